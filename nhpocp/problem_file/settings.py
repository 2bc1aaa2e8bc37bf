"""The `solvers` block: settings of every solver, as names and numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BeforeValidator, Field, create_model

from nhpocp.problem_file.derived import block_fields
from nhpocp.problem_file.numbers import Choice
from nhpocp.problem_file.states import Strict
from nhpocp.solvers.registry import SOLVERS
from nhpocp.solvers.settings import KERNELS, SolverSettings


def absent(value: Any) -> Any:
    """Nothing, as a block whose lines are all commented out reads, stands for the block left out."""
    return {} if value is None else value


def _block(settings: type[SolverSettings]) -> type[Strict]:
    """The block of one solver."""
    return create_model(
        settings.__name__, __base__=Strict, __doc__=settings.__doc__, **block_fields(settings)
    )


BLOCKS = {name: _block(settings) for name, settings in SOLVERS.items()}
_FIELDS: dict[str, Any] = {
    name: (
        Annotated[block, BeforeValidator(absent)],
        Field(default_factory=lambda block=block: block(), description=SOLVERS[name].meaning),
    )
    for name, block in BLOCKS.items()
}
_FIELDS["compile"] = (
    Annotated[str, Choice(*KERNELS)],
    Field(default="auto", description="whether to compile the integrator with the system's C compiler"),
)
if TYPE_CHECKING:

    class Solvers(Strict):
        """A block for each solver by its name, and `compile`."""

        def __getattr__(self, name: str) -> Any: ...
else:
    Solvers = create_model("Solvers", __base__=Strict, __doc__="Settings of the solvers.", **_FIELDS)
