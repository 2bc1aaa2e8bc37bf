"""Mappings whose entries are worked out when they are first looked at: what a sweep never asks for costs it nothing."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import cached_property
from typing import Any

from nhpocp.errors import UnknownNameError, suggestion
from nhpocp.plain_text import brief


class Named(dict[str, Any]):
    """A dict that answers a name it does not have with those that it has."""

    def __missing__(self, name: str) -> Any:
        raise UnknownNameError(f"there is no {name!r} here; {suggestion(str(name), self)}")

    def __repr__(self) -> str:
        return f"{{{', '.join(f'{name!r}: {brief(value)}' for name, value in self.items())}}}"


class Deferred(Mapping[str, Any]):
    """``known`` entries at once, those of ``rest()`` on demand; copied or pickled, a dict of them all."""

    def __init__(self, rest: Callable[[], Mapping[str, Any]], known: Mapping[str, Any] | None = None) -> None:
        self._make, self._known = rest, dict(known or {})

    @cached_property
    def _rest(self) -> Mapping[str, Any]:
        return self._make()

    @cached_property
    def _whole(self) -> Named:
        return Named({**self._known, **self._rest, **self._known})

    def __getitem__(self, name: str) -> Any:
        return self._known[name] if name in self._known else self._whole[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._whole)

    def __len__(self) -> int:
        return len(self._whole)

    def __or__(self, more: Mapping[str, Any]) -> Deferred:
        """With further known entries, or others in place of these."""
        return Deferred(lambda: self._rest, {**self._known, **more})

    def __ior__(self, more: Mapping[str, Any]) -> Deferred:
        self._known |= more
        self.__dict__.pop("_whole", None)
        return self

    def __repr__(self) -> str:
        if "_whole" in self.__dict__:
            return repr(self._whole)
        known = ", ".join(f"{name!r}: {brief(value)}" for name, value in self._known.items())
        return f"{{{known}, …}}" if known else "{…}"

    def __reduce__(self) -> tuple[type[Named], tuple[dict[str, Any]]]:
        return Named, (dict(self),)


def extended(record: Mapping[str, Any], **more: Any) -> Mapping[str, Any]:
    """A record with further entries; what is deferred stays so."""
    return record | more if isinstance(record, Deferred) else {**record, **more}


def at_hand(record: Mapping[str, Any]) -> Mapping[str, Any]:
    """The entries of a record that cost nothing to look at; to ask the record itself for one that is absent does."""
    return record._known if isinstance(record, Deferred) else record
