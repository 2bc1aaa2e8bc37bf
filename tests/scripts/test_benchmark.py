"""The benchmark runs, its peers solve the task that they are said to solve, and its lines can fail; no timing."""

import json
import sys
from pathlib import Path

import benchmark
import numpy as np
import pytest
from contestants import contestants
from measuring import cold
from replaying import replay
from scaling import grow
from wanted import Line

from nhpocp.flow.compiled import kernel_build
from tests.conftest import PAPER_START
from tests.flow.compiled.test_kernels import QUICKLY

SCRIPTS = Path(benchmark.__file__).parent
INTERVALS = 10
PEERS = {one.name: one for one in contestants(INTERVALS, 20) if "interpreted" not in one.name}


@pytest.fixture(autouse=True)
def quick_to_compile(monkeypatch):
    monkeypatch.setattr(kernel_build, "FLAGS", QUICKLY)


def test_the_quick_form_writes_tables_and_picture(tmp_path, capsys):
    words = ["--quick", "--names", "plain", "γ = 1, interpreted", "-o", str(tmp_path)]
    assert benchmark.main(benchmark.read(words)) == 0
    said = capsys.readouterr().out
    assert said == (tmp_path / "table.md").read_text(encoding="utf-8")
    assert "| continuation, γ = 1, interpreted |" in said
    stored = json.loads((tmp_path / "benchmark.json").read_text(encoding="utf-8"))
    assert {row["name"] for row in stored["rows"]} == {
        "continuation, γ = 1, interpreted",
        "plain (17), γ = 1",
    }
    assert all(row["error"] < 1e-3 and row["megabytes"] > 10 for row in stored["rows"])
    assert stored["goals"]["verified"] == stored["goals"]["tried"] == 2
    assert len(stored["wanted"]) > 10
    assert (tmp_path / "table.csv").read_text(encoding="utf-8").count("\n") == 3
    assert (tmp_path / "scaling.png").read_bytes().startswith(b"\x89PNG")


def test_a_replay_of_the_papers_start_ends_where_it_should():
    found = replay(PAPER_START, harmonic=True)
    assert found.position == pytest.approx([0.712869, 0.535277, 34.976485], abs=1e-6)
    assert found.error == pytest.approx(1.3376783, abs=1e-7)
    assert found.effort == pytest.approx(1.375)


@pytest.mark.parametrize("name", PEERS)
def test_everybody_reaches_the_goal_and_says_what_it_costs(name):
    one = PEERS[name]
    objective, control = one.build()()
    found = replay(control, one.harmonic)
    assert found.error < 2e-3
    assert found.effort == pytest.approx(objective, rel=1e-6)
    if one.least:
        assert objective == pytest.approx(2.11666 if one.harmonic else 2.1252, abs=1e-3)


@pytest.mark.parametrize("module", sorted(SCRIPTS.glob("rival_*.py")), ids=lambda path: path.stem)
def test_rivals_import_nothing_of_ours(module):
    text = module.read_text(encoding="utf-8")
    own = [file.stem for file in SCRIPTS.glob("*.py") if not file.stem.startswith("rival_")]
    imported = [line.split()[1] for line in text.splitlines() if line.startswith(("import ", "from "))]
    assert not [name for name in imported if name.split(".")[0] in ["nhpocp", *own]]


def test_lines_hold_fail_or_were_not_measured():
    assert Line("", 0.003, most=1 / 300).holds
    assert Line("", 0.004, most=1 / 300).holds is False
    assert Line("", 0.85, most=1.1, least=0.9).holds is False
    assert Line("", 500.0, least=400.0).holds
    assert Line("", None, most=1.0).holds is None
    assert str(Line("of that: this", 0.004, most=1 / 300)).split() == [
        "NO",
        "wanted",
        "≤",
        "1/300",
        "seen",
        "1/250",
        "of",
        "that:",
        "this",
    ]


def test_a_slow_way_is_not_asked_for_more(monkeypatch):
    monkeypatch.setattr("scaling.PATIENCE", 0.0)
    curves = grow({"one": lambda size: lambda: None}, (1, 2, 3), rounds=1)
    assert list(curves["one"]) == [1]


def test_a_fresh_process_is_measured_by_itself():

    ballast = np.ones(40_000_000)  # 320 MB that the child does not have
    slim = cold([sys.executable, "-c", "pass"])
    assert ballast.nbytes > 2**20 * slim.megabytes > 0
    with pytest.raises(RuntimeError, match="status 3"):
        cold([sys.executable, "-c", "raise SystemExit(3)"])


def test_a_name_that_nobody_has(tmp_path):
    with pytest.raises(SystemExit, match="nobody has fmincon in the name"):
        benchmark.main(benchmark.read(["--only", "solvers", "--names", "fmincon", "-o", str(tmp_path)]))
