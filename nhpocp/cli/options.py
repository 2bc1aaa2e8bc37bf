"""Options and first steps that several verbs share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from nhpocp.cli.terminal import say

if TYPE_CHECKING:
    from nhpocp.problem import PlanningProblem
    from nhpocp.problem_file import ProblemFile


def json_option(command: Callable[..., Any]) -> Callable[..., Any]:
    return click.option("--json", "as_json", is_flag=True, help="One JSON document on standard output.")(
        command
    )


def set_option(command: Callable[..., Any]) -> Callable[..., Any]:
    return click.option(
        "--set",
        "overrides",
        multiple=True,
        metavar="KEY=VALUE",
        help="Override a key of the file; repeatable.",
    )(command)


def load(file: Path, overrides: Sequence[str]) -> PlanningProblem:
    """The problem of a file; what is doubtful about it is said."""
    from nhpocp.problem_file import build

    return build(opened(file, overrides))


def opened(file: Path, overrides: Sequence[str]) -> ProblemFile:
    """A problem's file, which knows where it says what; what is doubtful about it is said."""
    from nhpocp.problem_file import read

    document = read(file, overrides)
    for line in document.warning_lines():
        say(line)
    return document
