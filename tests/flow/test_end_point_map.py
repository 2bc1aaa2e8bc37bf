"""The end-point Jacobian: three ways that agree with each other and with differences; known ranks."""

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, assume, given, settings
from hypothesis import strategies as st

from nhpocp import so3
from nhpocp.controls.fourier import Fourier
from nhpocp.flow.dynamics import Dynamics
from nhpocp.flow.end_point_map import DifferentiatedEndPointMap, VariationalEndPointMap
from nhpocp.flow.integrators import CasadiRungeKutta, Cvodes, RungeKutta4
from nhpocp.systems.legs import Leg
from nhpocp.systems.numeric import NumericSystem
from nhpocp.systems.three_upu import ThreeUPU
from tests.conftest import PAPER_START, paper_problem

WAYS = {
    "rk4": (DifferentiatedEndPointMap, RungeKutta4(200)),
    "casadi rk": (DifferentiatedEndPointMap, CasadiRungeKutta(steps=200)),
    "cvodes": (DifferentiatedEndPointMap, Cvodes(steps=2)),
    "variational": (VariationalEndPointMap, RungeKutta4(200)),
    "variational cvodes": (VariationalEndPointMap, Cvodes(steps=2)),
}


def made(way, system, basis, start, horizon=1.0):
    factory, integrator = WAYS[way]
    return factory(system, basis, horizon, start, integrator)


def relative(jacobian, reference):
    return np.abs(jacobian - reference).max() / np.abs(reference).max()


def differences(system, basis, start, coefficients, horizon, step=2e-4):
    """Central differences in the state space's own tangent numbers, Richardson-extrapolated."""
    rate, space = NumericSystem(system).rate_function, system.state_space
    flow = RungeKutta4(200).flow(Dynamics(rate), basis, horizon)

    def central(size):
        columns = []
        for index in np.ndindex(*coefficients.shape):
            change = np.zeros(coefficients.shape)
            change[index] = size
            ahead, behind = flow.end(start, coefficients + change), flow.end(start, coefficients - change)
            columns.append(space.difference(ahead, behind) / (2 * size))
        return np.array(columns).T

    return (4 * central(step) - central(2 * step)) / 3


@pytest.mark.parametrize("way", WAYS)
def test_paper_start(way, problem):
    end = made(way, problem.system, problem.basis, problem.start_point)(PAPER_START)
    np.testing.assert_allclose(end.state[:3], [0.712869, 0.535277, 34.976485], atol=6e-7)
    assert end.jacobian.shape == (6, 15)


def vectors(bound):
    return st.tuples(*[st.floats(-bound, bound)] * 3)


def symmetric_robots(axis, joint):
    return st.builds(
        ThreeUPU,
        base_radius=st.floats(20, 40),
        platform_radius=st.floats(8, 18),
        roller_tilt=st.floats(0.2, np.pi / 2),
        platform_axis=st.just(axis),
        joint=st.just(joint),
    )


def robots_of_explicit_legs():
    """The default robot with every leg bent by itself, and both joints in it."""

    def bent(plain, changes, joint):
        moves = dict(zip(("base", "platform", "r", "w4"), changes, strict=True))
        values = {name: tuple(np.add(getattr(plain, name), move)) for name, move in moves.items()}
        return Leg(**values, joint=joint)

    changes = st.tuples(vectors(4), vectors(3), vectors(0.4), vectors(0.4))
    joints = ("veselova", "suslov", "veselova")
    legs = [
        st.builds(bent, st.just(leg), changes, st.just(joint))
        for leg, joint in zip(ThreeUPU().legs, joints, strict=True)
    ]
    return st.builds(lambda *three: ThreeUPU(legs=three), *legs)


ROBOTS = {
    f"{joint} {axis}": symmetric_robots(axis, joint)
    for joint in ("veselova", "suslov")
    for axis in ("radial", "tangential", "normal")
} | {"explicit legs": robots_of_explicit_legs()}


@pytest.mark.parametrize("robots", ROBOTS.values(), ids=ROBOTS)
@settings(
    max_examples=2,
    deadline=None,
    derandomize=True,
    phases=[Phase.generate],  # shrinking would take minutes
    suppress_health_check=list(HealthCheck),
)
@given(
    data=st.data(),
    pose=st.tuples(
        *[st.floats(-2, 2)] * 2, st.floats(22, 32), *[st.floats(-0.2, 0.2)] * 2, st.floats(-1.5, -0.3)
    ),
    seed=st.integers(0, 1000),
    harmonics=st.sampled_from([1, 0, 2]),
    horizon=st.sampled_from([0.4, 1.0, 2.5]),
)
def test_all_ways_agree_and_match_differences(robots, data, pose, seed, harmonics, horizon):
    """1e-7 between the ways, 1e-6 against differences; from 3 parameters to 15, more and fewer than the 12 outputs."""
    system, basis = data.draw(robots), Fourier(harmonics)
    start = system.state_space.pack(
        {"position": np.array(pose[:3]), "orientation": so3.from_rpy(np.array(pose[3:]))}
    )
    coefficients = np.random.default_rng(seed).normal(0, 0.3, (3, basis.size)) / horizon
    assume(is_regular(system, basis, start, coefficients, horizon))
    found = made("rk4", system, basis, start, horizon)(coefficients)
    for way in list(WAYS)[1:]:
        jacobian = made(way, system, basis, start, horizon)(coefficients).jacobian
        assert relative(jacobian, found.jacobian) < 1e-7, way
    step = 2e-4 / horizon
    by_differences = differences(system, basis, start, coefficients, horizon, step)
    assert relative(found.jacobian, by_differences) < 1e-6


LEAP = 2.0  # of any state number in one of 100 steps: faster paths run out of SUNDIALS' own steps


def is_regular(system, basis, start, coefficients, horizon):
    """Whether a path keeps clear of det S = 0, where (7) is undefined and no two ways need agree."""
    numeric = NumericSystem(system)
    flow = RungeKutta4(100).flow(Dynamics(numeric.rate_function), basis, horizon)
    path = flow.states(start, coefficients)
    if not np.isfinite(path).all() or np.abs(np.diff(path, axis=0)).max() > LEAP:
        return False
    clearance = numeric.margins(path, system.default_length_scale())["sigma_s"]
    return clearance.min() > 0.1


@pytest.mark.parametrize(
    ("coefficients", "rank"),
    [(np.zeros((3, 5)), 3), (np.eye(3, 5, -2), 5), (PAPER_START, 6)],
    ids=["zero", "only lambda_30 = 1", "the paper's"],
)
def test_ranks(coefficients, rank, problem):
    """[physics §1]: 3 at Λ = 0, 5 with a constant turn only, 6 at the paper's start."""
    end = made("rk4", problem.system, problem.basis, problem.start_point)(coefficients)
    assert np.linalg.matrix_rank(end.jacobian, tol=1e-8 * np.linalg.norm(end.jacobian)) == rank


def test_gram_matrix_is_the_limit_of_the_discrete_one(problem):
    """D of (14) is ∫ Φ B Bᵀ Φᵀ: over a Fourier basis, J Gram⁻¹ Jᵀ tends to it as harmonics grow."""
    variational = VariationalEndPointMap(
        problem.system, problem.basis, 1.0, problem.start_point, RungeKutta4(200)
    )
    exact = variational.gram(PAPER_START)
    np.testing.assert_allclose(exact, exact.T, atol=1e-9)
    errors = []
    for harmonics in (2, 8, 32):
        basis = Fourier(harmonics)
        padded = np.pad(PAPER_START, ((0, 0), (0, basis.size - 5)))
        jacobian = made("rk4", problem.system, basis, problem.start_point)(padded).jacobian
        inner = jacobian @ np.kron(np.eye(3), np.linalg.inv(basis.gram(1.0))) @ jacobian.T
        assert np.linalg.eigvalsh(exact - inner).min() > -1e-6  # a subspace never gains
        errors.append(np.linalg.norm(exact - inner) / np.linalg.norm(exact))
    assert errors[2] < errors[1] < errors[0]
    assert errors[2] < 5e-3


def test_time_scaling_of_the_jacobian():
    """v(t)/T over [0, T] ends where v over [0, 1] does."""
    problem = paper_problem()
    slow = made("rk4", problem.system, problem.basis, problem.start_point, horizon=2.5)(PAPER_START / 2.5)
    fast = made("rk4", problem.system, problem.basis, problem.start_point)(PAPER_START)
    np.testing.assert_allclose(slow.state, fast.state, atol=1e-9)
    np.testing.assert_allclose(slow.jacobian, 2.5 * fast.jacobian, atol=1e-8)
