"""The verb `analyze`, and what it says in a terminal."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from nhpocp.cli.exit_status import SOLVED
from nhpocp.cli.options import json_option, load, set_option
from nhpocp.cli.terminal import put, say, tell
from nhpocp.systems.margins import det, margin

if TYPE_CHECKING:
    from nhpocp.analysis import Analysis
    from nhpocp.analysis.analysis import PathAnalysis, PointAnalysis
    from nhpocp.analysis.slices import SingularityMap, Span
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
    from nhpocp.problem_file.numbers import parse_number

    value: Any = text.strip()
    with suppress(ValueError):  # -pi/6, 75 deg
        value = float(value)
    try:
        return parse_number(value)
    except ValueError as error:
        raise click.BadParameter(str(error), param_hint="--slice") from error


def lines(analysis: Analysis) -> list[str]:
    """An analysis in a few lines."""
    system = analysis.problem.system
    space, inputs = system.state_space, system.input_space.size
    told = [
        f"{analysis.problem.name} ({system.model}, {space.dimension} dimensions, {inputs} inputs): "
        f"{analysis.controllability.kind}",
        f"  {analysis.controllability.sentence}",
    ]
    told += [_row("" if i else "mobility", words) for i, words in enumerate(_mobility_words(analysis))]
    told += [_row(name, _point_words(point)) for name, point in analysis.points.items()]
    if analysis.path:
        told += _path_lines(analysis.path)
    if analysis.end_point:
        rows, columns = analysis.end_point.jacobian.shape
        spectrum, agility = analysis.end_point.spectrum, analysis.end_point.agility
        told.append(
            _row(
                "end point",
                f"Jacobian {rows} × {columns}, rank {spectrum.rank}, singular values {_span(spectrum.values)}, "
                f"condition {analysis.end_point.condition:.3g}",
            )
        )
        told.append(
            _row(
                "agility",
                f"semi-axes {_span(agility.semi_axes)}, slowest along {agility.words(len(agility.labels) - 1)}; "
                f"dexterity √det D = {agility.volume:.3g}",
            )
        )
    if analysis.map:
        told.append(_row("map", _map_words(analysis.map)))
    return told + [f"  note: {note}" for note in analysis.notes]


def _mobility_words(analysis: Analysis) -> list[str]:
    """What the legs leave, and how much of it manoeuvres reach."""
    if not analysis.mobility:
        return []
    reached = analysis.filtration.generic.rank
    return [
        *analysis.mobility.describe(),
        f"manoeuvres reach {reached} dimensions of the {analysis.mobility.reachable}",
    ]


def _row(name: str, words: str) -> str:
    return f"  {name.ljust(11)}{words}"


def _span(values: Sequence[float]) -> str:
    return f"{values[0]:.3g} … {values[-1]:.3g}"


def _point_words(point: PointAnalysis) -> str:
    growth = point.growth
    words = [f"growth vector {_vector(growth.vector)}" if growth.spectra else "the fields are not finite"]
    if growth.degree:
        words.append(f"degree of non-holonomy {growth.degree}")
    if growth.spectra:
        words.append(f"least σ/σ₁ {growth.weakest:.3g}")
        if growth.spectra[-1].doubtful:
            words.append("a doubtful rank: see the singular values in analysis.json")
    for name, value in point.margins.items():
        known = margin(name)
        if known and known.kind == "sigma":
            signed = point.margins[det(known.matrix).name]
            sign = "> 0" if signed > 0 else "< 0" if signed < 0 else "= 0" if signed == 0 else "unknown"
            words.append(f"σ_min({known.letter}) {value:.3g}, det {sign}")
    return "; ".join(words) + (f" ({point.note})" if point.note else "")


def _vector(vector: Sequence[int]) -> str:
    return f"({', '.join(map(str, vector))})"


def _path_lines(path: PathAnalysis) -> list[str]:
    weakest = path.weakest
    words = f"growth vector {_vector(path.generic.vector)}"
    times: dict[str, list[str]] = {}
    for i in path.irregular:
        times.setdefault(
            _vector(path.growth[i].vector) if path.growth[i].spectra else "not finite", []
        ).append(f"{path.times[i]:.4g}")
    others = []
    for vector, met in times.items():
        others.append(f"{vector} at t = {_few(met, 4)}")
    words += f", but {'; '.join(others)}" if others else ""
    if not times:
        words += (
            f" throughout; least σ/σ₁ {path.bracket_margin[weakest]:.3g} at t = {path.times[weakest]:.4g}"
        )
    told = [_row("guess", words)]
    least = []
    for name, values in path.margins.items():
        known = margin(name)
        if known and known.kind == "sigma" and not all(math.isnan(value) for value in values):
            place = min(range(len(values)), key=lambda i: math.inf if math.isnan(values[i]) else values[i])
            least.append(f"least σ_min({known.letter}) {values[place]:.3g} at t = {path.times[place]:.4g}")
    if least:
        told.append(_row("", "; ".join(least)))
    if path.crossings:
        met = [f"det {c.letter} at t = {c.time:.4g}" for c in path.crossings]
        told.append(_row("", f"changes of sign: {_few(met, 8)}"))
    return told


def _few(words: Sequence[str], most: int) -> str:
    more = f" and {len(words) - most} more" if len(words) > most else ""
    return f"{', '.join(words[:most])}{more}"


def _map_words(surfaces: SingularityMap) -> str:
    def limits(name: str, ends: Sequence[float]) -> str:
        angle = {c.name: c.unit == "angle" for c in (surfaces.first, surfaces.second)}[name]
        low, high = (math.degrees(end) if angle else end for end in ends)
        return f"{name} {low:.4g} … {high:.4g}{'°' if angle else ''}"

    data = surfaces.to_json()
    words = [limits(name, ends) for name, ends in data["coordinates"].items()]
    told = []
    for name, surface in data["matrices"].items():
        verb = (
            "changes its sign"
            if surface["changes_sign"]
            else "touches zero"
            if surface["touches_zero"]
            else f"keeps its sign (least σ_min {surface['least_sigma']:.3g})"
            if surface["least_sigma"] is not None
            else "is not finite"
        )
        told.append(f"det {name.upper()} {verb}")
    return f"{', '.join(words)}, through {surfaces.at}: {'; '.join(told)}"
