"""Growth vectors: the known ones, those of singular points, and that no unit changes them."""

from __future__ import annotations

from typing import ClassVar

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nhpocp.analysis.growth import Fields, Scales, filtration, rank_losses
from nhpocp.analysis.spectrum import Spectrum
from nhpocp.analysis.verdict import Reserve, pieces_of, verdict
from nhpocp.arrays import namespace
from nhpocp.constraints.bound import Bound
from nhpocp.problem import PlanningProblem
from nhpocp.problem_file.registry import system_class
from nhpocp.state_space import StateSpace, scalar
from nhpocp.systems.system import System
from nhpocp.systems.three_upu import ThreeUPU
from tests import wheels
from tests.conftest import Integrators, Turntable, paper_problem
from tests.ferry import Ferry

TOLERANCE = 1e-8


class Plane(System):
    """Two fields on R³."""

    state_space = StateSpace([scalar("x"), scalar("y"), scalar("z")])
    input_space = StateSpace([scalar("u1"), scalar("u2")])

    def height(self, x, y):
        """What the second field climbs."""
        raise NotImplementedError

    def vector_fields(self, state):
        return namespace(state).matrix([[1, 0], [0, 1], [0 * state[0], self.height(state[0], state[1])]])


class Martinet(Plane):
    """ż = x²/2 u2: growth (2, 3), but (2, 2, 3) where x = 0."""

    model: ClassVar[str] = "martinet"

    def height(self, x, y):
        return 0.5 * x * x


class Cubic(Plane):
    """ż = x³ u2: (2, 2, 2, 3) where x = 0."""

    model: ClassVar[str] = "cubic"

    def height(self, x, y):
        return x * x * x


class Leaves(Plane):
    """ż = y u2 keeps z - y²/2: involutive, though no field is constant."""

    model: ClassVar[str] = "leaves"

    def height(self, x, y):
        return y


class Grushin(System):
    """ẋ = u1, ẏ = x u2: the second field vanishes where x = 0."""

    model: ClassVar[str] = "grushin"
    state_space = StateSpace([scalar("x"), scalar("y")])
    input_space = StateSpace([scalar("u1"), scalar("u2")])

    def vector_fields(self, state):
        return namespace(state).matrix([[1, 0], [0, state[0]]])


class Springs(System):
    """A linear system ẋ = A x + b u of two integrators: with drift, Kalman's rank is that of the brackets."""

    model: ClassVar[str] = "springs"
    state_space = StateSpace([scalar("x"), scalar("v"), scalar("w")])
    input_space = StateSpace([scalar("u")])

    def vector_fields(self, state):
        return namespace(state).array([[0.0], [0.0], [1.0]])

    def drift(self, state):
        return namespace(state).vector([state[1], state[2], -state[0]])


def grown(system, *points, length=1.0, limit=6, tolerance=TOLERANCE):
    fields = Fields(system, Scales(length, 1.0))
    return filtration(fields, np.array(points, dtype=float), tolerance, limit)


def start(model, **values):
    system = system_class(model)()
    return system, system.state_space.pack({name: np.array(value) for name, value in values.items()})


KNOWN = {
    "heisenberg": ((2, 3), {"x": 0.3, "y": -1.0, "z": 2.0}, {}),
    "free_nilpotent_36": ((3, 6), {"x": [1, 2, 3], "z": [0, 1, 0]}, {}),
    "unicycle": ((2, 3), {"x": 1.0, "y": 2.0, "theta": 0.4}, {}),
    "veselova_joint": ((2, 3), {"orientation": np.eye(3)}, {}),
    "suslov_joint": ((2, 3), {"orientation": np.eye(3)}, {}),
    "rolling_sphere": ((2, 3, 5), {"position": [1, 2], "orientation": np.eye(3)}, {}),
    "rolling_sphere, marble": ((3, 5), {"position": [1, 2], "orientation": np.eye(3)}, {"contact": "marble"}),
    "chained": ((2, 3, 4, 5, 6, 7), {"x": [0.1] * 7}, {"n": 7}),
    "engel": ((2, 3, 4), {"x": 0.1, "y": 0.2, "z": 0.3, "v": 0.4}, {}),
    "cartan": ((2, 3, 5), {"x": 0.1, "y": 0.2, "z": 0.3, "v": 0.4, "w": 0.5}, {}),
    "car": ((2, 3, 4), {"x": 0, "y": 0, "theta": 0.2, "phi": 0.1}, {}),
    "car_with_trailers": ((2, 3, 4, 5), {"x": 0, "y": 0, "theta": [0, 0.2, 0.3]}, {"lengths": [1, 1]}),
    "car_with_trailers, off the axle": (
        (2, 3, 5),
        {"x": 0, "y": 0, "theta": [0, 0.2, 0.3]},
        {"lengths": [1, 1], "hitch_offsets": [0.2, 0.3]},
    ),
    "nonholonomic_manipulator": ((2, 3, 4, 5), {"phi": 0, "theta": [0.1, 0.2, 0.3, 0]}, {"gains": [1, 1, 1]}),
    "passive_sphere": ((3, 5), {"orientation": np.eye(3), "alpha": [0, 1.5]}, {}),
    "friction_drive_wrist": ((2, 3), {"orientation": np.eye(3)}, {}),
    "trident_snake": ((3, 6), {"x": 0, "y": 0, "theta": 0, "phi": [0.1, 0.2, 0.3]}, {}),
    "mobile_manipulator": ((4, 5), {"x": 0, "y": 0, "theta": 0, "q": [0.1, 0.2]}, {}),
    "sphere_on_sphere": ((2, 3, 5), {"contact_point": [0.1, 0.2], "orientation": np.eye(3)}, {}),
    "sphere_on_sphere, marble": (
        (3, 5),
        {"contact_point": [0.1, 0.2], "orientation": np.eye(3)},
        {"contact": "marble"},
    ),
}


@pytest.mark.parametrize(
    ("headings", "vector"),
    [
        ([0, np.pi / 2, np.pi / 2], (2, 3, 4, 4, 5)),
        ([0, 0.3, 0.3 + np.pi / 2], (2, 3, 4, 5)),
        ([0, np.pi / 2, np.pi, np.pi], (2, 3, 4, 4, 5, 5, 5, 6)),
    ],
    ids=["folded at the tractor", "folded behind", "folded twice"],
)
def test_a_folded_train_loses_steps(headings, vector):
    """[Jean]: the degree rises, for two trailers to 5 and for three to 8, Fibonacci's numbers."""
    system = system_class("car_with_trailers")(lengths=[1] * (len(headings) - 1))
    (growth,) = grown(system, [0, 0, *headings], limit=9).points
    assert growth.vector == vector


def test_balls_of_one_size_go_nowhere_else():
    """Rubber at 1:1 is integrable: two dimensions, and `analyze` says so."""
    system = system_class("sphere_on_sphere")(ratio=1)
    point = system.state_space.pack({"contact_point": np.array([0.1, 0.2]), "orientation": np.eye(3)})
    found = grown(system, point)
    assert found.points[0].vector == (2,)
    assert verdict(found, ["here"], TOLERANCE).kind != "controllable"


@pytest.mark.parametrize("case", KNOWN)
def test_known_growth_vectors(case):
    vector, values, parameters = KNOWN[case]
    system = system_class(case.partition(",")[0])(**parameters)
    point = system.state_space.pack({name: np.array(value) for name, value in values.items()})
    found = grown(system, point)
    (growth,) = found.points
    assert growth.vector == found.generic.vector == vector
    assert growth.degree == len(vector)
    assert len(growth.basis) == growth.dimension
    assert found.settled
    assert verdict(found, ["here"], TOLERANCE).kind == "controllable"


@pytest.mark.parametrize("form", ["feedback", "original"])
@pytest.mark.parametrize("preset", ThreeUPU.presets)
def test_the_robot_grows_to_three_and_six(preset, form):
    problem = paper_problem(preset, form=form)
    found = grown(problem.system, problem.start_point, problem.goal_point, length=problem.scale)
    assert [growth.vector for growth in found.points] == [(3, 6)] * 2


@pytest.mark.parametrize(
    ("system", "singular", "regular", "vectors"),
    [
        (Martinet(), [0, 1, 2], [0.5, 1, 2], ((2, 2, 3), (2, 3))),
        (Cubic(), [0, 1, 2], [0.5, 1, 2], ((2, 2, 2, 3), (2, 3))),
        (Grushin(), [0, 1], [0.5, 1], ((1, 2), (2,))),
    ],
)
def test_growth_at_singular_points(system, singular, regular, vectors):
    found = grown(system, singular, regular)
    assert tuple(growth.vector for growth in found.points) == vectors
    assert found.generic.vector == vectors[1]
    assert verdict(found, ["a", "b"], TOLERANCE).kind == "controllable"


def test_a_rank_that_may_still_grow_is_no_verdict():
    """With brackets up to degree 3 only, nothing is known of x = 0."""
    found = grown(Cubic(), [0, 1, 2], [1, 1, 2], limit=3)
    assert found.points[0].vector == (2,)
    assert not found.settled
    said = verdict(found, ["here", "there"], TOLERANCE)
    assert (said.kind, said.failing) == ("undecided", ("here",))
    assert "up to degree 3" in said.sentence


def test_involutive_fields_stay_on_leaves():
    found = grown(Leaves(), [0.1, 0.2, 0.3])
    assert found.points[0].vector == (2,)
    assert found.settled
    assert found.points[0].degree is None
    said = verdict(found, ["here"], TOLERANCE)
    assert said.kind == "not controllable"
    assert "2-dimensional sets in 3" in said.sentence


def test_a_fully_actuated_system_needs_no_bracket():
    assert grown(Integrators(), [1, 2]).points[0].vector == (2,)


# --- drift ------------------------------------------------------------------------------------------------------------


def test_kalmans_rank_condition_is_strong_accessibility():
    found = grown(Springs(), [0.3, 0.2, 0.1])
    assert found.points[0].full
    assert found.points[0].strong == 3
    assert verdict(found, ["here"], TOLERANCE).kind == "strongly accessible"


def test_an_angle_that_only_drifts_is_accessible_no_more():
    system = Turntable()
    found = grown(system, system.state_space.pack({"angle": 0.2, "orientation": np.eye(3)}))
    assert found.points[0].full
    assert found.points[0].strong == 3
    said = verdict(found, ["here"], TOLERANCE)
    assert said.kind == "accessible"
    assert "dimension 3 of 4" in said.sentence


def test_brackets_without_drift_are_enough_for_a_boat():
    system = Ferry()
    found = grown(system, system.state_space.pack({"position": np.zeros(2), "theta": 0.3}))
    assert found.points[0].strong == 3
    assert verdict(found, ["here"], TOLERANCE).kind == "strongly accessible"


# --- scales -----------------------------------------------------------------------------------------------------------


@settings(max_examples=6, deadline=None)
@given(st.floats(1e-3, 1e3))
def test_no_unit_of_length_changes_a_singular_value(factor):
    """The robot and its pose in other units."""
    problem = paper_problem("default")
    system = ThreeUPU(base_radius=30 * factor, platform_radius=15 * factor)
    point = problem.start_point.copy()
    point[:3] *= factor
    own = grown(problem.system, problem.start_point, length=15.0).points[0]
    other = grown(system, point, length=15.0 * factor).points[0]
    for one, two in zip(own.spectra, other.spectra, strict=True):
        np.testing.assert_allclose(one.values, two.values, rtol=1e-8)


@settings(max_examples=10, deadline=None)
@given(st.floats(1e-3, 1e3))
def test_no_size_of_all_fields_together_matters(factor):
    class Faster(Martinet):
        def vector_fields(self, state):
            return factor * super().vector_fields(state)

    own, other = (grown(system, [0.4, 0, 0]).points[0] for system in (Martinet(), Faster()))
    for one, two in zip(own.spectra, other.spectra, strict=True):
        np.testing.assert_allclose(one.values, two.values, rtol=1e-9)


class Scaled(System):
    """Another system with its tangent numbers in other units, and its inputs too: x = state_units * y."""

    def __init__(self, system, state_units, input_units=1.0):
        self.system, self.model = system, f"scaled {system.model}"
        self.state_space, self.input_space = system.state_space, system.input_space
        self.units, self.inputs = np.broadcast_to(state_units, system.state_space.size), input_units

    def vector_fields(self, state):
        fields = self.system.vector_fields(state * self.units)
        xp = namespace(state)
        columns = fields.shape[1]
        rows = [
            [fields[i, j] * self.inputs / unit for j in range(columns)] for i, unit in enumerate(self.units)
        ]
        return xp.matrix(rows)


def nearby(system, size):
    return size * (0.3 + 0.1 * np.arange(system.state_space.size))


@pytest.mark.parametrize("size", [0.0, 1.0, 1e3, 1e6])
def test_heisenbergs_brackets_are_left_invariant(size):
    """Size is not degeneracy: (2, 3) everywhere."""
    found = grown(system_class("heisenberg")(), [size, -0.5 * size, size])
    assert found.points[0].vector == found.generic.vector == (2, 3)
    assert verdict(found, ["here"], TOLERANCE).kind == "controllable"


@pytest.mark.parametrize("size", [1e3, 1e6])
def test_a_free_nilpotent_system_is_left_invariant_too(size):
    system, point = start("free_nilpotent_36", x=[size, size, 0.0], z=[0.0, 0.0, 0.0])
    assert grown(system, point).points[0].vector == (3, 6)


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3, 1e6])
@pytest.mark.parametrize("trailers", [1, 2, 3])
def test_trailers_in_any_unit_are_controllable(trailers, unit):
    system = wheels.Trailers(lengths=(unit,) * trailers)
    point = [0.3 * unit, 0.2 * unit, *0.1 * np.arange(trailers + 1)]
    vector = tuple(range(2, trailers + 4))
    for length in (1.0, unit):
        found = grown(system, point, length=length)
        assert found.points[0].vector == vector
        assert verdict(found, ["here"], TOLERANCE).kind == "controllable"


@pytest.mark.parametrize("factor", [1e-9, 1e9])
@pytest.mark.parametrize(
    "system", [wheels.Chained5(), wheels.Engel(), wheels.Cartan()], ids=lambda s: s.model
)
def test_no_unit_of_state_or_input_makes_a_system_degenerate(system, factor):
    point, vector = nearby(system, 1.0), grown(system, nearby(system, 1.0)).points[0].vector
    one = np.where(np.arange(system.state_space.size) == system.state_space.size - 1, factor, 1.0)
    for units, inputs in ((factor, 1.0), (1.0, factor), (one, 1.0)):
        found = grown(Scaled(system, units, inputs), point / units)
        assert verdict(found, ["here"], TOLERANCE).kind == "controllable"
        assert found.points[0].vector == vector


@pytest.mark.parametrize("size", [1.0, 1e3, 1e6])
@pytest.mark.parametrize("factor", [1e-9, 1.0, 1e9])
def test_what_is_integrable_is_so_in_every_unit(size, factor):
    found = grown(Scaled(Leaves(), factor), np.array([0.1, size, 0.3]) / factor)
    assert verdict(found, ["here"], TOLERANCE).kind == "not controllable"


class Turned(Plane):
    """ż = cos²(x) + sin²(x) - 1 + y u2: a height whose bracket vanishes but for rounding."""

    model: ClassVar[str] = "turned"

    def height(self, x, y):
        xp = namespace(x, y)
        return (xp.cos(x) * xp.cos(x) + xp.sin(x) * xp.sin(x)) * y


@pytest.mark.parametrize("place", [0.3, 30.0, 3e4])
def test_a_bracket_that_vanishes_to_rounding_is_zero(place):
    found = grown(Turned(), [place, 0.2, 0.1])
    assert found.points[0].vector == (2,)
    assert verdict(found, ["here"], TOLERANCE).kind == "not controllable"


class Nearly(System):
    """Four fields in R⁴, the last but 1e-9 in the plane of the others, so that no clear rank can be read."""

    model: ClassVar[str] = "nearly"
    state_space = StateSpace([scalar(name) for name in "abc"])
    input_space = StateSpace([scalar(f"u{i}") for i in range(3)])

    def vector_fields(self, state):
        return namespace(state).matrix([[1, 0, 1], [0, 1, 1], [1, 1, 2 + 1e-9]])


def test_a_rank_without_a_clear_margin_is_undecided():
    found = grown(Nearly(), [0.1, 0.2, 0.3])
    said = verdict(found, ["here"], TOLERANCE)
    assert said.kind == "undecided"
    assert "not by a clear margin" in said.sentence


# --- what the verdict does not cover -------------------------------------------------------------------------------


class Kinked(Plane):
    """ż = |x| u2."""

    model: ClassVar[str] = "kinked"

    def height(self, x, y):
        return ca.fabs(x)


class Joined(Plane):
    """ż = x u2 where x > 1, else nothing: integrable on one piece only."""

    model: ClassVar[str] = "joined"

    def height(self, x, y):
        return ca.if_else(x > 1.0, x, 0.0)


def reserve(system, **bounds):
    origin = dict.fromkeys(system.state_space.names, 0.0)
    limits = [Bound("control", name, *sides) for name, sides in bounds.items()]
    return Reserve.of(PlanningProblem(system=system, start=origin, goal=origin, bounds=limits))


def test_fields_that_are_joined_of_pieces_are_named():
    found = grown(Kinked(), [0.5, 0.0, 0.0])
    said = verdict(found, ["here"], TOLERANCE, Reserve(pieces_of(Kinked())))
    assert said.kind == "controllable"
    assert "joined of pieces (|·|)" in said.sentence
    assert pieces_of(Martinet()) == ()


def test_one_piece_is_no_verdict_on_the_whole():
    found = grown(Joined(), [0.0, 0.0, 0.0])
    assert verdict(found, ["here"], TOLERANCE).kind == "not controllable"
    said = verdict(found, ["here"], TOLERANCE, Reserve(pieces_of(Joined())))
    assert said.kind == "undecided"
    assert "says nothing of what lies beyond" in said.sentence


@pytest.mark.parametrize(
    ("bounds", "kind", "words"),
    [
        ({"v": (-1.0, 1.0), "w": (-1.0, 1.0)}, "controllable", "small-time locally controllable"),
        ({"v": (0.0, 1.0)}, "accessible", "The bounds on v exclude going back"),
        ({"v": (0.5, 1.0), "w": (-1.0, 1.0)}, "accessible", "exclude going back"),
        ({"v": (1.0, 1.0)}, "undecided", "hold v at one value"),
    ],
)
def test_bounds_that_exclude_going_back_limit_the_verdict(bounds, kind, words):
    """A unicycle that only drives forwards is Dubins' car."""
    system = system_class("unicycle")()
    found = grown(system, np.zeros(3))
    said = verdict(found, ["here"], TOLERANCE, reserve(system, **bounds))
    assert said.kind == kind
    assert words in said.sentence


def test_a_narrow_gap_is_called_doubtful():
    assert not Spectrum((1.0, 0.3, 1e-15), TOLERANCE).doubtful
    assert Spectrum((1.0, 5e-8, 1e-15), TOLERANCE).doubtful
    assert Spectrum((1.0, 0.3, 2e-9), TOLERANCE).doubtful
    spectrum = Spectrum((2.0, 1.0, 1e-12), TOLERANCE)
    assert (spectrum.rank, spectrum.least_kept, spectrum.largest_dropped) == (2, 0.5, 5e-13)
    assert Spectrum((0.0, 0.0), TOLERANCE).rank == Spectrum((), TOLERANCE).rank == 0


# --- along a path -----------------------------------------------------------------------------------------------------


@settings(max_examples=10, deadline=None)
@given(st.floats(0.05, 0.95), st.floats(0.2, 3.0))
def test_a_path_through_a_singular_surface_is_caught_between_samples(when, speed):
    """Martinet's surface x = 0, met at a time that is no sample's."""
    fields = Fields(Martinet(), Scales(1.0, 1.0))

    def path(times):
        return np.column_stack([speed * (times - when), np.cos(times), np.sin(times)])

    times = np.linspace(0, 1, 21)
    generic = filtration(fields, path(times), TOLERANCE, 3).generic
    (found,) = rank_losses(fields, path, times[np.abs(times - when) > 1e-3], generic, TOLERANCE)
    assert found == pytest.approx(when, abs=1e-7)


def test_a_path_that_keeps_its_distance_loses_no_rank():
    fields = Fields(Martinet(), Scales(1.0, 1.0))

    def path(times):
        return np.column_stack([0.01 + (times - 0.5) ** 2, times, times])

    times = np.linspace(0, 1, 20)
    generic = filtration(fields, path(times), TOLERANCE, 3).generic
    assert not len(rank_losses(fields, path, times, generic, TOLERANCE))
