"""Chained forms: coordinates and inputs in which a system is ż1 = v1, ż2 = v2, ż_{k+1} = z_k v1."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from nhpocp.arrays import Array
from nhpocp.errors import InvalidProblemError
from nhpocp.frozen import ByValue
from nhpocp.kept import kept
from nhpocp.state_space import StateSpace

SAME = 1e-7  # of the state's numbers; further from its own image, a state is outside the chart


class TwoInputs(Protocol):
    """What a chained form needs of a system."""

    @property
    def model(self) -> str: ...

    state_space: StateSpace

    def vector_fields(self, state: Array) -> Array: ...


@dataclass(frozen=True, eq=False)
class ChainedForm(ByValue):
    r"""The chained form of a system with two inputs and n numbers of state, [Sørdalen]:

        z_n = last(x),   z_k = (∂z_{k+1}/∂x · g)/(∂z_1/∂x · g),   v = (ż_1, ż_2) = D(x) u

    g: the vector field of the input ``drive``, which alone moves z_1 and z_3 … z_n. system: whose form it is. first,
    last: x ↦ z_1 and z_n, flat outputs. assemble: (z_1, z_n, slopes) ↦ x, with n - 2 slopes of which the j-th enters
    z_{n-j} linearly, and no z_k of a greater k; how the state is found from z. A form holds in a chart, where D is
    regular.
    Errors: `InvalidProblemError` from `to_chained` for states outside.
    """

    system: TwoInputs
    drive: int
    first: Callable[[Array], Array]
    last: Callable[[Array], Array]
    assemble: Callable[[Array, Array, Sequence[Array]], Array]

    @property
    def size(self) -> int:
        """n, numbers of z."""
        return self.system.state_space.size

    def to_chained(self, states: Array) -> Array:
        """z (n,) of a state (n,), or (…, n) of many. Errors: `InvalidProblemError` for one outside the chart."""
        z = self._coordinates(states)
        if not np.allclose(self.from_chained(z), states, rtol=SAME, atol=SAME):
            raise InvalidProblemError(
                f"a state of {self.system.model} lies outside the chart of its chained form"
            )
        return z

    def from_chained(self, z: Array) -> Array:
        """The state (n,) of coordinates z (n,), or (…, n) of many."""
        z = np.asarray(z, dtype=float)
        flat = z.reshape(-1, self.size).T
        ends, slopes = flat[[0, -1]], np.zeros((self.size - 2, flat.shape[1]))
        for j in range(self.size - 2):  # z_{n-1-j} = α + β s_j, with the slopes before it known
            slopes[j] = 0.0
            alpha = _functions(self)["links"](ends, slopes).full()[-1 - j]
            slopes[j] = 1.0
            beta = _functions(self)["links"](ends, slopes).full()[-1 - j] - alpha
            slopes[j] = (flat[-2 - j] - alpha) / beta
        return _functions(self)["state"](ends, slopes).full().T.reshape(z.shape)

    def to_chained_input(self, states: Array, inputs: Array) -> Array:
        """v (2,) of an input u (2,) at a state (n,), or (…, 2) of many."""
        return (self._decoupling(states) @ np.asarray(inputs, dtype=float)[..., None])[..., 0]

    def from_chained_input(self, states: Array, v: Array) -> Array:
        """u (2,) that makes v (2,) at a state (n,), or (…, 2) of many: the feedback D(x)⁻¹ v."""
        return np.linalg.solve(self._decoupling(states), np.asarray(v, dtype=float)[..., None])[..., 0]

    def _coordinates(self, states: Array) -> Array:
        return self._mapped("z", states, (self.size,))

    def _decoupling(self, states: Array) -> Array:
        return self._mapped("D", states, (2, 2))

    def _mapped(self, name: str, states: Array, shape: tuple[int, ...]) -> Array:
        states = np.asarray(states, dtype=float)
        columns = _functions(self)[name](states.reshape(-1, self.size).T).full()
        return columns.T.reshape((*states.shape[:-1], *shape))


@kept(64)
def _functions(form: ChainedForm) -> dict[str, Any]:
    """CasADi's functions of a form, each of one column a point: z and D of x, z_2 … z_{n-1} and x of the slopes."""
    import casadi as ca

    n, system = form.size, form.system
    x = ca.SX.sym("x", n)
    fields = system.vector_fields(x)
    lifted = ca.horzcat(*[system.state_space.lift(x, fields[:, i]) for i in range(2)])
    z = [form.last(x)]
    speed = ca.jacobian(form.first(x), x) @ lifted[:, form.drive]
    for _ in range(n - 2):
        z.insert(0, ca.jacobian(z[0], x) @ lifted[:, form.drive] / speed)
    z.insert(0, form.first(x))
    decoupling = ca.jacobian(ca.vertcat(z[0], z[1]), x) @ lifted
    of_x = ca.Function("z", [x], [ca.vertcat(*z)])
    ends, slopes = ca.SX.sym("ends", 2), ca.SX.sym("s", n - 2)
    state = form.assemble(ends[0], ends[1], [slopes[j] for j in range(n - 2)])
    return {
        "z": of_x,
        "D": ca.Function("D", [x], [ca.vec(decoupling.T)]),
        "links": ca.Function("links", [ends, slopes], [of_x(state)[1:-1]]),
        "state": ca.Function("state", [ends, slopes], [state]),
    }
