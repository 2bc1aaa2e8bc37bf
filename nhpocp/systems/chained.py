"""The chained form: what unicycles, cars with trailers and geared arms become in the right coordinates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

from nhpocp.arrays import Array, namespace
from nhpocp.errors import InvalidProblemError
from nhpocp.state_space import StateSpace, scalar, vector
from nhpocp.systems.system import Parameter, System

if TYPE_CHECKING:
    from nhpocp.systems.chained_form import ChainedForm


class Chained(System):
    r"""The chained form with one chain on Rⁿ, [Murray & Sastry]:

        ẋ1 = u1,   ẋ2 = u2,   ẋ_{k+1} = x_k u1,  k = 2 … n-1

    Growth vector (2, 3, …, n): every further bracket with the first field moves one more link. Its canonical steering
    is by integrally related sinusoids, u1 = a sin ωt and u2 = b cos kωt, which displace x_{k+2} alone of x_1 … x_{k+2}.
    """

    model: ClassVar[str] = "chained"
    declared: ClassVar[Mapping[str, Parameter]] = {
        "n": Parameter("integer", 3, "numbers of the state; at least 2")
    }
    example: ClassVar[Mapping[str, Any]] = {
        "start": {"x": [0, 0, 0]},
        "goal": {"x": [0, 0, 1]},
        "control": {"harmonics": 1, "initial": [[0, 2, 0], [0, 0, 2]]},
    }
    input_space = StateSpace([scalar("u1"), scalar("u2")])
    plotted = ("x_1", "x_2, \\dots, x_n")
    n: int

    def __init__(self, n: int = 3) -> None:
        super().__init__(n=n)
        if self.n < 2:
            raise InvalidProblemError(f"{self.n}; expected a whole number of at least 2", path="system.n")
        self.state_space = StateSpace([vector("x", self.n)])

    def vector_fields(self, state: Array) -> Array:
        links = [[state[k], 0.0] for k in range(1, self.n - 1)]
        return namespace(state).matrix([[1.0, 0.0], [0.0, 1.0], *links])

    def constraints(self, state: Array, velocity: Array) -> Array:
        """Each link's slope: dx_{k+1} - x_k dx_1."""
        xp = namespace(state, velocity)
        return xp.vector([velocity[k + 1] - state[k] * velocity[0] for k in range(1, self.n - 1)])

    def chained_form(self, near: Array) -> ChainedForm:
        """Itself."""
        from nhpocp.systems.chained_form import ChainedForm

        def assemble(first: Array, last: Array, slopes: Sequence[Array]) -> Array:
            return namespace(first).vector([first, *reversed(slopes), last])

        return ChainedForm(self, 0, lambda x: x[0], lambda x: x[self.n - 1], assemble)

    def drawing(self, state: Array) -> dict[str, Any]:
        """The chain in one picture: every x_k above x_1, the last of them followed."""
        xp = namespace(state)
        chain = xp.rows([xp.vector([state[0], state[k]]) for k in range(1, self.n)])
        return {"lines": {"chain": chain}, "points": {"x": chain}, "trace": chain[self.n - 2, :]}
