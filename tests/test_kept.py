"""What is worked out from an object is made once, and goes with it."""

import gc
import pickle
import subprocess
import sys
import threading
from weakref import ref

import casadi as ca
import numpy as np
import pytest

import nhpocp
from nhpocp.calls import accumulated, call, mapped, side_by_side
from nhpocp.flow.dynamics import dynamics
from nhpocp.flow.runge_kutta import scheme
from nhpocp.flow.tableau import CLASSICAL
from nhpocp.kept import Kept, kept, let_go
from nhpocp.problem_file import parse_problem
from nhpocp.problem_file.registry import SYSTEMS
from nhpocp.problem_file.starters import starter
from nhpocp.solvers.nlp import interval
from nhpocp.solvers.nlp.ipopt import Ipopt
from nhpocp.systems.numeric import numeric_system
from tests.conftest import Integrators, paper_problem


class Owner:
    """Not hashable, as a user's dataclass is not."""

    __hash__ = None

    def __eq__(self, other):
        return True


class Result:
    """Of a call, and it may know its owner."""

    def __init__(self, owner, *rest):
        self.owner, self.rest = owner, rest


def test_results_are_made_once_for_each_owner_and_arguments():
    look = kept(most=8)(Result)
    first, second = Owner(), Owner()
    assert look(first) is look(first)
    assert look(first, 1) is look(first, 1)
    assert len({id(look(owner, *rest)) for owner in (first, second) for rest in ((), (1,), (2,))}) == 6


def test_results_go_with_their_owner_though_they_know_it():
    look, owner = kept(most=8)(Result), Owner()
    gone = ref(owner), ref(look(owner))
    del owner
    gc.collect()
    assert [each() for each in gone] == [None, None]


def test_no_more_are_kept_than_is_said_and_the_first_goes_first():
    look, owners = kept(most=3)(Result), [Owner() for _ in range(5)]
    gone = [ref(look(owner)) for owner in owners]
    assert [each() is not None for each in gone] == [False, False, True, True, True]
    assert look(owners[0]) is look(owners[0])
    look.cache_clear()
    assert all(not value for owner in owners for value in vars(owner).values() if isinstance(value, Kept))


def test_large_results_leave_less_room_and_the_last_always_stays():
    look, owners = kept(most=10, size=lambda result: result.rest[0])(Result), [Owner() for _ in range(4)]
    gone = [ref(look(owner, size)) for owner, size in zip(owners, (3, 4, 5, 30), strict=True)]
    assert [each() is not None for each in gone] == [False, False, False, True]
    gone = [ref(look(owners[k], size)) for k, size in enumerate((4, 5, 1))]
    assert all(each() is not None for each in gone)
    assert look(owners[3], 6).rest == (6,)
    assert [each() is not None for each in gone] == [False, False, True]


def test_intervals_of_many_robots_take_the_room_of_one():
    """By number, two systems' intervals were kept, of up to 16 steps: 330 MB of expressions."""
    robots = [nhpocp.ThreeUPU(base_radius=30 + k) for k in range(3)]
    gone = [
        ref(interval.interval_of(paper_problem(system=robot), None, steps, ()))
        for robot in robots
        for steps in (8, 16)
    ]
    there = [each() for each in gone if each() is not None]
    assert there == [each() for each in gone[-2:]]  # what one robot needs, the last one's, is all there
    assert sum(interval.BESIDES + each.shot.length for each in there) <= interval.MOST


def test_what_is_kept_can_be_let_go_and_is_not_pickled():
    system = Integrators()
    before = ref(numeric_system(system))
    other = pickle.loads(pickle.dumps(system))
    assert not any(vars(other).get(name) for name, value in vars(system).items() if isinstance(value, Kept))
    let_go(system)
    gc.collect()
    assert before() is None
    assert numeric_system(system).system is system


def test_threads_may_keep_at_once():
    look, owner, found = kept(most=4)(Result), Owner(), []

    def ask():
        found.extend(look(owner, k % 7).rest[0] == k % 7 for k in range(300))

    threads = [threading.Thread(target=ask) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    assert len(found) == 1200
    assert all(found)


def test_functions_take_their_maps_and_callers_along():
    x = ca.SX.sym("x", 2)
    function = ca.Function("f", [x], [2 * x])
    gone = [ref(function)]
    for of_many in (mapped(function, 3), side_by_side(function, 3)):
        np.testing.assert_array_equal(call(of_many, np.ones((3, 2)))[0], 2.0)
        gone.append(ref(of_many))
    np.testing.assert_array_equal(call(accumulated(function, 2), np.ones(2))[0], [[2, 2], [4, 4]])
    del function, of_many
    assert [each() for each in gone] == [None] * 3  # without a cycle


@pytest.mark.parametrize("model", SYSTEMS)
def test_a_system_takes_along_all_that_was_made_for_it(model):
    problem = parse_problem(starter(model))
    system = problem.system
    for solver in (
        nhpocp.Continuation(step_rule=nhpocp.Adaptive(), max_iterations=2),
        nhpocp.MultipleShooting(intervals=3, steps_per_interval=1, optimizer=Ipopt(max_iterations=2)),
    ):
        nhpocp.solve(problem.with_(samples=5), solver)
    steps = scheme(dynamics(system), CLASSICAL)
    gone = [ref(system), ref(numeric_system(system)), ref(numeric_system(system).rate_function), ref(steps)]
    gone += [ref(made) for made in vars(system)[f"{interval.__name__}._made, kept"].values()]
    assert len(gone) > 4
    del problem, system, steps
    gc.collect()
    assert [each() for each in gone] == [None] * len(gone)


LOOP = """
import nhpocp
from tests.conftest import paper_problem
from nhpocp.solvers.nlp.ipopt import Ipopt

problem = paper_problem(samples=5)
jacobian = nhpocp.Continuation(step_rule=nhpocp.Adaptive(), integrator=nhpocp.RungeKutta4(20))
nlp = nhpocp.MultipleShooting(intervals=3, steps_per_interval=1, optimizer=Ipopt(max_iterations=1))
for k in range(ROBOTS):
    robot = nhpocp.ThreeUPU(base_radius=30 + 0.01 * k)
    for solver in (jacobian, nlp):
        solver.solve(nhpocp.replace(problem, system=robot))
    with open("/proc/self/statm") as file:
        print(int(file.read().split()[1]))
"""


def test_one_robot_after_another_takes_no_more_memory():
    """Kept for the process, each of these robots held 7 MB; one with N = 50 held 23."""
    script = LOOP.replace("ROBOTS", "13")
    found = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=300, check=True, cwd="tests"
    )
    pages = [int(line) for line in found.stdout.split()]
    assert (pages[-1] - pages[4]) / (len(pages) - 5) * 4096 < 2e6
