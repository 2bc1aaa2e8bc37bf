"""A comparison as files: report.html, comparison.csv, .tex and .json, every solution in `<name>/<variant>`, and the
motions of one problem together in `<name>/animation.html`."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from nhpocp.comparison import VARIANTS, Comparison, Entry, Group, Run
from nhpocp.errors import InvalidProblemError, UnreadableSolutionError
from nhpocp.problem import PlanningProblem
from nhpocp.problem_file import variant
from nhpocp.solution import Solution
from nhpocp.solution_folder import audit, check_target, folder_name, is_solution_folder
from nhpocp.solution_folder.auditing import Audit
from nhpocp.solution_folder.pictures import attempted
from nhpocp.solution_folder.reading import json_content
from nhpocp.solution_folder.target import COMPARISON, require_own
from nhpocp.views.latex_table import latex_table
from nhpocp.whole import bench, write_file

ANIMATION = "animation.html"
# names of folders need not be text; JSON reads them again
TEXT = {"encoding": "utf-8", "errors": "backslashreplace"}
Report = Callable[[Comparison, Path, Mapping[str, str]], Any]
Animate = Callable[[Sequence[Entry], Path], Any]


def plan(
    problems: Sequence[PlanningProblem], variants: Sequence[str], home: Path, only: bool = False
) -> dict[str, Run]:
    """Every run by its folder under ``home``: both solvers on every problem unless ``only``, and the variants; a
    variant said twice counts once.

    Errors: `InvalidProblemError` for a variant that is none, two problems of one name, and folders that are not ours.
    """
    labels = list(dict.fromkeys([*([] if only else VARIANTS), *variants]))
    runs: dict[str, Run] = {}
    owners: dict[Path, str] = {}
    for problem in problems:
        place = home / folder_name(problem.name)
        if place in owners:
            raise InvalidProblemError(
                f"two problems would both be stored in {place}; give one of them another `name:`", path="name"
            )
        owners[place] = problem.name
        for label in labels:
            folder = place / folder_name(label)
            if str(folder) in runs:
                raise InvalidProblemError(
                    f"--variant {label}: {runs[str(folder)].variant} would be stored in the same folder, {folder}"
                )
            check_target(folder)
            runs[str(folder)] = Run(*variant(problem, label), label)
    return runs


def check_home(home: Path, names: Iterable[str]) -> None:
    """Makes the folder of the report on the problems of these names.

    Errors: `InvalidProblemError` where it cannot be written to, and for a file in the report's place, or an
    animation's, that nhpocp did not write.
    """
    try:
        with bench(home):
            pass
    except OSError as error:
        raise InvalidProblemError(f"cannot write here: {error.strerror}", file=str(home)) from error
    for file in (*COMPARISON, *(f"{folder_name(name)}/{ANIMATION}" for name in names)):
        require_own(home / file)


@dataclass(frozen=True)
class Written:
    """The files of a comparison, and what is missing of them, in words."""

    files: list[Path]
    missing: list[str]


def write_comparison(
    comparison: Comparison,
    home: Path,
    report: Report,
    animate: Animate | None = None,
    missing: Sequence[str] = (),
) -> Written:
    """The four files, each whole or not at all, and an animation a problem.

    ``report(comparison, file, animations)`` writes the page, which links the animations, relative addresses by the
    titles of their groups; ``animate(entries, file)`` writes one of them, or nothing where no run moved; ``missing``:
    what is missing of the runs already. The numbers come first: Ctrl-C ends the drawing.
    Errors: `InvalidProblemError` where they cannot be written; animations for which there is no room are missing.
    """
    check_home(home, [group.title for group in comparison.groups])
    lost = list(missing)

    def numbers(file: Path) -> None:
        data = {**comparison.to_json(), "warnings": [*comparison.notes, *lost]}
        file.write_text(json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False) + "\n", **TEXT)

    def page(file: Path) -> None:
        report(comparison, file, animations)

    _write_or_refuse(home / "comparison.json", numbers)
    _write_or_refuse(
        home / "comparison.csv", lambda file: file.write_text(comparison.to_csv(), newline="", **TEXT)
    )
    _write_or_refuse(
        home / "comparison.tex", lambda file: file.write_text(latex_table(comparison), encoding="ascii")
    )
    animations = _write_animations(comparison, home, animate, lost) if animate else {}
    files = [home / name for name in (*COMPARISON, *animations.values())]
    if why := attempted(lambda: _write_or_refuse(home / "report.html", page)):
        (home / "report.html").unlink(missing_ok=True)  # of an earlier comparison
        lost.append(f"the report could not be written ({why}); `nhpocp compare --from {home}` writes it")
        files.remove(home / "report.html")
    if lost:
        _write_or_refuse(home / "comparison.json", numbers)
    return Written(files, lost)


def _write_animations(
    comparison: Comparison, home: Path, animate: Animate, lost: list[str]
) -> dict[str, str]:
    """An animation for every problem that asks for pictures and has a motion; their places under ``home`` by title."""
    animations = {}

    def write(group: Group, place: str) -> None:
        if write_file(home / place, partial(animate, group.entries)):
            animations[group.title] = place

    for group in comparison.groups:
        place = f"{folder_name(group.title)}/{ANIMATION}"
        if group.problem.pictures and (why := attempted(partial(write, group, place))):
            lost.append(f"{home / place} could not be written ({why}); `nhpocp animate` writes it")
    return animations


def _write_or_refuse(file: Path, write: Callable[[Path], Any]) -> None:
    try:
        write_file(file, write)
    except OSError as error:
        raise InvalidProblemError(f"cannot write here: {error.strerror}", file=str(file)) from error


def load_comparison(places: Iterable[Path]) -> Comparison:
    """The comparison of stored solutions: solution folders, or folders that hold some, such as one that
    `write_comparison` wrote. Each is verified again, and what it states that is not so becomes a note.

    Errors: `UnreadableSolutionError` for a place without solutions, or a damaged one.
    """
    folders = list(dict.fromkeys(folder for place in places for folder in solution_folders(place)))
    audits = [audit(folder) for folder in folders]
    notes = [
        f"{folder} states what is not so: {difference}"
        for folder, audited in zip(folders, audits, strict=True)
        for difference in audited.differences
    ]
    solutions = [_placed(audited, folder) for audited, folder in zip(audits, folders, strict=True)]
    return Comparison.of(solutions, [str(folder) for folder in folders], notes)


def solution_folders(place: Path) -> list[Path]:
    """The place itself or the solution folders under it, in the order of the comparison.json that lists them."""
    if is_solution_folder(place):
        return [place]
    folders = sorted(
        file.parent
        for file in place.rglob("solution.json")
        if not any(part.startswith(".") for part in file.relative_to(place).parts)
        and is_solution_folder(file.parent)
    )
    if not folders:
        raise UnreadableSolutionError(f"{place}: no solution folder, and none under it")
    order: dict[tuple[str, ...], int] = {}
    table = place / "comparison.json"
    text = json_content(table) if table.is_file() else b""
    with suppress(ValueError, KeyError, TypeError, RecursionError):
        listed = json.loads(text)["runs"]
        order = {Path(run["folder"]).parts[-2:]: k for k, run in enumerate(listed) if run["folder"]}
    return sorted(folders, key=lambda folder: order.get(folder.parts[-2:], len(order)))


def _placed(audited: Audit, folder: Path) -> Solution:
    """What an audit found; a solution that `compare` did not make is told on which machine it was made."""
    solution = audited.solution
    # a place-holder of a run that could not begin is none that reaches anything
    if audited.stated.verdict is None:
        solution = replace(solution, verdict=None)
    note = solution.details.get("comparison")
    if note is None:
        stored = json.loads(json_content(folder / "solution.json"))
        environment = {
            key: value for key, value in stored.get("environment", {}).items() if value is not None
        }
        solution = replace(solution, details={**solution.details, "comparison": {"environment": environment}})
    return solution
