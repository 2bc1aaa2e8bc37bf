"""A problem file, read and checked: its shape by the models of `schema`, its meaning by the `PlanningProblem`.

CasADi is not loaded: this is all of `nhpocp check`, which has a third of a second.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any

from pydantic import ValidationError

from nhpocp.doubts import doubts
from nhpocp.errors import InvalidProblemError, describe, nearest, one_line, refuse
from nhpocp.problem import PlanningProblem
from nhpocp.problem_file import document as documents
from nhpocp.problem_file.building import assembled, build_solvers, via_order
from nhpocp.problem_file.document import Document
from nhpocp.problem_file.homes import homes
from nhpocp.problem_file.messages import translate
from nhpocp.problem_file.obstacles import corners_of_meshes
from nhpocp.problem_file.overrides import apply, within
from nhpocp.problem_file.registry import SYSTEMS, read_system
from nhpocp.problem_file.schema import ProblemData
from nhpocp.systems.system import System
from nhpocp.systems.trial import try_out


@dataclass(frozen=True)
class ProblemFile:
    """A problem file that has been checked.

    ``text`` is the YAML as read; with overrides, the same file with the overrides in it. ``problem`` has no solvers
    yet. ``doubts``: what is legal and hardly meant.
    """

    data: ProblemData
    text: str
    path: FilePath | None
    problem: PlanningProblem
    doubts: list[InvalidProblemError]
    place: Place

    @property
    def system(self) -> System:
        return self.problem.system

    @property
    def warnings(self) -> list[str]:
        """The doubts as `path: message`."""
        return [f"{doubt.path}: {doubt.message}" for doubt in self.doubts]

    def warning_lines(self) -> list[str]:
        """The doubts as lines for people, with file, line and column."""
        located = [self.place.error([doubt]) for doubt in self.doubts]
        return [f"{error.place or 'problem'}: warning: {error.path}: {error.message}" for error in located]

    def filled(self) -> dict[str, Any]:
        """Every default filled in, as plain JSON data; angles in radians. Itself a valid problem."""
        data = self.data.model_dump(mode="json", exclude_none=True)
        data["system"] = {
            **{name: self.data.system[name] for name in ("model", "preset") if name in self.data.system},
            **self.system.parameters(),
        }
        data["length_scale"] = self.problem.scale
        return data

    def located(self, error: InvalidProblemError) -> InvalidProblemError:
        """An error with file, line and column, as far as its path tells."""
        return error if error.line is not None else self.place.error([error, *error.others])


@dataclass(frozen=True)
class Place:
    """Where the text came from: turns errors into one with file, line and column."""

    file: str | None
    document: Document
    overridden: Sequence[str] = ()

    def error(self, errors: Iterable[InvalidProblemError]) -> InvalidProblemError:
        """The first error in the order of the file, mistakes in --set before it; says how many more there are."""
        unique = {(error.path, error.plain): error for error in errors}.values()
        first, *others = map(self._placed, sorted(unique, key=self._order))
        return first.changed(others=tuple(others), counted=bool(others))

    def _placed(self, error: InvalidProblemError) -> InvalidProblemError:
        alone = error.changed(others=(), counted=False)
        if by := self._override(error.path or ""):
            return alone.changed(note=f" (given by --set {by})")
        mark = self.document.locate(error.path or "", error.at_key)
        line, column = (mark.line, mark.column) if mark else (None, None)
        return alone.changed(path=error.path or None, file=self.file, line=line, column=column)

    def _override(self, path: str) -> str | None:
        """The override that a path stands in, or that made the mapping where the path is missing."""
        if path in self.document.marks:
            return None
        return next((done for done in self.overridden if within(path, done)), None) or next(
            (done for done in self.overridden if path and within(done, path)), None
        )

    def _order(self, error: InvalidProblemError) -> tuple[int, int]:
        if self._override(error.path or ""):
            return (0, 0)
        mark = self.document.locate(error.path or "", error.at_key)
        return (mark.line, mark.column) if mark else (10**9, 0)


def read(path: str | FilePath, overrides: Sequence[str] = ()) -> ProblemFile:
    """A problem file, checked.

    Errors: `InvalidProblemError` with file, line and column.
    """
    path = FilePath(path)
    return _read(documents.read_file(path), str(path), path, overrides)


def read_text(text: str, file: str | None = None, overrides: Sequence[str] = ()) -> ProblemFile:
    """A problem file's text, checked; ``file`` is how messages call it."""
    return _read(text, file, FilePath(file) if file else None, overrides)


def build(file: ProblemFile) -> PlanningProblem:
    """The problem of a file, with its solvers."""
    try:
        if file.system.model not in SYSTEMS.lines:
            try_out(file.system, file.problem.start_point)
        return file.problem.with_(solvers=build_solvers(file.data)).read_from(file.text)
    except InvalidProblemError as error:
        raise file.located(error) from None


def load_problem(path: str | FilePath, overrides: Sequence[str] = ()) -> PlanningProblem:
    """The problem that a file describes.

    Errors: `InvalidProblemError` with file, line and column.
    """
    return build(read(path, overrides))


def parse_problem(text: str, file: str | None = None, overrides: Sequence[str] = ()) -> PlanningProblem:
    """The problem that a file's text describes, as `read_text`."""
    return build(read_text(text, file, overrides))


def _read(text: str, file: str | None, path: FilePath | None, overrides: Sequence[str]) -> ProblemFile:
    overridden: list[str] = []
    fitted: list[InvalidProblemError] = []
    if overrides:
        document, overridden, fitted = apply(text, overrides, file)
    else:
        document = documents.parse(text, file)
    if not isinstance(document.data, dict):
        words = f"expected a mapping that begins with `nhpocp: 1`, got {describe(document.data)}"
        raise InvalidProblemError(words, file=file, line=1, column=1)
    place = Place(file, document, overridden)
    if "study" in document.data:
        words = f"this is a study of many problems; run it with `nhpocp sweep {file or 'STUDY.yaml'}`"
        raise place.error([InvalidProblemError(words, path="study", at_key=True)])
    shown = document.text if overrides else text
    try:
        meshes = corners_of_meshes(document.data, path)
    except InvalidProblemError as error:
        raise place.error([error]) from None
    if meshes:
        document = apply(shown, meshes, file)[0]
        shown = document.text
    try:
        try:
            data, system = _validated(document.data)
        except InvalidProblemError as error:
            refuse([*(wrong := [error, *error.others]), *_beyond(document.data, wrong)])
            raise
        if data.name is None:
            data = data.model_copy(update={"name": _stem(path)})
            shown = _named(shown, _stem(path), "name" in document.data)
        problem = _assembled(data, system)
    except InvalidProblemError as error:
        raise place.error([error, *error.others]) from None
    doubted = [
        *fitted,
        *doubts(problem, data.solvers.jacobian.tolerance, document.data),
        *_without_effect(data),
    ]
    return ProblemFile(data, shown, path, problem, doubted, place)


def _named(text: str, name: str, null: bool) -> str:
    """A problem's text with its name, which is the file's stem: in a folder the file is called otherwise.

    null: whether the text has the key, and nothing behind it.
    """
    line = f"name: {json.dumps(name, ensure_ascii=False)}"
    first = None if null else re.search(r"^nhpocp: *1 *(#.*)?\r?\n", text, flags=re.MULTILINE)
    if first:  # as everybody writes it: the rest stays to the letter
        return f"{text[: first.end()]}{line}\n{text[first.end() :]}"
    return apply(text, [line.replace(": ", "=", 1)], None)[0].text


def _stem(path: FilePath | None) -> str:
    return "".join(c if c.isprintable() and c not in "\\/" else "_" for c in path.stem) if path else "problem"


def _validated(raw: dict[str, Any]) -> tuple[ProblemData, System]:
    """The shape of a file: every key, name and number. Errors: `InvalidProblemError` with all the `others`."""
    wrong: list[InvalidProblemError] = []
    system: Any = None
    block: Any = None
    if "system" in raw:
        try:
            system, block = read_system(raw["system"])
        except InvalidProblemError as error:
            wrong += [error, *error.others]
    try:
        # the system's own errors are already known
        data = ProblemData.model_validate({**raw, "system": {}} if "system" in raw else raw)
    except ValidationError as error:
        wrong += translate(error, ProblemData)
    for each in wrong:
        if each.word is not None:
            each.elsewhere = homes(each.word, each.path or "", raw, system)
    refuse(wrong)  # among them a system that is missing
    return data.model_copy(update={"system": block}), system


def _beyond(raw: dict[str, Any], wrong: Sequence[InvalidProblemError]) -> list[InvalidProblemError]:
    """What does not fit together in the blocks of a file whose keys, names and numbers are right.

    The others are left out, or nothing is said where there is no problem without them. Kinds of constraints and
    settings of solvers stand each by itself.
    """
    kept: dict[str, Any] = {"nhpocp": 1}
    blocks = {tuple(re.split(r"[.[]", error.path or "")[:2]) for error in wrong}
    bad = {first for first, *_ in blocks}
    misspelt = [error.word for error in wrong if error.word and error.word == error.path]
    obstacles_read = "obstacles" not in bad and not nearest("obstacles", misspelt)
    for name, block in raw.items():
        if name not in bad:
            kept[name] = block
        elif name in ("constraints", "solvers") and isinstance(block, dict):
            kept[name] = {key: value for key, value in block.items() if (name, key) not in blocks}
    if not {"system", "start", "goal"} <= set(kept):
        return []
    try:
        data, system = _validated(kept)
        _assembled(data, system, obstacles_read)
    except InvalidProblemError as error:
        return [error, *error.others]
    return []


def _assembled(data: ProblemData, system: System, obstacles_read: bool = True) -> PlanningProblem:
    """The problem without solvers; what foreign equations raise is their model's fault."""
    try:
        return assembled(data, system, obstacles_read)
    except InvalidProblemError as error:
        order = via_order(data)
        for each in (error, *error.others):
            each.path = _as_written(each.path or "", order)
        raise
    except Exception as error:
        if system.model in SYSTEMS.lines:
            raise
        raise _failing(system, error) from error


def _as_written(path: str, order: Sequence[int]) -> str:
    """A path of the problem, whose via poses stand in the order of time, as one of the file."""
    return re.sub(r"^via\[(\d+)\]", lambda place: f"via[{order[int(place[1])]}]", path)


def _failing(system: System, error: Exception) -> InvalidProblemError:
    fault = f"the equations of {system.model} fail at the start: {one_line(error)}"
    return InvalidProblemError(fault, path="system.model")


def _without_effect(data: ProblemData) -> Iterator[InvalidProblemError]:
    """Settings of a solver that it makes no use of as it is."""
    jacobian = data.solvers.jacobian
    if jacobian.step_rule == "auto" and jacobian.gamma != type(jacobian).model_fields["gamma"].default:
        words = f"{jacobian.gamma:g} does nothing, for step_rule is auto; with euler it is the γ of (17)"
        yield InvalidProblemError(words, path="solvers.jacobian.gamma", at_key=True)
