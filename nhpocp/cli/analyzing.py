"""The verb `analyze`, and what it says in a terminal."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from nhpocp.cli.exit_status import SOLVED
from nhpocp.cli.options import json_option, load, set_option
from nhpocp.cli.terminal import put, say, tell

if TYPE_CHECKING:
    from nhpocp.analysis import Analysis
    from nhpocp.analysis.slices import Span
    from nhpocp.state_space import StateSpace


@click.command(
    epilog="Exit status: 0 whatever is found; 2 bad input. --slice examples: z,yaw · x=-10:10,y=-10:10 · "
    "yaw=-120 deg:20 deg,z. Coordinates: x y z (or position[0] …), scalars by name, roll pitch yaw."
)
@click.argument("file", type=click.Path(path_type=Path))
@click.option(
    "--slice",
    "slice_text",
    metavar="A[=LO:HI],B[=LO:HI]",
    help="Two coordinates of the map of singularities; without it those that move most.",
)
@click.option(
    "--at",
    default="start",
    show_default=True,
    metavar="start|goal|TIME",
    help="Where the map's other coordinates are taken from; TIME: of the initial guess.",
)
@click.option(
    "--tolerance", type=float, help="Of ranks, relative to the largest singular value.  [default: 1e-8]"
)
@click.option("--degree", type=int, help="Of the longest Lie brackets.  [default: 6]")
@set_option
@click.option(
    "-o", "--output", type=click.Path(path_type=Path), help="The folder for analysis.json and pictures."
)
@json_option
def analyze(
    file: Path,
    slice_text: str | None,
    at: str,
    tolerance: float | None,
    degree: int | None,
    overrides: tuple[str, ...],
    output: Path | None,
    as_json: bool,
) -> int:
    """Growth vectors, ranks, agility and singularities of FILE.

    At start and goal and along the initial guess; solves nothing. Default folder: results/NAME/analysis.
    """
    from nhpocp.analysis import analyze as examine
    from nhpocp.analysis_folder import save_analysis
    from nhpocp.solution_folder import check_target, folder_name, plain

    problem = load(file, overrides)
    folder = output or Path("results") / folder_name(problem.name) / "analysis"
    spans = parse_slice(slice_text, problem.system.state_space) if slice_text is not None else []
    check_target(folder)
    given = {"tolerance": tolerance, "degree": degree}
    chosen: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    analysis = examine(problem, spans=spans, at=_time(at), **chosen)
    pictures = None
    if problem.pictures:
        from nhpocp.views.analysis_figures import write_pictures

        pictures = write_pictures
    missing = save_analysis(analysis, folder, pictures)
    for warning in missing:
        say(f"warning: {warning}")
    if as_json:
        data = plain(analysis.to_json())
        warnings = [*data.get("warnings", ()), *missing]
        put({**data, "warnings": warnings, "folder": str(folder)})
    else:
        for line in lines(analysis):
            tell(line)
        tell(f"  written: {folder}")
    return SOLVED


def _time(at: str) -> str | float:
    """A time where the text is a number, else the text."""
    try:
        return float(at)
    except ValueError:
        return at


def parse_slice(text: str, space: StateSpace) -> list[Span]:
    """Two spans from A[=LO:HI],B[=LO:HI]; numbers as in problem files."""
    from nhpocp.analysis.slices import Span, chosen

    parts = [part.partition("=") for part in text.split(",")]
    coordinates = chosen(space, [name.strip() for name, _, _ in parts])
    spans = []
    for coordinate, (_, equals, limits) in zip(coordinates, parts, strict=True):
        low, colon, high = limits.partition(":")
        if equals and not colon:
            raise click.BadParameter(f"{limits!r}; expected LO:HI", param_hint="--slice")
        spans.append(Span(coordinate, *((_number(low), _number(high)) if equals else (None, None))))
    return spans


def _number(text: str) -> float:
    from nhpocp.written_numbers import parse_number

    value: Any = text.strip()
    with suppress(ValueError):  # -pi/6, 75 deg
        value = float(value)
    try:
        return parse_number(value)
    except ValueError as error:
        raise click.BadParameter(str(error), param_hint="--slice") from error


def lines(analysis: Analysis) -> list[str]:
    """An analysis in a few lines."""
    from nhpocp.views.analysis_words import rows, size

    problem, said = analysis.problem, analysis.controllability
    return [
        f"{problem.name} ({size(problem.system)}): {said.kind}",
        f"  {said.sentence}",
        *(f"  {name.ljust(11)}{words}" for name, words in rows(analysis)),
        *(f"  note: {note}" for note in analysis.notes),
    ]
