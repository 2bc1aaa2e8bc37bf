"""The package of problems/recipes.md, built by pip, installed into a folder of its own, and used as its page says.

What a file may say is fixed once `nhpocp.problem_file` is imported, so all of this runs in processes of its own.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from itertools import groupby
from pathlib import Path

import pytest

from tests.program.test_markdown import ROOT, Block, blocks

PARTS = [block for block in blocks("problems/recipes.md") if block.info.endswith("plugin")]
PROGRAMS = {
    "pip": "-m pip --disable-pip-version-check",
    "pytest": "-m pytest -q -p no:cacheprovider",
}
ONE_AFTER_ANOTHER = """
import sys
from nhpocp.cli.entry import status
for line in sys.argv[1:]:
    assert status(line.split()[1:]) == 0, line
"""


def run(folder: Path, *arguments: str, path: tuple[Path, ...] = (), status: int = 0) -> str:
    """What a Python with these folders on its path says, at home in a folder."""
    places = os.pathsep.join(map(str, [*path, ROOT]))
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": places, "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
    )
    said = done.stdout + done.stderr
    assert done.returncode == status, said
    assert "Traceback" not in said, said
    return said


@pytest.fixture(scope="module")
def package(tmp_path_factory) -> Path:
    """The files of the package."""
    folder = tmp_path_factory.mktemp("package")
    for block in PARTS:
        name = block.info.removesuffix("plugin").strip()
        if name:
            (folder / name).write_text(block.text, encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def said(package, tmp_path_factory) -> tuple[Path, str]:
    """Where the package was installed, and what the commands of the page said there, one after another."""
    place, told = tmp_path_factory.mktemp("installed"), ""
    (commands,) = [block.text for block in PARTS if block.language == "sh"]
    for program, lines in groupby(commands.splitlines(), lambda line: line.split()[0]):
        if program == "nhpocp":  # one process, which the others' imports are spared
            told += run(package, "-c", ONE_AFTER_ANOTHER, *lines, path=(place,))
            continue
        (line,) = lines
        words = line.split()[1:]
        if program == "pip":
            assert words == ["install", "."]
            words = [
                "install",
                "-q",
                "--no-deps",
                "--no-build-isolation",
                "--no-index",
                "--target",
                str(place),
                ".",
            ]
        told += run(package, *PROGRAMS[program].split(), *words, path=(place,))
    return place, told


def test_the_package_is_installed_checked_solved_verified_and_compared_as_its_page_says(said):
    (shown,) = [block.text for block in PARTS if block.language == "text"]
    for line in shown.splitlines():
        pattern = ".*".join(re.escape(part.strip()) for part in line.split("…"))
        assert re.search(pattern, said[1]), f"the page shows {line!r}; what came was\n{said[1]}"


def test_its_solutions_are_read_back_in_python_and_named_where_it_is_not_installed(said, package):
    place, _ = said
    code = """
import json, nhpocp
plan = nhpocp.load_solution("results/both/disc/nlp")
again = nhpocp.solve(plan.problem, "nlp")
nhpocp.save_solution(again, "results/again")
read = nhpocp.load_solution("results/again")
print(json.dumps({
    "system": plan.problem.system.parameters(), "basis": repr(plan.control.basis), "costs": dict(read.costs),
    "energy": again.costs["energy"], "bounds": [b.label for b in read.problem.bounds], "ok": nhpocp.verify(read).ok,
}))
"""
    told = json.loads(run(package, "-W", "error::UserWarning", "-c", code, path=(place,)).splitlines()[-1])
    assert told["system"] == {"radius": 0.5}
    assert told["basis"] == "Bernstein(degree=5)"
    assert told["costs"]["energy"] == told["energy"] > 0
    assert told["bounds"] == ["arena"]
    assert told["ok"]
    refused = run(package, "-m", "nhpocp", "verify", "results/disc", status=2)
    assert "unknown model 'disc'" in refused
    assert "entry point of the group nhpocp.systems" in refused


def test_the_schema_the_starter_and_the_settings_know_its_parts(said, package):
    place, _ = said
    schema = json.loads(run(package, "-m", "nhpocp", "schema", path=(place,)))
    text = json.dumps(schema)
    assert "system_disc" in schema["definitions"]
    assert "BernsteinControl" in text
    assert "arena" in schema["definitions"]["Constraints"]["properties"]
    assert "energy" in schema["properties"]["objective"]["enum"]
    run(package, "-m", "nhpocp", "init", "starter.yaml", "--system", "disc", path=(place,))
    starter = (package / "starter.yaml").read_text(encoding="utf-8")
    for words in ("# or basis bernstein with degree: 4", "# arena: 5", "energy ∫|ẋ|²"):
        assert words in starter
    run(package, "-m", "nhpocp", "check", "starter.yaml", path=(place,))


METHODS = '''
from dataclasses import dataclass, replace
from typing import ClassVar

import nhpocp
from nhpocp import declared


@dataclass(frozen=True)
class Halving(nhpocp.StepRule):
    """γ = 1, halved until the error falls."""

    kind: ClassVar = "halving"

    def updates(self, here, evaluate):
        gamma = 1.0
        while gamma > 1e-3:
            trial = evaluate(here.coefficients + gamma * nhpocp.full_step(here), gamma)
            if trial.failure or trial.crossing or trial.merit >= here.merit:
                gamma /= 2
                continue
            here, gamma = trial, 1.0
            yield here

    def settings(self):
        return {}


@dataclass(frozen=True)
class Brisk(nhpocp.SolverSettings):
    """The continuation in few updates."""

    tolerance: float = declared.positive(1e-4, "the error E at which to stop")
    meaning: ClassVar = "the continuation in few updates"

    def solver(self, kernels, others):
        return BriskSolver(self)


@dataclass(frozen=True)
class BriskSolver:
    given: Brisk
    name: ClassVar = "brisk"

    @property
    def tolerance(self):
        return self.given.tolerance

    def settings(self):
        return {"tolerance": self.tolerance}

    def solve(self, problem, progress=None):
        own = nhpocp.Continuation(step_rule=Halving(), tolerance=self.tolerance).solve(problem, progress)
        return replace(own, solver=self.name, settings=self.settings())
'''
POINTS = {"nhpocp.step_rules": "halving = {}:Halving", "nhpocp.solvers": "brisk = {}:Brisk"}


def installed(place: Path, module: str, text: str, points: dict[str, str]) -> Path:
    """A folder with a distribution of one module and its entry points."""
    info = place / f"{module}-0.3.dist-info"
    info.mkdir(parents=True)
    (place / f"{module}.py").write_text(text, encoding="utf-8")
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {module}\nVersion: 0.3\n", encoding="utf-8")
    lines = "".join(f"[{group}]\n{line.format(module)}\n" for group, line in points.items())
    (info / "entry_points.txt").write_text(lines, encoding="utf-8")
    return place


def test_a_plugins_step_rule_and_solver_are_set_in_a_file_stored_and_verified(tmp_path):
    place = installed(tmp_path / "site", "methods", METHODS, POINTS)
    (tmp_path / "turn.yaml").write_text(
        "nhpocp: 1\nsystem: {model: unicycle}\nstart: {x: 0, y: 0, theta: 0}\ngoal: {y: 1}\n"
        "solvers: {jacobian: {step_rule: halving}, brisk: {tolerance: 1e-5}}\noutput: {pictures: false}\n"
    )
    code = """
from nhpocp.cli.entry import status
from nhpocp.testing import check_solver, check_step_rule
import methods, nhpocp
assert status(["solve", "turn.yaml", "-o", "own"]) == 0
assert status(["solve", "turn.yaml", "--solver", "brisk", "-o", "brisk"]) == 0
assert status(["verify", "own"]) == 0 and status(["verify", "brisk"]) == 0
assert status(["compare", "turn.yaml", "--variant", "brisk:tolerance=1e-7", "-o", "both"]) == 0
assert nhpocp.load_solution("own").settings["step_rule"] == "halving"
assert nhpocp.load_solution("brisk").tolerance == 1e-5
assert nhpocp.load_solution("both/turn/brisk-tolerance-1e-7").tolerance == 1e-7
check_step_rule(methods.Halving())
check_solver(nhpocp.load_problem("turn.yaml").solvers["brisk"])
"""
    told = run(tmp_path, "-c", code, path=(place,))
    assert "differs" not in told
    assert "nothing that a problem file has a word for" not in told


GROUPS = {
    "nhpocp.bases": "haar = {}:Haar",
    "nhpocp.objectives": "ride = {}:Ride",
    "nhpocp.constraints": "fence = {}:Fence",
    "nhpocp.step_rules": "half = {}:Half",
    "nhpocp.solvers": "mine = {}:Mine",
    "nhpocp.systems": "raft = {}:Raft",
}


def test_a_broken_distribution_costs_one_sentence_and_harms_nothing(tmp_path):
    place = installed(tmp_path / "site", "shaky", "1 / 0\n", GROUPS)
    paper = str(ROOT / "problems" / "paper.yaml")
    told = run(tmp_path, "-m", "nhpocp", "check", paper, path=(place,)).splitlines()
    assert sorted(told) == sorted(
        [
            f"{paper}: ok",
            "warning: the plugin shaky:Fence of shaky 0.3 cannot be loaded: ZeroDivisionError: division by zero",
        ]
    )
    doctor = run(tmp_path, "-m", "nhpocp", "doctor", path=(place,))
    for name in ("Haar", "Ride", "Fence", "Half", "Mine", "Raft"):
        assert f"shaky:{name} of shaky 0.3 cannot be loaded" in doctor


FAILING = {
    "the settings": (
        "return BriskSolver(self)",
        "return kernels.warp()",
        "of methods 0.3 fails: AttributeError",
    ),
    "the name": (
        'name: ClassVar = "brisk"',
        'name: ClassVar = "slow"',
        "calls itself 'slow'; expected 'brisk'",
    ),
    "the solve": ("own = nhpocp", "own = problem.task", "of methods 0.3 fails: AttributeError"),
}


@pytest.mark.parametrize("name", FAILING)
def test_a_solver_that_fails_is_named_without_a_traceback_and_harms_no_other(name, tmp_path):
    before, after, words = FAILING[name]
    place = installed(tmp_path / "site", "methods", METHODS.replace(before, after), POINTS)
    (tmp_path / "turn.yaml").write_text(
        "nhpocp: 1\nsystem: {model: unicycle}\nstart: {x: 0, y: 0, theta: 0}\ngoal: {y: 1}\noutput: {pictures: false}\n"
    )
    code = """
from nhpocp.cli.entry import status
assert status(["solve", "turn.yaml", "-o", "own"]) == 0
assert status(["solve", "turn.yaml", "--solver", "brisk"]) == 2
"""
    told = run(tmp_path, "-c", code, path=(place,))
    assert words in told
    assert ("warning: the plugin methods:Brisk of methods 0.3 fails: " in told) is (name != "the solve")


def test_the_parts_of_the_page_are_the_files_of_a_package():
    assert {block.language for block in PARTS} == {"toml", "python", "yaml", "sh", "text"}
    assert all(isinstance(block, Block) for block in PARTS)
