"""Systems of other distributions, by their entry points in the group `nhpocp.systems`: name = "module:Class".

Asked only for a model that the registry does not have, and for lists of models: looking through every installed
distribution takes longer than checking a file. Loading one runs the code of a distribution that the user installed;
nothing that a problem file says is ever evaluated.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from nhpocp.errors import CallError, InvalidProblemError, one_line
from nhpocp.systems.system import System

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

GROUP = "nhpocp.systems"


def installed() -> dict[str, list[EntryPoint]]:
    """Every entry point of the group by its name, as many as claim it."""
    from importlib.metadata import entry_points  # a tenth of the time of `check`, which seldom needs it

    points: dict[str, list[EntryPoint]] = {}
    for point in sorted(entry_points(group=GROUP), key=lambda point: (point.name, point.value)):
        if point not in points.setdefault(point.name, []):  # a distribution may stand on the path twice
            points[point.name].append(point)
    return points


def load(points: list[EntryPoint]) -> type[System]:
    """The class of a model.

    Errors: `InvalidProblemError` at system.model where it cannot be imported, is no System, or is claimed twice.
    """
    point = points[0]
    if len(points) > 1:
        origins = " and ".join(origin(one) for one in points)
        raise _broken(f"{point.name!r} is the name of {origins}; uninstall one")
    try:
        cls = point.load()
    except Exception as error:
        raise _broken(f"{origin(point)} cannot be loaded: {one_line(error)}") from error
    if not (isinstance(cls, type) and System in cls.__mro__):
        raise _broken(f"{origin(point)} is no subclass of nhpocp.System")
    model = getattr(cls, "model", None)
    if model != point.name:
        raise _broken(
            f"{origin(point)} calls its model {model!r}; expected {point.name!r}, its entry point's name"
        )
    return cls


def made(cls: type[System], origin: str, **parameters: Any) -> System:
    """An instance of a class from elsewhere. Errors: `InvalidProblemError`, whatever its code raises."""
    try:
        return cls(**parameters)
    except CallError as error:
        raise _broken(f"{origin} fails: {error.message}") from error
    except InvalidProblemError:
        raise
    except Exception as error:
        raise _broken(f"{origin} fails: {one_line(error)}") from error


def origin(point: EntryPoint) -> str:
    """Where a system comes from."""
    package = f" of {point.dist.name} {point.dist.version}" if point.dist else ""
    return f"the plugin {point.value}{package}"


def _broken(message: str) -> InvalidProblemError:
    return InvalidProblemError(message, path="system.model")
