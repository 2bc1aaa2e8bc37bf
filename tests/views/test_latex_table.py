"""comparison.tex: a table that LaTeX takes, whatever the names are."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from nhpocp.comparison import Comparison
from nhpocp.objectives.registry import OBJECTIVES
from nhpocp.outcome import Outcome
from nhpocp.views.latex_table import escaped, latex_table, number
from tests.test_comparison import line, made

ENGINE = shutil.which("pdflatex") or shutil.which("tectonic")
PAPER = r"\documentclass{article}\usepackage{booktabs}\begin{document}\input{comparison}\end{document}"
# what is left of a text once the commands that `escaped` writes are taken out
COMMAND = re.compile(
    r"\\[&%#_{}]|\\textbackslash\{\}|\\textascii(tilde|circum)\{\}|\\ensuremath\{[<>|]\}|\{\\char\d+\}|\{[\[*-]\}"
    r"|\\[`'^~\"=.uvc]\{\w\}"
)


def evil() -> Comparison:
    """Runs and problems whose names are all that LaTeX reads otherwise."""
    names = [r"50% & $x_1^2$ \input{~/secret} #1 {", "ü µ 机 --[*]"]
    runs = [made(problem=line(name=names[0])), made(2.0, problem=line(goal=2.0, name=names[1]))]
    failed = made(solver="nlp", outcome=Outcome.ITERATION_LIMIT, message="not yet.")
    comparison = Comparison.of([*runs, replace(failed, problem=line(name=names[0]))])
    odd = replace(comparison.entries[0], variant=r"jacobian:note=a_b\c%")
    return Comparison([odd, *comparison.entries[1:]])


@given(st.text(max_size=40))
def test_any_text_is_printed_and_commands_nothing(text: str) -> None:
    assert escaped(text).isascii()
    assert not re.search(r"[\\&%$#_{}~^<>|\"`\[*-]", COMMAND.sub("", escaped(text)))


def test_every_row_has_a_cell_a_column() -> None:
    table = latex_table(evil())
    assert table.isascii()
    columns = re.search(r"\\begin\{tabular\}\{@\{\}([lr]+)@\{\}\}", table)
    assert columns is not None
    rows = [text for text in table.splitlines() if text.endswith(r"\\") and "multicolumn" not in text]
    assert len(rows) == 4
    for row in rows:
        assert len(re.findall(r"(?<!\\)&", row)) + 1 == len(columns[1])
    assert [table.count(rule) for rule in (r"\toprule", r"\midrule", r"\bottomrule")] == [1, 2, 1]
    plain = re.sub(r"\\[{}]", "", table)
    assert plain.count("{") == plain.count("}")
    assert "iteration limit" in table
    assert r"$\int |\mathrm{control}|^2\,\mathrm{d}t$" in table


def test_numbers_are_those_of_the_rows() -> None:
    comparison = Comparison.of([made(), made(2.0, settings={"gamma": 0.5})])
    rows = [text.split(" & ") for text in latex_table(comparison).splitlines() if text.startswith("gamma")]
    assert [row[3] for row in rows] == ["1.5", "6"]
    assert [row[4] for row in rows] == ["0.00", "300.00"]
    assert [row[0] for row in rows] == ["gamma = 0.1", "gamma = 0.5"]
    assert [number(value) for value in (None, 1e-9, -2.5, 123456.0)] == [
        *("--", r"$1\times10^{-9}$", "$-2.5$", r"$1.235\times10^{5}$")
    ]


def test_problems_with_a_run_each_are_rows() -> None:
    runs = [made(problem=line(goal=goal, name=f"goal_{goal:g}")) for goal in (1.0, 2.0, 3.0)]
    lines = latex_table(Comparison.of(runs)).splitlines()
    assert [text.split(" & ")[0] for text in lines[5:8]] == [rf"goal\_{i}" for i in (1, 2, 3)]
    assert lines.count(r"\midrule") == 1


def test_the_symbol_of_any_objective_is_mathematics(monkeypatch: pytest.MonkeyPatch) -> None:
    """A plugin's too, and inputs of any name."""
    for symbol, tex in (
        ("∫|{control}|² dt", r"\int |\mathrm{control}|^2\,\mathrm{d}t"),
        ("∫|ẋ|² dt", r"\int |\dot{x}|^2\,\mathrm{d}t"),
        ("∫m_of_θ · 5% dt", r"\int \mathrm{m\_of\_}\mbox{U+03B8} \mbox{U+00B7} 5\mbox{\%}\,\mathrm{d}t"),
    ):
        monkeypatch.setattr(type(OBJECTIVES["effort"]), "symbol", symbol)
        table = latex_table(evil())
        assert table.isascii()
        assert f" & ${tex}$ & " in table


@pytest.mark.skipif(ENGINE is None, reason="no LaTeX here")
def test_latex_sets_it(tmp_path: Path) -> None:
    (tmp_path / "comparison.tex").write_text(latex_table(evil()), encoding="ascii")
    (tmp_path / "paper.tex").write_text(PAPER, encoding="ascii")
    options = ["-halt-on-error", "-interaction=nonstopmode"] if "pdflatex" in str(ENGINE) else []
    done = subprocess.run(
        [str(ENGINE), *options, "paper.tex"], cwd=tmp_path, capture_output=True, check=False, timeout=120
    )
    assert done.returncode == 0, done.stdout[-2000:]
    assert (tmp_path / "paper.pdf").stat().st_size > 1000
