"""`nhpocp animate` as a user meets it: where the file goes, what is replaced, what is refused."""

import json
from pathlib import Path

import pytest

from nhpocp.cli.entry import status
from nhpocp.views import film

PROBLEMS = Path(__file__).parents[2] / "problems"


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """A vehicle planned by both methods, as `compare` leaves it."""
    home = tmp_path_factory.mktemp("results")
    file, quiet = str(PROBLEMS / "unicycle.yaml"), ["--set", "output.pictures=false"]
    for solver in ("jacobian", "nlp"):
        folder = str(home / "unicycle" / solver)
        assert status(["solve", file, *quiet, "--solver", solver, "-o", folder]) == 0
    return home / "unicycle"


def test_one_solution_keeps_its_animation_in_its_folder(results, capsys):
    assert status(["animate", str(results / "jacobian")]) == 0
    file = results / "jacobian" / "animation.html"
    assert capsys.readouterr().out == f"{file}\n"
    assert "<title>Motion: unicycle</title>" in file.read_text(encoding="utf-8")
    assert status(["animate", str(results / "jacobian")]) == 0  # ours, so it is replaced
    assert status(["verify", str(results / "jacobian")]) == 0


def test_several_lie_beside_their_folders(results, capsys):
    assert status(["animate", str(results / "jacobian"), str(results / "nlp"), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["file"] == str(results / "animation.html")
    assert [Path(folder).name for folder in said["folders"]] == ["jacobian", "nlp"]
    page = (results / "animation.html").read_text(encoding="utf-8")
    assert ">Jacobian method</h2>" in page
    assert ">NLP</h2>" in page


def test_a_folder_of_solutions_stands_for_them(results, tmp_path):
    assert status(["animate", str(results), "-o", str(tmp_path / "all.html")]) == 0
    assert (tmp_path / "all.html").read_text(encoding="utf-8").count("<canvas") == 2


def test_the_ending_of_the_file_says_the_format(results, tmp_path, monkeypatch):
    monkeypatch.setattr(film, "FRAMES", 2)
    assert status(["animate", str(results / "nlp"), "-o", str(tmp_path / "a.gif")]) == 0
    assert (tmp_path / "a.gif").read_bytes().startswith(b"GIF89a")
    assert status(["animate", str(results / "nlp"), "-o", str(tmp_path / "a.gif")]) == 0


def test_an_mp4_without_ffmpeg_is_an_optional_part(results, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("PATH", str(tmp_path))
    assert status(["animate", str(results / "nlp"), "--format", "mp4", "--json"]) == 3
    assert "ffmpeg" in json.loads(capsys.readouterr().out)["error"]["message"]
    assert not (results / "nlp" / "animation.mp4").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["{tmp}/nothing"], "nothing: no solution folder"),
        (["{ours}", "-o", "{tmp}/mine.html"], "mine.html: this file was not written by nhpocp animate"),
        (["{ours}", "-o", "{tmp}"], "this is a folder; expected a file's name"),
        (["{ours}", "-o", "{tmp}/a.pdf"], "a file that ends in .pdf; expected .html, .gif, .mp4"),
        (
            ["{ours}", "-o", "{tmp}/a.gif", "--format", "html"],
            "--format html, but the file's name ends in .gif",
        ),
        (["{ours}", "-o", "{tmp}/mine.html/a.html"], "cannot write here"),
        (["{ours}", "--format", "avi"], "'avi' is not one of 'html', 'gif', 'mp4'"),
        ([], "Missing argument 'DIR...'"),
    ],
)
def test_bad_input_is_said_in_a_line(results, tmp_path, capsys, arguments, words):
    (tmp_path / "mine.html").write_text("my own page")
    known = {"tmp": tmp_path, "ours": results / "jacobian"}
    assert status(["animate", *(argument.format(**known) for argument in arguments)]) == 2
    assert words in capsys.readouterr().err
    assert (tmp_path / "mine.html").read_text() == "my own page"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mine.html"]


def test_compare_writes_one_for_each_problem_and_links_it(results, tmp_path, capsys):
    for folder in ("jacobian", "nlp"):
        problem = results / folder / "problem.yaml"
        text = problem.read_text(encoding="utf-8")
        assert "pictures: false" in text
        problem.write_text(text.replace("pictures: false", "pictures: true"), encoding="utf-8")
    capsys.readouterr()
    assert status(["compare", "--from", str(results), "-o", str(tmp_path)]) == 0
    assert f"animation: {tmp_path}/unicycle/animation.html" in capsys.readouterr().out
    assert (tmp_path / "unicycle" / "animation.html").read_text(encoding="utf-8").count("<canvas") == 2
    assert 'href="unicycle/animation.html"' in (tmp_path / "report.html").read_text(encoding="utf-8")
