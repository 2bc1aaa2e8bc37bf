"""What the verbs say, and where: results on standard output, messages and progress on standard error."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from nhpocp.comparison import Comparison
    from nhpocp.solution import Progress, Solution, Verdict

TIMES = {"build_s": "build", "solve_s": "solve", "verify_s": "verification"}


def say(text: str) -> None:
    """A message for people, on standard error."""
    click.echo(text, err=True)


def put(data: Any) -> None:
    """The one JSON document of --json, on standard output."""
    click.echo(json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False))


def error_data(error: BaseException, **known: Any) -> dict[str, Any]:
    """The JSON form of an error; what it does not know itself may be given."""
    found = {name: getattr(error, name, None) for name in ("file", "line", "column", "path", "message")}
    return {"error": {**found, "message": found["message"] or str(error), **known}}


@contextmanager
def progress(quiet: bool) -> Iterator[Progress | None]:
    """One line that follows the iterations, on a terminal only."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console

    with Console(stderr=True).status("building") as status:

        def show(record: Mapping[str, Any]) -> None:
            error = record.get("error")
            words = "" if error is None else f"  E = {error:.3e}"
            run = f"{record['name']} by {record['variant']}: " if "variant" in record else ""
            status.update(f"{run}iteration {record['k']}{words}")

        yield show


@contextmanager
def counter(quiet: bool, word: str) -> Iterator[Callable[[int, int], None] | None]:
    """How many of what is made are done, on a terminal only."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console

    with Console(stderr=True).status(word) as status:
        yield lambda done, count: status.update(f"{word} {done} of {count}")


def report(solution: Solution, folder: Path) -> None:
    """The end of `solve` in a few lines."""
    click.echo(f"{solution.problem.name} ({solution.solver}): {solution.outcome.value}")
    click.echo(f"  {solution.message}")
    if solution.verdict:
        for line in verdict_lines(solution.verdict):
            click.echo(line)
    times = [f"{word} {solution.timing[key]:.2f} s" for key, word in TIMES.items() if key in solution.timing]
    effort = f"effort {solution.control.effort:.6g}"
    click.echo(f"  {', '.join([effort, f'{solution.evaluations} evaluations', *times])}")
    click.echo(f"  written: {folder}")


def comparison_lines(comparison: Comparison, file: Path, animations: Sequence[Path] = ()) -> None:
    """The end of `compare`: a line a run, and where the report and the animations are."""

    def figure(value: float | None, form: str) -> str:
        return "-" if value is None else format(value, form)

    rows = comparison.rows()
    widths = [
        max(len(str(row[key])) for row in rows) if rows else 0 for key in ("name", "variant", "outcome")
    ]
    for row in rows:
        words = [
            str(row[key]).ljust(w) for key, w in zip(("name", "variant", "outcome"), widths, strict=True)
        ]
        gap = None if row["optimality_gap"] is None else 100 * row["optimality_gap"]
        cost = f"{row['objective']} {figure(row['objective_value'], '.6g')}"
        numbers = f"E = {figure(row['verified_error'], '.2e')}  {cost}"
        click.echo(
            f"{'  '.join(words)}  {numbers}  gap {figure(gap, '.2f')} %  {figure(row['solve_s'], '.2f')} s"
        )
    for note in comparison.notes:
        say(note)
    for animation in animations:
        click.echo(f"animation: {animation}")
    click.echo(f"report: {file}")


def verdict_lines(verdict: Verdict) -> list[str]:
    """A verdict in a few lines."""

    def figure(value: float | None) -> str:
        return "-" if value is None else f"{value:.3g}"

    legs = (verdict.rolling, verdict.leg_rate)
    shown = (
        f", rolling constraint {figure(legs[0])}, leg rates {figure(legs[1])}"
        if any(value is not None for value in legs)
        else ""
    )
    lines = [f"  verified error E = {figure(verdict.error)}{shown} ({verdict.method})"]
    if verdict.original is not None:
        replay = verdict.original
        lines.append(f"  replay of (3) under u: E = {figure(replay.error)}, reached t = {replay.reached:.4g}")
    lines += [f"  refuted: {reason}" for reason in verdict.reasons]
    lines += [f"  warning: {warning}" for warning in verdict.warnings]
    return lines
