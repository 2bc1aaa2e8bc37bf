"""The errors a user can meet. Each message says what came, what was expected, what to write instead."""

from __future__ import annotations

import copy
import difflib
from collections.abc import Iterable, Sequence
from typing import Any


class NhpocpError(Exception):
    """Base of every error that nhpocp raises on purpose."""


class LocatedError(NhpocpError, ValueError):
    """Something wrong at a place.

    ``file``, ``line``, ``column`` (both from 1) and ``path`` (dotted key) say where, as far as they are known.
    """

    def __init__(
        self,
        message: str,
        *,
        path: str | None = None,
        file: str | None = None,
        line: int | None = None,
        column: int | None = None,
    ) -> None:
        super().__init__(message)
        self.message, self.path, self.file, self.line, self.column = message, path, file, line, column

    def __str__(self) -> str:
        return ": ".join(part for part in (self.place, self.path, self.message) if part)

    @property
    def place(self) -> str:
        """file:line:column, as far as known."""
        return ":".join(str(part) for part in (self.file, self.line, self.column) if part is not None)


class InvalidProblemError(LocatedError):
    """A problem, a setting or a file that cannot be used as it stands.

    at_key: whether the path's last key is the mistake, and not its value. known: the names that ``word`` may have been
    meant as; they are compared when the message is read, since of thousands of errors few are told. elsewhere: whole
    paths at which the word is a key. others: what is wrong beside this, found at the same time; where they are
    ``counted`` the message says how many there are.
    """

    def __init__(
        self,
        message: str,
        *,
        at_key: bool = False,
        word: str | None = None,
        known: Iterable[str] = (),
        **place: Any,
    ) -> None:
        super().__init__(message, **place)
        self.at_key = at_key or word is not None
        self.word, self._known = word, tuple(known)
        self.elsewhere: Sequence[str] = ()
        self.others: tuple[InvalidProblemError, ...] = ()
        self.counted, self.note = False, ""

    @property
    def message(self) -> str:
        more = f" (and {len(self.others)} more)" if self.counted else ""
        if self.word is None:
            return f"{self.plain}{self.note}{more}"
        meant = " or ".join(map(repr, self.elsewhere))
        hint = f"did you mean {meant}?" if meant else suggestion(self.word, self._known)
        return f"{self.plain}; {hint}{self.note}{more}"

    @message.setter
    def message(self, words: str) -> None:
        self.plain = words

    @property
    def each(self) -> tuple[InvalidProblemError, ...]:
        """This and the others, each by itself."""
        return self.changed(counted=False), *self.others

    def changed(self, **values: Any) -> InvalidProblemError:
        """A copy with other attributes, such as file, line and column."""
        twin = copy.copy(self)
        for name, value in values.items():
            setattr(twin, name, value)
        return twin

    def under(self, prefix: str) -> InvalidProblemError:
        """This error, its path counted from further up."""
        between = "." if self.path and not self.path.startswith("[") else ""
        self.path = f"{prefix}{between}{self.path or ''}"
        return self


def refuse(errors: Sequence[InvalidProblemError]) -> None:
    """Raises the first of several errors, which knows the others; nothing where there is none."""
    if errors:
        errors[0].others = tuple(errors[1:])
        raise errors[0]


class FrozenError(NhpocpError, AttributeError, TypeError):
    """An attempt to change what is frozen once made."""


class UnknownNameError(NhpocpError, AttributeError, KeyError):
    """A name that is none of those that there are: an entry of a trajectory, a public name, a function."""

    def __str__(self) -> str:
        return str(self.args[0])  # a KeyError would say its repr


class CallError(InvalidProblemError, TypeError):
    """A constructor or function called with arguments that it does not take."""


class NhpocpWarning(UserWarning):
    """What is legal and hardly meant, as `nhpocp check` says it: `path: what is doubtful; what to write`."""


class OrientationAtPiError(NhpocpError, ValueError):
    """The logarithm of a half turn: its axis has two signs, so the error of orientation has no direction."""


class TooLargeError(NhpocpError, MemoryError):
    """More memory would be needed than there is; the message says how much, and what for."""


class UnreadableSolutionError(LocatedError):
    """A folder that is not a solution folder, or one that was damaged."""


class MissingDependencyError(NhpocpError, ImportError):
    """An optional part that is not installed; the message says how to install it."""


def describe(value: Any) -> str:
    """A value in plain words, for error messages."""
    if value is None:
        return "nothing"
    if isinstance(value, type):
        return f"the class {value.__name__}"
    if isinstance(value, bool):
        return f"the truth value {str(value).lower()}"
    if isinstance(value, int | float):
        return f"the number {value:.12g}" if abs(value) < 1e300 else "a number too large"
    if isinstance(value, str):
        return f"the text {value!r}" if len(value) <= 40 else f"the text {value[:37]!r}…"
    if isinstance(value, list):
        return f"a list of {len(value)}"
    if isinstance(value, tuple):
        return f"a tuple of {len(value)}"
    if type(value).__module__ == "numpy" and hasattr(value, "shape"):
        return f"an array of shape {value.shape}" if value.shape else describe(value.item())
    return "a mapping" if isinstance(value, dict) else f"a {type(value).__name__}"


def one_line(error: BaseException) -> str:
    """An exception of foreign code in one line."""
    lines = str(error).strip().splitlines()
    return f"{type(error).__name__}: {lines[0]}" if lines else type(error).__name__


def expect(value: Any, kinds: type | tuple[type, ...], wanted: str, path: str | None = None) -> None:
    """Refuses what is no instance of the ``kinds``; ``wanted``: what is expected, in words.

    Errors: `CallError` with what came; a class where its instance is meant is named.
    """
    if isinstance(value, kinds):
        return
    meant = isinstance(value, type) and issubclass(value, kinds)
    hint = f"; write {value.__name__}(…)" if meant else ""
    raise CallError(f"expected {wanted}, got {describe(value)}{hint}", path=path)


def nearest(word: str, known: Iterable[str]) -> str:
    """The known word that was probably meant; empty where none is near."""
    lower = {each.lower(): each for each in known}
    near = difflib.get_close_matches(word.lower(), lower, n=1, cutoff=0.6)
    return lower[near[0]] if near else ""


def suggestion(word: str, known: Iterable[str], none: str = "") -> str:
    """The nearest known word as a question, else all of them, or what is said where there is ``none`` near."""
    known = list(known)
    if near := nearest(word, known):
        return f"did you mean {near!r}?"
    if none:
        return none
    return f"expected one of {', '.join(known)}" if known else "no key is expected here"
