"""What can be said of a planning problem before it is solved: brackets, ranks, singularities."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from nhpocp.analysis.agility import Ellipsoid, EndPointAnalysis, end_point_analysis, velocities
from nhpocp.analysis.growth import Fields, Filtration, Growth, Scales, filtration, rank_losses
from nhpocp.analysis.slices import SingularityMap, Span, livelier, singularity_map
from nhpocp.analysis.verdict import Controllability, Reserve, verdict
from nhpocp.arrays import Array
from nhpocp.controls.control import Control
from nhpocp.errors import InvalidProblemError
from nhpocp.plain_text import brief
from nhpocp.problem import PlanningProblem
from nhpocp.shown import Shown
from nhpocp.solution import Crossing
from nhpocp.solvers.nlp.guesses import NoGuessError, ProblemGuess
from nhpocp.systems.mobility import Mobility, mobility
from nhpocp.systems.numeric import numeric_system
from nhpocp.systems.parallel_robot import ParallelRobot
from nhpocp.verification.crossings import describe_state, find_crossings
from nhpocp.verification.replay import Path, replay

SCHEMA_VERSION = 1
# relative, of every rank; the values themselves are exact to about 1e-13, the Jacobian to 1e-8
TOLERANCE = 1e-8
DEGREE = 6  # of the longest brackets, where it takes so many
SAMPLES = 51  # of the path of the initial guess
SHORTEST = 1e-6  # fraction of the horizon: what ends before has no path
FINE = 1001  # samples between which determinants are asked for their sign


@dataclass(frozen=True)
class PointAnalysis:
    """One state: growth, the ellipsoid of velocities, σ_min and det of the regularity matrices."""

    state: Array
    growth: Growth
    velocities: Ellipsoid | None
    margins: Mapping[str, float]  # sigma_*, det_*
    note: str = ""

    def __repr__(self) -> str:
        return f"<PointAnalysis: growth vector {self.growth.vector}, margins {brief(self.margins)}>"

    def to_json(self, problem: PlanningProblem) -> dict[str, Any]:
        return {
            "state": describe_state(problem.system.state_space, self.state),
            "note": self.note or None,
            **self.growth.to_json(),
            "velocities": self.velocities.to_json() if self.velocities else None,
            "margins": dict(self.margins),
        }


@dataclass(frozen=True)
class PathAnalysis:
    """Growth along the path of the initial guess, up to where it goes: samples, and the times of rank losses."""

    times: Array
    states: Array
    growth: tuple[Growth, ...]
    generic: Growth  # at almost every state near by
    bracket_margin: Array  # σ_rank/σ_1 of the brackets up to the generic degree, (k,)
    margins: Mapping[str, Array]  # sigma_*, det_*, (k,)
    crossings: tuple[Crossing, ...]
    crossing_states: Array  # (crossings, size)

    def __repr__(self) -> str:
        crossed = f", {len(self.crossings)} crossings" if self.crossings else ""
        return f"<PathAnalysis to t = {self.times[-1]:.4g}: growth vector {self.generic.vector}{crossed}>"

    @property
    def irregular(self) -> list[int]:
        """The samples whose growth vector is not the generic one."""
        return [i for i, growth in enumerate(self.growth) if growth.vector != self.generic.vector]

    @property
    def weakest(self) -> int:
        """The sample that is nearest to losing rank."""
        return int(np.argmin(np.nan_to_num(self.bracket_margin, nan=0.0)))

    def to_json(self) -> dict[str, Any]:
        return {
            "t": self.times.tolist(),
            "reached_t": float(self.times[-1]),
            "growth_vectors": [list(growth.vector) for growth in self.growth],
            "bracket_margin": self.bracket_margin.tolist(),
            "least_rank": min(growth.rank for growth in self.growth),
            "irregular": [
                {"t": float(self.times[i]), "growth_vector": list(self.growth[i].vector)}
                for i in self.irregular
            ],
            "weakest": {
                "t": float(self.times[self.weakest]),
                "bracket_margin": float(self.bracket_margin[self.weakest]),
            },
            "margins": {name: values.tolist() for name, values in self.margins.items()},
            "crossings": [crossing.to_json() for crossing in self.crossings],
        }


@dataclass(frozen=True)
class Analysis(Shown):
    """Everything that `analyze` found out, as its `to_json()` says in plain data.

    problem, tolerance: what was asked. filtration: growth vectors at the start, at a goal that is a state, then along
    the path. controllability: what follows of them. points: ranks and singular values by name, "start" and "goal".
    path, end_point: the margins and the end point's Jacobian along the initial guess; None without a usable one. map:
    of singularities over two coordinates. mobility: of a parallel robot at the start. notes: sentences on all of it.
    """

    problem: PlanningProblem
    tolerance: float
    filtration: Filtration  # at the start, at the goal if there is one, then along the path
    controllability: Controllability
    points: Mapping[str, PointAnalysis]  # "start" and, if its goal is a state, "goal"
    path: PathAnalysis | None = None
    end_point: EndPointAnalysis | None = None
    map: SingularityMap | None = None
    mobility: Mobility | None = None  # of a parallel robot at the start
    notes: Sequence[str] = field(default=())

    def __repr__(self) -> str:
        system, growth = self.problem.system, self.filtration.generic.vector
        return f"<Analysis of {brief(self.problem.name)}: {system.model}, {self.controllability.kind}, growth {growth}>"

    def to_json(self) -> dict[str, Any]:
        """Plain data; numbers may be infinite or NaN."""
        system = self.problem.system
        return {
            "schema_version": SCHEMA_VERSION,
            "name": self.problem.name,
            "system": {"model": system.model, **system.parameters()},
            "driftless": system.driftless,
            "tolerance": self.tolerance,
            "length_scale": self.problem.scale,
            "bracket_degree": self.filtration.limit,
            "generic": self.filtration.generic.to_json(),
            "controllability": self.controllability.to_json(),
            "points": {name: point.to_json(self.problem) for name, point in self.points.items()},
            "path": self.path.to_json() if self.path else None,
            "end_point": self.end_point.to_json() if self.end_point else None,
            "map": self.map.to_json() if self.map else None,
            "mobility": asdict(self.mobility) if self.mobility else None,
            "notes": list(self.notes),
        }


def analyze(
    problem: PlanningProblem,
    *,
    tolerance: float = TOLERANCE,
    degree: int = DEGREE,
    spans: Sequence[Span] = (),
    at: str | float = "start",
) -> Analysis:
    """Growth vectors, ranks, singular values and singularities at start and goal and along the initial guess.

    tolerance: relative, for every rank. degree: of the longest Lie brackets to look at. spans: the two coordinates of
    the map of singularities (none: those that move most), all others as they are ``at`` the start, the goal, or a time
    of the initial guess.
    Errors: `InvalidProblemError` where these do not fit the problem.
    """
    if not 0 < tolerance < 1:
        raise InvalidProblemError(f"tolerance {tolerance:g}; expected a number between 0 and 1")
    if degree < 1:
        raise InvalidProblemError(f"degree {degree}; expected a whole number >= 1")
    system, scale = problem.system, problem.scale
    states, notes = _ends(problem)
    control, excuse = _guess(problem)
    notes += [excuse] if excuse else []
    followed = (
        replay(numeric_system(system), control, problem.start_point, problem.scales.points)
        if control
        else None
    )
    fields = Fields(system, Scales(scale, control.horizon if control else problem.horizon.first))
    ends = np.array([point for point, _ in states.values()])
    grown, times = _grown(fields, ends, followed, tolerance, degree)
    points = {
        name: _point(problem, point, growth, note)
        for (name, (point, note)), growth in zip(states.items(), grown.points, strict=False)
    }
    path = _path(problem, fields, followed, times, grown) if followed else None
    end_point = None
    if control and followed and followed.stopped is None:
        end_point = end_point_analysis(system, control, problem.start_point, scale, tolerance)
        if end_point is None:
            notes.append(f"the end point's Jacobian overflows, in lengths of {scale:.4g}")
    if followed and followed.stopped:
        notes.append(f"the path of the initial guess ends at t = {followed.reached:.4g}: {followed.stopped}")
    return Analysis(
        problem,
        tolerance,
        grown,
        verdict(grown, [*states, *(f"t = {t:.4g}" for t in times)], tolerance, Reserve.of(problem)),
        points,
        path,
        end_point,
        _map(
            problem, spans, *_base(at, states, followed), np.vstack([ends, *([path.states] if path else [])])
        ),
        _mobility(problem, notes),
        notes,
    )


def _ends(problem: PlanningProblem) -> tuple[dict[str, tuple[Array, str]], list[str]]:
    """Start and goal as states, each with what is to be said of it."""
    names, notes = problem.system.state_space.names, []
    ends = {"start": (problem.start_point, "")}
    given, free = [n for n in names if n in problem.goal], [n for n in names if n not in problem.goal]
    if given:
        ends["goal"] = (problem.goal_point, f"{', '.join(free)} as at the start" if free else "")
    else:
        notes.append("the goal fixes no part of the state; only the start is looked at")
    return ends, notes


def _mobility(problem: PlanningProblem, notes: list[str]) -> Mobility | None:
    """Of a parallel robot at the start; a note where there is none to be had."""
    if not isinstance(problem.system, ParallelRobot):
        return None
    try:
        return mobility(problem.system, problem.start_point)
    except InvalidProblemError as error:
        notes.append(f"no mobility: {error.message}")
        return None


def _guess(problem: PlanningProblem) -> tuple[Control | None, str]:
    """The initial control, or why there is none."""
    try:
        return ProblemGuess().control(problem, problem.horizon.first, 0), ""
    except NoGuessError as error:
        return None, f"no initial guess: {error.args[0]}"


def _point(problem: PlanningProblem, state: Array, growth: Growth, note: str) -> PointAnalysis:
    margins = numeric_system(problem.system).margins(state[None], problem.scale)
    values = {name: float(value[0]) for name, value in margins.items()}
    return PointAnalysis(state, growth, velocities(problem.system, state, problem.scale), values, note)


def _grown(
    fields: Fields, ends: Array, path: Path | None, tolerance: float, degree: int
) -> tuple[Filtration, Array]:
    """The growth at the ends, then along the path at the times returned, those at which it loses rank among them."""
    if path is None:
        return filtration(fields, ends, tolerance, degree), np.empty(0)
    whole = path.reached > SHORTEST * fields.scales.time
    times = np.linspace(0.0, path.reached, SAMPLES) if whole else np.zeros(1)
    grown = filtration(fields, np.vstack([ends, path(times)]), tolerance, degree)
    losses = rank_losses(fields, path, times, grown.generic, tolerance)
    if len(losses):
        times = np.union1d(times, losses)
        grown = filtration(fields, np.vstack([ends, path(times)]), tolerance, degree)
    return grown, times


def _path(
    problem: PlanningProblem, fields: Fields, path: Path, times: Array, grown: Filtration
) -> PathAnalysis:
    numeric, states, generic = numeric_system(problem.system), path(times), grown.generic
    crossings: Sequence[Crossing] = ()
    if len(times) > 1:
        crossings = find_crossings(numeric, path, np.linspace(0.0, path.reached, FINE), problem.scale)
    return PathAnalysis(
        times,
        states,
        grown.points[-len(times) :],
        generic,
        fields.margin(states, len(generic.spectra), generic.rank),
        numeric.margins(states, problem.scale),
        tuple(crossings),
        np.array([path.at(crossing.time) for crossing in crossings]).reshape(-1, states.shape[1]),
    )


def _base(at: str | float, states: Mapping[str, tuple[Array, str]], path: Path | None) -> tuple[Array, str]:
    """The state that a map goes through, and its name."""
    if isinstance(at, str):
        if at not in states:
            raise InvalidProblemError(
                f"no state {at!r} to draw a map through; there is {' and '.join(states)}"
            )
        return states[at][0], at
    if path is None:
        raise InvalidProblemError(f"no state at t = {at:g} to draw a map through: there is no initial guess")
    if not 0 <= at <= path.reached:
        raise InvalidProblemError(
            f"no state at t = {at:g} to draw a map through; the initial guess goes from 0 to {path.reached:.4g}"
        )
    return path(np.array([at]))[0], f"t = {at:g}"


def _map(
    problem: PlanningProblem, spans: Sequence[Span], base: Array, at: str, shown: Array
) -> SingularityMap | None:
    """The map, for systems that name matrices whose singularity is to be watched."""
    if not problem.system.regularity(problem.start_point):
        if spans:
            raise InvalidProblemError(
                f"slice: {problem.system.model} names no matrix whose singularity would have to be watched"
            )
        return None
    if not spans:
        spans = [Span(c) for c in livelier(problem.system.state_space, shown, problem.scale)]
    return singularity_map(problem.system, spans, base, at, shown, problem.scale)
