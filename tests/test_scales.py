"""What counts as 1: a problem in other units has the same numbers, once they are divided by its scales."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nhpocp.constraints.bound import Bound
from nhpocp.horizon import Horizon
from nhpocp.objectives.registry import OBJECTIVES
from nhpocp.problem import PlanningProblem
from nhpocp.state_space import StateSpace, scalar, vector
from nhpocp.systems.heisenberg import Heisenberg
from nhpocp.systems.rolling_sphere import RollingSphere
from nhpocp.systems.system import System
from nhpocp.systems.three_upu import ThreeUPU
from nhpocp.systems.unicycle import Unicycle
from nhpocp.via import Via
from tests.conftest import paper_problem

FACTORS = st.floats(1e-9, 1e9)


class Mixed(System):
    """Lengths and numbers without unit, and no length of its own."""

    model = "mixed"
    state_space = StateSpace([vector("p", 2, "length"), scalar("q")])
    input_space = StateSpace([vector("v", 2, "length"), scalar("rate")])

    def vector_fields(self, state):
        return np.eye(3)


def unicycle(s=1.0, tau=1.0):
    return PlanningProblem(
        system=Unicycle(),
        start={"x": 1000.0 * s, "y": 0.0, "theta": 0.0},
        goal={"x": 1001.0 * s, "y": 0.5 * s, "theta": 1.0},
        via=[Via(0.5, {"y": 3.0 * s})],
        horizon=Horizon(2.0 * tau),
        error_length=0.7 * s,
    )


def sphere(s=1.0, tau=1.0):
    turned = np.eye(3)
    return PlanningProblem(
        system=RollingSphere(radius=0.3 * s, contact="marble"),
        start={"position": [0.0, 0.0], "orientation": turned},
        goal={"position": [5.0 * s, 0.0], "orientation": turned},
        horizon=Horizon(None, 1.0 * tau, 4.0 * tau),
    )


def robot(s=1.0, tau=1.0, form="feedback"):
    return PlanningProblem(
        system=ThreeUPU(base_radius=30 * s, platform_radius=15 * s, form=form),
        start={"position": [0.0, 0.0, 25.0 * s], "orientation": np.eye(3)},
        goal={"position": [0.0, 1.0 * s, 30.0 * s]},
        horizon=Horizon(3.0 * tau),
        error_length=s,
    )


def mixed(s=1.0, tau=1.0):
    return PlanningProblem(
        system=Mixed(),
        start={"p": [0.0, 0.0], "q": 0.0},
        goal={"p": [0.0, 0.0], "q": 0.0},
        bounds=[Bound("state.p", "p", [-s, -2.0 * s], [s, np.inf]), Bound("state.q", "q", 0.0, 5.0)],
        horizon=Horizon(tau),
        error_length=s,
    )


PROBLEMS = {
    "unicycle": unicycle,
    "sphere": sphere,
    "robot": robot,
    "robot by its legs": lambda s=1.0, tau=1.0: robot(s, tau, "original"),
    "mixed": mixed,
}


@pytest.mark.parametrize("make", PROBLEMS.values(), ids=PROBLEMS)
@settings(max_examples=20, deadline=None)
@given(s=FACTORS, tau=FACTORS)
def test_scales_follow_the_units(make, s, tau):
    before, after = make().scales, make(s, tau).scales
    assert after.length == pytest.approx(s * before.length, rel=1e-12, abs=0)
    assert after.radius == pytest.approx(s * before.radius, rel=1e-12, abs=0)
    assert after.time == pytest.approx(tau * before.time, rel=1e-12, abs=0)
    assert after.number == before.number
    units = {"length": s, "angle": 1.0, "": 1.0}
    system = make().system
    by_state = np.array([units[unit] for unit in system.state_space.tangent_units])
    by_input = np.array([units[unit] for unit in system.input_space.tangent_units]) / tau
    np.testing.assert_allclose(after.states, by_state * before.states, rtol=1e-12)
    np.testing.assert_allclose(after.inputs, by_input * before.inputs, rtol=1e-12)


@pytest.mark.parametrize(
    ("make", "lengths", "times"),
    [
        (PROBLEMS["robot"], {"effort": 0, "leg_effort": 2, "path_length": 1, "time": 0}, (-1, -1, 0, 1)),
        (PROBLEMS["robot by its legs"], {"effort": 2, "leg_effort": 2}, (-1, -1)),
    ],
)
def test_objectives_have_their_units(make, lengths, times):
    s, tau = 1e-3, 1e3
    for (name, by_length), by_time in zip(lengths.items(), times, strict=True):
        factor = OBJECTIVES[name].scale(make(s, tau).scales) / OBJECTIVES[name].scale(make().scales)
        assert factor == pytest.approx(s**by_length * tau**by_time, rel=1e-12)


def test_a_mechanism_lends_its_own_length_others_what_they_are_to_cover():
    assert robot().scales.length == 15.0
    assert unicycle().scales.length == 3.0  # a via pose counts too, and where the origin lies does not
    assert sphere().scales.length == 0.3
    assert mixed().scales.length == 2.0
    assert mixed().scales.number == 5.0


def test_where_nothing_is_to_be_covered_there_are_scales_still():
    at = {"x": 5.0, "y": 0.0, "theta": 0.0}
    resting = PlanningProblem(system=Unicycle(), start=at, goal=at, error_length=0.01)
    assert resting.scales.length == 0.01
    here = {"x": 1.0, "y": 1.0, "z": 1.0}
    assert PlanningProblem(system=Heisenberg(), start=here, goal=here).scales.number == 1.0


@settings(max_examples=20, deadline=None)
@given(z=st.floats(1e-5, 1e9))
def test_numbers_without_unit_are_measured_by_the_task(z):
    zero = {"x": 0.0, "y": 0.0, "z": 0.0}
    problem = PlanningProblem(system=Heisenberg(), start=zero, goal={**zero, "z": z}, horizon=Horizon(4.0))
    np.testing.assert_array_equal(problem.scales.states, [z, z, z])
    np.testing.assert_allclose(problem.scales.inputs, z / 4.0)


def test_another_goal_has_scales_of_its_own():
    problem = unicycle()
    assert problem.scales.length == 3.0
    assert problem.towards({"x": 1010.0}).scales.length == 10.0


def test_every_objective_has_a_scale():
    for make in PROBLEMS.values():
        for objective in OBJECTIVES.values():
            assert objective.scale(make().scales) > 0
    assert OBJECTIVES["effort"].scale(paper_problem().scales) == 1.0
