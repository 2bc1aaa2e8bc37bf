"""The progress of long work in the output of a notebook's cell, while it lasts."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from html import escape
from time import perf_counter
from typing import Any

from nhpocp.solution import Progress
from nhpocp.views.progress import AT_ONCE, LONGEST_LINE, Panel

PAUSE = 0.25  # seconds between two updates
NOTHING = {"text/plain": "", "text/html": ""}


def in_a_notebook() -> bool:
    """Whether this process is a notebook's kernel; a terminal of IPython is none."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return getattr(shell, "kernel", None) is not None


@contextmanager
def followed(progress: Progress | None, title: str = "") -> Iterator[Progress | None]:
    """The listener that is given; in a notebook, where none is, one that shows what it hears until the work ends."""
    if progress is not None or not in_a_notebook():
        yield progress
        return
    from IPython.display import display, update_display

    panel, shown, last = Panel(title), "", 0.0

    def listen(record: Mapping[str, Any]) -> None:
        nonlocal shown, last
        if not panel.hear(record) or panel.seconds < AT_ONCE or perf_counter() - last < PAUSE:
            return
        last, lines = perf_counter(), _as_output(panel)
        if shown:
            update_display(lines, display_id=shown, raw=True)
        else:
            shown = display(lines, display_id=True, raw=True).display_id

    try:
        yield listen
    finally:
        if shown:
            update_display(NOTHING, display_id=shown, raw=True)


def _as_output(panel: Panel) -> dict[str, str]:
    """The lines as text and as HTML that keeps their columns."""
    text = "\n".join(filter(None, panel.lines(LONGEST_LINE)))
    return {"text/plain": text, "text/html": f'<pre style="margin:0">{escape(text)}</pre>'}
