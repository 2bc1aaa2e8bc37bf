"""Families: members by name, each announced in one line "module:Class" and imported when it is asked for.

A line stands in nhpocp itself, or is an entry point of another distribution.
"""

from __future__ import annotations

import re
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Generic, TypeVar, cast

from nhpocp import plugins
from nhpocp.errors import InvalidProblemError, LocatedError, NhpocpWarning, one_line, suggestion
from nhpocp.plugins import EntryPoint, imported

Member = TypeVar("Member")
_SAID: set[tuple[str, str]] = set()  # what this process has warned of, by distribution


@dataclass(frozen=True)
class Group:
    """The entry points by which other distributions add to a family.

    name: "nhpocp.bases". contract: "module:Class", of which every member is a subclass that can be made without
    arguments. called: the attribute that repeats the entry point's name; "" for none. noun: "a basis". reserved: names
    that mean something else where a file names a member.
    """

    name: str
    contract: str
    called: str
    noun: str
    reserved: tuple[str, ...] = ()


class Family(Mapping[str, Member], Generic[Member]):
    """What a name of a problem file stands for; the names of nhpocp's own are known before anything is imported.

    ``lines``: "module:attribute" by name, in the order of messages and lists. ``made``: what a member is made of the
    attribute, once. ``group``: where others add theirs, which come last. Who goes through a family meets the members
    that work: a plugin that is broken is left out, with one `NhpocpWarning`; who asks for it by name is answered with
    an `InvalidProblemError`.
    """

    def __init__(
        self,
        lines: Mapping[str, str],
        made: Callable[[Any], Member] | None = None,
        group: Group | None = None,
    ) -> None:
        self.lines, self.group, self._made = dict(lines), group, made
        self._members: dict[str | EntryPoint, Member] = {}
        self._faults: dict[EntryPoint, str] = {}

    def __getitem__(self, name: str) -> Member:
        if name not in self.lines:
            return self._added(self.plugins()[name])
        if self._made is None:
            return cast("Member", imported(self.lines[name]))
        if name not in self._members:
            self._members[name] = self._made(imported(self.lines[name]))
        return self._members[name]

    def __contains__(self, name: object) -> bool:
        return name in self.lines or name in self.plugins()

    def __iter__(self) -> Iterator[str]:
        yield from self.lines
        for name, points in self.plugins().items():
            try:
                self._added(points)
            except InvalidProblemError:
                self.complain(points[0], self._faults[points[0]])
            else:
                yield name

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def plugins(self) -> dict[str, tuple[EntryPoint, ...]]:
        """The entry points by the names that they add, whether they work or not."""
        if self.group is None:
            return {}
        added = dict(plugins.announced(self.group.name))
        for name in added.keys() & {*self.lines, *self.group.reserved}:
            (point, *_) = added.pop(name)
            self.complain(point, f"is never used: {name} is a name of nhpocp itself")
        return added

    def faults(self) -> list[str]:
        """What is wrong with the plugins that do not work, a sentence each."""
        len(self)  # meets every one
        here = plugins.announced(self.group.name).values() if self.group else ()
        return [self._sentence(point) for points in here for point in points if point in self._faults]

    def complain(self, point: EntryPoint, fault: str) -> None:
        """Says what is wrong with a plugin; once what is wrong alike with several of one distribution."""
        self._faults[point] = fault
        if (point.distribution, fault) not in _SAID:
            _SAID.add((point.distribution, fault))
            warnings.warn(self._sentence(point), NhpocpWarning, stacklevel=_outside())

    def _sentence(self, point: EntryPoint) -> str:
        return f"{point} {self._faults[point]}"

    def unknown(self, word: str) -> str:
        """What to write instead of a name that is none, in words."""
        near = suggestion(word, self)
        (point, *_) = self.plugins().get(word, (None,))
        if point in self._faults:
            return self._sentence(point)
        if self.group is None or near.startswith("did you mean"):
            return near
        return (
            f"{near}; {self.group.noun} of your own is found by an entry point of the group {self.group.name}"
        )

    def _added(self, points: tuple[EntryPoint, ...]) -> Member:
        """The member that an entry point announces. Errors: `InvalidProblemError`, in words found once."""
        point, *others = points
        if others:
            origins = " and ".join(map(str, others))
            self._faults[point] = f"claims the name {point.name!r}, and so does {origins}; uninstall one"
        elif point not in self._members and point not in self._faults:
            try:
                self._members[point] = self._tried(point, cast("Group", self.group))
            except InvalidProblemError as error:
                self._faults[point] = error.message
        if point in self._faults:
            raise InvalidProblemError(self._sentence(point))
        return self._members[point]

    def _tried(self, point: EntryPoint, group: Group) -> Member:
        """Errors: `InvalidProblemError` with what is wrong with an entry point, in words that follow its own."""
        if not re.fullmatch(r"[^\W_][\w-]*", point.name):
            raise InvalidProblemError(f"is called {point.name!r}; expected letters, digits, - and _")
        with _naming("cannot be loaded"):
            cls = imported(point.value)
        contract = imported(group.contract)
        if not (isinstance(cls, type) and contract in cls.__mro__):
            raise InvalidProblemError(f"is no subclass of nhpocp.{contract.__name__}")
        if group.called and (own := getattr(cls, group.called, None)) != point.name:
            words = f"calls its {group.called} {own!r}; expected {point.name!r}, its entry point's name"
            raise InvalidProblemError(words)
        with _naming("fails"):
            cls()  # nothing that works is broken without arguments
            return self._made(cls) if self._made else cast("Member", cls)


@contextmanager
def _naming(words: str) -> Iterator[None]:
    """Whatever code from elsewhere raises is a fault of its plugin."""
    try:
        yield
    except Exception as error:
        raise InvalidProblemError(f"{words}: {reason(error)}") from error


def reason(error: BaseException) -> str:
    """What an error of a plugin's code says, in one line."""
    return error.message if isinstance(error, LocatedError) else one_line(error)


def _outside() -> int:
    """How far up the calls the first stands that is none of nhpocp's, as `warnings.warn` counts."""
    frame, depth = sys._getframe(1), 1
    while frame is not None:
        name = str(frame.f_globals.get("__name__", ""))
        if name.partition(".")[0] not in ("nhpocp", "importlib", "collections"):
            return depth
        depth += not name.startswith("importlib._bootstrap")  # which are not counted
        frame = frame.f_back  # type: ignore[assignment]
    return 1
