"""What a trajectory consists of, by name: a system's states, inputs, outputs and margins as blocks."""

from __future__ import annotations

from nhpocp.arrays import Array
from nhpocp.errors import InvalidProblemError
from nhpocp.kept import kept
from nhpocp.state_space import Block, scalar, shaped
from nhpocp.systems.margins import det, sigma
from nhpocp.systems.system import System, check_names


class _Anywhere:
    """A packed state of a system, of which one is as good as another: all are equal."""

    def __init__(self, point: Array) -> None:
        self.point = point

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Anywhere)

    def __hash__(self) -> int:
        return 0


def quantities(system: System, point: Array) -> list[tuple[str, Block]]:
    """Of each part of a trajectory what it is, state, input, output or margin, and its block.

    point: a packed state with numbers; beside it outputs and matrices are made, for their names and shapes, which are
    those of every state, and are kept.
    Errors: `InvalidProblemError` where two parts have one name, or an output another shape than is declared.
    """
    return list(_quantities(system, _Anywhere(point)))


@kept(most=64)
def _quantities(system: System, anywhere: _Anywhere) -> list[tuple[str, Block]]:
    import numpy as np

    # beside the point, where the machine may be singular; what is not finite has a shape all the same
    aside = np.linspace(0.01, 0.02, system.state_space.dimension)
    with np.errstate(all="ignore"):
        near = np.asarray(system.state_space.retract(anywhere.point, aside))
        values = system.outputs(near, np.zeros(system.input_space.size))
        matrices = list(system.regularity(near))
    declared = {block.name: block for block in system.output_blocks or ()}
    more = [block for block in system.quantity_blocks if block.name not in declared]
    outputs = []
    for name, value in values.items():
        shape = tuple(size for size in np.shape(value) if size > 1)
        block = declared.get(name) or shaped(name, shape)
        if shape != tuple(size for size in block.shape if size > 1):
            raise InvalidProblemError(f"output {name!r} is of shape {shape}; declared is {block.shape}")
        outputs.append(block)
    margins = [kind(name) for kind in (sigma, det) for name in matrices]
    parts = [
        *(("state", block) for block in system.state_space.blocks),
        *(("input", block) for block in system.input_space.blocks),
        *(("output", block) for block in (*outputs, *more)),
        *(("margin", scalar(margin.name, symbol=margin.symbol)) for margin in margins),
    ]
    check_names([(what, block) for what, block in parts if block not in more])
    return parts
