"""What the verbs say, and where: results on standard output, messages on standard error."""

from __future__ import annotations

import errno
import io
import json
import os
import sys
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import click

from nhpocp.plain_text import CONTROLS, visible

if TYPE_CHECKING:
    from rich.console import Console

    from nhpocp.solution import Verdict


def open_streams() -> None:
    """Streams that take whatever is written to them, of this process and of those that it starts.

    One that was closed (`2>&-`) leads nowhere; without that its number would go to the first file opened, and messages
    into it. What an encoding lacks is written as an escape.
    """
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(number, True)
    os.close(number)
    for name, number in (("stdout", 1), ("stderr", 2)):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, io.TextIOWrapper(io.FileIO(number, "w", closefd=False), encoding="utf-8"))
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def say(text: str) -> None:
    """A message for people, on standard error; where that takes none, what was asked for is done without."""
    try:
        click.echo(visible(text), err=True)
    except OSError:
        abandon(sys.stderr)


def abandon(stream: Any) -> None:
    """Nobody reads on, or the disk is full: Python shall not try once more at its end."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def tell(text: str) -> None:
    """A result for people, on standard output."""
    click.echo(visible(text))


def console(*, error: bool = False) -> Console:
    """rich's, on standard output or on standard ``error``; every text on it is `visible`, wherever it stands."""
    from rich.console import Console
    from rich.segment import Segment

    class Visible(Console):
        def render_str(self, text: str, **how: Any) -> Any:  # before it is measured
            return super().render_str(visible(text), **how)

        def render(self, *what: Any) -> Any:
            for part in super().render(*what):
                yield part if part.control else Segment(visible(part.text), part.style)

    return Visible(stderr=error, highlight=False, markup=False, emoji=False)


def put(data: Any) -> None:
    """The one JSON document of --json, on standard output; with JSON's escapes where the encoding lacks something."""
    text = json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False)
    try:
        text.encode(getattr(sys.stdout, "encoding", None) or "utf-8")
    except UnicodeEncodeError:
        text = json.dumps(data, indent=1, allow_nan=False)
    # JSON itself spells out but some of them
    spelt = CONTROLS.sub(lambda match: f"\\u{ord(match[0]):04x}", text)
    _write_whole(spelt + "\n")


def _write_whole(text: str) -> None:
    """Text to standard output, all of it: without a buffer (`python -u`) Python drops what a pipe did not take at once,
    as when a signal arrives."""
    stream, raw = sys.stdout, getattr(sys.stdout, "buffer", None)
    if not isinstance(raw, io.RawIOBase):
        click.echo(text, nl=False)
        return
    stream.flush()
    rest = memoryview(text.encode(stream.encoding, stream.errors or "strict"))
    while rest:
        written = raw.write(rest)
        if written is None:
            raise BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))
        rest = rest[written:]


def error_data(error: BaseException, **known: Any) -> dict[str, Any]:
    """The JSON form of an error; what it does not know itself may be given."""
    stated = {name: getattr(error, name, None) for name in ("file", "line", "column", "path", "message")}
    return {"error": {**stated, "message": stated["message"] or str(error), **known}}


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
