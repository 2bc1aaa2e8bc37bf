"""Bounds along a path."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nhpocp.constraints.bound import Bound, check_bounds
from nhpocp.horizon import Horizon
from nhpocp.problem import PlanningProblem
from nhpocp.systems.three_upu import ThreeUPU

LAW = settings(max_examples=50, deadline=None, derandomize=True)
TIMES = np.linspace(0, 1, 5)
numbers = st.floats(-10, 10)


@LAW
@given(st.lists(numbers, min_size=1, max_size=6), numbers, numbers)
def test_excess_is_the_distance_to_the_interval(values, one, other):
    lower, upper = sorted((one, other))
    values = np.array(values)
    excess = Bound("b", "q", lower, upper).excess(values)
    assert np.array_equal(excess, np.abs(values - np.clip(values, lower, upper)))


def test_bounds_broadcast_over_components():
    bound = Bound("b", "q", lower=[0, -np.inf, -1], upper=[1, 5, np.inf])
    values = np.array([[0.5, -100, 100], [-2, 7, -4]])
    assert bound.excess(values).tolist() == [[0, 0, 0], [2, 2, 3]]


@LAW
@given(lower=st.floats(1, 100), below=st.floats(0.01, 0.9), wider=st.floats(1, 1e9))
def test_widening_one_side_never_excuses_the_other(lower, below, wider):
    """A limit is judged by its own size: [36, 1e5] is as strict below as [36, 60]."""
    values = np.array([[lower * (1 - below)]])
    for upper in (lower, lower + wider, np.inf):
        (report,) = check_bounds([Bound("b", "q", lower, upper)], np.array([0.0]), {"q": values})
        assert not report.ok
        assert report.worst == pytest.approx(lower * below)


def test_each_component_is_judged_by_its_own_limit():
    bound = Bound("b", "q", [-1e5, 27.0], [1e5, 30.0])
    (report,) = check_bounds([bound], np.array([0.0]), {"q": np.array([[0.0, 25.0]])})
    assert (report.ok, report.component, report.worst) == (False, (1,), 2.0)


def test_a_limit_of_zero_counts_in_its_own_unit():
    (report,) = check_bounds([Bound("b", "q", 0.0, np.inf)], np.array([0.0]), {"q": np.array([-2e-3])})
    assert not report.ok


def test_the_worst_component_and_time_are_named():
    values = np.zeros((5, 2, 3))
    values[1, 0, 2], values[3, 1, 0] = 1.5, -4
    (report,) = check_bounds([Bound("leg_length", "l", -1, 1)], TIMES, {"l": values})
    assert (report.worst, report.time, report.component, report.ok) == (3, 0.75, (1, 0), False)
    assert report.describe() == "leg_length[1][0] is -4 at t=0.75, outside [-1, 1]"
    assert (report.value, report.allowed) == (-4, 0.001)


def test_a_scalar_quantity_has_no_component():
    (report,) = check_bounds([Bound("margin", "s", lower=0.5)], TIMES, {"s": np.array([1, 1, 0.25, 1, 1])})
    assert (report.component, report.time, report.worst) == ((), 0.5, 0.25)
    assert report.describe() == "margin is 0.25 at t=0.5, below 0.5"


@pytest.mark.parametrize(
    ("lower", "upper", "words"),
    [
        (0.0, 2.0, "outside [0, 2]"),
        ([0.0, -np.inf, 0.0], [2.0, 4.0, 2.0], "above 4"),
        ([[0.0], [-np.inf]], 4.0, "above 4"),
        (-np.inf, [[0.0, 4.0, 0.0]], "above 4"),
    ],
)
def test_the_limit_of_the_component_is_named(lower, upper, words):
    values = np.ones((5, 2, 3))
    values[2, 1, 1] = 9
    (report,) = check_bounds([Bound("b", "q", lower, upper)], TIMES, {"q": values})
    assert report.component == (1, 1)
    assert report.describe() == f"b[1][1] is 9 at t=0.5, {words}"


def test_a_tiny_relative_excess_is_forgiven():
    values = {"q": np.full(5, 40.02)}
    bound = Bound("b", "q", upper=40)
    assert check_bounds([bound], TIMES, values)[0].ok
    assert not check_bounds([bound], TIMES, values, relative_tolerance=1e-4)[0].ok


@pytest.mark.parametrize("place", range(5))
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_what_is_no_number_never_passes(place, bad):
    values = np.zeros((5, 2))
    values[place, 1] = bad
    (report,) = check_bounds([Bound("b", "q", -1, 1)], TIMES, {"q": values})
    assert not report.ok
    assert report.worst == np.inf
    assert (report.time, report.component) == (TIMES[place], (1,))


def test_every_bound_gets_its_own_report_in_order():
    bounds = [Bound("a", "q", upper=1), Bound("b", "w", lower=0)]
    reports = check_bounds(bounds, TIMES, {"q": np.zeros(5), "w": -np.ones(5)})
    assert [report.bound for report in reports] == bounds
    assert [report.ok for report in reports] == [True, False]


# --- what a tolerance is a share of -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("lower", "upper", "coordinate", "sizes"),
    [
        (20.0, 60.0, False, (20.0, 60.0)),  # a length counts from 0
        (-200.0, 200.0, False, (200.0, 200.0)),
        (0.0, np.inf, False, (15.0, 15.0)),  # nothing but the quantity's own scale
        (0.0, 0.1, False, (0.1, 0.1)),
        (0.0, 0.0, False, (15.0, 15.0)),
        (1e-9, np.inf, False, (1.5e-3, 15.0)),  # as good as 0
        (-np.inf, 1000.0, True, (15.0, 15.0)),  # where 0 lies says nothing of a coordinate
        (999.5, 1000.0, True, (0.5, 0.5)),
        (0.0, 0.0, True, (15.0, 15.0)),
        (-0.1, np.inf, True, (0.1, 15.0)),
    ],
)
@given(unit=st.floats(1e-9, 1e9))
@settings(max_examples=5, deadline=None)
def test_sizes_of_limits(lower, upper, coordinate, sizes, unit):
    bound = Bound("b", "q", lower * unit, upper * unit, 15.0 * unit, coordinate)
    found = [size for size, side in zip(bound.sizes, (lower, upper), strict=True) if np.isfinite(side)]
    wanted = [size * unit for size, side in zip(sizes, (lower, upper), strict=True) if np.isfinite(side)]
    np.testing.assert_allclose(found, wanted, rtol=1e-9)


def test_a_problem_says_what_its_quantities_measure():
    """States and inputs by their units, outputs by what these change of them."""
    quantities = ("position", "v", "u", "leg_lengths", "joint_angles", "sigma_w")
    scales = []
    for s, tau in ((1.0, 1.0), (1e-3, 1e3)):
        problem = PlanningProblem(
            system=ThreeUPU(base_radius=30 * s, platform_radius=15 * s),
            start={"position": [0, 0, 25 * s], "orientation": np.eye(3)},
            goal={"position": [0, 0, 30 * s]},
            horizon=Horizon(tau),
            bounds=[Bound(name, name, 0.0) for name in quantities],
        )
        assert [bound.coordinate for bound in problem.bounds] == [True, *[False] * 5]
        scales.append(np.array([bound.scale for bound in problem.bounds]))
    assert scales[0][:2].tolist() == [15.0, 1.0]
    assert 1 < scales[0][2] < 1000
    np.testing.assert_allclose(scales[1] / scales[0], [1e-3, 1e-3, 1e-6, 1e-3, 1, 1], rtol=1e-6)
