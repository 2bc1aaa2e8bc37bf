"""The example notebook: run as it stands, it gives what is stored in it."""

import re
import shutil
from itertools import count
from pathlib import Path

import pytest

nbformat = pytest.importorskip("nbformat", reason="the test extra is not installed")
nbconvert = pytest.importorskip("nbconvert", reason="the test extra is not installed")
from nbconvert.preprocessors import ExecutePreprocessor  # noqa: E402

ROOT = Path(__file__).parents[2]
FILE = ROOT / "problems" / "first_steps.ipynb"
LARGEST = 300_000  # bytes
AGAIN = (
    "jupyter nbconvert --to notebook --execute --inplace --ExecutePreprocessor.record_timing=False "
    "problems/first_steps.ipynb"
)
NUMBER = re.compile(r"(-?\d+(?:\.\d+)?(?:e[-+]?\d+)?)")


def read(file):
    return nbformat.read(file, as_version=4)


@pytest.fixture(scope="module")
def executed(tmp_path_factory):
    """The notebook after a run in a folder of its own, nothing of which is the user's."""
    folder = tmp_path_factory.mktemp("notebook")
    for file in (FILE, FILE.with_name("paper.yaml")):
        shutil.copy(file, folder)
    notebook = read(folder / FILE.name)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(ROOT))
        for name in ("JUPYTER_RUNTIME_DIR", "JUPYTER_DATA_DIR", "JUPYTER_CONFIG_DIR", "IPYTHONDIR"):
            patch.setenv(name, str(folder / name.lower()))
        runner = ExecutePreprocessor(timeout=300, kernel_name="python3", record_timing=False)
        runner.preprocess(notebook, {"metadata": {"path": str(folder)}})
    return notebook


def code(notebook):
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def said_by(output):
    """What is printed, or a result as text; times are not among them. Nothing where progress was shown."""
    return output.text if output.output_type == "stream" else output.get("data", {}).get("text/plain", "")


def said(cell):
    return " ".join("\n".join(map(said_by, cell.outputs)).split())


def test_what_is_stored_is_what_a_run_gives(executed):
    for stored, run in zip(code(read(FILE)), code(executed), strict=True):
        assert stored.source == run.source
        old, new = NUMBER.split(said(stored)), NUMBER.split(said(run))
        assert old[::2] == new[::2], f"run it again: {AGAIN}"
        assert [float(number) for number in new[1::2]] == pytest.approx(
            [float(number) for number in old[1::2]], rel=2e-3, abs=1e-6
        ), f"run it again: {AGAIN}"


def test_every_cell_shows_the_kind_of_output_that_is_stored(executed):
    def kinds(cell):
        return [sorted(output.get("data", ())) for output in cell.outputs if said_by(output)]

    for stored, run in zip(code(read(FILE)), code(executed), strict=True):
        assert kinds(stored) == kinds(run)


@pytest.mark.parametrize("which", ["stored", "run"])
def test_it_is_small_whole_and_sound(which, executed):
    notebook = read(FILE) if which == "stored" else executed
    nbformat.validate(notebook)
    assert len(nbformat.writes(notebook)) < LARGEST
    cells = code(notebook)
    assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1))
    assert not [output for cell in cells for output in cell.outputs if output.output_type == "error"]
    assert not [output for cell in cells for output in cell.outputs if output.get("name") == "stderr"]
    assert "/" + "home/" not in nbformat.writes(notebook)


def test_it_shows_all_that_a_notebook_can(executed):
    html = [
        output.data["text/html"]
        for cell in code(executed)
        for output in cell.outputs
        if "text/html" in output.get("data", {})
    ]
    for piece in (
        "2 of 2 verified",
        "converged</span>",
        "iteration limit</span>",
        "<iframe ",
        "<table border",
    ):
        assert any(piece in each for each in html), piece
    assert any("image/png" in output.get("data", {}) for cell in code(executed) for output in cell.outputs)


def test_its_links_lead_somewhere():
    text = "\n".join(cell.source for cell in read(FILE).cells if cell.cell_type == "markdown")
    links = re.findall(r"\]\(([^)#]+)(?:#([^)]+))?\)", text)
    assert links
    for file, place in links:
        page = (FILE.parent / file).read_text(encoding="utf-8")
        heads = [head.lower().replace(" ", "-") for head in re.findall(r"^#+ (.*)", page, re.MULTILINE)]
        assert not place or place in heads


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_a_page_of_it_shows_pictures_and_plays(theme, executed, browser, tmp_path):
    text, _ = nbconvert.HTMLExporter(theme=theme).from_notebook_node(executed)
    (tmp_path / "page.html").write_text(text, encoding="utf-8")
    context = browser.new_context(viewport={"width": 1000, "height": 800}, offline=True)
    page = context.new_page()
    page.goto((tmp_path / "page.html").as_uri(), wait_until="domcontentloaded")
    assert page.evaluate("[...document.images].every((image) => image.naturalWidth > 100)")
    assert page.locator(".nhpocp-card").count() == 5
    page.locator("iframe").scroll_into_view_if_needed()
    clock = page.frame_locator("iframe").locator("#clock")
    clock.wait_for()
    page.frame_locator("iframe").locator("#play").click()
    assert any(
        page.wait_for_timeout(50) or clock.inner_text() != "t = 0.000" for _ in zip(range(100), count())
    )
    cell = page.locator(".nhpocp-card td").first
    dark = page.evaluate("(cell) => getComputedStyle(cell).color", cell.element_handle())
    assert (sum(map(int, re.findall(r"\d+", dark)[:3])) > 384) == (theme == "dark")
    context.close()
