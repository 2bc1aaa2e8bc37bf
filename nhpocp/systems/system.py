"""The contract of a control system: its names, its parameters, its vector fields."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from inspect import Parameter as SignatureParameter
from inspect import signature
from typing import TYPE_CHECKING, Any, ClassVar, Self

from nhpocp.arrays import Array, namespace, symbolic
from nhpocp.bodies.surroundings import Surroundings
from nhpocp.constructed import add_to_manual
from nhpocp.errors import CallError, InvalidProblemError, expect, suggestion
from nhpocp.frozen import Frozen, as_value
from nhpocp.kept import Kept, kept
from nhpocp.plain_text import as_call
from nhpocp.shown import Shown
from nhpocp.state_space import Block, StateSpace, check_distinct, scalar, vector
from nhpocp.systems.leg_accelerations import LEG_ACCELERATIONS, acceleration_blocks
from nhpocp.systems.margins import margin
from nhpocp.systems.parameter import Parameter as Parameter

if TYPE_CHECKING:
    from nhpocp.bodies.hull import Hull
    from nhpocp.bodies.obstacles import Obstacle
    from nhpocp.systems.chained_form import ChainedForm


DISTANCE = "distance"  # of a system's bodies, among the quantities of a trajectory
_COLLECTED = SignatureParameter.VAR_POSITIONAL, SignatureParameter.VAR_KEYWORD

# names that stand for something else in a trajectory, or in the archive that holds its arrays
RESERVED = ("t", "file", "allow_pickle", DISTANCE, LEG_ACCELERATIONS)


def check_names(parts: Sequence[tuple[str, Block]]) -> None:
    """Errors: `InvalidProblemError` where a part of a trajectory has a name that something else has.

    parts: what it is, and its block.
    """
    check_distinct(parts)
    for what, block in parts:
        if what != "margin" and (block.name in RESERVED or margin(block.name)):
            raise InvalidProblemError(
                f"{what} {block.name!r} is called like something else: {', '.join(RESERVED)}, and what begins with "
                "sigma_ or det_, have a meaning of their own in every trajectory; rename it"
            )


def _blocks(system: System, space: str) -> Sequence[Block]:
    return getattr(getattr(system, space, None), "blocks", ())


class System(Frozen, Shown):
    r"""A control system  ẋ = f(x) + G(x) u  on a `StateSpace`, driftless where f = 0.

    x is a packed point, u a packed input; G(x) has one row per tangent number (rotations: angular velocity in base
    coordinates) and one column per input number. Everything works for numbers (NumPy) and for CasADi symbols.
    Subclass it, declare the class variables, and write `vector_fields`; where there is a drift f, `drift`. Attributes
    are set in ``__init__``; once that has finished a system is frozen, and `with_` makes another.
    """

    noun: ClassVar[str] = "system"
    model: ClassVar[str]
    declared: ClassVar[Mapping[str, Parameter]] = {}
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {}
    # what `outputs` gives; None: nothing is known of it but the shapes, once a problem is built
    output_blocks: Sequence[Block] | None = None

    # LaTeX of the two numbers that `drawing` shows against each other, where these are no places in the plane
    plotted: Sequence[str] = ()

    # a task with the default parameters, for `nhpocp init`: `start`, `goal` and, where the control to begin with
    # matters, `control`, as a problem file writes them
    example: ClassVar[Mapping[str, Any]] = {}

    state_space: StateSpace
    input_space: StateSpace
    surroundings: Surroundings | None = None  # set by `among`
    rest: tuple[float, ...] | None = None  # set by `resting`
    rest_blocks: Sequence[Block] = ()  # what `from_rest` gives
    accelerated: bool = False  # set by `accelerating`

    def __init_subclass__(cls, **more: Any) -> None:
        super().__init_subclass__(**more)
        if "declared" in vars(cls) and cls.__doc__:
            lines = [
                f"{name}: {', '.join([parameter.described, *parameter.choices])}"
                for name, parameter in cls.declared.items()
            ]
            lines += [f"Presets: {', '.join(cls.presets)}"] if cls.presets else []
            add_to_manual(cls, lines, "a parameter that it does not have, or a value that is none")

    @classmethod
    def preset(cls, name: str, **parameters: Any) -> Self:
        """The system with a named set of parameters; further parameters override it."""
        if name not in cls.presets:
            near = suggestion(str(name), cls.presets) if cls.presets else f"{cls.model} has no presets"
            raise InvalidProblemError(f"unknown preset {name!r}; {near}", path="system.preset")
        return cls(**{**cls.presets[name], **parameters})

    def __init__(self, **parameters: Any) -> None:
        """Every declared parameter becomes an attribute, checked; what is left out has its default."""
        self._declare(parameters)

    def _declare(self, parameters: Mapping[str, Any]) -> None:
        unknown = [name for name in parameters if name not in self.declared]
        if unknown:
            known = ", ".join(self.declared) or "none"
            raise InvalidProblemError(
                f"unknown parameter; {self.model} has {known}", path=f"system.{unknown[0]}"
            )
        for name, parameter in self.declared.items():
            setattr(self, name, parameter.checked(name, parameters.get(name, parameter.default)))

    def _freeze(self) -> None:
        name = f"{type(self).__module__}.{type(self).__qualname__}"
        for part in ("state_space", "input_space"):
            if not isinstance(getattr(self, part, None), StateSpace):
                example = "StateSpace([vector('position', 3, 'length')])"
                raise CallError(f"{name} has no {part}; expected a StateSpace, such as {example}")
        expect(getattr(self, "model", None), str, f"a name as `model` of {name}")
        check_names(
            [
                *(("state", block) for block in _blocks(self, "state_space")),
                *(("input", block) for block in _blocks(self, "input_space")),
                *(("output", block) for block in self.output_blocks or ()),
            ]
        )
        super()._freeze()

    def with_(self, **changes: Any) -> Self:
        """The system with other parameters; those that are not named keep their values."""
        values = {**self.parameters(), **changes}
        for name, parameter in list(signature(type(self).__init__).parameters.items())[1:]:
            if name in values or name in self.declared or parameter.kind in _COLLECTED:
                continue
            if name not in vars(self):
                raise InvalidProblemError(
                    f"{type(self).__name__} does not say what its {name!r} is; expected it among parameters(), or as "
                    "an attribute of that name"
                )
            values[name] = vars(self)[name]
        made = type(self)(**values).resting(self.rest).accelerating(self.accelerated)
        return made.among(self.surroundings.obstacles) if self.surroundings is not None else made

    def __repr__(self) -> str:
        values = self.parameters().items()
        known = {name: parameter.default for name, parameter in self.declared.items()}
        return as_call(type(self).__name__, [(name, value, known.get(name, ...)) for name, value in values])

    def parameters(self) -> dict[str, Any]:
        """Every parameter as plain JSON data; ``type(self)(**self.parameters())`` is the same system."""
        values = {name: getattr(self, name) for name in self.declared}
        return {name: list(value) if isinstance(value, tuple) else value for name, value in values.items()}

    def vector_fields(self, state: Array) -> Array:
        """G(x), dimension × inputs."""
        raise NotImplementedError(f"{type(self).__name__} has no vector_fields(state)")

    def drift(self, state: Array) -> Array:
        """f(x), the velocity without control (dimension,); zero unless overridden."""
        return namespace(state).array([0.0] * self.state_space.dimension)

    @property
    def driftless(self) -> bool:
        """Whether f = 0: then zero control stays put, and a motion may be run slower, faster and backwards."""
        return type(self).drift is System.drift

    def velocity(self, state: Array, control: Array) -> Array:
        """The tangent vector f(x) + G(x) u (dimension,)."""
        driven = self.vector_fields(state) @ control
        return driven if self.driftless else self.drift(state) + driven

    def constraints(self, state: Array, velocity: Array) -> Array:
        """The kinematic constraints' residuals at a tangent vector, zero on every motion; written from geometry, not G.

        As many as the dimension exceeds the inputs; none unless overridden, and no solver uses them.
        """
        return namespace(state, velocity).array([])

    def invariants(self, state: Array) -> dict[str, tuple[Array, float | None]]:
        """Scalars that no motion changes, by their names in messages, with the value that each has to have, if any.

        A start has to fit, and only goals with the same values can be reached; none unless overridden.
        """
        return {}

    def rate(self, state: Array, control: Array) -> Array:
        """ẋ of the packed point (size,)."""
        return self.state_space.lift(state, self.velocity(state, control))

    def linearised(self, state: Array, control: Array) -> Array:
        """[∂velocity/∂x, ∂velocity/∂u], dimension × (size + inputs), for SX symbols; x is the packed point.

        Override it where the equations' structure makes the derivative cheaper than differentiating `velocity`.
        """
        xp, velocity = symbolic(), self.velocity(state, control)
        return xp.block([[xp.jacobian(velocity, state), xp.jacobian(velocity, control)]])

    def outputs(self, state: Array, control: Array) -> dict[str, Array]:
        """Named quantities worth plotting or bounding, besides states and inputs."""
        return {}

    @property
    def comparable(self) -> tuple[Any, ...]:
        """What equals that of another system with the same equations: the class, its parameters and spaces."""
        parameters = sorted(self.parameters().items())
        obstacles = self.surroundings and self.surroundings.obstacles
        besides = obstacles, self.rest, self.accelerated
        return type(self), as_value(parameters), self.state_space, self.input_space, *besides

    @property
    def pose_outputs(self) -> tuple[Block, ...]:
        """Those of `outputs` that may be goals."""
        return tuple(block for block in self.output_blocks or () if block.of_pose)

    @property
    def known_outputs(self) -> tuple[str, ...] | None:
        """The names of `outputs`, as far as they are known without making expressions."""
        if self.output_blocks is not None:
            return tuple(block.name for block in self.output_blocks)
        return () if type(self).outputs is System.outputs else None

    def output(self, name: str, state: Array, control: Array) -> Array:
        """One of `outputs`; override it where there is a shorter way than making them all."""
        return self.outputs(state, control)[name]

    def bodies(self, state: Array) -> dict[str, Hull]:
        """What takes up room, by name, as convex hulls with round rims; none unless overridden.

        In space throughout, or in the plane. Bodies that meet by construction name each other in `Hull.touches`.
        """
        return {}

    @property
    def has_bodies(self) -> bool:
        """Whether any of it takes up room."""
        return type(self).bodies is not System.bodies

    def among(self, obstacles: Sequence[Obstacle] | None) -> Self:
        """This system with `distance` among its quantities: of its bodies from obstacles and from each other.

        None takes it away again.
        """
        if obstacles is not None and self.surroundings and self.surroundings.obstacles == tuple(obstacles):
            return self  # with all that has been made of it
        around = None if obstacles is None else Surroundings.of(self.bodies_somewhere(), obstacles)
        return self._known_besides(surroundings=around)

    def resting(self, state: Array | None) -> Self:
        """This system with what it counts from a pose at rest, packed, among its quantities; None: without."""
        return self._known_besides(rest=None if state is None else tuple(float(number) for number in state))

    def accelerating(self, asked: bool = True) -> Self:
        """This system with the accelerations of its legs in its trajectories, or without."""
        return self if asked == self.accelerated else self._known_besides(accelerated=asked)

    def _known_besides(self, **besides: Any) -> Self:
        kept = {name: value for name, value in self.__dict__.items() if not isinstance(value, Kept)}
        other = object.__new__(type(self))
        other.__dict__.update(kept, **besides)
        return other

    def from_rest(self, state: Array, rest: Array) -> dict[str, Array]:
        """Quantities that count from the pose at rest; none unless overridden, with `rest_blocks`."""
        return {}

    @property
    def dimension_of_bodies(self) -> int:
        """2 in the plane, 3 in space."""
        return next(iter(self.bodies_somewhere().values())).dimension

    @property
    def somewhere(self) -> Array:
        """A packed state for what is the same at all of them, beside zeros, where a machine may be singular."""
        import numpy as np

        aside = np.linspace(0.1, 0.2, self.state_space.dimension)
        blocks = self.state_space.blocks
        zeros = {b.name: np.eye(3) if b.kind == "rotation" else np.zeros(b.shape) for b in blocks}
        return np.asarray(self.state_space.retract(np.asarray(self.state_space.pack(zeros)), aside))

    def bodies_somewhere(self) -> dict[str, Hull]:
        """The bodies at some state, for what no state changes of them."""
        import numpy as np

        with np.errstate(all="ignore"):
            return self.bodies(self.somewhere)

    def quantities(self, state: Array, control: Array) -> dict[str, Array]:
        """`outputs`, and among obstacles the distances of its bodies."""
        own = self.outputs(state, control)
        if self.rest is not None:
            own = {**own, **self.from_rest(state, namespace().array(self.rest))}
        if self.surroundings is not None:
            own = {**own, DISTANCE: self._distances(state)}
        return own

    def quantity(self, name: str, state: Array, control: Array) -> Array:
        """One of `quantities`."""
        if self.surroundings is not None and name == DISTANCE:
            return self._distances(state)
        if self.rest is not None and name in (block.name for block in self.rest_blocks):
            return self.from_rest(state, namespace().array(self.rest))[name]
        return self.output(name, state, control)

    def _distances(self, state: Array) -> Array:
        """Of symbols by a function that is made once: the expressions are many."""
        if self.surroundings is None:
            raise ValueError("nothing is around this system")
        made = None if namespace(state) is namespace() else _distance_function(self)
        return self.surroundings.distances(self.bodies(state)) if made is None else made(state)

    @property
    def quantity_blocks(self) -> tuple[Block, ...]:
        """Blocks of `quantities`, as far as they are known without making expressions, and of accelerations."""
        own = (*(self.output_blocks or ()), *(self.rest_blocks if self.rest is not None else ()))
        if self.accelerated:
            own += acceleration_blocks(self)
        if self.surroundings is None:
            return own
        names = tuple(", ".join(pair) for pair in self.surroundings.pairs)
        kind = {"symbol": "d", "words": "distance", "entries": names}
        if len(names) == 1:
            return (*own, scalar(DISTANCE, "length", **kind))
        return (*own, vector(DISTANCE, len(names), "length", **kind))

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

    def joint_sines(self, state: Array) -> list[Array]:
        """Sines of the angles between directions of which the axes of joints are made, one number each.

        Where two fall together a joint turns at any speed and no equation need notice. It separates no poses.
        """
        return []

    def actuated(self) -> tuple[System, Callable[[Array, Array], Array]] | None:
        """This system's motions as the actuators make them: their system, and (x, control) ↦ its input.

        None where this system's own inputs are the actuators', or nothing is known of any.
        """
        return None

    def actuator_positions(self, state: Array) -> Array | None:
        """Where the actuators stand at a packed state, (n,): what a machine is told, leg lengths say.

        Their rates are the inputs of `actuated`'s system. None where the inputs themselves are what it is told.
        """
        return None

    def chained_form(self, near: Array) -> ChainedForm | None:
        """Coordinates in which this system is in chained form, in a chart that holds the point ``near``.

        None where none is known. Its `to_chained` and `from_chained` take states there and back; the solver `sinusoids`
        steers in them.
        """
        return None

    def default_length_scale(self) -> float:
        """A typical length of the mechanism, which turns rotations into lengths; override it where there is one."""
        return 1.0

    @property
    def own_length(self) -> float | None:
        """`default_length_scale` of a mechanism that has a length of its own; None for others, a unicycle say."""
        has_one = type(self).default_length_scale is not System.default_length_scale
        return self.default_length_scale() if has_one else None

    def input_label(self) -> str | list[str]:
        """How a solution file names the control."""
        return list(self.input_space.names)

    def drawing(self, state: Array) -> dict[str, Any]:
        """Plain arrays for pictures: ``{"lines": {name: (n, 3)}, "points": {name: (n, 3)}}``, in the state's units.

        A mechanism in the plane gives (n, 2) throughout and is seen from above. Closed lines are bodies, "leg 1" is
        the first of the kind "leg"; closed lines with "wheel", "roller", "drawbar" or "window" among the words of their
        names are dark parts of them. ``"trace"``, (3,) or (2,), is the point whose path is drawn, if there is one.

        ``"solids"``, {name: solid}, in space only, is what the animation shows where that looks more like the machine;
        pictures on paper leave it out. A solid is a round bar, {"ends": (2, 3), "radius"}, shown as a cylinder with a
        piston where its length changes, or a ball, {"centre": (3,), "rotation": (3, 3), "radius"}, with meridians
        that show how it is turned. It takes the place of the line of its name, and of lines or points whose names or
        kinds are in "replaces". The functions of `systems.solids` make them.
        """
        return {"lines": {}, "points": {}}


@kept(most=64)
def _distance_function(system: System) -> Any:
    """x ↦ the distances of a system's pairs; None where its parameters are symbols."""
    xp, around = symbolic(), system.surroundings
    x = xp.symbol(system.state_space.size)
    return xp.function(x, around.distances(system.bodies(x))) if around is not None else None
