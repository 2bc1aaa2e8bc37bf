"""The verb `steer`: what it says, writes and ends with."""

import csv
import json

import pytest

import nhpocp
from nhpocp.cli.entry import status
from tests.conftest import paper_problem
from tests.machine.conftest import PROBLEMS
from tests.machine.test_steering import AROUND, CART

ROBOT = nhpocp.dump_problem(paper_problem().with_(pictures=False))


@pytest.fixture
def robot(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "robot.yaml").write_text(ROBOT, encoding="utf-8")
    return tmp_path


def said(arguments, capsys):
    ended = status(arguments)
    out, err = capsys.readouterr()
    return ended, out, err


def test_one_machine(robot, capsys):
    wrong = ["--error", "roller_tilt=2deg,base_radius=1%"]
    ended, out, _ = said(["steer", "robot.yaml", *wrong, "-o", "out", "--json"], capsys)
    answer = json.loads(out)
    assert ended == 0
    assert answer["outcome"] == "reached"
    assert answer["folder"] == "out"
    cycles = answer["cycles"]
    assert cycles[0]["plan_s"] is None
    assert {"position_error", "angle_error", "plan_s"} <= set(cycles[1])
    stored = json.loads((robot / "out" / "steer.json").read_text(encoding="utf-8"))
    assert stored["schema_version"] == 1
    assert stored["plant"]["wrong"]["base_radius"] == pytest.approx(1.01 * 30)
    with (robot / "out" / "steer.csv").open(newline="", encoding="utf-8") as table:
        rows = list(csv.DictReader(table))
    assert [float(row["error"]) for row in rows] == [cycle["error"] for cycle in cycles]
    plans = [nhpocp.load_solution(robot / "out" / row["folder"]) for row in stored["cycles"][1:]]
    assert all(plan.converged for plan in plans)
    # a second steering, of fewer cycles, leaves nothing of the first
    ended, out, _ = said(["steer", "robot.yaml", *wrong, "--cycles", "1", "-o", "out"], capsys)
    assert ended == 1
    assert "cycle_limit" in out
    assert sorted(path.name for path in (robot / "out").iterdir()) == ["cycle_1", "steer.csv", "steer.json"]


def test_many_machines(robot, capsys):
    ended, out, _ = said(["steer", "robot.yaml", "--runs", "2", "--noise", "1e-4", "-o", "out"], capsys)
    assert ended == 0
    assert "2 of 2 machines reached the goal" in out
    assert "roller_tilt 2 deg" in out
    stored = json.loads((robot / "out" / "steer.json").read_text(encoding="utf-8"))
    table = stored["table"]["position_error"]
    assert table["with"][-1] < 5e-3 < table["without"][-1]
    with (robot / "out" / "steer.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["outcome"] for row in rows] == ["reached", "reached"]
    assert float(rows[0]["base_radius"]) == stored["machines"][0]["wrong"]["base_radius"]


def test_a_machine_of_bodies_and_contacts(robot, capsys):
    pytest.importorskip("mujoco")
    asked = ["--machine", "physics", "--gravity", "9.81", "--error", "roller_tilt=2deg,base_radius=1%"]
    asked += ["--duration", "1", "--cycles", "4", "--set", "solvers.jacobian.objective=effort", "-o", "out"]
    ended, out, _ = said(["steer", "robot.yaml", *asked, "--json"], capsys)
    cycles = json.loads(out)["cycles"]
    assert ended == 0
    # measured with another model of this machine: 1.32, 0.099, 5.4e-3, 3.6e-4 units
    found = [cycle["position_error"] for cycle in cycles[1:]]
    assert found[0] == pytest.approx(1.32, rel=0.05)
    assert len(found) == 4
    assert found[3] < 1e-3
    plant = json.loads((robot / "out" / "steer.json").read_text(encoding="utf-8"))["plant"]
    assert (plant["kind"], plant["gravity"]) == ("physics", 9.81)


def test_many_machines_of_bodies_and_contacts_corrected_under_way(robot, capsys):
    pytest.importorskip("mujoco")
    asked = ["--machine", "physics", "--gravity", "9.81", "--runs", "1", "--noise", "1e-4", "--duration", "1"]
    asked += ["--rate", "10", "--cycles", "1", "--tolerance", "0.05", "-o", "out", "--json"]
    ended, out, _ = said(["steer", "robot.yaml", *asked], capsys)
    table = json.loads(out)["table"]["error"]
    assert ended == 0
    assert 10 * table["with"][-1] < table["without"][-1]


def test_a_machine_that_breaks_ends_it_and_keeps_what_was_measured(robot, capsys):
    pytest.importorskip("mujoco")
    asked = ["--machine", "physics", "--servo", "1e12", "--duration", "1", "-o", "out", "--json"]
    ended, out, _ = said(["steer", "robot.yaml", *asked], capsys)
    answer = json.loads(out)
    assert ended == 1
    assert answer["outcome"] == "interrupted"
    assert "broke apart" in answer["message"]
    assert (robot / "out" / "steer.json").exists()


def test_pictures_of_a_cart(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cart.yaml").write_text(nhpocp.dump_problem(CART), encoding="utf-8")
    ended, _, err = said(["steer", "cart.yaml", "--error", "v=3%", "-o", "out"], capsys)
    assert (ended, err) == (0, "")
    for kind in ("png", "svg"):
        assert (tmp_path / "out" / f"steering.{kind}").stat().st_size > 5000


@pytest.fixture
def around(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "around.yaml").write_text(nhpocp.dump_problem(AROUND), encoding="utf-8")
    return tmp_path / "out"


def test_bounds_that_the_machine_broke_on_its_way_are_told(around, capsys):
    asked = ["steer", "around.yaml", "--error", "v=-20%", "--tolerance", "0.2", "-o", "out"]
    asked += ["--set", "output.pictures=false"]
    ended, out, err = said(asked, capsys)
    assert (ended, err) == (0, "")
    stored = json.loads((around / "steer.json").read_text(encoding="utf-8"))
    (warning,) = stored["warnings"]
    assert warning.startswith("cycle 1: distance[body, pillar] is -0.09")
    assert f"  warning: {warning}\n" in out
    distances = [cycle["constraints"]["distance"] for cycle in stored["cycles"][1:]]
    assert [distance["ok"] for distance in distances] == [False, True]
    assert distances[0]["value"] + distances[0]["worst"] == pytest.approx(0.1)
    with (around / "steer.csv").open(newline="", encoding="utf-8") as file:
        assert [row["broken"] for row in csv.DictReader(file)] == ["", "1", "0"]
    ended, out, _ = said([*asked, "--json"], capsys)
    assert (ended, json.loads(out)["warnings"]) == (0, [warning])


def test_bounds_that_many_machines_broke_are_told(around, capsys):
    asked = ["--error", "v=20%", "--runs", "2", "--set", "output.pictures=false", "-o", "out"]
    ended, out, _ = said(["steer", "around.yaml", *asked], capsys)
    stored = json.loads((around / "steer.json").read_text(encoding="utf-8"))
    (warning,) = stored["warnings"]
    assert ended == 0
    assert f"  warning: {warning}\n" in out
    told = [bool(machine["warnings"]) for machine in stored["machines"]]
    assert f"not kept by {sum(told)} of 2 machines" in warning
    assert [machine["broken"] for machine in stored["machines"]] == [int(each) for each in told]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--error", "rollertilt=2deg"], "did you mean 'roller_tilt'?"),
        (["--tolerance", "0"], "not positive"),
        (["--objective", "beauty"], "none of none, effort"),
        (["--noise", "-1"], "noise"),
        (["--noise", "-1", "--machine", "physics"], "noise"),
        (["--gravity", "9.81"], "add --machine physics"),
        (["--duration", "0"], "duration"),
        (["--set", "horizon={min: 1, max: 2}"], "horizon"),
    ],
)
def test_bad_input_is_answered(arguments, words, robot, capsys):
    ended, out, err = said(["steer", "robot.yaml", *arguments, "-o", "out"], capsys)
    assert (ended, out) == (2, "")
    assert words in err
    assert "Traceback" not in err


def test_what_has_no_bodies_is_refused(robot, capsys):
    pytest.importorskip("mujoco")
    (robot / "cart.yaml").write_text(nhpocp.dump_problem(CART), encoding="utf-8")
    for file, model in (("cart.yaml", "unicycle"), (str(PROBLEMS / "rolling_sphere.yaml"), "rolling_sphere")):
        ended, _, err = said(["steer", file, "--machine", "physics", "-o", "out"], capsys)
        assert ended == 2
        assert f"{model} cannot be built; expected a robot on legs" in err


def test_what_others_wrote_is_left_alone(robot, capsys):
    (robot / "out" / "cycle_1").mkdir(parents=True)
    (robot / "out" / "cycle_1" / "notes.txt").write_text("mine", encoding="utf-8")
    ended, _, err = said(["steer", "robot.yaml", "-o", "out"], capsys)
    assert ended == 2
    assert "left alone" in err
    assert (robot / "out" / "cycle_1" / "notes.txt").read_text(encoding="utf-8") == "mine"
