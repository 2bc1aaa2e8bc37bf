"""What is worked out from an object lies with it: made once, and gone when the object goes."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import wraps
from typing import Any, Protocol, TypeVar
from weakref import ref

R = TypeVar("R", covariant=True)


class Keeping(Protocol[R]):
    """A function whose results are kept with its first argument."""

    def __call__(self, owner: Any, *rest: Any) -> R: ...

    def cache_clear(self) -> None:
        """Lets go of every result."""
        ...


class Kept(dict[Any, Any]):
    """Results by the further arguments; with a copied or pickled owner there are none yet."""

    def __reduce__(self) -> tuple[Any, ...]:
        return Kept, ()


def kept(
    most: int, size: Callable[[Any], int] = lambda result: 1
) -> Callable[[Callable[..., R]], Keeping[R]]:
    """`functools.lru_cache` for a function of an owner and what tells its results apart, without holding the owner.

    ``most``: results that are kept, of all owners together, or the sum of what their ``size`` says, but always the
    last; those of owners that have gone count until their turn.
    Owners need no hash: each keeps its own, and an owner that equals another has results of its own.
    """

    def decorate(make: Callable[..., R]) -> Keeping[R]:
        slot = f"{make.__module__}.{make.__qualname__}, kept"
        made: deque[tuple[ref[Any], tuple[Any, ...], int]] = deque()

        @wraps(make)
        def looked_up(owner: Any, *rest: Any) -> R:
            try:
                return owner.__dict__[slot][rest]
            except KeyError:
                pass
            result = make(owner, *rest)
            owner.__dict__.setdefault(slot, Kept())[rest] = result
            made.append((ref(owner), rest, size(result)))
            while len(made) > 1 and sum(each for _, _, each in list(made)) > most:
                let_go_of_first()
            return result

        def let_go_of_first() -> None:
            with suppress(IndexError):  # another thread was quicker
                owner, rest, _ = made.popleft()
                getattr(owner(), "__dict__", {}).get(slot, {}).pop(rest, None)

        def cache_clear() -> None:
            while made:
                let_go_of_first()

        keeping: Any = looked_up
        keeping.cache_clear = cache_clear
        return keeping

    return decorate


def let_go(owner: Any) -> None:
    """Drops all that is kept with an object, to be made again when it is asked for."""
    for name in [name for name, value in owner.__dict__.items() if isinstance(value, Kept)]:
        owner.__dict__.pop(name, None)
