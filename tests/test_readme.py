"""README says what is there: its code runs, its links lead somewhere, its map shows the house."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from nhpocp.problem_file import read_text

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    """The fenced code blocks of a language ('' for none)."""
    fenced = re.findall(r"^```(\w*)\n(.*?)^```$", README, flags=re.MULTILINE | re.DOTALL)
    return [text for name, text in fenced if name == language]


@pytest.fixture
def folder(tmp_path):
    """A folder in which README's paths to problems hold, and which may be written into."""
    (tmp_path / "problems").symlink_to(ROOT / "problems", target_is_directory=True)
    return tmp_path


def test_there_is_code_to_run():
    assert blocks("python")
    assert blocks("yaml")


@pytest.mark.parametrize("code", blocks("python"))
def test_python_runs(code, folder):
    done = subprocess.run(
        [sys.executable, "-W", "error::FutureWarning", "-c", code],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "converged" in done.stdout
    assert "False" not in done.stdout  # what is verified there verifies


@pytest.mark.parametrize("text", blocks("yaml"))
def test_yaml_is_a_problem(text):
    assert read_text(text, "README.md").warnings == []


def test_relative_links_and_pictures_exist():
    targets = re.findall(r"\]\(([^)\s]+)\)", README)
    relative = [target.partition("#")[0] for target in targets if "://" not in target]
    missing = [target for target in relative if target and not (ROOT / target).exists()]
    assert relative
    assert not missing


def test_named_files_exist():
    """Files in backticks that begin with a folder of the repository."""
    folders = "nhpocp|problems|scripts|tests"
    named = re.findall(rf"`((?:{folders})/[\w./-]*)", README)
    assert [name for name in named if not (ROOT / name).exists()] == []


def test_every_verb_is_one_of_the_command_lines():
    done = subprocess.run(
        [sys.executable, "-c", "from nhpocp.cli import main; main()", "--help"],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    there = set(re.findall(r"^  ([a-z]+) ", done.stdout.partition("Commands:")[2], flags=re.MULTILINE))
    table = [line.split("|")[1] for line in README.splitlines() if line.startswith("| `nhpocp")]
    named = {verb for cell in table for verb in re.findall(r"`(?:nhpocp )?([a-z]+)", cell)}
    named |= set(re.findall(r"`(?:\S*/)?nhpocp ([a-z]+)", README))
    assert named
    assert named - there == set(), "named in README, unknown to the program"
    assert there - named == set(), "verbs that README does not name"


def test_floor_map_names_every_room():
    (floors,) = [block for block in blocks("") if re.search(r"^0 +state_space", block, flags=re.MULTILINE)]
    # what stands in braces is inside a room, not beside it
    named = set(re.findall(r"[a-z]\w+", re.sub(r"\{[^}]*\}", "", floors)))
    rooms = {
        path.stem
        for path in (ROOT / "nhpocp").iterdir()
        if not path.name.startswith("_") and (path.suffix == ".py" or (path / "__init__.py").exists())
    }
    assert rooms - named == set(), "rooms that the map does not show"
    assert named - rooms == set(), "shown on the map, not built"
