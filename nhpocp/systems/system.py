"""The contract of a control system: its names, its parameters, its vector fields."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, Protocol, Self

from nhpocp.arrays import Array, symbolic
from nhpocp.state_space import Block, StateSpace


@dataclass(frozen=True)
class Parameter:
    """A parameter as a user writes it: what kind of value, its default, what it means."""

    kind: Literal["number", "positive", "integer", "numbers", "choice", "legs"]
    default: Any
    meaning: str
    choices: tuple[str, ...] = ()


class System(Protocol):
    r"""A driftless control system  ẋ = G(x) u  on a `StateSpace`.

    x is a packed point, u a packed input; G(x) has one row per tangent number (rotations: angular velocity in base
    coordinates) and one column per input number. Everything works for numbers (NumPy) and for CasADi symbols.
    Subclass it, declare the class variables, and write `vector_fields`.
    """

    model: ClassVar[str]
    declared: ClassVar[Mapping[str, Parameter]]
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {}
    pose_outputs: ClassVar[
        tuple[Block, ...]
    ] = ()  # those of `outputs` that depend on x alone: they may be goals

    state_space: StateSpace
    input_space: StateSpace

    @classmethod
    def preset(cls, name: str, **parameters: Any) -> Self:
        """The system with a named set of parameters; further parameters override it."""
        return cls(**{**cls.presets[name], **parameters})

    def __hash__(self) -> int:
        return id(self)  # what is made for a system is kept beside it

    def parameters(self) -> dict[str, Any]:
        """Every parameter as plain JSON data; ``type(self)(**self.parameters())`` is the same system."""
        ...

    def vector_fields(self, state: Array) -> Array:
        """G(x), dimension × inputs."""
        ...

    def velocity(self, state: Array, control: Array) -> Array:
        """The tangent vector G(x) u (dimension,)."""
        return self.vector_fields(state) @ control

    def rate(self, state: Array, control: Array) -> Array:
        """ẋ of the packed point (size,)."""
        return self.state_space.lift(state, self.velocity(state, control))

    def linearised(self, state: Array, control: Array) -> tuple[Array, Array]:
        """∂velocity/∂x over the packed point (dimension × size) and ∂velocity/∂u, for SX symbols.

        Override it where the equations' structure makes the derivative cheaper than differentiating `velocity`.
        """
        xp, velocity = symbolic(), self.velocity(state, control)
        return xp.jacobian(velocity, state), xp.jacobian(velocity, control)

    def outputs(self, state: Array, control: Array) -> dict[str, Array]:
        """Named quantities worth plotting or bounding, besides states and inputs."""
        return {}

    def output(self, name: str, state: Array, control: Array) -> Array:
        """One of `outputs`; override it where there is a shorter way than making them all."""
        return self.outputs(state, control)[name]

    def regularity(self, state: Array) -> dict[str, Array]:
        """Square matrices by name whose singularity breaks the model or the machine, in the system's own units."""
        return {}

    def column_scales(self, name: str, length_scale: float) -> list[float]:
        """Divisors of the columns of the regularity matrix ``name``, which make σ_min comparable across units."""
        return []

    def breaking(self) -> tuple[str, ...]:
        """Names of the regularity matrices that these equations invert: no path of this system crosses their zero."""
        return ()

    def separating(self) -> tuple[str, ...]:
        """Names of the regularity matrices whose zero no path of the machine may cross for good."""
        return self.breaking()

    def default_length_scale(self) -> float:
        """A typical length of the mechanism, which turns rotations into lengths."""
        return 1.0

    def input_label(self) -> str | list[str]:
        """How a solution file names the control."""
        return list(self.input_space.names)

    def drawing(self, state: Array) -> dict[str, Any]:
        """Plain arrays for pictures: ``{"lines": {name: (n, 3)}, "points": {name: (n, 3)}}``."""
        return {"lines": {}, "points": {}}
