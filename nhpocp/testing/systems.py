"""Laws of systems: what is declared fits, and the equations are what geometry, SciPy and finite differences say."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import casadi as ca
import numpy as np

from nhpocp.arrays import Array
from nhpocp.controls.control import Control
from nhpocp.controls.fourier import Fourier
from nhpocp.errors import expect
from nhpocp.flow.compiled.kernels import Compiled, Interpreted
from nhpocp.flow.dynamics import Dynamics
from nhpocp.flow.end_point_map import DifferentiatedEndPointMap, VariationalEndPointMap
from nhpocp.flow.integrators import CasadiRungeKutta, Cvodes, RungeKutta4
from nhpocp.problem import PlanningProblem
from nhpocp.problem_file.starters import example_start
from nhpocp.provenance import c_compiler
from nhpocp.solvers.continuation.initial_control import drawn
from nhpocp.systems.numeric import numeric_system
from nhpocp.systems.system import System
from nhpocp.testing.laws import Law, agree, apart, holds, run
from nhpocp.verification import geometry
from nhpocp.verification.replay import replay
from nhpocp.views.drawing import split_name

BASIS = Fourier(2)
SEEDS = (0, 1)
# eighth-order central difference
WEIGHTS = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
WAYS = {
    "variational": (VariationalEndPointMap, RungeKutta4(200)),
    "cvodes": (DifferentiatedEndPointMap, Cvodes(steps=2)),
    "rk": (DifferentiatedEndPointMap, CasadiRungeKutta(steps=200)),
}


def check_system(system: System, start: Mapping[str, Any] | None = None) -> None:
    """Holds a system against the laws that nhpocp's own keep: names, parameters, drawing, equations, derivatives.

    system: an instance, with parameters that matter. start: a value for every block of the state, as a problem's, away
    from singularities; by default that of its `example`, else zeros. Motions of about the mechanism's own length around
    it are looked at.
    Errors: `AssertionError` with the first law that does not hold, and why; `CallError` for what is no system.
    """
    expect(system, System, "a system, such as ThreeUPU()", "system")
    run(system.model, LAWS, standing(system, start))


def standing(system: System, start: Mapping[str, Any] | None = None) -> PlanningProblem:
    """A problem that begins and ends at the start: where laws look at a system."""
    space, begin = system.state_space, start or example_start(system)
    first = space.blocks[0].name  # as much of a goal as there is room for beside invariants
    aim = PlanningProblem(system=system, start=begin, goal={first: begin[first]}, basis=BASIS)
    return aim if system.invariants(aim.start_point) else aim.towards(aim.start)


def random_state(problem: PlanningProblem, seed: int) -> Array:
    """A point around the start: the mechanism's own length and 0.3 rad apart in every direction."""
    space, random = problem.system.state_space, np.random.default_rng(seed)
    scales = np.where(np.array(space.tangent_units) == "length", 0.2 * problem.scale, 0.3)
    return np.asarray(space.retract(problem.start_point, scales * random.standard_normal(space.dimension)))


def random_control(problem: PlanningProblem, seed: int, horizon: float = 1.0) -> Control:
    """A seeded control of natural size."""
    return Control(BASIS, drawn(problem, np.random.default_rng(seed)), horizon)


def exact(
    problem: PlanningProblem, control: Callable[[float], Array], horizon: float, start: Array | None = None
) -> Array:
    """x(T) by SciPy; ``control``: t ↦ u."""
    from scipy.integrate import solve_ivp

    rate = numeric_system(problem.system).rate_function
    path = solve_ivp(
        lambda t, x: np.array(rate(x, control(t))).ravel(),
        (0.0, horizon),
        problem.start_point if start is None else start,
        method="DOP853",
        rtol=1e-12,
        atol=1e-12,
    )
    end: Array = path.y[:, -1]
    return end


def at(control: Control) -> Callable[[float], Array]:
    """A control as a function of one time."""
    return lambda t: control(np.array([t]))[0]


# --- what a system declares -------------------------------------------------------------------------------------------


def parameters_make_the_same_system(problem: PlanningProblem) -> None:
    system = problem.system
    again = type(system)(**system.parameters())
    came, expected = again.parameters(), system.parameters()
    strange = set(expected) - set(system.declared)
    holds(not strange, f"parameters() gives {sorted(strange)}, which `declared` does not know")
    holds(came == expected, f"made of its parameters {expected} it has {came}")
    state, control = random_state(problem, 1), random_control(problem, 1)(np.array([0.3]))[0]
    agree("the velocity", again.velocity(state, control), system.velocity(state, control), 0.0)


def outputs_are_those_declared(problem: PlanningProblem) -> None:
    system, state = problem.system, random_state(problem, 2)
    outputs, still = (
        system.outputs(state, np.ones(system.input_space.size)),
        np.zeros(system.input_space.size),
    )
    if system.known_outputs is not None:
        came, expected = sorted(outputs), sorted(system.known_outputs)
        holds(came == expected, f"outputs(…) gives {came}; output_blocks declares {expected}")
    for block in system.output_blocks or ():
        came_shape = np.shape(outputs[block.name])
        holds(came_shape == block.shape, f"{block.name} is of shape {came_shape}; declared is {block.shape}")
    for block in system.pose_outputs:
        alone = system.output(block.name, state, still)
        agree(f"{block.name}, an output of the pose alone, without control", alone, outputs[block.name], 0.0)


def bodies_are_the_same_for_numbers_and_symbols(problem: PlanningProblem) -> None:
    system, state = problem.system, random_state(problem, 4)
    x, bodies = ca.SX.sym("x", system.state_space.size), system.bodies(state)
    symbols = system.bodies(x)
    holds(list(symbols) == list(bodies), f"bodies(…) gives {[*bodies]} for numbers, {[*symbols]} for symbols")
    dimensions = {len(np.ravel(corner)) for body in bodies.values() for corner in body.corners}
    holds(dimensions <= {2} or dimensions <= {3}, f"bodies(…) has corners of {sorted(dimensions)} numbers")
    for name, body in bodies.items():
        made = ca.vertcat(*[ca.SX(corner) for corner in symbols[name].corners])
        places = ca.Function("corners", [x], [made])(state).full().ravel()
        agree(f"the corners of {name!r} for symbols", places, np.ravel(body.corners), 1e-12)
        holds(name not in body.touches, f"{name!r} touches itself")


def drawings_are_plain_arrays_of_one_dimension(problem: PlanningProblem) -> None:
    picture = problem.system.drawing(random_state(problem, 3))
    items = [*picture["lines"].values(), *picture["points"].values()]
    kinds = {split_name(other)[0] for other in (*picture["lines"], *picture["points"])}
    for name, solid in picture.get("solids", {}).items():
        items.append(np.reshape(solid["ends"] if "ends" in solid else [solid["centre"]], (-1, 3)))
        holds(solid["radius"] > 0, f"the solid {name!r} has no radius > 0")
        if "rotation" in solid:
            agree(f"RᵀR of {name!r}", solid["rotation"].T @ solid["rotation"], np.eye(3), 1e-12)
        strange = set(solid["replaces"]) - kinds - {"spheres", "universal joints"}
        holds(not strange, f"the solid {name!r} replaces {sorted(strange)}, which nothing is called")
    trace = picture.get("trace")
    items += [np.reshape(trace, (1, -1))] if trace is not None else []
    columns = {np.shape(item)[1] for item in items}
    words = f"points have {sorted(columns)} coordinates; expected 3, or 2 throughout"
    holds(len(columns) <= 1 and columns <= {2, 3}, words)
    finite = all(np.isfinite(np.asarray(item, dtype=float)).all() for item in items)
    holds(finite, "a coordinate is no finite number")


# --- the equations ----------------------------------------------------------------------------------------------------


def numbers_and_symbols_move_alike(problem: PlanningProblem) -> None:
    """ẋ = f + G u, by NumPy and by CasADi."""
    system = problem.system
    for seed in SEEDS:
        state = random_state(problem, seed)
        control = random_control(problem, seed)(np.array([0.2]))[0]
        velocity = system.velocity(state, control)
        affine, size = system.drift(state) + system.vector_fields(state) @ control, np.abs(velocity).max()
        agree("drift + vector_fields · u", affine, velocity, 1e-12, size)
        rate = numeric_system(system).rate_function(state, control).full().ravel()
        agree("the rate by CasADi", rate, system.state_space.lift(state, velocity), 1e-12, size)
        moved = bool(np.any(system.drift(state)))
        holds(not (system.driftless and moved), "driftless, but drift(state) is not 0")


def linearised_is_the_derivative(problem: PlanningProblem) -> None:
    numeric, n = numeric_system(problem.system), problem.system.state_space.size
    step = 1e-3 * max(1.0, problem.scale / 15)

    def rate(values: Array) -> Array:
        return numeric.rate_function(values[:n], values[n:]).full().ravel()

    for seed in SEEDS:
        state, control = random_state(problem, seed), random_control(problem, seed)(np.array([0.4]))[0]
        point = np.concatenate([state, control])
        jacobian = numeric.linearised_function(state, control).full()
        for column, direction in enumerate(np.eye(len(point))):
            differences = sum(
                w * (rate(point + k * step * direction) - rate(point - k * step * direction))
                for k, w in WEIGHTS.items()
            )
            what = f"column {column} of linearised(state, control)"
            agree(what, jacobian[:, column], differences / step, 1e-8, np.abs(jacobian).max())


def motions_keep_the_constraints(problem: PlanningProblem) -> None:
    """The path is differenced, and what geometry says of its velocity has to vanish: G is not asked."""
    system, space = problem.system, problem.system.state_space
    legs = geometry.has_legs(system)
    if not legs and type(system).constraints is System.constraints:
        return  # it says nothing of them
    times, step = np.linspace(0.05, 0.95, 19), 2e-3
    for seed in (*SEEDS, 2):
        control = random_control(problem, seed)
        path = replay(numeric_system(system), control, problem.start_point)
        if legs:
            rolling, rates = geometry.residuals(numeric_system(system), path(times), control(times))
            worst = max(rolling.max(), rates.max())
            holds(worst < 1e-8, f"rolling and the legs' rates are broken by {worst:.3g}")
            continue
        rows = np.shape(system.constraints(problem.start_point, np.zeros(space.dimension)))[0]
        wanted = space.dimension - system.input_space.size
        holds(rows == wanted, f"{rows} constraints; the dimension exceeds the inputs by {wanted}")
        for time in times:
            here = path(np.array([time]))[0]
            moved = {
                k: np.asarray(space.difference(path(np.array([time + k * step]))[0], here))
                for k in (-2, -1, 1, 2)
            }
            velocity = (8 * (moved[1] - moved[-1]) - (moved[2] - moved[-2])) / (12 * step)
            residual = np.abs(system.constraints(here, velocity)).max(initial=0.0)
            allowed = 1e-7 * np.linalg.norm(velocity) * (1 + np.abs(here).max())
            broken = f"a motion breaks them by {residual:.3g} at t = {time:.2f}; rounding is {allowed:.3g}"
            holds(residual <= allowed, broken)


def motions_leave_the_invariants(problem: PlanningProblem) -> None:
    system, control = problem.system, random_control(problem, 11)
    start = {name: value for name, (value, _) in system.invariants(problem.start_point).items()}
    end = system.invariants(exact(problem, at(control), 1.0))
    holds(set(end) == set(start), f"{sorted(start)} at the start, {sorted(end)} at the end")
    for name, (value, _) in end.items():
        holds(abs(value - start[name]) < 1e-9 * problem.scale, f"{name} goes from {start[name]} to {value}")


def the_constraints_can_be_broken(problem: PlanningProblem) -> None:
    """A residual that is always zero would prove nothing."""
    system, space = problem.system, problem.system.state_space
    if geometry.has_legs(system) or type(system).constraints is System.constraints:
        return
    state, random = random_state(problem, 4), np.random.default_rng(4)
    least = np.abs(system.constraints(state, random.standard_normal(space.dimension))).min(initial=1.0)
    holds(least > 1e-3, f"a velocity at random has a residual of {least:.3g}")


def time_may_be_scaled(problem: PlanningProblem) -> None:
    if not problem.system.driftless:
        return
    control = random_control(problem, 5)
    slow = Control(BASIS, np.asarray(control.coefficients) / 2.5, 2.5)
    end = exact(problem, at(control), 1.0)
    agree("the end of the motion run slower", exact(problem, at(slow), 2.5), end, 1e-9)


def motions_run_backwards(problem: PlanningProblem) -> None:
    if not problem.system.driftless:
        return
    forth = at(random_control(problem, 6))
    back = exact(problem, lambda t: -forth(1.0 - t), 1.0, exact(problem, forth, 1.0))
    agree("the end of the motion there and back", back, problem.start_point, 1e-9)
    still = np.zeros(problem.system.input_space.size)
    agree("the end without control", exact(problem, lambda t: still, 1.0), problem.start_point, 0.0)


# --- the end point ----------------------------------------------------------------------------------------------------


def the_end_points_jacobian_comes_alike_from_every_way(problem: PlanningProblem) -> None:
    coefficients = 0.6 * np.asarray(random_control(problem, 7).coefficients)
    own = DifferentiatedEndPointMap(problem.system, BASIS, 1.0, problem.start_point, RungeKutta4(200))(
        coefficients
    )
    for name, (factory, integrator) in WAYS.items():
        other = factory(problem.system, BASIS, 1.0, problem.start_point, integrator)(coefficients)
        agree(f"the end by {name}", other.state, own.state, 1e-6)
        agree(f"the Jacobian by {name}", other.jacobian, own.jacobian, 1e-6, np.abs(own.jacobian).max())


def runge_kutta_has_order_four(problem: PlanningProblem) -> None:
    """Away from the period's end, where quadrature of a Fourier sum would be exact; where there is an error at all."""
    coefficients = 0.6 * np.asarray(random_control(problem, 8).coefficients)  # far from det W = 0
    rate, last = numeric_system(problem.system).rate_function, 0.61
    ends = [
        RungeKutta4()
        .flow(Dynamics(rate), BASIS, 1.0, np.linspace(0.0, last, steps + 1))
        .end(problem.start_point, coefficients)
        for steps in (20, 40, 80)
    ]
    end = exact(problem, at(Control(BASIS, coefficients, 1.0)), last)
    errors = np.array([np.abs(reached - end).max() for reached in ends])
    if errors[0] < 1e-9:
        return  # rounding: the equations are linear, say
    shown = ", ".join(f"{error:.3g}" for error in errors)
    holds(errors[0] > errors[1] > errors[2] > 1e-11, f"errors of 20, 40 and 80 steps are {shown}")
    orders = np.log2(errors[:-1] / errors[1:])
    smooth = bool(np.abs(orders - 4.0).max() <= 0.35)
    holds(smooth, f"errors of 20, 40 and 80 steps are {shown}: orders {orders}; are the equations smooth?")


def a_compiled_kernel_gives_the_same_numbers(problem: PlanningProblem) -> None:
    if not c_compiler():
        return
    coefficients = 0.3 * random_control(problem, 9).coefficients  # singularities would magnify rounding
    ends = [
        DifferentiatedEndPointMap(
            problem.system, BASIS, 1.0, problem.start_point, RungeKutta4(30, kernels=kernels)
        )(coefficients)
        for kernels in (Compiled(), Interpreted())
    ]
    holds(apart(ends[0].path, ends[1].path) < 1e-9, "the compiled path is another")
    holds(apart(ends[0].jacobian, ends[1].jacobian) < 1e-9, "the compiled Jacobian is another")


LAWS: tuple[Law, ...] = (
    parameters_make_the_same_system,
    outputs_are_those_declared,
    drawings_are_plain_arrays_of_one_dimension,
    bodies_are_the_same_for_numbers_and_symbols,
    numbers_and_symbols_move_alike,
    linearised_is_the_derivative,
    motions_keep_the_constraints,
    motions_leave_the_invariants,
    the_constraints_can_be_broken,
    time_may_be_scaled,
    motions_run_backwards,
    the_end_points_jacobian_comes_alike_from_every_way,
    runge_kutta_has_order_four,
    a_compiled_kernel_gives_the_same_numbers,
)
