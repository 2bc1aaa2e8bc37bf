"""The solvers by name: settings in a file, choices of the command line and variants follow from these lines."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from nhpocp.errors import InvalidProblemError
from nhpocp.family import Family, Group
from nhpocp.solvers.settings import SolverSettings

if TYPE_CHECKING:
    from nhpocp.flow.compiled.kernels import Kernels
    from nhpocp.solution import Solver

SOLVERS: Family[type[SolverSettings]] = Family(
    {
        "jacobian": "nhpocp.solvers.continuation.settings:JacobianSettings",
        "nlp": "nhpocp.solvers.nlp.settings:NlpSettings",
        "least_squares": "nhpocp.solvers.least_squares:LeastSquaresSettings",
        "sinusoids": "nhpocp.solvers.sinusoids:SinusoidsSettings",
    },
    group=Group(
        "nhpocp.solvers",
        "nhpocp.solvers.settings:SolverSettings",
        "",
        "a solver",
        ("compile", "tolerance", "source"),
    ),
)


def made_solver(
    name: str,
    settings: SolverSettings,
    kernels: Kernels | None = None,
    others: Mapping[str, Solver] | None = None,
) -> Solver:
    """The solver of some settings, as `SolverSettings.solver`.

    Errors: `InvalidProblemError` where it is not called as they are.
    """
    solver = settings.solver(kernels, others or {})
    if solver.name != name:
        maker = f"{type(settings).__module__}:{type(settings).__name__}"
        words = f"{maker} makes a solver that calls itself {solver.name!r}; expected {name!r}"
        raise InvalidProblemError(words, path=f"solvers.{name}")
    return solver
