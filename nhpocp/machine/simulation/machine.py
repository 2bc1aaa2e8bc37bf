"""A machine in MuJoCo: commanded by leg lengths, measured by pose, advanced in time. The only place for MuJoCo."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from types import ModuleType
from typing import NamedTuple

import numpy as np

from nhpocp import so3
from nhpocp.arrays import Array
from nhpocp.errors import InvalidProblemError, MissingDependencyError, NhpocpError
from nhpocp.machine.simulation.base_joints import Roller
from nhpocp.machine.simulation.building import built
from nhpocp.machine.simulation.built import STEP
from nhpocp.machine.simulation.settings import MachineSettings
from nhpocp.systems.system import System

AT_REST = 1e-4  # m/s or rad/s
LONGEST_SETTLING = 10.0  # s
AT_ONCE = 100  # steps between two looks at whether it holds together
CONTROL_STEP = 0.002  # s between set-points of the servos on the way from one command to the next


class MachineBroke(NhpocpError):
    """Bodies that no motion could hold together."""


class Contacts(NamedTuple):
    """At the rollers, (rollers,) each: the forces normal to the contact and within it [N], and the slip [length/s].

    The slip is the velocity along the roller's axle, which rolling does not have.
    """

    normal: Array
    friction: Array
    slip: Array


class Machine:
    """A parallel robot, or a ball on a plane, as bodies, joints and contacts, driven by position servos.

    That of a robot is a `Plant`: `command`, `advance`, `measure` are all that a controller needs. Every time is in
    seconds, every length in the system's unit. Where the integration breaks down the machine stands still; ``failure``
    says so, in words.
    """

    def __init__(
        self, system: System, start: Mapping[str, Array], settings: MachineSettings | None = None
    ) -> None:
        """At a pose, {"position": (3,) [length] (of a ball (2,)), "orientation": (3, 3)}, with its servos holding it.

        Errors: `MissingDependencyError` without MuJoCo; `InvalidProblemError` for a system that cannot be built, or
        bodies that do not fit the pose.
        """
        self.system, self.settings = system, settings or MachineSettings()
        position, orientation = (
            np.asarray(start.get(name), dtype=float) for name in ("position", "orientation")
        )
        self.built = built(system, position, orientation, self.settings)
        self._mujoco = require_engine()
        try:
            self._model = self._mujoco.MjModel.from_xml_string(self.built.text)
        except ValueError as error:
            raise InvalidProblemError(f"no machine can be built of these legs: {error}") from error
        self._data = self._mujoco.MjData(self._model)
        self._motors = [self._model.actuator(name).id for name in self.built.motors]
        self._rods = [self._model.joint(name).qposadr[0] for name in self.built.motors]
        self._body, self._components = self._model.body(self.built.body).id, len(position)
        self._rims = [self._model.geom(f"rim {roller.leg}").id for roller in self.built.rollers]
        kinds = self._mujoco.mjtWarning
        self._bad = [int(k) for k in (kinds.mjWARN_BADQPOS, kinds.mjWARN_BADQVEL, kinds.mjWARN_BADQACC)]
        self._random = np.random.default_rng(self.settings.seed)
        self._shown = self.built.lengths  # what the servos hold now
        self._told = self.built.lengths  # and will, once what is under way has arrived
        self._next: Array | None = None  # and at the end of the next `advance`
        self._zero = np.zeros(len(self._motors))  # what encoders show, less what the legs are long
        self._homed = False
        self._waiting: deque[tuple[float, Array]] = deque()
        self.failure = ""
        self._mujoco.mj_forward(self._model, self._data)

    @property
    def engine(self) -> str:
        """What integrates it, and its version."""
        return f"MuJoCo {self._mujoco.__version__}"

    @property
    def time(self) -> float:
        """Since it was built [s]."""
        return float(self._data.time)

    def measure(self) -> dict[str, Array]:
        """The platform's pose, {"position": (3,) [length], "orientation": (3, 3)}, with the noise of the settings."""
        pose = self.pose()
        for_position, for_orientation = self.settings.noise
        if for_position or for_orientation:
            pose["position"] = pose["position"] + self._random.normal(0.0, for_position or 0.0, 3)
            turn = self._random.normal(0.0, for_orientation or 0.0, 3)
            pose["orientation"] = so3.exp(turn) @ pose["orientation"]
        return pose

    def pose(self) -> dict[str, Array]:
        """The platform's pose as it is, {"position": (3,) [length], "orientation": (3, 3)}."""
        position = self._data.xpos[self._body][: self._components] / self.built.metres
        return {
            "position": position.copy(),
            "orientation": self._data.xmat[self._body].reshape(3, 3).copy(),
        }

    @property
    def point(self) -> Array:
        """The packed state (size,) of the system as it is, without noise."""
        return np.asarray(self.system.state_space.pack(self.pose()), dtype=float)

    def command(self, leg_lengths: Array) -> None:
        """Lengths of the driven legs (n,) [length] at the end of the next `advance`; held until the next command.

        The first ever, unless `home` came before it, names the lengths that the legs have now: it moves nothing.
        """
        lengths = np.asarray(leg_lengths, dtype=float)
        if lengths.shape != self._shown.shape or not np.isfinite(lengths).all():
            words = f"expected {len(self._motors)} finite leg lengths, got {lengths.tolist()}"
            raise InvalidProblemError(words)
        if not self._homed:
            self.home(lengths)
        self._next = lengths

    def advance(self, seconds: float) -> None:
        """Lets so much time go by, in whole steps of 0.5 ms. Errors: `MachineBroke`, once and for all."""
        steps = max(0, round(seconds / STEP))
        self._set_out(steps * STEP)
        while steps and not self.failure:
            while self._waiting and self._waiting[0][0] <= self.time + 0.5 * STEP:
                self._shown = self._waiting.popleft()[1]
                lengths = self._shown - self._zero - self.built.lengths
                self._data.ctrl[self._motors] = self.built.metres * lengths
            now = min(steps, AT_ONCE)
            if self._waiting:  # until the next command arrives
                now = min(now, max(1, round((self._waiting[0][0] - self.time) / STEP)))
            self._mujoco.mj_step(self._model, self._data, nstep=now)
            steps -= now
            warned = self._data.warning.number[self._bad]
            if warned.any() or not np.isfinite(self._data.qpos).all():
                self.failure = (
                    f"the bodies broke apart after {self.time:.3g} s: the joints cannot follow this motion"
                )
        if self.failure:
            raise MachineBroke(self.failure)

    def _set_out(self, seconds: float) -> None:
        """Has the servos led to what was commanded at a steady speed."""
        if self._next is None:
            return
        parts = max(1, round(seconds / CONTROL_STEP))
        for k in range(parts):
            due = self.time + self.settings.latency + k * seconds / parts
            self._waiting.append((due, self._told + (k + 1) / parts * (self._next - self._told)))
        self._told, self._next = self._next, None

    def settle(self) -> None:
        """Advances until nothing moves any more, for 10 s at most."""
        for _ in range(round(LONGEST_SETTLING / 0.1)):
            self.advance(0.1)
            if self.at_rest:
                return

    @property
    def at_rest(self) -> bool:
        """Whether nothing moves any more and no command is under way, or nothing can move."""
        under_way = self._waiting or self._next is not None
        return bool(self.failure or (not under_way and np.abs(self._data.qvel).max() < AT_REST))

    def home(self, leg_lengths: Array) -> None:
        """From now on what is commanded is called ``leg_lengths`` (n,) [length]: the encoders are set to them."""
        self._zero = self._zero + np.asarray(leg_lengths, dtype=float) - self._shown
        self._shown = self._told = np.asarray(leg_lengths, dtype=float)
        self._homed = True

    def leg_lengths(self) -> Array:
        """What the encoders show, (n,) [length]."""
        return self._data.qpos[self._rods] / self.built.metres + self.built.lengths + self._zero

    def motor_forces(self) -> Array:
        """(n,) [N], positive where a motor pushes its leg out."""
        return self._data.actuator_force[self._motors].copy()

    def contacts(self) -> Contacts:
        """Forces and slip at the rollers."""
        count = len(self.built.rollers)
        normal, friction, force = np.zeros(count), np.zeros(count), np.zeros(6)
        pairs = self._data.contact.geom
        for k in range(self._data.ncon):
            for i, rim in enumerate(self._rims):
                if rim in pairs[k]:
                    self._mujoco.mj_contactForce(self._model, self._data, k, force)
                    normal[i] += force[0]
                    friction[i] += np.hypot(force[1], force[2])
        slip = [self._slip(roller) / self.built.metres for roller in self.built.rollers]
        return Contacts(normal, friction, np.array(slip))

    def _slip(self, roller: Roller) -> float:
        """The velocity of the ball against the roller along the axle where they touch [m/s]."""
        point, axle = roller.point, roller.axle
        if roller.carrier:
            carrier = self._data.body(roller.carrier)
            turned = carrier.xmat.reshape(3, 3)
            point, axle = carrier.xpos + turned @ point, axle @ turned.T
        ball, own = (self._velocity(name, point) for name in (roller.ball, roller.roller))
        along = axle @ (ball - own)
        return float(along) if along.ndim == 0 else float(np.linalg.norm(along))

    def _velocity(self, body: str, point: Array) -> Array:
        """Of the point of a body that is at this place [m/s]."""
        number, moved = self._model.body(body).id, np.zeros(6)
        kind = self._mujoco.mjtObj.mjOBJ_XBODY
        self._mujoco.mj_objectVelocity(self._model, self._data, kind, number, moved, 0)
        return moved[3:] + np.cross(moved[:3], point - self._data.xpos[number])


def require_engine() -> ModuleType:
    """Errors: `MissingDependencyError` with the line that installs it."""
    try:
        import mujoco
    except ImportError:
        words = 'physics needs MuJoCo; install it with: pip install "nhpocp[physics]"'
        raise MissingDependencyError(words) from None
    if mujoco.get_mju_user_warning() is None:  # else its warnings go to a file in the current folder
        mujoco.set_mju_user_warning(lambda words: None)
    return mujoco
