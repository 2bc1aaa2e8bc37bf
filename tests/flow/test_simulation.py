"""Sampled motions and their costs, against SciPy and closed forms."""

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

from nhpocp.flow.simulation import simulate
from nhpocp.flow.step_error import settled_path
from nhpocp.problem import PlanningProblem
from nhpocp.systems.numeric import NumericSystem
from nhpocp.systems.unicycle import Unicycle
from tests.conftest import PAPER_START, paper_problem


@pytest.mark.parametrize("samples", [2, 37, 201])
def test_samples_match_an_independent_integration(samples):
    problem = paper_problem(samples=samples)
    numeric = NumericSystem(problem.system)
    control = problem.control(PAPER_START)
    found = simulate(problem, control).trajectory

    def rate(t, x):
        return np.array(numeric.rate_function(x, control(t)[0])).ravel()

    exact = solve_ivp(rate, (0, 1), problem.start_point, "DOP853", found["t"], rtol=1e-11, atol=1e-12).y.T
    np.testing.assert_allclose(found["position"], exact[:, :3], atol=1e-9)
    np.testing.assert_allclose(found["orientation"].reshape(-1, 9), exact[:, 3:], atol=1e-10)
    assert set(found) == {
        *("t", "position", "orientation", "v", "u", "leg_lengths", "joint_angles", "platform_normal"),
        *("sigma_s", "sigma_w", "det_s", "det_w"),
    }


def test_steps_are_doubled_until_the_path_is_settled():
    """Merged manoeuvres are one smooth piece that may take tens of thousands."""
    problem = PlanningProblem(
        system=Unicycle(), start={"x": 0.0, "y": 0.0, "theta": 0.0}, goal={"x": 1.0, "y": 0.0, "theta": 0.0}
    )
    control = problem.control(np.array([[5.0, 0.0, 4.0, 0.0, 0.0], [0.0, 3e3, 0.0, 0.0, 4e3]]))
    times, path = settled_path(problem, control, 800)
    assert len(times) - 1 > 16 * 800
    x, y = (
        quad(lambda t, part=part: control(t)[0, 0] * part(_heading(t)), 0.0, 1.0, limit=10_000)[0]
        for part in (np.cos, np.sin)
    )
    np.testing.assert_allclose(path[-1, :2], [x, y], atol=1e-6)


def _heading(t):
    turn = 2.0 * np.pi
    return 3e3 * (1.0 - np.cos(turn * t)) / turn + 4e3 * np.sin(2.0 * turn * t) / (2.0 * turn)


def test_costs():
    problem = paper_problem()
    control = problem.control(PAPER_START)
    motion = simulate(problem, control)
    assert motion.costs["effort"] == pytest.approx(1 + 3 * 0.125)  # ∫|v|² = Σλ₀² + ½ Σλ²
    fine = simulate(paper_problem(samples=4001), control)
    legs = np.trapezoid(np.sum(fine.trajectory["u"] ** 2, axis=1), fine.trajectory["t"])
    assert motion.costs["leg_effort"] == pytest.approx(legs, rel=1e-5)
    assert motion.costs["path_length"] == pytest.approx(fine.costs["path_length"], rel=1e-5)


def test_path_length_of_a_pure_turn_is_the_angle_times_the_length_scale():
    """β = 90°, w4 normal, on the axis: a constant turn climbs the curve of [physics §3]."""
    problem = paper_problem("paper_conjecture", length_scale=7.0)
    coefficients = np.zeros((3, 5))
    coefficients[2, 0] = np.pi / 3
    motion = simulate(problem, problem.control(coefficients))
    assert motion.trajectory["position"][-1] == pytest.approx([0, 0, 36.06993827482299], abs=1e-9)

    def rho(psi):
        return np.sqrt(15**2 + 5**2 - 150 * np.cos(psi))

    def speed(psi):  # of (z, 7 ψ); z/ρ is constant
        return np.hypot(25 / rho(np.pi / 6) * 75 * np.sin(psi) / rho(psi), 7.0)

    exact = quad(speed, np.pi / 6, np.pi / 2)[0]
    assert motion.costs["path_length"] == pytest.approx(exact, rel=1e-6)
