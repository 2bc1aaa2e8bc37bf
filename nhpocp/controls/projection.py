"""Carrying a control from one basis to another."""

from __future__ import annotations

import numpy as np

from nhpocp.controls.basis import ControlBasis
from nhpocp.controls.control import Control
from nhpocp.controls.samples import Samples
from nhpocp.controls.table import Gram

POINTS = 8  # Gauss-Legendre nodes per smooth piece: exact to degree 15


def project(control: Control, basis: ControlBasis) -> Control:
    """The control over ``basis`` that is nearest in ∫ |difference|² dt; the same horizon."""
    horizon = control.horizon
    pieces = max(32, 2 * basis.size, 2 * control.basis.size)
    knots = np.unique(
        np.concatenate([np.linspace(0, horizon, pieces + 1), control.breakpoints, basis.breakpoints(horizon)])
    )
    nodes, weights = np.polynomial.legendre.leggauss(POINTS)
    middles, halves = 0.5 * (knots[1:] + knots[:-1]), 0.5 * np.diff(knots)
    times = (middles[:, None] + halves[:, None] * nodes).ravel()
    fractions = (halves[:, None] * weights).ravel()
    moments = Samples(basis, horizon, times).transposed(fractions[:, None] * control(times))
    return Control(basis, Gram.of(basis.gram(horizon)).solve(moments).T, horizon)
