"""Systems, problems and what they hold cannot change once made; where Python cannot forbid it, verification sees it."""

import copy
import dataclasses
import pickle

import numpy as np
import pytest

import nhpocp
from nhpocp import (
    FrozenError,
    InvalidProblemError,
    PlanningProblem,
    StateSpace,
    System,
    namespace,
    scalar,
    vector,
)
from nhpocp.constraints.bound import Bound
from nhpocp.problem_file.registry import SYSTEMS, system_class
from nhpocp.systems.heisenberg import Heisenberg
from nhpocp.systems.numeric import numeric_system
from tests.conftest import Integrators, Turntable, paper_problem

ORIGIN, UP = {"x": 0, "y": 0, "z": 0}, {"x": 0, "y": 0, "z": 1}
PAIR = {"state_space": StateSpace([vector("q", 2)]), "input_space": StateSpace([vector("u", 2)])}


def itself(made):
    return made


def pickled(made):
    return pickle.loads(pickle.dumps(made))


def loop(system):
    """Heisenberg's least loop to z = 1."""
    return PlanningProblem(
        system=system, start=ORIGIN, goal=UP, basis=nhpocp.Fourier(1), initial=[[0, 0, 1], [0, 1, 0]]
    )


class Scaled(System):
    """A user's, whose parameter is an attribute of its class, and which asks no one to initialise it."""

    model, k = "scaled", 1.0
    state_space, input_space = PAIR["state_space"], PAIR["input_space"]

    def __init__(self, gains=(1.0, 1.0)):
        self.gains = np.array(gains)
        self.table, self.names = {"first": [1.0, 2.0]}, ["a", "b"]

    def vector_fields(self, state):
        return namespace(state).matrix([[self.k * self.gains[0], 0], [0, GLOBAL * self.gains[1]]])


@dataclasses.dataclass
class Data(System):
    """Another's, which is a dataclass."""

    gain: float = 1.0
    model = "data"
    state_space, input_space = PAIR["state_space"], PAIR["input_space"]

    def vector_fields(self, state):
        return self.gain * namespace(state).eye(2)


class Inner(Scaled):
    """A third, which goes on after the class above it has finished."""

    def __init__(self):
        super().__init__([2.0, 3.0])
        self.more = 5.0


GLOBAL = 1.0
OWN = (Scaled, Data, Inner, Turntable, Integrators)
EVERY = [*(system_class(model) for model in SYSTEMS), *OWN]


@pytest.mark.parametrize("kind", EVERY, ids=lambda kind: kind.__name__)
@pytest.mark.parametrize("again", [itself, copy.copy, copy.deepcopy, pickled])
def test_no_attribute_of_a_system_can_be_assigned(kind, again):
    system = again(kind())
    numeric_system(system)  # what is kept is no obstacle to copies
    system = again(system)
    for name in (*system.declared, *vars(system), "input_space", "typo"):
        with pytest.raises(FrozenError, match=rf"make a new one: replace\(system, {name}="):
            setattr(system, name, 3)
        with pytest.raises(FrozenError):
            delattr(system, name)
    assert not hasattr(system, "typo")


@pytest.mark.parametrize("kind", EVERY, ids=lambda kind: kind.__name__)
def test_a_replaced_system_has_everything_else_as_it_was(kind):
    system = kind()
    same = nhpocp.replace(system)
    assert same is not system
    assert same.parameters() == system.parameters()
    for name, parameter in system.declared.items():
        if parameter.kind in ("positive", "number"):
            changed = system.with_(**{name: 0.75})
            assert changed.parameters() == {**system.parameters(), name: 0.75}


def test_replace_asks_for_what_it_cannot_know():
    class Secret(Data):
        def __init__(self, gain=1.0):
            self.hidden = gain

    with pytest.raises(InvalidProblemError, match="does not say what its 'gain' is"):
        Secret(3.0).with_()
    assert Secret(3.0).with_(gain=2.0).hidden == 2.0
    assert Data(3.0).with_().gain == 3.0


def test_what_an_attribute_holds_is_a_copy_that_stays_as_it_is():
    gains = np.array([1.0, 2.0])
    system = Scaled(gains)
    gains[0] = 7.0
    assert system.gains[0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        system.gains[0] = 3.0
    for change in (
        lambda: system.table.update(first=1),
        lambda: system.table.__setitem__("first", 1),
        lambda: system.table["first"].append(1),
        lambda: system.table["first"].__setitem__(0, 1),
        lambda: system.names.sort(),
    ):
        with pytest.raises(FrozenError, match="make a new object"):
            change()
    assert system.table == {"first": [1.0, 2.0]}
    assert {**system.table, "second": 2}["second"] == 2
    assert [*system.names, "c"] == ["a", "b", "c"]


def test_spaces_are_frozen():
    for change in ({"blocks": ()}, {"size": 3}, {"typo": 1}):
        for name, value in change.items():
            with pytest.raises(FrozenError, match="replace"):
                setattr(PAIR["state_space"], name, value)
    with pytest.raises(FrozenError):
        PAIR["state_space"]._points["q"] = slice(0, 1)
    assert PAIR["state_space"].with_(blocks=[scalar("x")]) == StateSpace([scalar("x")])


@pytest.mark.parametrize("again", [itself, copy.copy, copy.deepcopy, pickled])
def test_no_part_of_a_problem_can_be_changed(again):
    limits, place = np.array([9.0, 9.0, 40.0]), np.array([0.0, 0.0, 25.0])
    bounds = [Bound("state.position", "position", -limits, limits)]
    start = {**paper_problem().start, "position": place}
    problem = again(paper_problem(bounds=bounds, start=start, reference={"nlp": {"effort": 2}}))
    limits[0] = place[0] = 5.0
    assert problem.start["position"][0] == 0
    for name in ("goal", "horizon", "typo"):
        with pytest.raises(FrozenError, match=rf"a problem is frozen once made.*replace\(problem, {name}="):
            setattr(problem, name, 3)
    for change in (
        lambda: problem.start.update(position=3),
        lambda: problem.goal.__setitem__("position", 3),
        lambda: problem.reference["nlp"].clear(),
        lambda: problem.towards(problem.goal).goal.popitem(),
    ):
        with pytest.raises(FrozenError, match="make a new object"):
            change()
    ends = (problem.start_point, problem.goal_point, problem.towards(problem.goal).goal_point)
    for array in (problem.start["position"], problem.goal["orientation"], problem.bounds[0].upper, *ends):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
    assert problem.with_(samples=11).samples == nhpocp.replace(problem, samples=11).samples == 11


@pytest.mark.parametrize("solver", [None, nhpocp.MultipleShooting(intervals=40)], ids=["jacobian", "nlp"])
def test_a_system_is_solved_as_it_is_whatever_was_solved_before(solver):
    """[Brockett]: 2π |z| / c, a circle; 2N tan(π/N) with N pieces."""
    solver = solver or nhpocp.Continuation(objective="effort")
    for scale in (1.0, 0.5, 2.0):
        problem = loop(Heisenberg(scale))
        plan = nhpocp.solve(problem, solver)
        assert plan.converged
        assert plan.control.effort == pytest.approx(2 * np.pi / scale, rel=3e-3)
    half = nhpocp.solve(problem.with_(system=nhpocp.replace(problem.system, scale=0.5)), solver)
    assert half.converged
    assert half.control.effort == pytest.approx(12.566, rel=3e-3)


@pytest.mark.parametrize(
    "solver", [nhpocp.Continuation(), nhpocp.MultipleShooting(intervals=5)], ids=lambda s: s.name
)
@pytest.mark.parametrize("where", ["class", "global"])
def test_what_cannot_be_frozen_is_seen_by_verification_and_then_by_solvers(solver, where, monkeypatch):
    problem = PlanningProblem(
        system=Scaled(), start={"q": [0, 0]}, goal={"q": [1, 1]}, basis=nhpocp.Fourier(0)
    )
    first = nhpocp.solve(problem, solver)
    assert first.converged
    if where == "class":
        monkeypatch.setattr(Scaled, "k", 2.0)
    else:
        monkeypatch.setitem(globals(), "GLOBAL", 2.0)
    assert not nhpocp.verify(first).ok
    stale = nhpocp.solve(problem, solver)
    assert stale.outcome.value == "not_verified"
    assert stale.verdict.error == pytest.approx(1.0, abs=5e-3)
    fresh = nhpocp.solve(problem, solver)
    assert fresh.converged
    assert fresh.control.effort == pytest.approx(1.25, rel=5e-3)


def test_verification_shares_no_function_with_solvers(problem):
    problem = problem.with_(
        system=nhpocp.replace(problem.system)
    )  # the tests share theirs, and this one is spoilt
    plan = nhpocp.solve(problem, nhpocp.Continuation())
    wrong = numeric_system(problem.with_(system=problem.system.with_(base_radius=20.0)).system)
    vars(numeric_system(problem.system)).update(vars(wrong), system=problem.system)
    vars(numeric_system(problem.system))["rate_function"] = wrong.rate_function
    assert nhpocp.verify(plan).ok
