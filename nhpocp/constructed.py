"""Constructors that answer a wrong call in this package's own words: what came, what was expected, what to write."""

from __future__ import annotations

from abc import ABCMeta
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, Field
from inspect import Parameter, Signature, cleandoc, signature
from typing import Any

from nhpocp.errors import CallError, suggestion
from nhpocp.plain_text import as_call


class Constructing(ABCMeta):
    """The metaclass of `Constructed`; what is declared of fields, as by `nhpocp.declared`, goes into the manual."""

    def __init__(cls, name: str, bases: tuple[type, ...], members: dict[str, Any], **more: Any) -> None:
        super().__init__(name, bases, members, **more)
        # pinned, for @dataclass writes its own over one that is inherited
        cls.__repr__ = cls.__repr__  # type: ignore[method-assign]
        declared = {
            field: value.metadata["declared"].meaning
            for field, value in {**getattr(cls, "__dataclass_fields__", {}), **members}.items()
            if isinstance(value, Field) and "declared" in value.metadata
        }
        if declared and cls.__doc__:
            lines = [f"{field}: {meaning}" for field, meaning in declared.items()]
            add_to_manual(cls, lines, "a value that is none of these")

    def __call__(cls, *args: Any, **kwargs: Any) -> Any:
        try:
            return super().__call__(*args, **kwargs)
        except TypeError as error:
            if words := _misfit(cls, args, kwargs):
                raise CallError(words) from error
            raise

    @property
    def __signature__(cls) -> Signature:
        """That of ``__init__``, for `help`; else `inspect` shows that of this class's ``__call__``."""
        own = signature(cls.__init__)  # type: ignore[misc]
        return own.replace(parameters=list(own.parameters.values())[1:])


class Constructed(metaclass=Constructing):
    """A class whose constructor says which arguments it takes, as `CallError`, where it is given others."""

    def __repr__(self) -> str:
        return written(self)


def written(made: Any) -> str:
    """An object as one would write it, in one line: its class, and the arguments that say something."""
    cls = type(made)
    fields: Mapping[str, Any] = getattr(cls, "__dataclass_fields__", {})

    def default(argument: Parameter) -> Any:
        own = fields.get(argument.name)
        return argument.default if own is None or own.default_factory is MISSING else own.default_factory()

    given = [p for p in cls.__signature__.parameters.values() if hasattr(made, p.name)]
    return as_call(cls.__name__, [(p.name, getattr(made, p.name), default(p)) for p in given])


def add_to_manual(cls: type, parameters: Sequence[str], wrong: str) -> None:
    """Adds lines on parameters to a class's docstring, and for what it raises an error."""
    text = cleandoc(cls.__doc__ or "")
    errors = "" if "Errors:" in text else f"\nErrors: `InvalidProblemError` for {wrong}."
    cls.__doc__ = "\n".join([text, "", *parameters]) + errors


def _misfit(cls: Any, args: Sequence[Any], kwargs: Mapping[str, Any]) -> str:
    """Why a class cannot be called so, in words; empty where it can."""
    if left := sorted(getattr(cls, "__abstractmethods__", ())):
        return f"{cls.__name__} is a contract; derive a class from it that has {', '.join(left)}, or use one that has"
    parameters = cls.__signature__.parameters
    try:
        cls.__signature__.bind(*args, **kwargs)
    except TypeError as error:
        fault = str(error)
    else:
        return ""
    known = [name for name, p in parameters.items() if p.kind not in (p.VAR_KEYWORD, p.VAR_POSITIONAL)]
    shown = ", ".join(known) or "none"
    for name in kwargs:
        if name not in known:
            return f"{cls.__name__} has no argument {name!r}; {suggestion(name, known)}"
    placed = [
        p
        for p in parameters.values()
        if p.kind in (Parameter.POSITIONAL_ONLY, Parameter.POSITIONAL_OR_KEYWORD)
    ]
    if len(args) > len(placed):
        by_name = " by name: " if len(placed) < len(known) else ": "
        return (
            f"{cls.__name__} was given {len(args)} arguments without names; its arguments are{by_name}{shown}"
        )
    return f"{cls.__name__}: {fault}; its arguments are {shown}"
