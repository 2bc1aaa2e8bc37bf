"""An optimiser of designs: Optuna, asked for trials and told what they were worth."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from nhpocp.errors import InvalidProblemError, MissingDependencyError, one_line
from nhpocp.study.optimisation import Level, Optimisation, Variable
from nhpocp.study.trials import Trial

if TYPE_CHECKING:
    import optuna

FILE = "optuna.sqlite"
NAME = "nhpocp"  # of the one study in the file
BEYOND = 0.03  # of a range's width on both sides; what is proposed there is the bound, which is reached so
FAILED = "failed runs"  # the constraint that there are none


class Optimiser:
    """The trials of a study in Optuna's own file, which outlives the program, and which Optuna's tools read.

    Tree-structured Parzen estimators, of one objective or of a Pareto front. Each trial has a seed of its own, made of
    the study's and its number. What is proposed depends on the batches before, which have ended, and on the batch so
    far, which has not: on nothing that a stop or the number of workers changes.
    """

    def __init__(self, study: optuna.Study, optimisation: Optimisation) -> None:
        self._study, self._optimisation = study, optimisation
        self._known = study.get_trials(deepcopy=False)

    def proposed(self, number: int) -> Level:
        """The point of a trial, from 1: the one that is known, or the next."""
        from optuna.trial import TrialState

        variables = self._optimisation.variables
        known = self._known[number - 1] if number <= len(self._known) else None
        if known is not None and known.state is TrialState.COMPLETE:
            params = known.params
        else:
            trial = self._asked(number, known)
            params = {variable.path: _suggested(trial, variable) for variable in variables}
        return tuple(_value(variable, params[variable.path]) for variable in variables)

    def _asked(self, number: int, known: optuna.trial.FrozenTrial | None) -> optuna.Trial:
        """A new trial, or one that a stop came between: what it has of its point it keeps, the rest it gets now."""
        import optuna

        seed = np.random.SeedSequence([self._optimisation.seed, number]).generate_state(1)[0]
        self._study.sampler = optuna.samplers.TPESampler(seed=int(seed))
        return self._study.ask() if known is None else optuna.Trial(self._study, known._trial_id)

    def tell(self, trial: Trial) -> None:
        """What a trial was worth; one with failed runs is infeasible, and worth nothing."""
        import optuna

        told = self._study.get_trials(deepcopy=False)[trial.number - 1]
        if told.state is optuna.trial.TrialState.COMPLETE:
            return
        if FAILED not in told.constraints:
            optuna.Trial(self._study, told._trial_id).set_constraint(FAILED, trial.failed)
        nothing = [objective.merit(np.inf) for objective in self._optimisation.objectives]
        self._study.tell(told.number, nothing if trial.failed else trial.values)


def _suggested(trial: optuna.Trial, variable: Variable) -> Any:
    if variable.is_range:
        least, most = variable.values
        beyond = BEYOND * (most - least)
        return trial.suggest_float(variable.path, least - beyond, most + beyond)
    if variable.numeric:  # by their places in order: what is near is probably alike
        return trial.suggest_int(variable.path, 0, len(variable.values) - 1)
    return trial.suggest_categorical(variable.path, list(range(len(variable.values))))


def _value(variable: Variable, suggested: Any) -> Any:
    if variable.is_range:
        least, most = variable.values
        return float(min(max(suggested, least), most))
    return (sorted(variable.values) if variable.numeric else variable.values)[suggested]


def check_installed() -> None:
    """Errors: `MissingDependencyError` without Optuna."""
    try:
        import optuna  # noqa: F401
    except ImportError:
        words = 'to optimise a design needs Optuna; install it with: pip install "nhpocp[design]"'
        raise MissingDependencyError(words) from None


def check_place(store: Path, resume: bool) -> None:
    """Before the store of an optimised study is made.

    Errors: `MissingDependencyError` without Optuna; `InvalidProblemError` where its file was left by another sweep.
    """
    check_installed()
    file = store.with_name(FILE)
    if file.exists() and not (resume or store.exists()):
        words = "trials of an earlier sweep, whose store is gone; remove this file, or name another folder with -o"
        raise InvalidProblemError(words, file=str(file))


@contextmanager
def opened(optimisation: Optimisation, file: Path) -> Iterator[Optimiser]:
    """The optimiser whose trials are in a file, a new one where there is none; Optuna is quiet within it.

    Errors: `InvalidProblemError` where the file is none of Optuna's, or cannot be written to; `MissingDependencyError`.
    """
    check_installed()
    import optuna
    from sqlalchemy.exc import SQLAlchemyError

    loud = optuna.logging.get_verbosity()
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    try:
        storage = optuna.storages.RDBStorage(f"sqlite:///{file}")
        ways = optuna.study.StudyDirection
        directions = [ways.MAXIMIZE if each.greatest else ways.MINIMIZE for each in optimisation.objectives]
        study = optuna.create_study(
            storage=storage, study_name=NAME, directions=directions, load_if_exists=True
        )
        try:
            yield Optimiser(study, optimisation)
        finally:
            storage.remove_session()
            storage.engine.dispose()
    except (SQLAlchemyError, optuna.exceptions.StorageInternalError) as error:
        raise InvalidProblemError(
            f"Optuna cannot use this file: {one_line(error)}", file=str(file)
        ) from error
    finally:
        optuna.logging.set_verbosity(loud)
