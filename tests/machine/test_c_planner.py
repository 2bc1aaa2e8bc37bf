"""`nhpocp export FILE --format c-planner`: a program that plans what Python plans, with its numbers and its endings."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from compiled_planner import STRICT, CompiledPlanner, Question

from nhpocp import so3
from nhpocp.cli.entry import status
from nhpocp.machine.export.planner.c_planner import write_planner
from nhpocp.planning import refused
from nhpocp.problem import PlanningProblem
from nhpocp.problem_file import build, read
from nhpocp.solvers.continuation.confirmation import missed
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.continuation_result import ContinuationResult
from nhpocp.state_space import deg
from tests.machine.conftest import PROBLEMS, reference

CHECKED = ("-O0", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all", *STRICT)
PAPER = ["solvers.jacobian.step_rule=adaptive", "solvers.jacobian.max_iterations=12"]
CLOSE = 1e-9


def exported(folder: Path, name: str, overrides: Sequence[str]) -> tuple[PlanningProblem, Continuation, Path]:
    """A problem of the library, its method, and what the program makes of them."""
    source = folder / f"{name}.c"
    given = [word for override in overrides for word in ("--set", override)]
    problem_file = PROBLEMS / f"{name}.yaml"
    assert status(["export", str(problem_file), "--format", "c-planner", "-o", str(source), *given]) == 0
    problem = build(read(problem_file, overrides))
    solver = problem.solvers["jacobian"]
    return problem, solver, source


@pytest.fixture(scope="module")
def paper(tmp_path_factory: pytest.TempPathFactory) -> tuple[PlanningProblem, Continuation, CompiledPlanner]:
    problem, method, source = exported(tmp_path_factory.mktemp("paper"), "paper", PAPER)
    return problem, method, CompiledPlanner(source, CHECKED)


def asked(problem: PlanningProblem, first: Any = None) -> Question:
    return problem.start_point, problem.goal_point, first


def near_goals(problem: PlanningProblem, count: int) -> list[PlanningProblem]:
    """Problems whose starts and goals lie beside the paper's."""
    random, tasks = np.random.default_rng(0), []
    for _ in range(count):
        poses = []
        for pose in (problem.start, problem.goal):
            turn = so3.exp(random.normal(0.0, 0.1, 3))
            position = np.asarray(pose["position"]) + random.normal(0.0, 0.5, 3)
            poses.append({"position": position, "orientation": turn @ pose["orientation"]})
        tasks.append(problem.with_(start=poses[0], goal=poses[1]))
    return tasks


def test_plans_are_python_s(paper: tuple[PlanningProblem, Continuation, CompiledPlanner]) -> None:
    problem, method, planner = paper
    tasks = [problem, *near_goals(problem, 20)]
    answers = planner.plans(map(asked, tasks))
    assert sum(answer.status == "converged" for answer in answers) > 15
    for task, answer in zip(tasks, answers, strict=True):
        plan = method.find(task)
        assert answer.status == plan.outcome.value
        assert (answer.updates, answer.evaluations) == (plan.updates, len(plan.records))
        assert np.abs(answer.coefficients - plan.control.coefficients.ravel()).max() < CLOSE
        assert answer.error == pytest.approx(plan.error, abs=CLOSE)
        assert task.goal_error(answer.end) == pytest.approx(answer.error, abs=CLOSE)


def test_legs_move_as_the_plan_does(paper: tuple[PlanningProblem, Continuation, CompiledPlanner]) -> None:
    problem, method, planner = paper
    count = 34
    (answer,) = planner.plans([asked(problem)], times=count)
    solution = method.find(problem).solution(method, problem)
    times = 1.1 * np.arange(count) / (count - 1) - 0.05
    inside = (times >= 0) & (times <= 1)
    states = reference(solution, np.clip(times, 0.0, 1.0)[inside], 1.0, quintic=False)
    lengths = [np.asarray(problem.system.output("leg_lengths", x, np.zeros(3))) for x in states]
    assert answer.joints[inside] == pytest.approx(np.array(lengths), abs=1e-5)
    slopes = np.gradient(answer.joints[inside], times[inside], axis=0)
    assert answer.speeds[inside][1:-1] == pytest.approx(slopes[1:-1], rel=0.05, abs=1.0)
    assert (answer.speeds[~inside] == 0).all()
    assert (answer.joints[0] == answer.joints[1]).all()  # it rests there


def beginning(problem: PlanningProblem, scale: float) -> np.ndarray:
    return np.asarray(problem.initial) * scale


def test_endings_are_python_s(paper: tuple[PlanningProblem, Continuation, CompiledPlanner]) -> None:
    problem, method, planner = paper
    random = np.random.default_rng(3)
    firsts = [
        np.zeros((3, 5)),
        beginning(problem, 30.0),
        *(problem.initial + random.normal(0.0, size, (3, 5)) for size in (1.0, 3.0, 6.0)),
    ]
    far = problem.towards({**problem.goal, "position": [0.0, 0.0, 80.0]})
    tasks = [*(problem.with_(initial=first) for first in firsts), far]
    answers = planner.plans(asked(task, task.initial) for task in tasks)
    seen: set[str] = set()
    for task, answer in zip(tasks, answers, strict=True):
        plan: ContinuationResult = method.find(task)
        assert answer.status == plan.outcome.value
        assert (answer.updates, answer.evaluations) == (plan.updates, len(plan.records))
        assert answer.coefficients == pytest.approx(plan.control.coefficients.ravel(), abs=1e-6)
        seen.add(answer.status)
    assert seen >= {"rank_deficient", "singular_s", "iteration_limit"}


def test_what_is_no_task_is_said(paper: tuple[PlanningProblem, Continuation, CompiledPlanner]) -> None:
    problem, method, planner = paper
    start, goal, _ = asked(problem)
    opposite = problem.towards({**problem.goal, "orientation": {"rpy": [0, 180 * deg, 0]}})
    said = refused(opposite, method)
    assert said is not None
    lost, reflected, rough = (np.array(goal) for _ in range(3))
    lost[1] = np.nan
    reflected[3:] *= -1.0
    rough[3:] *= 1.0 + 1e-7  # Python takes it for the rotation that is nearest
    words = [
        (start, opposite.goal_point, None, said.outcome.value),
        (start, lost, None, "not_finite"),
        (np.full(12, np.inf), goal, None, "not_finite"),
        (start, goal, np.full((3, 5), np.inf), "not_finite"),
        (start, reflected, None, "bad_input"),
        (np.zeros(12), goal, None, "bad_input"),
        (start, rough, None, "converged"),
    ]
    answers = planner.plans([(one, other, first) for one, other, first, _ in words])
    assert [answer.status for answer in answers] == [status for *_, status in words]
    assert answers[0].status == "other_component"
    plan = method.find(problem)
    assert answers[-1].coefficients == pytest.approx(plan.control.coefficients.ravel(), abs=CLOSE)
    still = answers[1]
    assert (still.updates, still.evaluations) == (0, 0)
    assert (still.coefficients == 0).all()
    assert (still.end == start).all()


@pytest.mark.parametrize(
    ("name", "overrides"),
    [
        ("unicycle", ["solvers.jacobian.objective=none"]),
        (
            "unicycle",
            ["solvers.jacobian.objective=none", "solvers.jacobian.metric=l2", "goal={x: 1, y: 0.5}"],
        ),
        ("rolling_sphere", ["solvers.jacobian.step_rule=adaptive", "solvers.jacobian.objective=none"]),
        (  # of splines few are not zero at once, and the state is moved by itself, linearly
            "double_integrator",
            [
                "control={basis: bspline, degree: 2, intervals: 4}",
                "solvers.jacobian={step_rule: adaptive, metric: l2}",
                "constraints=null",
                "objective=effort",
                "horizon=1.5",
            ],
        ),
    ],
    ids=["unicycle", "a part of the pose, by L2", "sphere", "splines"],
)
def test_other_systems_and_bases(tmp_path: Path, name: str, overrides: list[str]) -> None:
    problem, method, source = exported(tmp_path, name, overrides)
    planner = CompiledPlanner(source, CHECKED)
    start, goal, _ = asked(problem)
    with_free = np.where(goal == start, np.nan, goal) if len(problem.goal) < len(problem.start) else goal
    (answer,) = planner.plans([(start, with_free, None)], times=5)
    plan = method.find(problem)
    assert answer.status == plan.outcome.value == "converged"
    assert np.abs(answer.coefficients - plan.control.coefficients.ravel()).max() < CLOSE
    if answer.joints.size:  # the numbers of the state itself
        assert (answer.joints[0] == start).all()
        assert (answer.joints[-1] == answer.end).all()


def test_a_half_turn_has_no_axis(tmp_path: Path) -> None:
    still = "control={harmonics: 1, initial: [[0, 0, 0], [0, 0, 0]]}"
    overrides = ["solvers.jacobian={step_rule: adaptive}", still]
    problem, method, source = exported(tmp_path, "rolling_sphere", overrides)
    half = problem.towards({**problem.goal, "orientation": {"rpy": [0, 0, 180 * deg]}})
    (answer,) = CompiledPlanner(source, CHECKED).plans([asked(half)])
    assert answer.status == method.find(half).outcome.value == "orientation_at_pi"


def test_a_claim_that_finer_steps_refute_is_none(tmp_path: Path) -> None:
    overrides = ["solvers.jacobian={step_rule: adaptive, steps: 12, tolerance: 1e-6}"]
    problem, method, source = exported(tmp_path, "heisenberg", overrides)
    (answer,) = CompiledPlanner(source, CHECKED).plans([asked(problem)])
    plan = method.find(problem)
    assert plan.outcome.value == "converged"
    assert missed(problem, plan.control, plan.integrator) > method.tolerance
    assert answer.status == "not_verified"
    assert np.abs(answer.coefficients - plan.control.coefficients.ravel()).max() < CLOSE


def test_the_example_plans_the_file_s_problem(tmp_path: Path) -> None:
    problem, method, source = exported(tmp_path, "unicycle", ["solvers.jacobian.objective=none"])
    again = source.read_bytes()
    exported(tmp_path, "unicycle", ["solvers.jacobian.objective=none"])
    assert source.read_bytes() == again
    program = tmp_path / "example"
    flags = ["-O1", *STRICT, "-DUNICYCLE_PLANNER_EXAMPLE"]
    subprocess.run(["cc", *flags, str(source), "-o", str(program), "-lm"], check=True)
    said = subprocess.run([str(program)], check=True, capture_output=True, text=True).stdout.splitlines()
    assert said[0].startswith("converged: E = ")
    rows = np.array([[float(word) for word in line.split()] for line in said[1:]])
    assert rows == pytest.approx(method.find(problem).control.coefficients, abs=CLOSE)


def test_names_of_problems_do_no_harm(tmp_path: Path) -> None:
    problem = build(read(PROBLEMS / "unicycle.yaml", ["solvers.jacobian.objective=none"]))
    named = problem.with_(name='*/ #error "\n$x??/ 寸')
    header = write_planner(named, problem.solvers["jacobian"], tmp_path / "plan.c")
    for text in (header.read_text(encoding="utf-8"), (tmp_path / "plan.c").read_text(encoding="utf-8")):
        assert text.isascii()
    subprocess.run(["cc", "-O0", *STRICT, "-c", "plan.c", "-o", "object"], check=True, cwd=tmp_path)


def test_a_planner_is_named_by_its_problem(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    words = ["--set", "name=2-wheels", "--set", "solvers.jacobian.objective=none", "--json"]
    assert status(["export", str(PROBLEMS / "unicycle.yaml"), "--format", "c-planner", *words]) == 0
    assert json.loads(capsys.readouterr().out) == {
        "file": "x2_wheels_planner.c",
        "header": "x2_wheels_planner.h",
        "format": "c-planner",
        "name": "x2_wheels_planner",
    }
    assert {file.name for file in tmp_path.iterdir()} == {"x2_wheels_planner.c", "x2_wheels_planner.h"}


@pytest.mark.parametrize(
    ("name", "overrides", "words"),
    [
        ("paper", [], "paper.yaml:26:16: solvers.jacobian.step_rule: euler; the planner in C takes"),
        ("paper", [*PAPER, "solvers.jacobian.inverse=damped"], "`inverse: moore_penrose`"),
        ("paper", [*PAPER, "solvers.jacobian.integrator=cvodes"], "`integrator: rk4`"),
        ("paper", [*PAPER, "solvers.jacobian.sensitivity=variational"], "`sensitivity: automatic`"),
        ("paper", [*PAPER, "solvers.jacobian.objective=effort"], "`objective: none`"),
        ("paper", [*PAPER, "solvers.jacobian.starts=3"], "`starts: 1`"),
        ("paper", [*PAPER, "constraints={leg_speed: 200}"], "constraints: the planner in C does without"),
        ("paper", [*PAPER, "via=[{at: 0.5, position: [0, 0, 30]}]"], "plan from one to the next"),
        ("paper", [*PAPER, "goal={leg_lengths: [38, 39, 40]}"], "leg_lengths; the planner in C takes goals"),
        ("paper", [*PAPER, "control={harmonics: 0}"], "3 coefficients cannot meet 6 numbers"),
    ],
)
def test_what_a_planner_cannot_do_is_said(
    tmp_path: Path, capsys: Any, name: str, overrides: list[str], words: str
) -> None:
    given = [word for override in overrides for word in ("--set", override)]
    source = [str(PROBLEMS / f"{name}.yaml"), "--format", "c-planner", "-o", str(tmp_path / "a.c")]
    assert status(["export", *source, *given]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert not list(tmp_path.iterdir())


def test_files_of_others_stay(tmp_path: Path, capsys: Any) -> None:
    given = [str(PROBLEMS / "paper.yaml"), "--format", "c-planner", "--set", PAPER[0]]
    for name in ("a.h", "b.c"):
        (tmp_path / name).write_text("int mine;\n")
        target = tmp_path / f"{name[0]}.c"
        assert status(["export", *given, "-o", str(target)]) == 2
        assert "is no planner of nhpocp's; name another" in capsys.readouterr().err
    for target, words in ((tmp_path / "plan", "ends in .c"), (tmp_path, "this is a folder")):
        assert status(["export", *given, "-o", str(target)]) == 2
        assert words in capsys.readouterr().err
    assert status(["export", str(tmp_path), *given[1:]]) == 2
    assert "made of a problem's file" in capsys.readouterr().err
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.h", "b.c"]
