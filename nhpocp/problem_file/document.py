"""A YAML document as plain data that knows the line and column of everything in it."""

from __future__ import annotations

import errno
import os
import re
import stat
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, BinaryIO

from nhpocp.errors import InvalidProblemError

if TYPE_CHECKING:
    from nhpocp.problem_file.composing import Mark, Tree

LARGEST_FILE = 1_000_000  # bytes

_UNPRINTABLE = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x84\x86-\x9f\ufffe\uffff]")


@dataclass(frozen=True)
class Document:
    """Plain data, and a mark for every key and value by its dotted path."""

    text: str
    data: Any
    marks: dict[str, tuple[Mark | None, Mark]]  # of the key, of the value

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
        line, column = _place(before, len(before))
        words = f"byte 0x{raw[error.start]:02x} is not UTF-8; expected a text file saved as UTF-8"
        raise InvalidProblemError(words, file=name, line=line, column=column) from None
    return text.replace("\r\n", "\n")


def _place(text: str, index: int) -> tuple[int, int]:
    """Line and column, from 1."""
    return text.count("\n", 0, index) + 1, index - (text.rfind("\n", 0, index) + 1) + 1


@lru_cache(maxsize=8)  # a text is read again to see whether it still says what it said
def parse(text: str, file: str | None = None) -> Document:
    """The one document that a YAML text holds; read it, do not change it.

    Errors: `InvalidProblemError` with line and column.
    """
    return Document(text, *read_tree(text, file).plain())


def read_tree(text: str, file: str | None, comments: bool = False) -> Tree:
    """The nodes of a YAML text; with ``comments`` they can be written again.

    Errors: `InvalidProblemError` with line and column.
    """
    from nhpocp.problem_file.composing import Tree  # and ruamel

    text = text.removeprefix("\ufeff").encode("utf-8", "replace").decode("utf-8")  # no half surrogate pairs
    if odd := _UNPRINTABLE.search(text):
        line, column = _place(text, odd.start())
        words = f"character U+{ord(odd[0]):04X} has no place in a text file; expected YAML"
        raise InvalidProblemError(words, file=file, line=line, column=column)
    if len(text) > LARGEST_FILE:
        raise InvalidProblemError("larger than 1 MB; expected a problem file of a few kB", file=file)
    return Tree(text, file, comments)


def dotted(path: Iterable[str | int]) -> str:
    """("via", 0, "at") as via[0].at."""
    text = ""
    for part in path:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text
