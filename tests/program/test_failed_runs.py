"""Runs that fail as people's do: what each says names a cure, and the cure works when it is followed to the letter."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from nhpocp.cli.entry import status
from nhpocp.cli.summary import next_commands, task
from nhpocp.solution_folder import load_solution

PROBLEMS = Path(__file__).parents[2] / "problems"
PAPER, HEISENBERG = PROBLEMS / "paper.yaml", PROBLEMS / "heisenberg.yaml"
PLAIN = ["output.pictures=false", "solvers.jacobian.gamma=1"]
AUTO = "solvers.jacobian.step_rule=auto"
PLACE = "goal.position=[0.3, 0.2, "
STROKE = "constraints.leg_length=[20, 50]"


def run(verb, file, overrides, solver="jacobian"):
    """The exit status; results go to ``out``."""
    words = [verb, str(file), *(word for override in overrides for word in ("--set", override))]
    return status(words if verb == "check" else [*words, "--solver", solver, "-o", "out"])


def named(pattern):
    """A cure that the words name: what a pattern finds becomes an override."""

    def cure(said, overrides):
        match = re.search(pattern, said)
        assert match, said
        return match

    return cure


def following(pattern, made):
    """Overrides with what the words name in them."""
    return lambda said, overrides: [*overrides, made(named(pattern)(said, overrides))]


def replaced(pattern, made):
    """The same in place of the last override."""
    return lambda said, overrides: [*overrides[:-1], made(named(pattern)(said, overrides))]


# how a run fails: verb, file, solver, overrides, exit status, and the overrides that its words lead to
FAILED = {
    "a key without its block": (
        *("check", PAPER, "jacobian", ["gamma=0.5"], 2),
        replaced(r"did you mean '([\w.]+)'\?", lambda m: f"{m[1]}=0.5"),
    ),
    "an open side written as infinity": (
        *("check", PAPER, "jacobian", ["constraints.joint_angle={theta3: [-inf, 150 deg]}"], 2),
        replaced(r"or (\{max: )…\}", lambda m: f"constraints.joint_angle={{theta3: {m[1]}150 deg}}}}"),
    ),
    "a free horizon": (
        *("solve", PAPER, "jacobian", [*PLAIN, "horizon={min: 0.5, max: 3}"], 2),
        following(r"add `(initial): (\d+)`", lambda m: f"horizon.{m[1]}={m[2]}"),
    ),
    "a control that cannot begin": (
        *(
            "solve",
            PAPER,
            "jacobian",
            [*PLAIN, "control.initial=[[0, 0, 0, 0, 0], [0, 0, 0, 0, 0], [0, 0, 0, 0, 0]]"],
        ),
        1,
        replaced(r"`initial: (auto)`", lambda m: f"control.initial={m[1]}"),
    ),
    "too few iterations": (
        *(
            "solve",
            PAPER,
            "jacobian",
            [*PLAIN, "solvers.jacobian.gamma=0.1", "solvers.jacobian.max_iterations=9"],
            1,
        ),
        following(r"also gamma, up to (\d+)", lambda m: f"solvers.jacobian.gamma={m[1]}"),
    ),
    "a goal outside of a bound": (
        *("solve", PAPER, "jacobian", [*PLAIN, AUTO, "constraints.leg_length=[20, 40]"], 1),
        replaced(
            r"the goal itself breaks leg_length\[\d\], which is ([\d.]+), outside",
            lambda m: f"constraints.leg_length=[20, {float(m[1]) + 1}]",
        ),
    ),
    "a goal on the other side": (
        *(
            "solve",
            PAPER,
            "jacobian",
            [*PLAIN, AUTO, "goal.orientation.rpy=[0, 0, -pi/6]", f"{PLACE}-35]"],
            1,
        ),
        replaced(r"choose a goal on the start's side", lambda _: f"{PLACE}35]"),
    ),
    "legs too far apart for their motors": (
        *("solve", PAPER, "jacobian", [*PLAIN, AUTO, STROKE, "constraints.leg_speed=5"], 1),
        following(r"leg_speed was found for horizon: ([\d.]+)\.", lambda m: f"horizon={m[1]}"),
    ),
    "a stroke and speeds that no search meets": (
        *("solve", PAPER, "jacobian", [*PLAIN, AUTO, STROKE, "constraints.leg_speed=20"], 1),
        following(r"leg_speed was found for horizon: ([\d.]+)\.", lambda m: f"horizon={m[1]}"),
    ),
    "no longest horizon": (
        *(
            "solve",
            HEISENBERG,
            "nlp",
            ["solvers.nlp.intervals=10", "output.pictures=false", "horizon={min: 0.5}"],
            1,
        ),
        replaced(r"as in `horizon: (\{[^}]*\})`", lambda m: f"horizon={m[1]}"),
    ),
}


@pytest.mark.parametrize("name", FAILED)
def test_what_a_failed_run_says_leads_to_its_cure(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    verb, file, solver, overrides, ended, cure = FAILED[name]
    assert run(verb, file, overrides, solver) == ended
    said = " ".join(capsys.readouterr())
    assert run(verb, file, cure(said, overrides), solver) == 0, capsys.readouterr()


NEXT = {
    "into a singular surface": ["solvers.jacobian.gamma=0.1", "goal.position=[-0.4, -0.2, 80]"],
    "too few iterations": ["solvers.jacobian.gamma=0.1", "solvers.jacobian.max_iterations=9"],
}


@pytest.mark.parametrize("name", NEXT)
def test_the_next_command_of_a_failed_run_works(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    overrides = [PLAIN[0], *NEXT[name]]
    assert run("solve", PAPER, overrides) == 1
    command = next_commands(load_solution("out"), Path("out"), task(PAPER, overrides))[0]
    assert status(shlex.split(command)[1:]) == 0
