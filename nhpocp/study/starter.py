"""A commented study file to begin with, for `nhpocp init --study`, and the schema by which editors check studies."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from nhpocp.constraints.registry import KINDS
from nhpocp.problem_file.editor_schema import DIALECT, REFERENCE, json_schema
from nhpocp.problem_file.registry import system_class
from nhpocp.problem_file.starters import example_task, flow, line, options
from nhpocp.study.schema import OptimiseData, StudyData, StudyFileData
from nhpocp.systems.system import System

IDENTITY = "nhpocp.study.schema.json"
LEVELS = 3
HEAD = """\
# yaml-language-server: $schema={schema}
# By the line above editors complete and check this file; it names a file beside this one, which is written again by
#   nhpocp schema --study -o {schema}
# Every combination of the axes' levels is a run; `nhpocp check` says how many, `nhpocp sweep` runs them.
# Lines that begin with # are keys at their defaults, or examples; remove the # to set one."""


def study_starter(model: str = "three_upu", schema: str = IDENTITY) -> str:
    """A study file around the task of `nhpocp init` for ``model``; ``schema``: where editors find the JSON schema.

    Errors: `InvalidProblemError` for an unknown model or a broken plugin.
    """
    cls = system_class(model)
    system = cls()
    task = example_task(system)
    lines = [
        *HEAD.format(schema=schema).splitlines(),
        line("nhpocp: 1", "version of this format"),
        line("study:"),
        line("  # name: my_study", str(StudyData.model_fields["name"].description)),
        line("  problem:", "or the path of a problem file, from this file's folder, such as problem.yaml"),
        *_problem(cls, model, task),
        line("  axes:", "levels by the path of any key of the problem: a list, or a rule"),
        *_axes(system, task),
        line("  solvers: [jacobian]", 'or [jacobian, nlp, "nlp:initial=jacobian"]: each at every point'),
        *options(StudyData, ["samples", "sampling", "seed", "order"], "  "),
        *_optimise(system),
    ]
    return "\n".join(lines) + "\n"


def _problem(cls: type[System], model: str, task: Mapping[str, Any]) -> Iterator[str]:
    preset = f", preset: {next(iter(cls.presets))}" if cls.presets else ""
    yield f"    system: {{model: {model}{preset}}}"
    yield from (
        f"    {name}: {flow(task[name])}" for name in ("start", "goal", "horizon", "control") if name in task
    )


def _axes(system: System, task: Mapping[str, Any]) -> Iterator[str]:
    """One that is on: the first number of the goal, if there is one; and examples of the others."""
    for block in system.state_space.blocks:
        value = task["goal"].get(block.name)
        if isinstance(value, list) and value and isinstance(value[0], int | float):
            value, place = value[0], "[0]"
        else:
            place = ""
        if isinstance(value, int | float):
            yield line(f"    goal.{block.name}{place}: {{linspace: [{value:g}, {value + 0.2:g}, {LEVELS}]}}")
            yield line("    # horizon: [1, 2]", "a list of levels")
            break
    else:
        yield line("    horizon: [1, 2]", "a list of levels")
    yield line("    # error_length: {loguniform: [0.1, 10], samples: 50, seed: 1}", "drawn; or uniform")
    yield line("    # solvers.jacobian.seed: {range: [0, 8, 2]}", "also logspace: [from, to, number]")


def _optimise(system: System) -> Iterator[str]:
    """An example: over a dimension of the system, if it has one, for little effort and much clearance."""
    sizes = {
        name: value for name, value in system.parameters().items() if isinstance(value, float) and value > 0
    }
    name, size = next(iter(sizes.items()), ("", 0.0))
    over = (
        f"system.{name}: [{0.9 * size:g}, {1.1 * size:g}]" if name else "solvers.jacobian.gamma: [0.05, 0.2]"
    )
    objectives = "[effort]" if KINDS["clearance"].lacking(system) else "[effort, {max: clearance}]"
    fields = OptimiseData.model_fields
    yield line("  # optimise:", str(StudyData.model_fields["optimise"].description))
    yield line(f"  #   over: {{{over}}}", str(fields["over"].description))
    yield line(f"  #   objectives: {objectives}", str(fields["objectives"].description))
    for key in ("trials", "batch", "seed"):
        yield line(f"  #   {key}: {fields[key].default}", str(fields[key].description))


def study_schema() -> dict[str, Any]:
    """JSON schema (draft 7) of study files, with a description of every key, and defaults."""
    problem = json_schema()
    schema = StudyFileData.model_json_schema(ref_template=REFERENCE)
    definitions = {**problem.pop("definitions"), **schema.pop("$defs")}
    inline = {key: part for key, part in problem.items() if not key.startswith("$")}
    inline["required"] = [name for name in inline["required"] if name != "nhpocp"]
    keys = definitions["StudyData"]["properties"]
    keys["problem"] = {
        "description": keys["problem"]["description"],
        "if": {"type": "object"},
        "then": inline,
        "else": {"type": "string"},
    }
    keys["axes"] |= {"minProperties": 1, "properties": dict.fromkeys(_paths(), _axis(keys["axes"]))}
    over = definitions["OptimiseData"]["properties"]["over"]
    over |= {"minProperties": 1, "properties": dict.fromkeys(_paths(), over["additionalProperties"])}
    objectives = definitions["OptimiseData"]["properties"]["objectives"]
    definitions["OptimiseData"]["properties"]["objectives"] = {
        "anyOf": [objectives, objectives["items"]],
        "description": objectives["description"],
    }
    definitions["StudyData"]["anyOf"] = [{"required": ["axes"]}, {"required": ["optimise"]}]
    keys["solvers"] = {
        "anyOf": [keys["solvers"], {"type": "string"}],
        "description": keys["solvers"]["description"],
    }
    head = {"$schema": DIALECT, "$id": IDENTITY, "title": "nhpocp study file"}
    return {**head, **schema, "definitions": definitions}


def _axis(axes: Mapping[str, Any]) -> Any:
    return axes["additionalProperties"]


def _paths() -> Iterator[str]:
    """Paths for editors to offer; any other may be written too."""
    from nhpocp.problem_file.homes import paths

    yield from (
        path for path in paths({"system": {}}, None) if "." in path or path in ("horizon", "error_length")
    )
