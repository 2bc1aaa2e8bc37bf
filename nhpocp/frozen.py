"""Objects that cannot change once they are made: what was worked out from one then stays right."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, ClassVar, NoReturn, Self, TypeVar

from nhpocp.constructed import Constructing, written
from nhpocp.errors import CallError, FrozenError, describe


class FixedDict(dict[Any, Any]):
    """A dict whose entries stay as they are; `copy()` and `{**it}` are ordinary ones."""

    def _refuse(self, *_: Any, **__: Any) -> NoReturn:
        raise FrozenError(
            f"these entries ({', '.join(map(str, self)) or 'none'}) are frozen once made; make a new object: "
            "replace(it, name={**it.name, 'entry': value})"
        )

    __setitem__ = __delitem__ = __ior__ = update = pop = popitem = clear = setdefault = _refuse

    def __reduce__(self) -> tuple[Any, ...]:
        return fixed, (dict(self),)  # arrays come back as ordinary ones


class FixedList(list[Any]):
    """A list whose items stay as they are; `copy()` and `list(it)` are ordinary ones."""

    def _refuse(self, *_: Any, **__: Any) -> NoReturn:
        raise FrozenError("this list is frozen once made; make a new object: replace(it, name=[...])")

    __setitem__ = __delitem__ = __iadd__ = __imul__ = append = extend = insert = _refuse
    pop = remove = clear = sort = reverse = _refuse

    def __reduce__(self) -> tuple[Any, ...]:
        return fixed, (list(self),)


def fixed(value: Any) -> Any:
    """A copy of a value that refuses to be changed in place: arrays, lists, mappings, sets, and what they hold.

    Objects of other classes are taken as they are.
    """
    if isinstance(value, FixedDict | FixedList):
        return value
    make = _FIXED.get(type(value))
    if make is not None:
        return make(value)
    numpy = sys.modules.get("numpy")  # not imported for what holds no array
    if (
        numpy is not None
        and type(value) is numpy.ndarray
        and (value.flags.writeable or value.base is not None)
    ):
        value = value.copy()
        value.flags.writeable = False
    return value


def _fixed_dict(value: Any) -> FixedDict:
    return FixedDict({key: fixed(entry) for key, entry in value.items()})


_FIXED: dict[type, Callable[[Any], Any]] = {
    dict: _fixed_dict,
    MappingProxyType: _fixed_dict,
    list: lambda value: FixedList(map(fixed, value)),
    tuple: lambda value: tuple(map(fixed, value)),
    set: frozenset,
}


class _Freezing(Constructing):
    """Freezes an object when the outermost ``__init__`` has finished, whatever that calls."""

    def __call__(cls, *args: Any, **kwargs: Any) -> Any:
        made = super().__call__(*args, **kwargs)
        if isinstance(made, Frozen):
            made._freeze()
        return made


class Frozen(metaclass=_Freezing):
    """Attributes are set by ``__init__``, and from then on they stay as they are."""

    noun: ClassVar[str] = "it"  # in messages

    def _freeze(self) -> None:
        """What is left to do once ``__init__`` has finished."""
        for name, value in self.__dict__.items():
            self.__dict__[name] = fixed(value)
        self.__dict__["_frozen"] = True

    def __repr__(self) -> str:
        return written(self)

    def __setattr__(self, name: str, value: Any) -> None:
        self._refuse_when_made(name)
        super().__setattr__(name, value)

    def __delattr__(self, name: str) -> None:
        self._refuse_when_made(name)
        super().__delattr__(name)

    def _refuse_when_made(self, name: str) -> None:
        if "_frozen" in self.__dict__:
            raise FrozenError(
                f"{type(self).__name__}.{name}: a {self.noun} is frozen once made; make a new one: "
                f"replace({self.noun}, {name}=...)"
            )

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update({name: fixed(value) for name, value in state.items()})

    def __copy__(self) -> Self:
        return self

    def with_(self, **changes: Any) -> Self:
        """A new object that differs in what is named."""
        return dataclasses.replace(self, **changes)  # type: ignore[type-var]


class ByValue:
    """A dataclass with arrays in it that equals its copies: compared, and hashed, by its fields."""

    def __eq__(self, other: object) -> bool:
        if self is other:
            return True
        if type(other) is not type(self):
            return NotImplemented
        return self._value == other._value

    def __hash__(self) -> int:
        return hash(self._value)

    @property
    def _value(self) -> tuple[Any, ...]:
        names = [field.name for field in dataclasses.fields(self) if field.compare]  # type: ignore[arg-type]
        return tuple(as_value(getattr(self, name)) for name in names)


def as_value(value: Any) -> Any:
    """What equals for equal values: tuples for arrays, lists and mappings; it has a hash where its parts have."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, Mapping):
        entries = [(str(key), as_value(entry)) for key, entry in value.items()]
        return "mapping", tuple(sorted(entries, key=lambda pair: pair[0]))
    if isinstance(value, list | tuple):
        return tuple(map(as_value, value))
    if isinstance(value, float) and value != value:
        return "NaN"
    if (known := getattr(value, "comparable", None)) is not None:
        return known
    return value


F = TypeVar("F")


def replace(made: F, **changes: Any) -> F:
    """A new system, problem, control or setting that differs in what is named: `replace(system, scale=0.5)`.

    made: any object that this package makes, which stays as it is. changes: the new values by the names of the
    constructor's arguments.
    Errors: `InvalidProblemError` where the changes do not fit; `CallError` for a name that is no argument.
    """
    if isinstance(made, Frozen):
        return made.with_(**changes)
    if not dataclasses.is_dataclass(made) or isinstance(made, type):
        raise CallError(f"expected a system, a problem, a control or a setting, got {describe(made)}")
    return dataclasses.replace(made, **changes)
