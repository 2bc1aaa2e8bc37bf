"""The progress of long work: a few lines on standard error that follow the solvers' records, on a terminal only."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from nhpocp.cli.terminal import console
from nhpocp.views.progress import ASCII_BLOCKS, AT_ONCE, BLOCKS, LONGEST_LINE, Panel

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderResult

    from nhpocp.solution import Progress


@contextmanager
def progress(quiet: bool, title: str = "") -> Iterator[Progress | None]:
    """A listener for solvers that draws what it hears; None where nobody would see it."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.live import Live

    panel = TerminalPanel(title)
    with Live(
        panel,
        console=console(error=True),
        refresh_per_second=4,
        transient=True,
        redirect_stdout=sys.stdout.isatty(),  # what goes to a file is none of the terminal's business
    ) as live:

        def show(record: Mapping[str, Any]) -> None:
            if panel.hear(record):
                live.refresh()

        yield show


@contextmanager
def counter(quiet: bool, word: str) -> Iterator[Callable[[int, int], None] | None]:
    """How many of what is made are done; None where nobody would see it."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    with console(error=True).status(word) as status:
        yield lambda done, count: status.update(f"{word} {done} of {count}")


class TerminalPanel(Panel):
    """A panel as rich draws it."""

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        from rich.text import Text

        if self.seconds < AT_ONCE:
            return
        width = min(options.max_width, LONGEST_LINE)
        blocks = ASCII_BLOCKS if options.ascii_only else BLOCKS
        styles = ["bold", "", "", "dim"]
        for line, style in zip(self.lines(width, blocks), styles, strict=True):
            if line:
                yield Text(line, style, no_wrap=True, overflow="ellipsis")
