"""What other distributions add: their entry points in the groups that `family.Family` asks for, name = module:Class.

Read from the folders on the path, which takes a millisecond or two; `importlib.metadata` looks at every distribution in
full, and takes five times as long of the third of a second that `nhpocp check` has. Loading an entry point runs the
code of a distribution that the user installed; nothing that a problem file says is ever evaluated.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib import import_module
from itertools import takewhile
from operator import attrgetter
from typing import Any

from nhpocp.errors import one_line

PREFIX = "nhpocp."  # of the groups
LARGEST = 1_000_000  # bytes of a list of entry points; no distribution has as many
METADATA = ("METADATA", "PKG-INFO")


@dataclass(frozen=True)
class EntryPoint:
    """One line of a distribution. value: "module:Class"; distribution: its name and version."""

    group: str
    name: str
    value: str
    distribution: str

    def __str__(self) -> str:
        return f"the plugin {self.value} of {self.distribution}"


def imported(line: str) -> Any:
    """What "module:attribute" names. Raises whatever its module raises."""
    module, _, attribute = line.partition(":")
    return attrgetter(attribute)(import_module(module))


def announced(group: str) -> Mapping[str, tuple[EntryPoint, ...]]:
    """The entry points of a group by name, as many as claim it."""
    return _on(tuple(sys.path)).get(group, {})


@lru_cache(maxsize=8)
def _on(path: tuple[str, ...]) -> dict[str, dict[str, tuple[EntryPoint, ...]]]:
    """The entry points on a path by group and name; a distribution may stand on it twice."""
    groups: dict[str, dict[str, tuple[EntryPoint, ...]]] = {}
    for folder in dict.fromkeys(path):
        for point in _in(folder or os.curdir):
            names = groups.setdefault(point.group, {})
            others = names.get(point.name, ())
            if point.value not in [other.value for other in others]:
                names[point.name] = (*others, point)
    return groups


def _in(folder: str) -> Iterator[EntryPoint]:
    """The entry points of the distributions in a folder, in the order of their names."""
    try:
        with os.scandir(folder) as entries:
            homes = sorted(e.path for e in entries if e.name.endswith((".dist-info", ".egg-info")))
    except OSError:  # not there, no folder, not to be read: nothing can be imported from it either
        return
    for home in homes:
        if PREFIX in (text := _text(home, "entry_points.txt")):
            yield from _lines(text, _name(home))


def _text(home: str, name: str) -> str:
    try:
        with open(os.path.join(home, name), encoding="utf-8", errors="replace") as file:
            return file.read(LARGEST)
    except OSError:
        return ""


def _name(home: str) -> str:
    """Name and version of a distribution, by its metadata, else by its folder."""
    lines = next((text for name in METADATA if (text := _text(home, name))), "").splitlines()
    head = dict(line.partition(": ")[::2] for line in takewhile(str.strip, lines))
    by_folder = os.path.basename(home).rpartition(".")[0].replace("-", " ")
    return f"{head['Name']} {head.get('Version', '')}".rstrip() if "Name" in head else by_folder


def _lines(text: str, distribution: str) -> Iterator[EntryPoint]:
    group = ""
    for line in text.splitlines():
        if section := re.fullmatch(r"\s*\[(.+)\]\s*", line):
            group = section[1].strip()
        elif group.startswith(PREFIX) and not line.lstrip().startswith(("#", ";")) and "=" in line:
            name, _, value = line.partition("=")
            yield EntryPoint(group, name.strip(), re.sub(r"\s|\[.*", "", value), distribution)


def fault(error: BaseException) -> str:
    """What plugins have to do with an error that nobody foresaw, in a sentence; empty where they have nothing."""
    packages = {
        point.value.partition(":")[0].partition(".")[0]: point
        for names in _on(tuple(sys.path)).values()
        for points in names.values()
        for point in points
    }
    step, blamed = error.__traceback__, None
    while step:
        package = str(step.tb_frame.f_globals.get("__name__", "")).partition(".")[0]
        blamed = packages.get(package, blamed)
        step = step.tb_next
    return f"{blamed} fails: {one_line(error)}" if blamed else ""
