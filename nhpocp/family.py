"""Families: members by name, each announced in one line "module:Class" and imported when it is asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from typing import Any, Generic, TypeVar, cast

Member = TypeVar("Member")


class Family(Mapping[str, Member], Generic[Member]):
    """What a name of a problem file stands for; the names are known before anything is imported.

    ``lines``: "module:attribute" by name, in the order of messages and lists. ``made``: what a member is made of the
    attribute, once.
    """

    def __init__(self, lines: Mapping[str, str], made: Callable[[Any], Member] | None = None) -> None:
        self._lines, self._made = dict(lines), made
        self._members: dict[str, Member] = {}

    def __getitem__(self, name: str) -> Member:
        if name not in self._members:
            module, _, attribute = self._lines[name].partition(":")
            announced = getattr(import_module(module), attribute)
            self._members[name] = self._made(announced) if self._made else cast("Member", announced)
        return self._members[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._lines)

    def __len__(self) -> int:
        return len(self._lines)
