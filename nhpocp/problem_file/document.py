"""YAML text as plain data that knows the line and column of everything in it.

Built from the parser's events rather than by a YAML constructor: so limits hold before anything is expanded, YAML 1.2's
core schema decides what is a number, and no tag can call a class.
"""

from __future__ import annotations

import errno
import os
import re
import stat
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path as FilePath
from typing import Any, BinaryIO

from nhpocp.errors import InvalidProblemError

LARGEST_FILE = 1_000_000  # bytes
LARGEST_TREE = 50_000  # keys and values, aliases expanded: two seconds
DEEPEST = 50  # levels

_UNPRINTABLE = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x84\x86-\x9f\ufffe\uffff]")
_INTEGER = re.compile(r"[-+]?[0-9]+")
_BASED = re.compile(r"0x[0-9a-fA-F]+|0o[0-7]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_INFINITE = re.compile(r"[-+]?\.(inf|Inf|INF)")
_WORDS: dict[str, Any] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL")),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
    **dict.fromkeys((".nan", ".NaN", ".NAN"), float("nan")),
}
_CORE = "tag:yaml.org,2002:"


@dataclass(frozen=True)
class Mark:
    """Where something stands in the text, counted from 1."""

    line: int
    column: int


@dataclass(frozen=True)
class Document:
    """Plain data, and a mark for every key and value by its dotted path."""

    data: Any
    text: str
    marks: dict[str, tuple[Mark | None, Mark]]  # of the key, of the value
    aliases: bool = False  # the text uses anchors

    def locate(self, path: str, at_key: bool = False) -> Mark | None:
        """The mark of a path, or of the nearest thing above it that stands in the text."""
        if path in self.marks:
            key, value = self.marks[path]
            return (key if at_key else None) or value
        while path:
            path = path[: max(path.rfind("."), path.rfind("["), 0)]
            if path in self.marks:
                key, value = self.marks[path]
                return key or value
        return None


@dataclass
class _Node:
    """A value under construction. items: (key or None, key's mark, node)."""

    kind: str  # scalar | mapping | list
    mark: Mark
    value: Any = None
    items: list[tuple[str | None, Mark | None, _Node]] = field(default_factory=list)
    size: int = 1  # values in it, aliases expanded
    depth: int = 1
    closed: bool = False
    key: tuple[str, Mark] | None = None  # a mapping's key that still waits for its value
    keys: dict[str, Mark] = field(default_factory=dict)  # a mapping's


def open_file(path: FilePath) -> BinaryIO:
    """A file to be read, at once: a pipe or a device would be waited for, perhaps for ever. Errors: `OSError`."""
    at_once = getattr(os, "O_NONBLOCK", 0)
    stream = open(path, "rb", opener=lambda name, flags: os.open(name, flags | at_once))  # noqa: SIM115 - handed on
    kind = os.fstat(stream.fileno()).st_mode
    if stat.S_ISREG(kind):
        return stream
    stream.close()
    what = "a pipe" if stat.S_ISFIFO(kind) else "a socket" if stat.S_ISSOCK(kind) else "a device"
    raise OSError(errno.EINVAL, f"this is {what}; expected a file")


def read_file(path: FilePath) -> str:
    """The text of a file.

    Errors: `InvalidProblemError` where there is no such file, or no text in it.
    """
    name = str(path)
    try:
        with open_file(path) as stream:
            raw = stream.read(LARGEST_FILE + 1)
    except FileNotFoundError:
        raise InvalidProblemError("no such file", file=name) from None
    except IsADirectoryError:
        raise InvalidProblemError("this is a folder; expected a problem file (YAML)", file=name) from None
    except PermissionError:
        raise InvalidProblemError("no permission to read this file", file=name) from None
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        reason = getattr(error, "strerror", None) or str(error)
        raise InvalidProblemError(f"cannot read this file: {reason}", file=name) from None
    if len(raw) > LARGEST_FILE:
        raise InvalidProblemError("larger than 1 MB; expected a problem file of a few kB", file=name)
    return _decode(raw, name)


def _decode(raw: bytes, name: str) -> str:
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise InvalidProblemError("the text is UTF-16; save it as UTF-8", file=name, line=1, column=1)
    try:
        text = raw.decode("utf-8")
    except UnicodeDecodeError as error:
        before = raw[: error.start].decode("utf-8")
        mark = _mark_at(before, len(before))
        raise InvalidProblemError(
            f"byte 0x{raw[error.start]:02x} is not UTF-8; expected a text file saved as UTF-8",
            file=name,
            line=mark.line,
            column=mark.column,
        ) from None
    return text.replace("\r\n", "\n")


def _mark_at(text: str, index: int) -> Mark:
    return Mark(text.count("\n", 0, index) + 1, index - (text.rfind("\n", 0, index) + 1) + 1)


@lru_cache(maxsize=8)  # a text is read again to see whether it still says what it said
def parse(text: str, file: str | None = None) -> Document:
    """The one mapping that a YAML text holds; read it, do not change it.

    Errors: `InvalidProblemError` with line and column.
    """
    text = text.removeprefix("\ufeff").encode("utf-8", "replace").decode("utf-8")  # no half surrogate pairs
    if found := _UNPRINTABLE.search(text):
        mark = _mark_at(text, found.start())
        raise InvalidProblemError(
            f"character U+{ord(found[0]):04X} has no place in a text file; expected YAML",
            file=file,
            line=mark.line,
            column=mark.column,
        )
    if len(text) > LARGEST_FILE:
        raise InvalidProblemError("larger than 1 MB; expected a problem file of a few kB", file=file)
    composer = _Composer(file)
    for event in _events(text, file):
        composer.take(event)
    root = composer.root
    if root is None or (root.kind == "scalar" and root.value is None):
        raise InvalidProblemError(
            "the file is empty; expected a problem such as `nhpocp init` writes", file=file, line=1, column=1
        )
    marks: dict[str, tuple[Mark | None, Mark]] = {}
    return Document(_plain(root, "", None, marks), text, marks, composer.aliases)


def _events(text: str, file: str | None) -> Iterator[Any]:
    from ruamel.yaml import YAML
    from ruamel.yaml.error import MarkedYAMLError, YAMLError

    try:
        yield from YAML(typ="safe", pure=True).parse(text)
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line, column = (mark.line + 1, mark.column + 1) if mark else (None, None)
        raise InvalidProblemError(_syntax(text, error, line), file=file, line=line, column=column) from None
    except (YAMLError, ValueError, ArithmeticError, LookupError, TypeError, AttributeError) as error:
        # the scanner's own slips on odd input, such as "\UFFFFFFFF"
        raise InvalidProblemError(f"this is not YAML ({type(error).__name__})", file=file) from None


def _syntax(text: str, error: Any, line: int | None) -> str:
    lines = text.split("\n")
    here = lines[line - 1] if line and line <= len(lines) else ""
    if "\t" in here[: len(here) - len(here.lstrip())] or "'\\t'" in str(error.problem):
        return "a tab in the indentation; YAML wants spaces"
    problem = " ".join(str(error.problem or error.context or "syntax error").split())
    context = f" {' '.join(str(error.context).split())}" if error.problem and error.context else ""
    return f"this is not YAML: {problem}{context}"


class _Composer:
    """Events in, a tree out; keeps every limit on the way."""

    def __init__(self, file: str | None) -> None:
        self.file, self.aliases = file, False
        self._stack: list[_Node] = []
        self._anchors: dict[str, _Node] = {}
        self._documents = 0
        self.root: _Node | None = None

    def _refuse(self, message: str, mark: Mark, path: str | None = None) -> InvalidProblemError:
        return InvalidProblemError(message, path=path, file=self.file, line=mark.line, column=mark.column)

    def take(self, event: Any) -> None:
        """One parser event."""
        kind, mark = type(event).__name__, Mark(event.start_mark.line + 1, event.start_mark.column + 1)
        if kind == "DocumentStartEvent":
            self._documents += 1
            if self._documents > 1:
                raise self._refuse("a second document begins here; expected one problem a file", mark)
        elif kind == "AliasEvent":
            self.aliases = True
            node = self._anchors.get(event.anchor)
            if node is None:
                raise self._refuse(f"no anchor &{event.anchor} stands before this alias", mark)
            if not node.closed:
                raise self._refuse(f"the alias *{event.anchor} contains itself", mark)
            self._attach(node, mark)
        elif kind == "ScalarEvent":
            if not event.value and not event.style and self._stack and self._stack[-1].key:
                mark = self._stack[-1].key[1]  # nothing stands nowhere: point at its key
            node = _Node("scalar", mark, self._scalar(event, mark), closed=True)
            self._remember(event, node)
            self._attach(node, mark, raw=event.value)
        elif kind in ("MappingStartEvent", "SequenceStartEvent"):
            expected = "mapping" if kind == "MappingStartEvent" else "list"
            self._check_tag(event, mark, ("map",) if expected == "mapping" else ("seq",))
            node = _Node(expected, mark)
            self._remember(event, node)
            self._stack.append(node)
            self._check_depth(node, mark)
        elif kind in ("MappingEndEvent", "SequenceEndEvent"):
            node = self._stack.pop()
            node.closed = True
            self._attach(node, node.mark)

    def _remember(self, event: Any, node: _Node) -> None:
        if event.anchor:
            self._anchors[event.anchor] = node

    def _check_tag(self, event: Any, mark: Mark, allowed: tuple[str, ...]) -> str | None:
        tag = str(event.tag) if event.tag else None
        if tag is None or tag == "!":
            return tag
        name = tag.removeprefix(_CORE)
        if name == tag or name not in allowed:
            raise self._refuse(f"the tag {tag.replace(_CORE, '!!')} means nothing here; remove it", mark)
        return name

    def _scalar(self, event: Any, mark: Mark) -> Any:
        if any("\ud800" <= character <= "\udfff" for character in event.value):
            raise self._refuse("half of a surrogate pair; expected a whole character", mark)
        tag = self._check_tag(event, mark, ("str", "int", "float", "bool", "null"))
        if tag in ("str", "!") or (tag is None and event.style):
            return event.value
        return resolve(event.value)

    def _check_depth(self, node: _Node, mark: Mark) -> None:
        if len(self._stack) + node.depth - 1 > DEEPEST:
            raise self._refuse(f"nested deeper than {DEEPEST} levels; a problem needs about 6", mark)

    def _attach(self, node: _Node, mark: Mark, raw: str | None = None) -> None:
        """Put a finished node where it belongs: as root, list item, key or value."""
        if not self._stack:
            self.root = node
            return
        parent = self._stack[-1]
        if parent.kind == "mapping" and parent.key is None:
            parent.key = (self._key(parent, node, mark, raw), mark)
            return
        name, place = parent.key or (None, None)
        # an alias stands where it is used, not where its anchor is
        used = node if node.mark == mark else _Node(**{**vars(node), "mark": mark})
        parent.items.append((name, place, used))
        parent.key = None
        parent.size += node.size + (name is not None)
        parent.depth = max(parent.depth, node.depth + 1)
        self._check_depth(parent, mark)
        if parent.size > LARGEST_TREE:
            raise self._refuse(
                f"expands to more than {LARGEST_TREE} keys and values; expected a short problem", mark
            )

    def _key(self, parent: _Node, node: _Node, mark: Mark, raw: str | None) -> str:
        if node.kind != "scalar":
            raise self._refuse(f"a {node.kind} as a key; expected a name", mark)
        name = raw if raw is not None else str(node.value)
        if place := parent.keys.get(name):
            path = ".".join([open_.key[0] for open_ in self._stack[:-1] if open_.key] + [name])
            raise self._refuse(f"duplicate key; first given in line {place.line}", mark, path)
        parent.keys[name] = mark
        return name


def resolve(text: str) -> Any:
    """What an unquoted scalar means by YAML 1.2's core schema."""
    if text in _WORDS:
        return _WORDS[text]
    if _INTEGER.fullmatch(text):
        return int(text) if len(text) < 300 else float(text)
    if _BASED.fullmatch(text):
        return int(text, 0)
    if _FLOAT.fullmatch(text):
        return float(text)
    if _INFINITE.fullmatch(text):
        return float(text.replace(".", ""))
    return text


def dotted(path: Iterable[str | int]) -> str:
    """("via", 0, "at") as via[0].at."""
    text = ""
    for part in path:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def _plain(node: _Node, path: str, key: Mark | None, marks: dict[str, tuple[Mark | None, Mark]]) -> Any:
    marks[path] = (key, node.mark)
    if node.kind == "mapping":
        before = f"{path}." if path else ""
        return {name: _plain(child, f"{before}{name}", place, marks) for name, place, child in node.items}
    if node.kind == "list":
        return [_plain(child, f"{path}[{i}]", None, marks) for i, (_, _, child) in enumerate(node.items)]
    return node.value
