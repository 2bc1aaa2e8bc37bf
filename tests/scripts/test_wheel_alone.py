"""What is built holds all that the program needs; the lowest versions are read from it."""

import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest
import wheel_alone

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    return wheel_alone.built(tmp_path_factory.mktemp("built"))


def ours(folder):
    files = subprocess.run(["git", "ls-files", folder], cwd=ROOT, capture_output=True, text=True, check=False)
    if files.returncode or not files.stdout:
        pytest.skip("no checkout")
    return set(files.stdout.splitlines())


def test_the_wheel_is_the_package_and_the_sdist_the_checkout(built):
    sdist, wheel = built
    with zipfile.ZipFile(wheel) as archive:
        inside = {name for name in archive.namelist() if ".dist-info/" not in name}
    assert ours("nhpocp") <= inside
    assert all(name.startswith("nhpocp/") for name in inside)
    with tarfile.open(sdist) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert ours("nhpocp") | ours("tests") | {"pyproject.toml", "LICENSE", "README.md"} <= names


def test_the_lowest_versions_are_those_of_this_python(built):
    lines = subprocess.run(
        [sys.executable, "-c", wheel_alone.LEAST, built[1], "parquet"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout.splitlines()
    least = dict(line.split("==") for line in lines)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert len(least) == len({line.partition(">")[0] for line in project["dependencies"]}) + 1
    assert least["click"] == "8.1"
    assert (least["numpy"] == "1.26") == (sys.version_info < (3, 13))
