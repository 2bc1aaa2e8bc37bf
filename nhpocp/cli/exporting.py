"""The verb `export`: a plan for a machine, a planner, or the table of a study; argument and format decide."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from nhpocp.cli.exit_status import SOLVED
from nhpocp.cli.options import json_option, opened, set_option
from nhpocp.cli.terminal import put, say, tell
from nhpocp.errors import InvalidProblemError
from nhpocp.machine.export.registry import FORMATS, MACHINES, PLANNERS

TABLES = ("csv", "parquet")  # of a study
PLAN = {  # options of a plan, by the keyword that they are
    "rate": "--rate",
    "duration": "--duration",
    "profile": "--profile",
    "max_speed": "--max-speed",
    "max_acceleration": "--max-acceleration",
}
OF_A_PLAN = FORMATS | MACHINES
MEANINGS = "; ".join(f"{name}: {each.meaning}" for name, each in (OF_A_PLAN | PLANNERS).items())


@click.command(epilog=f"Formats. {MEANINGS}. MCAP needs the extra `export`, Parquet `parquet`.")
@click.argument("source", type=click.Path(path_type=Path), metavar="DIR|FILE|STUDY.sqlite")
@click.option(
    "--format",
    "kind",
    type=click.Choice([*OF_A_PLAN, *PLANNERS, "parquet"]),
    default="csv",
    show_default=True,
    help=f"Of a plan {', '.join(OF_A_PLAN)}; of a problem {', '.join(PLANNERS)}; of a study {', '.join(TABLES)}.",
)
@click.option("--rate", type=float, help="Samples per unit of time (Hz where that is s); default: 100.")
@click.option(
    "--duration",
    type=float,
    help="Of the motion; default: the least that keeps the limits, without limits the plan's own.",
)
@click.option(
    "--profile",
    type=click.Choice(["quintic", "linear"]),
    help="quintic: the same path with zero speed and acceleration at both ends, the default; linear: the plan's own "
    "timing, the only one of systems with drift.",
)
@click.option("--max-speed", type=float, help="Of every leg with a motor; without legs, of every input.")
@click.option("--max-acceleration", type=float, help="Likewise.")
@set_option
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    help="The file; default: motion.ENDING (machine.xml) in DIR, NAME_planner.c here, or the table beside the store.",
)
@json_option
def export(
    source: Path, kind: str, overrides: tuple[str, ...], output: Path | None, as_json: bool, **timing: Any
) -> int:
    """Write a plan for a machine, a planner that needs no Python, or a study's rows as a table.

    Of a solution folder DIR: poses, inputs and legs with speeds and accelerations, at a machine's rate, in its time and
    within its limits, integrated again from the plan itself.

    Of a problem FILE (--format c-planner): a C99 file and its header, which plan from any start to any goal as the
    Jacobian method does with `step_rule: adaptive`; --set changes the problem.

    Of a STUDY.sqlite: one row a run, its axes, how it ended, costs and margins.
    """
    given = {name: value for name, value in timing.items() if value is not None}
    if kind in MACHINES | PLANNERS:
        _refuse_timing(given, f"an option of a motion, which {kind} is not")
    if kind in PLANNERS:
        return _planner(source, kind, overrides, output, as_json)
    if overrides:
        words = f"changes a problem FILE, which {', '.join(PLANNERS)} is made of; this was planned as it is"
        raise InvalidProblemError(words, path="--set")
    if kind in MACHINES and source.is_dir():
        return _machine(source, kind, output, as_json)
    if source.is_dir():
        return _plan(source, kind, output, given, as_json)
    if not source.exists():
        words = "no such file or folder; expected a solution folder, or the store of a study"
        raise InvalidProblemError(words, file=str(source))
    _refuse_timing(given, "an option of a solution folder; a study's table takes --format and -o")
    if kind not in TABLES:
        words = f"{kind} is a format of a solution folder, and this is none; of a study: {', '.join(TABLES)}"
        raise InvalidProblemError(f"{words}; of a problem: {', '.join(PLANNERS)}", file=str(source))
    return _table(source, kind, output, as_json)


def _refuse_timing(given: dict[str, Any], words: str) -> None:
    if given:
        raise InvalidProblemError(words, path=PLAN[next(iter(given))])


def _plan(folder: Path, kind: str, output: Path | None, timing: dict[str, Any], as_json: bool) -> int:
    if kind not in FORMATS:
        words = f"{kind} is a format of a study, STUDY.sqlite; of a solution folder: {', '.join(OF_A_PLAN)}"
        raise InvalidProblemError(words, file=str(folder))
    from nhpocp.machine.export.motion import make_motion
    from nhpocp.solution_folder import load_solution, unwritable

    file = _file_beside(folder, output, FORMATS[kind].file_name)
    solution = load_solution(folder)
    motion = make_motion(solution, **timing)
    if not motion.converged:
        say(
            f"warning: this plan is not solved and verified ({solution.outcome.value}); a machine should not run it"
        )
    try:
        FORMATS[kind].write(motion, file)
    except OSError as error:
        raise unwritable(file, error) from error
    scaling, samples = motion.scaling, len(motion.times)
    if as_json:
        put(
            {
                "file": str(file),
                "format": kind,
                "samples": samples,
                "rate": motion.rate,
                "duration": scaling.duration,
                "profile": scaling.profile.name,
                "converged": motion.converged,
            }
        )
    else:
        tell(str(file))
        say(f"{samples} samples over {scaling.duration:.6g}, {scaling.profile.name}")
    return SOLVED


def _machine(folder: Path, kind: str, output: Path | None, as_json: bool) -> int:
    from nhpocp.solution_folder import load_solution, unwritable

    file = _file_beside(folder, output, MACHINES[kind].file_name)
    problem = load_solution(folder).problem
    try:
        MACHINES[kind].write(problem, file)
    except OSError as error:
        raise unwritable(file, error) from error
    if as_json:
        put({"file": str(file), "format": kind})
    else:
        tell(str(file))
    return SOLVED


def _planner(source: Path, kind: str, overrides: Sequence[str], output: Path | None, as_json: bool) -> int:
    if source.is_dir():
        words = f"this is a folder; {kind} is made of a problem's file, such as {source / 'problem.yaml'}"
        raise InvalidProblemError(words, file=str(source))
    document = opened(source, overrides)
    from nhpocp.csv_writer import identifiers
    from nhpocp.planning import own_solver
    from nhpocp.problem_file import build
    from nhpocp.solution_folder import unwritable

    problem = build(document)
    (stem,) = identifiers([f"{problem.name}_{PLANNERS[kind].stem}"])
    file = output or Path(f"{stem}.{PLANNERS[kind].ending}")
    _check_file(file)
    solver = own_solver(problem, "jacobian")
    try:
        header = PLANNERS[kind].write(problem, solver, file)
    except InvalidProblemError as error:
        raise error if error.file else document.located(error) from error
    except OSError as error:
        raise unwritable(file, error) from error
    if as_json:
        put({"file": str(file), "header": str(header), "format": kind, "name": stem})
    else:
        tell(f"{file}\n{header}")
        if solver.settings().get("step_rule") == "auto":
            say("of `step_rule: auto` the planner has the first way alone: one start, by `adaptive`")
    return SOLVED


def _file_beside(folder: Path, output: Path | None, name: str) -> Path:
    """The file that is asked for, which is none of the solution's own."""
    from nhpocp.solution_folder.target import DATA

    file = output or folder / name
    _check_file(file)
    if file.name in DATA and file.resolve().parent == folder.resolve():
        raise InvalidProblemError("this is a file of the solution itself; name another", file=str(file))
    return file


def _check_file(file: Path) -> None:
    if file.is_dir():
        raise InvalidProblemError("this is a folder; name a file", file=str(file))


def _table(store: Path, kind: str, output: Path | None, as_json: bool) -> int:
    from nhpocp.solution_folder import unwritable
    from nhpocp.study.export import FORMATS as WRITERS
    from nhpocp.study.store import Store

    file = output or store.with_suffix(f".{kind}")
    if file.resolve() == store.resolve():
        raise InvalidProblemError("this is the store itself; name another file", file=str(file))
    with Store.open(store) as opened:
        try:
            WRITERS[kind](opened, file)
        except OSError as error:  # of a full disk, which does not say where
            raise unwritable(file, error) from error
    if as_json:
        put({"file": str(file)})
    else:
        tell(str(file))
    return SOLVED
