"""A study: a problem, a design of points around it, and the solvers to run at each; read from its file."""

from __future__ import annotations

import copy
import hashlib
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from nhpocp.errors import InvalidProblemError, describe, refuse, suggestion
from nhpocp.problem_file import document as documents
from nhpocp.problem_file import dumping, variants
from nhpocp.problem_file.messages import translate
from nhpocp.problem_file.overrides import within
from nhpocp.problem_file.reading import Place, ProblemFile, read_text
from nhpocp.study.design import END, Design, design_of
from nhpocp.study.optimisation import Level, Optimisation, Quantity, optimisation_of, quantities
from nhpocp.study.schema import StudyData, StudyFileData

MOST_RUNS = 10_000_000
INSIDE = -1  # of a range: at no end, and no whole number
AXES, OVER = "study.axes.", "study.optimise.over."
_PATH = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*|\[\d+\])*")
_GIVEN_BY = re.compile(r" \(given by --set ([^)]*)\)")


@dataclass(frozen=True)
class Study:
    """Runs numbered from 1: at every point of ``design`` each of the ``solvers``, which change fastest.

    text, problem_text: the study file and the problem file that it names, from which all of it can be read again.
    solvers: as `nhpocp compare --variant` takes them. order: "given", or "nearest", where goals begin with the plan to
    their neighbour. optimise: what the trials of the design are for, if it has such.
    """

    name: str
    text: str
    problem_text: str
    problem_file: str | None
    design: Design
    solvers: tuple[str, ...]
    order: str
    optimise: Optimisation | None = None

    def __len__(self) -> int:
        return len(self.design) * len(self.solvers)

    def parameters(self, run: int) -> dict[str, Any]:
        """The values of a run by the paths of the axes."""
        return self.design.point((run - 1) // len(self.solvers))

    def solver(self, run: int) -> str:
        """The variant that a run is solved by."""
        return self.solvers[(run - 1) % len(self.solvers)]

    def proposed(self, levels: Sequence[Level]) -> Study:
        """With the trials that are known by now."""
        return replace(self, design=self.design.proposed(levels))

    def runs_of_trial(self, trial: int) -> range:
        """The numbers of a trial's runs."""
        each = len(self) // self.design.factors[0].size
        return range((trial - 1) * each + 1, trial * each + 1)

    @cached_property
    def goal_axes(self) -> frozenset[str]:
        """The axes along which nothing but the goal changes: the innermost of the design."""
        return frozenset(path for factor in self.design.factors if factor.of_goal for path in factor.paths)

    @property
    def first(self) -> dict[str, Any]:
        """The values of the first run; where trials are still to be proposed, the first values that a file gives."""
        if not self.optimise:
            return self.parameters(1)
        level = tuple(variable.values[0] for variable in self.optimise.variables)
        return self.proposed([level]).parameters(1)

    @cached_property
    def quantities(self) -> dict[str, Quantity]:
        """By name what its trials may be compared by."""
        return quantities(read_problem(self.problem_text, None, self.first, self.solvers[0]).problem)

    @cached_property
    def measured(self) -> list[Quantity]:
        """What its objectives are read from, in their order."""
        objectives = self.optimise.objectives if self.optimise else ()
        return [self.quantities[objective.name] for objective in objectives]

    @property
    def digest(self) -> str:
        """What decides on the runs and their numbers: equal for studies whose runs are the same."""
        factors = [[factor.paths, factor.levels] for factor in self.design.factors]
        runs: list[Any] = [self.problem_text, factors, self.solvers, self.order]
        if self.optimise:  # its trials are known by their numbers
            runs[1] = [factors[1:], self.optimise.identity]
        return hashlib.sha256(json.dumps(runs, sort_keys=True, default=str).encode()).hexdigest()


def overrides(parameters: Mapping[str, Any], solver: str) -> list[str]:
    """What a run sets in the study's problem, as `--set` takes it."""
    return [f"{path}={_written(value)}" for path, value in parameters.items()] + variants.overrides(solver)[1]


def _written(value: Any) -> str:
    return json.dumps(value, default=str)  # JSON is YAML


def read_problem(text: str, file: str | None, parameters: Mapping[str, Any], solver: str) -> ProblemFile:
    """The problem of a run, from that of its study.

    Errors: `InvalidProblemError` by the path in the problem.
    """
    try:
        return read_text(text, file, overrides(parameters, solver))
    except InvalidProblemError as error:
        raise InvalidProblemError(_GIVEN_BY.sub("", error.message), path=error.path) from None


def changed_goal(goal: Mapping[str, Any], parameters: Mapping[str, Any]) -> dict[str, Any]:
    """A goal as a file writes it, with those of the parameters that are of the goal."""
    changed = {"goal": copy.deepcopy(dict(goal))}
    for path, value in parameters.items():
        if path.startswith(END):
            *way, last = (int(k) if k.isdigit() else k for k in re.findall(r"\w+", path))
            here: Any = changed
            for step in way:
                here = here[step] if isinstance(here, list) else here.setdefault(step, {})
            here[last] = value
    return changed["goal"]


def is_study(path: Path) -> bool:
    """Whether a file says of itself that it is a study, right or wrong."""
    try:
        data = documents.parse(documents.read_file(path), str(path)).data
    except InvalidProblemError:
        return False
    return isinstance(data, dict) and "study" in data


def read_study(path: Path) -> Study:
    """A study file, checked.

    Errors: `InvalidProblemError` with file, line and column, in the study file or in the problem file that it names.
    """
    return read_study_text(documents.read_file(path), str(path))


def read_study_text(text: str, file: str | None = None, problem_text: str | None = None) -> Study:
    """A study file's text; ``problem_text``: of the problem file that it names, if that is no longer to be read."""
    document = documents.parse(text, file)
    place = Place(file, document)
    if not isinstance(document.data, dict):
        words = f"expected a mapping that begins with `nhpocp: 1`, got {describe(document.data)}"
        raise InvalidProblemError(words, file=file, line=1, column=1)
    try:
        data = StudyFileData.model_validate(document.data).study
    except ValidationError as error:
        raise place.error(translate(error, StudyFileData)) from None
    try:
        named, text_of = _problem(data.problem, file, problem_text)
        _check_paths(data)
        solvers = tuple(dict.fromkeys(data.solvers))
        _check_solvers(solvers)
        design = design_of(data)
        stem = Path(file).stem if file else "study"
        optimise = optimisation_of(data.optimise) if data.optimise else None
        study = Study(data.name or stem, text, text_of, named, design, solvers, data.order, optimise)
        if len(study) > MOST_RUNS:
            many = "study.optimise.trials" if optimise else "study.axes"
            raise InvalidProblemError(f"{len(study)} runs; expected {MOST_RUNS} at most", path=many)
    except InvalidProblemError as error:
        raise error if error.file else place.error([error, *error.others]) from None
    if problem_text is None:
        _check_values(study, data, place)
    return study


def _problem(given: Any, file: str | None, text: str | None) -> tuple[str | None, str]:
    """The name and the text of the problem; ``text``: what is known of it already, and then not read.

    Errors: `InvalidProblemError`, in the problem file where there is one.
    """
    if isinstance(given, dict):
        return None, dumping.write_data({"nhpocp": 1, **given}) if text is None else text
    path = Path(file or "").parent / given
    if text is not None:
        return str(path), text
    try:
        return str(path), documents.read_file(path)
    except InvalidProblemError as error:
        raise InvalidProblemError(f"{error.file}: {error.message}", path="study.problem") from None


def _check_paths(data: StudyData) -> None:
    over = data.optimise.over if data.optimise else {}
    places = [(path, AXES) for path in data.axes] + [(path, OVER) for path in over]
    wrong = [
        InvalidProblemError(
            "no path of a key; expected names, dots and places in lists, such as goal.position[0]",
            path=f"{block}{path}",
            at_key=True,
        )
        for path, block in places
        if not _PATH.fullmatch(path)
    ]
    for path in over:
        if path in data.axes:
            words = "this is an axis, too; expected one of the two: all its levels, or the best value"
            wrong.append(InvalidProblemError(words, path=f"{OVER}{path}", at_key=True))
    for path, block in places:
        for other, _ in places:
            if path != other and within(other, path):
                words = f"{other} is a part of it; expected axes that do not contain one another"
                wrong.append(InvalidProblemError(words, path=f"{block}{path}", at_key=True))
    refuse(wrong)


def _check_solvers(solvers: Sequence[str]) -> None:
    wrong = []
    for place, label in enumerate(solvers):
        try:
            variants.overrides(label)
        except InvalidProblemError as error:
            words = error.message.removeprefix(f"--variant {label}: ")
            wrong.append(InvalidProblemError(words, path=f"study.solvers[{place}]"))
    refuse(wrong)


def _check_values(study: Study, data: Any, place: Place) -> None:
    """The problem at the first design point by every solver, and there with the other levels of each axis.

    Of levels that a rule makes, the ends. What only fails in combination ends as a row that says so.
    """
    try:
        read_text(study.problem_text, study.problem_file)
    except InvalidProblemError as error:
        if study.problem_file:
            raise
        inner = [
            each.changed(file=None, line=None, column=None).under("study.problem") for each in error.each
        ]
        raise place.error(inner) from None
    keys = {path: (f"{AXES}{path}", axis) for path, axis in data.axes.items()}
    if data.optimise:
        keys |= {path: (f"{OVER}{path}", values) for path, values in data.optimise.over.items()}
    first, wrong = study.first, list[InvalidProblemError]()
    for number, label in enumerate(study.solvers):
        wrong += _mistakes(study, first, label, f"study.solvers[{number}]", keys)
    if not wrong:
        for path, (block, axis) in keys.items():
            for level, value in _tried(study, path, axis):
                if value != first[path]:
                    where = _place_of(block, axis, level)
                    inside = "; two numbers are a range, three or more are choices" if level == INSIDE else ""
                    mistakes = _mistakes(study, {**first, path: value}, study.solvers[0], where)
                    wrong += [each.changed(note=inside) for each in mistakes]
    if not wrong and study.optimise:
        wrong += _unknown_objectives(study, study.optimise)
    if wrong:
        raise place.error(wrong)


def _tried(study: Study, path: str, axis: Any) -> Iterator[tuple[int | None, Any]]:
    """Values to try, and their places in the list that the file has; `INSIDE` of a range."""
    if isinstance(axis, list):
        yield from enumerate(axis)
        variables = study.optimise.variables if study.optimise else ()
        for variable in variables:
            if variable.path == path and variable.is_range:
                least, most = variable.values
                yield INSIDE, least + (most - least) / 2**0.5
    else:
        factor = next(factor for factor in study.design.factors if path in factor.paths)
        values = [level[factor.paths.index(path)] for level in factor.levels]
        yield from ((None, min(values)), (None, max(values)))


def _unknown_objectives(study: Study, optimise: Optimisation) -> Iterator[InvalidProblemError]:
    known = study.quantities
    for number, objective in enumerate(optimise.objectives):
        if objective.name in {other.name for other in optimise.objectives[:number]}:
            words = f"{objective.name} is an objective already; expected each once"
            yield InvalidProblemError(words, path=f"study.optimise.objectives[{number}]")
        if objective.name not in known:
            words = f"unknown objective {objective.name!r}; {suggestion(objective.name, known)}"
            yield InvalidProblemError(words, path=f"study.optimise.objectives[{number}]")


def _place_of(block: str, axis: Any, level: int | None) -> str:
    return block if level in (None, INSIDE) or not isinstance(axis, list) else f"{block}[{level}]"


def _mistakes(
    study: Study,
    parameters: Mapping[str, Any],
    solver: str,
    where: str,
    keys: Mapping[str, tuple[str, Any]] | None = None,
) -> list[InvalidProblemError]:
    """What is wrong with a problem of the study: at ``where``, or at one of the ``keys`` whose first level it is."""
    try:
        read_text(study.problem_text, study.problem_file, overrides(parameters, solver))
    except InvalidProblemError as error:
        given = _GIVEN_BY.search(error.message)
        by = given[1] if given else error.path or ""
        if keys and by in keys:
            where = _place_of(*keys[by], 0)
        words = _GIVEN_BY.sub("", error.changed(counted=False).message).removeprefix(f"--set {by}: ")
        axis = re.sub(r"\[\d+\]$", "", where)
        if not error.path or error.path in (_key(where), _key(axis)):
            misnamed = "no keys to set" in words or error.at_key
            return [InvalidProblemError(words, path=axis if misnamed else where, at_key=misnamed)]
        return [InvalidProblemError(f"{error.path}: {words}", path=where)]
    return []


def _key(place: str) -> str:
    """The key of the problem that stands at a place of the study file."""
    return place.removeprefix(AXES).removeprefix(OVER)
