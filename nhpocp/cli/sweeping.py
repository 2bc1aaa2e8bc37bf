"""The verbs `sweep` and `export`: many runs of one study, and their table."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from nhpocp.cli.exit_status import NOT_SOLVED, SOLVED
from nhpocp.cli.options import json_option
from nhpocp.cli.terminal import console, put, say, tell
from nhpocp.errors import InvalidProblemError
from nhpocp.interruption import Interruption

if TYPE_CHECKING:
    from nhpocp.study.sweep import Tally

STORE = "study.sqlite"


@click.command(epilog="Exit status: 0 if every run of the study is solved and verified, else 1.")
@click.argument("file", type=click.Path(path_type=Path), metavar="STUDY.yaml")
@click.option(
    "--workers", type=click.IntRange(1, 1024), help="Processes, one thread each; default: one a core."
)
@click.option("--resume", is_flag=True, help="Run what the store does not have yet.")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    help=f"The folder of the store, {STORE}; default: results/NAME.",
)
@json_option
def sweep(file: Path, workers: int | None, resume: bool, output: Path | None, as_json: bool) -> int:
    """Run a study: many problems, one row each in an SQLite file.

    Rows are stored as runs finish. After Ctrl-C, or whatever else stops it, --resume goes on.
    """
    from nhpocp.solution_folder import folder_name
    from nhpocp.study.store import Store
    from nhpocp.study.study import read_study
    from nhpocp.study.sweep import sweep as run_all

    study = read_study(file)
    folder = output or Path("results") / folder_name(study.name)
    # before and after the runs there is nothing to stop: all that has ended is stored
    with Interruption(patient=True), Store.create(folder / STORE, study, resume) as store:
        with _live(as_json, study.name) as show:
            tally = run_all(study, store, workers or os.cpu_count() or 1, show)
        outcomes, first = store.outcomes(), store.failed()
    if as_json:
        put(
            {
                "store": str(store.file),
                "report": None,
                "runs": tally.runs,
                "converged": tally.converged,
                "failed": tally.failed,
                "seconds": tally.seconds,
            }
        )
    else:
        _summary(tally, outcomes, store.file, first)
    if tally.stopped:
        say(f"stopped by hand; {tally.stored} of {tally.runs} runs are stored, --resume runs the others")
    return SOLVED if tally.converged == tally.runs else NOT_SOLVED


def _summary(tally: Tally, outcomes: dict[str, int], store: Path, first: int | None) -> None:
    endings = ", ".join(f"{count} {name}" for name, count in outcomes.items() if name != "converged")
    tell(
        f"{tally.stored} of {tally.runs} runs: {tally.converged} solved and verified"
        + (f", {tally.failed} failed ({endings})" if endings else "")
    )
    tell(f"{tally.done} runs in {tally.seconds:.1f} s, {tally.rate:.3g} a second")
    tell(f"store: {store}")
    tell(f"next: nhpocp export {store} --format csv")
    if first is not None:
        tell(f"      nhpocp solve --from {store} --run {first}")


@contextmanager
def _live(quiet: bool, name: str) -> Iterator[Callable[[Tally], None] | None]:
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
        task = bar.add_task(name, total=None, words="starting")

        def show(tally: Tally) -> None:
            words = f"{tally.converged} solved, {tally.failed} failed, {tally.rate:.3g} a second"
            bar.update(task, total=tally.runs, completed=tally.stored, words=words)

        yield show


@click.command()
@click.argument("store", type=click.Path(path_type=Path), metavar="STUDY.sqlite")
@click.option("--format", "kind", type=click.Choice(["csv", "parquet"]), default="csv", show_default=True)
@click.option("-o", "--output", type=click.Path(path_type=Path), help="The file; default: beside the store.")
@json_option
def export(store: Path, kind: str, output: Path | None, as_json: bool) -> int:
    """Write the rows of a study's store as a table.

    One row a run: its axes, how it ended, costs and margins. Parquet needs the extra `parquet`.
    """
    from nhpocp.solution_folder import unwritable
    from nhpocp.study.export import FORMATS
    from nhpocp.study.store import Store

    file = output or store.with_suffix(f".{kind}")
    if file.resolve() == store.resolve():
        raise InvalidProblemError("this is the store itself; name another file", file=str(file))
    with Store.open(store) as opened:
        try:
            FORMATS[kind](opened, file)
        except OSError as error:  # of a full disk, which does not say where
            raise unwritable(file, error) from error
    if as_json:
        put({"file": str(file)})
    else:
        tell(str(file))
    return SOLVED
