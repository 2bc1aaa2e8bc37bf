"""What is wrong with a file, and where: collected first, reported once, in the order of the file."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

Path = tuple[str | int, ...]


@dataclass(frozen=True)
class Issue:
    """One thing that is wrong at one place; ``at_key`` where the key itself is the mistake.

    ``known``: the names that the path's last may have been meant as. They are compared once the issue is told: of tens
    of thousands one is.
    """

    path: Path
    message: str
    at_key: bool = False
    known: tuple[str, ...] | None = None

    @property
    def words(self) -> str:
        """The message, with what may have been meant."""
        if self.known is None:
            return self.message
        return f"{self.message}; {suggestion(str(self.path[-1]), self.known)}"

    def under(self, prefix: Path) -> Issue:
        """The same issue, its path counted from further up."""
        return replace(self, path=prefix + self.path)


class Refusal(ValueError):
    """Raised by validators: several issues at once, their paths relative to the value validated."""

    def __init__(self, issues: Sequence[Issue]) -> None:
        super().__init__("; ".join(issue.message for issue in issues))
        self.issues = tuple(issues)


def dotted(path: Path) -> str:
    """("via", 0, "at") as via[0].at."""
    text = ""
    for part in path:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def suggestion(word: str, known: Iterable[str]) -> str:
    """The nearest known word as a question, else all of them."""
    known = list(known)
    near = difflib.get_close_matches(word.lower(), known, n=1, cutoff=0.6)
    if near:
        return f"did you mean {near[0]!r}?"
    return f"expected one of {', '.join(known)}" if known else "no key is expected here"


def unknown_key(path: Path, known: Iterable[str]) -> Issue:
    """A key that does not exist."""
    return Issue(path, "unknown key", at_key=True, known=tuple(known))
