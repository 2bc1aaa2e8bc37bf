"""The machine: built of where joints are, it ends where plans do, and misses where it should."""

from __future__ import annotations

import csv
import json
import shutil
import signal
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

import nhpocp
from nhpocp import so3
from nhpocp.cli.entry import status
from nhpocp.machine.simulation import Machine, MachineSettings, Simulation, build, play, playing
from nhpocp.simulation_folder import save_simulation
from nhpocp.solution import Solution
from nhpocp.solution_folder import save_solution
from nhpocp.solution_folder.target import require_replaceable
from nhpocp.systems.parallel_robot import ParallelRobot
from nhpocp.views import simulation_figures
from tests.conftest import paper_problem
from tests.machine.conftest import PROBLEMS
from tests.machine.conftest import plan as library_plan

pytest.importorskip("mujoco")
SECONDS = 2.0  # of a play: driftless plans may be played at any speed


@pytest.fixture(scope="module")
def plan() -> Solution:
    return nhpocp.solve(paper_problem())


@pytest.fixture(scope="module")
def played(plan: Solution) -> Simulation:
    return play(plan, duration=SECONDS)


def off(simulation: Simulation) -> tuple[float, float]:
    return simulation.position_error, np.degrees(simulation.angle_error)


def test_the_machine_ends_where_the_plan_does(played: Simulation) -> None:
    position, angle = off(played)
    assert position < 5e-3
    assert angle < 5e-3
    assert played.reached
    assert 0.01 < played.worst_following[0] < 0.5  # servos lag behind while they move
    assert played.slip < 1e-2
    assert np.abs(played.trajectory["normal_force"] - 50.0).max() < 5.0
    # it is the pose that reaches the goal, not a copy of the plan's
    goal = played.solution.problem.goal
    assert np.linalg.norm(played.trajectory["position"][-1] - goal["position"]) < 5e-3


def test_without_friction_nothing_holds_the_platform(plan: Solution, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(playing, "LONGEST_SETTLING", 0.5)  # it would swing for long
    slippery = play(plan, MachineSettings(friction=1e-4), duration=SECONDS)
    assert slippery.position_error > 0.1
    assert slippery.slip > 0.1


def test_a_plan_with_another_length_of_one_leg_is_seen_to_miss(plan: Solution) -> None:
    path = dict(plan.trajectory)
    lengths = np.array(path["leg_lengths"])
    lengths[:, 0] = lengths[0, 0] + 1.01 * (lengths[:, 0] - lengths[0, 0])
    missed = play(replace(plan, trajectory={**path, "leg_lengths": lengths}), duration=SECONDS)
    assert not missed.reached
    assert missed.position_error > 5 * missed.tolerance


def test_a_machine_that_differs_from_the_model_misses_by_as_much_as_measured(plan: Solution) -> None:
    # measured with another model of this machine, played slowly: 1.16 units and 5.1°
    wrong = play(plan, MachineSettings(errors="roller_tilt=2deg"), duration=2.0)
    assert off(wrong) == pytest.approx((1.16, 5.1), rel=0.03)


def test_payload_bends_more_and_motors_carry_what_virtual_work_says(plan: Solution) -> None:
    still = {
        "position": np.array([0.0, 0.0, 25.0]),
        "orientation": so3.from_rpy(np.array([0, 0, -np.pi / 6])),
    }
    sags, held = [], []
    for settings in (MachineSettings(gravity=9.81), MachineSettings(gravity=9.81, payload=2.0)):
        machine = Machine(plan.problem.system, still, settings)
        machine.settle()
        sags.append(25.0 - machine.measure()["position"][2])
        held.append(machine.motor_forces())
    # virtual work: what the motors push is what (3) makes of their speeds, seen from the other side
    state = np.concatenate([still["position"], still["orientation"].ravel()])
    rising = [
        float(plan.problem.system.with_(form="original").velocity(state, axis)[2]) for axis in np.eye(3)
    ]
    assert held[1] - held[0] == pytest.approx(2.0 * 9.81 * np.array(rising), rel=0.01)
    assert 1e-3 < sags[0] < sags[1] < 0.1


def pinned(**joint: Any) -> ParallelRobot:
    """A platform whose middle a base joint holds, on two motors between ball joints."""
    driven = [
        {"base": [30 * c, 30 * s, 0], "platform": [15 * c, 15 * s, 2], "base_joint": "spherical"}
        for c, s in ((1.0, 0.0), (-0.5, 0.87))
    ]
    return ParallelRobot(legs=[{"base": [0, 0, 25], "platform": [0, 0, 0], "length": 0, **joint}, *driven])


@pytest.mark.parametrize(
    "robot",
    [
        *(ParallelRobot.preset(preset) for preset in ("mixed", "braced", "translational")),
        pinned(base_joint="veselova", r=[0, 0, 1]),
        pinned(base_joint="suslov", r=[0, 0, 1]),
        pinned(base_joint="universal", w1=[1, 0, 0], w2=[0, 1, 0]),
    ],
    ids=["mixed", "braced", "translational", "veselova", "suslov", "universal"],
)
def test_every_kind_of_leg_holds_its_length_and_its_joint(robot: ParallelRobot) -> None:
    start = {"position": np.array([0.0, 0.0, 25.0]), "orientation": np.eye(3)}
    machine = Machine(robot, start)
    built = machine.built
    assert len(built.motors) == robot.motors
    assert len(built.rollers) == sum(leg.joint in ("veselova", "suslov") for leg in robot.legs)
    longer = built.lengths.copy()
    longer[0] += 0.3
    for share in np.linspace(0, 1, 50):
        machine.command(built.lengths + share * (longer - built.lengths))
        machine.advance(0.01)
    machine.settle()
    pose = machine.pose()
    legs = [leg.pose(pose["position"], pose["orientation"]) for leg in robot.legs]
    wanted = iter(longer)
    for leg, now in zip(robot.legs, legs, strict=True):
        before = leg.pose(start["position"], start["orientation"])
        length = next(wanted) if leg.actuated else before.length
        assert now.length == pytest.approx(length, abs=2e-3)
        if leg.joint == "universal" and not leg.pinned:
            assert float(leg.base_joint.invariant(now.g, now.w3)) == pytest.approx(0.0, abs=1e-4)
    # [G K; S J] says where that leads, to first order
    state = np.concatenate([start["position"], start["orientation"].ravel()])
    control = np.r_[0.3, np.zeros(robot.motors - 1)]
    moved = np.asarray(robot.velocity(state, control), dtype=float).ravel()
    assert (
        np.linalg.norm(pose["position"] - start["position"] - moved[:3])
        < 0.1 * np.linalg.norm(moved[:3]) + 1e-2
    )
    assert np.linalg.norm(so3.log(pose["orientation"]) - moved[3:]) < 0.1 * np.linalg.norm(moved[3:]) + 1e-2


def test_latency_noise_and_seed_are_those_asked_for(plan: Solution) -> None:
    start = {name: plan.problem.start[name] for name in ("position", "orientation")}
    settings = MachineSettings(noise=(0.01, 0.001), latency=0.1, seed=3)
    one, other = (Machine(plan.problem.system, start, settings) for _ in range(2))
    seen = np.array([one.measure()["position"] - start["position"] for _ in range(400)])
    assert seen.std() == pytest.approx(0.01, rel=0.1)
    assert np.array_equal(other.measure()["position"] - start["position"], seen[0])
    one.command(one.built.lengths)  # the first names where the legs are
    one.command(one.built.lengths + 0.5)
    assert not one.at_rest  # something is under way
    one.advance(0.09)
    assert np.abs(one.leg_lengths() - one.built.lengths).max() < 1e-6
    one.advance(0.2)
    assert one.leg_lengths() == pytest.approx(one.built.lengths + 0.5, abs=1e-2)
    other.command(np.array([1.0, 2.0, 3.0]))
    other.settle()
    assert np.linalg.norm(other.pose()["position"] - start["position"]) < 1e-6
    assert other.leg_lengths() == pytest.approx([1.0, 2.0, 3.0], abs=1e-5)
    one.home(np.array([1.0, 2.0, 3.0]))
    assert one.leg_lengths() == pytest.approx([1.0, 2.0, 3.0], abs=1e-2)
    one.settle()
    assert one.leg_lengths() == pytest.approx([1.0, 2.0, 3.0], abs=1e-5)


def test_what_cannot_be_built_is_refused_in_words(plan: Solution) -> None:
    with pytest.raises(nhpocp.InvalidProblemError, match="did you mean 'roller_tilt'"):
        play(plan, MachineSettings(errors="rollr_tilt=0.1"), duration=1.0)
    start = {name: plan.problem.start[name] for name in ("position", "orientation")}
    with pytest.raises(nhpocp.InvalidProblemError, match="heisenberg cannot be built"):
        Machine(nhpocp.Heisenberg(), start)
    with pytest.raises(nhpocp.InvalidProblemError, match=r"press.*> 0"):
        MachineSettings(press=0.0)
    with pytest.raises(nhpocp.InvalidProblemError, match="expected 3 finite leg lengths"):
        Machine(plan.problem.system, start).command(np.zeros(2))


def test_what_breaks_apart_says_so_and_leaves_no_file(
    plan: Solution, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    broken = play(plan, MachineSettings(stiffness=1e12), duration=SECONDS)
    assert "broke apart" in broken.failure
    assert broken.outcome == "broken"
    assert not broken.reached
    assert not list(tmp_path.iterdir())  # MuJoCo would log its warnings here


def test_a_stop_by_hand_keeps_what_was_measured(
    stored: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    folder, advance = Path(shutil.copytree(stored, tmp_path / "copy")), Machine.advance

    def pressed(machine: Machine, seconds: float) -> None:
        advance(machine, seconds)
        if 0.5 < machine.time < 0.503:
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(Machine, "advance", pressed)
    assert status(["simulate", str(folder), "--duration", "2", "--json"]) == 1
    data = json.loads(capsys.readouterr().out)
    assert (data["outcome"], data["reached"]) == ("interrupted", False)
    assert "Stopped by hand after 0.5" in data["failure"]
    with np.load(folder / "simulation" / "simulation.npz") as arrays:
        assert 0.3 < arrays["t"][-1] < 0.5
        assert all(np.isfinite(values).all() and len(values) > 50 for values in arrays.values())


@pytest.fixture(scope="module")
def rolled() -> Solution:
    return nhpocp.solve(nhpocp.load_problem(PROBLEMS / "rolling_sphere.yaml"))


def test_a_ball_rolls_on_its_contact_as_the_plan_says(rolled: Solution, tmp_path: Path) -> None:
    played = play(rolled, duration=SECONDS)
    position, angle = off(played)
    assert position < 1e-6
    assert angle < 0.1
    goal = rolled.problem.goal["orientation"]
    assert np.degrees(so3.angle(played.trajectory["orientation"][-1] @ np.asarray(goal).T)) < 0.1
    folder = save_solution(rolled, tmp_path / "ball")
    save_simulation(played, folder)
    header = (folder / "simulation" / "simulation.csv").read_text(encoding="utf-8").splitlines()[0]
    assert {"centre_x", "planned_centre_y", "motor_force_x", "slip_1", "position_2"} <= set(header.split(","))
    slippery = play(rolled, MachineSettings(friction=1e-4), duration=SECONDS)
    assert off(slippery)[1] > 10
    assert slippery.slip > 100 * played.slip
    other = play(rolled, MachineSettings(errors="radius=1%"), duration=SECONDS)
    # the area that is rolled round goes by the square of the radius: 2 % of 90°
    assert off(other)[1] == pytest.approx(1.6, abs=0.3)


def test_what_spins_as_it_likes_is_refused(rolled: Solution) -> None:
    marble = nhpocp.RollingSphere(contact="marble")
    with pytest.raises(nhpocp.InvalidProblemError, match="nothing drives its spin"):
        Machine(marble, rolled.problem.start)


def test_nothing_of_the_equations_is_in_the_machine(plan: Solution, monkeypatch: pytest.MonkeyPatch) -> None:
    def none(*_: Any) -> Any:
        raise AssertionError("the machine asked for the equations")

    for name in ("kinematics", "velocity", "rows", "translation", "constraint_rows", "actuator_rows"):
        monkeypatch.setattr(type(plan.problem.system), name, none)
    start = {name: plan.problem.start[name] for name in ("position", "orientation")}
    text = build(plan.problem.system, start["position"], start["orientation"], MachineSettings()).text
    assert len(ElementTree.fromstring(text).findall("contact/pair")) == 3


# --- the verb ---------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def stored(plan: Solution, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_solution(plan, tmp_path_factory.mktemp("simulate") / "paper")


def test_the_verb_writes_a_folder_that_may_be_replaced(stored: Path, tmp_path: Path, capsys: Any) -> None:
    folder, model = Path(shutil.copytree(stored, tmp_path / "copy")), tmp_path / "machine.xml"
    assert status(["simulate", str(folder), "--duration", "2", "--mjcf", str(model), "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert {"folder", "position_error", "angle_error", "slip", "duration"} <= set(data)
    inside = folder / "simulation"
    assert data["folder"] == str(inside)
    names = {"simulation.json", "simulation.csv", "simulation.npz", "simulation.png", "simulation.svg"}
    names |= {"animation.html"}
    assert {file.name for file in inside.iterdir()} == names
    assert json.loads((inside / "simulation.json").read_text(encoding="utf-8"))["schema_version"] == 1
    with (inside / "simulation.csv").open(newline="", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    with np.load(inside / "simulation.npz") as arrays:
        assert [float(row["slip_rate_2"]) for row in rows] == arrays["slip_rate"][:, 1].tolist()
        assert float(rows[-1]["position_error"]) == data["position_error"]
    assert ElementTree.parse(model).getroot().tag == "mujoco"
    assert status(["export", str(folder), "--format", "mjcf"]) == 0
    assert (folder / "machine.xml").read_bytes() == model.read_bytes()
    require_replaceable(folder, folder)
    (inside / "mine.txt").write_text("mine", encoding="utf-8")
    with pytest.raises(nhpocp.InvalidProblemError, match="simulation"):
        require_replaceable(folder, folder)


def test_the_exported_machine_stands_as_the_plan_starts(stored: Path, tmp_path: Path, capsys: Any) -> None:
    import mujoco

    file = tmp_path / "robot.xml"
    assert status(["export", str(stored), "--format", "mjcf", "-o", str(file), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"file": str(file), "format": "mjcf"}
    model = mujoco.MjModel.from_xml_path(str(file))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    start, metres = nhpocp.load_solution(stored).problem.start, 0.01  # 15 units are 15 cm
    platform = model.body("platform").id
    assert data.xpos[platform] == pytest.approx(metres * np.asarray(start["position"]))
    assert data.xmat[platform].reshape(3, 3) == pytest.approx(np.asarray(start["orientation"]))
    assert {f"length {i}" for i in (1, 2, 3)} <= {model.actuator(i).name for i in range(model.nu)}
    assert model.npair == 3  # rollers on balls
    assert np.abs(data.efc_pos[: data.ne]).max() < 1e-9  # the legs meet the platform


def test_mjcf_needs_a_robot_and_no_engine(
    stored: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    assert status(["export", str(stored), "--format", "mjcf", "-o", str(tmp_path / "a.xml")]) == 0
    assert (tmp_path / "a.xml").read_text(encoding="utf-8").startswith("<mujoco")
    car = save_solution(library_plan("car"), tmp_path / "car")
    refusals = [
        ([str(car)], "car cannot be built; expected a robot on legs"),
        ([str(stored), "--rate", "5"], "--rate: an option of a motion, which mjcf is not"),
        ([str(stored), "--set", "name=a"], "--set: changes a problem FILE"),
        ([str(stored / "problem.yaml")], "mjcf is a format of a solution folder"),
        ([str(stored), "-o", str(stored / "solution.json")], "a file of the solution itself"),
    ]
    for words, said in refusals:
        assert status(["export", *words, "--format", "mjcf"]) == 2
        assert said in capsys.readouterr().err


def test_the_verb_says_that_the_machine_missed(
    stored: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.setattr(simulation_figures, "write_simulation_pictures", lambda *_: None)
    folder = Path(shutil.copytree(stored, tmp_path / "copy"))
    asked = ["--duration", "2", "--error", "roller_tilt=2deg,base_radius=1%", "--gravity", "9.81"]
    assert status(["simulate", str(folder), *asked]) == 1
    assert "missed the plan's end" in capsys.readouterr().out
    page = (folder / "simulation" / "animation.html").read_text(encoding="utf-8")
    (run,) = json.loads(page.split('type="application/json">')[1].split("</script>")[0])["runs"]
    with np.load(folder / "simulation" / "simulation.npz") as arrays:
        measured, planned = arrays["position"], arrays["planned_position"]
        assert run["times"][-1] == arrays["t"][-1]
    values = {part["name"]: np.array(part["values"]) for part in run["parts"] if len(part["values"]) > 1}
    for name, path in (("platform", measured), ("planned platform", planned)):
        middle = values[name][-1, :3].mean(axis=0)  # of the three joints
        assert middle == pytest.approx(path[-1], abs=1e-3)
    data = json.loads((folder / "simulation" / "simulation.json").read_text(encoding="utf-8"))
    assert data["machine"]["errors"] == "roller_tilt=2deg,base_radius=1%"


@pytest.mark.parametrize(
    ("option", "value", "words"),
    [
        ("--error", "roller_tilt", "NAME=AMOUNT"),
        ("--error", "roller_tilt=2 grad", "only deg is"),
        ("--error", "base_radus=1%", "did you mean 'base_radius'?"),
        ("--noise", "1%", "0.1 or 2deg"),
        ("--duration", "0", "0.01 to 3600 s"),
        ("--tolerance", "0", "> 0"),
        ("--friction", "-1", "> 0"),
    ],
)
def test_what_is_none_is_refused(stored: Path, option: str, value: str, words: str, capsys: Any) -> None:
    assert status(["simulate", str(stored), option, value]) == 2
    assert words in capsys.readouterr().err.replace("\n", " ")
    assert not (stored / "simulation").exists()


def test_a_comparison_asks_the_machine(tmp_path: Path, capsys: Any, undrawn: None) -> None:
    home, alone = tmp_path / "out", ["--only", "--variant", "jacobian:gamma=1"]
    asked = [
        str(PROBLEMS / "paper.yaml"),
        str(PROBLEMS / "unicycle.yaml"),
        *alone,
        "--set",
        "output.pictures=false",
    ]
    assert status(["compare", *asked, "--physics", "-o", str(home), "--json"]) == 0
    robot, cart = json.loads(capsys.readouterr().out)["runs"]
    assert robot["physics_outcome"] == "reached"
    assert 0 < robot["physics_position_error"] < 5e-3
    assert cart["physics_outcome"] is None  # it has no bodies
    assert "On a machine in a physics engine" in (home / "report.html").read_text(encoding="utf-8")
    again = tmp_path / "again"
    assert status(["compare", "--from", str(home), "-o", str(again), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["runs"][0]["physics_slip"] == robot["physics_slip"]


def test_without_mujoco_the_line_that_brings_it_is_told(
    stored: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "mujoco", None)
    paper = str(PROBLEMS / "paper.yaml")
    asked = (
        ["simulate", str(stored)],
        ["compare", paper, "--physics"],
        ["steer", paper, "--machine", "physics"],
    )
    for arguments in asked:
        assert (
            status([*arguments, *([] if arguments[0] == "simulate" else ["-o", str(tmp_path / "out")])]) == 3
        )
        assert 'pip install "nhpocp[physics]"' in capsys.readouterr().err
