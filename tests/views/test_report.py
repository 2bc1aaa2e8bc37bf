"""The report: self-contained, escaped, well-formed, the same bytes again, and quiet in a browser."""

from __future__ import annotations

import base64
import functools
import hashlib
import http.server
import json
import re
import subprocess
import threading
from dataclasses import replace
from html.parser import HTMLParser
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from nhpocp.comparison import Comparison
from nhpocp.controls.fourier import Fourier
from nhpocp.outcome import Outcome
from nhpocp.solution import Verdict
from nhpocp.views.report import render, write_report
from nhpocp.views.report_words import given, introduction, number, percent
from tests.conftest import CHROMIUM, axe_violations, paper_problem
from tests.test_comparison import line, made
from tests.views.test_figures import CASES, good

VOID = {"meta", "link", "br", "hr", "img", "input"}
SCRIPT = "<script>alert('you')</script>"


class Page(HTMLParser):
    """Tags balanced, ids unique; keeps attributes, headings and words."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, Any]]] = []
        self.words = ""
        self.feed(text)
        self.close()
        assert not self.open, f"never closed: {self.open}"
        ids = [attributes["id"] for _, attributes in self.tags if "id" in attributes]
        assert len(ids) == len(set(ids))

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: Any) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open
        assert self.open.pop() == tag, f"</{tag}> closes something else"

    def handle_data(self, data: str) -> None:
        if not (self.open and self.open[-1] in ("style", "script")):
            self.words += data

    def named(self, tag: str) -> list[dict[str, Any]]:
        return [attributes for name, attributes in self.tags if name == tag]


def both() -> Comparison:
    """A verified run and a refuted one, on the robot."""
    nlp = replace(
        good(),
        solver="nlp",
        outcome=Outcome.NOT_VERIFIED,
        message=f"E = 0.5 is above 1e-06. {Outcome.NOT_VERIFIED.advice}",
        verdict=Verdict(0.5, False, "by hand", ["E = 0.5 is above 1e-06"]),
        settings={"intervals": 50, "plugin": "ipopt"},
        details={
            "optimality": {"stationarity": 1e-9, "feasibility": 1e-10, "complementarity": 0.0},
            "status": "Solve_Succeeded",
            "guess_defect": 0.07,
        },
    )
    verified = replace(good(), verdict=Verdict(9.1e-4, True, "by hand"))
    return Comparison.of([verified, nlp])


@pytest.fixture(scope="module")
def page() -> str:
    return render(both())


def test_the_page_is_well_formed_and_accessible(page):
    parsed = Page(page)
    assert parsed.named("html") == [{"lang": "en"}]
    levels = [int(tag[1]) for tag, _ in parsed.tags if re.fullmatch("h[1-6]", tag)]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(later <= earlier + 1 for earlier, later in pairwise(levels))
    assert all("scope" in attributes for attributes in parsed.named("th"))
    assert all(svg["role"] == "img" and len(svg["aria-label"]) > 20 for svg in parsed.named("svg"))
    assert len(parsed.named("svg")) == 6


def test_the_page_needs_nothing_from_outside(page):
    for _, attributes in Page(page).tags:
        for name in ("src", "href", "srcset", "data", "action"):
            assert str(attributes.get(name, "#")).startswith(("#", "data:,"))
    assert "http" not in page
    assert "@import" not in page
    # a page that allows only this script and no inline handler stays what it is
    assert not [key for _, attributes in Page(page).tags for key in attributes if key.startswith("on")]
    assert not re.search(r"\b(eval|fetch|import|XMLHttpRequest|Function)\b\(", script(page))
    assert len(page.encode()) < 3e6


def script(page: str) -> str:
    """The page's own script, word for word: what a policy's hash is taken of."""
    (found,) = re.findall(r"<script>(.*?)</script>", page, flags=re.DOTALL)
    return found


def numbers(page: str) -> list[dict[str, Any]]:
    """What the script is told of each figure over time or iterations."""
    return [json.loads(text) for text in re.findall(r'<script type="application/json">(.*?)</script>', page)]


def test_every_reference_inside_the_page_leads_somewhere(page):
    parsed = Page(page)
    ids = {attributes["id"] for _, attributes in parsed.tags if "id" in attributes}
    wanted = set(re.findall(r'(?:href="#|url\(#)([^")]+)', page))
    assert wanted - ids == set()


def test_the_order_of_contents(page):
    titles = [
        "What was asked",
        "Verdict",
        "Results",
        "Figures",
        "Limits",
        "Certificate",
        "Settings",
        "Versions",
    ]
    places = [page.index(f">{title}") for title in titles]
    assert places == sorted(places)


def test_the_verdict_says_who_reached_the_goal_and_who_was_refuted(page):
    words = " ".join(Page(page).words.split())
    assert "the NLP claimed success and was refuted (E = 0.5 is above 1e-06)" in words
    assert "there is no other verified motion to compare it with" in words
    assert "no: refuted" in words


def test_the_certificate_is_shown(page):
    assert "ipopt: Solve_Succeeded" in page
    assert "stationarity" in page


def test_the_same_solutions_give_the_same_bytes(page, tmp_path):
    assert write_report(both(), tmp_path / "a.html").read_bytes() == page.encode()


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.__name__)
def test_every_kind_of_solution_gives_a_page(case, monkeypatch, undrawn):
    system = case().problem.system
    if system.parameters() is None:  # the toys say nothing of theirs
        monkeypatch.setattr(type(system), "parameters", lambda self: {})
    text = render(Comparison.of([case(), replace(case(), solver="nlp")]))
    Page(text)
    assert not re.search(r"\b(nan|inf|None)\b", text)


def test_users_words_are_escaped():
    problem = replace(paper_problem(), name=SCRIPT).read_from(f"# {SCRIPT}\nname: x  # assumed {SCRIPT}\n")
    solution = replace(
        good(),
        problem=problem,
        message=f"{SCRIPT}.",
        warnings=[SCRIPT],
        outcome=Outcome.STAGNATED,
        settings={SCRIPT: SCRIPT},
        details={"comparison": {"variant": f"nlp:{SCRIPT}", "environment": {"platform": SCRIPT}}},
    )
    refuted = replace(
        solution, outcome=Outcome.NOT_VERIFIED, verdict=Verdict(1.0, False, "by hand", [SCRIPT]), solver="nlp"
    )
    text = render(Comparison.of([solution, refuted], notes=[SCRIPT]))
    parsed = Page(text)
    own = [attributes.get("type", "") for attributes in parsed.named("script")]
    assert own == ["application/json"] * (len(own) - 1) + [""]
    assert "alert" not in script(text)
    assert text.count("&lt;script&gt;") > 8


def test_failed_runs_appear_with_their_reason(undrawn):
    failed = made(
        0.0,
        ok=None,
        evaluations=0,
        iterations=[],
        outcome=Outcome.SOLVER_ERROR,
        message="The horizon is free & open.",
    )
    page = Page(render(Comparison.of([failed])))
    words = " ".join(page.words.split())
    assert "The only run does not reach the goal: the Jacobian method ended as solver error" in words
    assert "The horizon is free & open" in words
    assert "No run produced a motion that could be drawn." in words
    assert "There is no verified motion" in words


def test_several_problems_share_a_summary(undrawn):
    runs = [made(), made(problem=line(goal=2.0, name="other")), made(problem=line(goal=3.0, name="third"))]
    page = Page(render(Comparison.of(runs)))
    assert [attributes["href"] for attributes in page.named("a")] == [
        "#problem-1",
        "#problem-2",
        "#problem-3",
    ]
    assert "All problems" in page.words


def test_many_runs_are_split_over_tables(undrawn):
    runs = [made(1 + 0.1 * k, settings={"gamma": float(k)}) for k in range(6)]
    page = Page(render(Comparison.of(runs)))
    assert "All 6 runs reach the goal" in page.words
    assert "tolerance" in page.words


def test_sentences_for_equal_costs(undrawn):
    words = " ".join(Page(render(Comparison.of([made(), made(solver="nlp")]))).words.split())
    assert "Both runs reach the goal" in words
    assert "costs the same" in words


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (None, "–"),
        (np.nan, "–"),
        (0.0, "0"),
        (-30.0, "−30.00"),
        (2.05082, "2.051"),
        (9.1e-8, "9.10&#8239;·&#8239;10<sup>−8</sup>"),
        (12, "12"),
        ("<b>", "&lt;b&gt;"),
    ],
)
def test_numbers_for_reading(value, words):
    assert number(value) == words


def test_chosen_numbers_keep_their_digits():
    assert [given(x) for x in (1.0, 0.001, 1e-6, 2.5e-7)] == [
        *("1", "0.001", "10<sup>−6</sup>", "2.5&#8239;·&#8239;10<sup>−7</sup>"),
    ]
    assert [percent(x) for x in (None, 0.0, 1e-9, 0.4901, 0.00123)] == [
        "–",
        "0 %",
        "0 %",
        "49.0 %",
        "0.1230 %",
    ]


def test_the_introduction_of_a_problem_file():
    text = (
        "# yaml-language-server: $schema=x\n# First\n# line.\n#\n# Second.\nnhpocp: 1\n"
        "gamma: 0.1  # assumed: ours\n# assumed alone\n"
    )
    assert introduction(text) == ["First line.", "Second."]
    assert introduction(None) == []


IN_A_BROWSER = pytest.mark.skipif(
    CHROMIUM is None, reason="no Chromium here: install it to see the report in a browser"
)


def test_the_script_is_told_what_is_drawn(page):
    figures = numbers(page)
    assert [figure["abscissa"] for figure in figures] == ["t", "t", "t", "t", "k"]
    solution = good()
    legs = figures[1]["panels"]
    assert [panel["name"] for panel in legs[:3]] == ["leg length l₁", "leg length l₂", "leg length l₃"]
    assert {panel["unit"] for panel in legs[3:]} == {"length per unit time"}
    for i, panel in enumerate(legs[:3]):
        assert [curve["name"] for curve in panel["curves"]] == ["Jacobian method", "NLP"]
        for curve in panel["curves"]:
            told = np.array(curve["y"])
            np.testing.assert_allclose(told, solution.trajectory["leg_lengths"][:, i], rtol=5.1e-4)
    convergence = figures[-1]["panels"][0]
    assert (convergence["y"][2], figures[-1]["interpolate"]) == (1, False)
    drawn = set(re.findall(r"[ML] (-?[\d.]+ -?[\d.]+)", page))
    drawn = np.array([[float(number) for number in pair.split()] for pair in drawn])
    for figure in figures:
        for panel in figure["panels"]:
            for curve in panel["curves"]:  # where the script puts its dots there is a line of the picture
                point = [
                    offset + factor * (np.log10(value) if log else value)
                    for (offset, factor, log), value in zip(
                        (panel["x"], panel["y"]), (figure["xs"][curve["x"]][-1], curve["y"][-1]), strict=True
                    )
                ]
                assert np.abs(drawn - point).max(axis=1).min() < 0.1


def opened(browser: Any, text: str, **options: Any) -> Any:
    """The page under the strictest policy that lets its own script run; complaints fail the test at `complaints`."""
    digest = base64.b64encode(hashlib.sha256(script(text).encode()).digest()).decode()
    policy = f"default-src 'none'; style-src 'unsafe-inline'; img-src data:; script-src 'sha256-{digest}'"
    tab = browser.new_context(viewport={"width": 1100, "height": 900}, **options).new_page()
    tab.complaints = []
    tab.on("console", lambda message: tab.complaints.append(message.text))
    tab.on("pageerror", lambda error: tab.complaints.append(str(error)))
    headers = {"Content-Security-Policy": policy, "Content-Type": "text/html; charset=utf-8"}
    tab.route("**/*", lambda route: route.fulfill(body=text, headers=headers))
    tab.goto("http://report.test/")
    return tab


@IN_A_BROWSER
def test_the_pointer_shows_the_values_of_the_curves(page, browser):
    tab = opened(browser, page)
    figure, solution, told = tab.locator(".plot").nth(1), good(), numbers(page)[1]
    board, panel = figure.locator(".readout"), told["panels"][1]
    assert board.count() == 1
    assert not board.is_visible()
    figure.scroll_into_view_if_needed()
    box = figure.locator("svg").bounding_box()
    zoom = box["width"] / float(figure.locator("svg").get_attribute("viewBox").split()[2])
    across = panel["x"][0] + 0.37 * panel["x"][1]
    tab.mouse.move(box["x"] + zoom * across, box["y"] + zoom * (panel["box"][1] + panel["box"][3]) / 2)
    times, lengths = solution.trajectory["t"], solution.trajectory["leg_lengths"][:, 1]
    nearest = int(np.argmin(np.abs(times - 0.37)))
    heading, *rows = board.inner_text().splitlines()
    assert heading == f"leg length l₂ at t = {times[nearest]:g}"
    assert rows == [f"{name}: {lengths[nearest]:.2f} length" for name in ("Jacobian method", "NLP")]
    tab.mouse.move(5, 5)
    assert not board.is_visible()
    figure.focus()
    for key in ("Home", "Shift+ArrowRight", "ArrowRight", "ArrowDown"):
        tab.keyboard.press(key)
    assert board.inner_text().startswith(f"leg length l₃ at t = {times[11]:g}\n")
    tab.keyboard.press("Escape")
    assert not board.is_visible()
    assert tab.complaints == []


@IN_A_BROWSER
def test_without_javascript_nothing_is_missing(page, browser):
    off = opened(browser, page, java_script_enabled=False)
    assert off.locator("figure svg").count() == 6
    assert off.locator("figcaption:visible").count() == 6
    assert off.locator(".readout").count() == 0
    assert off.locator("script:visible").count() == 0


@IN_A_BROWSER
def test_paper_shows_no_cursor(page, browser):
    tab = opened(browser, page)
    tab.locator(".plot").first.focus()
    tab.keyboard.press("ArrowRight")
    assert tab.locator(".readout:visible").count() == 1
    tab.emulate_media(media="print")
    assert tab.locator(".readout:visible").count() == 0


@IN_A_BROWSER
def test_the_values_fit_a_narrow_page(page, browser):
    tab = opened(browser, page)
    tab.set_viewport_size({"width": 400, "height": 700})
    tab.locator(".plot").first.focus()
    for key in ("Home", "End"):
        tab.keyboard.press(key)
        assert tab.locator(".readout:visible").count() == 1
        assert tab.evaluate("document.documentElement.scrollWidth <= innerWidth")


@IN_A_BROWSER
def test_a_browser_finds_nothing_to_complain_of(page, tmp_path):
    (tmp_path / "report.html").write_text(page, encoding="utf-8")
    asked: list[str] = []

    class Handler(http.server.SimpleHTTPRequestHandler):
        def log_request(self, *_: Any) -> None:
            asked.append(self.path)

        def log_message(self, *_: Any) -> None:
            pass

    handler = functools.partial(Handler, directory=str(tmp_path))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        done = subprocess.run(
            [
                *(str(CHROMIUM), "--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr"),
                *(f"--user-data-dir={tmp_path / 'profile'}", "--window-size=1200,4000"),
                f"--screenshot={tmp_path / 'report.png'}",
                f"http://127.0.0.1:{server.server_port}/report.html",
            ],
            capture_output=True,
            text=True,
            timeout=120,
            check=True,
        )
        server.shutdown()
    assert asked == ["/report.html"]
    assert "CONSOLE" not in done.stderr
    assert (tmp_path / "report.png").stat().st_size > 50_000


def test_the_report_passes_axe(browser, tmp_path, page):
    file = tmp_path / "report.html"
    file.write_text(page, encoding="utf-8")
    tab = browser.new_page(viewport={"width": 1200, "height": 900})
    tab.goto(file.as_uri())
    assert axe_violations(tab) == []
    tab.close()


def test_animations_are_linked_where_there_are_some(undrawn):
    page = Page(render(Comparison.of([made()]), {"line": "a b/animation.html"}))
    assert page.named("a") == [{"href": "a%20b/animation.html"}]
    assert "a b/animation.html" in page.words


def test_the_control_to_begin_with_is_said_of_every_run_that_has_its_own(undrawn):
    runs = [made(problem=line(basis=Fourier(h), initial=None).read_from(f"harmonics: {h}")) for h in (1, 3)]
    words = Page(render(Comparison.of(runs))).words
    for h in (1, 3):
        name = f"Jacobian method (harmonics = {h})"
        assert f"{name}: fourier, {h} harmonics; drawn by a seed" in words
        assert f"The problem file as read for {name}:harmonics: {h}" in words.replace("\n", "")
    alone = Page(render(Comparison.of([made(), made(settings={"gamma": 0.5})]))).words
    assert "Jacobian method (gamma = 0.1): fourier" not in alone
