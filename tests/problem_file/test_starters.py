"""The files that `nhpocp init` writes: right as they stand, and with every key that they offer."""

from __future__ import annotations

import re
from pathlib import Path

import jsonschema
import pytest

from nhpocp.errors import InvalidProblemError
from nhpocp.planning import solve
from nhpocp.problem_file import json_schema, parse_problem, read_text, starter
from nhpocp.problem_file.document import parse
from nhpocp.problem_file.registry import SYSTEMS, system_class
from nhpocp.problem_file.settings import BLOCKS

PROBLEMS = sorted((Path(__file__).parents[2] / "problems").glob("*.yaml"))
OPTION = re.compile(
    r"^( *)# (\w+): (?!.*\[…\])(.*?)(?: +# .*)?$", re.MULTILINE
)  # a key that is commented out


def uncommented(found):
    return f"{found[1]}{found[2]}: {found[3]}"


@pytest.fixture(scope="module")
def editor() -> jsonschema.Draft7Validator:
    return jsonschema.Draft7Validator(json_schema())


@pytest.mark.parametrize("model", SYSTEMS)
def test_it_is_right_for_reader_and_editor_and_so_is_every_key_in_it(model, editor) -> None:
    text = starter(model)
    assert text.startswith("# yaml-language-server: $schema=nhpocp.schema.json\n")
    assert read_text(text).warnings == []
    editor.validate(parse(text).data)
    settings = [name for block in BLOCKS.values() for name in block.model_fields]
    for name in (*system_class(model).declared, *settings):
        assert re.search(rf"^ *#? ?{name}: ", text, re.MULTILINE), name
    used, count = OPTION.subn(uncommented, text)
    assert count >= 25
    alone = [words for words in read_text(used).warnings if not words.startswith("obstacles: nothing asks")]
    assert alone == []  # a distance, which comes after, is beside them in a comment
    editor.validate(parse(used).data)


@pytest.mark.parametrize("model", SYSTEMS)
def test_it_can_be_solved(model) -> None:
    assert solve(parse_problem(starter(model) + "  pictures: false\n")).converged


def test_its_keys_stand_at_their_defaults() -> None:
    text = starter("unicycle")
    filled, bare = read_text(OPTION.sub(uncommented, text)).filled(), read_text(text).filled()
    assert filled["constraints"] != bare["constraints"]
    for name in ("solvers", "output", "objective", "error_length"):
        assert filled[name] == bare[name]


def test_a_system_without_an_example_gets_a_made_up_task(monkeypatch) -> None:
    monkeypatch.setattr(system_class("unicycle"), "example", {})
    text = starter("unicycle")
    assert "are made up" in text
    assert read_text(text).data.goal == {"x": 1, "y": 1, "theta": 1}


def test_no_line_is_wider_than_an_editor() -> None:
    for model in SYSTEMS:
        assert max(map(len, starter(model).splitlines())) <= 150


def test_an_unknown_system_is_asked_back() -> None:
    with pytest.raises(InvalidProblemError, match="did you mean 'three_upu'"):
        starter("three_up")
