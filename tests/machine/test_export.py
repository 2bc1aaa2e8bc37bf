"""`nhpocp export DIR`: files that others read, with the plan's numbers in them."""

from __future__ import annotations

import errno
import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas
import pytest
import scipy.io
import yaml
from mcap.reader import make_reader
from rosbags.typesys import Stores, get_typestore

import nhpocp
from nhpocp.cli.entry import status
from nhpocp.errors import InvalidProblemError
from nhpocp.machine.export.motion import make_motion
from nhpocp.machine.export.registry import FORMATS
from nhpocp.solution_folder.target import OWN
from nhpocp.units import Units
from tests.machine.conftest import plan, reference

DURATION, RATE = 2.5, 40
TIMING = ["--rate", str(RATE), "--duration", str(DURATION)]


@pytest.fixture(scope="module")
def solution(folder):
    return nhpocp.load_solution(folder)


@pytest.fixture(scope="module")
def motion(solution):
    return make_motion(solution, rate=RATE, duration=DURATION)


@pytest.fixture(scope="module")
def states(solution, motion):
    """By another integration, in the machine's time."""
    states = reference(solution, motion.times, DURATION, quintic=True)
    return solution.problem.system.state_space.split(states)


@pytest.fixture(scope="module")
def files(folder, tmp_path_factory):
    """One file of each format, as the program writes it into the folder."""
    home = Path(shutil.copytree(folder, tmp_path_factory.mktemp("files") / "paper"))
    for kind in FORMATS:
        assert status(["export", str(home), "--format", kind, *TIMING]) == 0
    assert {file.name for file in home.iterdir()} <= OWN  # so that the folder may be replaced
    return {kind: home / each.file_name for kind, each in FORMATS.items()}


def joints(motion, kind):
    return np.stack([getattr(joint, kind) for joint in motion.joints], axis=1)


def test_pandas_reads_the_csv(files, motion, states):
    table = pandas.read_csv(files["csv"])
    assert list(table) == [column.name for column in motion.columns()]
    assert (table["t"].to_numpy() == np.arange(101) / RATE).all()
    position = table[["position_1", "position_2", "position_3"]].to_numpy()
    assert position == pytest.approx(states["position"], abs=1e-7)
    lengths = table[[f"leg_lengths_{i}" for i in (1, 2, 3)]].to_numpy()
    assert lengths == pytest.approx(joints(motion, "position"), rel=1e-14)


def test_json_says_what_every_column_is(files, motion, states):
    document = json.loads(files["json"].read_text(encoding="utf-8"))
    columns = {column["name"]: column for column in document["columns"]}
    assert document["schema_version"] == 1
    assert [document[name] for name in ("name", "profile", "duration", "plan_duration", "samples")] == [
        *("paper", "quintic"),
        *(DURATION, 1.0, 101),
    ]
    assert (document["converged"], document["system"]["base_radius"]) == (True, 30.0)
    turned = np.array([columns[f"orientation_{i}_{j}"]["values"] for i in (1, 2, 3) for j in (1, 2, 3)])
    assert turned.T.reshape(-1, 3, 3) == pytest.approx(states["orientation"], abs=1e-8)
    units = {name: columns[name]["unit"] for name in ("t", "position_1", "leg_speeds_2", "orientation_1_1")}
    assert units == {
        "t": "time",
        "position_1": "length",
        "leg_speeds_2": "length/time",
        "orientation_1_1": "",
    }
    assert columns["orientation_acceleration_3"]["unit"] == "rad/time^2"


def test_scipy_reads_the_mat_file(files, motion, states):
    read = scipy.io.loadmat(files["mat"], simplify_cells=True)
    for entry in motion.entries:
        assert (read[entry.name] == entry.values).all()
    assert read["position"] == pytest.approx(states["position"], abs=1e-7)
    assert read["unit"]["leg_accelerations"] == "length/time^2"
    assert read["info"]["duration"] == DURATION


def test_ros2_takes_the_message(files, motion):
    store = get_typestore(Stores.ROS2_HUMBLE)
    read = yaml.safe_load(files["ros2"].read_text(encoding="utf-8"))

    def built(kind, data):
        return store.types[kind](**data)

    def duration(data):
        return built("builtin_interfaces/msg/Duration", data)

    points = [
        built(
            "trajectory_msgs/msg/JointTrajectoryPoint",
            {
                **{name: np.array(values) for name, values in point.items() if name != "time_from_start"},
                "time_from_start": duration(point["time_from_start"]),
            },
        )
        for point in read["points"]
    ]
    header = built(
        "std_msgs/msg/Header",
        {**read["header"], "stamp": built("builtin_interfaces/msg/Time", read["header"]["stamp"])},
    )
    kind = "trajectory_msgs/msg/JointTrajectory"
    message = built(kind, {"header": header, "joint_names": read["joint_names"], "points": points})
    back = store.deserialize_cdr(store.serialize_cdr(message, kind), kind)
    assert back.joint_names == ["leg_1", "leg_2", "leg_3"]
    for name, of in (
        ("positions", "position"),
        ("velocities", "velocity"),
        ("accelerations", "acceleration"),
    ):
        assert (np.array([getattr(point, name) for point in back.points]) == joints(motion, of)).all()
    stamps = [point.time_from_start.sec + point.time_from_start.nanosec * 1e-9 for point in back.points]
    assert stamps == pytest.approx(motion.times, abs=1e-9)


def test_the_recording_reads_back(files, motion, states):
    with files["mcap"].open("rb") as stream:
        reader = make_reader(stream)
        messages = list(reader.iter_messages())
        (metadata,) = reader.iter_metadata()
    assert json.loads(metadata.metadata["duration"]) == DURATION
    rows = {topic: [] for topic in ("/motion", "/pose")}
    for schema, channel, message in messages:
        assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
        row = json.loads(message.data)
        assert set(row) == set(json.loads(schema.data)["properties"])
        rows[channel.topic].append((message.log_time, row))
    for column in motion.columns():
        assert [row[column.name] for _, row in rows["/motion"]] == column.values.tolist()
    for topic in rows:
        assert [time for time, _ in rows[topic]] == [round(time * 1e9) for time in motion.times]
    places = [[row["pose"]["position"][axis] for axis in "xyz"] for _, row in rows["/pose"]]
    assert np.array(places) == pytest.approx(states["position"], abs=1e-7)


PROGRAM = """\
#include <stdio.h>
#include "motion.h"
int main(void)
{
    for (int k = -2; k <= 4 * 100 + 2; k++) {
        const double t = k * MOTION_PAPER_DURATION / 400;
        double p[MOTION_PAPER_JOINTS], v[MOTION_PAPER_JOINTS];
        motion_paper_at(t, p, v);
        printf("%.17g", t);
        for (int i = 0; i < MOTION_PAPER_JOINTS; i++) {
            printf(" %.17g %.17g", p[i], v[i]);
        }
        putchar('\\n');
    }
    return 0;
}
"""


def test_a_c_program_follows_the_plan(files, solution, motion, tmp_path):
    compiler = next(filter(None, map(shutil.which, ("gcc", "cc"))), None)
    if compiler is None:
        pytest.skip("no C compiler here")
    (tmp_path / "main.c").write_text(PROGRAM)
    flags = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-I", str(files["c"].parent)]
    made = [compiler, *flags, str(tmp_path / "main.c"), "-o", str(tmp_path / "main")]
    subprocess.run(made, check=True)
    said = subprocess.run([str(tmp_path / "main")], check=True, capture_output=True, text=True).stdout
    rows = np.array([[float(word) for word in line.split()] for line in said.splitlines()])
    inside = rows[2:-2]
    fine = make_motion(
        solution, rate=4 * RATE, duration=DURATION
    )  # three times between each two of the table
    assert inside[:, 0] == pytest.approx(fine.times)
    positions, velocities = joints(fine, "position"), joints(fine, "velocity")
    assert (inside[::4, 1::2] == joints(motion, "position")).all()
    assert np.abs(inside[:, 1::2] - positions).max() < 1e-5 * np.ptp(positions)
    assert np.abs(inside[:, 2::2] - velocities).max() < 1e-3 * np.abs(velocities).max()
    for row, end in ((0, 2), (1, 2), (-1, -3), (-2, -3)):  # before and after it rests there
        assert (rows[row, 1::2] == rows[end, 1::2]).all()
        assert (rows[row, 2::2] == 0).all()


def test_a_state_without_legs_is_its_own_joints(tmp_path):
    motion = make_motion(plan("car"), rate=10)
    assert [joint.name for joint in motion.joints] == ["x", "y", "theta", "phi"]
    FORMATS["ros2"].write(motion, tmp_path / "car.yaml")
    read = yaml.safe_load((tmp_path / "car.yaml").read_text(encoding="utf-8"))
    assert [point["positions"] for point in read["points"]] == joints(motion, "position").tolist()
    rolling = make_motion(plan("rolling_sphere"), rate=10)
    for kind in ("ros2", "c"):
        with pytest.raises(InvalidProblemError, match="rotation in its state and no legs"):
            FORMATS[kind].write(rolling, tmp_path / "none")
    in_minutes = replace(motion, units=Units(time="min"))
    for kind in ("ros2", "mcap"):
        with pytest.raises(InvalidProblemError, match="counts seconds"):
            FORMATS[kind].write(in_minutes, tmp_path / "none")
    assert [file.name for file in tmp_path.iterdir()] == ["car.yaml"]


def test_small_and_large_numbers_are_numbers_to_ros2(tmp_path):
    motion = make_motion(plan("car"), rate=1)
    numbers = np.array([1e-05, -2e16])
    odd = replace(motion.joints[0], position=numbers)
    FORMATS["ros2"].write(replace(motion, joints=(odd,)), tmp_path / "a.yaml")
    read = yaml.safe_load((tmp_path / "a.yaml").read_text(encoding="utf-8"))
    assert [point["positions"] for point in read["points"]] == [[1e-05], [-2e16]]


def test_names_of_problems_do_no_harm_to_c_and_yaml(tmp_path):
    named = replace(make_motion(plan("car"), rate=10), name='*/ #error "\n$x??/ 寸')
    for kind in ("c", "ros2"):
        FORMATS[kind].write(named, tmp_path / FORMATS[kind].file_name)
    assert len(yaml.safe_load((tmp_path / "motion.yaml").read_text(encoding="utf-8"))["points"]) == 11
    head = (tmp_path / "motion.h").read_text(encoding="utf-8")
    assert head.isascii()
    assert head.count("*/") == 2


def test_mcap_asks_for_its_extra(folder, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "mcap.writer", None)
    assert status(["export", str(folder), "--format", "mcap", "-o", str(tmp_path / "a.mcap")]) == 3
    assert 'pip install "nhpocp[export]"' in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_full_disk_leaves_what_was_there(folder, tmp_path, monkeypatch, capsys):
    def full(stream, *_, **__):
        stream.write(b"half")
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(scipy.io, "savemat", full)
    (tmp_path / "a.mat").write_text("old")
    assert status(["export", str(folder), "--format", "mat", "-o", str(tmp_path / "a.mat")]) == 2
    assert "a.mat: cannot write here: No space left on device" in capsys.readouterr().err
    assert [file.name for file in tmp_path.iterdir()] == ["a.mat"]
    assert (tmp_path / "a.mat").read_text() == "old"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            ["DIR", "--format", "parquet"],
            "parquet is a format of a study, STUDY.sqlite; of a solution folder: csv,",
        ),
        (
            ["DIR/problem.yaml", "--format", "mat"],
            "mat is a format of a solution folder, and this is none; of a study:",
        ),
        (["DIR/problem.yaml", "--rate", "10"], "--rate: an option of a solution folder"),
        (["none"], "none: no such file or folder; expected a solution folder, or the store of a study"),
        (["DIR", "-o", "DIR/trajectory.csv"], "this is a file of the solution itself"),
        (["DIR", "-o", "DIR"], "this is a folder; name a file"),
        (["DIR", "--max-speed", "5", "--duration", "0.1"], "the least duration that keeps them is "),
        (["."], "solution"),
    ],
)
def test_what_is_no_export_is_refused(folder, tmp_path, monkeypatch, capsys, arguments, words):
    monkeypatch.chdir(tmp_path)
    before = {file.name: file.stat().st_mtime_ns for file in folder.iterdir()}
    assert status(["export", *(word.replace("DIR", str(folder)) for word in arguments)]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert "Traceback" not in said
    assert {file.name: file.stat().st_mtime_ns for file in folder.iterdir()} == before
    assert not list(tmp_path.iterdir())


def test_a_plan_that_nobody_confirms_is_said(folder, tmp_path, capsys):
    document = json.loads((folder / "solution.json").read_text(encoding="utf-8"))
    copy = Path(shutil.copytree(folder, tmp_path / "copy"))
    document |= {"outcome": "iteration_limit", "converged": False}
    (copy / "solution.json").write_text(json.dumps(document), encoding="utf-8")
    assert status(["export", str(copy), "--json"]) == 0
    out, errors = capsys.readouterr()
    answer = json.loads(out)
    assert answer["converged"] is False
    assert answer["file"] == str(copy / "motion.csv")
    assert (answer["samples"], answer["duration"], answer["profile"]) == (101, 1.0, "quintic")
    assert "warning: this plan is not solved and verified (iteration_limit)" in errors
