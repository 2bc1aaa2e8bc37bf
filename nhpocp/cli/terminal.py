"""What the verbs say, and where: results on standard output, messages on standard error."""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from nhpocp.solution import Verdict

_CONTROLS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f]")  # all but tab and newline


def say(text: str) -> None:
    """A message for people, on standard error."""
    click.echo(visible(text), err=True)


def tell(text: str) -> None:
    """A result for people, on standard output."""
    click.echo(visible(text))


def visible(text: str) -> str:
    """A text with its control sequences spelt out: read from a file they would be the file's to command with."""
    return _CONTROLS.sub(lambda found: f"\\x{ord(found[0]):02x}", text)


def put(data: Any) -> None:
    """The one JSON document of --json, on standard output."""
    text = json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False)
    click.echo(
        _CONTROLS.sub(lambda found: f"\\u{ord(found[0]):04x}", text)
    )  # JSON spells out some of them only


def error_data(error: BaseException, **known: Any) -> dict[str, Any]:
    """The JSON form of an error; what it does not know itself may be given."""
    found = {name: getattr(error, name, None) for name in ("file", "line", "column", "path", "message")}
    return {"error": {**found, "message": found["message"] or str(error), **known}}


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
