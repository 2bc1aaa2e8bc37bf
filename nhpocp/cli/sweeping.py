"""The verb `sweep`: many runs of one study."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from nhpocp.cli.exit_status import NOT_SOLVED, SOLVED
from nhpocp.cli.optimum import Optimum
from nhpocp.cli.options import json_option
from nhpocp.cli.terminal import console, put, say, tell
from nhpocp.errors import InvalidProblemError
from nhpocp.interruption import Interruption
from nhpocp.study import STORE

if TYPE_CHECKING:
    from nhpocp.study.study import Study
    from nhpocp.study.sweep import Tally


@click.command(
    epilog="Exit status: 0 if every run of the study is solved and verified, or of an optimised one if all trials are "
    "made and one has no failed run; else 1."
)
@click.argument("file", type=click.Path(path_type=Path), metavar="STUDY.yaml")
@click.option(
    "--workers", type=click.IntRange(1, 1024), help="Processes, one thread each; default: one a core."
)
@click.option(
    "--dask",
    metavar="ADDRESS|local",
    help="Dask's workers instead: of the scheduler there, or as many as --workers here.",
)
@click.option("--resume", is_flag=True, help="Run what the store does not have yet.")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    help=f"The folder of the store, {STORE}; default: results/NAME.",
)
@json_option
def sweep(
    file: Path, workers: int | None, dask: str | None, resume: bool, output: Path | None, as_json: bool
) -> int:
    """Run a study: many problems, one row each in an SQLite file, and a report.

    Rows are stored as runs finish. After Ctrl-C, or whatever else stops it, --resume goes on. A study with `optimise`
    looks for the best design: Optuna (extra `design`) proposes trials, and the best are shown. At the end report.html
    and comparison.tex, for LaTeX, are written beside the store; `nhpocp compare --from STUDY.sqlite` does it again.
    """
    from nhpocp.solution_folder import folder_name
    from nhpocp.study.report import check_home
    from nhpocp.study.study import read_study
    from nhpocp.study.sweep import opened
    from nhpocp.study.sweep import sweep as run_all

    study = read_study(file)
    many = workers or os.cpu_count() or 1
    folder = output or Path("results") / folder_name(study.name)
    check_home(folder)
    # before and after the runs there is nothing to stop: all that has ended is stored
    with (
        Interruption(patient=True),
        _dask(dask, workers) as make,
        opened(study, folder, resume) as store,
    ):
        with _live(as_json, study) as show:
            tally = run_all(study, store, many, show, make)
        outcomes, first = store.outcomes(), store.failed()
    optimum = Optimum.of(study.optimise, tally.trials) if study.optimise else None
    if tally.stopped:
        say(
            f"stopped {tally.stopped}; {tally.stored} of {tally.runs} runs are stored, --resume runs the others"
        )
    report = _report(store.file, folder, as_json)
    if as_json:
        numbers = tally.runs, tally.converged, tally.failed, tally.seconds
        _put(store.file, report, *numbers, **(optimum.to_json() if optimum else {}))
    else:
        _summary(tally, outcomes, store.file, report, first, optimum)
    if optimum:
        return SOLVED if tally.stored == tally.runs and optimum.front else NOT_SOLVED
    return SOLVED if tally.converged == tally.runs else NOT_SOLVED


@contextmanager
def _dask(address: str | None, workers: int | None) -> Iterator[Callable[[], Executor] | None]:
    """Dask's workers; None without an address."""
    if address is None:
        yield None
        return
    from nhpocp.study.cluster import LOCAL, DaskExecutor

    if workers and address != LOCAL:
        words = f"the workers of a scheduler are its own; expected --workers with {LOCAL} alone"
        raise InvalidProblemError(words, path="--workers")
    with DaskExecutor(address, workers or os.cpu_count()) as executor:
        yield lambda: executor


def report_again(store: Path, home: Path | None, as_json: bool) -> int:
    """The report of a stored study, beside its store or in ``home``."""
    from nhpocp.study.store import Store

    with Store.open(store) as opened:
        runs, outcomes = int(opened.facts["runs"]), opened.outcomes()
    stored, solved = sum(outcomes.values()), outcomes.get("converged", 0)
    report = _report(store, home or store.parent, as_json)
    if as_json:
        _put(store, report, runs, solved, stored - solved, None)
    else:
        tell(_counted(outcomes, runs))
        if report:
            tell(f"report: {report}")
    return SOLVED if solved == runs else NOT_SOLVED


def _report(store: Path, home: Path, quiet: bool) -> Path | None:
    """Where the report is; without one a warning says why."""
    from nhpocp.cli.progress import progress
    from nhpocp.study.report import PAGE, write_report

    with progress(quiet, "writing the report"):
        why = write_report(store, home)
    if why:
        say(
            f"warning: the report could not be written ({why}); "
            f"`nhpocp compare --from {shlex.quote(str(store))}` writes it"
        )
    return None if why else home / PAGE


def _put(
    store: Path, report: Path | None, runs: int, solved: int, failed: int, seconds: float | None, **more: Any
) -> None:
    put(
        {
            "store": str(store),
            "report": None if report is None else str(report),
            "runs": runs,
            "converged": solved,
            "failed": failed,
            "seconds": seconds,
            **more,
        }
    )


def _counted(outcomes: dict[str, int], runs: int) -> str:
    """How many runs are stored, and how they ended."""
    endings = ", ".join(f"{count} {name}" for name, count in outcomes.items() if name != "converged")
    stored, solved = sum(outcomes.values()), outcomes.get("converged", 0)
    failed = f", {stored - solved} failed ({endings})" if endings else ""
    return f"{stored} of {runs} runs: {solved} solved and verified{failed}"


def _summary(
    tally: Tally,
    outcomes: dict[str, int],
    store: Path,
    report: Path | None,
    first: int | None,
    optimum: Optimum | None,
) -> None:
    tell(_counted(outcomes, tally.runs))
    tell(f"{tally.done} runs in {tally.seconds:.1f} s, {tally.rate:.3g} a second")
    tell(f"store: {store}")
    if optimum:
        for line in optimum.lines():
            tell(line)
    if report:
        tell(f"report: {report}")
    tell(f"next: nhpocp export {store} --format csv")
    if optimum and optimum.front:
        first = optimum.front[0].runs[0]
    if first is not None:
        tell(f"      nhpocp solve --from {store} --run {first}")


@contextmanager
def _live(quiet: bool, study: Study) -> Iterator[Callable[[Tally], None] | None]:
    """A line that follows the tally on a terminal; None where nobody would see it."""
    import sys

    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = [
        TextColumn("{task.description}", markup=False),
        BarColumn(20),
        TextColumn("{task.completed} of {task.total}, {task.fields[words]}", markup=False),
        TimeRemainingColumn(compact=True),
    ]
    with Progress(*columns, console=console(error=True), transient=True, refresh_per_second=4) as bar:
        task = bar.add_task(study.name, total=None, words="starting")

        def show(tally: Tally) -> None:
            words = f"{tally.converged} solved, {tally.failed} failed, {tally.rate:.3g} a second"
            if study.optimise and tally.trials:
                words += f", {Optimum.of(study.optimise, tally.trials).words()}"
            bar.update(task, total=tally.runs, completed=tally.stored, words=words)

        yield show
