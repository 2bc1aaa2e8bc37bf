"""`analyze` as a whole: what it says of the library's problems, and of problems with parts missing."""

from __future__ import annotations

import json

import numpy as np
import pytest

import nhpocp
from nhpocp.analysis import analyze, slices
from nhpocp.analysis.slices import Span, chosen
from nhpocp.analysis_folder import save_analysis
from nhpocp.controls.fourier import Fourier
from nhpocp.errors import InvalidProblemError
from nhpocp.horizon import Horizon
from nhpocp.problem import PlanningProblem
from nhpocp.solution_folder.target import ANALYSIS_PICTURES
from nhpocp.solvers.nlp import guesses
from nhpocp.views import analysis_figures
from tests.analysis.test_growth import Leaves, Martinet
from tests.conftest import Integrators, Runaway, paper_problem


@pytest.fixture(scope="module", autouse=True)
def coarse():
    """Maps of few points, which is quicker."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(slices, "RESOLUTION", 25)
        yield


@pytest.fixture(scope="module")
def paper():
    return analyze(paper_problem())


@pytest.fixture(scope="module")
def conjecture():
    return analyze(paper_problem("paper_conjecture"))


def test_the_papers_robot(paper):
    assert {name: point.growth.vector for name, point in paper.points.items()} == {
        "start": (3, 6),
        "goal": (3, 6),
    }
    assert paper.path.irregular == []
    assert paper.path.crossings == ()
    assert paper.end_point.jacobian.shape == (6, 15)
    assert paper.end_point.condition == pytest.approx(46.9, rel=0.01)
    assert paper.map.first.name == "z"
    assert paper.map.second.name == "yaw"
    assert paper.points["start"].margins["det_s"] > 0


def test_the_path_of_the_guess_ends_where_physics_says(paper):
    """[physics §2]: p(T; Λ0)."""
    np.testing.assert_allclose(paper.path.states[-1][:3], [0.712869, 0.535277, 34.976485], atol=1e-6)


def test_paper_conjecture_has_growth_three_five_six_on_its_way(conjecture):
    """Where three brackets become dependent, between samples; with those of degree 3 they span again."""
    path = conjecture.path
    vectors = [path.growth[i].vector for i in path.irregular]
    assert vectors == [(3, 5, 6), (3, 5, 6)]
    np.testing.assert_allclose(path.times[path.irregular], [0.76006, 0.80633], atol=1e-5)
    assert path.weakest in path.irregular
    assert {crossing.which for crossing in path.crossings} == {"det_w"}
    np.testing.assert_allclose([c.time for c in path.crossings], [0.63259, 0.89002], atol=1e-5)


def test_the_loss_of_rank_is_a_change_of_sign(conjecture):
    """Independent of the search: the determinant of [g1 g2 g3 [g1,g2] [g1,g3] [g2,g3]] by differences of G."""
    problem, path = conjecture.problem, conjecture.path
    space = problem.system.state_space

    def determinant(point):
        step, fields = 1e-5, problem.system.vector_fields(point)

        def along(i):
            ends = [space.retract(point, sign * step * fields[:, i]) for sign in (1, -1)]
            one, two = (problem.system.vector_fields(end) for end in ends)
            return (one - two) / (2 * step)

        columns, slopes = [*fields.T], [along(i) for i in range(3)]
        for i, j in ((0, 1), (0, 2), (1, 2)):
            value = slopes[i][:, j] - slopes[j][:, i]
            value[3:] -= np.cross(fields[3:, i], fields[3:, j])
            columns.append(value)
        return np.linalg.det(np.array(columns))

    signs = {t: np.sign(determinant(state)) for t, state in zip(path.times, path.states, strict=True)}
    for i in path.irregular:
        assert signs[path.times[i - 1]] == -signs[path.times[i + 1]] != 0


def test_a_free_part_of_the_goal_is_said():
    found = analyze(paper_problem(goal={"position": [0, 0, 30]}))
    assert found.points["goal"].note == "orientation as at the start"


def test_a_goal_of_outputs_alone_is_no_state():
    found = analyze(paper_problem(goal={"leg_lengths": [38, 39, 40]}))
    assert list(found.points) == ["start"]
    assert "only the start" in found.notes[0]
    with pytest.raises(InvalidProblemError, match="no state 'goal'"):
        analyze(found.problem, at="goal")


def test_initial_auto_and_free_horizons_are_analysed_too():
    problem = paper_problem(initial=None, horizon=Horizon(None, 0.5, 1.5))
    found = analyze(problem)
    assert found.end_point.control.horizon == 1.0
    assert found.end_point.spectrum.rank == 6


def test_a_path_that_cannot_be_followed_is_analysed_as_far_as_it_goes():
    problem = PlanningProblem(
        system=Runaway(), start={"x": 1.0}, goal={"x": 3.0}, basis=Fourier(0), initial=[[2.0]]
    )
    found = analyze(problem)
    assert found.path.times[-1] == pytest.approx(0.5, abs=1e-3)
    assert found.end_point is None
    assert "ends at t = 0." in found.notes[0]


def test_without_any_guess_the_ends_are_analysed(monkeypatch):
    monkeypatch.setattr(guesses, "DRAWS", 0)
    start = {"x": 0.3, "y": 0.0, "z": 0.0}
    problem = PlanningProblem(system=Leaves(), start=start, goal=start)
    found = analyze(problem)
    assert found.path is None
    assert found.end_point is None
    assert found.controllability.kind == "not controllable"
    assert found.controllability.failing == ("start", "goal")
    assert "no initial guess" in found.notes[0]
    assert analysis_figures.names_of(found) == []
    with pytest.raises(InvalidProblemError, match="there is no initial guess"):
        analyze(problem, at=0.5)


def test_fields_that_are_not_finite_are_no_verdict():
    """A platform in the plane of the base, its legs along the base's radii: S is singular at the start."""
    flat = {"position": [0, 0, 0], "orientation": np.eye(3)}
    found = analyze(paper_problem("paper_conjecture", start=flat))
    assert found.points["start"].growth.vector == ()
    assert found.points["goal"].growth.vector == (3, 6)
    assert found.controllability.kind == "undecided"
    assert found.controllability.sentence.startswith("The fields are not finite at start")
    assert "the path of the initial guess ends at t = " in found.notes[0]
    assert "along_guess" not in analysis_figures.names_of(found)


def test_a_start_on_martinets_surface():
    problem = PlanningProblem(
        system=Martinet(),
        start={"x": 0.0, "y": 0.0, "z": 0.0},
        goal={"x": 0.0, "y": 1.0, "z": 1.0},
        basis=Fourier(1),
        initial=[[0, 1, 0], [1, 0, 0]],
    )
    found = analyze(problem)
    assert found.points["start"].growth.vector == (2, 2, 3)
    assert found.filtration.generic.vector == (2, 3)
    assert 0 in found.path.irregular


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"tolerance": 0.0}, "between 0 and 1"),
        ({"tolerance": float("nan")}, "between 0 and 1"),
        ({"degree": 0}, ">= 1"),
        ({"at": "middle"}, "there is start and goal"),
        ({"at": 7.0}, "goes from 0 to 1"),
    ],
)
def test_options_are_checked(options, words):
    with pytest.raises(InvalidProblemError, match=words):
        analyze(paper_problem(), **options)


def test_a_map_needs_something_to_watch():
    problem = PlanningProblem(system=Integrators(), start={"x": 0, "y": 0}, goal={"x": 1, "y": 0})
    spans = [Span(c) for c in chosen(problem.system.state_space, ["x", "y"])]
    with pytest.raises(InvalidProblemError, match="names no matrix"):
        analyze(problem, spans=spans)


def test_the_map_may_go_through_a_pose_of_the_path():
    found = analyze(paper_problem(), at=0.5)
    assert found.map.at == "t = 0.5"
    assert found.map.fixed()["x"] != 0


def test_public_names():
    assert isinstance(nhpocp.analyze(paper_problem(), degree=2), nhpocp.Analysis)


# --- pictures and files -----------------------------------------------------------------------------------------------


def test_own_pictures_are_known_to_the_folders():
    assert set(ANALYSIS_PICTURES) == set(analysis_figures.FIGURES)


def texts(figure):
    found = [*figure.texts, *(t for legend in figure.legends for t in legend.get_texts())]
    found += [t for axes in figure.axes for t in (axes.xaxis.label, axes.yaxis.label)]
    found += [t for axes in figure.axes if axes.get_legend() for t in axes.get_legend().get_texts()]
    return " ".join(t.get_text() for t in found)


def test_the_map_says_what_it_shows(conjecture):
    figure = analysis_figures.singularity_map(conjecture)
    words = texts(figure)
    for said in (
        "start",
        "goal",
        "initial guess",
        "keeps its sign",
        "changes its sign",
        "yaw [°]",
        r"\det W = 0",
    ):
        assert said in words
    assert "x$ = 0" in figure._supxlabel.get_text()
    assert len(figure.axes) == 4  # two panels, two scales of colours


def test_a_jump_of_sign_is_not_drawn_as_a_zero():
    values = np.ones((4, 6))
    values[:, 3:] = -1
    assert analysis_figures._jumps(values, 0.5)[:, 2:4].all()
    assert not analysis_figures._jumps(np.linspace(1, -1, 24).reshape(4, 6), 0.7).any()


def test_pictures_of_the_guess_and_of_the_ellipsoid(conjecture):
    words = texts(analysis_figures.along_guess(conjecture))
    assert "(3, 5, 6)" in words
    assert r"\sigma_{\min}(W)" in words
    figure = analysis_figures.agility(conjecture)
    assert "0.0741" in figure.axes[0].get_title(loc="left")
    assert len(figure.axes[0].patches) == 6


def test_folders_are_written_whole_and_replaced_only_if_ours(paper, tmp_path):
    folder = tmp_path / "out"
    for _ in range(2):
        save_analysis(paper, folder)
        assert sorted(file.name for file in folder.iterdir()) == ["analysis.json", "map.npz"]
    data = json.loads((folder / "analysis.json").read_text())
    assert data["controllability"]["verdict"] == "controllable"
    with np.load(folder / "map.npz") as arrays:
        assert set(arrays) == {"z", "yaw", "det_s", "det_w", "sigma_s", "sigma_w"}
        assert arrays["det_w"].shape == (arrays["yaw"].size, arrays["z"].size)
    (folder / "mine.txt").write_text("keep")
    with pytest.raises(InvalidProblemError, match="was not written by nhpocp"):
        save_analysis(paper, folder)
    assert (folder / "mine.txt").read_text() == "keep"
