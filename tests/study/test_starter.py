"""What `init --study` writes, and the schema of studies: right for the reader and for editors."""

from __future__ import annotations

import contextlib
from pathlib import Path

import jsonschema
import pytest

from nhpocp.cli import entry
from nhpocp.problem_file import json_schema
from nhpocp.problem_file.document import parse
from nhpocp.problem_file.registry import SYSTEMS
from nhpocp.study.starter import study_schema, study_starter
from nhpocp.study.study import read_study, read_study_text

STUDIES = sorted((Path(__file__).parents[2] / "problems" / "studies").glob("*.yaml"))


@pytest.fixture(scope="module")
def editor() -> jsonschema.Draft7Validator:
    schema = study_schema()
    jsonschema.Draft7Validator.check_schema(schema)
    return jsonschema.Draft7Validator(schema)


@pytest.mark.parametrize("model", SYSTEMS)
def test_a_starter_is_right_and_so_are_the_lines_that_it_offers(model, editor):
    text = study_starter(model)
    assert len(read_study_text(text)) >= 2
    editor.validate(parse(text).data)
    offered = text.replace("    # horizon", "    horizon") if text.count("horizon: [") == 1 else text
    offered = offered.replace("    # error", "    error").replace("    # solvers", "    solvers")
    for name in ("name", "samples", "sampling", "seed", "order"):
        offered = offered.replace(f"  # {name}:", f"  {name}:")
    whole = read_study_text(offered)
    assert (whole.name, len(whole) % (50 * 5)) == ("my_study", 0)
    editor.validate(parse(offered).data)
    optimised = text.replace("  # optimise:", "  optimise:").replace("  #   ", "    ")
    assert len(read_study_text(optimised)) == 100 * len(read_study_text(text))
    editor.validate(parse(optimised).data)


@pytest.mark.parametrize("path", STUDIES, ids=lambda path: path.stem)
def test_the_library_is_right(path, editor):
    assert len(read_study(path)) >= 2
    editor.validate(parse(path.read_text(encoding="utf-8")).data)


@pytest.mark.parametrize(
    ("right", "wrong", "place"),
    [
        ("linspace", "linspce", "axes"),
        ("goal: {x:", "goal: {w:", "problem"),
        ("solvers: [jacobian]", "solvers: [3]", "solvers"),
        ("# order: given", "order: anyhow", "order"),
        ("start:", "strat:", "problem"),
        ("# optimise:", "optimise: {over: {horizon: 3}, objectives: [effort]}", "optimise"),
        ("# optimise:", "optimise: {over: {horizon: [1, 3]}, objectives: [{least: effort}]}", "optimise"),
    ],
)
def test_editors_underline_mistakes_where_they_stand(right, wrong, place, editor):
    text = study_starter("unicycle")
    assert right in text
    mistakes = list(editor.iter_errors(parse(text.replace(right, wrong)).data))
    assert mistakes
    assert all(list(mistake.absolute_path)[:2] == ["study", place] for mistake in mistakes)


def test_editors_complete_the_paths_of_axes(editor):
    axes = editor.schema["definitions"]["StudyData"]["properties"]["axes"]
    assert {"constraints.leg_length", "solvers.nlp.intervals", "horizon"} <= set(axes["properties"])
    assert editor.schema["$id"] != json_schema()["$id"]


def test_init_writes_a_study_and_its_schema(tmp_path, capsys):
    with contextlib.chdir(tmp_path):
        assert entry.status(["init", "--study"]) == 0
        assert (
            capsys.readouterr().out == "study.yaml\nnhpocp.study.schema.json\nnext: nhpocp sweep study.yaml\n"
        )
        assert entry.status(["init", "--study"]) == 2
        assert entry.status(["schema", "--study", "-o", "nhpocp.study.schema.json"]) == 0
        assert entry.status(["check", "study.yaml"]) == 0
        assert capsys.readouterr().out.endswith("study.yaml: ok, 3 runs\n")
