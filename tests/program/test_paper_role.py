"""A student's task: section 4 of the paper with h = 1, 2, 3, 5 and ten goals, its figures and tables in a paper."""

from __future__ import annotations

import csv
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import nhpocp
from nhpocp.cli.entry import status
from nhpocp.views.latex_table import latex_table
from tests.conftest import draw_nothing

PAPER_FILE = Path(__file__).parents[2] / "problems" / "paper.yaml"
HARMONICS = (1, 2, 3, 5)
FIGURES = ("controls", "relative_pose")
ENGINE = shutil.which("pdflatex") or shutil.which("tectonic")
PAPER = r"""\documentclass{article}
\usepackage{booktabs,graphicx}
\begin{document}
\begin{figure}\includegraphics{h2/controls}\caption{Controls and leg lengths.}\end{figure}
\begin{figure}\includegraphics{h2/relative_pose}\caption{Position and rotation relative to the goal.}\end{figure}
\begin{table}\input{harmonics/comparison}\caption{One method over four bases.}\end{table}
\begin{table}\input{goals}\caption{Ten goals.}\end{table}
\end{document}
"""


def first_control(harmonics: int) -> list[list[float]]:
    """Λ₀ of [Paper] section 4 over any number of harmonics: λ11 = λ21 = λ32 = .5, λ30 = 1."""
    rows = np.zeros((3, 1 + 2 * harmonics))
    rows[0, 1] = rows[1, 1] = rows[2, 2] = 0.5
    rows[2, 0] = 1
    return rows.tolist()


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the commands of the recipe leave behind."""
    home = tmp_path_factory.mktemp("paper")
    for h in HARMONICS:
        changes = [f"control.harmonics={h}", f"control.initial={first_control(h)}", "output.pictures=false"]
        asked = [word for change in changes for word in ("--set", change)]
        assert status(["solve", str(PAPER_FILE), *asked, "-o", str(home / f"h{h}")]) == 0
    drawn = ["--format", "pdf,svg", "--only", ",".join(FIGURES), "--size", "84mm"]
    assert status(["plot", str(home / "h2"), *drawn]) == 0
    folders = [str(home / f"h{h}") for h in HARMONICS]
    with pytest.MonkeyPatch.context() as patch:
        draw_nothing(patch)  # nobody looks at the report's curves
        assert status(["compare", "--from", *folders, "-o", str(home / "harmonics")]) == 0
    problem = nhpocp.load_problem(PAPER_FILE).with_(pictures=False, samples=21)
    goals = [{**problem.goal, "position": [x, -0.2, z]} for z in (33, 35) for x in (-0.8, -0.4, 0, 0.4, 0.8)]
    tasks = [problem.with_(name=f"goal_{i}", goal=goal) for i, goal in enumerate(goals, 1)]
    method = nhpocp.Continuation(step_rule=nhpocp.Euler(gamma=0.5))
    comparison = nhpocp.compare([nhpocp.Run(task, method, "jacobian") for task in tasks])
    assert comparison.all_converged
    (home / "goals.tex").write_text(latex_table(comparison), encoding="ascii")
    (home / "paper.tex").write_text(PAPER, encoding="ascii")
    return home


def test_the_bases_stand_side_by_side_under_what_differs(home: Path) -> None:
    with (home / "harmonics" / "comparison.csv").open(newline="", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["variant"] for row in rows] == [f"jacobian:control.harmonics={h}" for h in HARMONICS]
    assert [row["basis"] for row in rows] == [f"fourier harmonics={h}" for h in HARMONICS]
    assert all(row["claim_right"] == "true" for row in rows)
    reference = nhpocp.load_problem(PAPER_FILE).reference["jacobian"]
    assert float(rows[1]["effort"]) == pytest.approx(reference["effort"], rel=1e-4)
    report = (home / "harmonics" / "report.html").read_text(encoding="utf-8")
    assert len(re.findall(r'<section[^>]*id="problem-|id="problem-\d+"', report)) == 1


def test_the_figures_of_the_paper_follow_from_the_table(home: Path) -> None:
    with (home / "h2" / "trajectory.csv").open(newline="", encoding="utf-8") as stream:
        header, *rows = csv.reader(stream)
    columns = dict(zip(header, np.array(rows, dtype=float).T, strict=True))
    for i in (1, 2, 3):
        assert abs(columns[f"v_{i}"]).max() > 0.1
        assert abs(columns[f"e_p_{i}"][-1]) < 1e-3
        assert abs(columns[f"r_{i}"][-1]) < 1e-3
    assert columns["e_p_3"][0] == -10
    assert columns["r_3"][0] == pytest.approx(np.pi / 3)


def test_the_figures_have_the_fonts_that_journals_take(home: Path) -> None:
    for name in FIGURES:
        content = (home / "h2" / f"{name}.pdf").read_bytes()
        assert b"/FontFile2" in content
        assert not re.search(rb"/Subtype\s*/Type3", content)
        width = re.search(rb"/MediaBox\s*\[\s*0\s+0\s+([\d.]+)", content)
        assert width is not None
        assert float(width[1]) == pytest.approx(84 / 25.4 * 72, abs=0.01)


def test_the_paper_can_be_set(home: Path) -> None:
    """By LaTeX where it is there; what it reads is there and in order anywhere."""
    for place in re.findall(r"\\includegraphics\{(.*?)\}", PAPER):
        assert (home / f"{place}.pdf").stat().st_size > 5000
    for place, name, runs in (
        ("harmonics/comparison", "harmonics = ", len(HARMONICS)),
        ("goals", r"goal\_", 10),
    ):
        table = (home / f"{place}.tex").read_text(encoding="ascii")
        assert table.count(f"\n{name}") == runs
        assert table.count(r"\begin{tabular}") == table.count(r"\end{tabular}") == 1
    if ENGINE is None:
        return
    options = ["-halt-on-error", "-interaction=nonstopmode"] if "pdflatex" in ENGINE else []
    done = subprocess.run(
        [ENGINE, *options, "paper.tex"], cwd=home, capture_output=True, check=False, timeout=300
    )
    assert done.returncode == 0, done.stdout[-2000:]
    assert (home / "paper.pdf").stat().st_size > 20000
