"""A system tried out before any solver meets it: its equations as numbers and as symbols, and their shapes."""

from __future__ import annotations

from typing import Any

import numpy as np

from nhpocp.arrays import Array, namespace
from nhpocp.errors import InvalidProblemError, one_line
from nhpocp.kept import kept
from nhpocp.systems.system import System


def try_out(system: System, point: Array) -> None:
    """Asks a system for its velocity at a packed state (size,), in numbers and in symbols.

    Errors: `InvalidProblemError` at system.model where the equations fail, are of other shapes than (dimension, inputs)
    and (dimension,), or say one thing to NumPy and another to CasADi.
    """
    _tried_out(system, tuple(map(float, point)))


@kept(most=64)
def _tried_out(system: System, numbers: tuple[float, ...]) -> None:
    from nhpocp.systems.numeric import numeric_system

    point = np.array(numbers)
    dimension, inputs = system.state_space.dimension, system.input_space.size
    with np.errstate(all="ignore"):
        fields = _asked(system, "numbers", lambda: namespace(point).array(system.vector_fields(point)))
        _expect_shape(system, "vector_fields", np.shape(fields), (dimension, inputs))
        drift = _asked(system, "numbers", lambda: namespace(point).array(system.drift(point)))
        _expect_shape(system, "drift", np.shape(drift), (dimension,))
        control = np.ones(inputs)
        velocity = _asked(system, "numbers", lambda: np.asarray(system.velocity(point, control), dtype=float))
        rate = _asked(
            system,
            "symbols",
            lambda: np.array(numeric_system(system).rate_function(point, control)).ravel(),
        )
        agree = velocity.shape == (dimension,) and np.allclose(
            rate, np.asarray(system.state_space.lift(point, velocity)), equal_nan=True
        )
    if not agree:  # float() of a CasADi symbol is NaN and no error
        fault = (
            f"the velocity of {system.model} at the start is {velocity} in NumPy's numbers, but CasADi's expressions "
            f"give the rate {rate}; expected the same, {dimension} numbers of velocity"
        )
        raise InvalidProblemError(fault, path="system.model")


def _asked(system: System, kind: str, ask: Any) -> Any:
    try:
        return ask()
    except InvalidProblemError:
        raise
    except NotImplementedError as error:
        words = f"{error}; write it: G(x), {system.state_space.dimension} × {system.input_space.size}"
        raise InvalidProblemError(words, path="system.model") from error
    except Exception as error:  # foreign equations may raise anything
        hint = (
            "; they have to take symbols too: write xp = namespace(state) and xp.cos instead of math.cos or numpy.cos"
            if kind == "symbols"
            else ""
        )
        words = f"the equations of {system.model} fail at the start, for {kind}: {one_line(error)}{hint}"
        raise InvalidProblemError(words, path="system.model") from error


def _expect_shape(system: System, name: str, came: tuple[int, ...], wanted: tuple[int, ...]) -> None:
    if came != wanted:
        meaning = (
            "one row per tangent number and one column per input" if len(wanted) == 2 else "tangent numbers"
        )
        words = (
            f"the equations of {system.model} fail at the start: {name}(state) is of shape {came}; expected {wanted}, "
            f"{meaning}"
        )
        raise InvalidProblemError(words, path="system.model")
