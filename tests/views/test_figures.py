"""Pictures of solutions: what is drawn is what was computed, for good, failed and partial solutions."""

from __future__ import annotations

import struct
import warnings
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from scipy.integrate import solve_ivp

from nhpocp import so3
from nhpocp.comparison import Entry
from nhpocp.constraints.bound import Bound, check_bounds
from nhpocp.controls.control import Control
from nhpocp.controls.fourier import Fourier
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.solution import Crossing, Solution, Verdict
from nhpocp.state_space import StateSpace, rotation, scalar, vector
from nhpocp.systems.numeric import NumericSystem
from nhpocp.systems.system import System
from nhpocp.systems.three_upu import ThreeUPU
from nhpocp.via import Via
from nhpocp.views import drawing, panels
from nhpocp.views.figures import FIGURES, write_pictures
from nhpocp.views.finite_path import path_of
from nhpocp.views.labels import plain_words, symbol
from nhpocp.views.overlays import overlays
from nhpocp.views.records import step_sums
from nhpocp.views.style import DOTS_PER_INCH, PANEL
from tests.conftest import library_problem

FINAL = [  # physics, section 2: the preset `default` after (17) with gamma = 0.1
    [0.03936, 0.62835, 0.79417, -0.56243, -0.29366],
    [-0.01976, 0.4729, -0.90043, -0.81548, 0.09843],
    [0.97118, -0.12044, 1.01225, 0.00946, -0.21296],
]
FIRST = [[0, 0.5, 0, 0, 0], [0, 0.5, 0, 0, 0], [1, 0, 0.5, 0, 0]]  # [Paper] section 4


class Unicycle(System):
    """A toy without legs, margins or drawing."""

    model = "toy"
    state_space = StateSpace([scalar("x", "length"), scalar("y", "length"), scalar("theta", "angle")])
    input_space = StateSpace([scalar("v"), scalar("w")])

    def vector_fields(self, state: Any) -> Any:
        import casadi as ca

        return ca.vertcat(ca.horzcat(ca.cos(state[2]), 0), ca.horzcat(ca.sin(state[2]), 0), ca.horzcat(0, 1))


class Spinner(System):
    """A toy whose state is one rotation: about z, at the speed of its input."""

    model = "spinner"
    state_space = StateSpace([rotation("orientation")])
    input_space = StateSpace([vector("u", 1)])

    def vector_fields(self, state: Any) -> Any:
        import casadi as ca

        return ca.DM([0, 0, 1])


def solved(problem: PlanningProblem, coefficients: Any, **changes: Any) -> Solution:
    """A Solution without a solver: SciPy's integration of a control."""
    control = Control(problem.basis, coefficients, 1.0)
    numeric = NumericSystem(problem.system)
    times = np.linspace(0, 1, problem.samples)

    def rate(time: float, state: Any) -> Any:
        return numeric.rate_function(state, control(np.array([time]))[0]).full().ravel()

    states = solve_ivp(rate, (0, 1), problem.start_point, t_eval=times, rtol=1e-8, atol=1e-10).y.T
    values: dict[str, Any] = {
        "problem": problem,
        "solver": "jacobian",
        "settings": {"gamma": 0.1},
        "tolerance": 1e-3,
        "outcome": Outcome.CONVERGED,
        "message": "",
        "final_error": 9.1e-4,
        "control": control,
        "trajectory": {"t": times, **numeric.trajectory(states, control(times), problem.scale)},
        "iterations": [{"k": k, "error": 1.3377 * 0.9**k} for k in range(70)],
        "evaluations": 70,
    }
    return Solution(**{**values, **changes})


def task(system: ThreeUPU) -> PlanningProblem:
    start = {"position": [0, 0, 25], "orientation": so3.from_rpy([0, 0, -np.pi / 6])}
    goal = {"position": [-0.4, -0.2, 35], "orientation": so3.from_rpy([0, 0, -np.pi / 2])}
    return PlanningProblem(system=system, start=start, goal=goal)


@cache
def good() -> Solution:
    return solved(task(ThreeUPU.preset("default")), FINAL)


@cache
def crossing() -> Solution:
    """The conjectured robot under the paper's first control: it crosses det W = 0, see physics, section 2."""
    return solved(task(ThreeUPU.preset("paper_conjecture")), FIRST)


@cache
def failed() -> Solution:
    """Overflowed at 40 % of the horizon, after twelve iterations that grew."""
    trajectory = {}
    for name, values in good().trajectory.items():
        values = np.array(values, dtype=float)
        if name != "t":
            values[81:] = np.nan
        trajectory[name] = values
    records = [{"k": k, "error": 1.3377 * 1.4**k} for k in range(12)] + [{"k": 12, "error": None}]
    return replace(
        good(), trajectory=trajectory, iterations=records, outcome=Outcome.NOT_FINITE, final_error=np.nan
    )


@cache
def hopeless() -> Solution:
    """Nothing finite but the time, and nothing recorded."""
    trajectory = {name: np.full_like(values, np.nan) for name, values in good().trajectory.items()}
    trajectory["t"] = good().trajectory["t"]
    return replace(good(), trajectory=trajectory, iterations=[], outcome=Outcome.SOLVER_ERROR)


@cache
def single() -> Solution:
    return replace(
        good(), iterations=[{"k": 0, "error": 1.3377}], outcome=Outcome.RANK_DEFICIENT, final_error=1.3377
    )


@cache
def toy() -> Solution:
    problem = PlanningProblem(
        system=Unicycle(), start={"x": 0, "y": 0, "theta": 0}, goal={"x": 0, "y": 1, "theta": 0}
    )
    return solved(problem, [[0, 2, 3, 0, 1], [0, 1, 0, 2, 0]])


@cache
def spinner() -> Solution:
    """Turns from I to Rz(4) with the goal I: passes a half turn."""
    problem = PlanningProblem(
        system=Spinner(), start={"orientation": np.eye(3)}, goal={"orientation": np.eye(3)}
    )
    return solved(problem, [[4, 0, 0, 0, 0]])


@cache
def lost() -> Solution:
    """A toy that did not converge: no margins, no determinants."""
    return replace(toy(), outcome=Outcome.STAGNATED, message="No better.")


@cache
def tries() -> Solution:
    """Two tries, the second one better but not there; the trials 2 and 5 were refused, the path crosses det W = 0."""
    rows = [
        (0, 0, 1.3, 0.2, True),
        (1, 0, 0.9, 0.1, True),
        (1, 0, None, 1e-12, False),
        (0, 1, 1.5, 0.3, True),
        (1, 1, 0.5, 0.2, True),
        (1, 1, 2.5, 0.1, False),
        (2, 1, 0.4, 0.2, True),
    ]
    names = ("k", "attempt", "error", "sigma_s", "accepted")
    records = [{**dict(zip(names, row, strict=True)), "sigma_jacobian": 0.01, "gamma": 0.5} for row in rows]
    outcome, message = Outcome.NOT_REACHED, "Nothing that was tried reached the goal."
    return replace(crossing(), iterations=records, outcome=outcome, message=message)


@cache
def broken() -> Solution:
    """Leg 2 and the clearance from det W = 0 outside their limits."""
    bounds = [Bound("leg_length", "leg_lengths", 20.0, 36.0), Bound("clearance.sigma_w", "sigma_w", 2.0)]
    problem = replace(good().problem, bounds=bounds)
    trajectory = good().trajectory
    reports = check_bounds(bounds, trajectory["t"], trajectory)
    verdict = Verdict(9.1e-4, False, "test", bounds=reports, reached=1.0)
    message = f"{reports[0].describe()}. {Outcome.CONSTRAINT_VIOLATED.advice}"
    return replace(
        good(), problem=problem, verdict=verdict, outcome=Outcome.CONSTRAINT_VIOLATED, message=message
    )


@cache
def stopped() -> Solution:
    """Ended for det S = 0, and the replay came no further than t = 0.3."""
    verdict = Verdict(None, False, "test", reached=0.3)
    return replace(good(), verdict=verdict, outcome=Outcome.SINGULAR_S, message="Update 1: det S vanishes.")


@cache
def untried() -> Solution:
    """A goal that breaks a bound itself: nothing was tried."""
    bounds = [Bound("leg_length", "leg_lengths", 20.0, 35.0)]
    problem = replace(good().problem, bounds=bounds)
    return replace(good(), problem=problem, iterations=[], outcome=Outcome.INFEASIBLE, message="Too long.")


@cache
def beyond() -> Solution:
    """A goal on the other side of det W = 0."""
    goal = {"position": np.array([0.3, 0.2, -35.0]), "orientation": so3.from_rpy([0, 0, -np.pi / 6])}
    problem = replace(good().problem, goal=goal)
    return replace(good(), problem=problem, iterations=[], outcome=Outcome.OTHER_COMPONENT)


CASES = [good, crossing, failed, hopeless, single, toy, spinner]
FAILURES = [lost, tries, broken, stopped, untried, beyond]


def lines_of(axes: Any) -> dict[str, Any]:
    return {line.get_label(): line for line in axes.get_lines() if not line.get_label().startswith("_")}


def words_of(figure: Any) -> str:
    texts = [text.get_text() for text in figure.texts]
    title = figure.get_suptitle()
    legends = [
        text.get_text() for axes in figure.axes if axes.get_legend() for text in axes.get_legend().get_texts()
    ]
    return " ".join([title, *texts, *legends]).replace("\n", " ")


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.__name__)
def test_every_picture_of_every_kind_of_solution(case: Any, tmp_path: Path) -> None:
    solution = case()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        kinds = ("svg", "png") if case is good else ("svg",)
        files = write_pictures(
            solution, tmp_path / "pictures", **({} if case is good else {"formats": kinds})
        )
    nothing_to_say = {
        "failure": solution.outcome is Outcome.CONVERGED,
        "margins": not any(name.startswith("sigma_") for name in solution.trajectory),
        "distances": "distance" not in solution.trajectory,
        "trees": "trees" not in solution.details,
    }
    names = [name for name in FIGURES if not nothing_to_say.get(name)]
    assert [file.name for file in files] == [f"{name}.{kind}" for name in names for kind in kinds]
    assert sorted(file.name for file in tmp_path.iterdir()) == ["pictures"]
    for file in files:
        if file.suffix == ".svg":
            assert ElementTree.parse(file).getroot().tag.endswith("svg")
        else:
            assert file.read_bytes().startswith(b"\x89PNG")
            assert file.stat().st_size > 2000


def test_only_what_is_asked_for(tmp_path: Path) -> None:
    files = write_pictures(good(), tmp_path, formats=("pdf",), names=["margins"])
    assert [file.name for file in files] == ["margins.pdf"]
    assert files[0].read_bytes().startswith(b"%PDF")


def test_png_size_and_layout_are_fixed(tmp_path: Path) -> None:
    (file,) = write_pictures(good(), tmp_path, formats=("png",), names=["controls"])
    width, height = struct.unpack(">II", file.read_bytes()[16:24])
    assert (width, height) == (round(2 * PANEL[0] * DOTS_PER_INCH), round(PANEL[1] * DOTS_PER_INCH))


def test_pictures_are_reproducible_to_the_byte(tmp_path: Path) -> None:
    for kinds, names in ((("svg",), ["controls", "convergence", "robot"]), (("pdf", "png"), ["robot"])):
        first = write_pictures(good(), tmp_path / "a", formats=kinds, names=names)
        second = write_pictures(good(), tmp_path / "b", formats=kinds, names=names)
        assert [file.read_bytes() for file in first] == [file.read_bytes() for file in second]


def test_drawing_leaves_no_trace_in_matplotlib(tmp_path: Path) -> None:
    from matplotlib import rcParams

    before = dict(rcParams)
    write_pictures(good(), tmp_path, names=["controls"])
    assert dict(rcParams) == before


def test_controls_show_the_trajectory() -> None:
    left, right = FIGURES["controls"](good()).axes
    trajectory = good().trajectory
    for i in range(3):
        np.testing.assert_array_equal(
            lines_of(left)[f"$v_{{{i + 1}}}$"].get_xydata(), np.c_[trajectory["t"], trajectory["v"][:, i]]
        )
        np.testing.assert_array_equal(
            lines_of(right)[f"$l_{{{i + 1}}}$"].get_ydata(), trajectory["leg_lengths"][:, i]
        )
    assert right.get_ylabel().endswith("[length]")


def test_relative_pose_is_the_error_of_the_paper() -> None:
    left, right = FIGURES["relative_pose"](good()).axes
    trajectory, goal = good().trajectory, good().problem.goal
    for i, name in enumerate(["$e_{p,{1}}$", "$e_{p,{2}}$", "$e_{p,{3}}$"]):
        drawn = lines_of(left)[name].get_ydata()
        np.testing.assert_array_equal(drawn, trajectory["position"][:, i] - goal["position"][i])
    drawn = np.array([lines_of(right)[f"$r_{i}$"].get_ydata() for i in (1, 2, 3)]).T
    for k in (0, 77, 200):
        turned = so3.exp(drawn[k]) @ goal["orientation"]
        np.testing.assert_allclose(turned, trajectory["orientation"][k], atol=1e-8)


def test_a_half_turn_is_marked_and_not_bridged() -> None:
    (axes,) = FIGURES["relative_pose"](spinner()).axes
    lines = lines_of(axes)
    mark = lines["half turn: no unique axis"].get_xdata()[0]
    assert mark == pytest.approx(np.pi / 4, abs=1e-2)
    drawn = lines["$r_3$"].get_ydata()
    assert np.isnan(drawn).any()
    assert np.nanmax(np.abs(np.diff(drawn))) < 0.1


def test_half_turn_exactly_at_a_sample_is_undefined() -> None:
    trajectory = {"t": np.array([0.0, 1.0]), "orientation": np.array([np.diag([-1.0, -1.0, 1.0]), np.eye(3)])}
    solution = replace(spinner(), trajectory=trajectory)
    block = solution.problem.system.state_space.blocks[0]
    assert np.isnan(panels.relative_values(solution, block)).tolist() == [[True] * 3, [False] * 3]


def test_a_via_pose_is_marked() -> None:
    via = [Via(0.25, {"position": [0, 0, 30]})]
    figure = FIGURES["relative_pose"](replace(good(), problem=replace(good().problem, via=via)))
    assert [lines_of(axes)["via pose"].get_xdata()[0] for axes in figure.axes] == [0.25, 0.25]


def test_convergence_shows_records_theory_and_tolerance() -> None:
    (axes,) = FIGURES["convergence"](good()).axes
    lines, ks = lines_of(axes), np.arange(70)
    np.testing.assert_array_equal(
        lines[r"error $\mathscr{E}$"].get_ydata(), [r["error"] for r in good().iterations]
    )
    np.testing.assert_allclose(
        lines[r"$\mathscr{E}(0)\,e^{-\gamma\theta}$"].get_ydata(), 1.3377 * np.exp(-0.1 * ks)
    )
    np.testing.assert_allclose(
        lines[r"$\mathscr{E}(0)\,(1-\gamma)^k$"].get_ydata(), 1.3377 * 0.9**ks, rtol=1e-12
    )
    assert lines["tolerance 0.001"].get_ydata()[0] == good().tolerance
    assert axes.get_yscale() == "log"


@pytest.mark.parametrize("gamma", [1.0, 0.5])
def test_convergence_with_steps_of_their_own(gamma: float) -> None:
    records = [
        {"k": 0, "error": 1.0},
        {"k": 1, "error": 0.4, "gamma": gamma},
        {"k": 2, "error": 0.3, "gamma": 0.2},
    ]
    theta, log_product = step_sums(replace(good(), iterations=records)) or (None, None)
    np.testing.assert_allclose(theta, [0, gamma, gamma + 0.2])
    np.testing.assert_allclose(np.exp(log_product), [1, 1 - gamma, (1 - gamma) * 0.8], atol=1e-12)


def test_other_solvers_have_no_theory_of_decay() -> None:
    (axes,) = FIGURES["convergence"](replace(good(), solver="nlp", settings={})).axes
    assert not any("gamma" in name for name in lines_of(axes))


def test_a_failed_run_says_how_it_ended() -> None:
    assert "not finite" in words_of(FIGURES["convergence"](failed()))
    assert "rank deficient" in words_of(FIGURES["convergence"](single()))
    assert "recorded no error" in words_of(FIGURES["convergence"](hopeless()))


@pytest.mark.parametrize("name", ["controls", "relative_pose", "margins", "robot"])
def test_a_path_is_cut_at_the_first_nan_and_says_so(name: str) -> None:
    figure = FIGURES[name](failed())
    assert "not finite after t = 0.4" in words_of(figure)
    if name != "robot":
        ends = [len(line.get_xdata()) for axes in figure.axes for line in lines_of(axes).values()]
        assert set(ends) == {81}
    assert "No finite sample" in words_of(FIGURES[name](hopeless()))


def test_what_overflowed_without_nan_is_cut_too() -> None:
    position = np.array(good().trajectory["position"])
    position[150:] = 1e200
    solution = replace(good(), trajectory={**good().trajectory, "position": position})
    assert path_of(solution).samples == 150


def test_margins_show_singular_values_and_crossings() -> None:
    (axes,) = FIGURES["margins"](good()).axes
    drawn = lines_of(axes)[r"$\sigma_{\min}(W)$"].get_ydata()
    np.testing.assert_array_equal(drawn, good().trajectory["sigma_w"])
    assert "singularity" not in words_of(FIGURES["margins"](good()))

    times = panels.crossing_times(crossing())["det_w"]
    assert times
    assert "Parallel singularity" in words_of(FIGURES["margins"](crossing()))
    told = Verdict(None, True, "test", crossings=[Crossing("det_w", 0.5395, {}, True)])
    figure = FIGURES["margins"](replace(crossing(), verdict=told))
    assert "t = 0.539" in words_of(figure) or "t = 0.540" in words_of(figure)
    assert lines_of(figure.axes[0])[r"$\det\,W = 0$"].get_xdata()[0] == 0.5395


def test_the_robot_is_drawn_where_it_is_and_at_one_scale() -> None:
    figure = FIGURES["robot"](good())
    assert len(figure.axes) == 3
    trajectory, system = good().trajectory, good().problem.system
    for axes, k in zip(figure.axes, (0, 100, 200), strict=True):
        state = system.state_space.pack({name: trajectory[name][k] for name in system.state_space.names})
        leg = system.drawing(state)["lines"]["leg 2"]
        drawn = [np.array(line.get_data_3d()).T for line in axes.get_lines()]
        assert any(line.shape == leg.shape and np.allclose(line, leg) for line in drawn)
        assert any(np.array_equal(line, trajectory["position"]) for line in drawn)
        ranges = np.diff([axes.get_xlim3d(), axes.get_ylim3d(), axes.get_zlim3d()], axis=1).ravel()
        box = axes.get_box_aspect() if hasattr(axes, "get_box_aspect") else axes._box_aspect
        scales = np.array(box if box is not None else axes._box_aspect) / ranges
        np.testing.assert_allclose(scales, scales[0])


def test_a_kind_of_line_keeps_its_colour_along_the_path() -> None:
    """r, w3 and w4 are of one length, up to rounding."""
    legends = [drawing.legend_entries(pose.drawing) for pose in drawing.poses_of(crossing())]
    assert legends[0] == legends[1] == legends[2]
    assert "#000000" not in [style["color"] for _, style in legends[0]]  # the path's


def test_a_toy_shows_its_states_and_its_path() -> None:
    left, right = FIGURES["controls"](toy()).axes
    assert set(lines_of(left)) == {"$v$", "$w$"}
    assert set(lines_of(right)) == {"$x$", "$y$", r"$\theta$"}
    assert len(FIGURES["relative_pose"](toy()).axes) == 2  # lengths, and the angle


def test_jumps_of_a_control_are_drawn_as_jumps() -> None:
    class Steps(Fourier):
        """Two intervals, standing in for a piecewise constant basis."""

        size = 2  # type: ignore[assignment]
        labels = ("1", "2")  # type: ignore[assignment]

        def breakpoints(self, horizon: float) -> Any:
            return np.array([0.5 * horizon])

        def table(self, times: Any, horizon: float, side: str = "right") -> Any:
            times = np.asarray(times)
            late = times >= 0.5 if side == "right" else times > 0.5
            return np.c_[~late, late].astype(float)

    solution = replace(toy(), control=Control(Steps(), [[1, 3], [2, -1]]))
    times = solution.trajectory["t"]
    values = solution.control(times)
    trajectory = {**solution.trajectory, "v": values[:, 0], "w": values[:, 1]}
    line = lines_of(FIGURES["controls"](replace(solution, trajectory=trajectory)).axes[0])["$v$"]
    at_jump = line.get_xdata() == 0.5
    np.testing.assert_array_equal(line.get_ydata()[at_jump], [1, 3])
    assert (np.diff(line.get_xdata()) >= 0).all()


# --- why a solve failed ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("case", FAILURES, ids=lambda case: case.__name__)
def test_every_kind_of_failure_has_its_picture(case: Any, tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        (file,) = write_pictures(case(), tmp_path, formats=("png",), names=["failure"])
    assert file.stat().st_size > 2000


def test_a_failure_is_titled_with_its_ending_and_says_no_more_than_needed() -> None:
    words = words_of(FIGURES["failure"](broken()))
    assert words.startswith("constraint violated: leg_length[")
    assert "loosen it" not in words
    assert words_of(FIGURES["failure"](stopped())).startswith("singular S: Update 1: det S vanishes.")
    assert len(FIGURES["failure"](replace(single(), message="word " * 400)).get_suptitle()) < 500


def test_a_failure_shows_every_evaluation_and_what_was_refused() -> None:
    errors, margins, path = FIGURES["failure"](tries()).axes
    drawn = [line.get_xydata() for line in errors.get_lines()]
    first, second = ([[0, 1.3], [1, 0.9]], [[3, 1.5], [4, 0.5], [6, 0.4]])
    for expected in (first, second, [[2, np.nan], [5, 2.5]]):
        assert any(np.array_equal(line, expected, equal_nan=True) for line in drawn), expected
    assert lines_of(errors)["not finite"].get_xdata().tolist() == [2]
    assert any(list(line.get_xdata()) == [2.5, 2.5] for line in errors.get_lines())  # between the tries
    assert set(lines_of(margins)) == {r"$\sigma_{\min}(J)$", r"$\sigma_{\min}(S)$", r"$\leq$"}
    marks = lines_of(path)[r"$\det\,W$ $= 0$"].get_xdata()
    np.testing.assert_allclose(marks, panels.crossing_times(tries())["det_w"])


def test_the_convergence_of_several_tries_is_that_of_the_best() -> None:
    lines = lines_of(FIGURES["convergence"](tries()).axes[0])
    assert lines[r"error $\mathscr{E}$"].get_xydata().tolist() == [[0, 1.5], [1, 0.5], [2, 0.4]]
    assert lines["trial"].get_xydata().tolist() == [[1, 2.5]]
    theta, _ = step_sums(tries()) or (None, None)
    np.testing.assert_allclose(theta, [0, 0.5, 1])  # of accepted steps alone


def test_a_broken_bound_is_drawn_with_its_limit_and_its_worst_place() -> None:
    _, legs, clearance = FIGURES["failure"](broken()).axes
    (report, other) = broken().verdict.bounds  # type: ignore[union-attr]
    mark = next(line for name, line in lines_of(legs).items() if "at $t$" in name)
    assert mark.get_xydata().tolist() == [[report.time, report.value]]
    name = f"$l_{{{report.component[0] + 1}}}$"
    drawn = good().trajectory["leg_lengths"][:, report.component[0]]
    np.testing.assert_array_equal(lines_of(legs)[name].get_ydata(), drawn)
    assert {20.0, 36.0} <= {float(line.get_ydata()[0]) for line in legs.get_lines() if len(line.get_ydata())}
    assert legs.get_ylabel() == "leg length $l$ [length]"
    assert clearance.get_ylabel() == r"clearance $\sigma_{\min}(W)$ [–]"
    assert other.value < 2.0


def test_a_path_is_drawn_no_further_than_the_replay_followed_it() -> None:
    figure = FIGURES["failure"](stopped())
    path = figure.axes[-1]
    assert max(line.get_xdata().max() for line in (lines_of(path)[r"$\det\,S$"],)) <= 0.3
    assert "path ends, $t$ = 0.3" in lines_of(path)
    assert "The path ends at t = 0.3 of 1." in words_of(figure)


def test_what_was_never_tried_shows_its_two_ends() -> None:
    (axes,) = FIGURES["failure"](untried()).axes
    (length,) = {float(name) for name in lines_of(axes) if name[0].isdigit()}
    problem = untried().problem
    goal = [leg.length for leg in problem.system.leg_poses(problem.goal_point)]  # type: ignore[attr-defined]
    assert length == pytest.approx(max(goal), rel=1e-3)
    np.testing.assert_allclose([lines_of(axes)[f"$l_{{{i}}}$"].get_ydata()[1] for i in (1, 2, 3)], goal)
    (axes,) = FIGURES["failure"](beyond()).axes
    start, end = lines_of(axes)[r"$\det\,W$"].get_ydata()
    assert start * end < 0


@pytest.mark.parametrize(
    ("name", "index", "expected"),
    [
        ("v", 0, "$v_{1}$"),
        ("p", 2, "$p_{3}$"),
        ("u1", None, "$u_{1}$"),
        ("theta0_dot", None, r"$\dot{\theta}_{0}$"),
        ("omega_z", None, r"$\omega_{z}$"),
        ("x_dot", None, r"$\dot{x}$"),
        ("hitch_angle", None, "hitch angle"),
        ("v_0", None, "$v_{0}$"),
        (r"\dot\alpha_1", None, r"$\dot\alpha_{1}$"),
    ],
)
def test_symbols(name: str, index: int | None, expected: str) -> None:
    assert symbol(name, *([] if index is None else [index])) == expected


@pytest.mark.parametrize(
    ("label", "words"),
    [
        ("leg length $l_{1}$", "leg length l₁"),
        (r"$\sigma_{\min}(S)$ [–]", "σmin(S) [–]"),
        (r"error $\mathscr{E}$ [–]", "error E [–]"),
        (r"control $\dot{\theta}_{0}$ [rad]", "control θ̇₀ [rad]"),
        ("$p_{1}$ – goal [length]", "p₁ – goal [length]"),
        ("time [–]", "time [–]"),
        (r"control $\dot\alpha_{1}$, $\dot q_{2}$", "control α̇₁, q̇₂"),
        (r"$\Omega_{3}$ over $x_2, \dots, x_n$", "Ω₃ over x₂, …, xₙ"),
    ],
)
def test_words_of_labels(label: str, words: str) -> None:
    assert plain_words(label) == words


# --- systems of every kind --------------------------------------------------------------------------------------------


def of_library(stem: str) -> Solution:
    """A solution of the library's problem under its own first control."""
    problem = library_problem(stem)
    return solved(problem, problem.initial)


@pytest.mark.parametrize(
    "stem", ["unicycle", "veselova_joint", "suslov_joint", "rolling_sphere", "heisenberg"]
)
def test_the_path_is_that_of_the_point_which_the_system_names(stem: str) -> None:
    solution = of_library(stem)
    path, system = path_of(solution), solution.problem.system
    points = drawing.path_points(solution, path)
    first = np.asarray(system.drawing(solution.problem.start_point)["trace"])
    assert points.shape == (len(path.times), len(first))
    np.testing.assert_allclose(points[0], first, atol=1e-12)
    assert np.ptp(points, axis=0).max() > 0.1


def test_a_unicycle_is_seen_from_above_at_one_scale() -> None:
    figure = FIGURES["robot"](of_library("unicycle"))
    assert [axes.name for axes in figure.axes] == ["rectilinear"] * 3
    assert {axes.get_aspect() for axes in figure.axes} == {1.0}
    assert all(len(axes.patches) == 2 for axes in figure.axes)  # its body and its wheel, filled
    assert figure.axes[0].get_xlabel() == "$x$ [length]"


def test_wheels_and_windows_are_dark_parts_of_a_body() -> None:
    """A ghost leaves them out."""
    pose = drawing.goal_pose(of_library("car").problem)
    axes = Figure().add_subplot()
    drawing.plot_robot(axes, pose.drawing)
    shades = [to_hex(patch.get_facecolor()) for patch in axes.patches]
    assert sorted(shades) == [drawing.DARK] * 5 + [to_hex(drawing.FILLS[0])]
    drawing.plot_robot(axes, pose.drawing, ghost=True)
    assert len(axes.get_lines()) == 1


def test_numbers_that_are_no_places_have_scales_and_names_of_their_own() -> None:
    figure = FIGURES["robot"](of_library("chained"))
    assert {axes.get_aspect() for axes in figure.axes} == {"auto"}
    assert figure.axes[0].get_ylabel() == r"$x_2, \dots, x_n$"


def test_a_joint_alone_has_no_lengths() -> None:
    figure = FIGURES["robot"](of_library("veselova_joint"))
    assert [axes.name for axes in figure.axes] == ["3d"] * 3
    assert figure.axes[0].get_xlabel() == "$x$"


def test_paths_on_the_floor_are_compared_from_above() -> None:
    """The mechanism in space; its paths alone, flat, in the plane."""
    solution = of_library("rolling_sphere")
    entries = [Entry(solution, "first"), Entry(solution, "second")]
    path = next(found for found in overlays(entries, ["first", "second"]) if found.name == "path")
    assert [axes.name for axes in path.figure.axes] == ["3d", "rectilinear"]


def test_the_goal_of_a_system_without_bodies_is_drawn_too() -> None:
    goal = drawing.goal_pose(of_library("free_nilpotent_36").problem)
    axes = Figure().add_subplot(projection="3d")
    drawing.plot_robot(axes, goal.drawing, ghost=True)
    assert len(axes.get_lines()) == 1
