"""The verbs `check` and `verify`, which solve nothing and say whether a file or a folder is right."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from nhpocp.cli.exit_status import BAD_INPUT, NOT_SOLVED, SOLVED
from nhpocp.cli.options import json_option, set_option
from nhpocp.cli.terminal import error_data, put, say, tell, verdict_lines
from nhpocp.errors import InvalidProblemError

MOST = 100  # mistakes of one file that are printed


@click.command()
@click.argument("files", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="FILE...")
@set_option
@json_option
def check(files: tuple[Path, ...], overrides: tuple[str, ...], as_json: bool) -> int:
    """Validate problem files and studies; solve nothing.

    Prints every mistake of a file with its line and column, not only the first.
    """
    from nhpocp.problem_file import read
    from nhpocp.study.study import is_study

    checked, failures = [], []
    for file in files:
        try:
            if is_study(file):
                study = _study(file, overrides)
                checked.append({"file": str(file), "ok": True, "warnings": [], "study": study})
                if not as_json:
                    trials = f"{study['trials']} trials, " if "trials" in study else ""
                    tell(f"{file}: ok, {trials}{study['runs']} runs")
                continue
            document = read(file, overrides)
        except InvalidProblemError as error:
            failures.append(error)
            each = [error_data(one)["error"] for one in error.each[:MOST]]
            checked.append({"file": str(file), "ok": False, **error_data(error), "errors": each})
            continue
        checked.append(
            {"file": str(file), "ok": True, "warnings": document.warnings, "problem": document.filled()}
        )
        for line in document.warning_lines():
            say(line)
        if not as_json:
            tell(f"{file}: ok")
    for failure in failures:
        for mistake in failure.each[:MOST]:
            say(str(mistake))
        if len(failure.each) > MOST:
            say(f"{failure.file}: and {len(failure.each) - MOST} more")
    if as_json:
        if failures:
            put({**error_data(failures[0]), "files": checked})
        else:
            put(checked[0] if len(checked) == 1 else {"files": checked})
    return BAD_INPUT if failures else SOLVED


def _study(file: Path, overrides: tuple[str, ...]) -> dict[str, Any]:
    """What a study asks for."""
    from nhpocp.study.study import read_study

    if overrides:
        raise InvalidProblemError("--set changes a problem file; change a study's own text", file=str(file))
    study = read_study(file)
    levels = {
        path: len(factor.levels)
        for factor in study.design.factors
        if factor is not study.design.trials
        for path in factor.paths
    }
    trials = {"trials": study.optimise.trials} if study.optimise else {}
    return {
        "name": study.name,
        "problem": study.problem_file,
        "axes": levels,
        "points": len(study.design),
        "solvers": list(study.solvers),
        "order": study.order,
        "runs": len(study),
        **trials,
    }


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
@json_option
def verify(folder: Path, as_json: bool) -> int:
    """Check the solution in FOLDER, independently of solvers.

    Its control is integrated again by other code, from the files of FOLDER alone, and what they state is compared with
    what that gives.
    """
    from nhpocp.solution_folder import audit

    audited = audit(folder)
    verdict = audited.verdict
    if as_json:
        from nhpocp.solution_folder import plain
        from nhpocp.solution_folder.stored import StoredVerdict

        put(
            {
                "folder": str(folder),
                "outcome": audited.stated.outcome.value,
                "verified": plain(StoredVerdict.written(verdict)),
                "differences": audited.differences,
                "unchecked": audited.unchecked,
            }
        )
    else:
        differs = " what is stated here differs" if audited.differences else ""
        tell(f"{folder}: {'verified' if verdict.ok else 'refuted'}{';' + differs if differs else ''}")
        for line in verdict_lines(verdict):
            tell(line)
        for difference in audited.differences:
            tell(f"  differs: {difference}")
        for sentence in audited.unchecked:
            tell(f"  not checked: {sentence}")
    return SOLVED if audited.ok else NOT_SOLVED
