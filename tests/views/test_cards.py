"""Cards in notebooks: the verdict, a table and a picture of whatever there is, escaped, on any background."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import nhpocp
from nhpocp.comparison import Comparison
from nhpocp.outcome import Outcome
from nhpocp.problem_file.registry import SYSTEMS, system_class
from nhpocp.shown import Shown
from nhpocp.solution import Verdict
from tests.conftest import LIBRARY, Runaway, Turntable, axe_violations, library_problem, paper_problem
from tests.views.test_figures import CASES, FAILURES, good, hopeless, toy
from tests.views.test_report import SCRIPT, Page

ROOT = Path(__file__).parents[2]
LARGEST = 60_000  # characters of a card: a notebook holds some


def card(shown):
    """Its page, and the pictures in it."""
    html = shown._repr_html_()
    assert len(html) < LARGEST
    page = Page(html)
    pictures = page.named("img")
    assert all(picture["src"].startswith("data:image/png;base64,") and picture["alt"] for picture in pictures)
    assert "no picture" not in page.words
    return page, pictures


@pytest.mark.parametrize("case", [*CASES, *FAILURES], ids=lambda case: case.__name__)
def test_every_kind_of_solution_says_how_it_ended_and_shows_why(case):
    solution = case()
    page, pictures = card(solution)
    tag = solution.outcome.value.replace("_", " ") if solution.verdict else "not verified yet"
    assert tag in page.words
    assert solution.message in page.words
    assert len(pictures) == 1


def test_numbers_of_a_solution_are_its_own():
    solution = nhpocp.solve(paper_problem(bounds={"leg_length": [5, 60]}), nhpocp.Auto())
    words = card(solution)[0].words
    shown = float(re.search(r"effort\s*([\d.]+)", words)[1])
    assert shown == pytest.approx(solution.control.effort, rel=1e-5)
    assert "1 of 1" in words
    assert re.search(rf"evaluations\s*{solution.evaluations}\b", words)


@pytest.mark.parametrize("name", LIBRARY)
def test_problems_and_their_systems_have_a_card(name):
    problem = library_problem(name)
    page, pictures = card(problem)
    assert problem.name in page.words
    drawn = bool(problem.system.drawing(problem.start_point)["lines"])
    assert len(pictures) == drawn
    page, pictures = card(problem.system)
    assert problem.system.model in page.words
    assert len(pictures) == drawn


@pytest.mark.parametrize("model", SYSTEMS)
def test_a_system_names_its_parameters_inputs_and_states(model):
    system = system_class(model)()
    words = card(system)[0].words
    for name in (*system.state_space.names, *system.input_space.names, *system.parameters()):
        assert name in words or system.parameters()[name] is None


def test_a_doubtful_problem_says_what_is_doubted():
    problem = paper_problem(goal={"position": [0, 0, 25]}, bounds={"leg_length": [40, 60]})
    page, _ = card(problem)
    assert "doubtful" in page.words
    assert "no plan can begin there" in page.words


def test_a_comparison_has_a_table_for_each_problem():
    verdict = Verdict(1e-4, True, "by hand")
    verified = replace(good(), verdict=verdict)
    failed = replace(verified, solver="nlp", outcome=Outcome.STAGNATED)
    page, pictures = card(
        Comparison.of([verified, failed, replace(toy(), verdict=verdict)], notes=["One is missing."])
    )
    assert "1 of 2 verified" in page.words
    assert "1 of 1 verified" in page.words
    assert "One is missing." in page.words
    assert len(page.named("table")) == len(pictures) == 2
    many = Comparison.of(
        [
            replace(toy(), problem=toy().problem.with_(name=f"n{i}", horizon=1.0 + i))  # six tasks, not one
            for i in range(6)
        ]
    )
    assert "2 more problems" in card(many)[0].words
    assert "no runs" in card(Comparison([]))[0].words


@pytest.fixture(scope="module")
def of_the_paper():
    return nhpocp.analyze(paper_problem())


@pytest.mark.parametrize("stem", ["paper", "unicycle"])
def test_an_analysis_says_what_it_found(stem, of_the_paper):
    analysis = of_the_paper if stem == "paper" else nhpocp.analyze(ROOT / "problems" / f"{stem}.yaml")
    page, pictures = card(analysis)
    assert analysis.controllability.sentence in page.words
    assert str(analysis.points["start"].growth.vector) in page.words
    assert len(pictures) == 1


def test_systems_that_draw_nothing_or_bring_no_example_have_no_picture():
    for system in (Runaway(), Turntable()):
        assert card(system)[1] == []


class Faulty(Turntable):
    """Its author's drawing fails."""

    def drawing(self, state):
        raise ZeroDivisionError("no drawing today")


def test_a_drawing_that_fails_costs_the_picture_alone():
    start = {"angle": 0, "orientation": np.eye(3)}
    problem = nhpocp.PlanningProblem(system=Faulty(), start=start, goal={"angle": 1})
    html = problem._repr_html_()
    assert "no picture: ZeroDivisionError: no drawing today" in html
    assert "<img" not in html


def test_everything_is_escaped(of_the_paper):
    problem = nhpocp.replace(paper_problem(), name=SCRIPT)
    verdict = Verdict(1.0, False, "by hand", [SCRIPT], warnings=[SCRIPT])
    solution = replace(
        *(good(),),
        problem=problem,
        solver=SCRIPT,
        message=SCRIPT,
        warnings=[SCRIPT],
        outcome=Outcome.NOT_VERIFIED,
        verdict=verdict,
        details={"comparison": {"variant": SCRIPT}},
    )
    analysis = replace(of_the_paper, map=None, end_point=None, problem=problem, notes=[SCRIPT])
    for shown in (problem, solution, Comparison.of([solution], notes=[SCRIPT]), analysis):
        html = shown._repr_html_()
        assert "<script" not in html
        assert html.count("&lt;script&gt;") >= 2
        assert not Page(html).named("script")


def test_all_that_is_shown_has_a_card():
    kinds = {cls for cls in vars(nhpocp)["_HOMES"] if isinstance(getattr(nhpocp, cls), type)}
    shown = {name for name in kinds if issubclass(getattr(nhpocp, name), Shown)}
    assert {"Analysis", "Comparison", "PlanningProblem", "Solution", "System"} <= shown
    with pytest.raises(NotImplementedError, match="no card shows a Shown"):
        Shown()._repr_html_()


@pytest.fixture(scope="module")
def cards():
    shown = [good(), hopeless(), paper_problem(), paper_problem().system, Comparison.of([good(), toy()])]
    return "".join(each._repr_html_() for each in shown)


@pytest.mark.parametrize(("paper", "ink"), [("#fff", "#000"), ("#111", "#e8e8e8")], ids=["light", "dark"])
def test_a_card_reads_on_any_background(paper, ink, cards, browser):
    page = browser.new_page()
    page.set_content(
        f"<!doctype html><html lang='en'><title>cards</title><body style='background:{paper};color:{ink}'>"
        f"<main><h1>cards</h1>{cards}</main></body></html>"
    )
    assert axe_violations(page) == []  # contrast among them
    assert page.evaluate("[...document.images].every((image) => image.naturalWidth > 100)")
    colours = "[...document.querySelectorAll('.nhpocp-card td')].map((cell) => getComputedStyle(cell).color)"
    assert len(set(page.evaluate(colours))) == 1  # the page's own
    page.close()
