r"""The variational equations (11)-(12) and the Gram matrix of the end-point map, [Paper] section 3.

With (w, s) the variation of the state, rotations varying as ∂R = [s] R, a system ẋ = f(x) + G(x) u obeys
    (ẇ, ṡ) = A(t) (w, s) + B(t) δu,      A = ∂(f + G u)/∂x,   B = G(x),
and the rows of a rotation get ω × s besides ∂ω: for the robot that is the -[v] s of (11). With δu = P(t) δλ the matrix
M(t) of (w, s) over λ obeys Ṁ = A M + B P, and M(T) is the integral under eq. (16). The Gram matrix
    D = ∫ Φ(T,t) B Bᵀ Φᵀ(T,t) dt,   [Paper] eq. (14),   solves   Ḋ = A D + D Aᵀ + B Bᵀ,  D(0) = 0.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from nhpocp.arrays import Array, cross
from nhpocp.controls.basis import ControlBasis
from nhpocp.flow.dynamics import Dynamics
from nhpocp.flow.integrators import Integrator
from nhpocp.systems.system import System


def linearisation(system: System) -> ca.Function:
    """(x, u) ↦ A (d × d), B (d × m) of the variational equations at a point, d the dimension of the state space."""
    space = system.state_space
    x, u = ca.SX.sym("x", space.size), ca.SX.sym("u", system.input_space.size)
    delta = ca.SX.sym("delta", space.dimension)
    velocity, linearised = system.velocity(x, u), system.linearised(x, u)
    by_point, B = linearised[:, : space.size], linearised[:, space.size :]
    # d velocity along a tangent δ: the packed point moves by lift(x, δ), no retraction to differentiate
    directional = by_point @ space.lift(x, delta)
    for block in space.blocks:
        if block.kind == "rotation":
            part = space.tangent_slice(block.name)
            directional[part] = directional[part] + cross(velocity[part], delta[part])
    A = ca.jacobian(directional, delta)
    return ca.Function("linearisation", [x, u], [ca.densify(A), ca.densify(B)])


def gram_matrix(
    system: System,
    basis: ControlBasis,
    horizon: float,
    integrator: Integrator,
    start: Array,
    coefficients: Array,
) -> Array:
    """D of [Paper] eq. (14) alone, (d, d), which depends on the control's path and on no basis."""
    n, d, m = system.state_space.size, system.state_space.dimension, system.input_space.size
    y, u = ca.SX.sym("y", n + d * d), ca.SX.sym("u", m)
    x, D = y[:n], ca.reshape(y[n:], d, d)
    A, B = linearisation(system)(x, u)
    rate = ca.vertcat(system.rate(x, u), ca.vec(A @ D + D @ A.T + B @ B.T))
    flow = integrator.flow(Dynamics(ca.Function("gram", [y, u], [ca.densify(rate)])), basis, horizon)
    end = flow.states(np.concatenate([start, np.zeros(d * d)]), coefficients)[-1]
    return np.asarray(end[n:].reshape((d, d), order="F"))


class VariationalEquations:
    """x, M and D of one system integrated together, over one basis and horizon."""

    def __init__(
        self,
        system: System,
        basis: ControlBasis,
        horizon: float,
        integrator: Integrator,
        times: Array | None = None,
    ) -> None:
        self._space, self._inputs, self._basis = system.state_space, system.input_space.size, basis
        n, d, m, size = self._space.size, self._space.dimension, self._inputs, basis.size
        y = ca.SX.sym("y", n + d * m * size + d * d)
        w = ca.SX.sym("w", m + size)  # the control and the basis functions themselves
        x, u, phi = y[:n], w[:m], w[m:]
        M = ca.reshape(y[n : n + d * m * size], d, m * size)
        D = ca.reshape(y[n + d * m * size :], d, d)
        A, B = linearisation(system)(x, u)
        P = ca.kron(ca.SX.eye(m), phi.T)
        rate = ca.vertcat(system.rate(x, u), ca.vec(A @ M + B @ P), ca.vec(A @ D + D @ A.T + B @ B.T))
        # φ(t) is fed in as further inputs with the identity as their coefficients, so any integrator serves
        whole = ca.Function("variational", [y, w], [ca.densify(rate)])
        self.flow = integrator.flow(Dynamics(whole), basis, horizon, times)

    def states(self, start: Array, coefficients: Array) -> tuple[Array, Array, Array]:
        """Path x (k, n), Jacobians M along it (k, d, m·size) and Gram matrix D at its end (d, d)."""
        n, d, columns = self._space.size, self._space.dimension, self._inputs * self._basis.size
        start = np.concatenate([start, np.zeros(d * columns + d * d)])
        path = self.flow.states(start, np.vstack([coefficients, np.eye(self._basis.size)]))
        return (
            path[:, :n],
            path[:, n : n + d * columns].reshape(len(path), columns, d).swapaxes(1, 2),
            path[-1, n + d * columns :].reshape((d, d), order="F"),
        )
