"""The JSON schema that editors check problem files by: says yes and no as the reader does, and where."""

from __future__ import annotations

import json
from pathlib import Path
from typing import ClassVar

import jsonschema
import pytest

from nhpocp.errors import InvalidProblemError
from nhpocp.problem_file import editor_schema, json_schema, read_text, registry
from nhpocp.problem_file.document import parse
from nhpocp.state_space import StateSpace, vector
from nhpocp.systems.system import Parameter, System

PROBLEMS = sorted((Path(__file__).parents[2] / "problems").glob("*.yaml"))
PAPER = next(path for path in PROBLEMS if path.stem == "paper")
BEGINNING = """\
nhpocp: 1
system: {model: three_upu}
start: {position: [0, 0, 25], orientation: {rpy: [0, 0, 0]}}
"""
GOAL = "goal: {position: [0, 0, 30]}\n"


@pytest.fixture(scope="module")
def editor() -> jsonschema.Draft7Validator:
    """What an editor knows of problem files."""
    schema = json_schema()
    jsonschema.Draft7Validator.check_schema(schema)
    assert schema["$schema"] == jsonschema.Draft7Validator.META_SCHEMA["$schema"]
    return jsonschema.Draft7Validator(schema)


@pytest.mark.parametrize("path", PROBLEMS, ids=lambda path: path.stem)
def test_it_accepts_the_library(path, editor) -> None:
    editor.validate(parse(path.read_text(encoding="utf-8")).data)


@pytest.mark.parametrize(
    "line",
    [
        "goal: {position: [1e-3, 2., .5]}",
        "goal: {orientation: {rpy: [75 deg, pi/6, -2*pi/3]}}",
        "goal: {orientation: {quaternion: [1, 0, 0, 0]}}",
        "goal: {leg_lengths: [38, 39, 40], platform_normal: [0, 0.1, 1]}",
        f"{GOAL}horizon: {{min: 0.5, max: 3e0}}",
        f"{GOAL}solvers: {{jacobian: {{tolerance: 1e-3, steps: 1e2}}, nlp: {{steps_per_interval: 2}}}}",
        f"{GOAL}solvers:\n  jacobian:\nconstraints:\ncontrol: {{harmonics: 1}}",
        f"{GOAL}control: {{basis: bspline, degree: 2, initial: auto}}",
        f"{GOAL}constraints: {{leg_length: [null, 60], control: [[-1, pi], [-1, 1], [-1, 1]]}}",
        f"{GOAL}constraints: {{state: {{position: [[-1, -1, 0], [1, 1, null]]}}}}",
        f"{GOAL}via: [{{at: 0.5, position: [0, 0, 30]}}]\nname: 12",
    ],
)
def test_it_accepts_what_is_read(line, editor) -> None:
    read_text(BEGINNING + line)
    editor.validate(parse(BEGINNING + line).data)


@pytest.mark.parametrize(
    ("damage", "place"),
    [
        ({"nhpocp": 2}, ["nhpocp"]),
        ({"gama": 1}, []),
        ({"horizon": True}, ["horizon"]),
        ({"system": {"model": "x"}}, ["system", "model"]),
        ({"system": {"model": "three_upu", "base_radus": 3}}, ["system"]),
        ({"system": {"model": "three_upu", "preset": "mine"}}, ["system", "preset"]),
        ({"system": {"model": "three_upu", "base_radius": "30 mm"}}, ["system", "base_radius"]),
        ({"start": {"position": [0, 0, 25]}}, ["start"]),
        ({"goal": {}}, ["goal"]),
        ({"goal": {"position": [0, 0]}}, ["goal", "position"]),
        ({"goal": {"positon": [0, 0, 30]}}, ["goal"]),
        ({"goal": {"position": [0, 0, "75 grad"]}}, ["goal", "position", 2]),
        ({"goal": {"orientation": {"rpy": [0, 0, 0], "rotvec": [0, 0, 0]}}}, ["goal", "orientation"]),
        ({"control": {"basis": "x"}}, ["control"]),
        ({"control": {"basis": "fourier", "degree": 3}}, ["control"]),
        ({"control": {"initial": [["a"]]}}, ["control"]),
        ({"objective": "efort"}, ["objective"]),
        ({"solvers": {"jacobian": {"step_rule": "fast"}}}, ["solvers"]),
        ({"solvers": {"jacobian": {"gamma": 0}}}, ["solvers"]),
        ({"solvers": {"nlp": {"intervals": 1.5}}}, ["solvers"]),
        ({"constraints": {"leg_length": [1, "x"]}}, ["constraints"]),
        ({"output": {"pictures": "yes"}}, ["output"]),
    ],
    ids=str,
)
def test_it_refuses_what_the_reader_refuses_and_says_where(damage, place, editor) -> None:
    data = {**parse(PAPER.read_text(encoding="utf-8")).data, **damage}
    assert [list(error.absolute_path) for error in editor.iter_errors(data)] == [place]
    with pytest.raises(InvalidProblemError):
        read_text(json.dumps(data))


def blocks(node):
    """Every mapping of keys that a file may use; conditions on them are none."""
    if isinstance(node, dict):
        yield from [node["properties"]] if isinstance(node.get("properties"), dict) else []
        for name, part in node.items():
            yield from () if name == "if" else blocks(part)
    elif isinstance(node, list):
        for part in node:
            yield from blocks(part)


def test_every_key_says_what_it_is(editor) -> None:
    """What editors show on hover."""
    schema = editor.schema
    ends = [part["then"]["properties"][end] for part in schema["allOf"] for end in ("start", "goal")]
    described = [{"properties": schema["properties"]}, list(schema["definitions"].values()), ends]
    keys = [item for block in blocks(described) for item in block.items()]
    assert len(keys) > 150
    for name, key in keys:
        assert key["title"].startswith(name), name
        assert len(key["description"]) > 4, name


def test_names_that_depend_on_parameters_are_offered_and_not_forced(monkeypatch) -> None:
    class Chain(System):
        model = "chain"
        declared: ClassVar = {"n": Parameter("integer", 3, "links")}

        def __init__(self, n=3):
            self._declare({"n": n})
            self.state_space, self.input_space = StateSpace([vector("q", n)]), StateSpace([vector("u", 2)])

    monkeypatch.setattr(editor_schema, "SYSTEMS", {"chain": Chain})
    monkeypatch.setattr(registry, "system_class", lambda _: Chain)
    schema = json_schema()
    assert schema["allOf"][0]["then"]["properties"]["start"]["properties"]["q"]["description"] == "3 numbers"
    valid = jsonschema.Draft7Validator(schema).is_valid
    problem = {
        "nhpocp": 1,
        "system": {"model": "chain", "n": 2},
        "start": {"q": [0, 0]},
        "goal": {"q": [0, 1]},
    }
    assert valid(problem)
    assert valid(problem | {"goal": {"end": [0, 1]}})
    assert not valid(problem | {"start": {"q": 0}})
    assert not valid(problem | {"start": {"q": [0, 0], "r": "x"}})
