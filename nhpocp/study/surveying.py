"""A store made into a `Survey`: rows are read one at a time, in one state of the store, and none is kept."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from datetime import datetime
from typing import Any

import numpy as np

from nhpocp.errors import InvalidProblemError, describe, one_line
from nhpocp.objectives.registry import costs_of_motion
from nhpocp.problem import PlanningProblem
from nhpocp.problem_file.reading import read_text
from nhpocp.study.charting import Charting, axes_of
from nhpocp.study.store import Store
from nhpocp.study.study import Study, read_study_text
from nhpocp.study.trials import known
from nhpocp.survey import Failures, Profiles, Quantity, Spread, Survey, shift_of
from nhpocp.systems.margins import margin

QUANTILES = 201
KINDS_OF_FAILURE = 300  # that are told apart while they are counted
SOLVED = "converged"


def survey(store: Store) -> Survey:
    """What the runs of a store found together.

    Errors: `InvalidProblemError` for a store that is damaged, or whose study can no longer be read, such as without a
    plugin.
    """
    with store.snapshot():
        store.check()
        facts = store.facts
        study = read_study_text(facts["study"], f"{facts['name']}.yaml", facts["problem"])
        study = known(study, store) if study.optimise else study
        problem = read_text(facts["problem"], facts["problem_file"]).problem
        return _Surveyor(store, study, problem).survey()


class _Surveyor:
    def __init__(self, store: Store, study: Study, problem: PlanningProblem) -> None:
        self.store, self.study, self.problem = store, study, problem
        self.counts: dict[str, Counter[str]] = {label: Counter() for label in study.solvers}
        for label, outcome, count in store.select(
            "variant, outcome, count(*) FROM runs GROUP BY variant, outcome"
        ):
            if label not in self.counts:
                words = f"damaged: {describe(label)} is none of the study's solvers"
                raise InvalidProblemError(words, path="runs: variant")
            self.counts[label][outcome] += count
        every = sum(self.counts.values(), Counter[str]())
        failed = sorted((name for name in every if name != SOLVED), key=lambda name: (-every[name], name))
        self.outcomes = (SOLVED, *failed)
        self.columns = self._columns()
        self.cost = next(quantity.name for quantity in self.columns if quantity.kind == "cost")

    def survey(self) -> Survey:
        study, store = self.study, self.store
        axes = axes_of(study)
        charting = Charting(store, study, axes, self.outcomes)
        shown = {
            quantity.name: column
            for quantity, column in self.columns.items()
            if quantity.kind in ("cost", "evaluations")
        }
        spreads = {
            quantity.name: {label: self._spread(label, column) for label in study.solvers}
            for quantity, column in self.columns.items()
        }
        environments, seconds, workers = self._sessions()
        ((processor,),) = store.select("total(solve_s) + total(verify_s) FROM runs")
        return Survey(
            name=study.name,
            store=str(store.file),
            text=study.text,
            problem_text=study.problem_text,
            problem=self.problem,
            runs=len(study),
            order=study.order,
            axes=axes,
            solvers=study.solvers,
            tallies={label: (sum(some.values()), some[SOLVED]) for label, some in self.counts.items()},
            outcomes=self.outcomes,
            quantities=tuple(quantity for quantity in self.columns if self._known(spreads[quantity.name])),
            cost=self.cost,
            spreads=spreads,
            chart=charting.chart(shown, self.columns_of_cost()),
            profiles=self._profiles(spreads) if len(study.solvers) > 1 else {},
            failures=self._failures(),
            environments=environments,
            seconds=seconds,
            processor=processor,
            workers=workers,
            batched=self._batched(),
            unminimised=self._unminimised(),
        )

    @staticmethod
    def _known(spreads: Mapping[str, Spread]) -> bool:
        return any(spread.count for spread in spreads.values())

    def columns_of_cost(self) -> str:
        """Where the cost stands in a row."""
        return next(column for quantity, column in self.columns.items() if quantity.kind == "cost")

    def _columns(self) -> dict[Quantity, str]:
        """What is measured, and where it stands in a row."""
        varied, own = "objective" in self.store.axes, self.problem.objective
        cost = own if own in costs_of_motion() and not varied else "effort"
        names = [
            name
            for (name,) in self.store.select(
                "DISTINCT key FROM runs, json_each(runs.margins) WHERE converged ORDER BY key"
            )
            if re.fullmatch(r"\w+", name) and margin(name)
        ]
        return {
            Quantity(cost, "cost"): cost,
            Quantity("verified_error", "error"): "verified_error",
            Quantity("evaluations", "evaluations"): "evaluations",
            Quantity("seconds", "seconds"): "solve_s",
            **{Quantity(name, "margin"): f"json_extract(margins, '$.{name}')" for name in names},
        }

    def _spread(self, label: str, column: str) -> Spread:
        """Exact quantiles of the solved runs, which SQLite sorts."""
        known = f"FROM runs WHERE variant = ? AND converged AND {column} IS NOT NULL"
        ((count,),) = self.store.select(f"count(*) {known}", [label])
        if not count:
            return Spread(0, np.empty(0))
        wanted = sorted({round(k * (count - 1) / (QUANTILES - 1)) for k in range(QUANTILES)})
        wanted_set = set(wanted)
        values = self.store.select(f"{column} {known} ORDER BY {column}", [label])
        kept = [value for place, (value,) in enumerate(values) if place in wanted_set]
        return Spread(count, np.asarray(kept, dtype=float))

    def _sessions(self) -> tuple[tuple[dict[str, Any], ...], float, tuple[int, ...]]:
        """Versions and machine of every session, seconds by the clock of all, and processes."""
        environments, seconds, workers = [], 0.0, []
        query = """sessions.environment, sessions.workers, sessions.began, max(runs.finished) FROM sessions
                   JOIN runs ON runs.session = sessions.session GROUP BY sessions.session"""
        for environment, processes, began, ended in self.store.select(query):
            try:
                known = {key: value for key, value in json.loads(environment).items() if value is not None}
                span = datetime.fromisoformat(ended) - datetime.fromisoformat(began)
                workers.append(int(processes))
            except (TypeError, ValueError, AttributeError, RecursionError) as error:
                raise InvalidProblemError(f"damaged: {one_line(error)}", path="sessions") from None
            environments.append(known)
            seconds += max(span.total_seconds(), 0.0)
        return tuple(environments), seconds, tuple(dict.fromkeys(workers))

    def _batched(self) -> bool:
        """Whether goals were planned together: what a run took is then a share of what all of them took."""
        alone = self.study.order == "nearest" or self.study.design.goals < 2 or self.problem.bounds
        return not alone and any(label.startswith("jacobian") for label in self.study.solvers)

    def _unminimised(self) -> bool:
        """Whether the Jacobian method took the first control that reached the goal."""
        where = "variant LIKE 'jacobian%' AND json_extract(settings, '$.objective') = 'none'"
        return any(self.store.select(f"1 FROM runs WHERE {where} LIMIT 1"))

    # --- performance profiles ---------------------------------------------------------------------------------------

    def _profiles(self, spreads: Mapping[str, Mapping[str, Spread]]) -> dict[str, Profiles]:
        """Of cost and time, over the design points that every solver has run."""
        solvers = self.study.solvers
        profiles = {
            name: Profiles(solvers, shift_of(spread.at(0.5) for spread in spreads[name].values()))
            for name in (self.cost, "seconds")
        }
        for runs in self._by_point():
            for place, profile in enumerate(profiles.values()):
                profile.add([values[place] if solved else None for solved, *values in runs])
        return {name: profile for name, profile in profiles.items() if profile.points}

    def _by_point(self) -> Iterator[list[tuple[Any, ...]]]:
        """Whether solved, cost and seconds of all solvers, design point by design point; whole ones."""
        many, last, runs = len(self.study.solvers), -1, list[tuple[Any, ...]]()
        query = f"run, converged, {self.columns_of_cost()}, solve_s FROM runs ORDER BY run"
        for run, *values in self.store.select(query):
            point = (run - 1) // many
            if point != last:
                last, runs = point, []
            runs.append(tuple(values))
            if len(runs) == many:
                yield runs

    # --- failures ---------------------------------------------------------------------------------------------------

    def _failures(self) -> tuple[Failures, ...]:
        """Those that are alike together, the commonest first."""
        kinds: dict[tuple[str, tuple[str, ...]], list[Any]] = {}
        query = """run, variant, outcome, message, limits, solved_control IS NOT NULL FROM runs
                   WHERE NOT converged ORDER BY run"""
        for run, label, outcome, message, limits, kept in self.store.select(query):
            kind = outcome, _broken(outcome, message, json.loads(limits or "{}"))
            if kind not in kinds and len(kinds) >= KINDS_OF_FAILURE:
                kind = outcome, ("others",)
            counts, *first = kinds.setdefault(kind, [Counter(), run, message, bool(kept)])
            counts[label] += 1
            if kept and not first[2]:
                kinds[kind] = [counts, run, message, True]
        told = [Failures(*kind, *facts) for kind, facts in kinds.items()]
        return tuple(sorted(told, key=lambda some: (-some.count, some.run)))


def _broken(outcome: str, message: str, limits: Mapping[str, Any]) -> tuple[str, ...]:
    """The bounds and determinants by which a run failed: those its verdict found broken, or that its message names."""
    bounds = [name for name, found in limits.items() if isinstance(found, dict) and found.get("ok") is False]
    named = [name for name in limits if re.search(rf"\b{re.escape(name)}\b", message)]
    determinants = re.findall(r"\bdet [A-Z]\b", message) if outcome != "solver_error" else []
    return tuple(dict.fromkeys([*(bounds or named), *determinants]))
