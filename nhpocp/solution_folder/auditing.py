"""What a solution folder states, held against what its problem and its control give when they are worked out again."""

from __future__ import annotations

import csv
import io
import json
import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from nhpocp.csv_writer import as_text
from nhpocp.errors import InvalidProblemError
from nhpocp.objectives.registry import costs_of_motion, exact_costs
from nhpocp.outcome import Outcome
from nhpocp.problem_file.dumping import writable
from nhpocp.solution import Solution, Verdict
from nhpocp.solution_folder.columns import columns
from nhpocp.solution_folder.plain_data import checksum, plain, to_json
from nhpocp.solution_folder.reading import content, json_content, load_solution
from nhpocp.verification import verify
from nhpocp.verification.costs import replayed_costs

RECOMPUTED = ("name", "system", "converged", "effort", "crossings", "length_scale", "constraints")
WORDS = ("method", "reasons", "warnings")  # of a verdict: they may change with the version that speaks them
CLOSE = 1e-4  # relative, between two integrations of one number
NOTHING = 1e-8  # below it a number is an integration's error, which no two machines share
COPIED = 1e-9  # relative, between two copies of one number


@dataclass(frozen=True)
class Audit:
    """A folder read, judged afresh, and compared with what it says.

    differences: what the folder states and is not so, in words; unchecked: what could not be worked out again.
    """

    solution: Solution  # with the fresh verdict and costs
    stated: Solution  # as the folder has it
    differences: list[str] = field(default_factory=list)
    unchecked: list[str] = field(default_factory=list)

    @property
    def verdict(self) -> Verdict:
        if self.solution.verdict is None:
            raise RuntimeError("an audit without a verdict")
        return self.solution.verdict

    @property
    def ok(self) -> bool:
        """Whether the solution is verified and the folder says nothing else than what was found."""
        return self.verdict.ok and not self.differences


def audit(folder: str | os.PathLike[str]) -> Audit:
    """Works out again what a folder states.

    Errors: `UnreadableSolutionError` where it cannot be read, or is damaged.
    """
    home = Path(folder)
    stored = load_solution(home)
    stated = json.loads(json_content(home / "solution.json"))
    verdict = verify(stored)
    costs = replayed_costs(stored.problem, stored.control) if verdict.error is not None else None
    fresh = replace(stored.judged(verdict), timing=stored.timing, costs=costs or stored.costs)
    comparison = _Comparison(home, stated, stored, fresh, costs is not None)
    return Audit(
        _as_stored(stored, fresh), stored, list(comparison.differences()), list(comparison.unchecked())
    )


def _as_stored(stored: Solution, fresh: Solution) -> Solution:
    """The fresh solution with those of the stored costs that are right: they are what other tables show."""
    right = {
        name: value
        for name, value in stored.costs.items()
        if name in fresh.costs and not list(_apart(name, value, fresh.costs[name]))
    }
    return replace(fresh, costs={**fresh.costs, **right})


@dataclass(frozen=True)
class _Comparison:
    """One folder's statements beside what was found; every method yields sentences."""

    home: Path
    stated: Mapping[str, Any]
    stored: Solution
    fresh: Solution
    whole: bool  # whether the replay reached the end

    def differences(self) -> Iterator[str]:
        verified = self.stored.verdict is not None  # else it states no more than that nobody looked
        expected = to_json(self.fresh if verified else replace(self.fresh, verdict=None))
        for name in RECOMPUTED:
            if name not in self.stated:
                yield f"{name} is missing in solution.json"
            else:
                yield from _apart(name, self.stated[name], expected[name])
        for name in costs_of_motion()[1:]:
            if name in self.stated and (self.whole or name not in self._along_the_path):
                yield from _apart(name, self.stated[name], expected[name])
        if verified:
            yield from self._verdict(expected["verified"])
        yield from self._settings()
        yield from self._endings()
        yield from self._records()
        yield from self._files()
        if self.stated.get("checksum") not in (None, checksum(self.stated)):
            yield "solution.json was changed after it had been written: its checksum does not fit"

    @property
    def _along_the_path(self) -> list[str]:
        """The costs that a replay has to tell."""
        exact = exact_costs(self.stored.control)
        return [name for name in costs_of_motion() if name not in exact]

    def unchecked(self) -> Iterator[str]:
        if "checksum" not in self.stated:
            yield "solution.json has no checksum: what cannot be worked out again, as messages and timing, is as stated"
        if not self.whole:
            yield f"{' and '.join(self._along_the_path)}: the replay does not reach the end"
        if self.stored.evaluations and not self.stored.iterations:
            yield f"evaluations: {self.stored.evaluations} as stated; this folder holds no records of the iterations"
        if self.stored.details.get("costates") is not None:
            yield "details.costates: only their shape; they follow from multipliers, which are not stored"
        for key, value in self._unnamed().items():
            yield f"settings.{key}: {value!r} is nothing that a problem file has a word for"
        if self.stored.solver not in self.stored.problem.solvers:
            yield f"solver: {self.stored.solver!r} is none that a problem file names, so its settings are as stated"

    def _verdict(self, expected: Mapping[str, Any]) -> Iterator[str]:
        """The stored verdict's numbers; one of an older version may lack some."""
        stated = self.stated["verified"]
        if bool(stated["reasons"]) == stated["ok"]:
            yield f"verified.reasons: {len(stated['reasons'])} of them, but verified.ok is {_said(stated['ok'])}"
        for key in expected:
            if key in stated and key not in WORDS:
                yield from _apart(f"verified.{key}", stated[key], expected[key])

    def _settings(self) -> Iterator[str]:
        """Settings, tolerance and objective against those of the problem file."""
        solution = self.stored
        own = self._own_settings()
        if own is None:
            return
        unnamed = self._unnamed()
        for key in dict.fromkeys([*solution.settings, *own]):
            if key not in unnamed:
                there = solution.settings.get(key), plain(own.get(key))
                yield from _apart(f"settings.{key}", *there, "problem.yaml says")
        wanted = own.get("objective", solution.problem.objective)
        # "none" is written by methods that lower no cost, and was once where nothing was tried
        lowers_one = "objective" in own and solution.iterations
        if lowers_one or solution.objective != "none":
            yield from _apart("objective", solution.objective, wanted, "problem.yaml says")

    def _own_settings(self) -> Mapping[str, Any] | None:
        solver = self.stored.problem.solvers.get(self.stored.solver)
        return None if solver is None else dict(solver.settings())

    def _unnamed(self) -> dict[str, Any]:
        """Settings that no problem file can state, such as a step rule of the user's own."""
        solution, own = self.stored, self._own_settings() or {}
        return {
            key: value
            for key, value in solution.settings.items()
            if key in own and plain(own[key]) != value and not writable(solution.solver, {key: value})
        }

    def _endings(self) -> Iterator[str]:
        """How it ended, and with what error."""
        stored, verdict = self.stored, self.fresh.verdict
        if verdict is None:
            return
        if stored.outcome is not self.fresh.outcome:
            yield f"outcome is converged, but the replay refutes it: {verdict.refusal}"
        if stored.outcome is Outcome.NOT_VERIFIED and verdict.ok:
            yield "outcome is not_verified, but the replay finds nothing against the solution"
        believed = stored.final_error
        if stored.solver == "jacobian" and stored.iterations:
            errors = [record.get("error") for record in stored.iterations]
            if math.isfinite(believed) and not any(_close(believed, error, COPIED, 0.0) for error in errors):
                yield f"final_error is {believed:.6g}, which is the error of none of the iterations"
        elif (
            stored.outcome is Outcome.CONVERGED
            and verdict.error is not None
            and not abs(believed - verdict.error) <= stored.tolerance
        ):
            yield f"final_error is {believed:.6g}; the replay ends with {verdict.error:.6g}"

    def _records(self) -> Iterator[str]:
        """What the solve counted, as far as its records say."""
        stored = self.stored
        count = len(stored.iterations)
        if stored.solver == "jacobian" and count and stored.evaluations != count:
            yield f"evaluations is {stored.evaluations}, but there are {count} iterations, one for each"
        steps = [record["k"] for record in stored.iterations]
        for before, after in pairwise([-1, *steps]):  # a further try begins with 0
            if after > before + 1:
                yield f"iterations go on with k = {after} after {max(before, 0)}"
                break
        last = max(steps, default=0)
        if stored.evaluations < last:
            yield f"evaluations is {stored.evaluations}, fewer than the {last} iterations"
        costates = stored.details.get("costates")
        if costates is not None:
            dimension = stored.problem.system.state_space.dimension
            try:
                table = np.array(costates, dtype=float)
            except (TypeError, ValueError):
                table = np.empty(0)
            if table.ndim != 2 or table.shape[1] != dimension or not np.isfinite(table).all():
                yield f"details.costates is no table of finite numbers, {dimension} for every node"

    def _files(self) -> Iterator[str]:
        """The tables of the trajectory against each other, and their times against the problem's own."""
        stored = self.stored
        for name in sorted(set(self.stated["trajectory"]) ^ set(stored.trajectory)):
            where = "arrays.npz" if name in stored.trajectory else "solution.json"
            yield f"trajectory.{name} is in {where} alone"
        samples = stored.problem.samples
        if len(stored.trajectory["t"]) != samples:
            yield f"trajectory has {len(stored.trajectory['t'])} samples; problem.yaml says {samples}"
        expected = self.fresh.problem.system.state_space.names
        if all(name in stored.trajectory for name in expected):
            yield from self._table()

    def _table(self) -> Iterator[str]:
        """The first place where trajectory.csv says something else; if it is missing, it states nothing."""
        file = self.home / "trajectory.csv"
        if not file.exists():
            return
        every = columns(self.stored)
        try:
            text = content(file).decode("utf-8", errors="replace")
        except (OSError, InvalidProblemError) as error:
            yield f"trajectory.csv cannot be read: {getattr(error, 'strerror', None) or error}"
            return
        header, *rows = list(csv.reader(io.StringIO(text, newline=""))) or [[]]
        former = [column for column in every if column.entry]
        if header == [as_text(column.entry) for column in former]:  # of version 0.1
            every = former
        elif header != [column.name for column in every]:
            yield "trajectory.csv: its header is not that of this trajectory"
            return
        table = np.column_stack([column.values for column in every])
        if len(rows) != len(table) or any(len(row) != len(header) for row in rows):
            yield f"trajectory.csv has {len(rows)} rows; the trajectory has {len(table)}"
        else:
            numbers = np.array([[_number(cell) for cell in row] for row in rows])
            wanted = np.where(np.isfinite(table), table, np.inf)
            for k, i in np.argwhere(~np.isclose(numbers, wanted, rtol=COPIED, atol=1e-12))[:1]:
                cell = rows[k][i] or "empty"
                yield f"trajectory.csv: {header[i]} is {cell} in row {k + 1}; the trajectory has {table[k, i]:.9g}"


def _number(cell: str) -> float:
    """A cell of a table: infinite where it is empty, NaN, which is close to nothing, where it is no number."""
    if not cell:
        return math.inf
    try:
        return float(cell)
    except ValueError:
        return math.nan


def _apart(path: str, stated: Any, computed: Any, source: str = "worked out again it is") -> Iterator[str]:
    """Every place where plain data say something else than what was found."""
    if isinstance(stated, Mapping) and isinstance(computed, Mapping):
        for key in dict.fromkeys([*computed, *stated]):
            if key not in stated:
                continue  # an older version did not write it
            yield from _apart(f"{path}.{key}", stated[key], computed.get(key), source)
    elif (
        isinstance(stated, list | tuple)
        and isinstance(computed, list | tuple)
        and len(stated) == len(computed)
    ):
        for k, (one, other) in enumerate(zip(stated, computed, strict=True)):
            yield from _apart(f"{path}[{k}]", one, other, source)
    elif not _close(stated, computed, CLOSE, NOTHING):
        yield f"{path} is {_said(stated)}; {source} {_said(computed)}"


def _close(one: Any, other: Any, relative: float, absolute: float) -> bool:
    numbers = [isinstance(value, int | float) and not isinstance(value, bool) for value in (one, other)]
    if not all(numbers):
        return bool(type(one) is type(other) and one == other)
    return math.isclose(one, other, rel_tol=relative, abs_tol=absolute)


def _said(value: Any) -> str:
    """A value in few words."""
    if isinstance(value, float):
        return f"{value:.6g}"
    text = json.dumps(value, default=str, ensure_ascii=False)
    return text if len(text) <= 80 else f"{text[:77]}…"
