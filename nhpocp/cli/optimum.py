"""The best trials of an optimised study, in words and as JSON."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import degrees
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from nhpocp.study.optimisation import Optimisation, Variable
    from nhpocp.study.trials import Trial

SHOWN = 12  # trials of a front in words; JSON has all


@dataclass(frozen=True)
class Optimum:
    """trials: how many are judged, infeasible ones among them. front: the best one, or those that none surpasses."""

    optimise: Optimisation
    trials: int
    infeasible: int
    front: Sequence[Trial]

    @staticmethod
    def of(optimise: Optimisation, trials: Sequence[Trial]) -> Optimum:
        from nhpocp.study.trials import front

        failed = sum(trial.failed > 0 for trial in trials)
        return Optimum(optimise, len(trials), failed, front(trials, optimise.objectives))

    def to_json(self) -> dict[str, Any]:
        names = [objective.name for objective in self.optimise.objectives]
        front = [
            {
                "trial": trial.number,
                "point": dict(trial.point),
                "values": dict(zip(names, trial.values, strict=True)),
                "runs": list(trial.runs),
            }
            for trial in self.front
        ]
        return {"trials": self.trials, "infeasible": self.infeasible, "front": front}

    def words(self) -> str:
        """The best so far, in a few words."""
        if not self.front:
            return "no trial without failed runs"
        if len(self.optimise.objectives) > 1:
            return f"{len(self.front)} trials in front"
        return f"best {self.optimise.objectives[0].name} {self.front[0].values[0]:.6g}"

    def lines(self) -> Iterator[str]:
        """What was found, and a table of the best."""
        made = f"{self.trials} trials" + (
            f", {self.infeasible} of them with failed runs" if self.infeasible else ""
        )
        if not self.front:
            yield f"{made}: none is feasible"
            return
        count = len(self.front)
        if len(self.optimise.objectives) == 1:
            yield f"{made}; the best:"
        else:
            some = f"; {SHOWN} of them" if count > SHOWN else ""
            yield f"{made}; {count} that none surpasses in all objectives (Pareto front){some}:"
        steps = min(count, SHOWN)
        places = [round(k * (count - 1) / max(steps - 1, 1)) for k in range(steps)]
        yield from _table([self._heads(), *(self._cells(self.front[place]) for place in places)])

    def _heads(self) -> list[str]:
        variables = [variable.path for variable in self.optimise.variables]
        return ["trial", *variables, *map(str, self.optimise.objectives), "runs"]

    def _cells(self, trial: Trial) -> list[str]:
        point = [_written(variable, trial.point[variable.path]) for variable in self.optimise.variables]
        runs = f"{trial.runs[0]}…{trial.runs[-1]}" if len(trial.runs) > 1 else str(trial.runs[0])
        return [str(trial.number), *point, *(f"{value:.6g}" for value in trial.values), runs]


def _written(variable: Variable, value: Any) -> str:
    if variable.numeric:
        return f"{degrees(value):.6g} deg" if variable.degrees else f"{value:.6g}"
    return str(value)


def _table(rows: Sequence[Sequence[str]]) -> Iterator[str]:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        yield "  " + "  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True))
