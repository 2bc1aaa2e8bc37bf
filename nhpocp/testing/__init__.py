"""Laws that members of nhpocp's families keep, to be run on a plugin's: plain `AssertionError`s, whatever runs them.

Begin with `check_system`; each `check_…` runs the laws that nhpocp's own tests run on nhpocp's own members.
"""

from nhpocp.testing.bases import check_basis as check_basis
from nhpocp.testing.constraints import check_constraint as check_constraint
from nhpocp.testing.objectives import check_objective as check_objective
from nhpocp.testing.solvers import check_solver as check_solver
from nhpocp.testing.step_rules import check_step_rule as check_step_rule
from nhpocp.testing.systems import check_system as check_system

__all__ = [
    "check_basis",
    "check_constraint",
    "check_objective",
    "check_solver",
    "check_step_rule",
    "check_system",
]
