"""Controls put together in sequence, taken apart again, and cut anywhere."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate

import numpy as np

from nhpocp.controls.basis import ControlBasis
from nhpocp.controls.control import Control
from nhpocp.controls.sequence import SequenceBasis, join, retimed

SHORTEST = 0.5  # of the mean duration: what a part of little effort gets of the whole
SAMPLES = 12  # for each function of a basis that a part is carried to


def concatenated(controls: Sequence[Control]) -> Control:
    """One control of unit time that does these, the pieces of sequences among them side by side.

    A part gets √E of the time, with which the whole costs (Σ √E)², the least of all divisions; more if that is short.
    """
    if len(controls) == 1:
        return controls[0]
    weights = np.sqrt([control.effort for control in controls])
    weights = np.maximum(weights, SHORTEST * weights.mean())
    parts = [retimed(c, w / weights.sum()) for c, w in zip(controls, weights, strict=True)]
    return retimed(joined([piece for part in parts for piece in pieces_of(part)]), 1.0)


def joined(pieces: Sequence[Control]) -> Control:
    """Pieces in sequence; one alone is itself."""
    return join(pieces) if len(pieces) > 1 else pieces[0]


def pieces_of(control: Control) -> list[Control]:
    """Those of a sequence; of another basis the control itself."""
    basis = control.basis
    if not isinstance(basis, SequenceBasis):
        return [control]
    firsts = list(accumulate((each.size for each in basis.bases), initial=0))
    return [
        Control(each, control.coefficients[:, first : first + each.size], fraction * control.horizon)
        for each, fraction, first in zip(basis.bases, basis.shares, firsts[:-1], strict=True)
    ]


def between(control: Control, first: float, last: float, basis: ControlBasis) -> Control:
    """What a control of unit time does between two times, as one of unit time over a basis: the nearest in the mean."""
    count = SAMPLES * max(basis.size, control.basis.size)
    times, share = (np.arange(count) + 0.5) / count, last - first
    values = share * control(first + share * times)
    return Control(basis, np.linalg.lstsq(basis.table(times, 1.0), values, rcond=None)[0].T)


def middle(control: Control, steps: int) -> float:
    """The time by which a control of unit time has done half of ∫ |u| dt, one of so many."""
    done = np.cumsum(np.linalg.norm(control((np.arange(steps) + 0.5) / steps), axis=1))
    return float(np.clip(np.searchsorted(done, 0.5 * done[-1]) + 1, 1, steps - 1)) / steps
