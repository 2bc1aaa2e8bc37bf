"""The contract of a solver's settings: what a problem file may say of it, and the solver made of that."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

from nhpocp.constructed import Constructed
from nhpocp.declared import check
from nhpocp.family import Family

if TYPE_CHECKING:
    from nhpocp.flow.compiled.kernels import Kernels
    from nhpocp.solution import Solver

# whether to compile the integrator
KERNELS: Family[type[Any]] = Family(
    {
        "auto": "nhpocp.flow.compiled.kernels:CompiledWhenReady",
        "always": "nhpocp.flow.compiled.kernels:Compiled",
        "never": "nhpocp.flow.compiled.kernels:Interpreted",
    }
)


class SolverSettings(Constructed):
    """A frozen dataclass of `declared` fields; its module imports nothing heavy, for `check` reads it.

    meaning: what the solver is, in a few words.
    """

    meaning: ClassVar[str]

    def __post_init__(self) -> None:
        check(self)

    @abstractmethod
    def solver(self, kernels: Kernels | None, others: Mapping[str, Solver]) -> Solver:
        """The solver. kernels: who evaluates, None for its own default; others: a problem's solvers made before it.

        Errors: `InvalidProblemError` for settings that do not go together.
        """
