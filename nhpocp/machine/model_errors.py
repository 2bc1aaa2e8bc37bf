"""How far a machine may be from its model: a stated error for some of its parameters, or of its inputs."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from math import pi
from typing import Any

import numpy as np

from nhpocp.arrays import Array
from nhpocp.errors import InvalidProblemError
from nhpocp.systems.system import System
from nhpocp.written_numbers import parse_number

NUMBERS = ("number", "positive", "numbers", "vector")  # kinds of parameters that a machine can miss
PATH = "--error"


@dataclass(frozen=True)
class ModelError:
    """Of one parameter, or of one input: an amount [its unit], or a fraction of its value where it is ``relative``."""

    name: str
    amount: float
    relative: bool
    words: str  # as it was written


@dataclass(frozen=True)
class ModelErrors:
    """Errors by parameter; for systems that are told inputs, of inputs too: what the machine makes of them."""

    system: System
    errors: tuple[ModelError, ...]

    @classmethod
    def parsed(cls, text: str, system: System) -> ModelErrors:
        """From "roller_tilt=2deg,base_radius=1%"; a percentage alone, "2%", is of every number, and of angles degrees.

        Errors: `InvalidProblemError` for a name that is none, or an amount that is none.
        """
        known = _values(system)
        parts = [part.strip() for part in text.split(",") if part.strip()]
        if len(parts) == 1 and "=" not in parts[0]:
            return cls.of_all(_percentage(parts[0]), system)
        errors: list[ModelError] = []
        for part in parts:
            name, equals, amount = (piece.strip() for piece in part.partition("="))
            if name not in known:
                words = f"{name!r} is no number of {system.model}"
                raise InvalidProblemError(words, path=PATH, word=name, known=known)
            if any(error.name == name for error in errors):
                raise InvalidProblemError(f"{name} is given twice", path=PATH)
            errors.append(_error(name, amount if equals else "", relative_only=name in _inputs(system)))
        return cls(system, tuple(errors))

    @classmethod
    def of_all(cls, percentage: float, system: System) -> ModelErrors:
        """So many per cent of every parameter, of angles so many degrees; where there is none, of every input."""
        units = {name: parameter.unit for name, parameter in system.declared.items()}
        inputs = _inputs(system)
        names = [name for name in _values(system) if name not in inputs] or list(inputs)
        errors = (
            ModelError(name, percentage * pi / 180, False, f"{percentage:g} deg")
            if units.get(name) == "angle"
            else ModelError(name, percentage / 100, True, f"{percentage:g} %")
            for name in names
        )
        return cls(system, tuple(errors))

    def machine(
        self, fractions: Mapping[str, Any] | None = None
    ) -> tuple[System, Array | None, dict[str, Any]]:
        """A machine that is wrong by these fractions of the errors, from -1 to 1 (all of them unless given).

        Its system, the gains of its inputs (None: 1), and the values that are wrong, by name.
        """
        values, inputs = _values(self.system), _inputs(self.system)
        wrong: dict[str, Any] = {}
        for error in self.errors:
            value = np.asarray(values[error.name], dtype=float)
            fraction = 1.0 if fractions is None else np.asarray(fractions[error.name])
            wrong[error.name] = value + fraction * error.amount * (value if error.relative else 1.0)
        wrong = {name: value.tolist() for name, value in wrong.items()}
        parameters = {name: value for name, value in wrong.items() if name not in inputs}
        gains = np.array([wrong.get(name, 1.0) for name in inputs]) if set(wrong) & set(inputs) else None
        try:
            return self.system.with_(**parameters), gains, wrong
        except InvalidProblemError as error:
            raise InvalidProblemError(f"no machine of these errors: {error}", path=PATH) from error

    def drawn(self, random: np.random.Generator) -> tuple[System, Array | None, dict[str, Any]]:
        """A random `machine`, each number uniformly up to its error."""
        values = _values(self.system)
        shapes = {error.name: np.shape(values[error.name]) for error in self.errors}
        return self.machine({name: random.uniform(-1.0, 1.0, shape) for name, shape in shapes.items()})

    @property
    def words(self) -> str:
        return ", ".join(f"{error.name} {error.words}" for error in self.errors) or "none"


def _inputs(system: System) -> list[str]:
    """Names of the inputs that a machine is told itself; none where it is told positions."""
    import casadi as ca

    positions = system.actuator_positions(ca.SX.sym("x", system.state_space.size))
    return [] if positions is not None else list(system.input_space.labels)


def _values(system: System) -> dict[str, Any]:
    """Every number that a machine may miss: parameters, and 1 for the gain of each input."""
    kinds = {name: parameter.kind for name, parameter in system.declared.items() if parameter.of_motion}
    given = {name: value for name, value in system.parameters().items() if kinds.get(name) in NUMBERS}
    return {**given, **dict.fromkeys(_inputs(system), 1.0)}


def _error(name: str, amount: str, relative_only: bool) -> ModelError:
    wanted = "such as 1%" if relative_only else "such as 1%, 2deg or 0.3"
    if amount.endswith("%"):
        return ModelError(name, _percentage(amount) / 100, True, f"{_percentage(amount):g} %")
    if relative_only:
        words = f"{name}={amount}: expected what the machine makes more or less of this input, {wanted}"
        raise InvalidProblemError(words, path=PATH)
    text = re.sub(r"(?<=[0-9.])deg$", " deg", amount)
    try:
        return ModelError(name, _number(text), False, text)
    except ValueError as error:
        words = f"{name}={amount}: expected an amount {wanted}" if not amount else f"{name}={amount}: {error}"
        raise InvalidProblemError(words, path=PATH) from None


def _percentage(text: str) -> float:
    try:
        return _number(text.removesuffix("%").strip() if text.endswith("%") else "")
    except ValueError:
        words = f"{text!r}; expected NAME=AMOUNT,… such as roller_tilt=2deg,base_radius=1%, or 2% for every number"
        raise InvalidProblemError(words, path=PATH) from None


def _number(text: str) -> float:
    try:
        return parse_number(float(text))
    except ValueError:
        return parse_number(text)
