#!/usr/bin/env python3
"""The wheel without the checkout: made from the sdist, installed with the newest and with the lowest versions allowed.

For every Python named, or else for each of python3.11 … python3.14 on the PATH, two environments of their own, in which
`nhpocp init`, `solve`, `compare`, `sweep` and `export` run on what `init` writes. The lowest versions are read from the
wheel itself; what they need in turn is the newest that fits.
Run: .venv/bin/python scripts/wheel_alone.py [PYTHON …] [--versions lowest newest]
Ends with 1 where anything went wrong.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]
VERSIONS = ("lowest", "newest")
EXTRA = "parquet"
CALLS = [
    ["init", "problem.yaml"],
    ["init", "--study", "study.yaml"],
    ["check", "problem.yaml", "study.yaml"],
    ["solve", "problem.yaml", "-o", "solved"],
    ["verify", "solved"],
    ["export", "solved", "--format", "mat"],
    ["compare", "problem.yaml", "-o", "compared"],
    ["sweep", "study.yaml", "-o", "swept"],
    ["export", "swept/study.sqlite"],
    ["export", "swept/study.sqlite", "--format", "parquet"],
    ["solve", "--from", "swept/study.sqlite", "--run", "1", "-o", "one"],
]
# of the metadata of an installed package: `name==version` of the least version that each line allows
LEAST = """
import sys
from importlib.metadata import PathDistribution
from pathlib import Path
from zipfile import Path as ZipPath
from pip._vendor.packaging.requirements import Requirement
from pip._vendor.packaging.version import Version
bounds = {}
(info,) = (path for path in ZipPath(sys.argv[1]).iterdir() if path.name.endswith(".dist-info"))
for line in PathDistribution(info).requires:
    one = Requirement(line)
    if one.marker is None or one.marker.evaluate({"extra": sys.argv[2]}):
        least = [Version(part.version) for part in one.specifier if part.operator == ">="]
        bounds.setdefault(one.name, []).extend(least)
for name, least in bounds.items():
    print(f"{name}=={max(least)}")
"""


class Wrong(Exception):
    """A step that failed, in words."""


def ran(command: list[str | Path], cwd: Path, statuses: tuple[int, ...] = (0,)) -> str:
    """What a program says on standard output. Errors: `Wrong`."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("NHPOCP", "PYTHON", "VIRTUAL_ENV"))}
    done = subprocess.run([str(part) for part in command], cwd=cwd, env=kept, capture_output=True, text=True)
    if done.returncode not in statuses:
        said = (done.stderr.strip() or done.stdout.strip())[-2000:]
        raise Wrong(f"{' '.join(map(str, command[1:]))}: status {done.returncode}\n{said}")
    return done.stdout


def built(home: Path, root: Path = ROOT) -> tuple[Path, Path]:
    """The sdist of a checkout, and the wheel that comes out of it."""
    ran([sys.executable, "-m", "hatchling", "build", "-t", "sdist", "-d", home], root)
    (sdist,) = home.glob("*.tar.gz")
    with tarfile.open(sdist) as archive:
        archive.extractall(home / "unpacked", filter="data")
    (unpacked,) = (home / "unpacked").iterdir()
    ran([sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", home], unpacked)
    (wheel,) = home.glob("*.whl")
    return sdist, wheel


def found() -> list[str]:
    """The Pythons on the PATH."""
    names = [f"python3.{minor}" for minor in range(11, 15)]
    return [
        name
        for name in names
        if shutil.which(name) and not subprocess.run([name, "-V"], capture_output=True).returncode
    ]


def installed(python: str, versions: str, wheel: Path, home: Path) -> Path:
    """The Python of a new environment that has the wheel."""
    ran([python, "-m", "venv", home / "environment"], home)
    own = home / "environment" / "bin" / "python"
    install: list[str | Path] = [own, "-m", "pip", "install", "--quiet", "--only-binary", ":all:"]
    if versions == "lowest":
        (home / "least.txt").write_text(ran([own, "-c", LEAST, wheel, EXTRA], home), encoding="utf-8")
        install += ["--constraint", "least.txt"]
    ran([*install, f"{wheel}[{EXTRA}]"], home)
    return own


def tried(own: Path, home: Path) -> str:
    """Runs every call on what `init` wrote; the versions, in words."""
    place = ran([own, "-c", "import nhpocp; print(nhpocp.__file__)"], home).strip()
    if not Path(place).is_relative_to(home / "environment"):
        raise Wrong(f"nhpocp was imported from {place}")
    for call in CALLS:
        out = ran([own, "-m", "nhpocp", *call, "--json"], home)
        json.loads(out)
    listed = json.loads(ran([own, "-m", "pip", "list", "--format", "json"], home))
    wanted = json.loads(ran([own, "-c", NAMES], home))
    versions = {one["name"].lower().replace(".", "-"): one["version"] for one in listed}
    return ", ".join(f"{name} {versions[name.lower().replace('.', '-')]}" for name in wanted)


NAMES = """
import json, re
from importlib.metadata import requires
names = dict.fromkeys(re.match(r"[\\w.-]+", line).group() for line in requires("nhpocp") if "extra" not in line)
print(json.dumps([*names, "pyarrow"]))
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("pythons", nargs="*", metavar="PYTHON")
    parser.add_argument("--versions", nargs="+", choices=VERSIONS, default=VERSIONS)
    chosen = parser.parse_args()
    wrong = 0
    with tempfile.TemporaryDirectory(prefix="nhpocp-wheel-") as folder:
        sdist, wheel = built(Path(folder))
        sizes = [f"{file.name} {file.stat().st_size / 1024:.0f} kB" for file in (sdist, wheel)]
        print(", ".join(sizes), flush=True)
        for python in chosen.pythons or found():
            for versions in chosen.versions:
                began, home = time.monotonic(), Path(folder) / "home"
                home.mkdir()
                name = ran([python, "-V"], home).strip()
                try:
                    words = tried(installed(python, versions, wheel, home), home)
                except Wrong as error:
                    words, wrong = f"WRONG: {error}", wrong + 1
                print(f"{name}, {versions}: {words} ({time.monotonic() - began:.0f} s)", flush=True)
                shutil.rmtree(home)
    print(f"{wrong} wrong")
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
