"""What a trajectory consists of, by name: a system's states, inputs, outputs and margins as blocks."""

from __future__ import annotations

from nhpocp.errors import InvalidProblemError
from nhpocp.kept import kept
from nhpocp.state_space import Block, scalar, shaped
from nhpocp.systems.margins import det, sigma
from nhpocp.systems.system import System, check_names


@kept(most=64)
def quantities(system: System) -> list[tuple[str, Block]]:
    """Of each part of a trajectory what it is, state, input, output or margin, and its block.

    Outputs and matrices are made at some state, for their names and shapes.
    Errors: `InvalidProblemError` where two parts have one name, or an output another shape than is declared.
    """
    import numpy as np

    with np.errstate(all="ignore"):  # what is not finite has a shape all the same
        values = system.outputs(system.somewhere, np.zeros(system.input_space.size))
        matrices = list(system.regularity(system.somewhere))
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
