"""The columns of trajectory.csv: names that other programs take, and numbers that are the trajectory's."""

from __future__ import annotations

import csv
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from nhpocp import planning
from nhpocp.csv_writer import identifiers
from nhpocp.problem_file import parse_problem, starter
from nhpocp.solution import Solution
from nhpocp.solution_folder import audit, load_solution, save_solution
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.step_rules import Euler
from tests.conftest import paper_problem


@pytest.fixture(scope="module")
def solution() -> Solution:
    return planning.solve(paper_problem("paper_conjecture", samples=21), Continuation(step_rule=Euler(1.0)))


@pytest.fixture(scope="module")
def folder(solution: Solution, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_solution(solution, tmp_path_factory.mktemp("columns") / "plan")


def table(file: Path) -> dict[str, np.ndarray]:
    with file.open(newline="", encoding="utf-8") as stream:
        header, *rows = csv.reader(stream)
    return dict(zip(header, np.array(rows, dtype=float).T, strict=True))


def test_the_paper_s_quantities_stand_under_its_names(solution: Solution, folder: Path) -> None:
    every, trajectory = table(folder / "trajectory.csv"), solution.trajectory
    assert next(iter(every)) == "t"
    assert all(re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name) for name in every)
    goal = solution.problem.goal
    turns = Rotation.from_matrix(trajectory["orientation"] @ goal["orientation"].T).as_rotvec()
    angles = Rotation.from_matrix(trajectory["orientation"]).as_euler("xyz")
    for i in range(3):
        np.testing.assert_array_equal(every[f"v_{i + 1}"], trajectory["v"][:, i])
        np.testing.assert_array_equal(every[f"position_{i + 1}"], trajectory["position"][:, i])
        np.testing.assert_array_equal(every[f"orientation_3_{i + 1}"], trajectory["orientation"][:, 2, i])
        np.testing.assert_array_equal(every[f"theta_{i + 1}_2"], trajectory["joint_angles"][:, i, 1])
        np.testing.assert_array_equal(
            every[f"e_p_{i + 1}"], trajectory["position"][:, i] - goal["position"][i]
        )
        np.testing.assert_allclose(every[f"r_{i + 1}"], turns[:, i], atol=1e-9)
        np.testing.assert_allclose(every[("roll", "pitch", "yaw")[i]], angles[:, i], atol=1e-9)


def test_the_table_of_version_0_1_is_still_read(solution: Solution, folder: Path, tmp_path: Path) -> None:
    copy = Path(shutil.copytree(folder, tmp_path / "copy"))
    names, columns = [], []
    for name, values in solution.trajectory.items():  # as 0.1 wrote it
        for place in np.ndindex(*np.shape(values)[1:]):
            names.append(name + "".join(f"[{i}]" for i in place))
            columns.append(np.asarray(values)[(slice(None), *place)])
    lines = [",".join(names), *(",".join(map(repr, row)) for row in np.column_stack(columns).tolist())]
    (copy / "trajectory.csv").write_text("\r\n".join([*lines, ""]))
    assert audit(copy).differences == []
    np.testing.assert_array_equal(load_solution(copy).trajectory["v"], solution.trajectory["v"])
    lines[3] = lines[3].replace(",", ",1", 1)
    (copy / "trajectory.csv").write_text("\n".join(lines))
    assert any("trajectory.csv: position[0] is" in said for said in audit(copy).differences)


def test_a_header_of_others_is_noticed(folder: Path, tmp_path: Path) -> None:
    copy = Path(shutil.copytree(folder, tmp_path / "copy"))
    text = (copy / "trajectory.csv").read_text()
    (copy / "trajectory.csv").write_text(text.replace("v_1", "v_2", 1))
    assert audit(copy).differences == ["trajectory.csv: its header is not that of this trajectory"]


def test_other_systems_have_their_own_names(tmp_path: Path) -> None:
    problem = parse_problem(starter("unicycle"), None, ["output.pictures=false", "output.samples=5"])
    every = table(save_solution(planning.solve(problem), tmp_path / "plan") / "trajectory.csv")
    assert list(every)[:6] == ["t", "x", "y", "theta", "v", "w"]
    assert list(every)[-3:] == ["e_x", "e_y", "e_theta"]
    np.testing.assert_allclose(every["e_x"], every["x"] - float(problem.goal["x"]))


@given(st.lists(st.text(min_size=1), max_size=8))
def test_any_names_become_identifiers_each_once(names: list[str]) -> None:
    made = identifiers(names)
    assert len(set(made)) == len(made) == len(names)
    assert all(re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name) for name in made)
    assert identifiers(made) == made
