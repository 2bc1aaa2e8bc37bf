"""Routes made easier to follow: by other poses, wherever those take fewer manoeuvres."""

from __future__ import annotations

from itertools import accumulate, pairwise

import numpy as np

from nhpocp.arrays import Array
from nhpocp.solvers.route.route import Poses, Route

TRIES = 300
IDLE = 60  # in succession, that change nothing, before no more are made
WORTH = (
    5.0  # tries for each manoeuvre that is left: one costs as much as 20 to 50 tries, few of which save one
)
EASY = 1.0  # manoeuvres: what takes fewer is left as it is
GAIN = 0.97  # of the manoeuvres of a part, that another way may take
REACHES = (0.2, 2.0)  # in units of the scales: half of the part that goes by a pose beside it
ASIDE = 0.5  # likewise, how far beside it, at most


def eased(route: Route, random: np.random.Generator) -> Route:
    """The route with parts gone straight, or by a pose beside them, at random places, where that takes less."""
    idle = 0
    for number in range(TRIES):
        left = route.manoeuvres(0.0, route.length)
        if idle == IDLE or left < EASY or number >= WORTH * left:
            break
        idle += 1
        first, way, last = _straight(route, random) if number % 2 else _beside(route, random)
        if _takes_less(route.poses, way, GAIN * route.manoeuvres(first, last)):
            route, idle = route.by(first, way, last), 0
    return route


def _takes_less(poses: Poses, way: list[Array], most: float) -> bool:
    """Whether a way takes fewer manoeuvres than that, and is valid; of one that takes more no more is looked at."""
    takes = accumulate(poses.manoeuvres(*ends) for ends in pairwise(way))
    return all(count < most for count in takes) and all(poses.valid(*ends) for ends in pairwise(way))


def _straight(route: Route, random: np.random.Generator) -> tuple[float, list[Array], float]:
    first, last = np.sort(random.uniform(0.0, route.length, 2))
    return float(first), [route.at(first), route.at(last)], float(last)


def _beside(route: Route, random: np.random.Generator) -> tuple[float, list[Array], float]:
    middle, reach = random.uniform(0.0, route.length), random.uniform(*REACHES)
    first, last = max(0.0, middle - reach), min(route.length, middle + reach)
    checks, scales = route.poses.checks, route.poses.scales
    aside = ASIDE * min(1.0, reach) * random.uniform() * random.normal(size=len(scales)) * scales
    by = checks.between(route.at(middle), aside, np.ones(1))[0]
    return first, [route.at(first), by, route.at(last)], last
