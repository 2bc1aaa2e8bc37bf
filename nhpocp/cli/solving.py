"""The verbs `solve` and `compare`."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from nhpocp.cli.exit_status import NOT_SOLVED, SOLVED
from nhpocp.cli.options import json_option, load, set_option
from nhpocp.cli.progress import progress
from nhpocp.cli.summary import comparison_lines, report, task
from nhpocp.cli.terminal import put, say
from nhpocp.plain_text import visible
from nhpocp.solvers.registry import SOLVERS

if TYPE_CHECKING:
    from nhpocp.comparison import Comparison, Entry
    from nhpocp.interruption import Interruption
    from nhpocp.solution import Solution

DRAWING = {"k": None, "error": None, "stage": "drawing"}


@click.command()
@click.argument("file", type=click.Path(path_type=Path), required=False)
@click.option("--solver", type=click.Choice(list(SOLVERS)), default="jacobian", show_default=True)
@click.option(
    "--from", "store", type=click.Path(path_type=Path), metavar="STUDY.sqlite", help="A study's store ..."
)
@click.option(
    "--run", type=click.IntRange(min=1), help="... and which of its runs: a folder of that, solved before."
)
@set_option
@click.option("--trace", is_flag=True, help="Write the iterations to iterations.csv in the solution folder.")
@click.option("-o", "--output", type=click.Path(path_type=Path), help="The solution folder itself.")
@json_option
def solve(
    file: Path | None,
    solver: str,
    store: Path | None,
    run: int | None,
    overrides: tuple[str, ...],
    trace: bool,
    output: Path | None,
    as_json: bool,
) -> int:
    """Solve FILE, verify the result, write a solution folder."""
    if store is not None or run is not None:
        return _solve_stored(file, store, run, overrides, output, as_json)
    if file is None:
        raise click.UsageError("Missing argument 'FILE'.")
    with _keeping() as interruption:
        from nhpocp.solution_folder import check_target, folder_name, to_json

        problem = load(file, overrides)
        folder = output or Path("results") / folder_name(problem.name) / solver
        check_target(folder)
        interruption.check()  # nothing to keep yet; from here on the solver answers to Ctrl-C

        from nhpocp import planning

        with progress(as_json, f"{problem.name} by {solver}") as show:
            solution = planning.solve(problem, planning.own_solver(problem, solver), show)
            interruption.patient = True
            if show and problem.pictures:
                show(DRAWING)
            solution = _write(solution, folder, trace)
        if as_json:
            put({**to_json(solution), "folder": str(folder)})
        else:
            report(solution, folder, task(file, overrides))
    return SOLVED if solution.converged else NOT_SOLVED


def _solve_stored(
    file: Path | None,
    store: Path | None,
    run: int | None,
    overrides: tuple[str, ...],
    output: Path | None,
    as_json: bool,
) -> int:
    """The folder of one run of a study: its control, verified again."""
    if store is None or run is None:
        raise click.UsageError("--from STUDY.sqlite and --run K belong together")
    if file is not None or overrides:
        raise click.UsageError("--from takes a run as it was solved: leave out FILE and --set")
    with _keeping() as interruption:
        from nhpocp.solution_folder import check_target, folder_name, to_json
        from nhpocp.study.run import restored
        from nhpocp.study.store import Store

        with Store.open(store) as opened:
            row, facts = opened.row(run), opened.facts
            folder = output or Path("results") / folder_name(facts["name"]) / f"run_{run}"
            check_target(folder)
            interruption.check()
            solution = restored(row, facts)
        interruption.patient = True
        solution = _write(solution, folder)
        if as_json:
            put({**to_json(solution), "folder": str(folder)})
        else:
            report(solution, folder, f"--from {shlex.quote(str(store))} --run {run}")
    return SOLVED if solution.converged else NOT_SOLVED


@contextmanager
def _keeping() -> Iterator[Interruption]:
    """Ctrl-C is noted and kept for the solver, whatever is running."""
    from nhpocp.interruption import Interruption

    with Interruption() as interruption:
        yield interruption


def _write(solution: Solution, folder: Path, trace: bool = False) -> Solution:
    """The solution folder, with pictures if the problem asks for them, and the iterations if the user does.

    The solution as it is stored.
    """
    from nhpocp.solution_folder import store_solution

    return store_solution(solution, folder, _pictures if solution.problem.pictures else None, trace=trace)


def _pictures(solution: Solution, folder: Path) -> None:
    from nhpocp.views.figures import write_pictures  # once the numbers are written: loading takes its time

    write_pictures(solution, folder)


@click.command(epilog="Exit status: 0 if every run is solved and verified, else 1.")
@click.argument(
    "files", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="FILE...|DIR...|STORE"
)
@click.option(
    "--from",
    "stored",
    is_flag=True,
    help="The arguments are solution folders, or the argument is a study's store: write the report again.",
)
@click.option(
    "--variant",
    "variants",
    multiple=True,
    metavar="SOLVER:KEY=VALUE,...",
    help="One more run on every file, such as nlp:control=basis or jacobian:control.harmonics=3; repeatable.",
)
@click.option(
    "--physics",
    is_flag=True,
    help="Play every plan that reaches its goal on a machine of bodies and contacts, too (extra: physics).",
)
@click.option("--only", is_flag=True, help="The variants alone, not the two methods as the file sets them.")
@set_option
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    default=Path("results"),
    show_default=True,
    help="Where the report and the solutions go; of a study's store: default beside it.",
)
@json_option
@click.pass_context
def compare(
    context: click.Context,
    files: tuple[Path, ...],
    stored: bool,
    variants: tuple[str, ...],
    physics: bool,
    only: bool,
    overrides: tuple[str, ...],
    output: Path,
    as_json: bool,
) -> int:
    """Solve every FILE by both methods; compare them.

    Writes report.html, comparison.csv, comparison.json, comparison.tex (a table for LaTeX), a
    solution folder for every run, and NAME/animation.html with the motions of each problem.
    """
    if stored and (variants or overrides or only or physics):
        raise click.UsageError("--from solves nothing: leave out --variant, --only, --physics and --set")
    if only and not variants:
        raise click.UsageError("--only solves the variants alone: say some with --variant")
    if stored and any(file.is_file() for file in files):
        if len(files) > 1:
            raise click.UsageError("--from takes one study's store, or solution folders")
        from nhpocp.cli.sweeping import report_again

        chosen = context.get_parameter_source("output") is not ParameterSource.DEFAULT
        return report_again(files[0], output if chosen else None, as_json)
    with _keeping() as interruption:
        from nhpocp.comparison_folder import load_comparison, write_comparison

        tasks: dict[str, str] = {}
        missing: list[str] = []
        if stored:
            comparison = load_comparison(files)
        else:
            comparison, tasks, missing = _compared(files, variants, only, overrides, output, as_json, physics)
        interruption.patient = True
        with progress(as_json, "writing the report"):
            written = write_comparison(comparison, output, _report, _animation, missing)
        for warning in written.missing:
            say(f"warning: {warning}")
        if as_json:
            put({**comparison.to_json(), "warnings": [*comparison.notes, *written.missing]})
        else:
            comparison_lines(comparison, written.files, tasks)
    return SOLVED if comparison.all_converged else NOT_SOLVED


def _opinion() -> Callable[[Solution], Mapping[str, Any] | None]:
    """A physics engine's. Errors: `MissingDependencyError` where there is none."""
    from nhpocp.machine.simulation import opinion, require_engine

    require_engine()
    return opinion


def _report(comparison: Comparison, file: Path, animations: Mapping[str, str]) -> None:
    from nhpocp.views.report import write_report

    write_report(comparison, file, animations)


def _animation(entries: Sequence[Entry], file: Path) -> None:
    from nhpocp.views.animation import animate_runs

    animate_runs(entries, file)


def _compared(
    files: Sequence[Path],
    variants: Sequence[str],
    only: bool,
    overrides: Sequence[str],
    home: Path,
    quiet: bool,
    physics: bool,
) -> tuple[Comparison, dict[str, str], list[str]]:
    """Every run, each stored as soon as it has ended; what was typed for every problem's name; what is missing."""
    from nhpocp import comparison
    from nhpocp.comparison_folder import check_home, plan

    problems = [load(file, overrides) for file in files]
    runs = plan(problems, variants, home, only)
    check_home(home, [problem.name for problem in problems])
    opinion = _opinion() if physics else None
    folders = {id(run): folder for folder, run in runs.items()}
    missing: list[str] = []

    def keep(solution: Solution, run: comparison.Run) -> str:
        folder = folders[id(run)]
        if show and run.problem.pictures:
            show(DRAWING)
        written = _write(solution, Path(folder))
        missing.extend(warning for warning in written.warnings if warning not in solution.warnings)
        if not quiet:
            # above the progress, which takes what `print` writes, and not what `click.echo` does
            print(
                visible(f"{run.problem.name} by {run.variant}: {solution.outcome.value}  {solution.message}")
            )
        return folder

    tasks = {problem.name: task(file, overrides) for problem, file in zip(problems, files, strict=True)}
    with progress(quiet) as show:
        return (
            comparison.compare(list(runs.values()), progress=show, finished=keep, opinion=opinion),
            tasks,
            missing,
        )
