"""The page that plays: positions are the trajectory's, nothing comes from outside, and it moves in a browser."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from nhpocp import planning
from nhpocp.comparison import Comparison, Entry
from nhpocp.errors import InvalidProblemError
from nhpocp.outcome import Outcome
from nhpocp.problem_file.registry import SYSTEMS
from nhpocp.solution import Solution
from nhpocp.solution_folder import load_solution, save_solution
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.step_rules import Euler
from nhpocp.views import animation
from nhpocp.views.animation import LARGEST, animate_runs, render, write_animation
from tests.conftest import LIBRARY, axe_violations, library_problem, paper_problem
from tests.views.test_figures import CASES, crossing, good, hopeless, of_library
from tests.views.test_figures import solved as solved_by_hand
from tests.views.test_report import SCRIPT, Page

LIMIT = 6e6  # bytes


def entries(*solutions: Solution) -> list[Entry]:
    return list(Comparison.of(solutions).entries)


def data_of(page: str) -> Any:
    found = re.search(r'<script id="animation-data" type="application/json">(.*?)</script>', page, re.DOTALL)
    assert found
    return json.loads(found[1])


def part(run: Any, name: str) -> Any:
    return next(part for part in run["parts"] if part["name"] == name)


@cache
def two() -> str:
    """The robot on two clocks: one run ends earlier, and crosses det W = 0."""
    return render(entries(good(), replace(crossing(), solver="nlp")))


def test_legs_end_where_the_stored_trajectory_puts_them(tmp_path):
    solved = planning.solve(paper_problem(), Continuation(step_rule=Euler(gamma=1.0)))
    save_solution(solved, tmp_path / "folder")
    page = render(entries(load_solution(tmp_path / "folder")))
    run, stored = data_of(page)["runs"][0], np.load(tmp_path / "folder" / "arrays.npz")
    np.testing.assert_array_equal(run["times"], stored["t"])
    for i, leg in enumerate(solved.problem.system.legs, 1):
        ends = np.array(part(run, f"leg {i}")["values"])
        heads = stored["position"] + stored["orientation"] @ np.array(leg.platform)
        np.testing.assert_allclose(ends[:, 0], np.broadcast_to(leg.base, heads.shape), rtol=0, atol=1e-12)
        np.testing.assert_allclose(ends[:, 1], heads, rtol=0, atol=1e-12)
        lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        np.testing.assert_allclose(lengths, stored["leg_lengths"][:, i - 1], rtol=1e-12)
        assert part(run, f"leg {i}")["tube"] < lengths.min()  # the piston never leaves its tube
    outline = np.array(part(run, "platform")["values"])
    np.testing.assert_allclose(
        outline[:, 1], np.array(part(run, "leg 2")["values"])[:, 1], rtol=0, atol=1e-12
    )


def test_panels_hold_the_stored_numbers():
    panels = {panel["name"]: panel for panel in data_of(two())["runs"][1]["panels"]}
    assert list(panels)[:2] == ["controls", "leg_lengths"]
    assert {"error position", "error orientation", "margins"} < set(panels)
    for i, curve in enumerate(panels["leg_lengths"]["curves"]):
        np.testing.assert_allclose(curve["y"], crossing().trajectory["leg_lengths"][:, i], rtol=1e-5)
    labels = [curve["label"] for curve in panels["margins"]["curves"]]
    assert labels == ["<i>σ</i><sub>min</sub>(<i>S</i>)", "<i>σ</i><sub>min</sub>(<i>W</i>)"]
    assert [mark["words"] for mark in panels["margins"]["marks"]] == ["det W = 0"] * 2


def test_every_panel_says_its_units():
    def titles(page):
        return {panel["name"]: panel["words"] for panel in data_of(page)["runs"][0]["panels"]}

    robot = titles(two())
    assert robot["u"] == "leg speed u [length per unit time]"
    assert robot["joint_angles 1"] == "joint angle θ₁ [rad]"
    assert robot["platform_normal"] == "platform normal"
    assert {"joint_angles 2", "joint_angles 3"} < set(robot)
    for name, unit in (
        ("controls", "rad per unit time"),
        ("leg_lengths", "length"),
        ("error position", "length"),
    ):
        assert robot[name].endswith(f"[{unit}]")
    page = render(entries(of_library("unicycle")))
    assert titles(page)["state angle"] == "state θ [rad]"
    controls = data_of(page)["runs"][0]["panels"][0]["curves"]  # of different units: each says its own
    assert [curve["unit"] for curve in controls] == ["length per unit time", "rad per unit time"]


def test_crossings_are_marked_in_time_and_in_space():
    run = data_of(two())["runs"][1]
    trajectory = crossing().trajectory
    assert len(run["crossings"]) == 2
    for found in run["crossings"]:
        k = np.searchsorted(trajectory["t"], found["t"])
        before, after = trajectory["position"][[k - 1, k]]
        assert trajectory["det_w"][k - 1] * trajectory["det_w"][k] <= 0
        low, high = np.minimum(before, after), np.maximum(before, after)
        assert (low - 1e-4 <= found["point"]).all()
        assert (np.array(found["point"]) <= high + 1e-4).all()
        assert found["words"] == "det W = 0"
    assert two().count('class="tick"') == 2


def test_the_page_is_one_quiet_file(tmp_path):
    page = two()
    assert len(page.encode()) < LIMIT
    assert "http" not in page
    for _, attributes in Page(page).tags:
        for name in ("src", "href", "srcset", "data", "action"):
            assert str(attributes.get(name, "data:,")).startswith("data:,")
    file = write_animation(entries(good(), replace(crossing(), solver="nlp")), tmp_path / "a.html")
    assert file.read_text(encoding="utf-8") == page  # the same solutions give the same bytes


def test_users_words_are_escaped():
    solution = replace(
        good(), problem=replace(paper_problem(), name=SCRIPT), message=SCRIPT, outcome=Outcome.STAGNATED
    )
    page = render(entries(solution))
    assert SCRIPT not in page
    assert "alert" not in str(re.findall(r"<script[^>]*>(.*?)</script>", page, re.DOTALL)[1:])
    assert data_of(page)["runs"]


@pytest.mark.parametrize("name", LIBRARY)
def test_every_system_of_the_library_gives_a_page(name):
    problem = library_problem(name)
    shape = (problem.system.input_space.size, problem.basis.size)
    solution = solved_by_hand(problem, np.full(shape, 0.3) if problem.initial is None else problem.initial)
    run = data_of(render(entries(solution)))["runs"][0]
    assert any(len(part["values"]) == len(run["times"]) for part in run["parts"])  # something moves
    assert all(
        len(part["values"]) in (1, len(run["times"])) and re.fullmatch("#[0-9A-Fa-f]{6}", part["colour"])
        for part in run["parts"]
    )
    assert {ghost["words"] for ghost in run["ghosts"]} <= {"start", "goal"}
    assert all(ghost["outlines"] for ghost in run["ghosts"])
    assert run["trace"]
    assert len(run["panels"]) >= 2


def test_every_model_has_a_problem_here():
    assert {library_problem(name).system.model for name in LIBRARY} == set(SYSTEMS)


@pytest.mark.parametrize(
    "case", [case for case in CASES if case is not hopeless], ids=lambda case: case.__name__
)
def test_failed_and_undrawn_systems_give_a_page(case, monkeypatch):
    system = case().problem.system
    if system.parameters() is None:  # the toys say nothing of theirs
        monkeypatch.setattr(type(system), "parameters", lambda self: {})
    page = render(entries(case()))
    Page(page)
    assert not re.search(r"\b(NaN|Infinity)\b", json.dumps(data_of(page)))


def test_a_cut_path_is_shown_as_far_as_it_goes():
    failed = next(case for case in CASES if case.__name__ == "failed")()
    page = render(entries(failed))
    assert len(data_of(page)["runs"][0]["times"]) == 81
    assert "not finite after t = 0.4" in page
    assert "not a verified solution" in page


def test_what_cannot_stand_side_by_side_is_refused(tmp_path):
    with pytest.raises(InvalidProblemError, match="no path to show: it ended as solver_error"):
        render(entries(hopeless()))
    with pytest.raises(InvalidProblemError, match="moves in the plane and"):
        render(entries(good(), of_library("unicycle")))
    with pytest.raises(InvalidProblemError, match=f"at most {LARGEST}"):
        render(entries(good()) * (LARGEST + 1))
    assert animate_runs(entries(hopeless()), tmp_path / "none.html") is None
    assert not (tmp_path / "none.html").exists()


def test_different_systems_of_one_dimension_may_stand_side_by_side():
    runs = data_of(render(entries(good(), of_library("rolling_sphere"))))["runs"]
    assert [run["title"] for run in runs] == ["problem, Jacobian method", "rolling_sphere, Jacobian method"]
    assert runs[0]["high"] != runs[1]["high"]
    same = data_of(render(entries(good(), replace(good(), solver="nlp"))))["runs"]
    assert same[0]["high"] == same[1]["high"]


def test_what_is_not_finite_is_not_drawn(monkeypatch):
    system = type(good().problem.system)
    whole = system.drawing

    def torn(self, state):
        found = whole(self, state)
        if found["lines"]["leg 1"][1, 2] > 30:
            found["lines"]["platform"] = np.nan * found["lines"]["platform"]
            found["solids"]["leg 1"]["ends"] = np.nan * found["solids"]["leg 1"]["ends"]
            found["trace"] = np.full(3, np.nan)
        else:
            found["trace"] = state[:3]
        return found

    monkeypatch.setattr(system, "drawing", torn)
    run = data_of(render(entries(good())))["runs"][0]
    for name in ("leg 1", "platform"):
        values = part(run, name)["values"]
        assert values[0] is not None
        assert values[-1] is None
    assert run["trace"][-1] == run["trace"][-2]


def test_long_trajectories_are_thinned_with_both_ends(monkeypatch):
    monkeypatch.setattr(animation, "SAMPLES", 11)
    monkeypatch.setattr(animation, "LEAST", 3)
    run = data_of(render(entries(good())))["runs"][0]
    np.testing.assert_allclose(run["times"], good().trajectory["t"][::20])
    assert {len(curve["t"]) for panel in run["panels"] for curve in panel["curves"]} == {44}
    assert all(curve["t"][-1] == 1 for panel in run["panels"] for curve in panel["curves"])
    runs = data_of(render(entries(good(), good(), good(), good())))["runs"]
    assert [run["times"] for run in runs] == [[0, 0.5, 1]] * 4


# --- in a browser ---------------------------------------------------------------------------------------------------


@pytest.fixture
def opened(browser, tmp_path):
    """Opens a page from its file; at the end nothing may have been said or asked for."""
    said: list[str] = []
    pages = []

    def open_page(text: str, **options: Any) -> Any:
        file = tmp_path / "animation.html"
        file.write_text(text, encoding="utf-8")
        page = browser.new_page(viewport={"width": 1200, "height": 900}, **options)
        page.on("console", lambda message: said.append(message.text))
        page.on("pageerror", lambda error: said.append(str(error)))
        page.on("request", lambda asked: said.append(asked.url) if asked.url != file.as_uri() else None)
        page.goto(file.as_uri())
        pages.append(page)
        return page

    yield open_page
    for page in pages:
        page.close()
    assert [words for words in said if not words.startswith("data:,")] == []


def distance(page: Any, run: int, name: str, ghost: str) -> float:
    """Pixels between a body's corners and those of a ghost, the largest."""
    return page.evaluate(
        """([run, name, ghost]) => {
            const outline = nhpocp.data.runs[run].ghosts.find((found) => found.words === ghost).outlines[0];
            const ends = nhpocp.position(run, name).map((p) => nhpocp.project(run, p));
            const gaps = outline.map((p, i) => nhpocp.project(run, p).map((x, k) => x - ends[i][k]));
            return Math.max(...gaps.map((gap) => Math.hypot(...gap)));
        }""",
        [run, name, ghost],
    )


def test_playing_moves_the_platform_and_scrubbing_brings_it_to_the_goal(opened):
    page = opened(render(entries(good())))
    picture = page.locator("canvas")
    page.wait_for_timeout(200)
    assert page.evaluate("nhpocp.time()") == 0  # nothing plays by itself
    assert distance(page, 0, "platform", "start") < 1
    first = picture.screenshot()
    page.get_by_role("button", name="Play").click()
    page.wait_for_function("nhpocp.time() > 0.05")
    page.get_by_role("button", name="Pause").click()
    assert picture.screenshot() != first
    assert distance(page, 0, "platform", "start") > 2
    page.get_by_role("slider", name="time").fill("1")
    assert page.locator("#clock").inner_text() == "t = 1.000"
    assert distance(page, 0, "platform", "goal") < 2
    page.evaluate("nhpocp.frameTimes.length = 0, nhpocp.play(), 0")
    page.wait_for_function("nhpocp.frameTimes.length >= 30")
    times = page.evaluate("nhpocp.pause(), nhpocp.frameTimes")
    print(f"script a frame: median {np.median(times):.1f} ms over {len(times)} frames")


def test_keys_play_step_and_turn(opened):
    page = opened(two())
    page.keyboard.press("End")
    assert page.evaluate("nhpocp.time()") == 1
    page.keyboard.press("Home")
    page.keyboard.press("ArrowRight")
    assert page.evaluate("nhpocp.time()") == pytest.approx(0.01)
    page.keyboard.press("Space")
    page.wait_for_function("nhpocp.time() > 0.03")
    page.keyboard.press("Space")
    before = page.evaluate("[nhpocp.time(), nhpocp.project(1, [10, 0, 0])]")
    page.locator("#scene-1").focus()
    page.keyboard.press("ArrowLeft")  # turns the pictures, and leaves the clock alone
    page.wait_for_timeout(100)
    after = page.evaluate("[nhpocp.time(), nhpocp.project(1, [10, 0, 0])]")
    assert after[0] == before[0]
    assert after[1] != before[1]


def test_the_page_passes_axe_and_fits_a_telephone(opened):
    page = opened(two(), reduced_motion="reduce")
    assert axe_violations(page) == []
    page.set_viewport_size({"width": 400, "height": 800})
    assert page.evaluate("document.documentElement.scrollWidth") <= 400
    assert page.get_by_role("button", name="Play").is_visible()
    assert page.evaluate("nhpocp.time()") == 0


def test_a_vehicle_is_seen_from_above(opened):
    page = opened(render(entries(of_library("unicycle"))))
    right, up = page.evaluate(
        "[[1, 0], [0, 1]].map((p) => nhpocp.project(0, p).map((x, k) => x - nhpocp.project(0, [0, 0])[k]))"
    )
    assert right[0] == pytest.approx(-up[1])
    assert abs(right[1]) + abs(up[0]) < 1e-6 * right[0]


def test_numbers_that_are_no_places_fill_the_plane(opened):
    """The two axes of a phase plane have scales of their own."""
    page = opened(render(entries(of_library("double_integrator"))))
    low, high = page.evaluate(
        "[nhpocp.data.runs[0].low, nhpocp.data.runs[0].high].map((p) => nhpocp.project(0, p))"
    )
    width, height = page.evaluate(
        "(({ clientWidth: w, clientHeight: h }) => [w, h])(document.querySelector('canvas'))"
    )
    assert high[0] - low[0] > 0.7 * width
    assert low[1] - high[1] > 0.7 * height
