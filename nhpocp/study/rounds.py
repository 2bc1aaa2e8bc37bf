"""Rounds of a sweep: runs that can be performed in any order, before it is known which ones follow."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from nhpocp.errors import InvalidProblemError
from nhpocp.study.optimisation import Level, Optimisation
from nhpocp.study.order import Piece, pieces
from nhpocp.study.store import Store
from nhpocp.study.study import Study
from nhpocp.study.trials import Trial, evaluated

if TYPE_CHECKING:
    from nhpocp.study.optimiser import Optimiser

Round = tuple[Study, Iterator[Piece]]  # the study with the trials that are known by then, and what is missing


@contextmanager
def rounds(study: Study, store: Store, trials: list[Trial]) -> Iterator[Iterator[Round]]:
    """All rounds; the next is asked for once the rows of the one before are stored.

    One of all runs; of an optimised study one for each batch of trials, which join ``trials`` at its end.
    Errors: `MissingDependencyError` without Optuna, `InvalidProblemError` where its file cannot be used.
    """
    if study.optimise is None:
        yield iter([(study, pieces(study, store.done()))])
        return
    from nhpocp.study.optimiser import FILE, opened

    with opened(study.optimise, store.file.with_name(FILE)) as optimiser:
        yield _batches(study, study.optimise, store, optimiser, trials)


def _batches(
    study: Study, optimise: Optimisation, store: Store, optimiser: Optimiser, trials: list[Trial]
) -> Iterator[Round]:
    levels: list[Level] = []
    for first in range(1, optimise.trials + 1, optimise.batch):
        batch = range(first, min(first + optimise.batch, optimise.trials + 1))
        levels += [optimiser.proposed(trial) for trial in batch]
        known = study.proposed(levels)
        runs = range(known.runs_of_trial(batch[0]).start, known.runs_of_trial(batch[-1]).stop)
        done = _agreeing(known, store, runs)
        yield known, pieces(known, done, range(runs.start - 1, runs.stop - 1))
        for number in batch:
            trials.append(evaluated(study, store, number))
            optimiser.tell(trials[-1])


def _agreeing(study: Study, store: Store, runs: range) -> set[int]:
    """Those of the runs that are stored. Errors: `InvalidProblemError` where one is of another trial."""
    done = set()
    for row in store.rows("run BETWEEN ? AND ?", (runs[0], runs[-1])):
        point = json.dumps(study.parameters(row["run"]), default=str)
        if json.loads(row["parameters"]) != json.loads(point):
            words = f"run {row['run']} is of another trial than this optimiser's; restore the file that was beside it"
            raise InvalidProblemError(words, file=str(store.file))
        done.add(row["run"])
    return done
