"""`nhpocp plot`: which pictures, in which formats, how large."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from nhpocp.cli.entry import status
from nhpocp.solution_folder import save_solution
from nhpocp.solution_folder.target import OWN
from tests.views.test_figures import good


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    solution = replace(good(), settings={"gamma": 0.1, "tolerance": 1e-3})
    return save_solution(solution, tmp_path_factory.mktemp("plot") / "solution")


def test_what_is_asked_for_is_drawn(stored: Path, tmp_path: Path, capsys: Any) -> None:
    folder = Path(shutil.copytree(stored, tmp_path / "copy"))
    asked = ["--format", "pdf,svg", "--only", "controls,relative_pose", "--size", "84mm x 12cm", "--json"]
    assert status(["plot", str(folder), *asked]) == 0
    pictures = [Path(place) for place in json.loads(capsys.readouterr().out)["pictures"]]
    names = ("controls.pdf", "controls.svg", "relative_pose.pdf", "relative_pose.svg")
    assert [picture.name for picture in pictures] == list(names)
    for picture in pictures[1::2]:
        size = re.search(r'width="([\d.]+)pt" height="([\d.]+)pt"', picture.read_text(encoding="utf-8"))
        assert [float(points) for points in size.groups()] == pytest.approx([84 / 25.4 * 72, 12 / 2.54 * 72])
    assert {file.name for file in folder.iterdir()} <= OWN  # so that the folder may be replaced


@pytest.mark.parametrize(
    ("option", "value", "words"),
    [
        ("--only", "controls,relativ_pose", "did you mean 'relative_pose'?"),
        ("--format", "jpg", "'jpg'; "),
        ("--format", ",", "','; "),
        ("--size", "84", "84mm, 84mmx60mm"),
        ("--size", "84mmx", "84mm, 84mmx60mm"),
        ("--size", "0mm", "from 26mm to 1000mm"),
        ("--size", "84mmx9000mm", "from 26mm to 1000mm"),
        ("--size", "1e99mm", "84mm, 84mmx60mm"),
    ],
)
def test_what_is_none_is_refused(stored: Path, option: str, value: str, words: str, capsys: Any) -> None:
    assert status(["plot", str(stored), option, value]) == 2
    said = capsys.readouterr().err
    assert option in said
    assert words in said.replace("\n", " ")
    assert not list(stored.glob("*.png"))
