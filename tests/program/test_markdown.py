"""Markdown says what is there: its commands and code run in order, its links lead somewhere, its maps show the house.

How the blocks of a page are read, one page in one folder of its own in which problems/ can be seen:

- ``sh``: each line is a command, run as it stands; a backslash at its end continues it. ``# exit 1`` behind it says
  which status it ends with; 0 without.
- ``text`` right behind another block: lines that its output has, ``…`` standing for anything.
- ``python``: run; nothing it prints is False.
- ``yaml``: a whole problem, or a study. ``yaml fragment``: its keys replace those of problems/paper.yaml; both are
  checked.
- ``c``: a program. ``cc`` in ``sh`` compiles it, in the page's folder, and ``./`` begins a program that was made there.
- a file's name behind ``yaml``, ``python`` or ``c``: the block is also that file, for the commands below it.
- ``plugin`` at the end: part of a package that has to be installed first; `test_template` does.
"""

from __future__ import annotations

import contextlib
import gc
import io
import os
import re
import shlex
import subprocess
import warnings
from dataclasses import dataclass
from pathlib import Path

import pytest
from ruamel.yaml import YAML

import nhpocp
from nhpocp.cli.entry import cli, status
from nhpocp.outcome import Outcome
from nhpocp.problem_file import read_text
from nhpocp.study.study import read_study_text
from tests.program import test_floors

ROOT = Path(__file__).parents[2]
PAGES = {str(path.relative_to(ROOT)): path for folder in ("", "nhpocp", "problems", "scripts", "tests")
         for path in sorted((ROOT / folder).glob("*.md"))}  # fmt: skip
LANGUAGES = ("sh", "text", "python", "yaml", "toml", "bibtex", "c", "")
BASE = (ROOT / "problems" / "paper.yaml").read_text(encoding="utf-8")
# these make an environment, install into it, and call these very tests: looked at, not run
SET_UP = ("scripts/run", "scripts/test")
PYTHON = ".venv/bin/python"  # before a script that measures for minutes: looked at, not run


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, the rest of its info string, its text."""

    language: str
    info: str
    text: str


def blocks(page: str) -> list[Block]:
    text = PAGES[page].read_text(encoding="utf-8")
    fenced = re.findall(r"^```(\w*) *([^\n]*)\n(.*?)^```$", text, flags=re.MULTILINE | re.DOTALL)
    return [Block(language, info.strip(), body) for language, info, body in fenced]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder in which the pages' paths to problems hold, and which may be written into."""
    (tmp_path / "problems").symlink_to(ROOT / "problems", target_is_directory=True)
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    gc.enable()  # `check` lives too short to collect its garbage


@pytest.mark.parametrize("page", PAGES)
def test_what_a_page_shows_happens(page, folder, undrawn):
    said = ""
    for block in blocks(page):
        assert block.language in LANGUAGES, f"{page} has a block of {block.language}, which nothing reads"
        if block.info.endswith("plugin"):
            continue
        if re.fullmatch(r"\w+\.(yaml|py|c)", block.info):
            (folder / block.info).write_text(block.text, encoding="utf-8")
        if block.language == "sh":
            lines = block.text.replace("\\\n", " ").splitlines()
            said = "".join(obeyed(line) for line in lines if line.strip())
        elif block.language == "python":
            said = executed(block.text)
        elif block.language == "yaml" and "\nstudy:" in block.text:
            read_study_text(block.text, page)
        elif block.language == "yaml":
            assert read_text(problem_of(block), page).warnings == []
        elif block.language == "text":
            for line in block.text.splitlines():
                pattern = ".*".join(re.escape(part.strip()) for part in line.split("…"))
                assert re.search(pattern, said), f"{page} shows {line!r}; what came was\n{said}"


def obeyed(line: str) -> str:
    """Runs a line of a shell and returns what it said; its exit status is the one that the page says."""
    command, _, comment = line.partition("#")
    words = shlex.split(command)
    expected = re.search(r"exit (\d)", comment)
    if words[0] == PYTHON or words[0] in SET_UP:
        looked_at(words)
        return ""
    if words[0] == "cc" or words[0].startswith("./"):
        done = subprocess.run(words, capture_output=True, text=True, check=False)
        assert done.returncode == int(expected[1] if expected else 0), f"{line}\n{done.stderr}"
        return done.stdout + done.stderr
    assert words[0] in ("nhpocp", ".venv/bin/nhpocp"), f"nothing runs {line!r}"
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
        found = status(words[1:])
    assert found == int(expected[1] if expected else 0), f"{line}\n{out.getvalue()}"
    return out.getvalue()


def looked_at(words: list[str]) -> None:
    """A command that is not run: its script is there, can be run, and knows its options."""
    script = ROOT / (words[1] if words[0] == PYTHON else words[0])
    assert script.is_file(), f"{script} is not there"
    if words[0] in SET_UP:
        assert os.access(script, os.X_OK), f"{script} is not executable"
        return
    text = script.read_text(encoding="utf-8")
    assert [word for word in words[2:] if word.startswith("--") and word not in text] == []


def executed(code: str) -> str:
    out = io.StringIO()
    with contextlib.redirect_stdout(out), warnings.catch_warnings():
        warnings.simplefilter("error", FutureWarning)
        exec(compile(code, "<page>", "exec"), {"__name__": "__main__"})
    assert "False" not in out.getvalue()  # what is verified there verifies
    return out.getvalue()


def problem_of(block: Block) -> str:
    if block.info != "fragment":
        return block.text
    yaml, out = YAML(typ="safe", pure=True), io.StringIO()
    yaml.dump({**yaml.load(BASE), **yaml.load(block.text)}, out)
    return out.getvalue()


def test_the_readme_shows_code_in_every_language():
    shown = {block.language for page in PAGES for block in blocks(page)}
    assert shown == set(LANGUAGES)
    assert {"sh", "python", "yaml"} <= {block.language for block in blocks("README.md")}


@pytest.mark.parametrize("page", PAGES)
def test_links_and_pictures_lead_somewhere(page):
    text = PAGES[page].read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if "://" in target:
            continue
        name, _, place = target.partition("#")
        aim = (PAGES[page].parent / name).resolve() if name else PAGES[page]
        assert aim.exists(), f"{page} leads to {target}"
        if place:
            headings = re.findall(r"^#+ (.*)$", aim.read_text(encoding="utf-8"), flags=re.MULTILINE)
            assert place in [anchor(heading) for heading in headings], f"{page} leads to {target}"


def anchor(heading: str) -> str:
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


@pytest.mark.parametrize("page", PAGES)
def test_named_files_exist(page):
    """Files in backticks that begin with a folder of the repository."""
    text = PAGES[page].read_text(encoding="utf-8")
    named = re.findall(r"`((?:nhpocp|problems|scripts|tests)/[\w./-]*)", text)
    assert [name for name in named if not (ROOT / name).exists()] == []


@pytest.mark.parametrize("page", PAGES)
def test_options_between_backticks_exist(page):
    """Those of the verbs, and those of scripts that are named with them."""
    text = PAGES[page].read_text(encoding="utf-8")
    known = {name for verb in cli.commands.values() for option in verb.params for name in option.opts}
    spans = re.findall(r"`([^`\n]+)`", text)
    options = [word for span in spans if span.startswith(("-", "nhpocp")) for word in span.split()]
    assert [word for word in options if re.match(r"--?[a-z]", word) and word not in known] == []
    for span in spans:
        words = span.removeprefix(f"{PYTHON} ").split()
        if words and re.fullmatch(r"scripts/\w+\.py", words[0]):
            looked_at([PYTHON, *words])


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("nhpocp check problems/paper.yaml  # exit 1", "exit 1"),
        ("nhpocp check problems/none.yaml", "none.yaml"),
        ("ls problems", "nothing runs"),
        (f"{PYTHON} scripts/none.py", "not there"),
        (f"{PYTHON} scripts/benchmark.py --none", "--none"),
    ],
)
def test_a_line_that_does_something_else_is_found(line, words, folder):
    with pytest.raises(AssertionError, match=re.escape(words)):
        obeyed(line)


@pytest.mark.parametrize("page", PAGES)
def test_named_verbs_are_those_of_the_command_line(page):
    text = PAGES[page].read_text(encoding="utf-8")
    named = set(re.findall(r"`(?:\S*/)?nhpocp ([a-z]+)", text))
    assert named - set(cli.commands) == set(), f"named in {page}, unknown to the program"
    if page == "README.md":
        table = [line.split("|")[1] for line in text.splitlines() if line.startswith("| `nhpocp")]
        named |= set(re.findall(r"`([a-z]+)`", "".join(table)))
        assert set(cli.commands) - named == set(), "verbs that README does not name"


def test_pictures_are_shown_and_small():
    pictures = list((ROOT / "problems" / "pictures").iterdir())
    pages = "".join(path.read_text(encoding="utf-8") for path in PAGES.values())
    assert [path.name for path in pictures if f"pictures/{path.name})" not in pages] == []
    allowed = {".png": 64_000, ".gif": 256_000}
    assert [path.name for path in pictures if path.stat().st_size > allowed[path.suffix]] == []
    motions = [path.name for path in pictures if path.stem.endswith("_motion")]
    assert motions
    assert [name for name in motions if (pictures[0].parent / name).stat().st_size > 25_000] == []


def test_the_gallery_shows_every_problem_and_quotes_its_file():
    """Every number with three decimals or more is one that the problem's own file states."""
    text = PAGES["problems/README.md"].read_text(encoding="utf-8")
    entry = r"!\[[^\]]+\]\(pictures/(\w+)_motion\.png\)\n\n\*\*\[(\w+)\.yaml\]\(\2\.yaml\)\*\*: (.*?)\n\n"
    entries = re.findall(entry, text, flags=re.DOTALL)
    assert sorted(stem for _, stem, _ in entries) == sorted(
        p.stem for p in (ROOT / "problems").glob("*.yaml")
    )
    for picture, stem, words in entries:
        stated = (ROOT / "problems" / f"{stem}.yaml").read_text(encoding="utf-8")
        assert picture == stem
        assert [number for number in re.findall(r"\d+\.\d{3,}", words) if number not in stated] == [], stem


def test_every_ending_is_explained():
    text = PAGES["problems/recipes.md"].read_text(encoding="utf-8")
    told = set(re.findall(r"^\| `(\w+)` \|", text.partition("\n## Read a failed run")[2], flags=re.MULTILINE))
    assert told == {"outcome"} | {outcome.value for outcome in Outcome} - {"converged"}


def test_the_citation_has_the_version():
    (entry,) = [block.text for block in blocks("README.md") if block.language == "bibtex"]
    assert f"version = {{{nhpocp.__version__}}}" in entry


def test_every_room_of_the_map_has_its_sentence():
    text = PAGES["nhpocp/README.md"].read_text(encoding="utf-8")
    part = text[text.index("## The map") : text.index("## Six contracts")]
    told = {
        name.rstrip("/").replace("/", ".") for name in re.findall(r"^- `([\w/]+)`", part, flags=re.MULTILINE)
    }
    alike = re.compile(r"flow\.(?!compiled)|__main__")  # the modules of one room, and a door to cli
    assert told == {room for room in test_floors.FLOORS if not alike.match(room)} | {"flow"}


def test_the_example_of_a_system_is_the_one_that_the_tests_examine():
    ferry = (ROOT / "tests" / "ferry.py").read_text(encoding="utf-8")
    (shown,) = [block.text for block in blocks("problems/recipes.md") if "class Ferry" in block.text]
    definition = shown.partition("\n\nproblem = ")[0].strip()
    assert definition in ferry
