"""The columns of trajectory.csv, by names that MATLAB, pgfplots and Julia take as they are."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from nhpocp import so3
from nhpocp.arrays import Array
from nhpocp.csv_writer import identifiers
from nhpocp.relative import blocks_with_goal, relative_to
from nhpocp.solution import Solution
from nhpocp.state_space import Block, shaped
from nhpocp.systems.margins import margin

ANGLES = ("roll", "pitch", "yaw")


@dataclass(frozen=True)
class Column:
    """A column and all that is known of it.

    name: letters, digits and underscores, components counted from 1. values: (samples,). unit: in words, "" for none.
    entry: where the numbers stand in arrays.npz, "v[0]", which was the column's name in version 0.1; "" for what is
    worked out from the others. meaning: words.
    """

    name: str
    values: Array
    unit: str
    meaning: str
    entry: str = ""


def columns(solution: Solution) -> list[Column]:
    """Every number of every entry of a trajectory, then roll, pitch and yaw, and the path relative to the goal."""
    every = [*_stored(solution), *_angles(solution), *_relative(solution)]
    names = identifiers(column.name for column in every)
    return [replace(column, name=name) for name, column in zip(names, every, strict=True)]


def _stored(solution: Solution) -> Iterator[Column]:
    problem = solution.problem
    known = {block.name: (what, block) for what, block in problem.quantities}
    for name, values in solution.trajectory.items():
        what, block = known.get(name, ("time" if name == "t" else "output", shaped(name, ())))
        table = np.asarray(values)
        unit = problem.units.words(block.unit, block.rate or what == "input")
        if block.kind in ("rotation", "direction"):
            unit = ""  # of the numbers of a matrix or a unit vector
        if what == "time":
            unit = problem.units.time or "time"
        for place in np.ndindex(*table.shape[1:]):
            entry = name + "".join(f"[{i}]" for i in place)
            numbers = table[(slice(None), *place)]
            yield Column(_numbered(_stem(block), place), numbers, unit, _meaning(what, block, place), entry)


def _meaning(what: str, block: Block, place: tuple[int, ...]) -> str:
    """What a number of a quantity is, in words."""
    if own := margin(block.name):
        kind = "least singular value" if own.kind == "sigma" else "determinant"
        return f"{kind} of {own.letter}"
    if what == "time":
        return what
    words = block.words or block.name.replace("_", " ")
    words += f"[{block.entries[place[0] if place else 0]}]" if block.entries else ""  # as messages call it
    return words if what == "output" else f"{what}: {words}"


def _stem(block: Block) -> str:
    """A block's name, or its symbol where that is a Greek letter: joint_angles are theta."""
    letter = re.fullmatch(r"\\(?:var)?([a-z]+)", block.symbol)
    return letter[1] if letter else block.name


def _numbered(stem: str, place: Iterable[int]) -> str:
    return "_".join([stem, *(str(i + 1) for i in place)])


def _angles(solution: Solution) -> Iterator[Column]:
    """R = Rz(yaw) Ry(pitch) Rx(roll) of every rotation of the state."""
    there = [block for block in solution.problem.system.state_space.blocks if block.kind == "rotation"]
    for block in (block for block in there if block.name in solution.trajectory):
        rotations = np.asarray(solution.trajectory[block.name], dtype=float)
        angles = np.full((len(rotations), 3), np.nan)
        for k in np.flatnonzero(np.isfinite(rotations).all(axis=(1, 2))):
            angles[k] = np.ravel(so3.to_rpy(rotations[k]))
        for name, numbers in zip(ANGLES, angles.T, strict=True):
            own = name if len(there) == 1 else f"{block.name}_{name}"
            yield Column(own, numbers, "rad", f"{name} of {block.name}, R = Rz(yaw) Ry(pitch) Rx(roll)")


def _relative(solution: Solution) -> Iterator[Column]:
    """[Paper] Fig. 3: e_p_1 … e_p_3 and r_1 … r_3; e_theta, say, of another system."""
    for block in blocks_with_goal(solution):
        values = np.asarray(solution.trajectory[block.name], dtype=float)
        table = relative_to(np.asarray(solution.problem.goal[block.name]), values, block)
        letter = block.symbol if re.fullmatch(r"[A-Za-z]", block.symbol) else _stem(block)
        turned = block.kind == "rotation"
        stem = "r" if turned else f"e_{letter}"
        meaning = f"{block.name.replace('_', ' ')} relative to the goal"
        meaning += ", [r] = log(R R_d^T)" if turned else ""
        for i, numbers in enumerate(table.T):
            name = stem if block.kind == "scalar" else _numbered(stem, (i,))
            yield Column(name, numbers, solution.problem.units.words(block.unit), meaning)
