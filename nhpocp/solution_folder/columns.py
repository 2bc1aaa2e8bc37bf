"""The columns of trajectory.csv, by names that MATLAB, pgfplots and Julia take as they are."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from nhpocp import so3
from nhpocp.arrays import Array
from nhpocp.relative import blocks_with_goal, relative_to
from nhpocp.solution import Solution
from nhpocp.state_space import Block, shaped

ANGLES = ("roll", "pitch", "yaw")


@dataclass(frozen=True)
class Column:
    """A column: its name (letters, digits and underscores, components counted from 1), its numbers (samples,), and what
    version 0.1 called it, "" where it had none."""

    name: str
    values: Array
    former: str = ""


def columns(solution: Solution) -> list[Column]:
    """Every number of every entry of a trajectory, then roll, pitch and yaw, and the path relative to the goal."""
    every = [*_stored(solution), *_angles(solution), *_relative(solution)]
    names = identifiers(column.name for column in every)
    return [Column(name, column.values, column.former) for name, column in zip(names, every, strict=True)]


def identifiers(names: Iterable[str]) -> list[str]:
    """Names that are identifiers, each once: what is none is written with underscores, what is taken gets a number."""
    taken: list[str] = []
    for name in names:
        plain = re.sub(r"[^A-Za-z0-9_]", "_", name)
        base = other = plain if re.match("[A-Za-z]", plain) else f"x{plain}"
        count = 1
        while other in taken:
            count += 1
            other = f"{base}_{count}"
        taken.append(other)
    return taken


def _stored(solution: Solution) -> Iterator[Column]:
    blocks = {block.name: block for _, block in solution.problem.quantities}
    for name, values in solution.trajectory.items():
        table = np.asarray(values)
        stem = _stem(blocks.get(name) or shaped(name, ()))
        for place in np.ndindex(*table.shape[1:]):
            former = name + "".join(f"[{i}]" for i in place)
            yield Column(_numbered(stem, place), table[(slice(None), *place)], former)


def _stem(block: Block) -> str:
    """A block's name, or its symbol where that is a Greek letter: joint_angles are theta."""
    letter = re.fullmatch(r"\\([a-z]+)", block.symbol)
    return letter[1] if letter else block.name


def _numbered(stem: str, place: Iterable[int]) -> str:
    return "_".join([stem, *(str(i + 1) for i in place)])


def _angles(solution: Solution) -> Iterator[Column]:
    """R = Rz(yaw) Ry(pitch) Rx(roll) of every rotation of the state."""
    there = [block for block in solution.problem.system.state_space.blocks if block.kind == "rotation"]
    for block in (block for block in there if block.name in solution.trajectory):
        rotations = np.asarray(solution.trajectory[block.name], dtype=float)
        known = np.isfinite(rotations).all(axis=(1, 2))
        angles = np.full((len(rotations), 3), np.nan)
        for k in np.flatnonzero(known):
            angles[k] = np.ravel(so3.to_rpy(rotations[k]))
        for i, name in enumerate(ANGLES):
            yield Column(name if len(there) == 1 else f"{block.name}_{name}", angles[:, i])


def _relative(solution: Solution) -> Iterator[Column]:
    """[Paper] Fig. 3: e_p_1 … e_p_3 and r_1 … r_3; e_theta, say, of another system."""
    for block in blocks_with_goal(solution):
        values = np.asarray(solution.trajectory[block.name], dtype=float)
        table = relative_to(np.asarray(solution.problem.goal[block.name]), values, block)
        letter = block.symbol if re.fullmatch(r"[A-Za-z]", block.symbol) else _stem(block)
        stem = "r" if block.kind == "rotation" else f"e_{letter}"
        scalar = block.kind == "scalar"
        for i, numbers in enumerate(table.T):
            yield Column(stem if scalar else _numbered(stem, (i,)), numbers)
