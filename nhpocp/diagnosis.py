"""What this installation can do: versions, CasADi plugins, compiler. The data of `nhpocp doctor`."""

from __future__ import annotations

from typing import Any

import casadi as ca

from nhpocp.solution_folder import environment


def diagnose() -> dict[str, Any]:
    """Versions and the parts that were found by asking for them."""
    return {
        **{name: value for name, value in environment().items() if name != "plugin"},
        "integrators": [name for name in ("rk", "cvodes") if ca.has_integrator(name)],
        "nlp solvers": [name for name in ("ipopt", "fatrop") if ca.has_nlpsol(name)],
    }
