"""Steering in chained form: a closed-form plan from sinusoids, or from polynomials."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from itertools import pairwise
from math import factorial, pi, sqrt
from time import perf_counter
from typing import TYPE_CHECKING, Any, ClassVar

from nhpocp import declared
from nhpocp.constructed import Constructed
from nhpocp.errors import InvalidProblemError
from nhpocp.solvers.settings import SolverSettings

if TYPE_CHECKING:
    from nhpocp.arrays import Array
    from nhpocp.controls.control import Control
    from nhpocp.flow.compiled.kernels import Kernels
    from nhpocp.problem import PlanningProblem
    from nhpocp.solution import Progress, Solution, Solver
    from nhpocp.systems.chained_form import ChainedForm

DEGREE = 16  # of the polynomials that stand for a control
RESOLVED = 1e-11  # the last coefficients of such a polynomial, by the largest
SHORTEST = 4e-3  # half of the part of a stretch that is not halved again: its inputs are too wild
FARTHEST = (0.25, 32.0)  # least and greatest ways of z_1 that are tried, by that of least effort in z
THERE = 1e-12  # of the largest coordinate: nearer to the goal, one is left as it is
BRIEFEST = 1e-3  # of the longest stretch
STEPS = 16  # for each polynomial, at least, to see where a control leads
KEPT = 0.1  # of the tolerance: what a control may miss a pose by that the next part of the plan starts from
NEARER = "give nearer poses, `via`, or take another solver."
CHARTS = (
    4  # times that the way to a goal is halved, where no chart holds both ends or the inputs are too wild
)
ASIDE = (-3.0, -1.0, -0.3, 0.3, 1.0, 3.0)  # places of z_1 to go by, for polynomials


@dataclass(frozen=True)
class SinusoidsSettings(SolverSettings):
    """Closed-form steering of systems with a chained form, [Murray & Sastry], [Tilbury et al.]."""

    inputs: str = declared.choice("sinusoids", ("sinusoids", "polynomials"), "of the chained form")
    tolerance: float = declared.positive(1e-6, "the error E that counts as reached")

    meaning: ClassVar[str] = "closed-form steering of systems with a chained form"

    def solver(self, kernels: Kernels | None, others: Mapping[str, Solver]) -> Solver:
        return Sinusoids(self)


@dataclass(frozen=True)
class Stretch:
    """A part of the plan: its control over unit time, in pieces."""

    pieces: list[Control]

    @property
    def effort(self) -> float:
        """∫ |u|² over unit time."""
        return sum(piece.effort for piece in self.pieces)

    def lasting(self, duration: float) -> list[Control]:
        """The same motion in another time."""
        from nhpocp.controls.sequence import retimed

        return [retimed(piece, duration * piece.horizon) for piece in self.pieces]


class _TooWildError(Exception):
    """Inputs that change too fast to be followed."""


@dataclass(frozen=True)
class Sinusoids(Constructed):
    r"""Solver: steers z of a `ChainedForm` number by number, or all at once, and feeds the inputs back to the system's.

    Sinusoids, [Murray & Sastry]: constant v take z_1 and z_2 to the goal; then v = (a sin ωt, b cos kωt), one period
    each, moves z_{k+2} by (a/2ω)^k (b/k!) (2π/ω), leaves all numbers below it where they were, and those above to the
    next; a and b are those of least effort of the system. Polynomials, [Tilbury et al.]: constant v_1 and a polynomial
    v_2 of degree n - 2, by way of another z_1 where that is cheaper. Where no chart holds both ends, or the inputs are
    too wild to be followed, the way is halved, and each half begins where the one before it truly ends. Every stretch
    lasts as the square root of its effort, which makes their sum least. The plan is the solver's own: bounds, costs and
    `control` are not its concern, and what a pose leaves free stays as it was.
    given: a `SinusoidsSettings`. Errors: `InvalidProblemError` from `solve` for a system without a chained form, a pose
    outside its chart, or an output as the goal.
    """

    given: SinusoidsSettings
    name: ClassVar[str] = "sinusoids"

    @property
    def tolerance(self) -> float:
        return self.given.tolerance

    def settings(self) -> dict[str, Any]:
        return asdict(self.given)

    def solve(self, problem: PlanningProblem, progress: Progress | None = None) -> Solution:
        import numpy as np

        from nhpocp.controls.sequence import join
        from nhpocp.outcome import Outcome
        from nhpocp.solvers.claimed import claimed, unsolved

        began, count = perf_counter(), 0
        pieces: list[Control] = []
        durations = np.diff([0.0, *(task.share for task in problem.tasks)]) * problem.horizon.fixed
        point = problem.start_point
        for task, duration in zip(problem.tasks, durations, strict=True):
            try:
                goal = _next_pose(problem, task.values, point)
                stretches, point = self._steered(problem, point, goal, CHARTS)
            except _TooWildError:
                words = (
                    f"The inputs of {self.given.inputs} in chained form are too wild to be followed; {NEARER}"
                )
                return unsolved(problem, self, Outcome.STAGNATED, words, solve_seconds=perf_counter() - began)
            efforts = np.sqrt([stretch.effort for stretch in stretches])
            efforts = np.maximum(efforts, BRIEFEST * efforts.max() or 1.0)
            shares = duration * efforts / efforts.sum()
            pieces += [p for s, share in zip(stretches, shares, strict=True) for p in s.lasting(share)]
            count += len(stretches)
        control = join(pieces)
        error = _missed(problem, control)
        reached, record = error <= self.tolerance, {"k": 0, "error": error}
        if progress:
            progress(record)
        outcome = Outcome.CONVERGED if reached else Outcome.STAGNATED
        message = f"E = {error:.3g} by {count} stretches of {self.given.inputs} in chained form."
        if not reached:
            message += f" Its inputs are too wild to be followed; {NEARER}"
        timing = {"build_s": 0.0, "solve_s": perf_counter() - began}
        more = {"iterations": [record], "evaluations": 1, "objective": "none", "timing": timing}
        return claimed(problem, self, control, outcome, message, error, **more)

    def _steered(
        self, problem: PlanningProblem, start: Array, goal: Array, halvings: int
    ) -> tuple[list[Stretch], Array]:
        """The way to another point, and the point that it reaches.

        A half begins where the one before it truly ends, since reversing trailers multiply what is missed.
        """
        from nhpocp.controls.sequence import join

        space = problem.system.state_space
        between = space.retract(start, 0.5 * space.difference(goal, start))
        form = _form(problem, between)
        plan = _by_sinusoids if self.given.inputs == "sinusoids" else _by_polynomials
        try:
            stretches = plan(form, form.to_chained(start), form.to_chained(goal))
            control = join([piece for stretch in stretches for piece in stretch.pieces])
            reached = _path(problem, control, start)[1][-1]
            missed = space.weights(problem.error_length) * space.difference(goal, reached)
            if not (missed**2).sum() <= (KEPT * self.tolerance) ** 2:
                raise _TooWildError
        except (InvalidProblemError, _TooWildError):
            if not halvings:
                raise
        else:
            return stretches, reached
        first, there = self._steered(problem, start, between, halvings - 1)
        second, reached = self._steered(problem, there, goal, halvings - 1)
        return first + second, reached


def _form(problem: PlanningProblem, near: Array) -> ChainedForm:
    form = problem.system.chained_form(near)
    if form is None:
        words = f"{problem.system.model} has no chained form that nhpocp knows; expected one such as car"
        raise InvalidProblemError(words, path="solvers.sinusoids")
    return form


def _next_pose(problem: PlanningProblem, values: Mapping[str, Any], before: Array) -> Array:
    """The state that a task fixes; what it leaves free stays as it was. Errors: `InvalidProblemError` for an output."""
    space = problem.system.state_space
    if others := [name for name in values if name not in space.names]:
        words = f"sinusoids steers to states, and {others[0]} is an output; name the state in its place"
        raise InvalidProblemError(words, path="goal")
    return space.pack({**space.unpack(before), **values})


def _path(problem: PlanningProblem, control: Control, start: Array) -> tuple[Array, Array]:
    """Times and points, by fixed steps that are halved until they agree."""
    from nhpocp.flow.integrators import even_pieces
    from nhpocp.flow.step_error import settled_path

    return settled_path(problem, control, STEPS, start, even_pieces)


def _missed(problem: PlanningProblem, control: Control) -> float:
    """E of every pose."""
    import numpy as np

    times, path = _path(problem, control, problem.start_point)
    missed = []
    for task in problem.tasks:
        point = path[int(np.abs(times - task.share * control.horizon).argmin())]
        missed.append(np.asarray(task.weights * task.difference(point)))
    return float(np.linalg.norm(np.concatenate(missed)))


def _by_sinusoids(form: ChainedForm, start: Array, goal: Array) -> list[Stretch]:
    """Straight there, or by way of z_2 = … = z_{n-1} = 0 at both ends, between which z_1 goes without the others."""
    import numpy as np

    level = np.eye(form.size)[[0, -1]]  # takes z_1 and z_n
    aligned = start @ level.T @ level
    beside = np.array([goal[0], *aligned[1:]])
    return _cheapest([[start, goal], [start, aligned, beside, goal]], lambda a, b: _periods(form, a, b))


def _periods(form: ChainedForm, z: Array, goal: Array) -> list[Stretch]:
    """First z_1 and z_2, then each further number by a period of its own."""
    import numpy as np

    stretches: list[Stretch] = []
    straight, least = goal[:2] - z[:2], THERE * max(1.0, np.abs(goal).max())
    if straight.any() or form.size == 2:
        piece, z = _stretch(form, z, lambda t: straight + 0.0 * t[:, None])
        stretches.append(piece)
    for k in range(1, form.size - 1):
        needed = goal[k + 1] - z[k + 1]
        if abs(needed) > least:
            piece, z = _best_period(form, z, k, needed)
            stretches.append(piece)
    return stretches or [_stretch(form, z, lambda t: 0.0 * t[:, None] + [0.0, 0.0])[0]]


def _best_period(form: ChainedForm, z: Array, k: int, needed: float) -> tuple[Stretch, Array]:
    """A longer way of z_1 takes a smaller z_2: twice as long as long as that spares the system effort, or half."""
    best: tuple[Stretch, Array] | None = None
    for factor in (2.0, 0.5):
        length = 1.0 if factor > 1 else 0.5
        while FARTHEST[0] <= length <= FARTHEST[1]:
            try:
                found = _stretch(form, z, _period(k, needed, length))
            except _TooWildError:
                if best or factor < 1:
                    break
            else:
                if best and found[0].effort >= best[0].effort:
                    break
                best = found
            length *= factor
    if best is None:
        raise _TooWildError
    return best


def _period(k: int, displacement: float, length: float = 1.0) -> Callable[[Array], Array]:
    """v = (a sin ωt, b cos kωt), ω = 2π, that moves z_{k+2}; a: by ``length`` that of least a² + b².

    There a^{2k+2} = k (a^k b)².
    """
    import numpy as np

    needed = displacement * (4.0 * pi) ** k * factorial(k)
    a = length * (k * needed**2) ** (0.5 / (k + 1))
    b = needed / a**k
    return lambda t: np.stack([a * np.sin(2 * pi * t), b * np.cos(2 * pi * k * t)], axis=1)


def _by_polynomials(form: ChainedForm, start: Array, goal: Array) -> list[Stretch]:
    """Straight there, or by way of another z_1 half-way between: the one of least effort."""

    middle = 0.5 * (start + goal)
    ways: list[list[Array]] = [[start, goal]] if abs(goal[0] - start[0]) > 1e-3 else []
    for aside in ASIDE:
        by = middle.copy()
        by[0] += aside
        if min(abs(by[0] - start[0]), abs(by[0] - goal[0])) > 1e-3:
            ways.append([start, by, goal])
    return _cheapest(ways, lambda a, b: [_stretch(form, a, _polynomial(a, b))[0]])


def _cheapest(ways: list[list[Array]], leg: Callable[[Array, Array], list[Stretch]]) -> list[Stretch]:
    """The way of least effort by legs between its points. Errors: `_TooWildError` where every way has a wild leg."""
    plans = []
    for way in ways:
        try:
            plans.append([each for a, b in pairwise(way) for each in leg(a, b)])
        except _TooWildError:
            continue
    if not plans:
        raise _TooWildError
    return min(plans, key=_dearness)


def _dearness(stretches: list[Stretch]) -> float:
    """√ of the least ∫ |u|² dt over unit time, which shares the time among the stretches."""
    return sum(sqrt(each.effort) for each in stretches)


def _polynomial(start: Array, goal: Array) -> Callable[[Array], Array]:
    """v_1 constant and v_2 = Σ c_j t^j over unit time, which lead to

    z_k(1) = Σ_i z_i(0) v_1^{k-i}/(k-i)! + v_1^{k-2} Σ_j c_j j!/(j+k-1)!.
    """
    import numpy as np

    n, v = len(start), goal[0] - start[0]
    kept = [sum(start[i] * v ** (k - i) / factorial(k - i) for i in range(1, k + 1)) for k in range(1, n)]
    rows = [[v ** (k - 1) * factorial(j) / factorial(j + k) for j in range(n - 1)] for k in range(1, n)]
    coefficients = np.linalg.solve(rows, goal[1:] - kept)
    return lambda t: np.stack([v + 0.0 * t, np.polynomial.polynomial.polyval(t, coefficients)], axis=1)


def _stretch(form: ChainedForm, z: Array, inputs: Callable[[Array], Array]) -> tuple[Stretch, Array]:
    """The system's own control over unit time for inputs of the chained form from z, and the z reached."""
    pieces, reached = _resolved(form, z, inputs, 0.0, 1.0)
    return Stretch(pieces), reached


def _resolved(
    form: ChainedForm, z: Array, inputs: Callable[[Array], Array], begin: float, end: float
) -> tuple[list[Control], Array]:
    """Polynomials on as many parts of [begin, end] as the control needs, and z at the end.

    z_{k+1} = ∫ z_k v_1 by Chebyshev series, u by the form's feedback, interpolated in the Chebyshev nodes.
    """
    import numpy as np
    from numpy.polynomial import chebyshev

    from nhpocp.controls.chebyshev import Chebyshev
    from nhpocp.controls.control import Control

    nodes, half = np.cos(pi * (np.arange(DEGREE + 1) + 0.5) / (DEGREE + 1)), 0.5 * (end - begin)
    v = inputs(begin + half * (nodes + 1.0))
    path = [_integral(nodes, half * v[:, i], z[i]) for i in range(2)]
    for k in range(2, form.size):
        path.append(_integral(nodes, half * path[k - 1](nodes) * v[:, 0], z[k]))
    states = form.from_chained(np.stack([each(nodes) for each in path], axis=1))
    u = chebyshev.chebfit(nodes, form.from_chained_input(states, v), DEGREE)
    if np.abs(u[-3:]).max() <= RESOLVED * max(np.abs(u).max(), 1e-300):
        return [Control(Chebyshev(DEGREE), u.T, 2.0 * half)], np.array([each(1.0) for each in path])
    if half < SHORTEST:
        raise _TooWildError
    first, middle = _resolved(form, z, inputs, begin, begin + half)
    second, reached = _resolved(form, middle, inputs, begin + half, end)
    return first + second, reached


def _integral(nodes: Array, values: Array, start: float) -> Callable[[Any], Any]:
    """x ↦ start + ∫_{-1}^x of what has these values at Chebyshev nodes."""
    from numpy.polynomial import chebyshev

    series = chebyshev.chebint(chebyshev.chebfit(nodes, values, len(nodes) - 1), lbnd=-1)
    series[0] += start
    return lambda x: chebyshev.chebval(x, series)
