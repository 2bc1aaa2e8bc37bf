"""Whether every pose of a motion between two poses is valid, not only those that were looked at."""

from __future__ import annotations

import numpy as np

from nhpocp.arrays import Array
from nhpocp.solvers.route.pose_checks import PoseChecks

STEP = 0.1  # of the pose's scales, about 6 degrees: between the first samples
FEWEST = 3  # samples: two on either side of what is thin may have the same slacks
FARTHEST = 2000.0  # in units of the scales: what is longer is not looked at
HALVINGS = 7  # of that step, before a pose that might be invalid counts as one
STEEPER = 2.0  # times as steep as the samples around: how a slack may fall between two of them


def free(checks: PoseChecks, here: Array, tangent: Array, size: float) -> bool:
    """Whether the motion along a tangent from a pose is valid; size: of the tangent, in units of the pose's scales.

    A slack that changes by d between neighbours is taken to be no steeper than `STEEPER` d on the way, and may then not
    reach zero; where it might, poses between are looked at, ever closer. So steps are small only near what refuses.
    """
    if not size < FARTHEST:
        return False
    fractions = np.linspace(0.0, 1.0, max(FEWEST, 2 + int(size / STEP)))
    slacks = checks.slacks(checks.between(here, tangent, fractions))
    for _ in range(HALVINGS):
        if checks.refuse(slacks):
            return False
        doubtful = _doubtful(slacks, np.diff(fractions))
        if not doubtful.any():
            return True
        middle = 0.5 * (fractions[:-1] + fractions[1:])[doubtful]
        more = checks.slacks(checks.between(here, tangent, middle))
        places = np.flatnonzero(doubtful) + 1
        fractions, slacks = np.insert(fractions, places, middle), np.insert(slacks, places, more, axis=0)
    checks.refuse(slacks[slacks.min(axis=1).argmin()][None] - slacks.min())  # what is nearest to its limit
    return False


def clear(checks: PoseChecks, path: Array) -> bool:
    """Whether a path is valid at its poses (k, size), and surely between them."""
    slacks = checks.slacks(path)
    return not checks.refuse(slacks) and not _doubtful(slacks, np.ones(len(path) - 1)).any()


def _doubtful(slacks: Array, steps: Array) -> Array:
    """Between which neighbours (k - 1,) one of the slacks (k, slacks) might reach zero."""
    slopes = np.abs(np.diff(slacks, axis=0)) / steps[:, None]
    steepest = slopes.copy()
    steepest[1:] = np.maximum(steepest[1:], slopes[:-1])
    steepest[:-1] = np.maximum(steepest[:-1], slopes[1:])
    return np.asarray((slacks[:-1] + slacks[1:] <= STEEPER * steepest * steps[:, None]).any(axis=1))
