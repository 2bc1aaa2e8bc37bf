#!/usr/bin/env python3
"""The NLP under active bounds against a plain script: three robots, seven kinds of bound, ten goals each.

A goal is the end point of the paper's Λ₀ plus noise; a bound is set a little inside the extreme that the free optimum
has. The plain script has six local states about one rotation, lengths counted in the robot's own, one RK4 step per
interval, bounds as rows at the ends of the intervals, and IPOPT as it comes. Either plan is judged alike: replayed
by SciPy, E within the tolerance, bounds within 1e-3 of their limits on 5000 times.
Run: .venv/bin/python scripts/active_bounds.py [--robots …] [--kinds …] [--seeds 10] [--intervals 50]
[--compile auto]
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from statistics import median
from time import process_time
from typing import Any

import casadi as ca
import numpy as np
from goals import paper_task, reachable_goals

from nhpocp.arrays import Array
from nhpocp.constraints.bound import Bound, bound_rows
from nhpocp.controls.control import Control
from nhpocp.controls.piecewise_constant import PiecewiseConstant
from nhpocp.flow.compiled.kernels import Compiled, CompiledWhenReady, Interpreted, Kernels
from nhpocp.problem import PlanningProblem
from nhpocp.solution import Solution
from nhpocp.solvers.nlp.multiple_shooting import MultipleShooting
from nhpocp.systems.numeric import numeric_system
from nhpocp.systems.three_upu import ThreeUPU
from nhpocp.verification.replay import replay, sample

INSIDE = 0.1  # share of a quantity's range along the free optimum by which a bound is set inside its extreme
TOLERANCE = 1e-3  # of E, and of bounds relative to their limits
TIMES = 5000
UNEQUAL = (
    {"base": (28, 3, 0), "platform": (15, 0, 0), "r": (0.0, 0.97, 0.26), "w4": (1, 0, 0)},
    {"base": (-16, 25, 2), "platform": (-7, 12, 1), "r": (-0.8, -0.5, 0.3), "w4": (-0.5, 0.8, 0)},
    {"base": (-14, -27, -1), "platform": (-8, -13, 0), "r": (0.7, -0.6, 0.35), "w4": (-0.4, -0.9, 0)},
)
KERNELS: dict[str, Kernels] = {"auto": CompiledWhenReady(), "always": Compiled(), "never": Interpreted()}
ROBOTS: dict[str, Callable[[], ThreeUPU]] = {
    "default": ThreeUPU,
    "unequal": lambda: ThreeUPU(legs=UNEQUAL),
    "suslov": lambda: ThreeUPU(joint="suslov", platform_axis="normal"),
}


# --- what is solved -----------------------------------------------------------------------------------------


def _lowered(values: Array) -> Array:
    """The greatest value (components,) along a path, moved inwards, but not below what the ends need."""
    most, ends = values.max(0), values[[0, -1]].max(0)
    return most - np.minimum(INSIDE * np.ptp(values, axis=0), 0.5 * (most - ends))


def leg_length(free: Mapping[str, Array]) -> list[Bound]:
    lengths = free["leg_lengths"]
    return [Bound("leg_length", "leg_lengths", -_lowered(-lengths), _lowered(lengths))]


def leg_speed(free: Mapping[str, Array]) -> list[Bound]:
    limit = (1 - INSIDE) * np.abs(free["u"]).max()
    return [Bound("leg_speed", "u", -limit, limit)]


def control(free: Mapping[str, Array]) -> list[Bound]:
    limit = (1 - INSIDE) * np.abs(free["v"]).max()
    return [Bound("control", "v", -limit, limit)]


def control_of_each_input(free: Mapping[str, Array]) -> list[Bound]:
    limits = np.abs(free["v"]).max(0) * [1 - INSIDE, 1.2, 1.2]
    return [Bound("control", "v", -limits, limits)]


def clearance(free: Mapping[str, Array]) -> list[Bound]:
    names = ("sigma_s", "sigma_w")
    return [Bound(f"clearance.{name}", name, -_lowered(-free[name])) for name in names]


def position_box(free: Mapping[str, Array]) -> list[Bound]:
    places = free["position"]
    return [Bound("state.position", "position", -_lowered(-places), _lowered(places))]


def platform_normal_box(free: Mapping[str, Array]) -> list[Bound]:
    normals = free["platform_normal"]
    return [Bound("state.platform_normal", "platform_normal", -_lowered(-normals), _lowered(normals))]


KINDS = [
    leg_length,
    leg_speed,
    control,
    control_of_each_input,
    clearance,
    position_box,
    platform_normal_box,
]


@lru_cache(maxsize=3)
def robot(name: str) -> ThreeUPU:
    return ROBOTS[name]()


def free_task(name: str, seed: int) -> PlanningProblem:
    problem = replace(paper_task("default"), system=robot(name), name=f"{name}, goal {seed}")
    return replace(problem, goal=reachable_goals(problem, 1, seed)[0])


def cases(
    names: Sequence[str], kinds: Sequence[Callable[..., list[Bound]]], seeds: Sequence[int], intervals: int
) -> Any:
    """(robot, kind, seed, problem), where the free optimum is found."""
    for name in names:
        for seed in seeds:
            problem = free_task(name, seed)
            plan = plain(problem, intervals)
            if plan.status != "Solve_Succeeded":
                print(f"{name}, goal {seed}: no free optimum ({plan.status})")
                continue
            free = trajectory(problem, plan.control)
            for kind in kinds:
                yield name, kind.__name__, seed, replace(problem, bounds=kind(free))


# --- the plain script ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Plan:
    control: Control
    cost: float
    status: str
    iterations: int
    seconds: float  # of this process


def plain(problem: PlanningProblem, intervals: int) -> Plan:
    """The problem as a plain `ca.nlpsol` script has it."""
    began = process_time()
    system, space = problem.system, problem.system.state_space
    middle = np.asarray(
        space.retract(problem.start_point, 0.5 * space.difference(problem.goal_point, problem.start_point))
    )
    units = np.array([problem.scale] * 3 + [1.0] * 3)
    x, v = ca.SX.sym("x", 6), ca.SX.sym("v", 3)
    pose = space.chart(units * x, middle)
    c, velocity = x[3:], system.velocity(pose, v)
    omega = velocity[3:]
    spin = (omega + ca.cross(omega, c) + ca.dot(c, omega) * c) / 2
    f = ca.Function("f", [x, v], [ca.vertcat(velocity[:3] / problem.scale, spin)])
    h = 1 / intervals
    k1 = f(x, v)
    k2 = f(x + h / 2 * k1, v)
    k3 = f(x + h / 2 * k2, v)
    k4 = f(x + h * k3, v)
    step = ca.Function("step", [x, v], [x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)])
    found = [row for b in problem.bounds for row in bound_rows(b, system, pose, v, problem.scale)]
    rows = ca.Function("rows", [x, v], [ca.vertcat(*[row[1] for row in found])])
    w = ca.MX.sym("w", 9 * intervals + 6)
    stages = ca.reshape(w[: 9 * intervals], 9, intervals)
    before, inputs = stages[:6, :], stages[6:, :]
    after = ca.horzcat(before[:, 1:], w[9 * intervals :])
    gaps = after - step.map(intervals)(before, inputs)
    limits = [np.array([row[i] for row in found]) for i in (2, 3)]
    g, low, high = [ca.vec(gaps)], [np.zeros(6 * intervals)], [np.zeros(6 * intervals)]
    at_start = [i for i, row in enumerate(found) if ca.depends_on(ca.SX(row[1]), v)]
    for states, kept in ((after, list(range(len(found)))), (before, at_start)):
        if kept:
            g.append(ca.vec(rows.map(intervals)(states, inputs)[kept, :]))
            low.append(np.tile(limits[0][kept], intervals))
            high.append(np.tile(limits[1][kept], intervals))
    nlp = {"x": w, "f": ca.sumsqr(inputs) * h, "g": ca.vertcat(*g)}
    quiet = {"print_time": False, "show_eval_warnings": False, "error_on_fail": False}
    solver = ca.nlpsol(
        "plain", "ipopt", nlp, {**quiet, "ipopt": {"print_level": 0, "sb": "yes", "max_iter": 1000}}
    )
    guess = problem.control(problem.initial)((np.arange(intervals) + 0.5) * h)
    ends = [
        np.asarray(space.coordinates(point, middle)) / units
        for point in (problem.start_point, problem.goal_point)
    ]
    path = [ends[0]]
    for u in guess:
        path.append(np.array(step(path[-1], u)).ravel())
    start = np.concatenate([np.hstack([path[:-1], guess]).ravel(), path[-1]])
    lower, upper = np.full(w.numel(), -np.inf), np.full(w.numel(), np.inf)
    lower[:6] = upper[:6] = ends[0]
    lower[-6:] = upper[-6:] = ends[1]
    answer = solver(x0=start, lbx=lower, ubx=upper, lbg=np.concatenate(low), ubg=np.concatenate(high))
    values = np.array(answer["x"])[: 9 * intervals].reshape(intervals, 9)[:, 6:].T
    stats = solver.stats()
    return Plan(
        Control(PiecewiseConstant(intervals), values, 1.0),
        float(answer["f"]),
        str(stats["return_status"]),
        int(stats["iter_count"]),
        process_time() - began,
    )


# --- ours, and the judge ------------------------------------------------------------------------------------


def ours(problem: PlanningProblem, solver: MultipleShooting) -> tuple[Solution, float]:
    began = process_time()
    solution = solver.solve(problem)
    return solution, process_time() - began


def trajectory(problem: PlanningProblem, control: Control) -> Mapping[str, Array]:
    """The replayed motion at many times; an empty one where it cannot be followed."""
    numeric = numeric_system(problem.system)
    path = replay(numeric, control, problem.start_point)
    if path.stopped:
        return {}
    samples = sample(path, control, TIMES)
    return numeric.trajectory(samples.states, samples.controls, problem.scale)


def judged(problem: PlanningProblem, control: Control) -> tuple[float, float]:
    """E, and the worst relative excess of a bound."""
    free = trajectory(problem, control)
    if not free:
        return np.inf, np.inf
    space = problem.system.state_space
    end = np.asarray(space.pack({name: free[name][-1] for name in space.names}))
    excess = [float(bound.relative_excess(free[bound.quantity]).max()) for bound in problem.bounds]
    return problem.goal_error(end), max(excess, default=0.0)


def holds(error: float, excess: float) -> bool:
    return error <= TOLERANCE and excess <= TOLERANCE


def main(arguments: argparse.Namespace) -> None:
    kinds = [kind for kind in KINDS if kind.__name__ in arguments.kinds]
    solver = MultipleShooting(intervals=arguments.intervals, kernels=KERNELS[arguments.compile])
    times: list[tuple[float, float]] = []
    kept, lost, dearer, total = [0, 0], [], [], 0
    seeds = range(arguments.first, arguments.first + arguments.seeds)
    for name, kind, seed, problem in cases(arguments.robots, kinds, seeds, arguments.intervals):
        total += 1
        theirs = plain(problem, arguments.intervals)
        their_error, their_excess = judged(problem, theirs.control)
        mine, seconds = ours(problem, solver)
        error, excess = judged(problem, mine.control)
        cost = float(mine.details.get("objective_value", np.nan))
        good = theirs.status == "Solve_Succeeded" and holds(their_error, their_excess)
        well = mine.converged or (mine.outcome.value == "converged" and holds(error, excess))
        kept[0] += good
        kept[1] += well
        times.append((theirs.seconds, seconds))
        remark = ""
        if good and not well:
            lost.append(f"{name} {kind} {seed}")
            remark = "LOST"
        elif good and cost > 1.001 * theirs.cost:
            dearer.append(f"{name} {kind} {seed}")
            remark = f"DEARER {cost / theirs.cost:.4f}"
        elif well and not good:
            remark = "won"
        print(
            f"{name:8} {kind:22} {seed:3}  {theirs.status:26} {theirs.iterations:4} {theirs.cost:9.5f} "
            f"{their_error:8.1e} {their_excess:8.1e} {theirs.seconds:5.1f} s | {mine.outcome.value:16} "
            f"{len(mine.iterations):4} {cost:9.5f} {error:8.1e} {excess:8.1e} {seconds:5.1f} s  {remark}",
            flush=True,
        )
    ratio = median(mine for _, mine in times) / median(theirs for theirs, _ in times)
    print(
        f"{total} cases: plain holds in {kept[0]}, ours in {kept[1]}; median time {ratio:.2f} of the plain one's"
    )
    print(f"lost: {', '.join(lost) or 'none'}; dearer: {', '.join(dearer) or 'none'}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--robots", nargs="+", default=list(ROBOTS))
    parser.add_argument("--kinds", nargs="+", default=[kind.__name__ for kind in KINDS])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--intervals", type=int, default=50)
    parser.add_argument(
        "--compile", choices=list(KERNELS), default="auto"
    )  # of ours, as a problem file has it
    main(parser.parse_args())
