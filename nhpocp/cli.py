"""The command line: verbs, messages and exit statuses; no mathematics.

Exit status: 0 solved and verified, 1 not (everything is still written), 2 bad input, 3 an optional part is missing.
Everything heavy is imported inside the verb that needs it, so that --help and check answer at once.
"""

from __future__ import annotations

import gc
import json
import os
import signal
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from nhpocp.errors import InvalidProblemError, MissingDependencyError, NhpocpError

if TYPE_CHECKING:
    from nhpocp.solution import Progress, Solution

SOLVED, NOT_SOLVED, BAD_INPUT, MISSING_PART = 0, 1, 2, 3


def _json_option(command: Callable[..., Any]) -> Callable[..., Any]:
    return click.option("--json", "as_json", is_flag=True, help="One JSON document on standard output.")(
        command
    )


def _set_option(command: Callable[..., Any]) -> Callable[..., Any]:
    return click.option(
        "--set",
        "overrides",
        multiple=True,
        metavar="KEY=VALUE",
        help="Override a key of the file; repeatable.",
    )(command)


def say(text: str) -> None:
    """A message for people, on standard error."""
    click.echo(text, err=True)


def put(data: Any) -> None:
    """The one JSON document of --json, on standard output."""
    click.echo(json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False))


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="nhpocp")
@click.option("--debug", is_flag=True, help="Show tracebacks.")
def cli(debug: bool) -> None:
    """Plan motions for parallel robots with non-holonomic joints."""


@cli.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--solver", type=click.Choice(["jacobian", "nlp"]), default="jacobian", show_default=True)
@_set_option
@click.option("-o", "--output", type=click.Path(path_type=Path), help="The solution folder itself.")
@_json_option
def solve(file: Path, solver: str, overrides: tuple[str, ...], output: Path | None, as_json: bool) -> int:
    """Solve FILE, verify the result, write a solution folder."""
    from nhpocp.problem_file import load_problem
    from nhpocp.solution_folder import check_target

    with _interrupts():
        problem = load_problem(file, overrides)
        if solver not in problem.solvers:
            raise InvalidProblemError(
                f"the {solver} solver is not available in this version; use --solver jacobian"
            )
        folder = output or Path("results") / _safe(problem.name) / solver
        check_target(folder)

        from nhpocp import planning

        with _progress(as_json) as progress:
            solution = planning.solve(problem, problem.solvers[solver], progress)
        _write(solution, folder)
    if as_json:
        from nhpocp.solution_folder import to_json

        put({**to_json(solution), "folder": str(folder)})
    else:
        _report(solution, folder)
    return SOLVED if solution.converged else NOT_SOLVED


@cli.command()
@click.argument("folder", type=click.Path(path_type=Path))
@_json_option
def verify(folder: Path, as_json: bool) -> int:
    """Re-integrate the solution stored in FOLDER, independently of the solvers."""
    from nhpocp.solution_folder import load_solution
    from nhpocp.verification import verify as examine

    solution = load_solution(folder)
    verdict = examine(solution)
    if as_json:
        from nhpocp.solution_folder import plain

        put({"folder": str(folder), "outcome": solution.outcome.value, "verified": plain(verdict.to_json())})
    else:
        click.echo(f"{folder}: {'verified' if verdict.ok else 'refuted'}")
        for line in _verdict_lines(verdict):
            click.echo(line)
    return SOLVED if verdict.ok else NOT_SOLVED


@cli.command()
@click.argument("files", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="FILE...")
@_set_option
@_json_option
def check(files: tuple[Path, ...], overrides: tuple[str, ...], as_json: bool) -> int:
    """Validate problem files; solve nothing."""
    gc.disable()  # a short life: collecting garbage would take a tenth of it
    from nhpocp.problem_file import read

    found, failures = [], []
    for file in files:
        try:
            document = read(file, overrides)
        except InvalidProblemError as error:
            failures.append(error)
            found.append({"file": str(file), "ok": False, **_error(error)})
            continue
        found.append(
            {"file": str(file), "ok": True, "warnings": document.warnings, "problem": document.filled()}
        )
        for warning in document.warnings:
            say(f"{file}: warning: {warning}")
        if not as_json:
            click.echo(f"{file}: ok")
    for failure in failures:
        say(str(failure))
    if as_json:
        if failures:
            put({**_error(failures[0]), "files": found})
        else:
            put(found[0] if len(found) == 1 else {"files": found})
    return BAD_INPUT if failures else SOLVED


@cli.command()
@click.argument("folder", type=click.Path(path_type=Path))
@_json_option
def plot(folder: Path, as_json: bool) -> int:
    """Draw the pictures of the solution stored in FOLDER, into it."""
    from nhpocp.solution_folder import load_solution
    from nhpocp.views.figures import write_pictures

    written = [str(path) for path in write_pictures(load_solution(folder), folder)]
    if as_json:
        put({"folder": str(folder), "pictures": written})
    else:
        click.echo("\n".join(written))
    return SOLVED


@cli.command()
@_json_option
def systems(as_json: bool) -> int:
    """List the models with their states, inputs, parameters and presets."""
    from nhpocp.problem_file import systems as listing

    found = listing()
    if as_json:
        put(found)
        return SOLVED
    for name, entry in found.items():
        states, inputs = (", ".join(_block(block) for block in entry[part]) for part in ("states", "inputs"))
        click.echo(f"{name}: state {states}; input {inputs}")
        for parameter, default in entry["defaults"].items():
            click.echo(f"  {parameter} = {default}: {entry['meanings'][parameter]}")
        if entry["presets"]:
            click.echo(f"  presets: {', '.join(entry['presets'])}")
    return SOLVED


def _block(block: Mapping[str, Any]) -> str:
    return block["name"] + "".join(f"[{size}]" for size in block["shape"])


@cli.command()
def schema() -> int:
    """Print the JSON schema of problem files, for editors."""
    from nhpocp.problem_file import json_schema

    put(json_schema())
    return SOLVED


@cli.command()
@click.argument("file", type=click.Path(path_type=Path), default=Path("problem.yaml"))
@click.option(
    "--system", "model", default="three_upu", show_default=True, help="A model of `nhpocp systems`."
)
@_json_option
def init(file: Path, model: str, as_json: bool) -> int:
    """Write a commented starter FILE and its JSON schema beside it."""
    from nhpocp.problem_file import json_schema, starter

    text = starter(model)
    beside = file.with_name("nhpocp.schema.json")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with file.open("x", encoding="utf-8") as target:
            target.write(text)
        beside.write_text(json.dumps(json_schema(), indent=1) + "\n", encoding="utf-8")
    except FileExistsError:
        raise InvalidProblemError(
            "this file exists and is left alone; name another", file=str(file)
        ) from None
    except OSError as error:
        raise InvalidProblemError(f"cannot write here: {error.strerror}", file=str(file)) from error
    if as_json:
        put({"file": str(file), "schema": str(beside)})
    else:
        click.echo(f"{file}\n{beside}\nnext: nhpocp solve {file}")
    return SOLVED


@cli.command()
@_json_option
def doctor(as_json: bool) -> int:
    """Say which versions, plugins and compiler are at hand."""
    from nhpocp.diagnosis import diagnose

    found = diagnose()
    if as_json:
        put(found)
    else:
        for name, value in found.items():
            click.echo(f"{name}: {', '.join(value) if isinstance(value, list) else value}")
    return SOLVED


def _safe(name: str) -> str:
    """A problem's name as one folder name."""
    safe = "".join(character if character.isalnum() or character in "-_." else "-" for character in name)
    return safe if safe.strip(".") else "problem"


@contextmanager
def _interrupts() -> Iterator[None]:
    """SIGTERM acts like Ctrl-C: the solver stops and what it has is written."""
    before = signal.signal(signal.SIGTERM, lambda *_: signal.raise_signal(signal.SIGINT))
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def _progress(quiet: bool) -> Iterator[Progress | None]:
    """One line that follows the iterations, on a terminal only."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console

    with Console(stderr=True).status("building") as status:

        def show(record: Mapping[str, Any]) -> None:
            error = record.get("error")
            status.update(
                f"iteration {record['k']}  E = {error:.3e}"
                if error is not None
                else f"iteration {record['k']}"
            )

        yield show


def _write(solution: Solution, folder: Path) -> None:
    """The solution folder, with pictures if the problem asks for them; a second Ctrl-C does not tear it."""
    from nhpocp.solution_folder import save_solution

    pictures = None
    if solution.problem.pictures:
        from nhpocp.views.figures import write_pictures

        pictures = write_pictures
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        save_solution(solution, folder, pictures)
    finally:
        signal.signal(signal.SIGINT, before)


def _report(solution: Solution, folder: Path) -> None:
    """The end of `solve` in a few lines."""
    click.echo(f"{solution.problem.name} ({solution.solver}): {solution.outcome.value}")
    click.echo(f"  {solution.message}")
    if solution.verdict:
        for line in _verdict_lines(solution.verdict):
            click.echo(line)
    times = solution.timing
    click.echo(
        f"  effort {solution.control.effort:.6g}, {solution.evaluations} evaluations, build {times['build_s']:.2f} s, "
        f"solve {times['solve_s']:.2f} s, verification {times['verify_s']:.2f} s"
    )
    click.echo(f"  written: {folder}")


def _verdict_lines(verdict: Any) -> list[str]:
    def figure(value: float | None) -> str:
        return "-" if value is None else f"{value:.3g}"

    lines = [
        f"  verified error E = {figure(verdict.error)}, rolling constraint {figure(verdict.rolling)}, "
        f"leg rates {figure(verdict.leg_rate)} ({verdict.method})"
    ]
    if verdict.original is not None:
        replay = verdict.original
        lines.append(f"  replay of (3) under u: E = {figure(replay.error)}, reached t = {replay.reached:.4g}")
    lines += [f"  refuted: {reason}" for reason in verdict.reasons]
    lines += [f"  warning: {warning}" for warning in verdict.warnings]
    return lines


def _error(error: BaseException) -> dict[str, Any]:
    """The JSON form of bad input."""
    place = {name: getattr(error, name, None) for name in ("file", "line", "column", "path")}
    return {"error": {**place, "message": getattr(error, "message", None) or str(error)}}


def main() -> None:
    """Entry point: runs a verb and turns errors into messages and exit statuses."""
    # pydantic would look through every installed package for plugins, a tenth of the time of `check`
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    arguments = sys.argv[1:]
    as_json, debug = "--json" in arguments, "--debug" in arguments
    if debug:
        arguments = ["--debug", *(argument for argument in arguments if argument != "--debug")]
    try:
        status = cli.main(args=arguments, prog_name="nhpocp", standalone_mode=False)
    except click.ClickException as error:
        if as_json:
            put(
                {
                    "error": {
                        "file": None,
                        "line": None,
                        "column": None,
                        "path": None,
                        "message": error.format_message(),
                    }
                }
            )
        error.show()
        status = BAD_INPUT
    except (click.Abort, KeyboardInterrupt):
        say("stopped by hand before there was anything to keep")
        status = NOT_SOLVED
    except NhpocpError as error:
        if debug:
            raise
        if as_json:
            put(_error(error))
        say(str(error))
        status = MISSING_PART if isinstance(error, MissingDependencyError) else BAD_INPUT
    except BrokenPipeError:
        sys.stderr.close()
        status = NOT_SOLVED
    sys.exit(status if isinstance(status, int) else SOLVED)
