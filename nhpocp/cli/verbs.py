"""The verbs. Everything heavy is imported inside the verb that needs it, so that --help and check answer at once."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from nhpocp.cli.exit_status import BAD_INPUT, NOT_SOLVED, SOLVED
from nhpocp.cli.options import json_option, load, set_option
from nhpocp.cli.progress import progress
from nhpocp.cli.summary import comparison_lines, report, task
from nhpocp.cli.terminal import error_data, put, say, tell, verdict_lines, visible
from nhpocp.errors import InvalidProblemError
from nhpocp.solvers.registry import SOLVERS

if TYPE_CHECKING:
    from nhpocp.comparison import Comparison, Entry
    from nhpocp.interruption import Interruption
    from nhpocp.solution import Solution

DRAWING = {"k": None, "error": None, "stage": "drawing"}


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="nhpocp")
@click.option("--debug", is_flag=True, help="Show tracebacks.")
def cli(debug: bool) -> None:
    """Plan motions for parallel robots with non-holonomic joints."""


@cli.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--solver", type=click.Choice(list(SOLVERS)), default="jacobian", show_default=True)
@set_option
@click.option("--trace", is_flag=True, help="Write the iterations to iterations.csv in the solution folder.")
@click.option("-o", "--output", type=click.Path(path_type=Path), help="The solution folder itself.")
@json_option
def solve(
    file: Path, solver: str, overrides: tuple[str, ...], trace: bool, output: Path | None, as_json: bool
) -> int:
    """Solve FILE, verify the result, write a solution folder."""
    with _keeping() as interruption:
        from nhpocp.solution_folder import check_target, folder_name, to_json

        problem = load(file, overrides)
        folder = output or Path("results") / folder_name(problem.name) / solver
        check_target(folder)
        interruption.check()  # nothing to keep yet; from here on the solver answers to Ctrl-C

        from nhpocp import planning

        with progress(as_json, f"{problem.name} by {solver}") as show:
            solution = planning.solve(problem, problem.solvers[solver], show)
            interruption.patient = True
            if show and problem.pictures:
                show(DRAWING)
            solution = _write(solution, folder, trace)
        if as_json:
            put({**to_json(solution), "folder": str(folder)})
        else:
            report(solution, folder, task(file, overrides))
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


@cli.command()
@click.argument("folder", type=click.Path(path_type=Path))
@json_option
def verify(folder: Path, as_json: bool) -> int:
    """Check the solution in FOLDER, independently of solvers.

    Its control is integrated again by other code, from the files of FOLDER alone, and what they state is compared with
    what that gives.
    """
    from nhpocp.solution_folder import audit

    audited = audit(folder)
    verdict = audited.verdict
    if as_json:
        from nhpocp.solution_folder import plain

        put(
            {
                "folder": str(folder),
                "outcome": audited.stated.outcome.value,
                "verified": plain(verdict.to_json()),
                "differences": audited.differences,
                "unchecked": audited.unchecked,
            }
        )
    else:
        differs = " what is stated here differs" if audited.differences else ""
        tell(f"{folder}: {'verified' if verdict.ok else 'refuted'}{';' + differs if differs else ''}")
        for line in verdict_lines(verdict):
            tell(line)
        for difference in audited.differences:
            tell(f"  differs: {difference}")
        for sentence in audited.unchecked:
            tell(f"  not checked: {sentence}")
    return SOLVED if audited.ok else NOT_SOLVED


@cli.command()
@click.argument("files", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="FILE...")
@set_option
@json_option
def check(files: tuple[Path, ...], overrides: tuple[str, ...], as_json: bool) -> int:
    """Validate problem files; solve nothing."""
    from nhpocp.problem_file import read

    checked, failures = [], []
    for file in files:
        try:
            document = read(file, overrides)
        except InvalidProblemError as error:
            failures.append(error)
            checked.append({"file": str(file), "ok": False, **error_data(error)})
            continue
        checked.append(
            {"file": str(file), "ok": True, "warnings": document.warnings, "problem": document.filled()}
        )
        for line in document.warning_lines():
            say(line)
        if not as_json:
            tell(f"{file}: ok")
    for failure in failures:
        say(str(failure))
    if as_json:
        if failures:
            put({**error_data(failures[0]), "files": checked})
        else:
            put(checked[0] if len(checked) == 1 else {"files": checked})
    return BAD_INPUT if failures else SOLVED


@cli.command()
@click.argument("folder", type=click.Path(path_type=Path))
@json_option
def plot(folder: Path, as_json: bool) -> int:
    """Draw the pictures of the solution in FOLDER, into it."""
    from nhpocp.solution_folder import load_solution, unwritable
    from nhpocp.views.figures import write_pictures

    solution = load_solution(folder)
    try:
        written = [str(path) for path in write_pictures(solution, folder)]
    except OSError as error:
        raise unwritable(folder, error) from error
    if as_json:
        put({"folder": str(folder), "pictures": written})
    else:
        tell("\n".join(written))
    return SOLVED


@cli.command()
@json_option
def systems(as_json: bool) -> int:
    """List the models: states, inputs, parameters, presets."""
    from nhpocp.problem_file import systems as listing
    from nhpocp.problem_file.registry import every_class

    models = listing()
    for complaint in every_class()[1]:
        say(complaint)
    if as_json:
        put(models)
        return SOLVED
    for name, entry in models.items():
        states, inputs = (", ".join(_block(block) for block in entry[part]) for part in ("states", "inputs"))
        tell(f"{name}: state {states}; input {inputs}")
        for parameter, default in entry["defaults"].items():
            value = (
                ""
                if default is None
                else f" = {default:.6g}"
                if isinstance(default, float)
                else f" = {default}"
            )
            choices = entry["parameters"][parameter].get("choices", ())
            words = f" (one of {', '.join(choices)})" if choices else ""
            tell(f"  {parameter}{value}: {entry['meanings'][parameter]}{words}")
        if entry["presets"]:
            tell(f"  presets: {', '.join(entry['presets'])}")
    return SOLVED


def _block(block: Mapping[str, Any]) -> str:
    return block["name"] + "".join(f"[{size}]" for size in block["shape"])


@cli.command()
@click.option("--clear-cache", is_flag=True, help="Remove the compiled kernels from the cache first.")
@json_option
def doctor(clear_cache: bool, as_json: bool) -> int:
    """Say which versions, plugins, compiler and compiled kernels are at hand."""
    if clear_cache:
        from nhpocp.flow.compiled.kernel_folder import clear_cache as clear

        say(f"{clear()} kernels removed from the cache")
    from nhpocp.installation import diagnose

    facts = diagnose()
    if as_json:
        put(facts)
    else:
        for name, value in facts.items():
            if isinstance(value, dict):
                value = [f"{part} {entry}" for part, entry in value.items()]
            shown = ", ".join(value) if isinstance(value, list) else value
            tell(f"{name}: {'none' if value is None else shown}")
    return SOLVED


@cli.command(epilog="Exit status: 0 if every run is solved and verified, else 1.")
@click.argument("files", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="FILE...|DIR...")
@click.option(
    "--from", "stored", is_flag=True, help="The arguments are solution folders: write the report again."
)
@click.option(
    "--variant",
    "variants",
    multiple=True,
    metavar="SOLVER:KEY=VALUE,...",
    help="One more run on every file, such as nlp:control=basis; repeatable.",
)
@set_option
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    default=Path("results"),
    show_default=True,
    help="Where the report and the solutions go.",
)
@json_option
def compare(
    files: tuple[Path, ...],
    stored: bool,
    variants: tuple[str, ...],
    overrides: tuple[str, ...],
    output: Path,
    as_json: bool,
) -> int:
    """Solve every FILE by both methods; compare them.

    Writes report.html, comparison.csv, comparison.json, a solution folder for every run, and
    NAME/animation.html with the motions of each problem.
    """
    if stored and (variants or overrides):
        raise click.UsageError("--from solves nothing: leave out --variant and --set")
    with _keeping() as interruption:
        from nhpocp.comparison_folder import load_comparison, write_comparison

        tasks: dict[str, str] = {}
        missing: list[str] = []
        if stored:
            comparison = load_comparison(files)
        else:
            comparison, tasks, missing = _compared(files, variants, overrides, output, as_json)
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


def _report(comparison: Comparison, file: Path, animations: Mapping[str, str]) -> None:
    from nhpocp.views.report import write_report

    write_report(comparison, file, animations)


def _animation(entries: Sequence[Entry], file: Path) -> None:
    from nhpocp.views.animation import animate_runs

    animate_runs(entries, file)


def _compared(
    files: Sequence[Path], variants: Sequence[str], overrides: Sequence[str], home: Path, quiet: bool
) -> tuple[Comparison, dict[str, str], list[str]]:
    """Every run, each stored as soon as it has ended; what was typed for every problem's name; what is missing."""
    from nhpocp import comparison
    from nhpocp.comparison_folder import check_home, plan

    problems = [load(file, overrides) for file in files]
    runs = plan(problems, variants, home)
    check_home(home, [problem.name for problem in problems])
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
        return comparison.compare(list(runs.values()), progress=show, finished=keep), tasks, missing
