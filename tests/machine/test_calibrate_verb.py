"""The verb `calibrate`: tables that it reads, what it says and writes, and what it ends with."""

import csv
import json

import numpy as np
import pytest

import nhpocp
from nhpocp import deg, so3
from nhpocp.cli.entry import status
from nhpocp.csv_writer import write_table
from nhpocp.measured_table import read_measurements
from tests.machine.test_calibration import driven, noisy, two_runs

ROBOT = """nhpocp: 1
name: robot
system: # ours
  model: three_upu
  roller_tilt: 75 deg # as drawn
start: {position: [0, 0, 25], orientation: {rpy: [0, 0, -pi/6]}} # at rest
goal: {position: [-0.4, -0.2, 35], orientation: {rpy: [0, 0, -90 deg]}}
output: {pictures: false}
"""


def write(file, run, writing="matrix"):
    rotations = np.asarray(run["orientation"])
    if writing == "matrix":
        names = [f"orientation_{i}_{j}" for i in (1, 2, 3) for j in (1, 2, 3)]
        turned = rotations.reshape(-1, 9)
    elif writing == "quaternion":
        from scipy.spatial.transform import Rotation

        names = [f"orientation_quaternion_{i}" for i in (1, 2, 3, 4)]
        turned = np.roll(Rotation.from_matrix(rotations).as_quat(), 1, axis=1)
    else:
        names, turned = ["roll", "pitch", "yaw"], np.array([np.ravel(so3.to_rpy(each)) for each in rotations])
    columns = [
        "t",
        *(f"position_{i}" for i in (1, 2, 3)),
        *names,
        *(f"leg_lengths_{i}" for i in (1, 2, 3)),
        "extra",
    ]
    table = np.column_stack([run["t"], run["position"], turned, run["leg_lengths"], run["t"]])
    with file.open("w", newline="", encoding="utf-8") as stream:
        write_table(stream, columns, table)


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "robot.yaml").write_text(ROBOT, encoding="utf-8")
    for number, run in enumerate(two_runs()):
        write(tmp_path / f"run{number}.csv", run)
    return tmp_path


def said(arguments, capsys):
    ended = status(["calibrate", "robot.yaml", *arguments])
    out, err = capsys.readouterr()
    return ended, out, err


def test_two_runs(place, capsys):
    ended, out, err = said(["run0.csv", "run1.csv", "--json"], capsys)
    assert (ended, err) == (0, "")
    answer = json.loads(out)
    home = place / "results" / "robot" / "calibration"
    assert answer.pop("folder") == "results/robot/calibration"
    assert answer == json.loads((home / "calibration.json").read_text(encoding="utf-8"))
    assert answer["outcome"] == "fitted"
    tilt = next(each for each in answer["parameters"] if each["name"] == "roller_tilt")
    assert abs(tilt["value"] - 77 * deg) < 4 * tilt["standard_deviation"]
    assert answer["residuals"]["after"]["position"] < 0.1 * answer["residuals"]["before"]["position"]
    with (home / "residuals.csv").open(newline="", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["run"] for row in rows].count("run1.csv") == len(driven(1)[0])
    assert {"position_1_before", "orientation_3_after", "leg_lengths_3_after"} <= set(rows[0])
    # the file with the fitted robot, all else as it was
    text = (home / "fitted.yaml").read_text(encoding="utf-8")
    assert "# as drawn" in text
    assert "# at rest" in text
    fitted = nhpocp.load_problem(home / "fitted.yaml")
    for each in answer["parameters"]:
        assert fitted.system.parameters()[each["name"]] == pytest.approx(each["value"], rel=1e-14)
    assert status(["check", str(home / "fitted.yaml")]) == 0


@pytest.mark.parametrize("writing", ["matrix", "quaternion", "angles"])
def test_writings_of_a_rotation(writing, place):
    run = two_runs()[0]
    write(place / "run.csv", run, writing)
    read = read_measurements(place / "run.csv", nhpocp.ThreeUPU())
    np.testing.assert_allclose(read.points[:, 3:], run["orientation"].reshape(-1, 9), atol=1e-14)
    np.testing.assert_allclose(read.points[:, :3], run["position"], atol=0)
    np.testing.assert_allclose(read.lengths, run["leg_lengths"], atol=0)


def test_files_in_python(place):
    calibration = nhpocp.calibrate(
        "robot.yaml", ["run0.csv", place / "run1.csv"], ["base_radius"], (1e-3, 1e-3)
    )
    assert [each.run.name for each in calibration.residuals] == ["run0.csv", "run1.csv"]
    assert [each.name for each in calibration.estimates] == ["base_radius"]


def test_legs_of_their_own(place, capsys):
    ended, _, _ = said(["run0.csv", "run1.csv", "--fit", "base,platform,r", "-o", "out"], capsys)
    assert ended == 0
    text = (place / "out" / "fitted.yaml").read_text(encoding="utf-8")
    assert "# at rest" in text
    legs = nhpocp.load_problem(place / "out" / "fitted.yaml").system.legs
    assert np.hypot(*legs[2].base[:2]) == pytest.approx(30.3, abs=0.1)
    stored = json.loads((place / "out" / "calibration.json").read_text(encoding="utf-8"))
    assert [leg["base"] for leg in stored["system"]["legs"]] == [list(leg.base) for leg in legs]


def test_what_is_not_seen_ends_in_1(place, capsys):
    times, points, lengths = driven()
    still = np.repeat(points[:1], len(times), 0), np.repeat(lengths[:1], len(times), 0)
    write(place / "still.csv", noisy(times, *still, seed=1))
    ended, out, _ = said(["still.csv", "-o", "out"], capsys)
    assert ended == 1
    assert "roller_tilt is not seen by these data" in out
    stored = json.loads((place / "out" / "calibration.json").read_text(encoding="utf-8"))
    assert stored["parameters"][2]["standard_deviation"] is None
    assert (place / "out" / "fitted.yaml").exists()


def test_pictures_and_exported_plans(place, folder, capsys):
    """What `export` writes is read, and a plan's own motion finds the robot of the plan."""
    assert status(["export", str(folder), "--rate", "50", "-o", "motion.csv"]) == 0
    capsys.readouterr()
    ended, _, err = said(["motion.csv", "--set", "output.pictures=true", "-o", "out"], capsys)
    assert (ended, err) == (0, "")
    stored = json.loads((place / "out" / "calibration.json").read_text(encoding="utf-8"))
    assert [each["value"] for each in stored["parameters"]] == pytest.approx([30, 15, 75 * deg], rel=1e-4)
    for kind in ("png", "svg"):
        assert (place / "out" / f"residuals.{kind}").stat().st_size > 5000


def _changed(place, change):
    lines = (place / "run0.csv").read_text(encoding="utf-8").splitlines()
    (place / "bad.csv").write_text("\n".join(change(lines)), encoding="utf-8")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda lines: [lines[0].replace("leg_lengths_2", "leg_length_2"), *lines[1:]],
            "did you mean 'leg_length_2'?",
        ),
        (lambda lines: [lines[0].replace("position_1", "x"), *lines[1:]], "bad.csv:1: no column position_1"),
        (lambda lines: [lines[0].replace("orientation_1_1", "z"), *lines[1:]], "no column orientation_1_1"),
        (lambda lines: [*lines[:3], lines[3].replace(",", ",a", 1), *lines[4:]], "bad.csv:4: position_1: 'a"),
        (lambda lines: [*lines[:3], lines[3] + ",1", *lines[4:]], "bad.csv:4: 18 cells; expected 17"),
        (lambda lines: [*lines[:4], lines[2], *lines[5:]], "bad.csv:5: t:"),
        (lambda lines: lines[:1], "no row of measurements"),
        (lambda lines: lines[:3], "2 samples; expected at least 3"),
        (lambda lines: [], "no row of measurements"),
    ],
)
def test_bad_tables_are_answered(change, words, place, capsys):
    _changed(place, change)
    ended, out, err = said(["bad.csv", "-o", "out"], capsys)
    assert (ended, out) == (2, "")
    assert words in err
    assert "Traceback" not in err
    assert not (place / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["missing.csv"], "missing.csv: no such file"),
        (["run0.csv", "--fit", "tilt"], "did you mean 'roller_tilt'?"),
        (["run0.csv", "--noise", "0"], "POSITION,ANGLE"),
        (["."], "cannot read this file"),
        ([], "MEASURED.csv"),
    ],
)
def test_bad_input_is_answered(arguments, words, place, capsys):
    ended, out, err = said(arguments, capsys)
    assert (ended, out) == (2, "")
    assert words in err


def test_what_others_wrote_is_left_alone(place, capsys):
    (place / "out").mkdir()
    (place / "out" / "notes.txt").write_text("mine", encoding="utf-8")
    ended, _, err = said(["run0.csv", "-o", "out"], capsys)
    assert ended == 2
    assert "out" in err
    assert (place / "out" / "notes.txt").read_text(encoding="utf-8") == "mine"
