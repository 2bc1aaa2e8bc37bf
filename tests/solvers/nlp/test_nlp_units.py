"""One robot in other units: the NLP solver sees the same numbers, and finds the same plan."""

import numpy as np
import pytest

from nhpocp import planning
from nhpocp.constraints.bound import Bound
from nhpocp.flow.compiled.kernels import Interpreted
from nhpocp.horizon import Horizon
from nhpocp.problem import PlanningProblem
from nhpocp.solvers.nlp.ipopt import Ipopt
from nhpocp.solvers.nlp.multiple_shooting import MultipleShooting
from nhpocp.systems.three_upu import ThreeUPU
from tests.conftest import PAPER_START, yaw

UNITS = [(1e-3, 1e3), (1e3, 1e-3)]  # of length and time


def posed(length, time, objective):
    """The paper's task under active bounds, in a unit in which its lengths and times are so many times as large."""
    free = Horizon(time, 0.2 * time, 5 * time)
    return PlanningProblem(
        system=ThreeUPU(base_radius=30 * length, platform_radius=15 * length),
        start={"position": [0, 0, 25 * length], "orientation": yaw(-np.pi / 6)},
        goal={"position": [-0.4 * length, -0.2 * length, 35 * length], "orientation": yaw(-np.pi / 2)},
        initial=PAPER_START / time,
        horizon=free if objective == "time" else Horizon(time),
        objective=objective,
        error_length=length,
        bounds=[
            Bound("control", "v", -1.8 / time, 1.8 / time),
            Bound("leg_length", "leg_lengths", 30 * length, 60 * length),
        ],
    )


def planned(length, time, objective):
    solver = MultipleShooting(
        intervals=8, steps_per_interval=2, optimizer=Ipopt(tolerance=1e-4), kernels=Interpreted()
    )
    return planning.solve(posed(length, time, objective), solver)


@pytest.mark.parametrize("objective", ["effort", "leg_effort", "path_length", "time"])
def test_a_plan_is_the_same_in_every_unit(objective):
    middle = planned(1.0, 1.0, objective)
    assert middle.converged, middle.message
    for length, time in UNITS:
        other = planned(length, time, objective)
        assert other.converged, other.message
        assert abs(len(other.iterations) - len(middle.iterations)) <= 2
        assert abs(other.evaluations - middle.evaluations) <= 2
        controls = middle.control.coefficients, other.control.coefficients * time
        np.testing.assert_allclose(controls[1], controls[0], atol=1e-6 * np.abs(controls[0]).max())
        assert other.control.horizon == pytest.approx(time * middle.control.horizon, rel=1e-6)
        power = {"effort": (0, -1), "leg_effort": (2, -1), "path_length": (1, 0), "time": (0, 1)}[objective]
        factor = length ** power[0] * time ** power[1]
        assert other.details["objective_value"] == pytest.approx(
            factor * middle.details["objective_value"], rel=1e-6
        )
        units = np.array([length, length, length, 1, 1, 1]) / factor
        costates = [np.array(solution.details["costates"]) for solution in (middle, other)]
        np.testing.assert_allclose(costates[1] * units, costates[0], atol=1e-5 * np.abs(costates[0]).max())
