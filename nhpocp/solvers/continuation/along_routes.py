"""The way along routes of poses: a route, manoeuvres along it, and another where those do not lead to the end."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple, Protocol

import numpy as np

from nhpocp.controls.control import Control
from nhpocp.interruption import Interruption
from nhpocp.problem import PlanningProblem
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.route_manoeuvres import FRUGAL, GENTLE, Choice, RouteManoeuvres
from nhpocp.solvers.route.find_route import find_route, lacking
from nhpocp.solvers.route.sketch import sketched_route, sketched_trees

ATTEMPTS = 6  # with other seeds
FOR_LESS = 10  # likewise, where one has led to the goal and others may cost less
CHOICES = (FRUGAL, GENTLE)  # in turn
PATIENCE = 80.0  # manoeuvres that a route may seem to take, before another is tried


class Told(Protocol):
    """What hears of the way: the search that it is of."""

    problem: PlanningProblem
    base: Continuation

    def telling(self, way: str) -> None:
        """Hears what is being tried."""
        ...

    def note(self, way: str, outcome: str, error: float) -> None:
        """How a way ended that leaves no plan."""
        ...


class AlongRoute(NamedTuple):
    """A way to the goal along a route."""

    way: str  # in words
    controls: list[Control]  # the manoeuvres
    steps: int  # with which each is known to lead where it does
    sketch: dict[str, Any]  # of the route, for pictures


class AlongRoutes:
    """followed: whether there was a route. no_route: what is known of none, in words.

    sketch: for pictures of a failure, of the last route, or of the trees where none was found.
    """

    def __init__(self, search: Told, seconds: float, required: bool) -> None:
        """seconds: for which a route is looked for, at most. required: whether OMPL is."""
        self._search, self._seconds, self._required = search, seconds, required
        self.followed, self.no_route = False, ""
        self.sketch: dict[str, Any] = {}

    def ways(self) -> Iterator[AlongRoute]:
        """Those that lead to the goal, as they are found.

        What ends short of the goal, or multiplies errors beyond what a replay can check, is noted. Errors: Ctrl-C's;
        `MissingDependencyError` where OMPL is required and not installed.
        """
        search = self._search
        if lacking(search.problem):
            return
        slow, reached = list[RouteManoeuvres](), False
        for attempt in range(FOR_LESS):
            if attempt >= ATTEMPTS and not reached:
                break
            manoeuvres = self._manoeuvres(search.base.seed + attempt, CHOICES[attempt % len(CHOICES)])
            if manoeuvres is None:
                if not self.followed:
                    return
                continue
            self.followed = True
            self._walked(manoeuvres, PATIENCE)
            if manoeuvres.arrived or manoeuvres.delicate:
                reached |= manoeuvres.arrived and search.base.objective != "none"
                yield from self._ended(manoeuvres)
            else:
                slow.append(manoeuvres)
        for manoeuvres in sorted(slow, key=lambda one: one.part, reverse=True):
            self._walked(manoeuvres, np.inf)
            yield from self._ended(manoeuvres)

    def _walked(self, manoeuvres: RouteManoeuvres, patience: float) -> None:
        for fraction in manoeuvres.walk(patience):
            self._search.telling(f"manoeuvres along a route, {fraction:.0%} of it")

    def _ended(self, manoeuvres: RouteManoeuvres) -> Iterator[AlongRoute]:
        """Those that lead to the goal; others are noted."""
        count, ended = len(manoeuvres.controls), ""
        if manoeuvres.delicate:
            ended = f"{count} manoeuvres along a route, which multiply errors by {manoeuvres.growth:.1g}"
        elif not manoeuvres.arrived:
            ended = f"manoeuvres along a route, stuck after {count} at {manoeuvres.part:.0%} of it"
        if ended:
            error = self._search.problem.goal_error(manoeuvres.here)
            self._search.note(ended, "stagnated", error)
            return
        words = f"{count} manoeuvres in sequence" if count > 1 else "a manoeuvre"
        sketch = {"route": sketched_route(manoeuvres.whole)}
        yield AlongRoute(f"{words} along a route", manoeuvres.controls, manoeuvres.steps, sketch)

    def _manoeuvres(self, seed: int, choice: Choice) -> RouteManoeuvres | None:
        """Along a route, if there is one."""
        search = self._search
        search.telling("looking for a route")
        with Interruption() as interruption:
            found = find_route(
                search.problem, self._seconds, seed, lambda: interruption.noted, self._required
            )
            interruption.check()
        if found.route is None or found.checks is None:
            self.no_route = found.words
            if found.trees and not self.followed:
                self.sketch = {"trees": sketched_trees(found.trees)}
            return None
        self.sketch = {"route": sketched_route(found.route)}
        return RouteManoeuvres(search.problem, search.base, found.route, found.checks, seed, choice)
