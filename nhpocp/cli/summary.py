"""The end of `solve` and `compare`: plain lines where a program may read them, tables and the next step on a terminal.

The plain lines stay as they are from version to version; the tables may change.
"""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nhpocp.cli.terminal import console, say, tell, verdict_lines

if TYPE_CHECKING:
    from rich.console import Console

    from nhpocp.comparison import Comparison
    from nhpocp.solution import Solution

TIMES = {"build_s": "build", "solve_s": "solve", "verify_s": "verification"}
WIDEST = 100
ROOM_FOR_ALL = 76  # columns; the table of a comparison leaves out gap and time below it


def report(solution: Solution, folder: Path, task: str = "") -> None:
    """The end of `solve`. ``task``: the file and the overrides, as they were typed."""
    if sys.stdout.isatty():
        _report_table(solution, folder, task)
        return
    tell(f"{solution.problem.name} ({solution.solver}): {solution.outcome.value}")
    tell(f"  {solution.message}")
    if solution.verdict:
        for line in verdict_lines(solution.verdict):
            tell(line)
    for warning in solution.warnings:
        tell(f"  warning: {warning}")
    effort = f"effort {solution.control.effort:.6g}"
    parts = [effort, f"{solution.evaluations} evaluations", *_times(solution)]
    tell(f"  {', '.join(parts)}")
    tell(f"  written: {folder}")
    if words := _undrawn(solution, folder):
        tell(f"  {words}")


def _undrawn(solution: Solution, folder: Path) -> str:
    """That the pictures of a run that was stopped are still to be drawn, and how; else empty."""
    if solution.outcome.value != "interrupted" or not solution.problem.pictures:
        return ""
    drawn = folder.is_dir() and any(name.endswith((".svg", ".png")) for name in os.listdir(folder))
    return "" if drawn else f"no pictures were drawn; `nhpocp plot {shlex.quote(str(folder))}` draws them"


def comparison_lines(comparison: Comparison, files: Sequence[Path], tasks: Mapping[str, str]) -> None:
    """The end of `compare`: a line a run, and where the report is.

    ``files``: that were written; ``tasks``: `report`'s task by the problem's name.
    """
    animations = [path for path in files if path.stem == "animation"]
    if sys.stdout.isatty():
        _comparison_table(comparison, files, tasks, animations)
        return
    rows = comparison.rows()
    widths = [
        max(len(str(row[key])) for row in rows) if rows else 0 for key in ("name", "variant", "outcome")
    ]
    for row in rows:
        words = [
            str(row[key]).ljust(w) for key, w in zip(("name", "variant", "outcome"), widths, strict=True)
        ]
        cost = f"{row['objective']} {_figure(row['objective_value'], '.6g')}"
        numbers = f"E = {_figure(row['verified_error'], '.2e')}  {cost}"
        tell(f"{'  '.join(words)}  {numbers}  gap {_gap(row)} %  {_figure(row['solve_s'], '.2f')} s")
    for note in comparison.notes:
        say(note)
    for path in animations:
        tell(f"animation: {path}")
    for path in files:
        if path.stem == "report":
            tell(f"report: {path}")


def task(file: Path, overrides: Sequence[str]) -> str:
    """A problem as it was typed."""
    words = [str(file)]
    for override in overrides:
        words += ["--set", override]
    return shlex.join(words)


def _figure(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


def _gap(row: Mapping[str, Any]) -> str:
    return _figure(None if row["optimality_gap"] is None else 100 * row["optimality_gap"], ".2f")


def _times(solution: Solution) -> list[str]:
    return [f"{word} {solution.timing[key]:.2f} s" for key, word in TIMES.items() if key in solution.timing]


# --- on a terminal --------------------------------------------------------------------------------------------------


def _console() -> Console:
    narrow = console()
    narrow.width = min(narrow.width, WIDEST)
    return narrow


def _outcome(outcome: str) -> Any:
    from rich.text import Text

    return Text(outcome, "bold green" if outcome == "converged" else "bold red")


def _report_table(solution: Solution, folder: Path, task: str) -> None:
    from rich.table import Table
    from rich.text import Text

    drawn, verdict = _console(), solution.verdict
    head = Text(f"{solution.problem.name} by {solution.solver}: ", "bold")
    drawn.print(head + _outcome(solution.outcome.value))
    drawn.print(solution.message)
    table = Table.grid(padding=(0, 2))
    table.add_column(style="dim", no_wrap=True)
    table.add_column(overflow="fold")
    if verdict:
        table.add_row("verified error", f"{_figure(verdict.error, '.3g')}, wanted {solution.tolerance:g}")
        legs = {"rolling": verdict.rolling, "leg rates": verdict.leg_rate}
        known = [f"{name} {value:.2g}" for name, value in legs.items() if value is not None]
        if known:
            table.add_row("from geometry", ", ".join(known))
    if not solution.problem.goal_is_a_pose and solution.pose_reached:
        table.add_row("pose reached", solution.pose_reached)
    table.add_row("effort", f"{solution.control.effort:.6g}")
    cost = solution.costs.get(solution.problem.objective)
    if cost is not None and solution.problem.objective != "effort":
        table.add_row(solution.problem.objective, f"{cost:.6g}")
    table.add_row("evaluations", str(solution.evaluations))
    table.add_row("time", ", ".join(_times(solution)))
    if verdict:
        for word, sentences in (("refuted", verdict.reasons), ("warning", verdict.warnings)):
            for sentence in sentences:
                table.add_row(word, sentence)
    for sentence in solution.warnings:
        table.add_row("warning", sentence)
    table.add_row("written", _written(folder))
    drawn.print(table)
    _next(drawn, next_commands(solution, folder, task))
    if words := _undrawn(solution, folder):
        drawn.print(words, soft_wrap=True)


def _written(folder: Path) -> str:
    """A folder and what is in it; pictures of two formats by one name."""
    kinds: dict[str, list[str]] = {}
    for name in sorted(os.listdir(folder)) if folder.is_dir() else []:
        stem, _, kind = name.rpartition(".")
        kinds.setdefault(stem, []).append(kind)
    return "\n".join([str(folder), ", ".join(f"{stem}.{'|'.join(kind)}" for stem, kind in kinds.items())])


def _next(drawn: Console, commands: Sequence[str]) -> None:
    """What to type next, whole lines that can be copied."""
    if commands:
        drawn.print("next", style="dim")
    for command in commands:
        drawn.print(f"  {command}", soft_wrap=True)


def _comparison_table(
    comparison: Comparison, files: Sequence[Path], tasks: Mapping[str, str], animations: Sequence[Path]
) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    drawn, rows = _console(), comparison.rows()
    wide = drawn.width >= ROOM_FOR_ALL
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    table.add_column("run", overflow="fold")
    table.add_column("outcome", no_wrap=True)
    costs = sorted({row["objective"] for row in rows})
    for name in ["E", costs[0] if len(costs) == 1 else "cost", *(["gap", "time"] if wide else [])]:
        table.add_column(name, justify="right", no_wrap=True)
    for row in rows:
        gap = f"{_gap(row)} %" if row["converged"] else "-"
        more = [gap, f"{_figure(row['solve_s'], '.2f')} s"] if wide else []
        numbers = [_figure(row["verified_error"], ".1e"), _figure(row["objective_value"], ".5g"), *more]
        table.add_row(f"{row['name']} by {row['variant']}", _outcome(row["outcome"]), *numbers)
    drawn.print(table)
    for entry in comparison.entries:
        if not entry.solution.converged and not tasks:  # else it was said as the run ended
            drawn.print(f"{entry.solution.problem.name} by {entry.variant}: {entry.solution.message}")
    for note in comparison.notes:
        say(note)
    drawn.print("written", style="dim")
    for path in [*files, *filter(None, (entry.folder for entry in comparison.entries))]:
        drawn.print(f"  {path}", soft_wrap=True)
    _next(drawn, _after(comparison, tasks, bool(animations)))


def _after(comparison: Comparison, tasks: Mapping[str, str], animated: bool) -> list[str]:
    """Commands that fit the first run that failed; else one that shows what was found for the first problem.

    ``animated``: whether its page is there already; then as a film for slides.
    """
    for entry in comparison.entries:
        name = entry.solution.problem.name
        if not entry.solution.converged and entry.folder:
            own = shlex.quote(str(Path(entry.folder) / "problem.yaml"))
            return next_commands(entry.solution, Path(entry.folder), tasks.get(name, own))
    shown = (
        [entry.folder for entry in comparison.groups[0].entries if entry.folder] if comparison.groups else []
    )
    film = " --format gif" if animated else ""
    return [f"nhpocp animate {shlex.join(shown)}{film}"] if shown else []


# --- what to do next ------------------------------------------------------------------------------------------------


def next_commands(solution: Solution, folder: Path, task: str) -> list[str]:
    """The commands that fit how a solve ended, the most promising first. ``task``: the file and the overrides."""
    outcome, settings = solution.outcome.value, solution.settings
    place = shlex.quote(str(folder))
    again = f"nhpocp solve {task}"
    if solution.converged:
        return [f"nhpocp animate {place}", f"nhpocp verify {place}", f"nhpocp compare {task}"]
    if outcome in ("infeasible", "other_component"):
        return [f"nhpocp check {task}", f"nhpocp analyze {task}"]
    if outcome == "interrupted":
        return [again, f"nhpocp verify {place}"]
    if outcome == "solver_error":
        return ["nhpocp doctor"]
    if solution.solver == "nlp":
        return [_nlp_again(again, outcome, settings), f"nhpocp analyze {task}"]
    if outcome == "not_verified":
        return [f"{again} --set solvers.jacobian.steps={4 * (settings.get('steps') or 100)}"]
    if outcome == "constraint_violated":
        return [f"{again} --solver nlp"]
    if settings.get("step_rule") != "auto" and outcome != "not_reached":
        return [f"{again} --set solvers.jacobian.step_rule=auto", f"nhpocp analyze {task}"]
    return [f"nhpocp analyze {task}", f"{again} --solver nlp"]


def _nlp_again(again: str, outcome: str, settings: Mapping[str, Any]) -> str:
    """The NLP once more, from nearer or with finer intervals; the other method where that was tried."""
    again_by_nlp = f"{again} --solver nlp"
    if outcome in ("not_verified", "constraint_violated"):
        return f"{again_by_nlp} --set solvers.nlp.intervals={2 * settings.get('intervals', 50)}"
    if settings.get("initial") != "jacobian":
        return f"{again_by_nlp} --set solvers.nlp.initial=jacobian"
    if outcome == "iteration_limit":
        return f"{again_by_nlp} --set solvers.nlp.max_iterations={4 * settings.get('max_iterations', 1000)}"
    return f"{again} --set solvers.jacobian.step_rule=auto"
