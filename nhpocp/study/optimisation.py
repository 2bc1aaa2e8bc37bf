"""What an optimised study is after: which keys it may choose, and by what designs are compared."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from typing import Any, Literal

from nhpocp.constraints.registry import KINDS
from nhpocp.objectives.registry import available
from nhpocp.problem import PlanningProblem
from nhpocp.study.design import plain
from nhpocp.study.schema import OptimiseData
from nhpocp.systems.margins import margin

HORIZON = "horizon"  # of a problem; what the objective `time` costs
Row = Mapping[str, Any]  # of a store
Level = tuple[Any, ...]  # a value for each key that is optimised over


@dataclass(frozen=True)
class Variable:
    """A key of the problem and where the optimum is looked for: in the range [least, most], or among choices."""

    path: str
    values: tuple[Any, ...]
    degrees: bool = False  # whether the file gives them so

    @property
    def is_range(self) -> bool:
        """Whether any number between the two is meant."""
        return len(self.values) == 2 and self.numeric

    @property
    def numeric(self) -> bool:
        return all(isinstance(value, int | float) and not isinstance(value, bool) for value in self.values)


@dataclass(frozen=True)
class Quantity:
    """A number of a run, and of several goals together: costs are averaged, of the others the worst counts.

    kind: "cost", "least" or "peak", the least and the greatest magnitude along the path. parts: what it is read from.
    """

    kind: Literal["cost", "least", "peak"]
    parts: tuple[str, ...]

    def of_run(self, row: Row) -> float | None:
        """Its value; None where the run does not tell."""
        values = [self._of_part(row, part) for part in self.parts]
        known = [value for value in values if value is not None and isfinite(value)]
        return self._worst(known) if known and len(known) == len(values) else None

    def of_goals(self, values: Sequence[float]) -> float:
        """Its value over runs to several goals."""
        return sum(values) / len(values) if self.kind == "cost" else self._worst(values)

    def _worst(self, values: Sequence[float]) -> float:
        return min(values) if self.kind == "least" else max(values)

    def _of_part(self, row: Row, part: str) -> float | None:
        if part == HORIZON:
            value = json.loads(row["solved_control"] or "{}").get(part)
        elif self.kind == "cost":
            value = row[part]
        elif self.kind == "least" and margin(part):
            value = json.loads(row["margins"] or "{}").get(part)
        else:
            ends = json.loads(row["extremes"] or "{}").get(part) or []
            value = min(ends, default=None) if self.kind == "least" else max(map(abs, ends), default=None)
        return value


def quantities(problem: PlanningProblem) -> dict[str, Quantity]:
    """By name what designs can be compared by: costs, margins, limits of one number, and greatest magnitudes."""
    stored = [cost.name for cost in available(problem.system) if cost.of_motion]
    costs = {name: Quantity("cost", (name,)) for name in stored}
    margins, peaks, limits = {}, {}, {}
    for part, block in problem.quantities:
        if (known := margin(block.name)) and known.kind == "sigma":
            margins[block.name] = Quantity("least", (block.name,))
        elif part in ("input", "output") and block.kind != "rotation":
            peaks[block.name] = Quantity("peak", (block.name,))
    for key, kind in KINDS.items():
        if kind.shape == "number" and not kind.lacking(problem.system):
            parts = tuple(bound.quantity for bound in kind.bounds(1.0, problem.system))
            limits[key] = Quantity("least" if kind.side == "min" else "peak", parts)
    duration = Quantity("cost", (HORIZON,))
    return {**peaks, **limits, **margins, **costs, "time": duration, HORIZON: duration}


@dataclass(frozen=True)
class Objective:
    """A quantity of designs that is made least, or greatest."""

    name: str
    greatest: bool

    def __str__(self) -> str:
        return f"{'max' if self.greatest else 'min'} {self.name}"

    def merit(self, value: float) -> float:
        """The smaller, the better."""
        return -value if self.greatest else value


@dataclass(frozen=True)
class Optimisation:
    """So many trials, proposed in batches: designs over ``variables``, compared by ``objectives``."""

    variables: tuple[Variable, ...]
    objectives: tuple[Objective, ...]
    trials: int
    batch: int
    seed: int

    @property
    def identity(self) -> list[Any]:
        """What decides on the trials, whatever their number."""
        over = [[variable.path, variable.values] for variable in self.variables]
        return [over, [str(objective) for objective in self.objectives], self.batch, self.seed]


def _variable(path: str, values: list[Any]) -> Variable:
    degrees = any(isinstance(value, str) and value.endswith(" deg") for value in values)
    variable = Variable(path, tuple(map(plain, values)))
    return replace(variable, degrees=degrees and variable.numeric)


def optimisation_of(data: OptimiseData) -> Optimisation:
    """What the block of a study file asks for."""
    return Optimisation(
        tuple(_variable(path, values) for path, values in data.over.items()),
        tuple(
            Objective(name, direction == "max")
            for given in data.objectives
            for direction, name in given.items()
        ),
        data.trials,
        data.batch,
        data.seed,
    )
