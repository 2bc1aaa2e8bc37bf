"""Calls as beginners write them: each is answered in this package's own words, or does what was meant."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

import nhpocp
from nhpocp import (
    Adaptive,
    Auto,
    Bound,
    BSpline,
    CasadiRungeKutta,
    Chebyshev,
    Continuation,
    Control,
    Cvodes,
    Euler,
    Fourier,
    Heisenberg,
    Horizon,
    Ipopt,
    Leg,
    Legendre,
    MultipleShooting,
    MultiStart,
    Ode,
    OrientingPlatform,
    ParallelRobot,
    PiecewiseConstant,
    PlanningProblem,
    RollingSphere,
    Run,
    RungeKutta4,
    SequenceBasis,
    SolverGuess,
    StateSpace,
    System,
    ThreeUPU,
    Unicycle,
    Via,
    deg,
    scalar,
    vector,
)

ROBOT = {
    "system": ThreeUPU(),
    "start": {"position": [0, 0, 25], "orientation": {"rpy": [0, 0, -30 * deg]}},
    "goal": {"position": [-0.4, -0.2, 35], "orientation": {"rpy": [0, 0, -90 * deg]}},
    "initial": [[0, 0.5, 0, 0, 0], [0, 0.5, 0, 0, 0], [1, 0, 0.5, 0, 0]],
}


def problem(**changes):
    return PlanningProblem(**{**ROBOT, **changes})


class Cart(System):
    """A point on a line, whose equations the cases below break."""

    model = "cart"
    state_space = StateSpace([vector("position", 2, "length")])
    input_space = StateSpace([scalar("v", "length")])

    def vector_fields(self, state):
        return nhpocp.namespace(state).matrix([[1.0], [0.0]])


def cart(**members):
    """A problem with a cart of other members."""
    system = type("Cart", (Cart,), members)()
    return PlanningProblem(system=system, start={"position": [0, 0]}, goal={"position": [1, 0]})


@pytest.fixture(scope="module")
def solution():
    return nhpocp.solve(problem(), Continuation(step_rule=Adaptive()))


SPACE = {"state_space": None}
CALLS = [  # what is written, and what the answer says
    (lambda _: nhpocp.solv, "nhpocp has no 'solv'; did you mean 'solve'"),
    (lambda _: nhpocp.threeupu, "did you mean 'ThreeUPU'"),
    (lambda _: Fourier(-1), "Fourier.harmonics: -1 is out of range; expected a whole number from 0 to 1000"),
    (lambda _: Fourier(2.5), "2.5 is not a whole number"),
    (lambda _: Fourier("2"), "expected a whole number from 0 to 1000, got the text '2'"),
    (lambda _: Fourier(harmonic=2), "Fourier has no argument 'harmonic'; did you mean 'harmonics'"),
    (lambda _: Fourier(1, 2), "Fourier was given 2 arguments without names; its arguments are: harmonics"),
    (lambda _: Legendre(-1), "Legendre.degree: -1 is out of range"),
    (lambda _: Chebyshev(None), "Chebyshev.degree: expected a whole number from 0 to 1000, got nothing"),
    (lambda _: BSpline(intervals=0), "BSpline.intervals: 0 is out of range; expected a whole number from 1"),
    (lambda _: PiecewiseConstant(True), "got the truth value true"),
    (lambda _: SequenceBasis((), ()), "0 bases and 0 shares; expected as many, at least one"),
    (
        lambda _: nhpocp.ControlBasis(),
        "ControlBasis is a contract; derive a class from it that has breakpoints",
    ),
    (lambda _: nhpocp.StepRule(), "StepRule is a contract; derive a class from it"),
    (lambda _: ThreeUPU.preset("defalt"), "unknown preset 'defalt'; did you mean 'default'"),
    (lambda _: Unicycle.preset("default"), "unicycle has no presets"),
    (lambda _: ThreeUPU(base_radus=3), "ThreeUPU has no argument 'base_radus'; did you mean 'base_radius'"),
    (lambda _: ThreeUPU(base_radius="30"), "system.base_radius: expected a number, got the text '30'"),
    (lambda _: ThreeUPU(base_radius=-1), "system.base_radius: -1; expected a number > 0"),
    (lambda _: ThreeUPU(roller_tilt="75 deg"), "in Python write 30 deg as 30 * nhpocp.deg"),
    (lambda _: ThreeUPU(platform_axis="radail"), "'radail' is none of radial, tangential, normal"),
    (lambda _: ThreeUPU(legs=3), "expected a list of legs, got the number 3"),
    (lambda _: ThreeUPU(legs=[1, 2, 3]), "expected a leg, such as Leg(base=…, platform=…) or {'base': …}"),
    (lambda _: ParallelRobot(legs={}), "expected a list of legs, got a mapping"),
    (lambda _: Leg(base=0, platform=[1, 0, 0]), "base of a leg: expected 3 numbers, got the number 0"),
    (lambda _: Leg(base=["0", 0, 0], platform=[1, 0, 0]), "expected 3 numbers, got the text '0' among them"),
    (lambda _: Leg([0, 0, 0]), "Leg: missing a required argument: 'platform'"),
    (lambda _: Heisenberg(scael=2), "did you mean 'scale'"),
    (lambda _: nhpocp.SuslovJoint(speed=1), "unknown parameter; suslov_joint has none"),
    (lambda _: RollingSphere(radius=[1]), "system.radius: expected a number, got a list of 1"),
    (lambda _: OrientingPlatform(r=[0, 1]), "r of a leg has 2 numbers; expected 3"),
    (lambda _: ThreeUPU().with_(radius=3), "ThreeUPU has no argument 'radius'; did you mean"),
    (lambda _: replace(problem(), gaol={}), "PlanningProblem has no argument 'gaol'; did you mean 'goal'"),
    (
        lambda _: nhpocp.replace(3, x=1),
        "expected a system, a problem, a control or a setting, got the number 3",
    ),
    (
        lambda _: PlanningProblem(),
        "PlanningProblem: missing a required argument: 'system'; its arguments are",
    ),
    (
        lambda _: PlanningProblem(ThreeUPU()),
        "given 1 arguments without names; its arguments are by name: system",
    ),
    (
        lambda _: problem(system=ThreeUPU),
        "expected a system such as ThreeUPU(), got the class ThreeUPU; write Th",
    ),
    (lambda _: problem(system="three_upu"), "system: expected a system such as ThreeUPU(), got the text"),
    (
        lambda _: problem(start=[0, 0, 25]),
        "start: expected a mapping {'position': …, 'orientation': …}, got a list",
    ),
    (lambda _: problem(goal=None), "goal: expected a mapping"),
    (lambda _: problem(goal={"positon": [0, 0, 30]}), "goal.positon: unknown key; did you mean 'position'"),
    (lambda _: problem(goal={"position": [0, 0]}), "goal.position: 2 numbers; expected 3"),
    (lambda _: problem(goal={"position": "0, 0, 30"}), "expected [3 numbers], got the text '0, 0, 30'"),
    (lambda _: problem(goal={"position": ["0", "0", "30"]}), "expected [3 numbers], got a list of 3"),
    (
        lambda _: problem(goal={"orientation": [0, 0, 1]}),
        "expected {rpy: [roll, pitch, yaw]}, got a list of 3",
    ),
    (lambda _: problem(goal={"orientation": {"rpy": [0, 0, "-90°"]}}), "write 30 deg as 30 * nhpocp.deg"),
    (lambda _: problem(goal={"orientation": {"euler": [0, 0, 1]}}), "expected exactly one of rpy"),
    (lambda _: problem(basis="fourier"), "expected a basis such as Fourier(2), got the text 'fourier'"),
    (lambda _: problem(basis=Fourier), "got the class Fourier; write Fourier(…)"),
    (
        lambda _: problem(initial=5),
        "control.initial: expected one row of numbers per input, got the number 5",
    ),
    (lambda _: problem(initial="random"), "expected one row of numbers per input, got the text 'random'"),
    (lambda _: problem(horizon=0), "horizon: 0 is not a duration; expected a number > 0"),
    (
        lambda _: problem(horizon="2"),
        "expected a duration, or {'min': …, 'max': …, 'initial': …}, got the text",
    ),
    (lambda _: problem(horizon={"minimum": 1}), "horizon.minimum: unknown key; did you mean 'min'"),
    (lambda _: Horizon(minimal=1), "Horizon has no argument 'minimal'; did you mean 'minimum'"),
    (lambda _: problem(objective="efort"), "objective: 'efort' is none of effort"),
    (lambda _: problem(objective=3), "expected the name of an objective, got the number 3"),
    (lambda _: problem(error_length="1"), "error_length: expected a length > 0, got the text '1'"),
    (lambda _: problem(samples=1.5), "output.samples: 1.5 is not a whole number"),
    (
        lambda _: problem(via=[(0.5, {})]),
        "via[0]: expected Via(0.5, {…}) or {'at': 0.5, …}, got a tuple of 2",
    ),
    (
        lambda _: problem(via=Via(0.5, {"position": [0, 0, 30]})),
        "via: expected a list of via poses, got a Via",
    ),
    (lambda _: problem(via=[{"position": [0, 0, 30]}]), "via[0]: expected Via(0.5"),
    (lambda _: problem(bounds={"leg_lenght": [20, 60]}), "constraints.leg_lenght: unknown key; did you mean"),
    (
        lambda _: problem(bounds={"leg_length": 60}),
        "expected [lo, hi], or {min: …, max: …} with one or both, got",
    ),
    (lambda _: problem(bounds={"leg_length": [60, 20]}), "lower bound 60 is above upper bound 20"),
    (lambda _: problem(bounds={"leg_speed": -1}), "constraints.leg_speed: -1 is negative"),
    (lambda _: problem(bounds={"joint_angle": {"theta9": [0, 1]}}), "joint_angle.theta9: unknown key"),
    (
        lambda _: problem(bounds=Bound("a", "u", 0, 1)),
        "a mapping such as {'leg_length': [20, 60]}, got a Bound",
    ),
    (
        lambda _: problem(bounds=[("u", 0, 1)]),
        "expected Bound(label, quantity, lower, upper), got a tuple of 3",
    ),
    (
        lambda _: problem(bounds=[Bound("speed", "u", "a")]),
        "expected numbers as lower and upper, got the text 'a'",
    ),
    (lambda _: Bound("a", "u", low=3), "Bound has no argument 'low'; did you mean 'lower'"),
    (
        lambda _: problem(solvers=[Auto()]),
        "solvers: expected solvers by name, such as {'jacobian': Continuation()}",
    ),
    (lambda _: Continuation(gama=1), "Continuation has no argument 'gama'; expected one of step_rule"),
    (lambda _: Continuation(step_rule="adaptive"), "expected a step rule such as Adaptive(), got the text"),
    (lambda _: Continuation(step_rule=Adaptive), "got the class Adaptive; write Adaptive(…)"),
    (lambda _: Continuation(tolerance=0), "Continuation.tolerance: 0 is not positive; expected a number > 0"),
    (lambda _: Continuation(max_iterations=-1), "Continuation.max_iterations: -1 is out of range"),
    (lambda _: Continuation(objective="efort"), "got the text 'efort'; did you mean 'effort'"),
    (
        lambda _: Continuation(inverse="damped"),
        "expected an inverse such as MoorePenrose(), got the text 'damped'",
    ),
    (lambda _: Continuation(metric="l2"), "expected a metric such as L2Metric(), got the text 'l2'"),
    (
        lambda _: Continuation(integrator=100),
        "expected an integrator such as RungeKutta4(), got the number 100",
    ),
    (lambda _: Euler("0.1"), "Euler.gamma: expected a number > 0, got the text '0.1'"),
    (lambda _: Euler(gamma=-1), "Euler.gamma: -1 is not positive"),
    (lambda _: Ode(gamma=0), "Ode.gamma: 0 is not positive"),
    (lambda _: Adaptive(gamma=0.1), "Adaptive has no argument 'gamma'; expected one of first_radius"),
    (lambda _: Auto(restarts=-1), "Auto.restarts: -1 is out of range"),
    (lambda _: Auto(Adaptive()), "Auto.continuation: expected a Continuation, got a Adaptive"),
    (lambda _: MultiStart(starts=0), "MultiStart.starts: 0 is out of range"),
    (lambda _: RungeKutta4(0), "RungeKutta4.steps: 0 is out of range; expected a whole number from 1"),
    (lambda _: CasadiRungeKutta(steps="many"), "CasadiRungeKutta.steps: expected a whole number"),
    (lambda _: Cvodes(step=3), "Cvodes has no argument 'step'; did you mean 'steps'"),
    (lambda _: MultipleShooting(intervals=0), "MultipleShooting.intervals: 0 is out of range"),
    (
        lambda _: MultipleShooting(steps_per_interval=0),
        "MultipleShooting.steps_per_interval: 0 is out of range",
    ),
    (lambda _: MultipleShooting(interval=10), "did you mean 'intervals'"),
    (
        lambda _: MultipleShooting(optimizer="ipopt"),
        "expected an optimizer such as Ipopt(), got the text 'ipopt'",
    ),
    (lambda _: MultipleShooting(guess="straight"), "expected a guess such as StraightGuess(), got the text"),
    (
        lambda _: MultipleShooting(transcription="single"),
        "expected a class such as SingleShooting, got the text",
    ),
    (lambda _: Ipopt(tolerance=0), "Ipopt.tolerance: 0 is not positive"),
    (lambda _: Ipopt(linear_solver="ma57x"), "linear solver 'ma57x'; available"),
    (lambda _: SolverGuess(Auto), "expected a solver such as Auto(), got the class Auto"),
    (
        lambda _: Control(Fourier(2), [[1, 2]]),
        "control coefficients have shape (1, 2); expected one row per input",
    ),
    (lambda _: Control(Fourier(2), "abc"), "expected one row of numbers per input, got the text 'abc'"),
    (lambda _: Control(2, [[1]]), "Control.basis: expected a basis such as Fourier(2), got the number 2"),
    (lambda _: Control(Fourier(0), [[1]], horizon=0), "Control.horizon: 0 is not a duration"),
    (lambda _: Run(problem(), Auto, "auto"), "expected a solver such as Auto(), or a name"),
    (
        lambda _: nhpocp.solve(None),
        "problem: expected a PlanningProblem or the name of a problem file, got nothing",
    ),
    (lambda _: nhpocp.solve("absent.yaml"), "absent.yaml"),
    (lambda _: nhpocp.solve(problem(), "nlpp"), "unknown solver 'nlpp'; did you mean 'nlp'"),
    (lambda _: nhpocp.solve(problem(), Auto), "got the class Auto; write Auto()"),
    (lambda _: nhpocp.solve(problem(), 3), "expected a solver such as Auto(), or a name (jacobian, nlp"),
    (lambda _: nhpocp.compare([]), "problems: expected at least one"),
    (lambda _: nhpocp.compare(problem(), "jacobain"), "unknown solver 'jacobain'; did you mean 'jacobian'"),
    (
        lambda _: nhpocp.compare(3),
        "expected a PlanningProblem or the name of a problem file, got the number 3",
    ),
    (
        lambda _: nhpocp.plan_many(problem(), problem().goal),
        "goals, each a mapping, got a mapping; write [goal]",
    ),
    (lambda _: list(nhpocp.plan_many(problem(), [3])), "goal: expected a mapping"),
    (
        lambda _: nhpocp.analyze([problem()]),
        "expected a PlanningProblem or the name of a problem file, got a list",
    ),
    (lambda _: nhpocp.analyze(problem(), degree=0), "degree 0; expected a whole number >= 1"),
    (
        lambda _: nhpocp.simulate(problem(), [[1, 0, 0, 0, 0]]),
        "1 rows of coefficients; expected 3, one per input",
    ),
    (lambda _: nhpocp.simulate(problem(), [1, 2]), "control coefficients have shape (2,)"),
    (
        lambda _: nhpocp.verify(problem()),
        "expected a Solution or the name of its folder, got a PlanningProblem",
    ),
    (lambda _: nhpocp.verify("absent"), "absent"),
    (lambda _: nhpocp.load_problem("absent.yaml"), "absent.yaml"),
    (lambda _: nhpocp.load_problem(None), "expected the name of a problem file, got nothing"),
    (lambda _: nhpocp.load_problem("problems/paper.yaml", "horizon=2"), "write ['horizon=2']"),
    (lambda _: nhpocp.load_solution(None), "expected the name of a solution folder, got nothing"),
    (lambda _: nhpocp.load_solution("absent"), "no solution folder"),
    (lambda s: nhpocp.save_solution(s, None), "folder: expected the name of a folder, got nothing"),
    (
        lambda _: nhpocp.save_solution(problem(), "x"),
        "expected a Solution, such as solve(problem) returns, got a Pl",
    ),
    (
        lambda s: nhpocp.write_report(s, "x"),
        "expected a Comparison, such as compare(problem) returns, got a Sol",
    ),
    (
        lambda _: nhpocp.write_animation(problem(), "x"),
        "expected a Solution, or several, got a PlanningProblem",
    ),
    (lambda s: s.trajectory["lengths"], "there is no 'lengths' here; did you mean 'leg_lengths'"),
    (lambda s: s.costs["efort"], "there is no 'efort' here; did you mean 'effort'"),
    (lambda _: nhpocp.mobility(ThreeUPU(), [0, 0, 25]), "a packed state of 12 numbers"),
    (lambda _: nhpocp.mobility(Unicycle(), [0, 0, 0]), "expected a ParallelRobot, got a Unicycle"),
    (lambda _: StateSpace("position"), "StateSpace: expected a list of blocks"),
    (lambda _: StateSpace([nhpocp.direction("n")]), "n is a direction: an output, not a part of a state"),
    (lambda _: vector("p", -1), "block 'p': -1 is out of range"),
    (lambda _: vector("p", 3, "metres"), "unit 'metres'; expected 'length', 'angle', or ''"),
    (lambda _: StateSpace([scalar("x"), scalar("x")]), "are both called 'x'; rename one of them"),
    (lambda _: cart(state_space=StateSpace([scalar("t")])), "state 't' is called like something else"),
    (lambda _: cart(input_space=StateSpace([scalar("position")])), "are both called 'position'; rename"),
    (
        lambda _: cart(state_space=None),
        ".Cart has no state_space; expected a StateSpace, such as StateSpace(",
    ),
    (lambda _: cart(model=None), "expected a name as `model` of"),
    (
        lambda _: nhpocp.solve(cart(vector_fields=lambda s, x: np.eye(2))),
        "(2, 2); expected (2, 1), one row per",
    ),
    (
        lambda _: nhpocp.solve(cart(vector_fields=lambda s, x: [1.0, 0.0])),
        "is of shape (2,); expected (2, 1)",
    ),
    (
        lambda _: nhpocp.solve(cart(drift=lambda s, x: [0.0])),
        "drift(state) is of shape (1,); expected (2,)",
    ),
    (
        lambda _: nhpocp.solve(cart(vector_fields=lambda s, x: [[math.cos(x[0])], [0.0]])),
        "for symbols: TypeError: … write xp = namespace(state) and xp.cos instead of math.cos",
    ),
    (
        lambda _: nhpocp.solve(cart(vector_fields=lambda s, x: nhpocp.namespace(x).arcsine(x))),
        "namespace(…) has no 'arcsine', for it has to work on symbols too; did you mean 'arcsin'",
    ),
    (
        lambda _: nhpocp.solve(cart(vector_fields=System.vector_fields)),
        "has no vector_fields(state); write it",
    ),
]


@pytest.mark.parametrize("number", range(len(CALLS)))
def test_a_wrong_call_is_answered_in_words(number, solution):
    call, words = CALLS[number]
    with pytest.raises(nhpocp.NhpocpError) as caught:
        call(solution)
    said = str(caught.value)
    assert re.search(".*".join(map(re.escape, words.split("… "))), said), said
    assert "\n" not in said
