"""The progress of long work in words: a few lines that follow the solvers' records, for whoever draws them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import inf, isfinite, log10
from time import perf_counter
from typing import Any

from nhpocp.deferred import at_hand
from nhpocp.plain_text import visible

BLOCKS, ASCII_BLOCKS = "▁▂▃▄▅▆▇█", "_.:-=+*#"
LONGEST_LINE = 100
OFTEN = 0.1  # seconds between two looks at what a record works out on demand
AT_ONCE = 0.2  # seconds: shorter work shows nothing
LONG = 2.0  # seconds, after which it is said how much may be left
KEPT = 0.25  # of what was foretold: how far it may be off and still be believed
# what a record may hold, and how it is called here, most important first
FIGURES = {
    "jacobian": {
        "cost": "cost",
        "worst_bound": "bounds:",
        "gamma": "γ",
        "step": "step",
        "sigma_jacobian": "σ_min(J)",
        "rank": "rank",
    },
    "nlp": {"objective": "objective", "dual_infeasibility": "dual", "barrier": "μ", "step": "step"},
}


class Panel:
    """What was heard last and how the error fell, as lines of a width.

    It may be drawn from another thread too, so drawing looks at nothing but plain values.
    """

    def __init__(self, title: str = "") -> None:
        self.title, self.began = title, perf_counter()
        self.last: dict[str, Any] = {}
        self.figures: list[str] = []
        self._looked = -inf
        self._begin(None)

    def _begin(self, key: Any) -> None:
        """Another run, or another try: its error falls anew."""
        self.key, self.since, self.calls = key, perf_counter(), 0
        self.errors: list[float] = []
        self.foretold: float | None = None
        self._looked = -inf

    def hear(self, record: Mapping[str, Any]) -> bool:
        """Takes a record; whether it is time to draw."""
        now, known = perf_counter(), at_hand(record)
        if "stage" in known:
            self.last = {**self.last, "stage": known["stage"]}
            return True
        key = [known.get(name) for name in ("run", "way")]
        if key != self.key:
            self._begin(key)
        if not self.calls or known.get("phase") != self.last.get("phase"):
            self.since, self.calls, self.foretold = now, 0, known.get("expected")
        self.calls += 1
        error = record["error"]
        if error is not None and isfinite(error):
            self.errors.append(error)
        plain = ("k", "tolerance", "phase", "at_most", "expected", "way", "name", "variant", "run", "runs")
        self.last = {name: known.get(name) for name in plain} | {"error": error}
        if now - self._looked < OFTEN:
            return False
        self._looked = now
        self.figures = _figures(record)
        return True

    @property
    def seconds(self) -> float:
        """How long it has been listening."""
        return perf_counter() - self.began

    def lines(self, width: int, blocks: str = BLOCKS) -> list[str]:
        """Four lines: what runs, how far it is, its figures, the time; no longer than ``width``."""
        last = self.last
        run = f"run {last['run']} of {last['runs']}" if last.get("run") else ""
        name = f"{last['name']} by {last['variant']}" if last.get("name") else self.title
        at = last.get("stage") or last.get("phase") or ""
        head = _fitting([name, run, last.get("way") or "", at], width, " · ")
        return [head, self._distance(width, blocks), _fitting(self.figures, width), self._time(width)]

    def _distance(self, width: int, blocks: str) -> str:
        """The error in figures, and its course on a logarithmic scale that ends at the tolerance."""
        last = self.last
        if last.get("k") is None:
            return ""
        nlp = bool(self.figures) and self.figures[0].startswith("objective")
        count = f"iteration {last['k']}" if nlp else f"update {last['k']}"
        if not nlp and last["k"] + 1 < self.calls:
            count += f" ({self.calls} evaluations)"
        error = "no number" if last["error"] is None else f"{last['error']:.2e}"
        error = f"{'infeasibility' if nlp else 'E'} {error}"
        goal = f"wanted {last['tolerance']:g}" if last.get("tolerance") and not nlp else ""
        words = _fitting([count, error, goal], width)
        room = min(40, width - len(words) - 2)
        if room < 8 or not self.errors:
            return words
        return f"{words}  {sparkline(self.errors, last.get('tolerance') or 1e-6, room, blocks)}"

    def _time(self, width: int) -> str:
        left = self._left(perf_counter() - self.since)
        return _fitting([f"{duration(self.seconds)} so far", left], width)

    def _left(self, elapsed: float) -> str:
        """What is left, only where something justifies the words.

        The theory's estimate, as long as it proved right so far; else the limit, which bounds this phase and no more;
        of several tries nothing is known.
        """
        last = self.last
        if elapsed < LONG or self.calls < 3 or last.get("way") or last.get("stage"):
            return ""
        pace = elapsed / self.calls
        expected, foretold = last.get("expected"), self.foretold
        if expected is not None and foretold is not None:
            surprise = abs(foretold - (self.calls - 1) - expected)
            if surprise <= KEPT * foretold + 2:
                return f"about {duration(pace * expected)} to the goal"
        if last.get("at_most") is None:
            return ""
        return f"at most {duration(pace * last['at_most'])} in this phase"


def _figures(record: Mapping[str, Any]) -> list[str]:
    names = FIGURES["nlp" if "objective" in record else "jacobian"]
    figures = {word: record.get(name) for name, word in names.items()}
    return [
        f"{word} {value if isinstance(value, str) else format(value, '.4g')}"
        for word, value in figures.items()
        if value is not None
    ]


def _fitting(parts: Sequence[str], width: int, gap: str = "  ") -> str:
    """The parts in a line, as many as it holds."""
    line = ""
    for part in map(visible, filter(None, parts)):
        longer = f"{line}{gap}{part}" if line else part
        if len(longer) > width:
            return line or f"{part[: width - 1]}…"
        line = longer
    return line


def sparkline(values: Sequence[float], bottom: float, width: int, blocks: str = BLOCKS) -> str:
    """Positive values as a row of blocks on a logarithmic scale from ``bottom`` up to the largest."""
    chosen = (
        [values[(i + 1) * len(values) // width - 1] for i in range(width)] if len(values) > width else values
    )
    heights = [log10(max(value, bottom)) - log10(bottom) for value in chosen]
    top = max(*heights, 1e-9, log10(max(*values, bottom)) - log10(bottom))
    return "".join(blocks[min(len(blocks) - 1, int(len(blocks) * height / top))] for height in heights)


def duration(seconds: float) -> str:
    """A time as one says it."""
    if seconds < 10:
        return f"{seconds:.1f} s"
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
