"""Obstacles from the file to both solvers, to verification and to what is seen."""

from __future__ import annotations

import builtins
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import nhpocp
from nhpocp.bodies import hull
from nhpocp.bodies.distance import distance
from nhpocp.bodies.obstacles import KINDS
from nhpocp.bodies.stl import convex_corners
from nhpocp.cli.entry import status
from nhpocp.problem_file import dump_problem, parse_problem, read_text
from nhpocp.problem_file.registry import SYSTEMS
from nhpocp.views import obstacles as seen
from tests.conftest import paper_problem

GALLERY = Path(__file__).parents[2] / "problems"
ROBOT = """nhpocp: 1
system: {model: three_upu, leg_radius: 1.5, thickness: 1}
start: {position: [0, 0, 25], orientation: {rpy: [0, 0, -pi/6]}}
goal: {position: [-0.4, -0.2, 35], orientation: {rpy: [0, 0, -90 deg]}}
"""
CAR = """nhpocp: 1
system: {model: car}
start: {x: 0, y: 0, theta: 0, phi: 0}
goal: {x: 0, y: 0.5, theta: 0, phi: 0}
"""
AROUND = {
    "sphere": "{centre: [8, 0, 41], radius: 3}",
    "capsule": "{from: [30, 0, 40], to: [30, 20, 40], radius: 2}",
    "box": "{centre: [25, 0, 30], size: [4, 4, 4], rpy: [0, 0, 45 deg]}",
    "half_space": "{point: [0, 0, -5], normal: [0, 0, 2]}",
    "mesh": "{points: [[0, 0, 50], [4, 0, 50], [0, 4, 50], [0, 0, 54]]}",
    "disc": "{centre: [3, 3], radius: 1}",
    "rectangle": "{centre: [3, -3], size: [1, 2], angle: 30 deg}",
    "polygon": "{corners: [[-3, 3], [-4, 3], [-4, 4]]}",
    "half_plane": "{point: [0, -5], normal: [0, 1]}",
}


def text_with(kinds):
    plane = any(KINDS[kind].dimension == 2 for kind in kinds)
    lines = "".join(f"  - {kind}: {AROUND[kind]}\n" for kind in kinds)
    return f"{CAR if plane else ROBOT}obstacles:\n{lines}constraints: {{distance: 0.1}}\n"


@pytest.mark.parametrize("numbers", [2, 3])
def test_every_kind_is_read_written_and_drawn(numbers):
    kinds = [kind for kind in KINDS if KINDS[kind].dimension == numbers]
    problem = parse_problem(text_with(kinds))
    assert [obstacle.kind for obstacle in problem.obstacles] == kinds
    again = parse_problem(dump_problem(problem.with_()))
    assert again.with_(name=problem.name) == problem.with_(name=problem.name)
    assert again.obstacles == problem.obstacles
    low, high = seen.widened(problem.system, np.full(numbers, -6.0), np.full(numbers, 6.0))
    for obstacle in problem.obstacles:
        for face in seen.faces(obstacle, np.full(numbers, -60.0), np.full(numbers, 60.0)):
            assert face.shape[1] == numbers
            np.testing.assert_allclose(face[0], face[-1])
    parts = seen.parts(problem.system, np.full(numbers, -60.0), np.full(numbers, 60.0))
    assert {part["name"] for part in parts} == {obstacle.name for obstacle in problem.obstacles}
    assert {part["values"].shape[-1] for part in parts} == {numbers}
    assert (low <= -6).all()
    assert (high >= 6).all()


@pytest.mark.parametrize(
    ("changed", "place", "words"),
    [
        ("sphere: {centre: [8, 0, 41], radius: 3}", None, None),
        ("spere: {centre: [8, 0, 41], radius: 3}", "6:5", "did you mean 'sphere'"),
        ("sphere: {center: [8, 0, 41], radius: 3}", "6:14", "did you mean 'centre'"),
        ("sphere: {centre: [8, 0], radius: 3}", "6:22", "2"),
        ("sphere: {centre: [8, 0, 41], radius: -3}", "6:42", "not positive"),
        ("sphere: {centre: [8, 0, 41]}", "6:5", "radius"),
        (
            "box: {centre: [1, 1, 1], size: [1, 1, 1], orientation: 0}",
            "6:47",
            "expected one of centre, size, rpy",
        ),
        ("half_space: {point: [0, 0, 0], normal: [0, 0, 0]}", "6:44", "zero vector"),
        ("disc: {centre: [8, 0], radius: 3}", "6:5", "in space; expected one of sphere"),
        ("mesh: {points: [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]}", "6:20", "lie in a plane"),
        ("mesh: {}", "6:5", "points"),
        ("mesh: {file: missing.stl}", "6:18", "cannot read"),
    ],
)
def test_what_is_no_obstacle_is_refused_at_its_place(changed, place, words):
    text = f"{ROBOT}obstacles:\n  - {changed}\n"
    if place is None:
        assert read_text(text, "p.yaml").problem.obstacles
        return
    with pytest.raises(nhpocp.InvalidProblemError) as refused:
        read_text(text, "p.yaml")
    assert str(refused.value).startswith(f"p.yaml:{place}: obstacles[0]"), refused.value
    assert words in str(refused.value)


@pytest.mark.parametrize(
    "written",
    [
        "obstacles: [{disc: {centre: [3, 3], radius: -1}}]",
        "obstacles: [{half_plane: {point: [3, 3], normal: [0, 0]}}]",
        "obstacles: [{disk: {centre: [3, 3], radius: 1}}]",
        "obstacles: {disc: {centre: [3, 3], radius: 1}}",
        "obstacle: [{disc: {centre: [3, 3], radius: 1}}]",
    ],
)
def test_obstacles_that_cannot_be_read_are_not_missed_by_distance(written):
    with pytest.raises(nhpocp.InvalidProblemError) as refused:
        read_text(f"{CAR}{written}\nconstraints: {{distance: 0.1, state: {{x: [9, 1]}}}}\n")
    first, second = refused.value.each
    assert first.path.startswith(written.partition(":")[0])
    assert second.path == "constraints.state.x"


PILLAR = "  - name: {}\n    capsule: {{from: [-12, -12, 20], to: [-12, 10, 26], radius: 2}}\n"


def test_an_obstacle_may_have_a_name_which_messages_say():
    unnamed = PILLAR.replace("name: {}\n    ", "").format()
    text = f"{ROBOT}obstacles:\n{PILLAR.format('pillar')}{unnamed}constraints: {{distance: 1}}\n"
    problem = parse_problem(text)
    assert [obstacle.name for obstacle in problem.obstacles] == ["pillar", "capsule 1"]
    assert "distance[leg 3, pillar]" in nhpocp.solve(problem).message
    again = parse_problem(dump_problem(problem.with_()))
    assert again.obstacles == problem.obstacles
    assert again.obstacles[0].as_data()["name"] == "pillar"
    assert "name" not in again.obstacles[1].as_data()


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("leg 1", "a body of three_upu is called so; choose a name other than base, platform, leg 1"),
        ("sphere 1", "is what an obstacle without a name is called"),
        ("'a, b'", "expected a name of letters"),
        ("3", "expected text"),
    ],
)
def test_a_name_that_would_not_tell_is_refused_at_its_place(name, words):
    with pytest.raises(nhpocp.InvalidProblemError) as refused:
        read_text(f"{ROBOT}obstacles:\n{PILLAR.format(name)}", "p.yaml")
    assert str(refused.value).startswith("p.yaml:6:11: obstacles[0].name: ")
    assert words in str(refused.value)


def test_two_obstacles_of_one_name_are_refused():
    with pytest.raises(nhpocp.InvalidProblemError, match=r"obstacles\[1\]\.name: another obstacle"):
        read_text(f"{ROBOT}obstacles:\n{2 * PILLAR.format('pillar')}")


@pytest.mark.parametrize(
    "corners",
    [
        [[0, 0], [4, 0], [4, 4], [0, 4], [0, 0]],
        [[0, 0], [4, 0], [4, 0], [4, 4], [0, 4]],
        [[0, 0], [0.1, 0.03], [0.3, 0.09], [3, 0.9], [2.1, 3.9], [-0.9, 3]],
        [[0, 4], [4, 4], [4, 2], [4, 1], [4, 0], [0, 0], [0, 0]],
    ],
)
def test_corners_given_twice_or_inside_a_side_do_no_harm(corners):
    shape = nhpocp.Obstacle("polygon", {"corners": corners}).shape
    assert len(shape.corners) == 4
    assert {tuple(corner) for corner in shape.corners} <= {tuple(corner) for corner in corners}


@pytest.mark.parametrize(
    ("corners", "words"),
    [
        ([[0, 0], [4, 0], [4, 4], [3, 1]], "not convex; write several"),
        ([[0, 0], [4, 0], [4, 4], [3, 1], [0, 0]], "not convex; write several"),
        ([[0, 0], [4, 4], [4, 0], [0, 4]], "the sides cross; write the corners in order"),
        ([[0, 0], [4, 0], [0, 4], [4, 0]], "the sides cross; write the corners in order"),
        ([[0, 3], [-2, -2], [3, 1], [-3, 1], [2, -2]], "the sides cross; write the corners in order"),
        ([[0, 0], [0.1, 0.03], [0.3, 0.09]], "the corners lie on one line"),
        ([[0, 0], [3, 0], [1, 0], [2, 0]], "the corners lie on one line"),
        ([[1, 1], [1, 1], [1, 1]], "the corners lie on one line"),
        ([[0, 0], [4, 0]], "a list of 2; expected 3 or more points"),
    ],
)
def test_what_bounds_no_convex_polygon_is_refused_with_its_cause(corners, words):
    with pytest.raises(nhpocp.InvalidProblemError, match=r"obstacles\[0\]\.polygon\.corners: ") as refused:
        read_text(f"{CAR}obstacles: [{{polygon: {{corners: {corners}}}}}]\n")
    assert words in refused.value.message
    with pytest.raises(nhpocp.InvalidProblemError, match=r"polygon\.corners: ") as refused:
        nhpocp.Obstacle("polygon", {"corners": corners})
    assert words in refused.value.message


def test_a_problem_made_anew_keeps_its_obstacles():
    """A mesh takes long to build."""
    problem = parse_problem(text_with(["mesh", "sphere"]))
    again = nhpocp.replace(problem, initial=None)
    assert all(one is other for one, other in zip(again.obstacles, problem.obstacles, strict=True))


def test_a_capsule_without_length_is_a_ball():
    point, middle = {"from": [0, 0, 1], "to": [0, 0, 1], "radius": 0.1}, {"centre": [0, 0, 1], "radius": 0.1}
    bar = hull.capsule(np.array([-5.0, 0, 0]), np.array([5.0, 0, 0]), 0.2)
    made, ball = nhpocp.Obstacle("capsule", point).shape, nhpocp.Obstacle("sphere", middle).shape
    assert float(distance(bar, made)) == float(distance(bar, ball)) == pytest.approx(0.7)


def test_obstacles_and_distances_of_a_system_without_bodies_are_refused():
    with pytest.raises(nhpocp.InvalidProblemError, match="heisenberg has no bodies"):
        nhpocp.PlanningProblem(
            system=nhpocp.Heisenberg(),
            start={"x": 0, "y": 0, "z": 0},
            goal={"z": 1},
            obstacles=[{"disc": {"centre": [3, 3], "radius": 1}}],
        )
    with pytest.raises(nhpocp.InvalidProblemError, match="name obstacles"):
        read_text(CAR + "constraints: {distance: 0.1}\n")


def tetrahedron(file, text):
    corners = np.array([[0, 0, 50], [4, 0, 50], [0, 4, 50], [0, 0, 54]], dtype="<f4")
    triangles = [corners[list(face)] for face in ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3))]
    if text:
        lines = ["".join(f"vertex {x} {y} {z}\n" for x, y, z in triangle) for triangle in triangles]
        file.write_text("solid t\n" + "".join(f"facet\nouter loop\n{each}endloop\n" for each in lines))
        return
    records = [np.zeros(3, "<f4").tobytes() + each.tobytes() + b"\0\0" for each in triangles]
    file.write_bytes(b" " * 80 + (4).to_bytes(4, "little") + b"".join(records))


@pytest.mark.parametrize("text", [True, False])
def test_a_mesh_beside_the_problem_goes_into_the_folder(tmp_path, text):
    tetrahedron(tmp_path / "part.stl", text)
    file = tmp_path / "p.yaml"
    file.write_text(
        f"{ROBOT}obstacles:\n  - mesh: {{file: part.stl}}  # a part\nconstraints: {{distance: 1}}\n"
    )
    problem = nhpocp.load_problem(file)
    assert len(problem.obstacles[0].shape.corners) == 4
    (tmp_path / "part.stl").unlink()
    again = parse_problem(problem.source)
    assert again.obstacles == problem.obstacles
    assert "# a part" in problem.source


def test_a_mesh_is_read_in_python_as_beside_a_file(tmp_path, monkeypatch):
    tetrahedron(tmp_path / "part.stl", text=True)
    (tmp_path / "p.yaml").write_text(f"{ROBOT}obstacles: [{{mesh: {{file: part.stl}}}}]\n")
    read = nhpocp.load_problem(tmp_path / "p.yaml").obstacles[0]
    problem = parse_problem(ROBOT)
    for name in (tmp_path / "part.stl", str(tmp_path / "part.stl")):
        obstacle = nhpocp.Obstacle("mesh", {"file": name})
        (made,) = problem.with_(obstacles=[{"mesh": {"file": name}}]).obstacles
        assert made.entries == obstacle.entries
        assert made.entries["points"] == read.entries["points"]
    monkeypatch.chdir(tmp_path)
    near = problem.with_(obstacles=[nhpocp.Obstacle("mesh", {"file": "part.stl"})])
    (tmp_path / "part.stl").unlink()
    assert near.obstacles == (read,) == parse_problem(dump_problem(near)).obstacles
    with pytest.raises(
        nhpocp.InvalidProblemError, match=r"obstacles\[0\]\.mesh\.file: cannot read part\.stl"
    ):
        problem.with_(obstacles=[{"mesh": {"file": "part.stl"}}])
    with pytest.raises(nhpocp.InvalidProblemError, match=r"mesh\.file: expected the name of an STL file"):
        nhpocp.Obstacle("mesh", {"file": 3})


def no_body(name):
    """Triangles: of a body with a dent, or of one with too many corners."""
    if name == "dent":
        corners = np.array([[0, 0, 0], [4, 0, 0], [0, 4, 0], [0, 0, 4], [1, 1, 1]], dtype=float)
        return [
            corners[list(face)] for face in ((0, 1, 2), (0, 1, 3), (0, 2, 3), (4, 1, 2), (4, 1, 3), (4, 2, 3))
        ]
    points = np.random.default_rng(1).normal(size=(9000, 3))
    return (points / np.linalg.norm(points, axis=1, keepdims=True)).reshape(-1, 3, 3)


@pytest.mark.parametrize(("name", "words"), [("dent", "the mesh is not convex"), ("ball", "9000 corners")])
def test_a_mesh_that_is_no_obstacle_is_refused_with_its_file(name, words, tmp_path):
    lines = [f"vertex {' '.join(map(str, corner))}\n" for triangle in no_body(name) for corner in triangle]
    (tmp_path / f"{name}.stl").write_text("".join(lines))
    file = tmp_path / "p.yaml"
    file.write_text(f"{ROBOT}obstacles: [{{mesh: {{file: {name}.stl}}}}]\n")
    with pytest.raises(nhpocp.InvalidProblemError, match=rf"mesh\.file: .*{name}\.stl: .*{words}"):
        nhpocp.load_problem(file)
    with pytest.raises(nhpocp.InvalidProblemError, match=rf"mesh\.file: .*{name}\.stl: .*{words}"):
        nhpocp.Obstacle("mesh", {"file": tmp_path / f"{name}.stl"})


def test_a_mesh_may_be_finer_than_its_shape(tmp_path):
    """A turned tetrahedron, each of whose faces is four triangles, with the digits that text files have."""
    file = tmp_path / "fine.stl"
    for seed in range(6):
        corners = 10 * np.eye(4, 3) @ Rotation.random(random_state=seed).as_matrix()
        lines = ""
        for a, b, c in (corners[list(face)] for face in ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3))):
            d, e, f = (a + b) / 2, (b + c) / 2, (c + a) / 2
            for place in (a, d, f, d, b, e, f, e, c, d, e, f):
                lines += f"vertex {place[0]:.9e} {place[1]:.9e} {place[2]:.9e}\n"
        file.write_text(lines)
        np.testing.assert_allclose(sorted(convex_corners(file).tolist()), sorted(corners.tolist()), atol=1e-8)


@pytest.mark.parametrize("count", [65, 400, 2000])
def test_a_mesh_of_too_many_corners_is_refused_before_it_is_built(tmp_path, count, monkeypatch):
    monkeypatch.setattr(hull, "_around", None)  # orders the corners of each face
    points = np.random.default_rng(1).normal(size=(count, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    with pytest.raises(
        nhpocp.InvalidProblemError, match=rf"mesh\.points: the convex hull has {count} corners; at most 64"
    ):
        nhpocp.Obstacle("mesh", {"points": points})
    around = [points[[k, (k + 1) % count, (k + 2) % count]] for k in range(count)]
    lines = "".join(f"vertex {x} {y} {z}\n" for triangle in around for x, y, z in triangle)
    (tmp_path / "fine.stl").write_text(lines)
    with pytest.raises(nhpocp.InvalidProblemError, match=rf"fine\.stl: .* has {count} corners; at most 64"):
        convex_corners(tmp_path / "fine.stl")


@pytest.mark.parametrize("model", SYSTEMS.lines)
def test_bodies_have_one_dimension_and_touch_only_each_other(model):
    system = SYSTEMS[model]()
    if not system.has_bodies:
        assert system.among(()).surroundings.pairs == ()
        return
    bodies = system.bodies_somewhere()
    assert {len(corner) for body in bodies.values() for corner in body.corners} == {
        system.dimension_of_bodies
    }
    for pair in system.among(()).surroundings.pairs:
        assert set(pair) <= set(bodies)


def test_the_robot_s_legs_touch_their_plates_and_no_other_pair_does():
    robot = nhpocp.ThreeUPU(leg_radius=1.5).among(())
    assert robot.surroundings.pairs == (
        ("base", "platform"),
        ("leg 1", "leg 2"),
        ("leg 1", "leg 3"),
        ("leg 2", "leg 3"),
    )
    assert robot.with_(form="original").surroundings == robot.surroundings
    assert robot.among(None).surroundings is None


@pytest.mark.parametrize(
    ("obstacles", "bound", "words"),
    [
        ([], nhpocp.Bound("distance", "distance", 0.1), "name obstacles"),
        (
            [{"disc": {"centre": [1, 1], "radius": 0.2}}],
            nhpocp.Bound("distance", "distance", 0.1, 5),
            "below alone",
        ),
    ],
)
def test_bounds_on_distances_that_say_nothing_are_refused(obstacles, bound, words):
    start = {"x": 0, "y": 0, "theta": 0}
    with pytest.raises(nhpocp.InvalidProblemError, match=words):
        nhpocp.PlanningProblem(
            system=nhpocp.Unicycle(), start=start, goal={"x": 1}, obstacles=obstacles, bounds=[bound]
        )


def test_a_pose_in_collision_is_named_before_the_solve():
    problem = parse_problem(
        f"{ROBOT}obstacles: [{{capsule: {{from: [-12, -12, 20], to: [-12, 10, 26], radius: 2}}}}]\n"
        "constraints: {distance: 1}\n"
    )
    solution = nhpocp.solve(problem)
    assert solution.outcome.value == "infeasible"
    assert "the start itself breaks distance[leg 3, capsule 1]" in solution.message


LEGS_CROSS = {  # of the plan that minds no distance legs 2 and 3 overlap on the way
    "position": [-0.334619, 14.660861, 34.244102],
    "orientation": {
        "matrix": [
            [-0.55719617, 0.80941557, 0.18541537],
            [-0.63130776, -0.55797254, 0.53862524],
            [0.53942835, 0.18306576, 0.8218905],
        ]
    },
}


def test_legs_that_would_collide_on_the_way_are_led_around_each_other():
    robot = nhpocp.ThreeUPU(leg_radius=1.5)
    start = {"position": [0, 0, 25], "orientation": {"rpy": [0, 0, -np.pi / 6]}}
    free = nhpocp.PlanningProblem(system=robot, start=start, goal=LEGS_CROSS, pictures=False)
    plan = nhpocp.solve(free)
    assert plan.converged
    bounded = free.with_(bounds={"distance": 0.5})
    blind = nhpocp.verify(replace(plan, problem=bounded))
    assert not blind.ok
    assert "distance[leg 2, leg 3]" in " ".join(blind.reasons)
    solution = nhpocp.solve(bounded)
    assert solution.converged, solution.message
    assert solution.trajectory["distance"].min() > 0.4995


@pytest.fixture(scope="module")
def parked():
    problem = nhpocp.load_problem(GALLERY / "parallel_parking.yaml")
    return nhpocp.solve(problem.with_(pictures=False))


def test_without_the_library_a_second_formula_measures_and_is_named(parked, monkeypatch):
    assert parked.converged
    assert parked.verdict.method.endswith(
        "distances by python-fcl, those from half spaces by the heights of corners"
    )
    (report,) = [report for report in parked.verdict.bounds if report.bound.label == "distance"]
    imported = builtins.__import__

    def without(name, *more, **named):
        if name == "fcl":
            raise ImportError
        return imported(name, *more, **named)

    monkeypatch.setattr(builtins, "__import__", without)
    verdict = nhpocp.verify(parked)
    (again,) = [each for each in verdict.bounds if each.bound.label == "distance"]
    assert 'pip install "nhpocp[distances]"' in verdict.method
    assert verdict.ok
    assert again.name == report.name
    assert again.value == pytest.approx(report.value, abs=1e-12)


def test_what_is_passed_between_the_samples_is_seen(monkeypatch):
    """A body that flies past a thin wall's corner within one interval of samples."""
    from nhpocp.verification.distances import Distances

    car = nhpocp.Unicycle().among(
        nhpocp.PlanningProblem(
            system=nhpocp.Unicycle(),
            start={"x": 0, "y": 0, "theta": 0},
            goal={"x": 9},
            obstacles=[{"disc": {"centre": [5, 0.4], "radius": 0.2}}],
        ).obstacles
    )

    def path(times):
        return np.c_[10 * np.asarray(times), np.zeros((len(times), 2))]

    times = np.array([0.0, 0.3, 0.8, 1.0])  # far away at each of them
    distances = Distances(car, car.surroundings)
    assert distances.measure(distances.corners(path(times)), 0).min() > 1
    more, values, bounded = distances.along(path, times, np.array([0.2]))
    assert bounded
    assert len(more) > len(times)
    assert values.min() == pytest.approx(0.1, abs=0.02)


def test_verification_and_trajectories_tell_one_depth():
    """A unicycle that drives straight through a wall, and is deepest when its middle is in the wall's."""
    from nhpocp.verification.distances import Distances

    problem = nhpocp.PlanningProblem(
        system=nhpocp.Unicycle(width=0.4),
        start={"x": 0, "y": 0, "theta": 0},
        goal={"x": 3},
        obstacles=[{"rectangle": {"centre": [1.5, 0], "size": [0.2, 2]}}],
        bounds={"distance": 0.1},
    )
    motion = nhpocp.simulate(problem, np.array([[3.0, 0, 0, 0, 0], np.zeros(5)]))
    system = problem.system
    states = np.c_[motion.trajectory["x"], np.zeros((len(motion.trajectory["x"]), 2))]
    distances = Distances(system, system.surroundings)
    measured = distances.measure(distances.corners(states), 0)
    np.testing.assert_allclose(measured, motion.trajectory["distance"], atol=1e-9)
    assert measured.min() == pytest.approx(-0.5 * (1.9 * 0.4 + 0.2), abs=0.02)  # half of both lengths is out


def test_a_folder_shows_its_distances(parked, tmp_path, capsys):
    folder = nhpocp.save_solution(parked, tmp_path / "plan")
    again = nhpocp.load_solution(folder)
    assert again.problem.obstacles == parked.problem.obstacles
    assert status(["verify", str(folder), "--json"]) == 0
    assert status(["plot", str(folder), "--format", "png"]) == 0
    capsys.readouterr()
    assert (folder / "distances.png").stat().st_size > 5000
    stored = json.loads((folder / "solution.json").read_text())
    report = stored["constraints"]["distance"]
    assert report["ok"]
    meanings = (folder / "columns.csv").read_text()
    assert report["name"].startswith("distance[car, ")
    assert (
        f'distance_{report["component"][0] + 1},length,distance[{report["component"][0]}],"{report["name"]}"'
        in meanings
    )
    header = (folder / "trajectory.csv").read_text().partition("\n")[0].split(",")
    assert [name for name in header if name.startswith("distance")] == [f"distance_{k}" for k in (1, 2, 3)]


@pytest.mark.parametrize("solver", ["jacobian", "nlp"])
def test_the_cone_of_each_leg_is_kept_from_its_direction_at_the_start(solver):
    free = paper_problem(pictures=False)
    limit = np.radians(8)
    problem = free.with_(bounds={"joint_angle": {"cone": {"max": limit}}})
    made = nhpocp.MultipleShooting(intervals=20) if solver == "nlp" else nhpocp.Continuation()
    solution = nhpocp.solve(problem, made)
    assert solution.converged, solution.message
    cones = solution.trajectory["joint_cones"]
    np.testing.assert_allclose(cones[0], 0, atol=1e-12)
    assert cones.max() <= limit * 1.001
    if solver == "jacobian":  # without the bound its plan goes to 9.28°
        loose = free.with_(bounds={"joint_angle": {"cone": {"max": 1}}})
        assert nhpocp.solve(loose, made).trajectory["joint_cones"].max() > 1.1 * limit
    first, last = (
        np.array([pose.g for pose in problem.system.leg_poses(point)])
        for point in (problem.start_point, problem.goal_point)
    )
    np.testing.assert_allclose(cones[-1], np.arccos((first * last).sum(axis=1)), atol=1e-3)
