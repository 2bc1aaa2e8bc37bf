"""Problem files: numbers, defaults, overrides, building, writing back; and what the checking path may import."""

# ruff: noqa: E501 - long lines of YAML
from __future__ import annotations

import dataclasses
import json
import subprocess
import sys
from math import pi
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nhpocp import so3
from nhpocp.constraints.bound import Bound, check_bounds
from nhpocp.controls.fourier import Fourier
from nhpocp.doubts import doubts
from nhpocp.errors import InvalidProblemError
from nhpocp.flow.integrators import Cvodes
from nhpocp.horizon import Horizon
from nhpocp.problem import PlanningProblem
from nhpocp.problem_file import (
    build,
    build_solver,
    control_from_json,
    dump_problem,
    json_schema,
    load_problem,
    parse_problem,
    read,
    read_text,
    starter,
    systems,
)
from nhpocp.problem_file.document import parse
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.step_rules import Euler
from nhpocp.state_space import deg
from nhpocp.systems.three_upu import ThreeUPU
from nhpocp.written_numbers import parse_number

ROOT = Path(__file__).parents[2]
PROBLEMS = sorted((ROOT / "problems").glob("*.yaml"))
PAPER = ROOT / "problems" / "paper.yaml"
MINIMAL = """\
nhpocp: 1
system: {model: three_upu}
start: {position: [0, 0, 25], orientation: {rpy: [0, 0, 0]}}
goal: {position: [0, 0, 30]}
"""
finite = st.floats(-1e6, 1e6)
decimals = st.decimals(0, 1000, places=3).map(lambda number: f"{number:f}")


# --- numbers ---------------------------------------------------------------------------------------------------------


@given(st.booleans(), st.none() | decimals, st.none() | decimals.filter(lambda text: float(text) > 0))
def test_multiples_of_pi(negative, factor, divisor) -> None:
    text = "-" * negative + (f"{factor}*" if factor else "") + "pi" + (f"/{divisor}" if divisor else "")
    expected = (-1) ** negative * float(factor or 1) * pi / float(divisor or 1)
    assert parse_number(text) == pytest.approx(expected, rel=1e-15)


@given(finite)
def test_degrees_and_plain_numbers(number) -> None:
    assert parse_number(f"{number!r} deg") == pytest.approx(number * pi / 180, rel=1e-15)
    assert parse_number(number) == number


@given(st.text(max_size=12))
def test_nothing_else_is_a_number(text) -> None:
    if text in ("pi", "-pi") or "*pi" in text or "pi/" in text or text.endswith(" deg"):
        return
    with pytest.raises(ValueError, match="expected a number"):
        parse_number(text)


@pytest.mark.parametrize(
    "value", [True, None, [], {}, "2pi", "pi*2", "1/2", "1+1", "pi()", "+pi", "pi deg", "９ deg", "1e5"]
)
def test_these_are_no_numbers(value) -> None:
    with pytest.raises(ValueError, match="expected a number"):
        parse_number(value)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 10**400, "1e999 deg"])
def test_numbers_are_finite(value) -> None:
    with pytest.raises(ValueError, match="expected a finite number"):
        parse_number(value)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        *[
            ("1e-3", 1e-3),
            ("0x1F", 31),
            ("0o17", 15),
            ("017", 17),
            ("-.5", -0.5),
            ("yes", "yes"),
            ("1_0", "1_0"),
        ],
        *[
            ("~", None),
            ("True", True),
            ("2001-01-01", "2001-01-01"),
            ("'1'", "1"),
            ("!!str 1", "1"),
            ("!!int 1", 1),
        ],
    ],
)
def test_scalars_follow_the_core_schema_of_yaml_1_2(text, value) -> None:
    found = parse(f"a: {text}\n").data["a"]
    assert (found, type(found)) == (value, type(value))


# --- reading ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("path", PROBLEMS, ids=lambda path: path.stem)
def test_every_problem_of_the_library_is_valid(path) -> None:
    file = read(path)
    assert file.data.name == path.stem
    assert file.text == path.read_text(encoding="utf-8")
    assert file.warnings == []
    problem = load_problem(path)
    assert problem.source == file.text
    assert not problem.reference or problem.reference["source"]


def test_the_papers_task_is_read_as_the_paper_states_it() -> None:
    problem = load_problem(next(path for path in PROBLEMS if path.stem == "paper"))
    np.testing.assert_allclose(
        problem.goal["orientation"], so3.from_rpy(np.array([0, 0, -pi / 2])), atol=1e-15
    )
    np.testing.assert_array_equal(problem.initial, [[0, 0.5, 0, 0, 0], [0, 0.5, 0, 0, 0], [1, 0, 0.5, 0, 0]])


def test_defaults_are_those_of_the_contract(tmp_path) -> None:
    path = tmp_path / "my task.yaml"
    path.write_text(MINIMAL)
    filled = read(path).filled()
    assert filled["name"] == "my task"
    assert filled["horizon"] == 1
    assert filled["control"] == {"basis": "fourier", "harmonics": 2, "initial": "auto"}
    assert (filled["objective"], filled["error_length"], filled["length_scale"]) == ("effort", 1, 15)
    assert filled["system"]["roller_tilt"] == pytest.approx(75 * pi / 180)
    jacobian, nlp = filled["solvers"]["jacobian"], filled["solvers"]["nlp"]
    assert (jacobian["gamma"], jacobian["tolerance"], jacobian["max_iterations"], jacobian["steps"]) == (
        0.1,
        1e-3,
        500,
        100,
    )
    assert (nlp["intervals"], nlp["steps_per_interval"], nlp["tolerance"], nlp["max_iterations"]) == (
        50,
        "auto",
        1e-6,
        1000,
    )
    assert filled["solvers"]["compile"] == "auto"
    assert filled["output"] == {"samples": 201, "pictures": True}


@pytest.mark.parametrize(
    "text", [MINIMAL, PAPER.read_text(encoding="utf-8"), starter()], ids=["minimal", "paper", "starter"]
)
def test_what_is_filled_in_is_itself_a_valid_problem(text) -> None:
    filled = read_text(text).filled()
    again = read_text(json.dumps(filled)).filled()
    assert again == filled


LEGAL = [
    "system: {model: three_upu, preset: normal75, base_radius: 20, roller_tilt: pi/2}",
    "system: {model: three_upu, form: original, joint: suslov}",
    "system: {model: three_upu, preset: default, legs: [&a {base: [1, 0, 0], platform: [1, 0, 0], r: [0, 0, 1], w4: [1, 0, 0]}, "
    "{base: [0, 1, 0], platform: [0, 1, 0], r: [0, 1, 1], w4: [0, 2, 0], joint: suslov}, *a]}",
    "horizon: {min: 0.5, max: 3, initial: 1}",
    "horizon: {min: 0.5, max: 3}",
    "control: {basis: legendre, degree: 3}",
    "control: {basis: bspline, degree: 2, intervals: 4}",
    "control: {basis: piecewise_constant, intervals: 100000}",
    "control: {harmonics: 0, initial: [[0], [0], [pi/2]]}",
    "control:",
    "objective: leg_effort",
    "via: [{at: 0.5, position: [0, 0, 30]}, {at: 1/3, position: [0, 0, 30]}]".replace("1/3", "0.6"),
    "constraints: {leg_length: [20, 60], leg_speed: 200, control: 10, clearance: 0.05}",
    "constraints: {control: [[-1, 1], [-1, 1], [0, 0]], state: {position: [[-10, -10, 15], [10, 10, 45]]}}",
    "constraints: {leg_length: [20, null], state: {position: [-50, 50], leg_lengths: [20, 60]}}",
    "solvers: {jacobian: {step_rule: auto, inverse: lagrangian, metric: l2, integrator: cvodes, objective: path_length, starts: 3}}",
    "solvers: {nlp: {control: basis, steps_per_interval: 3, shooting: single, plugin: fatrop, initial: straight}, compile: never}",
    "solvers: {jacobian: , nlp: }",
    "reference: {jacobian: {effort: 1}, tolerance: 1e-4, source: x}",
    "output: {samples: 11, pictures: false}",
    "start: {position: [0, 0, 25], orientation: {quaternion: [1.0000009, 0, 0, 0]}}",
    "start: {position: [0, 0, 25], orientation: {matrix: [[1.0000009, 0, 0], [0, 1, 0], [0, 0, 1]]}}",
]


@pytest.mark.parametrize("line", LEGAL)
def test_a_legal_file_validates(line) -> None:
    key = line.partition(":")[0]
    kept = [row for row in MINIMAL.splitlines() if not row.startswith(f"{key}:")]
    text = "\n".join([*kept, line])
    file = read_text(text)
    assert [words for words in file.warnings if "singular where it begins" not in words] == []
    jsonschema.Draft7Validator(json_schema()).validate(parse(text).data)
    assert read_text(json.dumps(file.filled())).filled() == file.filled()


def test_goal_equal_to_start_is_legal_and_warned_of() -> None:
    text = MINIMAL.replace("[0, 0, 30]}", "[0, 0, 25], orientation: {quaternion: [1, 0, 0, 0]}}")
    assert any("same as start" in warning for warning in read_text(text).warnings)
    parse_problem(text)


FAR = """nhpocp: 1
system: {model: three_upu}
start: {position: [0, 0, 25], orientation: {rpy: [0, 0, 0]}}
goal: {position: [0, 0, 500], orientation: {rpy: [0, 0, 0]}}
constraints: {leg_length: [20, 60]}
"""


def test_a_goal_that_breaks_a_bound_itself_is_warned_of_with_leg_length_and_place() -> None:
    file = read_text(FAR, "far.yaml")
    words = "leg_length[0] is 500.2, outside [20, 60]; no plan can end there"
    assert file.warnings == [f"goal: {words}"]
    assert file.warning_lines() == [f"far.yaml:4:1: warning: goal: {words}"]
    (line,) = read_text(FAR.replace("500]", "30]"), "far.yaml", ["goal.position=[0, 0, 500]"]).warning_lines()
    assert line == f"far.yaml:4:1: warning: goal: {words}"


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (("500]", "58.06]"), []),  # 60.00 and some hundredths: as much as verification forgives
        (("500]", "59]"), ["goal: leg_length[0] is 60.88, outside [20, 60]; no plan can end there"]),
        (("500], orientation: {rpy: [0, 0, 0]}}", "500]}"), []),  # without orientation no leg has a length
        (("[20, 60]", "[null, 60]"), ["goal: leg_length[0] is 500.2, above 60; no plan can end there"]),
        (
            ("[20, 60]", "[30, null]"),
            ["start: leg_length[0] is 29.15, below 30; no plan can begin there"],
        ),
        (
            ("leg_length: [20, 60]", "state: {position: [[null, -1, 0], [0, 1, 40]]}"),
            ["goal: state.position[2] is 500, outside [0, 40]; no plan can end there"],
        ),
        (
            ("leg_length: [20, 60]", "state: {position: [0, 30], leg_lengths: [0, 600]}"),
            ["goal: state.position[2] is 500, outside [0, 30]; no plan can end there"],
        ),
        (
            ("constraints", "via: [{at: 0.5, position: [0, 0, 90]}]\nconstraints"),
            [
                "goal: leg_length[0] is 500.2, outside [20, 60]; no plan can end there",
            ],
        ),
        (
            (
                "constraints: {",
                "via: [{at: 0.5, position: [3, 0, 25]}]\nconstraints: {state: {position: [0, 2]}, ",
            ),
            [
                "start: state.position[2] is 25, outside [0, 2]; no plan can begin there",
                "goal: leg_length[0] is 500.2, outside [20, 60]; no plan can end there",
                "goal: state.position[2] is 500, outside [0, 2]; no plan can end there",
                "via[0]: state.position[2] is 25, outside [0, 2]; no plan can pass there",
            ],
        ),
    ],
)
def test_poses_are_held_against_the_bounds_that_they_can_break(change, expected) -> None:
    assert change[0] in FAR
    assert read_text(FAR.replace(*change)).warnings == expected


@given(
    position=st.tuples(*[st.floats(-40, 40)] * 3),
    angles=st.tuples(*[st.floats(-3, 3)] * 3),
    limits=st.tuples(st.floats(1, 60), st.floats(1, 60)).map(sorted),
)
@settings(max_examples=20, deadline=None)
def test_the_warning_agrees_with_verification(position, angles, limits) -> None:
    goal = {"position": list(position), "orientation": {"rpy": list(angles)}}
    file = read_text(FAR, None, [f"goal={json.dumps(goal)}", f"constraints.leg_length={json.dumps(limits)}"])
    problem = build(file)
    ends = [
        problem.goal["position"] + problem.goal["orientation"] @ leg.platform - np.array(leg.base)
        for leg in problem.system.legs  # type: ignore[attr-defined]
    ]
    lengths = np.linalg.norm(ends, axis=1)
    (report,) = check_bounds(problem.bounds, np.zeros(1), {"leg_lengths": lengths[None]})
    said = [warning for warning in file.warnings if warning.startswith("goal: leg_length")]
    assert bool(said) is not report.ok
    if said:
        assert f"{report.value:.4g}, {report.limit_words()}" in said[0]


METRES = """nhpocp: 1
system: {model: three_upu, base_radius: 0.03, platform_radius: 0.015}
start: {position: [0, 0, 0.025], orientation: {rpy: [0, 0, 0]}}
goal: {position: [0, 0, 0.035]}
error_length: 0.001
constraints: {state: {position: [[-1, -1, -1], [1, -0.0001, 1]]}}
"""


def test_a_bound_is_measured_by_the_machine_in_any_unit() -> None:
    """In metres, a tenth of a millimetre is within 1e-3 of 1, and far outside."""
    for text in (METRES, METRES.replace("-0.0001", "0.0001").replace("[0, 0, 0.035]", "[0, 0.0002, 0.035]")):
        warnings = read_text(text).warnings
        assert warnings
        assert all("state.position[1]" in warning for warning in warnings)
    assert read_text(METRES.replace("-0.0001", "0.0")).warnings == []


@pytest.mark.parametrize("system", ["three_upu, base_radius: 0.03, platform_radius: 0.015", "unicycle"])
def test_a_tolerance_that_is_large_beside_the_motion_is_warned_of(system) -> None:
    text = METRES.partition("constraints")[0]
    if system == "unicycle":  # which has no length but what it is to cover
        text = (
            text.partition("start")[0]
            + "start: {x: 0, y: 0, theta: 0}\ngoal: {y: 0.01}\nerror_length: 0.001\n"
        )
        text = text.replace("three_upu, base_radius: 0.03, platform_radius: 0.015", system)
    assert read_text(text).warnings == []
    (warning,) = read_text(text.replace("error_length: 0.001\n", "")).warnings
    assert warning.startswith("error_length: 1 is the length that counts as much as one radian")
    assert warning.endswith("by 0.001, where the motion is 0.01; write error_length: 0.01")


def test_overrides_change_data_and_text_and_keep_comments() -> None:
    overrides = [
        "solvers.jacobian.gamma=0.5",
        "control.initial[2][0]=2",
        "constraints.leg_length=[20, 60]",
        "name=x y",
    ]
    file = read(PAPER, overrides)
    assert file.data.solvers.jacobian.gamma == 0.5
    assert file.data.control.initial[2] == [2, 0, 0.5, 0, 0]
    assert file.data.constraints.leg_length == [20, 60]
    assert file.data.name == "x y"
    comments = [line.partition("#")[2].strip() for line in PAPER.read_text(encoding="utf-8").splitlines()]
    for comment in filter(None, comments):
        assert comment in file.text
    assert read_text(file.text).filled() == file.filled()


@pytest.mark.parametrize(
    ("basis", "size"), [("fourier, harmonics", (7, 5, 1)), ("legendre, degree", (4, 3, 1))]
)
def test_an_override_of_the_bases_size_takes_the_initial_control_along(basis, size):
    """With a note, also on reading back what was written; what contradicts itself in the file stays refused."""
    kind, key = basis.split(", ")
    row = [0.5, 1.5, 2.5, 3.5, 4.5][: size[1]]
    text = MINIMAL + f"control: {{basis: {kind}, {key}: 2, initial: [{row}, {row}, {row}]}} # kept\n"
    for value, functions in zip((3, 2, 0), size, strict=True):
        file = read_text(text, overrides=[f"control.{key}={value}"])
        expected = (row + 7 * [0.0])[:functions]
        assert np.array_equal(file.problem.initial, 3 * [expected])
        assert np.array_equal(read_text(file.text).problem.initial, 3 * [expected])
        assert "# kept" in file.text
        assert [doubt.path for doubt in file.doubts] == ([] if value == 2 else ["control.initial"])
    assert read_text(text, overrides=[f"control.{key}=3", "control.initial=auto"]).warnings == []
    for bad in (text.replace(f"{key}: 2", f"{key}: 3"), text.replace("0.5, ", "", 1)):
        with pytest.raises(InvalidProblemError, match=r"control\.initial"):
            read_text(bad, overrides=[f"control.{key}=4"])


@pytest.mark.parametrize("value", ["foo", "-1", "1001", "[2]", "{}", "1.5", ""])
def test_an_override_of_the_bases_size_by_what_is_none_is_refused_as_such(value):
    with pytest.raises(InvalidProblemError) as error:
        read(PAPER, [f"control.harmonics={value}"])
    assert error.value.path.startswith("control.harmonics")


def test_a_gamma_that_does_nothing_is_doubted():
    given = MINIMAL + "solvers: {jacobian: {gamma: 0.5}}\n"
    assert [doubt.path for doubt in read_text(given).doubts] == ["solvers.jacobian.gamma"]
    assert read_text(given, overrides=["solvers.jacobian.step_rule=euler"]).doubts == []


def test_an_override_changes_one_place_only_where_the_file_shares_values() -> None:
    text = MINIMAL.replace("start: {", "start: &s {").replace("goal: {position: [0, 0, 30]}", "goal: *s")
    file = read_text(text, overrides=["goal.position[2]=30"])
    assert file.data.start["position"] == [0, 0, 25]
    assert file.data.goal["position"] == [0, 0, 30]


def test_byte_order_mark_and_crlf_do_no_harm(tmp_path) -> None:
    path = tmp_path / "p.yaml"
    path.write_bytes(b"\xef\xbb\xbf" + MINIMAL.replace("\n", "\r\n").encode())
    assert read(path).data.name == "p"


def test_checking_imports_nothing_heavy() -> None:
    code = (
        "import sys; from nhpocp.problem_file import read, systems, starter, json_schema; "
        f"read({str(PAPER)!r}, ['horizon=2']).filled(); systems(); starter(); json_schema(); "
        "print([m for m in ('casadi', 'scipy', 'matplotlib') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=True)
    assert done.stdout.strip() == "[]"


# --- rotations -------------------------------------------------------------------------------------------------------


@settings(max_examples=25, deadline=None)
@given(st.lists(st.floats(-3, 3), min_size=3, max_size=3))
def test_the_four_ways_to_write_a_rotation_agree_with_so3(angles) -> None:
    def rows(written: str, value) -> np.ndarray:
        text = MINIMAL.replace("rpy: [0, 0, 0]", f"{written}: {json.dumps(value)}")
        return np.array(read_text(text).problem.start["orientation"])

    expected = so3.from_rpy(np.array(angles))
    turn = so3.exp(np.array(angles))
    np.testing.assert_allclose(rows("rpy", angles), expected, atol=1e-14)
    np.testing.assert_allclose(rows("rotvec", angles), turn, atol=1e-14)
    np.testing.assert_allclose(rows("matrix", expected.tolist()), expected, atol=1e-15)
    disturbed = expected + 3e-7 * np.sin(np.arange(9)).reshape(3, 3)
    np.testing.assert_allclose(rows("matrix", disturbed.tolist()), so3.nearest(disturbed), atol=1e-12)
    half, axis = np.linalg.norm(angles) / 2, np.array(angles) / (np.linalg.norm(angles) or 1)
    quaternion = [np.cos(half), *(np.sin(half) * axis)]
    np.testing.assert_allclose(rows("quaternion", quaternion), turn, atol=1e-14)


# --- building --------------------------------------------------------------------------------------------------------


def test_the_paper_is_built_with_its_settings() -> None:
    problem = load_problem(PAPER)
    assert problem.system.parameters() == ThreeUPU.preset("default").parameters()
    assert problem.basis == Fourier(2)
    assert problem.horizon == Horizon(1.0)
    solver = problem.solvers["jacobian"]
    found = solver.settings()
    assert {**found, "gamma": 0.1, "tolerance": 1e-3, "max_iterations": 500, "steps": 100, "seed": 0} == found
    assert (found["step_rule"], found["inverse"], found["metric"], found["integrator"]) == (
        "euler",
        "moore_penrose",
        "coefficients",
        "rk4",
    )


@pytest.mark.parametrize("integrator", ["rk4", "rk", "cvodes"])
@pytest.mark.parametrize("sensitivity", ["automatic", "variational"])
def test_every_available_setting_builds(integrator, sensitivity) -> None:
    rule = {"step_rule": "euler", "gamma": 0.5}
    settings_ = {"integrator": integrator, "sensitivity": sensitivity, "metric": "l2", **rule}
    found = build_solver("jacobian", settings_).settings()
    assert {key: found[key] for key in settings_} == settings_


def test_a_control_is_read_back_from_a_solution_file() -> None:
    control = load_problem(PAPER).control([[0.0] * 5, [1.0] * 5, [2.0] * 5], 3.0)
    again = control_from_json(json.loads(json.dumps(control.to_json())))
    assert (again.basis, again.horizon) == (control.basis, 3.0)
    np.testing.assert_array_equal(again.coefficients, control.coefficients)
    for damaged in (
        {},
        {"basis": "x"},
        {"basis": "fourier", "horizon": 1.0},
        {"basis": "fourier", "coefficients": 1},
    ):
        with pytest.raises(InvalidProblemError):
            control_from_json(damaged)


def test_a_solver_of_bad_settings_names_the_key() -> None:
    with pytest.raises(InvalidProblemError, match="did you mean 'gamma'") as caught:
        build_solver("jacobian", {"gama": 1})
    assert caught.value.path == "solvers.jacobian.gama"
    with pytest.raises(InvalidProblemError, match="available: jacobian"):
        build_solver("simplex")


def test_constraints_become_bounds() -> None:
    text = MINIMAL + (
        "constraints: {leg_length: [20, null], leg_speed: 200, control: [[-1, 2], [-3, 4], [5, 5]], clearance: 0.05,"
        " state: {position: [[-10, -10, 15], [10, 10, 45]]}}\n"
    )
    bounds = {bound.label: bound for bound in parse_problem(text).bounds}
    assert bounds["leg_length"] == Bound("leg_length", "leg_lengths", 20.0, np.inf)
    assert bounds["leg_speed"] == Bound("leg_speed", "u", -200.0, 200.0)
    assert bounds["control"] == Bound("control", "v", [-1.0, -3.0, 5.0], [2.0, 4.0, 5.0])
    assert bounds["clearance.sigma_s"] == Bound("clearance.sigma_s", "sigma_s", 0.05)
    assert bounds["clearance.sigma_w"] == Bound("clearance.sigma_w", "sigma_w", 0.05)
    assert bounds["state.position"].upper == [10, 10, 45]
    assert len(bounds) == 6


# --- writing back ----------------------------------------------------------------------------------------------------

numbers = st.floats(-100, 100)
vectors = st.lists(numbers, min_size=3, max_size=3)
names = st.text(st.characters(exclude_categories=["Cs", "Cc"]), min_size=1, max_size=10).filter(
    lambda text: (
        text.strip() and text.isprintable() and not set(text) & {"/", "\\"} and text not in (".", "..")
    )
)


@st.composite
def problems(draw) -> PlanningProblem:
    basis = Fourier(draw(st.integers(0, 3)))
    rows = st.lists(st.lists(numbers, min_size=basis.size, max_size=basis.size), min_size=3, max_size=3)
    low, width = draw(vectors), draw(st.lists(st.floats(0, 9), min_size=3, max_size=3))
    bounds = [
        Bound("leg_length", "leg_lengths", 20, 60),
        Bound("control", "v", low, [a + b for a, b in zip(low, width, strict=True)]),
        Bound("state.position", "position", -np.inf, np.array([1.0, 2.0, np.inf])),
    ]
    clearance = [Bound(f"clearance.{name}", name, 0.05) for name in ("sigma_s", "sigma_w")]  # only together
    clearance = clearance if draw(st.booleans()) else []
    pose = {"position": draw(vectors), "orientation": so3.exp(np.array(draw(vectors)) / 40)}
    goal = {"position": draw(vectors), "orientation": so3.exp(np.array(draw(vectors)) / 40)}
    kept = draw(st.sampled_from([("position",), ("orientation",), ("position", "orientation")]))
    symmetric = ThreeUPU(base_radius=draw(st.floats(1, 50)), roller_tilt=draw(numbers))
    return PlanningProblem(
        system=draw(st.sampled_from([symmetric, ThreeUPU(legs=symmetric.legs)])),
        start=pose,
        goal={name: goal[name] for name in kept},
        name=draw(names),
        horizon=draw(st.sampled_from([Horizon(2.5), Horizon(1.0, 0.5, 3.0), Horizon(None, 0.5)])),
        basis=basis,
        initial=draw(st.none() | rows),
        objective=draw(st.sampled_from(["effort", "path_length"])),
        error_length=draw(st.floats(0.1, 10)),
        length_scale=draw(st.none() | st.floats(0.1, 10)),
        bounds=[*draw(st.lists(st.sampled_from(bounds), unique_by=lambda bound: bound.label)), *clearance],
        samples=draw(st.integers(2, 500)),
        pictures=draw(st.booleans()),
        reference=draw(st.sampled_from([{}, {"jacobian": {"effort": 3.0}, "source": "a: # \u2028 'b'"}])),
    )


@settings(max_examples=60, deadline=None)
@given(problems())
def test_a_problem_survives_its_own_file(problem) -> None:
    again = parse_problem(dump_problem(problem))
    for part in ("start", "goal"):
        assert getattr(again, part).keys() == getattr(problem, part).keys()
        for name, value in getattr(problem, part).items():
            np.testing.assert_allclose(getattr(again, part)[name], value, rtol=0, atol=1e-15)
    assert (again.initial is None) == (problem.initial is None)
    if problem.initial is not None:
        np.testing.assert_array_equal(again.initial, problem.initial)
    mine, found = problem.system.parameters(), again.system.parameters()
    if "legs" in mine:  # directions are normalised once more
        for a, b in zip(mine.pop("legs"), found.pop("legs"), strict=True):
            assert a.pop("joint") == b.pop("joint")
            np.testing.assert_allclose(list(b.values()), list(a.values()), rtol=1e-15, atol=1e-16)
    assert found == mine
    for name in (
        "name",
        "horizon",
        "basis",
        "objective",
        "error_length",
        "length_scale",
        "samples",
        "pictures",
    ):
        assert getattr(again, name) == getattr(problem, name)
    assert dict(again.reference) == dict(problem.reference)
    bounds = {bound.label: bound for bound in again.bounds}
    written = {bound.label: bound for bound in problem.bounds}
    assert set(written) <= set(bounds) <= set(written) | {"clearance.sigma_s", "clearance.sigma_w"}
    for label, bound in written.items():
        assert bounds[label].quantity == bound.quantity
        for side in ("lower", "upper"):
            np.testing.assert_array_equal(
                *np.broadcast_arrays(getattr(bounds[label], side), getattr(bound, side))
            )


def test_solver_settings_survive_and_a_file_keeps_its_own_text() -> None:
    problem = load_problem(PAPER, ["solvers.jacobian.gamma=0.5", "solvers.jacobian.integrator=rk"])
    assert dump_problem(problem) == problem.source
    again = parse_problem(dump_problem(dataclasses.replace(problem)))
    assert again.solvers["jacobian"].settings() == problem.solvers["jacobian"].settings()


ELSEWHERE = {"position": [-0.4, -0.2, 34], "orientation": np.eye(3)}
CHANGES = {
    "start": {"start": ELSEWHERE},
    "goal": {"goal": {"position": [0, 0, 30]}},
    "system": {"system": ThreeUPU(base_radius=31)},
    "initial": {"initial": np.ones((3, 5))},
    "automatic": {"initial": None},
    "basis": {"basis": Fourier(1), "initial": None},
    "bounds": {"bounds": [Bound("leg_length", "leg_lengths", 20.0, 60.0)]},
    "horizon": {"horizon": Horizon(2.0)},
    "objective": {"objective": "leg_effort"},
    "error_length": {"error_length": 10.0},
    "length_scale": {"length_scale": 10.0},
    "name": {"name": "another"},
    "samples": {"samples": 11},
    "solvers": {"solvers": {"jacobian": Continuation(tolerance=1e-5)}},
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_a_problem_changed_since_it_was_read_is_written_as_it_is(change) -> None:
    problem = dataclasses.replace(load_problem(PAPER), **change)
    again = parse_problem(dump_problem(problem))
    settings = {name: solver.settings() for name, solver in again.solvers.items()}
    written, expected, unchanged = map(dataclasses.replace, (again, problem, load_problem(PAPER)))
    assert dump_problem(written) == dump_problem(expected, settings) == dump_problem(problem, settings)
    assert dump_problem(written) != dump_problem(unchanged)
    for name, solver in problem.solvers.items():
        assert settings[name] == solver.settings()


def test_a_name_that_came_from_the_file_name_is_written_into_the_text(tmp_path) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text(MINIMAL + "# a remark\n")
    text = dump_problem(load_problem(file))
    assert parse_problem(text).name == "mine"
    assert "# a remark" in text


def test_settings_given_for_a_solver_are_written() -> None:
    problem = load_problem(PAPER)
    used = Continuation(step_rule=Euler(0.5), integrator=Cvodes(), tolerance=1e-4)
    again = parse_problem(dump_problem(problem, {"jacobian": used.settings()}))
    assert again.solvers["jacobian"].settings() == used.settings()
    assert again.solvers["nlp"].settings() == problem.solvers["nlp"].settings()
    assert dump_problem(problem, {"jacobian": problem.solvers["jacobian"].settings()}) == problem.source


def test_settings_without_a_word_stay_behind() -> None:
    settings = {**Continuation(tolerance=1e-4).settings(), "step_rule": "hasty", "patience": 3}
    for text in (
        dump_problem(load_problem(PAPER), {"jacobian": settings, "mine": {"tolerance": 1}}),
        dump_problem(parse_problem(MINIMAL), {"jacobian": settings}),
    ):
        solver = parse_problem(text).solvers["jacobian"]
        assert (solver.tolerance, solver.settings()["step_rule"]) == (1e-4, "auto")


def test_a_bound_without_a_word_is_refused() -> None:
    problem = parse_problem(MINIMAL)
    for bound in (Bound("mine", "position", 0, 1), Bound("leg_speed", "u", -1, 2)):
        with pytest.raises(InvalidProblemError, match="no word for"):
            dump_problem(dataclasses.replace(problem, bounds=[bound]))


# --- systems ---------------------------------------------------------------------------------------------------------


def test_systems_are_described_as_plain_data() -> None:
    found = systems()["three_upu"]
    json.dumps(found)
    assert found["defaults"]["base_radius"] == 30
    assert [block["name"] for block in found["states"]] == ["position", "orientation"]
    assert [block["name"] for block in found["inputs"]] == ["v"]
    assert set(found["presets"]) == {"default", "normal75", "paper_conjecture", "vertical_equal"}


LEGLESS = """\
nhpocp: 1
system: {model: unicycle}
start: {x: 0, y: 0, theta: 0}
goal: {y: 1}
"""


@pytest.mark.parametrize(
    ("lines", "path", "words"),
    [
        (
            "objective: leg_effort",
            "objective",
            "none of effort, control_rate, path_length, time, the objectives of unicycle",
        ),
        (
            "solvers: {jacobian: {objective: leg_effort}}",
            "solvers.jacobian.objective",
            "none of effort, control_rate, path_length, the objectives of unicycle; or write none",
        ),
        ("constraints: {leg_speed: 1}", "constraints.leg_speed", "the system unicycle has no legs"),
        ("constraints: {clearance: 1}", "constraints.clearance", "the system unicycle has no legs"),
    ],
)
def test_what_needs_legs_is_refused_where_a_system_has_none(lines, path, words) -> None:
    with pytest.raises(InvalidProblemError, match=words) as caught:
        read_text(f"{LEGLESS}{lines}\n")
    assert caught.value.path == path
    assert caught.value.line == 5


def test_python_hears_of_the_same_objectives() -> None:
    problem = parse_problem(LEGLESS)
    with pytest.raises(
        InvalidProblemError,
        match="none of effort, control_rate, path_length, time, the objectives of unicycle",
    ):
        dataclasses.replace(problem, objective="leg_effort")


# --- angles that are probably degrees -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("rpy: [0, 0, 0]", "rpy: [0, 0, -90]", "start.orientation.rpy[2]: -90 radians are 14.3 turns"),
        ("rpy: [0, 0, 0]", "rotvec: [30, 0, 0]", "start.orientation.rotvec[0]: 30 radians are 4.77 turns"),
        ("three_upu}", "three_upu, roller_tilt: 75}", "if degrees are meant, write 75 deg"),
        ("rpy: [0, 0, 0]", "rpy: [0, 0, 720 deg]", None),
        ("rpy: [0, 0, 0]", "rpy: [0, 0, -6.2]", None),
    ],
)
def test_many_turns_in_radians_are_doubted(old, new, words) -> None:
    warnings = read_text(MINIMAL.replace(old, new)).warnings
    assert len(warnings) == (words is not None)
    assert words is None or words in warnings[0]


def test_coordinates_may_count_their_turns() -> None:
    text = "nhpocp: 1\nsystem: {model: unicycle}\nstart: {x: 0, y: 0, theta: 0}\ngoal: {theta: 12.6}\n"
    assert read_text(text).warnings == []
    (warning,) = read_text(text.replace("12.6", "90")).warnings
    assert warning == "goal.theta: 90 radians are 14.3 turns; if degrees are meant, write 90 deg"
    (warning,) = read_text(text + "via: [{at: 0.5, theta: 45}]\n").warnings
    assert warning.startswith("via[0].theta: 45 radians")


VEHICLE = "nhpocp: 1\nsystem: {model: car}\nstart: {x: 0, y: 0, theta: 0, phi: 0}\ngoal: {x: 0, y: 0.5}\n"
ARM = "nhpocp: 1\nsystem: {model: mobile_manipulator}\nstart: {x: 0, y: 0, theta: 0, q: [0, 1]}\n"
UNDOUBTED = {
    "constraints: {joint_angle: {cone: {max: 9 deg}, theta3: [-6, null]}}": MINIMAL,
    "constraints: {control: 90}": VEHICLE,
    "constraints: {state: {phi: [-30 deg, 30 deg], x: [-90, 90]}}": VEHICLE,
    "obstacles: [{rectangle: {centre: [30, 90], size: [9, 9], angle: 4500 deg}}]": VEHICLE,
}
DOUBTED = {
    "constraints: {joint_angle: {cone: {max: 9}}}": (MINIMAL, {"joint_angle.cone.max": 9}),
    "constraints: {joint_angle: {theta3: [-40 deg, 40]}}": (MINIMAL, {"joint_angle.theta3[1]": 40}),
    "constraints: {state: {phi: [-30, 30]}}": (VEHICLE, {"state.phi[0]": -30, "state.phi[1]": 30}),
    "obstacles: [{rectangle: {centre: [30, 90], size: [9, 9], angle: 45}}]": (
        VEHICLE,
        {"rectangle.angle": 45},
    ),
    "obstacles: [{box: {centre: [0, 0, 99], size: [9, 9, 9], rpy: [0, 0, 45]}}]": (
        MINIMAL,
        {"box.rpy[2]": 45},
    ),
    "goal: {tip_angle: 90}": (ARM, {"goal.tip_angle": 90}),
}


def test_limits_and_obstacles_are_doubted_as_poses_are() -> None:
    for line, text in UNDOUBTED.items():
        assert not [words for words in read_text(f"{text}{line}\n").warnings if "turns" in words], line
    for line, (text, meant) in DOUBTED.items():
        told = [words for words in read_text(f"{text}{line}\n").warnings if "turns" in words]
        assert len(told) == len(meant), line
        for words, (path, number) in zip(told, meant.items(), strict=True):
            assert f"{path}: {number} radians are " in words
            assert f"if degrees are meant, write {number} deg" in words


@pytest.mark.parametrize("unit", [1, deg])
def test_angles_of_python_are_doubted_unless_in_degrees(unit) -> None:
    made = parse_problem(VEHICLE).with_(
        goal={"x": 0, "y": 0.5, "theta": 1900 * unit},
        bounds={"state": {"phi": [-400 * unit, 500 * unit]}, "control": 90},
        obstacles=[{"rectangle": {"centre": [30, 90], "size": [9, 9], "angle": 450 * unit}}],
    )
    told = [doubt for doubt in doubts(made, 1e-3) if "turns" in doubt.message]
    where = [
        "goal.theta",
        "constraints.state.phi[0]",
        "constraints.state.phi[1]",
        "obstacles[0].rectangle.angle",
    ]
    assert [doubt.path for doubt in told] == (where if unit == 1 else [])
    assert all(doubt.message.endswith(" * nhpocp.deg") for doubt in told)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("25 cm", "'cm' is no unit here, only deg is: write 25, in the unit of your other numbers"),
        ("1e-3m", "'m' is no unit here, only deg is: write 1e-3,"),
        ("75 grad", "'grad' is no unit here, only deg is: write 75"),
        ("1.5 rad", "radians are plain numbers: write 1.5"),
    ],
)
def test_units_are_answered_with_what_to_write(text, words) -> None:
    with pytest.raises(ValueError, match=words):
        parse_number(text)
