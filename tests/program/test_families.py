"""Laws of whole families: what is announced in one line is what it says, and whatever follows from it agrees."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from nhpocp.constraints.bound import Bound
from nhpocp.constraints.control import ControlSize
from nhpocp.constraints.registry import KINDS, block_of, bounds_of
from nhpocp.controls.registry import BASES
from nhpocp.errors import InvalidProblemError
from nhpocp.objectives.effort import Effort
from nhpocp.objectives.objective import ControlObjective
from nhpocp.objectives.path_length import PathLength
from nhpocp.objectives.registry import OBJECTIVES, exact_costs
from nhpocp.outcome import Outcome
from nhpocp.problem_file.building import build_solver
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.settings import INVERSES, METRICS, STEP_RULES
from nhpocp.solvers.continuation.step_rules import Adaptive, Euler
from nhpocp.solvers.nlp.settings import GUESSES, OPTIMIZERS
from nhpocp.solvers.registry import SOLVERS
from nhpocp.testing import check_constraint, check_objective, check_solver, check_step_rule
from nhpocp.testing.objectives import controls
from tests.conftest import paper_problem


def test_every_member_is_called_as_it_is_announced():
    assert {name: cost.name for name, cost in OBJECTIVES.items()} == {name: name for name in OBJECTIVES}
    assert {key: kind.key for key, kind in KINDS.items()} == {key: key for key in KINDS}
    assert {name: build_solver(name).name for name in SOLVERS} == {name: name for name in SOLVERS}
    for family in (BASES, STEP_RULES, INVERSES, METRICS, GUESSES, OPTIMIZERS):
        assert {name: member.kind for name, member in family.items()} == {name: name for name in family}


@pytest.mark.parametrize("name", OBJECTIVES)
def test_objectives_keep_the_laws(name):
    check_objective(OBJECTIVES[name])


@pytest.mark.parametrize("name", KINDS)
def test_constraints_keep_the_laws(name):
    check_constraint(KINDS[name])
    check_constraint(KINDS[name], paper_problem().system)


@pytest.mark.parametrize("name", STEP_RULES)
def test_step_rules_keep_the_laws(name):
    check_step_rule(STEP_RULES[name]())


@pytest.mark.parametrize("name", SOLVERS)
def test_solvers_keep_the_laws(name):
    check_solver(SOLVERS[name]().solver(None, {}))


def test_costs_that_a_control_tells_are_told_where_it_has_them():
    for control in controls(2.5):
        for cost in OBJECTIVES.values():
            if isinstance(cost, ControlObjective):
                assert (cost.name in exact_costs(control)) is not bool(cost.lacking_control(control.basis))


def test_every_kind_of_constraint_is_read_as_it_is_written():
    system = paper_problem().system
    start = {"position": [0, 0, 25]}
    given = {key: shown for key, kind in KINDS.items() if (shown := kind.shown(system, start)) is not None}
    assert set(given) == set(KINDS)
    bounds = bounds_of(given, system)
    again = bounds_of(block_of(bounds, system), system)
    assert [(one.label, one.quantity) for one in bounds] == [(one.label, one.quantity) for one in again]


@pytest.mark.parametrize(
    "bounds",
    [
        [Bound("joint_angle.theta4", "joint_angles", [-0.1, -np.inf, -np.inf, -1], [0.1, np.inf, np.inf, 1])],
        [Bound("joint_angle.theta4", "joint_angles", upper=np.array([[9, 9, 9, k] for k in (1, 2, 3)]))],
        [Bound("joint_angle", "joint_angles", -3, 3)],
        [Bound("distance", "distance", 2.0), Bound("distance", "distance", 0.1)],
        [Bound("leg_length", "leg_lengths", 20, 60), Bound("leg_length", "leg_lengths", 30, 40)],
        [Bound("clearance.sigma_w", "sigma_w", 0.01)],
    ],
)
def test_bounds_that_a_file_would_change_are_not_written(bounds):
    with pytest.raises(InvalidProblemError, match="no word for"):
        block_of(bounds, paper_problem().system)


# --- members that break a law -----------------------------------------------------------------------------------------


class Doubled(Effort):
    def density(self, control, times):
        return 2 * super().density(control, times)


class Timeless(Effort):
    pace = 0


class Owing(PathLength):
    def integrand(self, system, state, control, length_scale):
        return super().integrand(system, state, control, length_scale) - 1e3


class Hasty(PathLength):
    pace = -1


class Deaf(PathLength):
    def integrand(self, system, state, control, length_scale):
        return abs(float(control[0]))


class Apart(PathLength):
    def searched(self, system, state, control, length_scale, rest):
        return 2 * super().searched(system, state, control, length_scale, rest)


class Called(Effort):
    name = "message"


@pytest.mark.parametrize(
    ("objective", "words"),
    [
        (Doubled(), "effort: a cost of the control is the integral of its density: no. by gram over fourier"),
        (Timeless(), "effort: the gram matrix grows with the duration as the pace says: no"),
        (Owing(), "path_length of unicycle: numbers and symbols cost alike: no. integrand is -"),
        (Hasty(), "path_length of unicycle: it grows with the duration as the pace says: no"),
        (Deaf(), "path_length of unicycle: numbers and symbols cost alike"),
        (Apart(), "path_length of unicycle: what is searched tends to it: no"),
        (Called(), "message: it says what it is: no. message means something else in files"),
    ],
)
def test_an_objective_that_breaks_a_law_is_told_which(objective, words):
    with pytest.raises(AssertionError, match=words):
        check_objective(objective)


class Halved(ControlSize):
    def value(self, bounds, system):
        return 5.0


class Foreign(ControlSize):
    def bounds(self, value, system):
        return [Bound("controls", "u", -1, 1)]


class Nowhere(ControlSize):
    def bounds(self, value, system):
        return [Bound("control", "thrust", -1, 1)]


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        (Halved(), "control: it is read as it is written: no. lower of control"),
        (Foreign(), "control: its bounds bear its key: no. a bound is labelled 'controls'"),
        (Nowhere(), "control: a problem takes its bounds: .*unknown quantity 'thrust'"),
    ],
)
def test_a_constraint_that_breaks_a_law_is_told_which(kind, words):
    with pytest.raises(AssertionError, match=words):
        check_constraint(kind)


@dataclass(frozen=True)
class Lazy(Euler):
    def updates(self, here, evaluate):
        yield here


@dataclass(frozen=True)
class Cold(Euler):
    def updates(self, here, evaluate):
        self.__dict__["gamma"] *= 0.5
        yield from super().updates(here, evaluate)


@dataclass(frozen=True)
class Secret(Euler):
    def settings(self):
        return {"gamma": (self.gamma,)}


@pytest.mark.parametrize(
    ("rule", "words"),
    [
        (Lazy(), "euler: it reaches what is easy: no. straight: "),
        (Cold(1.0), "euler: it does the same again: no"),
        (Secret(), r"euler: its settings are plain data: no. settings\(\) gives"),
    ],
)
def test_a_step_rule_that_breaks_a_law_is_told_which(rule, words):
    with pytest.raises(AssertionError, match=words):
        check_step_rule(rule)


class Boaster:
    """Claims whatever it is asked for; ``given`` may be what it is asked in."""

    name = "boaster"
    tolerance = 1e-3

    def settings(self):
        return {"tolerance": 1e-3}

    def solve(self, problem, progress=None):
        own = Continuation(step_rule=Euler(1e-6), max_iterations=1).solve(problem, progress)
        return replace(own, solver=self.name, settings=self.settings(), outcome=Outcome.CONVERGED)


class Raising(Boaster):
    def solve(self, problem, progress=None):
        if problem.bounds:
            raise ValueError("no plan")
        solution = Continuation(step_rule=Adaptive()).solve(problem, progress)
        return replace(solution, solver=self.name, settings=self.settings())


class Deafened(Boaster):
    def solve(self, problem, progress=None):
        return Raising().solve(problem)


class Loose(Boaster):
    def settings(self):
        return {"tolerance": 1.0}


@pytest.mark.parametrize(
    ("solver", "words"),
    [
        (Boaster(), "boaster: it solves what is easy: no. straight: not_verified"),
        (Raising(), "boaster: what cannot be is an outcome: ValueError: no plan"),
        (Deafened(), "boaster: it tells whoever listens: no. `progress` was never called"),
        (Loose(), r"boaster: its settings are plain data: no. settings\(\) says tolerance 1.0"),
    ],
)
def test_a_solver_that_breaks_a_law_is_told_which(solver, words):
    with pytest.raises(AssertionError, match=words):
        check_solver(solver)


@pytest.mark.parametrize("check", [check_objective, check_constraint, check_step_rule, check_solver])
def test_a_class_in_the_place_of_an_instance_is_refused(check):
    with pytest.raises(InvalidProblemError, match="expected"):
        check(Boaster)


def test_unknown_solvers_are_answered_with_those_that_there_are():
    with pytest.raises(InvalidProblemError, match=", ".join(SOLVERS)):
        build_solver("simplex")
