"""First-order optimality of an NLP's solution, computed again from its functions alone."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from nhpocp.arrays import Array


def kkt_residuals(programme: Any, x: Array, multipliers: Array) -> dict[str, float]:
    """Residuals of the Karush–Kuhn–Tucker conditions, each the largest absolute entry.

    stationarity: ∇f + ∇gᵀλ, by CasADi's reverse mode on the programme's value function (none of the matrices that the
    optimizer was given, and no kernel); feasibility: what g exceeds its bounds by; complementarity: λ times the slack
    of g.
    """
    unknowns, weights = ca.MX.sym("x", programme.size), ca.MX.sym("lam", len(multipliers))
    f, g = programme.nlp(unknowns, ca.MX(0, 1))
    lagrangian = ca.gradient(f + ca.dot(weights, g), unknowns)
    values = ca.Function("kkt", [unknowns, weights], [lagrangian, g])(x, multipliers)
    gradient, constraints = (np.array(value).ravel() for value in values)
    outside = np.maximum(programme.lower - constraints, constraints - programme.upper)
    towards = np.where(multipliers > 0, programme.upper - constraints, constraints - programme.lower)
    slack = np.where(multipliers == 0, 0.0, np.abs(np.where(np.isfinite(towards), towards, 1e20)))
    return {
        "stationarity": float(np.abs(gradient).max(initial=0.0)),
        "feasibility": float(np.maximum(outside, 0).max(initial=0.0)),
        "complementarity": float(np.abs(multipliers * slack).max(initial=0.0)),
    }
