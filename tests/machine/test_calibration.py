"""Parameters from measured runs: derivatives, the least squares themselves, their statistics, and what is not seen."""

from functools import cache

import numpy as np
import pytest
from scipy.optimize import least_squares

import nhpocp
from nhpocp import deg
from nhpocp.calls import call
from nhpocp.controls.control import Control
from nhpocp.errors import CallError, InvalidProblemError
from nhpocp.machine.calibration.calibration import Calibrating, Ending
from nhpocp.machine.calibration.fitting import Fit
from nhpocp.machine.calibration.leg_driven_steps import Bends, LegDrivenSteps, Policy
from nhpocp.machine.calibration.measurements import measured
from nhpocp.machine.calibration.noise import Noise
from nhpocp.machine.calibration.unknowns import Unknowns
from nhpocp.machine.feedback.set_points import SetPoints, positions_function
from nhpocp.machine.feedback.simulated_plant import SimulatedPlant
from tests.conftest import paper_problem
from tests.machine.test_steering import CART

PAPER = paper_problem()
SPACE = PAPER.system.state_space
TRUTH = {"base_radius": 30.3, "platform_radius": 15.0, "roller_tilt": 77 * deg}
OTHER = [[0.2, -0.4, 0.3, 0, 0.1], [-0.1, 0.3, 0, 0.4, 0], [-0.6, 0, 0.5, 0, 0.2]]


@cache
def driven(number=0, every=4, model=PAPER.system, **parameters):
    """Times, states and leg lengths of a machine with these parameters that is told a plan's lengths."""
    machine = model.with_(**(dict(parameters) or TRUTH))
    control = Control(PAPER.basis, np.array([PAPER.initial, OTHER][number]), 1.0)
    told = SetPoints.of(PAPER, control)
    plant = SimulatedPlant(machine, PAPER.start)
    plant.command(told.values[0])
    points = [plant.point]
    for values, seconds in zip(told.values[1:], np.diff(told.times), strict=True):
        plant.command(values)
        plant.advance(seconds)
        points.append(plant.point)
    where = positions_function(machine)
    lengths = np.array([call(where, point)[0].ravel() for point in points])
    return told.times[::every], np.array(points)[::every], lengths[::every]


def noisy(times, points, lengths, seed, noise=1e-3):
    random = np.random.default_rng(seed)
    seen = np.array([SPACE.retract(x, noise * random.standard_normal(SPACE.dimension)) for x in points])
    return {
        "t": times,
        **SPACE.split(seen),
        "leg_lengths": lengths + noise * random.standard_normal(lengths.shape),
    }


def two_runs(seed=0, **more):
    return [noisy(*driven(k, **more), seed=[seed, k]) for k in (0, 1)]


@cache
def calibrating(fit=None, noise=None):
    return Calibrating.of(PAPER, fit, noise)


# --- derivatives ------------------------------------------------------------------------------------------------------

MIXED = nhpocp.ParallelRobot.preset("mixed")
ASKED = [
    (PAPER.system, "base_radius,platform_radius,roller_tilt,w4,leg_offset"),
    (PAPER.system, "roller_tilt[each],base[2],platform[1].z"),
    (PAPER.system.with_(joint="suslov"), "roller_tilt,base_radius"),
    (MIXED, "base,platform,r,w4"),
    (nhpocp.ParallelRobot.preset("braced"), "base,r,platform[4]"),
]


@pytest.mark.parametrize(("system", "asked"), ASKED)
def test_derivatives_are_those_of_differences(system, asked):
    unknowns = Unknowns.parsed(asked, system)
    equations, n, h = LegDrivenSteps(unknowns), len(unknowns), 1e-6
    motors, random = equations.motors, np.random.default_rng(1)
    point = np.asarray(PAPER.start_point)
    begun = call(positions_function(system), point)[0].ravel()
    lengths = begun + np.array(
        [[0.0] * motors, [0.1, -0.2, 0.3, 0.2][:motors], [0.3, -0.3, 0.4, 0.3][:motors]]
    )
    run = {"t": [0, 0.3, 1], **SPACE.split(np.repeat(point[None], 3, 0)), "leg_lengths": lengths}
    run = measured(run, system, "run")
    bends, values = Bends.of(run), unknowns.start + 1e-2 * random.standard_normal(n)

    def path(values, start, changes):
        policy = Policy(np.repeat(start[None], 3, 0), changes, np.zeros((2, motors, 6)))
        return equations.follow(run, bends, values, start, policy)[0]

    changes = np.diff(lengths, axis=0)
    points = path(values, point, changes)
    linear, seen = (
        equations.linearised(run, bends, values, points, changes),
        equations.observed(run, values, points),
    )
    assert np.abs(linear.defects).max() < 1e-12
    steps = [(lambda d: (values, SPACE.retract(point, d), changes), 6, linear.by_state[0])]
    steps += [(lambda d: (values, point, changes + np.outer([1, 0], d)), motors, linear.by_change[0])]
    steps += [(lambda d: (values + d, point, changes), n, linear.by_values[0])]
    for moved, count, exact in steps:
        ways = [(path(*moved(h * e))[1], path(*moved(-h * e))[1]) for e in np.eye(count)]
        differences = np.array([SPACE.difference(after, before) for after, before in ways]).T / (2 * h)
        np.testing.assert_allclose(exact, differences, atol=3e-8)
    for k in range(3):
        ways = [(SPACE.retract(points[k], h * e), SPACE.retract(points[k], -h * e)) for e in np.eye(6)]

        def residuals(values, at, k=k):
            return equations.observed(run, values, np.vstack([points[:k], [at], points[k + 1 :]])).residuals[
                k
            ]

        changed = np.array([residuals(values, a) - residuals(values, b) for a, b in ways]).T / (-2 * h)
        np.testing.assert_allclose(seen.by_state[k], changed, atol=3e-8)
        changed = np.array(
            [residuals(values + h * e, points[k]) - residuals(values - h * e, points[k]) for e in np.eye(n)]
        )
        np.testing.assert_allclose(seen.by_values[k], changed.T / (-2 * h), atol=3e-8)


def test_a_twin_in_symbols_is_the_robot_of_those_numbers():
    values = np.array([31.0, 14.0, 1.2])
    unknowns = Unknowns.parsed(None, PAPER.system)
    system = unknowns.fitted(values)
    assert system.parameters() == {
        **PAPER.system.parameters(),
        **dict(zip(unknowns.names, values, strict=True)),
    }
    for leg, own in zip(system.legs, unknowns.vectors(values), strict=True):
        for name, vector in own.items():
            np.testing.assert_allclose(getattr(leg, name), vector, atol=1e-15)


# --- the least squares ------------------------------------------------------------------------------------------------


def test_it_is_what_least_squares_finds():
    """SciPy, with a column for every unknown of a short run, and derivatives by differences."""
    noise, run = Noise(2e-3, 1e-3, 5e-3), noisy(*driven(every=40), seed=3, noise=2e-3)
    found = Calibrating.of(PAPER, "base_radius,roller_tilt", noise).run([run])
    equations = LegDrivenSteps(Unknowns.parsed("base_radius,roller_tilt", PAPER.system))
    fit = Fit(equations, [measured(run, PAPER.system, "run")], noise)
    (taken,), (bends,) = fit.runs, fit.bends
    steps, scatter, start = len(taken.times) - 1, noise.of_rows(fit.kinds), equations.unknowns.start

    def residuals(z):
        values, point = start + z[:2], SPACE.retract(taken.points[0], z[2:8])
        changes = np.diff(taken.lengths, axis=0) + z[8:].reshape(steps, 3)
        policy = Policy(np.repeat(taken.points[:1], steps + 1, 0), changes, np.zeros((steps, 3, 6)))
        points = equations.follow(taken, bends, values, np.asarray(point), policy)[0]
        prior = z[:2] / equations.unknowns.scales
        return np.concatenate(
            [(equations.observed(taken, values, points).residuals / scatter).ravel(), prior]
        )

    oracle = least_squares(residuals, np.zeros(8 + 3 * steps), method="lm", xtol=1e-12, ftol=1e-12)
    covariance = np.linalg.inv(oracle.jac.T @ oracle.jac)[:2, :2]
    deviations = np.sqrt(np.diag(covariance))
    values = np.array([each.value for each in found.estimates])
    np.testing.assert_allclose((values - start - oracle.x[:2]) / deviations, 0, atol=2e-2)
    np.testing.assert_allclose(found.covariance, covariance, rtol=2e-2)


def test_true_values_are_as_near_as_is_said():
    """Some seeds of many; the whole law is three standard deviations for 95 of 100."""
    normal = []
    for seed in range(4):
        calibration = calibrating().run(two_runs(seed))
        assert calibration.fitted, calibration.message
        normal.append([(e.value - TRUTH[e.name]) / e.deviation for e in calibration.estimates])
        assert calibration.noise.angle == pytest.approx(1e-3, rel=0.3)
        assert calibration.variance == pytest.approx(1.0, abs=0.02)
    assert np.abs(normal).max() < 3.5
    assert 0.4 < np.mean(np.square(normal)) < 2.2


def test_what_nobody_measured_is_not_seen_and_stays():
    times, points, lengths = driven()
    still = noisy(times, np.repeat(points[:1], len(times), 0), np.repeat(lengths[:1], len(times), 0), seed=1)
    calibration = calibrating().run([still])
    assert calibration.outcome is Ending.NOT_SEEN
    assert "roller_tilt is not seen by these data" in calibration.message
    assert "cannot tell platform_radius and base_radius apart" in calibration.message
    assert calibration["roller_tilt"].value == pytest.approx(75 * deg, abs=1e-6)
    assert not any(each.seen for each in calibration.estimates)
    assert np.isnan(calibration["roller_tilt"].deviation)
    # a run that moves beside it says everything
    assert calibrating().run([still, noisy(*driven(1), seed=2)]).fitted


def test_poses_may_be_missing():
    run = noisy(*driven(platform_radius=15.0, base_radius=30.0, roller_tilt=76 * deg), seed=4)
    run["position"][np.arange(len(run["t"])) % 12 > 0] = np.nan
    calibration = calibrating("roller_tilt", (1e-3, 1e-3)).run([run])
    assert calibration.fitted
    estimate = calibration["roller_tilt"]
    assert abs(estimate.value - 76 * deg) < 4 * estimate.deviation < 0.02 * deg
    assert np.isnan(calibration.residuals[0].after[1, :6]).all()
    assert np.isfinite(calibration.residuals[0].after[:, 6:]).all()


def test_encoders_that_show_something_else_are_noticed_and_fitted():
    runs = [{**run, "leg_lengths": run["leg_lengths"] + [0.2, -0.1, 0.05]} for run in two_runs(5)]
    assert any("leg_offset" in doubt for doubt in calibrating().run(runs[:1]).doubts)
    calibration = calibrating("base_radius,platform_radius,roller_tilt,leg_offset").run(runs)
    assert calibration.doubts == ()
    for i, offset in enumerate([0.2, -0.1, 0.05], 1):
        estimate = calibration[f"leg_offset[{i}]"]
        assert abs(estimate.value - offset) < 4 * estimate.deviation < 0.01
    assert "leg_offset" not in str(calibration.changes)


def test_legs_one_by_one():
    legs = [dict(leg) for leg in _legs(PAPER.system)]
    turned = PAPER.system.with_(roller_tilt=78 * deg).legs[1].r
    legs[1]["r"] = list(turned)
    machine = nhpocp.ThreeUPU(legs=legs)
    times, points, lengths = driven(model=machine, form="feedback")
    calibration = calibrating("roller_tilt[each],base[3].z").run([noisy(times, points, lengths, seed=6)])
    for number, tilt in ((1, 75), (2, 78), (3, 75)):
        estimate = calibration[f"roller_tilt[{number}]"]
        assert abs(estimate.value - tilt * deg) < 4 * estimate.deviation < 0.1 * deg
    np.testing.assert_allclose(calibration.system.legs[1].r, turned, atol=1e-3)
    assert calibration.system.legs[2].base[2] == calibration["base[3].z"].value


def _legs(system):
    return nhpocp.ThreeUPU(legs=list(system.legs)).parameters()["legs"]


@pytest.mark.parametrize("spoil", [lambda x: x * 1e300, lambda x: -x, lambda x: x[::-1]])
def test_what_is_no_motion_of_such_a_robot_is_not_fitted(spoil):
    run = noisy(*driven(every=20), seed=7)
    calibration = calibrating("roller_tilt", (1e-3, 1e-3)).run(
        [{**run, "leg_lengths": spoil(run["leg_lengths"])}]
    )
    assert calibration.outcome is Ending.NOT_CONVERGED
    assert "furthest apart in run 1 at t=" in calibration.message


def test_ctrl_c_keeps_what_was_found(monkeypatch):
    def stopped(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("nhpocp.machine.calibration.calibration.estimate_noise", stopped)
    calibration = calibrating().run(two_runs(0, every=20))
    assert calibration.outcome is Ending.INTERRUPTED
    assert calibration["roller_tilt"].value == pytest.approx(77 * deg, abs=0.01 * deg)


def test_without_noise_it_finds_the_model_again():
    run = noisy(*driven(every=2, **PAPER.system.parameters()), seed=0, noise=0.0)
    calibration = nhpocp.calibrate(PAPER, [run])
    assert calibration.fitted
    for name, value in (("base_radius", 30), ("platform_radius", 15), ("roller_tilt", 75 * deg)):
        assert calibration[name].value == pytest.approx(value, rel=1e-4)


# --- what is asked ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ("rollertilt", "did you mean 'roller_tilt'?"),
        ("base_radius,base_radius", "base_radius is given twice"),
        ("roller_tilt,roller_tilt[2]", "fit one"),
        ("base[1].x,base_radius", "base[1].x says what base_radius says"),
        ("roller_tilt[4]", "can be fitted"),
        ("", "nothing to fit"),
    ],
)
def test_names_that_are_none_are_refused(asked, words):
    with pytest.raises(InvalidProblemError) as caught:
        Unknowns.parsed(asked, PAPER.system)
    assert words in str(caught.value)


@pytest.mark.parametrize("text", ["1e-3", "0,1e-3", "a,b", "1,2,3,4"])
def test_noise_that_is_none_is_refused(text):
    with pytest.raises(InvalidProblemError, match="POSITION,ANGLE"):
        Noise.parsed(text)
    assert Noise.parsed("0.01,0.1deg") == Noise(0.01, 0.1 * deg, 0.01)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"t": [0, 0, 1]}, "rise"),
        ({"leg_lengths": [[30, 30]] * 3}, "expected 3 numbers a sample"),
        ({"orientation": [np.ones((3, 3))] * 3}, "no rotation"),
        ({"position": [[np.nan] * 3] * 3}, "no pose"),
        ({"position": None}, "position"),
    ],
)
def test_runs_that_are_none_are_refused(change, words):
    run = {
        "t": [0, 1, 2],
        "position": [[0, 0, 25]] * 3,
        "orientation": [np.eye(3)] * 3,
        "leg_lengths": [[30] * 3] * 3,
    }
    with pytest.raises(InvalidProblemError, match=words):
        calibrating().run([{**run, **change}])


def test_other_calls_are_refused():
    with pytest.raises(InvalidProblemError, match="expected a robot on legs"):
        nhpocp.calibrate(CART, two_runs())
    with pytest.raises(CallError, match=r"write \[run\]"):
        nhpocp.calibrate(PAPER, two_runs()[0])
    with pytest.raises(CallError, match="several runs"):
        nhpocp.calibrate(PAPER, [])
