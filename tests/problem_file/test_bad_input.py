"""Every mistake in a problem file is answered with its place, what came and what was expected; never a traceback."""

# ruff: noqa: E501 - one mistake a line reads best
from __future__ import annotations

import contextlib
import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nhpocp import errors
from nhpocp.errors import InvalidProblemError
from nhpocp.problem import SAME_TIME
from nhpocp.problem_file import load_problem, read, read_text

GOOD = """\
nhpocp: 1
name: paper
system:
  model: three_upu
  preset: default
start: {position: [0, 0, 25], orientation: {rpy: [0, 0, -pi/6]}}
goal: {position: [-0.4, -0.2, 35], orientation: {rpy: [0, 0, -90 deg]}}
horizon: 1
control:
  basis: fourier
  harmonics: 2
  initial:
    - [0, 0.5, 0, 0, 0]
    - [0, 0.5, 0, 0, 0]
    - [1, 0, 0.5, 0, 0]
constraints: {leg_length: [20, 60]}
solvers:
  jacobian:
    gamma: 0.1
    steps: 100
    step_rule: euler
output: {samples: 201, pictures: true}
"""
RPY = "rpy: [0, 0, -pi/6]"

# what stands in GOOD, what replaces it, line, column, path, part of the message
MISTAKES = [
    ("gamma: 0.1", "gama: 0.1", 19, 5, "solvers.jacobian.gama", "unknown key; did you mean 'gamma'?"),
    ("gamma: 0.1", "gamma: abc", 19, 12, "solvers.jacobian.gamma", "expected a number, got the text 'abc'"),
    ("gamma: 0.1", "gamma: true", 19, 12, "solvers.jacobian.gamma", "got the truth value true"),
    ("gamma: 0.1", "gamma: .nan", 19, 12, "solvers.jacobian.gamma", "NaN; expected a finite number"),
    ("gamma: 0.1", "gamma: .inf", 19, 12, "solvers.jacobian.gamma", "infinity; expected a finite number"),
    ("gamma: 0.1", "gamma: 1e999", 19, 12, "solvers.jacobian.gamma", "infinity"),
    ("gamma: 0.1", "gamma: -1", 19, 12, "solvers.jacobian.gamma", "-1 is not positive"),
    ("gamma: 0.1", "gamma:", 19, 5, "solvers.jacobian.gamma", "expected a number, got nothing"),
    ("gamma: 0.1", "gamma: '0.1'", 19, 12, "solvers.jacobian.gamma", "remove the quotes"),
    ("gamma: 0.1", "gamma: 90deg", 19, 12, "solvers.jacobian.gamma", "write '90 deg'"),
    ("gamma: 0.1", "gamma: 2 * pi", 19, 12, "solvers.jacobian.gamma", "write '2*pi'"),
    ("gamma: 0.1", "gamma: pi/0", 19, 12, "solvers.jacobian.gamma", "divides by zero"),
    ("gamma: 0.1", "gamma: __import__('os')", 19, 12, "solvers.jacobian.gamma", "expected a number"),
    ("gamma: 0.1", "gamma: !!python/name:os 1", 19, 12, None, "means nothing here; remove it"),
    ("gamma: 0.1", "gamma: *x", 19, 12, None, "no anchor &x"),
    ("gamma: 0.1", "gamma: 0.1\n    gamma: 1", 20, 5, "solvers.jacobian.gamma", "duplicate key; first given in line 19"),
    ("step_rule: euler", "step_rule: eulr", 21, 16, "solvers.jacobian.step_rule", "did you mean 'euler'?"),
    ("step_rule: euler", "step_rule: 3", 21, 16, "solvers.jacobian.step_rule", "expected one of euler, adaptive"),
    ("steps: 100", "steps: 0", 20, 12, "solvers.jacobian.steps", "expected a whole number from 1 to 100000"),
    ("steps: 100", "steps: 1.5", 20, 12, "solvers.jacobian.steps", "1.5 is not a whole number"),
    ("  jacobian:", "\tjacobian:", 18, 1, None, "a tab in the indentation; YAML wants spaces"),
    ("harmonics: 2", "harmonics: 1001", 11, 14, "control.harmonics", "from 0 to 1000"),
    ("harmonics: 2", "degree: 2", 11, 3, "control.degree", "unknown key"),
    ("basis: fourier", "basis: furier", 10, 10, "control.basis", "did you mean 'fourier'?"),
    ("    - [1, 0, 0.5, 0, 0]\n", "", 13, 5, "control.initial", "2 rows; expected 3, one per input"),
    ("- [1, 0, 0.5, 0, 0]", "- [1, 0]", 15, 7, "control.initial[2]", "2 numbers; expected 5 (const, sin1"),
    ("horizon: 1", "horizon: 0", 8, 10, "horizon", "0 is not positive"),
    ("horizon: 1", "horizon: {min: 2, max: 1}", 8, 10, "horizon", "min 2 is not below max 1"),
    ("horizon: 1", "horizon: {min: 2, mx: 1}", 8, 19, "horizon.mx", "did you mean 'max'?"),
    ("horizon: 1", "horizon: {min: 2, initial: 1}", 8, 28, "horizon.initial", "outside min and max"),
    (RPY, f"{RPY}, quaternion: [1, 0, 0, 0]", 6, 65, "start.orientation.quaternion", "both rpy and quaternion"),
    (RPY, "", 6, 44, "start.orientation", "expected exactly one of rpy"),
    (RPY, "quaternion: [1, 1, 0, 0]", 6, 57, "start.orientation.quaternion", "write [0.707106781, 0.707106781"),
    (RPY, "matrix: [[1, 0, 0], [0, 1, 0], [0, 0, 1.1]]", 6, 53, "start.orientation.matrix", "off the unit matrix by 0.21"),
    (RPY, "matrix: [[1, 0, 0], [0, 1, 0], [0, 0, -1]]", 6, 53, "start.orientation.matrix", "a reflection, det R = -1"),
    (RPY, "rpy: [0, 0]", 6, 50, "start.orientation.rpy", "a list of 2; expected 3"),
    (RPY, "rpy: [0, 0, x]", 6, 57, "start.orientation.rpy[2]", "expected a number, got the text 'x'"),
    ("{rpy: [0, 0, -pi/6]}", "[0, 0, 0]", 6, 44, "start.orientation", "expected {rpy: [roll, pitch, yaw]}, got a list of 3"),
    ("position: [0, 0, 25]", "position: [0, 0]", 6, 19, "start.position", "2 numbers; expected 3"),
    ("position: [0, 0, 25]", "positon: [0, 0, 25]", 6, 9, "start.positon", "did you mean 'position'?"),
    ("position: [0, 0, 25], ", "", 6, 1, "start.position", "required key is missing; expected [3 numbers]"),
    ("start: {", "strat: {", 6, 1, "strat", "unknown key; did you mean 'start'?"),
    ("goal: {position: [-0.4, -0.2, 35], orientation: {rpy: [0, 0, -90 deg]}}\n", "", 1, 1, "goal", "required key is missing"),
    ("goal: {position: [-0.4, -0.2, 35], orientation: {rpy: [0, 0, -90 deg]}}", "goal: {}", 7, 7, "goal", "expected some of position"),
    ("model: three_upu", "model: three_up", 4, 10, "system.model", "unknown model 'three_up'; did you mean 'three_upu'?"),
    ("  model: three_upu\n", "", 3, 1, "system.model", "required key is missing; available: three_upu"),
    ("preset: default", "preset: defalt", 5, 11, "system.preset", "did you mean 'default'?"),
    ("preset: default", "base_radus: 3", 5, 3, "system.base_radus", "did you mean 'base_radius'?"),
    ("preset: default", "base_radius: 0", 5, 16, "system.base_radius", "0 is not positive"),
    ("preset: default", "joint: suslow", 5, 10, "system.joint", "did you mean 'suslov'?"),
    ("preset: default", "legs: [{base: [0, 0, 0]}]", 5, 10, "system.legs[0].platform", "required key is missing"),
    ("preset: default", "legs: []", 5, 9, "system.legs", "0 legs; the 3-ŬPU robot has 3"),
    ("preset: default", "legs: []\n  joint: suslov", 6, 3, "system.joint", "stands beside legs"),
    ("nhpocp: 1", "nhpocp: 2", 1, 9, "nhpocp", "schema version 2; this nhpocp reads version 1"),
    ("nhpocp: 1\n", "", 1, 1, "nhpocp", "required key is missing"),
    ("name: paper", "name: ../x", 2, 7, "name", "cannot name a folder"),
    ("[20, 60]", "[60, 20]", 16, 27, "constraints.leg_length", "lower bound 60 is above upper bound 20"),
    ("leg_length: [20, 60]", "leg_lenght: 3", 16, 15, "constraints.leg_lenght", "did you mean 'leg_length'?"),
    ("leg_length: [20, 60]", "control: [[0, 1]]", 16, 24, "constraints.control", "1 pairs; expected 3"),
    ("leg_length: [20, 60]", "state: {positon: [0, 1]}", 16, 23, "constraints.state.positon", "did you mean 'position'?"),
    ("leg_length: [20, 60]", "state: {orientation: [0, 1]}", 16, 23, "constraints.state.orientation", "a rotation cannot be bounded"),
    ("leg_length: [20, 60]", "state: {position: [[0], [1]]}", 16, 33, "constraints.state.position", "1 bounds a side; expected 3"),
    ("pictures: true", "pictures: yes", 22, 34, "output.pictures", "expected true or false, got the text 'yes'"),
    ("samples: 201", "samples: 1", 22, 19, "output.samples", "1 is out of range"),
    ("output: {", "via: [{at: 2, position: [0, 0, 30]}]\noutput: {", 22, 12, "via[0].at", "expected a share between 0 and 1"),
    ("output: {", "via: [{at: 0.5, x: 1}]\noutput: {", 22, 17, "via[0].x", "unknown key"),
]  # fmt: skip


def refusal(text: str, overrides: tuple[str, ...] = ()) -> InvalidProblemError:
    with pytest.raises(InvalidProblemError) as caught:
        read_text(text, "p.yaml", overrides)
    return caught.value


@pytest.mark.parametrize(("old", "new", "line", "column", "path", "message"), MISTAKES)
def test_a_mistake_is_answered_with_its_place(old, new, line, column, path, message) -> None:
    assert GOOD.count(old) == 1
    error = refusal(GOOD.replace(old, new))
    assert (error.file, error.line, error.column, error.path) == ("p.yaml", line, column, path), str(error)
    assert message in error.message
    assert "pydantic" not in str(error)
    assert str(error).startswith(f"p.yaml:{line}:{column}: ")


TEXTS = [
    ("", 1, 1, "the file is empty"),
    ("# only a comment\n", 1, 1, "the file is empty"),
    ("- 1\n", 1, 1, "expected a mapping that begins with `nhpocp: 1`, got a list of 1"),
    ("a: b: c\n", 1, 5, "this is not YAML"),
    ("a: [\n", 2, 1, "this is not YAML"),
    ("a: 1\n---\nb: 2\n", 2, 1, "a second document begins here"),
    ("a: 1\nb: \x07", 2, 4, "U+0007 has no place in a text file"),
    ("? [1]\n: 2\n", 1, 3, "a list as a key"),
    ("a: &a [*a]\n", 1, 8, "contains itself"),
    ("[" * 60 + "]" * 60, 1, 51, "nested deeper than 50 levels"),
    ("[" * 900_000, 1, 51, "nested deeper than 50 levels"),
    ("a: &x [*x, 1]", 1, 8, "contains itself"),
    (
        "a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n"
        + "".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]\n" for i in range(1, 30)),
        5,
        None,
        "expands to more than 50000 keys and values",
    ),
    ('a: "\\UFFFFFFFF"\n', None, None, "this is not YAML"),
    ("x" * 1_000_001, None, None, "larger than 1 MB"),
]


@pytest.mark.parametrize(("text", "line", "column", "message"), TEXTS)
def test_a_text_that_holds_no_problem(text, line, column, message) -> None:
    error = refusal(text)
    assert message in error.message
    assert error.line == line
    assert column is None or error.column == column


def test_the_first_mistake_of_the_file_is_reported_and_the_others_counted() -> None:
    error = refusal(GOOD.replace("gamma: 0.1", "gama: 0.1").replace("horizon: 1", "horizon: x"))
    assert error.path == "horizon"
    assert error.message.endswith("(and 1 more)")


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    binary, latin, wide, large = (tmp_path / name for name in ("b.yaml", "l.yaml", "w.yaml", "large.yaml"))
    binary.write_bytes(b"\x7fELF\x02\x01\x00\x00\xff\xfe")
    latin.write_bytes(b"nhpocp: 1\nname: caf\xe9\n")
    wide.write_bytes(GOOD.encode("utf-16"))
    large.write_bytes(b"#" * 1_000_001)
    cases = [
        (tmp_path / "none.yaml", "no such file", None),
        (tmp_path, "this is a folder", None),
        (binary, "is not UTF-8", 1),
        (latin, "byte 0xe9 is not UTF-8", 2),
        (wide, "UTF-16", 1),
        (large, "larger than 1 MB", None),
    ]
    for path, message, line in cases:
        with pytest.raises(InvalidProblemError, match=message) as caught:
            read(path)
        assert (caught.value.file, caught.value.line) == (str(path), line)


def test_a_file_without_permission(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, plain_open = tmp_path / "p.yaml", open
    path.write_text(GOOD)

    def refused(file, *arguments, **options):  # chmod would not stop root
        if Path(file) == path:
            raise PermissionError(13, "Permission denied", str(path))
        return plain_open(file, *arguments, **options)

    monkeypatch.setattr("builtins.open", refused)
    with pytest.raises(InvalidProblemError, match="no permission") as caught:
        read(path)
    assert caught.value.file == str(path)


@pytest.mark.parametrize(
    ("override", "path", "message"),
    [
        ("solvers.jacobian.gama=1", "solvers.jacobian.gama", "did you mean 'gamma'? (given by --set solvers.jacobian.gama)"),
        ("solvers.jacobian.gamma=abc", "solvers.jacobian.gamma", "expected a number, got the text 'abc'"),
        ("solvr.nlp.intervals=3", "solvr", "did you mean 'solvers'?"),
        ("horizon", None, "expected --set key=value"),
        ("=1", None, "expected --set key=value"),
        ("horizon=[1", "horizon", "this is not YAML"),
        ("name.x=1", "name.x", "name has no keys to set"),
        ("control.initial[9]=[1]", "control.initial[9]", "expected an index 0…2"),
        ("start={}", "start.position", "required key is missing"),
    ],
)  # fmt: skip
def test_a_bad_override_names_itself(override, path, message) -> None:
    error = refusal(GOOD, (override,))
    assert (error.file, error.line, error.path) == (None, None, path)
    assert message in error.message
    assert "--set" in error.message


def test_load_problem_says_the_same_as_read(tmp_path: Path) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(GOOD.replace("gamma", "gama"))
    with pytest.raises(InvalidProblemError, match="did you mean 'gamma'"):
        load_problem(path)


@settings(max_examples=150, deadline=None)
@given(
    st.integers(0, len(GOOD)),
    st.integers(0, 12),
    st.text(st.sampled_from("[]{}:,-#&*!|>'\"%@`?\n\t 019.eapi~xé\\"), max_size=6),
)
def test_no_damage_to_the_text_escapes_as_a_foreign_exception(place, removed, inserted) -> None:
    text = GOOD[:place] + inserted + GOOD[place + removed :]
    # legal or refused: anything but InvalidProblemError fails the test
    with contextlib.suppress(InvalidProblemError):
        read_text(text, "p.yaml")


@settings(max_examples=60, deadline=None)
@given(st.text(max_size=60))
def test_no_text_escapes_as_a_foreign_exception(text) -> None:
    with pytest.raises(InvalidProblemError):
        read_text(text)


MANY = {  # of one thing
    "unknown keys": (GOOD + "".join(f"k{i}: 1\n" for i in range(2_000)), "unknown key"),
    "unknown blocks": (
        GOOD.replace("start: {", "start: {" + "".join(f"k{i}: 1, " for i in range(2_000))),
        "unknown key",
    ),
    "unknown bounds": (
        GOOD.replace(
            "leg_length: [20, 60]", "state: {" + "".join(f"k{i}: [0, 1], " for i in range(2_000)) + "}"
        ),
        "unknown quantity",
    ),
    "wrong via poses": (GOOD + "via:\n" + "- {at: 2, position: a}\n" * 2_000, "not inside the horizon"),
    "via poses at no time": (
        GOOD + "via:\n" + "- {att: 0.5, position: a}\n" * 2_000,
        "required key is missing",
    ),
    "via poses at one time": (
        GOOD + "via:\n" + "- {at: 0.5, position: [0, 0, 1]}\n" * 2_000,
        "at 0.5 already",
    ),
    "via poses out of order": (
        GOOD + "via:\n" + "".join(f"- {{at: 0.{9_999 - i}, position: a}}\n" for i in range(2_000)),
        "expected",
    ),
}


@pytest.mark.parametrize("name", MANY)
def test_the_work_on_mistakes_grows_with_their_number_alone(name, monkeypatch) -> None:
    """Names are compared for the one that is told, and keys and times are looked up, not searched for."""
    text, words = MANY[name]
    compared, match = [], errors.difflib.get_close_matches
    monkeypatch.setattr(
        errors.difflib,
        "get_close_matches",
        lambda *given, **how: compared.append(given) or match(*given, **how),
    )
    error = refusal(text)
    assert words in error.message
    assert re.search(r"\(and \d{4,} more\)$", error.message)
    assert len(compared) <= 2_001  # a guess for a missing key beside an unknown one, in each mapping


def test_a_long_list_of_keys_is_refused_like_one_of_values() -> None:
    for text in ("a: {" + ", ".join(f"k{i}: 1" for i in range(30_000)) + "}", "a: [" + "1," * 60_000 + "]"):
        assert "expands to more than 50000 keys and values" in refusal(text).message


def test_via_poses_at_one_time_are_found_in_any_order_and_named_as_the_file_has_them() -> None:
    close, apart = SAME_TIME * 0.9, SAME_TIME * 1.1
    for times, later in (
        ([0.5, 0.2, 0.5 + close], [2]),
        ([0.5, 0.5 - close, 0.5 + apart], [0]),  # of two the later in time
        ([0.3, 0.1, 0.2, 0.1, 0.3, 0.3], [3, 4, 5]),
        ([0.1, 0.1 + apart, 0.1 - apart], []),
        ([0.5, close], [1]),
    ):
        via = "".join(f"- {{at: {time!r}, position: [0, 0, 30]}}\n" for time in times)
        if later:
            error = refusal(f"{GOOD}via:\n{via}")
            assert error.path == f"via[{min(later)}].at"
            assert error.message.endswith("more)") == (len(later) > 1)
        else:
            read_text(f"{GOOD}via:\n{via}")


# --- every mistake at once --------------------------------------------------------------------------------------------

SEVERAL = (
    GOOD.replace("gamma: 0.1", "gamma: abc")
    .replace("steps: 100", "stps: 100")
    .replace("    - [1, 0, 0.5, 0, 0]\n", "")
    .replace("leg_length: [20, 60]", "leg_lenght: 3, leg_speed: -1")
    .replace("output: {", "gamma: 2\noutput: {")
)


def test_every_mistake_of_a_file_is_located():
    """Those of form, and those of meaning in the blocks whose form is right."""
    each = [(error.line, error.column, error.path) for error in refusal(SEVERAL).each]
    assert each == [
        (13, 5, "control.initial"),
        (15, 15, "constraints.leg_lenght"),
        (15, 41, "constraints.leg_speed"),
        (18, 12, "solvers.jacobian.gamma"),
        (19, 5, "solvers.jacobian.stps"),
        (21, 1, "gamma"),
    ]
    assert "more)" not in "".join(error.message for error in refusal(SEVERAL).each)
    assert refusal(SEVERAL).message.endswith("(and 5 more)")


def test_a_mistake_of_form_makes_none_of_meaning():
    """With harmonics unknown nothing is said of the columns of `initial`."""
    each = refusal(GOOD.replace("harmonics: 2", "harmonics: two")).each
    assert [error.path for error in each] == ["control.harmonics"]


@pytest.mark.parametrize(
    ("override", "whole"),
    [
        ("gamma=1", "'solvers.jacobian.gamma'"),
        ("jacobian.gamma=1", "'solvers.jacobian'"),
        ("harmonics=3", "'control.harmonics'"),
        ("leg_speed=3", "'constraints.leg_speed'"),
        ("samples=30", "'output.samples'"),
        ("base_radius=30", "'system.base_radius'"),
        ("position=[0,0,30]", "'start.position' or 'goal.position'"),
        ("solvers.jacobian.intervals=3", "'solvers.nlp.intervals'"),
        ("solvers.gamma=3", "'solvers.jacobian.gamma'"),
        ("constraints.position=[0,3]", "'constraints.state.position'"),
        ("obstacles=[{distance: 3}]", "'constraints.distance'"),
    ],
)
def test_a_key_without_its_blocks_is_told_where_it_belongs(override, whole):
    assert f"unknown key; did you mean {whole}" in refusal(GOOD, (override,)).message
