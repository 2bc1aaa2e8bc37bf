"""A problem file, read and validated; nothing is built and nothing heavy imported."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path as FilePath
from typing import Any

from pydantic import ValidationError

from nhpocp.errors import InvalidProblemError
from nhpocp.problem_file import document as documents
from nhpocp.problem_file.angles import probable_degrees
from nhpocp.problem_file.document import Document
from nhpocp.problem_file.ends import broken_ends, coarse_tolerance
from nhpocp.problem_file.issues import Issue, Path, Refusal, dotted
from nhpocp.problem_file.messages import translate
from nhpocp.problem_file.numbers import describe
from nhpocp.problem_file.overrides import apply
from nhpocp.problem_file.registry import read_system
from nhpocp.problem_file.schema import Context, FreeHorizon, ProblemData
from nhpocp.problem_file.states import plain_state
from nhpocp.systems.system import System


@dataclass(frozen=True)
class ProblemFile:
    """A validated problem file.

    ``text`` is the YAML as read; with overrides, the same file with the overrides in it.
    """

    data: ProblemData
    text: str
    path: FilePath | None
    system: System
    doubts: list[Issue] = field(default_factory=list)  # what is legal and hardly meant
    place: Place | None = None

    @property
    def warnings(self) -> list[str]:
        """The doubts as `path: message`."""
        return [f"{dotted(doubt.path)}: {doubt.message}" for doubt in self.doubts]

    def warning_lines(self) -> list[str]:
        """The doubts as lines for people, with file, line and column."""
        located = [
            self.located(InvalidProblemError(d.message, path=dotted(d.path)), d.at_key) for d in self.doubts
        ]
        return [f"{error.place or 'problem'}: warning: {error.path}: {error.message}" for error in located]

    def filled(self) -> dict[str, Any]:
        """Every default filled in, as plain JSON data; angles in radians. Itself a valid problem."""
        data = self.data.model_dump(mode="json", exclude_none=True)
        data["system"] = {
            **{name: self.data.system[name] for name in ("model", "preset") if name in self.data.system},
            **self.system.parameters(),
        }
        known = self.data.length_scale, self.system.own_length, self.data.error_length
        data["length_scale"] = next(length for length in known if length)
        return data

    def located(self, error: InvalidProblemError, at_key: bool = False) -> InvalidProblemError:
        """The same error with file, line and column, as far as its path tells."""
        if self.place is None or error.line is not None:
            return error
        return self.place.error([Issue(undotted(error.path or ""), error.message, at_key)])


@dataclass(frozen=True)
class Place:
    """Where the text came from: turns issues into one error with file, line and column."""

    file: str | None
    document: Document
    overridden: Sequence[Path] = ()

    def error(self, issues: Iterable[Issue]) -> InvalidProblemError:
        """The first issue in the order of the file, mistakes in --set before it; says how many more there are."""
        unique = list(dict.fromkeys(issues))
        first = min(unique, key=self._order)
        more = f" (and {len(unique) - 1} more)" if len(unique) > 1 else ""
        path = dotted(first.path) or None
        if by := self._override(first.path):
            return InvalidProblemError(f"{first.words} (given by --set {dotted(by)}){more}", path=path)
        mark = self.document.locate(first.path, first.at_key)
        return InvalidProblemError(
            first.words + more,
            path=path,
            file=self.file,
            line=mark.line if mark else None,
            column=mark.column if mark else None,
        )

    def _override(self, path: Path) -> Path | None:
        """The override that a path stands in, or that made the mapping where the path is missing."""
        if path in self.document.marks:
            return None
        return next((done for done in self.overridden if path[: len(done)] == done), None) or next(
            (done for done in self.overridden if path and done[: len(path)] == path), None
        )

    def _order(self, issue: Issue) -> tuple[int, int]:
        if self._override(issue.path):
            return (0, 0)
        mark = self.document.locate(issue.path, issue.at_key)
        return (mark.line, mark.column) if mark else (10**9, 0)


def undotted(text: str) -> Path:
    """via[0].at as ("via", 0, "at")."""
    words = text.replace("[", ".[").split(".")
    return tuple(int(word[1:-1]) if word.startswith("[") else word for word in words if word)


def read(path: str | FilePath, overrides: Sequence[str] = ()) -> ProblemFile:
    """A problem file, validated.

    Errors: `InvalidProblemError` with file, line and column.
    """
    path = FilePath(path)
    return _read(documents.read_file(path), str(path), path, overrides)


def read_text(text: str, file: str | None = None, overrides: Sequence[str] = ()) -> ProblemFile:
    """The same from a text; ``file`` is how messages call it."""
    return _read(text, file, FilePath(file) if file else None, overrides)


def _read(text: str, file: str | None, path: FilePath | None, overrides: Sequence[str]) -> ProblemFile:
    document = documents.parse(text, file)
    overridden: list[Path] = []
    if not isinstance(document.data, dict):
        raise InvalidProblemError(
            f"expected a mapping that begins with `nhpocp: 1`, got {describe(document.data)}",
            file=file,
            line=1,
            column=1,
        )
    if overrides:
        document, overridden = apply(document, overrides, file)
    place = Place(file, document, overridden)
    data, system = _validate(document.data, place)
    if data.name is None:
        data = data.model_copy(update={"name": _stem(path)})
    shown = document.text if overrides else text
    return ProblemFile(data, shown, path, system, list(_doubts(data, system, document.data)), place)


def _stem(path: FilePath | None) -> str:
    return "".join(c if c.isprintable() and c not in "\\/" else "_" for c in path.stem) if path else "problem"


def _validate(raw: dict[str, Any], place: Place) -> tuple[ProblemData, System]:
    issues: list[Issue] = []
    system, block, context = None, None, None
    if "system" in raw:
        try:
            system, block = read_system(raw["system"])
            context = Context(system, system.known_outputs)
        except Refusal as refusal:
            issues = [issue.under(("system",)) for issue in refusal.issues]
    try:
        # the system's own issues are already known
        checked = {**raw, "system": {}} if "system" in raw else raw
        data = ProblemData.model_validate(checked, context=context)
    except ValidationError as error:
        raise place.error(issues + translate(error, ProblemData)) from None
    if system is None or issues:
        raise place.error(issues)
    return data.model_copy(update={"system": block}), system


def _doubts(data: ProblemData, system: System, raw: dict[str, Any]) -> Iterator[Issue]:
    start, goal = plain_state(data.start), plain_state(data.goal)
    if system.driftless and all(name in start and _close(goal[name], start[name]) for name in goal):
        yield Issue(("goal",), "the same as start; the shortest plan is to stand still", at_key=True)
    yield from broken_ends(data, system)
    yield from coarse_tolerance(data, system)
    yield from probable_degrees(raw, system)
    if data.objective == "time" and not isinstance(data.horizon, FreeHorizon):
        fixed = "time is fixed by horizon; write horizon: {min: …, max: …} to free it"
        yield Issue(("objective",), fixed, at_key=True)


def _close(a: Any, b: Any) -> bool:
    if isinstance(a, list):
        return all(_close(x, y) for x, y in zip(a, b, strict=True))
    return abs(a - b) <= 1e-12 * max(1.0, abs(a))
