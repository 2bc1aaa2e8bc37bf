"""Pictures, player, table and progress of a solution inside a notebook's cell."""

import builtins
import io
import re
import sys
from html import unescape

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

import nhpocp
from nhpocp.solution_folder import save_solution
from nhpocp.views import inline_progress
from nhpocp.views.figures import FIGURES, names_of
from nhpocp.views.inline import Figures
from tests.conftest import paper_problem
from tests.views.test_figures import good, hopeless

SMALL = 60_000  # bytes of a picture


@pytest.mark.parametrize("case", [good, hopeless], ids=lambda case: case.__name__)
def test_all_pictures_that_say_something_are_shown(case):
    solution = case()
    figures = solution.plot()
    assert isinstance(figures, Figures)
    assert len(figures) == len(names_of(solution))
    html = figures._repr_html_()
    assert html.count("<img") == len(figures)
    assert len(html) < SMALL * len(figures)


@pytest.mark.parametrize("name", [name for name in FIGURES if name != "failure"])
def test_a_picture_by_name_is_matplotlibs_figure_and_a_small_png(name, tmp_path):
    figure = good().plot(name)
    assert isinstance(figure, Figure)
    assert FIGURES[name](good()).get_size_inches().tolist() == figure.get_size_inches().tolist()
    png, shown = figure._repr_png_()
    assert len(png) < SMALL
    image = Image.open(io.BytesIO(png)).convert("RGB")
    assert image.size[0] == pytest.approx(120 * figure.get_figwidth(), abs=1)
    assert shown["width"] == pytest.approx(96 * figure.get_figwidth(), abs=1)
    assert image.getpixel((0, 0)) == (255, 255, 255)  # reads on dark pages too
    figure.savefig(tmp_path / "picture.pdf")
    assert (tmp_path / "picture.pdf").stat().st_size > 1000


def test_several_names_give_several_figures_and_a_wrong_one_is_answered():
    assert len(good().plot("controls", "robot")) == 2
    with pytest.raises(
        nhpocp.InvalidProblemError, match=r"no picture is called 'control'; did you mean 'controls'\?"
    ):
        good().plot("control")


def test_the_player_is_shown_in_a_frame_that_cannot_reach_the_notebook():
    player = good().animate(samples=21)
    html = player._repr_html_()
    assert re.match(r'<iframe title="[^"]+" sandbox="allow-scripts" ', html)
    assert len(html) < len(player.page) / 2
    assert html == good().animate(samples=21)._repr_html_()  # the same bytes
    assert len(unescape(html)) < 200_000
    for samples in (1, 0.5, "many"):
        with pytest.raises(nhpocp.InvalidProblemError, match=r"animate\.samples"):
            good().animate(samples=samples)
    with pytest.raises(nhpocp.InvalidProblemError, match="no path to show"):
        hopeless().animate()


def test_the_player_plays_in_its_frame(browser):
    page, errors = browser.new_page(viewport={"width": 1000, "height": 800}), []
    page.on("pageerror", lambda error: errors.append(error))
    page.set_content(f"<p>above</p>{good().animate(samples=21, height=600)._repr_html_()}<p>below</p>")
    frame = page.frame_locator("iframe")
    frame.locator("#clock").wait_for()
    before = frame.locator("#clock").inner_text()
    frame.locator("#play").click()
    page.wait_for_timeout(400)
    frame.locator("#play").click()
    assert frame.locator("#clock").inner_text() != before
    assert page.locator("iframe").bounding_box()["height"] == pytest.approx(600, abs=4)
    assert page.inner_text("body").split() == ["above", "below"]
    assert errors == []
    page.close()


def test_a_data_frame_has_the_columns_and_numbers_of_trajectory_csv(tmp_path):
    pandas = pytest.importorskip("pandas", reason="the test extra is not installed")
    frame = good().to_dataframe()
    save_solution(good(), tmp_path / "folder")
    stored = pandas.read_csv(tmp_path / "folder" / "trajectory.csv")
    assert list(frame.columns) == list(stored.columns)
    np.testing.assert_array_equal(frame.to_numpy(), stored.to_numpy())
    np.testing.assert_array_equal(frame["t"], good().trajectory["t"])


def test_without_pandas_a_data_frame_says_what_to_install(monkeypatch):
    own = builtins.__import__

    def without(name, *rest):
        if name == "pandas":
            raise ImportError("No module named 'pandas'")
        return own(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(nhpocp.MissingDependencyError, match=r'pip install "nhpocp\[notebook\]"'):
        good().to_dataframe()


# --- progress -------------------------------------------------------------------------------------------------------


@pytest.fixture
def notebook(monkeypatch):
    """What a notebook is told to display, in order, as (text, new or not)."""
    display = pytest.importorskip("IPython.display", reason="the test extra is not installed")
    heard = []

    class Handle:
        display_id = "here"

    def show(data, **_):
        heard.append((data, True))
        return Handle()

    monkeypatch.setattr(inline_progress, "in_a_notebook", lambda: True)
    monkeypatch.setattr(inline_progress, "PAUSE", 0.0)
    monkeypatch.setattr(inline_progress, "AT_ONCE", 0.0)
    monkeypatch.setattr(display, "display", show)
    monkeypatch.setattr(display, "update_display", lambda data, **_: heard.append((data, False)))
    return heard


def test_a_notebook_shows_how_far_a_solve_is_and_clears_it(notebook):
    nhpocp.solve(
        nhpocp.replace(paper_problem(), name="<b>mine</b>"), nhpocp.Continuation(step_rule=nhpocp.Euler(0.5))
    )
    texts = [data.get("text/plain", "") for data, _ in notebook]
    assert [new for _, new in notebook] == [True] + [False] * (len(notebook) - 1)
    assert "<b>mine</b>" in texts[0]
    assert "&lt;b&gt;mine" in notebook[0][0]["text/html"]
    assert any("update" in text and "E " in text for text in texts)
    assert notebook[-1][0] == inline_progress.NOTHING


def test_it_is_cleared_too_where_the_work_ends_with_an_error(notebook):
    def work():
        with inline_progress.followed(None, "mine") as listener:
            listener({"k": None, "error": None, "stage": "verifying"})
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        work()
    assert [data == inline_progress.NOTHING for data, _ in notebook] == [False, True]


def test_a_listener_of_ones_own_takes_its_place(notebook):
    heard = []
    nhpocp.compare(paper_problem(), "jacobian", heard.append)
    assert heard
    assert notebook == []


def test_outside_of_a_notebook_nothing_listens(monkeypatch):
    monkeypatch.delitem(sys.modules, "IPython", raising=False)
    assert not inline_progress.in_a_notebook()
    with inline_progress.followed(None) as listener:
        assert listener is None


def test_a_terminal_of_ipython_is_no_notebook(monkeypatch):
    class Module:
        get_ipython = staticmethod(lambda: object())

    monkeypatch.setitem(sys.modules, "IPython", Module())
    assert not inline_progress.in_a_notebook()
