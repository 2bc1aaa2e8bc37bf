"""What this installation can do: versions, CasADi plugins, compiler, compiled kernels. The data of `nhpocp doctor`."""

from __future__ import annotations

from typing import Any

import casadi as ca

from nhpocp.flow.compiled.kernel_folder import cached
from nhpocp.interruption import Interruption
from nhpocp.problem_file.registry import SYSTEMS, every_class
from nhpocp.provenance import environment
from nhpocp.solvers.nlp.ipopt import LINEAR_SOLVERS


def diagnose() -> dict[str, Any]:
    """Versions and the parts that were found by asking for them; linear solvers by solving with them."""
    with Interruption() as interruption:
        parts = _parts()
        interruption.check()  # CasADi makes a failure of it, which is none of the solver's
    return parts


def _parts() -> dict[str, Any]:
    return {
        **{name: value for name, value in environment().items() if name != "plugin"},
        "integrators": [name for name in ("rk", "cvodes") if ca.has_integrator(name)],
        "nlp solvers": [name for name in ("ipopt", "fatrop") if ca.has_nlpsol(name)],
        "linear solvers of ipopt": [name for name in LINEAR_SOLVERS if _solves(name)],
        "plugins": plugins(),
        "cache": cached(),
    }


def plugins() -> list[str]:
    """Systems of other distributions, and what is wrong with those that are broken."""
    classes, broken = every_class()
    return [f"{model} ({cls.__module__})" for model, cls in classes.items() if model not in SYSTEMS] + broken


def _solves(linear_solver: str) -> bool:
    """Whether IPOPT solves min x² + y², x + y = 1 with this linear solver."""
    x = ca.SX.sym("x", 2)
    options: dict[str, Any] = {
        "print_time": False,
        "ipopt": {"print_level": 0, "sb": "yes", "linear_solver": linear_solver},
    }
    try:
        solver = ca.nlpsol("tried", "ipopt", {"x": x, "f": ca.sumsqr(x), "g": ca.sum1(x)}, options)
        optimum = solver(x0=0, lbg=1, ubg=1)
    except RuntimeError:
        return False
    return bool(solver.stats()["success"]) and abs(float(optimum["f"]) - 0.5) < 1e-6
