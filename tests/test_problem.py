"""A planning problem checks itself and says where it is wrong."""

import numpy as np
import pytest

import nhpocp
from nhpocp import so3
from nhpocp.constraints.bound import Bound
from nhpocp.controls.fourier import Fourier
from nhpocp.errors import InvalidProblemError
from nhpocp.horizon import Horizon
from nhpocp.problem import PlanningProblem
from nhpocp.systems.three_upu import ThreeUPU

POSE = {"position": [0, 0, 25], "orientation": so3.from_rpy(np.array([0, 0, -np.pi / 6]))}
GOAL = {"position": [-0.4, -0.2, 35], "orientation": so3.from_rpy(np.array([0, 0, -np.pi / 2]))}


def problem(**changes):
    return PlanningProblem(**{"system": ThreeUPU(), "start": POSE, "goal": GOAL, **changes})


@pytest.mark.parametrize(
    ("changes", "path", "words"),
    [
        ({"start": {"position": [0, 0, 25]}}, "start.orientation", "required key is missing; expected {rpy"),
        (
            {"start": {**POSE, "speed": 3}},
            "start.speed",
            "unknown key; expected one of position, orientation",
        ),
        ({"start": {}}, "start.position", "required key is missing"),
        ({"goal": {}}, "goal", "empty; expected some of position"),
        ({"goal": {"place": [0, 0, 1]}}, "goal.place", "unknown key"),
        ({"goal": {"position": [0, 0]}}, "goal.position", "2 numbers; expected 3"),
        ({"goal": {"orientation": [0, 0, 1]}}, "goal.orientation", "expected {rpy: .*, got a list of 3"),
        ({"goal": {"position": [0, np.nan, 0]}}, "goal.position", "expected finite numbers"),
        ({"start": {**POSE, "position": [0, 0, np.inf]}}, "start.position", "expected finite numbers"),
        ({"start": {**POSE, "orientation": 1.1 * np.eye(3)}}, "start.orientation", "no rotation matrix"),
        ({"goal": {"orientation": np.diag([1, 1, -1])}}, "goal.orientation", "a reflection"),
        ({"objective": "beauty"}, "objective", "none of effort, leg_effort"),
        ({"error_length": 0.0}, "error_length", "not a length > 0"),
        ({"error_length": np.nan}, "error_length", "NaN; expected a finite number"),
        ({"length_scale": -1.0}, "length_scale", "not a length > 0"),
        ({"samples": 1}, "output.samples", "at least 2"),
        (
            {"initial": np.zeros((2, 5))},
            "control.initial",
            r"2 rows; expected 3, one per input \(v\[0\], v\[1\], v\[2\]\)",
        ),
    ],
)
def test_every_misfit_is_named_with_its_path(changes, path, words):
    with pytest.raises(InvalidProblemError, match=words) as caught:
        problem(**changes)
    assert caught.value.path == path


def test_everything_that_is_wrong_is_known_at_once():
    with pytest.raises(InvalidProblemError) as caught:
        problem(start={"position": [0, 0]}, goal={"place": 1}, objective="beauty", samples=1)
    paths = [error.path for error in (caught.value, *caught.value.others)]
    assert paths == ["start.position", "start.orientation", "goal.place", "objective", "output.samples"]


def test_a_rotation_is_written_in_python_as_in_a_file():
    written = problem(start={"position": [0, 0, 25], "orientation": {"rpy": [0, 0, -np.pi / 6]}})
    np.testing.assert_array_equal(written.start["orientation"], problem().start["orientation"])


BOUNDS = {  # a bound, words
    "no such quantity": (Bound("state.positon", "positon", 0, 1), "did you mean 'position'"),
    "a rotation": (Bound("state.orientation", "orientation", 0, 1), "a rotation cannot be bounded"),
    "a determinant": (Bound("det", "det_w", 0, 1), "unknown quantity"),
    "too many numbers": (Bound("state.position", "position", [0, 0], 1), "2 bounds a side; expected 3"),
    "the wrong way round": (Bound("leg_length", "leg_lengths", 60, 20), "bound 60 is above upper bound 20"),
    "one of them": (
        Bound("state.position", "position", [0, 5, 0], [1, 4, 1]),
        "5 is above upper bound 4 in component 2",
    ),
}


@pytest.mark.parametrize("name", BOUNDS)
def test_a_bound_that_bounds_nothing_is_refused(name):
    bound, words = BOUNDS[name]
    with pytest.raises(InvalidProblemError, match=words) as caught:
        problem(bounds=[bound])
    assert caught.value.path == f"constraints.{bound.label}"


def test_coefficients_for_another_basis_are_refused():
    with pytest.raises(InvalidProblemError, match="4 numbers; expected 5"):
        problem(initial=np.zeros((3, 4)))


@pytest.mark.parametrize(
    "values", [(0.0,), (-1.0,), (np.nan,), (np.inf,), (1.0, 3.0, 2.0), (1.0, 0.0, 2.0), (1.0, 2.0, 2.0)]
)
def test_a_horizon_that_is_no_duration_is_refused(values):
    with pytest.raises(InvalidProblemError) as caught:
        Horizon(*values)
    assert caught.value.path == "horizon"


def test_a_free_horizon_has_a_fixed_value_only_if_given():
    assert not Horizon().free
    assert Horizon(2.0, 1.0, 3.0).free
    assert Horizon(2.0, 1.0, 3.0).fixed == 2
    with pytest.raises(InvalidProblemError, match="initial: 1") as caught:
        _ = Horizon(None, 1.0, 3.0).fixed
    assert caught.value.path == "horizon"


@pytest.mark.parametrize(
    ("names", "rows", "weights"),
    [
        (("position", "orientation"), [0, 1, 2, 3, 4, 5], [0.1, 0.1, 0.1, 1, 1, 1]),
        (("orientation", "position"), [0, 1, 2, 3, 4, 5], [0.1, 0.1, 0.1, 1, 1, 1]),
        (("position",), [0, 1, 2], [0.1, 0.1, 0.1]),
        (("orientation",), [3, 4, 5], [1, 1, 1]),
    ],
)
def test_free_goal_blocks_have_no_error_rows_and_no_weight(names, rows, weights):
    found = problem(goal={name: GOAL[name] for name in names}, error_length=10.0)
    assert found.tasks[-1].rows.tolist() == rows
    assert found.tasks[-1].weights.tolist() == weights
    space = found.system.state_space
    goal = space.unpack(found.goal_point)
    for name in space.names:
        assert np.allclose(goal[name], GOAL[name] if name in names else POSE[name])
    difference = space.difference(found.goal_point, found.start_point)
    assert np.allclose(np.delete(difference, rows), 0)


def test_another_goal_is_checked_and_leaves_nothing_of_the_first():
    first = problem()
    here = first.tasks, first.goal_point  # worked out and kept beside it
    goal = {"position": [1.0, 2.0, 30.0]}
    other, made = first.towards(goal), problem(goal=goal)
    np.testing.assert_array_equal(other.goal_point, made.goal_point)
    assert other.tasks[-1].rows.tolist() == made.tasks[-1].rows.tolist()
    assert (first.tasks, first.goal_point) == here
    with pytest.raises(InvalidProblemError, match="unknown key"):
        first.towards({"place": [0, 0, 0]})


def test_points_are_packed_and_read_only_copies():
    position = np.array([0.0, 0, 25])
    found = problem(start={**POSE, "position": position})
    position[:] = 9
    assert found.start_point[:3].tolist() == [0, 0, 25]
    with pytest.raises(ValueError, match="read-only"):
        found.start["position"][0] = 1


def test_scale_is_the_systems_unless_stated():
    assert problem().scale == pytest.approx(15)
    assert problem(length_scale=2.0).scale == 2


def test_control_uses_the_problems_basis_and_horizon():
    found = problem(basis=Fourier(1), horizon=Horizon(3.0), initial=np.ones((3, 3)))
    control = found.control(found.initial)
    assert (control.basis, control.horizon) == (Fourier(1), 3.0)
    assert found.control(found.initial, 5.0).horizon == 5


def test_states_in_python_take_what_files_take():
    """The contract's own example, with degrees as text."""
    start = {"position": [0, 0, 25], "orientation": {"rpy": [0, 0, "-30 deg"]}}
    task = {"start": start, "goal": {"position": [0, 0, 30]}}
    problem = PlanningProblem(system=ThreeUPU(), horizon=1.0, bounds={"leg_length": [20, 60]}, **task)
    np.testing.assert_allclose(
        problem.start["orientation"], so3.from_rpy(np.array([0, 0, -np.pi / 6])), atol=1e-15
    )
    wheel = PlanningProblem(
        system=nhpocp.Unicycle(),
        start={"x": 0, "y": 0, "theta": "30 deg"},
        goal={"x": 0, "y": 0, "theta": "pi/2"},
    )
    assert float(wheel.start["theta"]) == pytest.approx(np.pi / 6)
    assert float(wheel.goal["theta"]) == pytest.approx(np.pi / 2)
