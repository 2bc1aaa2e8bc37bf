"""The errors a user can meet. Each message says what came, what was expected, what to write instead."""

from __future__ import annotations


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
    """A problem, a setting or a file that cannot be used as it stands."""


class FrozenError(NhpocpError, AttributeError, TypeError):
    """An attempt to change what is frozen once made."""


class OrientationAtPiError(NhpocpError, ValueError):
    """The logarithm of a half turn: its axis has two signs, so the error of orientation has no direction."""


class TooLargeError(NhpocpError, MemoryError):
    """More memory would be needed than there is; the message says how much, and what for."""


class UnreadableSolutionError(LocatedError):
    """A folder that is not a solution folder, or one that was damaged."""


class MissingDependencyError(NhpocpError, ImportError):
    """An optional part that is not installed; the message says how to install it."""
