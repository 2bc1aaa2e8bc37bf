"""An analysis in words: what was looked at, and what was seen there."""

from __future__ import annotations

import math
from collections.abc import Sequence

from nhpocp.analysis.analysis import Analysis, PathAnalysis, PointAnalysis
from nhpocp.analysis.slices import SingularityMap
from nhpocp.systems.margins import det, margin
from nhpocp.systems.system import System

Row = tuple[str, str]  # what it is about, "" where it goes on; and a sentence


def size(system: System) -> str:
    """How many numbers a system moves, and by how many."""
    return f"{system.model}, {system.state_space.dimension} dimensions, {system.input_space.size} inputs"


def rows(analysis: Analysis) -> list[Row]:
    """What was looked at, and what was seen, in the order of importance."""
    told = [("" if i else "mobility", words) for i, words in enumerate(_mobility_words(analysis))]
    told += [(name, _point_words(point)) for name, point in analysis.points.items()]
    if analysis.path:
        told += path_rows(analysis.path)
    if end := analysis.end_point:
        height, width = end.jacobian.shape
        words = f"Jacobian {height} × {width}, rank {end.spectrum.rank}, singular values {_span(end.spectrum.values)}"
        told.append(("end point", f"{words}, condition {end.condition:.3g}"))
        axes, slowest = end.agility, end.agility.words(len(end.agility.labels) - 1)
        words = f"semi-axes {_span(axes.semi_axes)}, slowest along {slowest}"
        told.append(("agility", f"{words}; dexterity √det D = {axes.volume:.3g}"))
    if analysis.map:
        told.append(("map", _map_words(analysis.map)))
    return told


def _mobility_words(analysis: Analysis) -> list[str]:
    """What the legs leave, and how much of it manoeuvres reach."""
    if not analysis.mobility:
        return []
    reached = analysis.filtration.generic.rank
    return [
        *analysis.mobility.describe(),
        f"manoeuvres reach {reached} dimensions of the {analysis.mobility.reachable}",
    ]


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


def path_rows(path: PathAnalysis) -> list[Row]:
    """What happens along the initial guess."""
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
    told = [("guess", words)]
    least = []
    for name, values in path.margins.items():
        known = margin(name)
        if known and known.kind == "sigma" and not all(math.isnan(value) for value in values):
            place = min(range(len(values)), key=lambda i: math.inf if math.isnan(values[i]) else values[i])
            least.append(f"least σ_min({known.letter}) {values[place]:.3g} at t = {path.times[place]:.4g}")
    if least:
        told.append(("", "; ".join(least)))
    if path.crossings:
        met = [f"det {c.letter} at t = {c.time:.4g}" for c in path.crossings]
        told.append(("", f"changes of sign: {_few(met, 8)}"))
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
