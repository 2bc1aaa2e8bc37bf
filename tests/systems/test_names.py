"""Names of states, inputs, outputs and margins: those that collide are refused, all others survive a folder."""

import csv
from typing import ClassVar

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import nhpocp
from nhpocp import (
    InvalidProblemError,
    PlanningProblem,
    StateSpace,
    System,
    namespace,
    rotation,
    scalar,
    vector,
)
from nhpocp.constraints.bound import Bound
from nhpocp.problem_file import registry
from nhpocp.systems.margins import margin
from nhpocp.systems.system import RESERVED


class Named(System):
    """q̇ = u on R³, whose parts are called as a test says; `sum` and the margin of `m` are made when asked for."""

    model = "named"
    shown: ClassVar[tuple[str, ...]] = ()
    guarded: ClassVar[tuple[str, ...]] = ()

    def vector_fields(self, state):
        return namespace(state).eye(3)

    def outputs(self, state, control):
        return dict.fromkeys(self.shown, state[0] + state[1])

    def regularity(self, state):
        return {name: namespace(state).eye(2) for name in self.guarded}

    def column_scales(self, name, length_scale):
        return [1.0, 1.0]


def named(state, control, goals=(), shown=(), guarded=()):
    spaces = {"state_space": StateSpace(state), "input_space": StateSpace(control)}
    outputs = {"output_blocks": goals} if goals else {}  # else nothing is known of them
    return type("Here", (Named,), {**spaces, **outputs, "shown": shown, "guarded": guarded})()


U = [vector("u", 3)]


@pytest.mark.parametrize(
    ("name", "make"),
    [
        ("t", lambda: named([vector("x", 2), scalar("t")], U)),
        ("file", lambda: named([vector("x", 2), scalar("file")], U)),
        ("file", lambda: named([vector("x", 3)], [vector("file", 3)])),
        ("x", lambda: named([vector("x", 3)], [vector("x", 3)])),
        ("x[0]", lambda: named([vector("x", 3)], [scalar("x[0]"), vector("u", 2)])),
        ("x", lambda: named([vector("x", 2), scalar("x")], U)),
        ("x[1]", lambda: named([vector("x", 2), scalar("x[1]")], U)),
        ("x[1][2]", lambda: named([rotation("x"), scalar("x[1][2]")], U)),
        ("sigma_s", lambda: named([vector("x", 2), scalar("sigma_s")], U)),
        ("det_w", lambda: named([vector("x", 2), scalar("det_w")], U)),
        ("x", lambda: named([vector("x", 3)], U, goals=(scalar("x"),))),
        ("t", lambda: named([vector("x", 3)], U, goals=(scalar("t"),))),
        ("y", lambda: named([vector("x", 3)], U, goals=(vector("y", 2), scalar("y")))),
        ("", lambda: named([vector("x", 2), scalar("")], U)),
        ("a\nb", lambda: named([vector("x", 2), scalar("a\nb")], U)),
        ("x", lambda: StateSpace([scalar("x"), scalar("x")])),
    ],
)
def test_names_that_collide_are_refused_when_a_system_is_made(name, make):
    with pytest.raises(InvalidProblemError, match=r"rename|expected a name") as refusal:
        make()
    assert repr(name) in str(refusal.value)


@pytest.mark.parametrize("shown", [("x",), ("u",), ("t",), ("x[0]",), ("sigma_m",), ("det_m",), ("u[2]",)])
def test_outputs_that_are_known_later_are_refused_with_the_problem(shown):
    system = named([vector("x", 3)], U, shown=shown, guarded=("m",))
    with pytest.raises(InvalidProblemError, match="rename"):
        PlanningProblem(system=system, start={"x": [0, 0, 0]}, goal={"x": [1, 0, 0]})


def free(name):
    return name not in RESERVED and margin(name) is None


NAMES = st.text(min_size=1, max_size=6).filter(lambda name: name.isprintable() and free(name))


@settings(max_examples=12, deadline=None)
@given(names=st.lists(NAMES, min_size=5, max_size=5, unique=True))
@example(names=["null", "true", "1e3", "<<", "x.npy"])
@example(names=["x y", "a,b", '"q"', "../x", "#"])
@example(names=["position", "orientation", "k", "error", "time"])
@example(names=["state", "control", "clearance", "matrix", "at"])
@example(names=["self", "args", "arr_0", "x[0", "ẋ"])
def test_what_is_saved_under_any_other_name_is_read(names, tmp_path_factory):
    first, second, control, output, guarded = names
    system = named(
        [scalar(first), vector(second, 2)],
        [vector(control, 3)],
        (scalar(output, of_pose=True),),
        (output,),
        (guarded,),
    )
    bounds = [Bound(f"state.{name}", name, -9.0, 9.0) for name in (first, second, output)]
    bounds += [
        Bound("control", control, -99.0, 99.0),
        Bound(f"clearance.sigma_{guarded}", f"sigma_{guarded}", 0.1),
    ]
    problem = PlanningProblem(
        system=system,
        start={first: 0, second: [0, 0]},
        goal={second: [1, 2], output: 1.5},
        basis=nhpocp.Fourier(0),
        samples=3,
        bounds=bounds,
    )
    plan = nhpocp.solve(problem, nhpocp.Continuation(step_rule=nhpocp.Adaptive()))
    assert plan.converged, plan.message
    folder = nhpocp.save_solution(plan, tmp_path_factory.mktemp("named") / "plan")
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(registry.SYSTEMS.lines, "named", f"{__name__}:HERE")
        patch.setitem(globals(), "HERE", type(system))
        again = nhpocp.load_solution(folder)
    assert list(again.trajectory) == list(plan.trajectory)
    for name, values in plan.trajectory.items():
        np.testing.assert_array_equal(again.trajectory[name], values)
    assert nhpocp.verify(again).ok
    with (folder / "trajectory.csv").open(newline="", encoding="utf-8") as file:
        header = next(csv.reader(file))
    assert len(set(header)) == len(header)
