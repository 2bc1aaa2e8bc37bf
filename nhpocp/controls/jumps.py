"""Whether controls jump, which has no derivative."""

from __future__ import annotations

import numpy as np

from nhpocp.arrays import Array
from nhpocp.controls.basis import ControlBasis
from nhpocp.controls.control import Control

ROUNDING = 1e-9  # of a control of size 1


def jumps(control: Control) -> Array:
    """Largest change of an input at each of the control's breakpoints, (k,)."""
    breaks = control.breakpoints
    return np.abs(control(breaks, "left") - control(breaks, "right")).max(axis=1, initial=0.0)


def may_jump(basis: ControlBasis) -> bool:
    """Whether controls over a basis do, but for particular coefficients."""
    control = Control(basis, np.random.default_rng(0).normal(size=(1, basis.size)))
    return bool(jumps(control).max(initial=0.0) > ROUNDING)
