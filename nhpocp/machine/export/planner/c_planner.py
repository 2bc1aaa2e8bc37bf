"""A problem's planner as C99: a file and its header, without any library but libm."""

from __future__ import annotations

import re
from pathlib import Path

from nhpocp.csv_writer import identifiers
from nhpocp.errors import InvalidProblemError
from nhpocp.flow.compiled.c_functions import LANES
from nhpocp.flow.compiled.kernel_cache import NotCompilableError
from nhpocp.machine.export.planner import header_text
from nhpocp.machine.export.planner.parts import Parts
from nhpocp.machine.export.planner.planner_source import (
    BAD_INPUT,
    ENDINGS,
    NO_ROTATION,
    SIGNATURE,
    PlannerSource,
)
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.solution import Solver
from nhpocp.state_space import Block
from nhpocp.whole import write_text


def write_planner(problem: PlanningProblem, solver: Solver, file: Path) -> Path:
    """Writes a planner for a problem as its solver would plan it, to `file` and a header beside it, which is returned.

    Its functions begin with the problem's name and `_planner`.
    Errors: `InvalidProblemError` for what a planner cannot do, naming what to set; `OSError`.
    """
    if file.suffix != ".c":
        raise InvalidProblemError(
            "a planner needs a file that ends in .c, for its header ends in .h", file=str(file)
        )
    header = file.with_suffix(".h")
    for each in (file, header):
        _check_ours(each)
    parts = Parts.of(problem, solver)
    (name,) = identifiers([f"{problem.name}_planner"])
    source = PlannerSource(parts, name, header.name)
    try:
        text = source.text()
    except NotCompilableError as error:
        raise InvalidProblemError(f"no planner in C for {problem.system.model}: {error}") from error
    write_text(header, _header(source, file.stem))
    write_text(file, text)
    return header


def _check_ours(file: Path) -> None:
    """Errors: `InvalidProblemError` for a file that stands there and that no planner's is."""
    try:
        with file.open("rb") as stream:
            ours = SIGNATURE.encode() in stream.readline()
    except FileNotFoundError:
        return
    if not ours:
        raise InvalidProblemError("exists, and is no planner of nhpocp's; name another", file=str(file))


def _header(source: PlannerSource, stem: str) -> str:
    """The header's text; ``stem``: of the files' names."""
    parts, name, sizes = source.parts, source.name, source.sizes
    problem, method = parts.problem, parts.method
    space, inputs, joints = problem.system.state_space, problem.system.input_space, parts.joint_labels
    names = {"name": name, "upper": name.upper()}
    room = _room(source)
    time = _comment(problem.units.time or "time")
    free = [block.name for block in space.blocks if block.name not in parts.task.values]
    timing = header_text.DRIFTLESS if problem.system.driftless else header_text.DRIFTING
    joint_words = "lengths of the legs with a motor" if parts.motors else "the numbers of the state"
    use = f", plan.joints; {name}_at(&plan, t, joints, speeds);" if joints else ";"
    return header_text.HEADER.substitute(
        names,
        signature=SIGNATURE,
        title=_comment(problem.name),
        model=_comment(problem.system.model),
        stem=_comment(stem),
        kilobytes=-(-8 * sum(room.values()) // 1000),
        example_use=use,
        rule=f"`step_rule: {method.step_rule.kind}`",
        steps=sizes["STEPS"],
        times=sizes["STEPS"] + 1,
        horizon=repr(float(problem.horizon.fixed)),
        time=time,
        tolerance=repr(float(method.tolerance)),
        length=_comment(problem.units.length or "length"),
        state="\n".join(
            f" *   {space.point_slice(block.name).start}: {_comment(block.name)}, {_written(block)}"
            for block in space.blocks
        ),
        held=header_text.HELD if problem.system.invariants(problem.start_point) else "",
        inputs="\n".join(f" *   {i}: {_comment(label)}" for i, label in enumerate(inputs.labels)),
        functions=", ".join(map(_comment, problem.basis.labels)),
        size=space.size,
        input_count=inputs.size,
        function_count=problem.basis.size,
        coefficients=sizes["COLUMNS"],
        joint_define=f"#define {name.upper()}_JOINTS {len(joints)}\n" if joints else "",
        evaluations=1 + method.max_iterations,
        statuses="\n".join(_statuses(name.upper())),
        error_length=f"{problem.error_length:g}",
        joint_fields=header_text.JOINT_FIELDS.substitute(names, joint_words=joint_words) if joints else "",
        watched_field=f"\n    double watched[{room['watched']}];" if "watched" in room else "",
        free=f" (of which {', '.join(map(_comment, free))} may be anything)" if free else "",
        rotations=header_text.ROTATIONS.substitute(names)
        if any(b.kind == "rotation" for b in space.blocks)
        else "",
        joint_functions=header_text.JOINT_FUNCTIONS.substitute(
            names,
            joints="\n".join(f" *   {i}: {_comment(label)}" for i, label in enumerate(joints)),
            timing=timing,
        )
        if joints
        else "",
        **room,
    )


def _room(source: PlannerSource) -> dict[str, int]:
    """Numbers that a planner works in, by the names of its arrays."""
    sizes, scheme = source.sizes, source.parts.scheme
    n, m, rows, lanes = scheme.size, scheme.inputs, scheme.rows, LANES * sizes["BLOCKS"]
    room = {
        "states": (sizes["STEPS"] + 1) * n,
        "controls": sizes["SAMPLES"] * m,
        "samples": lanes * (n + m),
        "tape": max(1, lanes * scheme.entries),
        "gathered": sizes["SAMPLES"] * rows * m,
        "sums": sizes["FUNCTIONS"] * rows * m,
        "tangents": rows * sizes["COLUMNS"],
        "jacobian": sizes["ROWS"] * sizes["COLUMNS"],
        "fine_states": (sizes["FINE_STEPS"] + 1) * n,
        "fine_controls": sizes["FINE_SAMPLES"] * m,
    }
    return room | ({"watched": (sizes["STEPS"] + 1) * scheme.watches} if scheme.watches else {})


def _statuses(upper: str) -> list[str]:
    """The enum's lines; numbers are places in the list of outcomes."""
    numbers = {outcome: i for i, outcome in enumerate(Outcome)}
    said = [(ending.value, numbers[ending], words) for ending, words in ENDINGS.items()]
    said.append((BAD_INPUT, len(numbers), NO_ROTATION))
    names = [f"{upper}_{word.upper()} = {number}" for word, number, _ in said]
    commas = [","] * (len(said) - 1) + [""]
    width = max(map(len, names)) + 1
    return [
        f"    {f'{name}{comma}':{width}} /* {_comment(words)} */"
        for name, comma, (_, _, words) in zip(names, commas, said, strict=True)
    ]


def _written(block: Block) -> str:
    """How a block of a pose is written."""
    if block.kind == "rotation":
        return "a rotation, body to base: nine numbers row by row"
    unit = {"length": " [length]", "angle": " [rad]", "": ""}[block.unit]
    return ("one number" if block.size == 1 else f"{block.size} numbers") + unit


def _comment(text: str) -> str:
    """A text that ends no comment, and whose characters every compiler reads."""
    return re.sub(r"[^ -~]|[*/\\?]", "_", text)
