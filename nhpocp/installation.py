"""What this installation can do: versions, CasADi plugins, compiler, compiled kernels. The data of `nhpocp doctor`."""

from __future__ import annotations

from typing import Any

import casadi as ca

from nhpocp.constraints.registry import KINDS
from nhpocp.controls.registry import BASES
from nhpocp.family import Family
from nhpocp.flow.compiled.kernel_folder import cached
from nhpocp.interruption import Interruption
from nhpocp.objectives.registry import OBJECTIVES
from nhpocp.problem_file.registry import SYSTEMS
from nhpocp.provenance import environment
from nhpocp.solvers.continuation.settings import STEP_RULES
from nhpocp.solvers.nlp.ipopt import LINEAR_SOLVERS
from nhpocp.solvers.registry import SOLVERS

EXTENSIBLE: tuple[Family[Any], ...] = (SYSTEMS, BASES, STEP_RULES, SOLVERS, OBJECTIVES, KINDS)


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
    """What other distributions add, and what is wrong with what is broken of it."""
    told: list[str] = []
    for family in EXTENSIBLE:
        faults, added = family.faults(), family.plugins()
        noun = family.group.noun if family.group else ""
        told += [f"{name}, {noun} ({added[name][0]})" for name in family if name in added]
        told += faults
    return told


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
