"""The study file: what its axes mean, what `check` holds against it, and that the file alone says everything."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
from click.testing import CliRunner
from corners import CORNERS
from hypothesis import given, settings
from hypothesis import strategies as st

from nhpocp.cli.verbs import cli
from nhpocp.errors import InvalidProblemError
from nhpocp.problem_file import read_text
from nhpocp.study.design import Design, Factor
from nhpocp.study.study import Study, changed_goal, overrides, read_problem, read_study_text

HEAD = CORNERS + "  axes:\n"


def study(*axes: str, end: str = "") -> Study:
    return read_study_text(HEAD + "".join(f"    {axis}\n" for axis in axes) + end, "study.yaml")


def column(of: Study, path: str) -> list:
    return [of.parameters(run)[path] for run in range(1, len(of) + 1, len(of.solvers))]


def test_every_combination_goals_innermost_and_solvers_fastest():
    made = study("goal.x: [1, 2]", "horizon: [1, 2, 4]", end='  solvers: [jacobian, "nlp:intervals=20"]\n')
    assert len(made) == 12
    assert column(made, "horizon") == [1, 1, 2, 2, 4, 4]
    assert column(made, "goal.x") == [1, 2] * 3
    assert [made.solver(run) for run in (1, 2, 3)] == ["jacobian", "nlp:intervals=20", "jacobian"]
    assert made.goal_axes == {"goal.x"}


@pytest.mark.parametrize(
    ("axis", "levels"),
    [
        ("[60 deg, -pi/6, 1e-1]", [math.pi / 3, -math.pi / 6, 0.1]),
        ("{linspace: [-1, 1, 5]}", [-1, -0.5, 0, 0.5, 1]),
        ("{linspace: [3, 4, 1]}", [3]),
        ("{logspace: [0.01, 100, 3]}", [0.01, 1, 100]),
        ("{range: [0, 0.3, 0.1]}", [0, 0.1, 0.2, 0.3]),
        ("{range: [2, -1, -1.5]}", [2, 0.5, -1]),
        ("{uniform: [0, 2], samples: 3, sampling: grid}", [0, 1, 2]),
        ("{loguniform: [1, 4], samples: 3, sampling: grid}", [1, 2, 4]),
    ],
)
def test_levels(axis, levels):
    assert column(study(f"goal.x: {axis}"), "goal.x") == pytest.approx(levels)


@pytest.mark.parametrize("sampling", ["random", "latin_hypercube", "sobol"])
def test_drawn_axes_of_one_kind_are_drawn_together_and_again_the_same(sampling):
    axes = ["goal.x: {uniform: [1, 3]}", "goal.y: {loguniform: [1, 100]}", "horizon: [1, 2]"]
    end = f"  sampling: {sampling}\n  samples: 21\n  seed: 5\n"
    made = study(*axes, end=end)
    assert len(made) == 42
    assert made == study(*axes, end=end)
    assert made.digest == study(*axes, end=end).digest != study(*axes, end=end.replace("5", "6")).digest
    xs, ys = column(made, "goal.x")[:21], column(made, "goal.y")[:21]
    assert all(1 <= x <= 3 for x in xs)
    assert all(1 <= y <= 100 for y in ys)
    assert len(set(zip(xs, ys, strict=True))) == 21
    if sampling == "latin_hypercube":  # one in each of the slices, whose logarithms are alike for y
        assert sorted(int((x - 1) / 2 * 21) for x in xs) == list(range(21))
        assert sorted(int(math.log(y) / math.log(100) * 21) for y in ys) == list(range(21))
    if sampling == "sobol":  # of the first 16 one in each sixteenth
        assert sorted(int((x - 1) / 2 * 16) for x in xs[:16]) == list(range(16))


def test_a_seed_of_its_own_is_a_factor_of_its_own():
    axes = ["goal.x: {uniform: [0, 1], samples: 3}", "goal.y: {uniform: [0, 1], samples: 3, seed: 1}"]
    assert len(study(*axes)) == 9


@settings(deadline=None)
@given(st.lists(st.integers(1, 4), min_size=1, max_size=4))
def test_points_are_all_different_and_as_many_as_there_are(sizes):
    factors = tuple(
        Factor((f"a{k}",), tuple((level,) for level in range(size))) for k, size in enumerate(sizes)
    )
    design = Design(factors)
    points = [tuple(design.point(index).items()) for index in range(len(design))]
    assert len(set(points)) == len(points) == math.prod(sizes)


def test_a_goal_is_changed_as_the_reader_of_problem_files_would_change_it():
    made = study("goal.x: [2 deg]", "goal.theta: [3]", "horizon: [2]")
    parameters = made.parameters(1)
    whole = read_problem(made.problem_text, None, parameters, "jacobian")
    fast = changed_goal(read_text(made.problem_text).data.model_dump(exclude_none=True)["goal"], parameters)
    assert fast == whole.data.goal
    assert overrides(parameters, "nlp:intervals=9")[-1] == "solvers.nlp.intervals=9"
    turned = changed_goal(
        {"position": [1, 2], "orientation": {"rpy": [0, 0, 1]}}, {"goal.orientation.rpy[2]": 5}
    )
    assert turned == {"position": [1, 2], "orientation": {"rpy": [0, 0, 5]}}


WRONG = {
    "goal.x: 5": "goal.x: expected a list of levels, or a rule such as {linspace: [0, 1, 5]}, got the number",
    "goal.x: []": "study.axes.goal.x: expected a list of levels, or a rule such as {linspace: [0, 1, 5]}, got an empty",
    "goal.x: [1, 2, far]": "9:20: study.axes.goal.x[2]: expected a number, got the text 'far'",
    "goal.x[0]: [1]": "9:5: study.axes.goal.x[0]: goal.x has no keys to set",
    "goal.u: [1]": "9:5: study.axes.goal.u: unknown key; expected one of x, y, theta",
    "horizont: [1]": "9:5: study.axes.horizont: unknown key; did you mean 'horizon'?",
    "horizon: [1, -1]": "9:18: study.axes.horizon[1]: -1 is not positive; expected a number > 0",
    "horizon: {linspace: [1, -1, 3]}": "9:14: study.axes.horizon: -1 is not positive; expected a number > 0",
    "goal.x: {linspace: [1, 2]}": "9:24: study.axes.goal.x.linspace: a list of 2; expected 3",
    "goal.x: {linspce: [1, 2, 3]}": "9:14: study.axes.goal.x.linspce: unknown key; did you mean 'linspace'?",
    "goal.x: {uniform: [2, 1]}": "9:13: study.axes.goal.x: uniform: 2 is not below 1; expected [least, most]",
    "goal.x: {loguniform: [0, 1]}": "study.axes.goal.x: loguniform: 0 is not positive; expected two positive numbers",
    "goal.x: {range: [0, 1, -1]}": "study.axes.goal.x: range: steps of -1 do not lead from 0 to 1",
    "goal.x: {range: [0, 1, 1e-9]}": "study.axes.goal.x: range: 1e+09 levels; expected 100000 at most",
    "goal.x: {linspace: [0, 1, 2], seed: 1}": "study.axes.goal.x: seed belongs to uniform and loguniform",
    "goal.x: {samples: 3}": "study.axes.goal.x: expected one of linspace, logspace, range, uniform",
    "goal x: [1]": "9:5: study.axes.goal x: no path of a key",
    "horizon: [1]\n  solvers: [jacobain]": "10:13: study.solvers[0]: 'jacobain' is no solver; did you mean 'jacobian'?",
    "horizon: [1]\n  solvers: ['nlp:intervls=3']": "10:13: study.solvers[0]: solvers.nlp.intervls: unknown key",
    "horizon: [1]\n  order: nearset": "10:10: study.order: unknown value 'nearset'; did you mean 'nearest'?",
    "horizon: [1]\n  oder: nearest": "10:3: study.oder: unknown key; did you mean 'order'?",
}


@pytest.mark.parametrize("axis", WRONG)
def test_mistakes_are_told_where_they_stand(axis):
    with pytest.raises(InvalidProblemError) as caught:
        study(axis)
    assert WRONG[axis] in str(caught.value)
    assert str(caught.value).startswith("study.yaml:")


def test_mistakes_of_the_problem_are_told_in_its_own_file(tmp_path):
    problem = tmp_path / "problem.yaml"
    problem.write_text("nhpocp: 1\nsystem: {model: unicycle}\nstart: {x: 0, y: 0, theta: 0}\ngoal: {w: 1}\n")
    text = "nhpocp: 1\nstudy: {problem: problem.yaml, axes: {horizon: [1, 2]}}\n"
    with pytest.raises(InvalidProblemError, match=r"problem\.yaml:4:8: goal\.w"):
        read_study_text(text, str(tmp_path / "study.yaml"))
    with pytest.raises(
        InvalidProblemError, match=r"study\.yaml:2:18: study\.problem: .*missing\.yaml: no such file"
    ):
        read_study_text(text.replace("problem.yaml", "missing.yaml"), str(tmp_path / "study.yaml"))
    with pytest.raises(InvalidProblemError, match=r"study\.yaml:7:12: study\.problem\.goal\.v"):
        read_study_text(HEAD.replace("x: 1, y", "v: 1, y") + "    horizon: [1]\n", "study.yaml")


def said(*arguments):
    done = CliRunner().invoke(cli, list(map(str, arguments)), standalone_mode=False)
    return done.return_value, done.stdout, done.stderr


def test_check_knows_studies_and_solve_says_what_they_are_for(tmp_path):
    file = tmp_path / "study.yaml"
    file.write_text(HEAD + "    goal.x: {linspace: [0, 1, 5]}\n")
    assert said("check", file) == (0, f"{file}: ok, 5 runs\n", "")
    status, out, _ = said("check", file, "--json")
    assert (status, json.loads(out)["study"]["axes"]) == (0, {"goal.x": 5})
    file.write_text(HEAD + "    goal.x: {linspac: [0, 1, 5]}\n")
    status, out, errors = said("check", file)
    assert (status, out) == (2, "")
    assert f"{file}:9:14: study.axes.goal.x.linspac: unknown key; did you mean 'linspace'?" in errors
    file.write_text(HEAD + "    goal.x: {linspace: [0, 1, 5]}\n")
    done = CliRunner().invoke(cli, ["solve", str(file)], standalone_mode=False)
    assert "this is a study of many problems; run it with `nhpocp sweep" in str(done.exception)


def test_checking_a_study_that_draws_nothing_loads_no_heavy_library(tmp_path):
    import subprocess
    import sys

    file = tmp_path / "study.yaml"
    file.write_text(HEAD + "    goal.x: {linspace: [0, 1, 5]}\n")
    code = (
        "import sys\nfrom pathlib import Path\nfrom nhpocp.study.study import read_study\n"
        "read_study(Path(sys.argv[1]))\n"
        "assert not {'casadi', 'scipy', 'matplotlib', 'sqlite3'} & set(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", code, str(file)], check=True, cwd=Path(__file__).parents[2])
