"""The cost that the Raven paper publishes, eq. (1): arc length and integral of the squared tip acceleration of an edge.

Between two waypoints of the paper's planner, a simulated robot under PD control moves from rest at a to b. The paper
prints neither gains nor a time law. Here the set point of the controller is b from the start of the edge, and the
masses, Coriolis effects and gravity are compensated (computed torque with PD, as in `twin track`). The plant is
then linear, with the same critically damped response of all joints:

    qdd = w^2 (b - q) - 2 w qd      q(t) = a + f(t) (b - a)      f(t) = 1 - (1 + w t) exp(-w t)

Therefore the simulation of an edge has a closed form, and a simulated edge follows the straight connection from a to b
without overshoot: it is free of collisions if and only if the straight connection is. An edge ends when 2 % of the
motion remain (the settling time). The bandwidth w follows from the paper's Table 2: a plan was tracked in 0.32 to
0.39 s an edge, whatever the length of the edges.
"""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from twin.codegen import Kernel, Stage
from twin.core.errors import ProtocolError
from twin.core.spatial import Array
from twin.kinematics.closed_loops.equations import LoopEquations
from twin.model.mechanism import Mechanism
from twin.planning.protocol.phases.free import ETA

REMAINING = 0.02
"""Fraction of its motion that remains at the end of an edge (ASSUMED: the usual definition of a settling time)."""

_SETTLED = 5.83392170191749
"""w t at which (1 + w t) exp(-w t) equals `REMAINING`."""

EDGE_TIME = 0.3625
"""Duration of an edge in s (DERIVED from the paper's Table 2).

The mean over its rows of the time of tracking divided by the number of edges: 4.705 s / 12.5, 4.277 s / 13.3,
3.909 s / 10.1, 3.688 s / 10.1. That an edge takes the same time whatever its length is ASSUMED.
"""

BANDWIDTH = _SETTLED / EDGE_TIME
"""Bandwidth w in rad/s of the response."""

_NODES = 16
"""Number of nodes of the Gauss-Legendre quadrature over an edge: the error is below 1e-5 for edges up to 1 rad."""


def response(t: Array) -> tuple[Array, Array, Array]:
    """Return f (k,) and its derivatives with respect to time, in 1/s and 1/s2, at times t (k,) in s."""
    x = BANDWIDTH * np.asarray(t, float)
    decay = np.exp(-x)
    f = 1 - (1 + x) * decay
    return f, BANDWIDTH * x * decay, BANDWIDTH**2 * (1 - x) * decay


def _quadrature() -> tuple[Array, Array]:
    """Return times (k,) in s within an edge, and the weights (k,) in s of an integral over the edge."""
    # nodes and weights of the interval -1 to 1, moved to 0 to `EDGE_TIME`
    x, weight = np.polynomial.legendre.leggauss(_NODES)
    times = EDGE_TIME * (x + 1) / 2
    weights = EDGE_TIME * weight / 2
    return times, weights


TipDerivatives = Callable[[Array, Array, Array], tuple[Array, Array]]
"""Function of joint values a (n, k), differences d (n, k) and s (1, k): (dp/ds, d2p/ds2), each (3, k), in m.

p(s) is the position of the tool where the joint values are a + s d.
"""


def tip_derivatives(mechanism: Mechanism) -> TipDerivatives:
    """Return the compiled derivatives of the tool's position along a straight line of the driven joints.

    Raises:
        ProtocolError: the tool's pose is not a function of the driven joints alone (the mechanism has loops).
    """
    equations = LoopEquations(mechanism)
    p = equations.T_base_tool[:3, 3]
    if mechanism.loops or ca.depends_on(p, equations.states):
        raise ProtocolError(
            f'{mechanism.name}: cost = "published" needs an arm without loops, whose tool follows from its driven '
            'joints alone; choose cost = "length" or "clearance"'
        )
    n = equations.q.numel()
    a = ca.SX.sym("a", n)
    d = ca.SX.sym("d", n)
    s = ca.SX.sym("s")
    p = ca.substitute(p, equations.q, a + s * d)
    rate = ca.jacobian(p, s)
    curvature = ca.jacobian(rate, s)
    function = ca.Function("tip", [a, d, s], [ca.densify(rate), ca.densify(curvature)], {"cse": True})
    stage = Stage(function, ("a", "d", "s"), ("rate", "curvature"))
    kernel = Kernel([stage], {"a": n, "d": n, "s": 1}, ["rate", "curvature"])

    def derivatives(a: Array, d: Array, s: Array) -> tuple[Array, Array]:
        rate, curvature = kernel(a, d, s)
        return rate, curvature

    return derivatives


def squared_acceleration(mechanism: Mechanism) -> Callable[[Array, Array], Array]:
    """Return a function of joint values a (k, n) and b (k, n): integrals (k,) in m2/s3 of |tip acceleration|^2.

    Raises:
        ProtocolError: see `tip_derivatives`.
    """
    derivatives = tip_derivatives(mechanism)
    times, weights = _quadrature()
    f, f_rate, f_acceleration = response(times)

    def integral(a: Array, b: Array) -> Array:
        edge_count = len(a)
        step = np.asarray(b, float) - a
        starts = np.repeat(np.asarray(a, float).T, _NODES, axis=1)  # the nodes of an edge are neighbours
        steps = np.repeat(step.T, _NODES, axis=1)
        rate, curvature = derivatives(starts, steps, np.tile(f, edge_count)[None])
        # chain rule: d2p/dt2 = dp/ds d2f/dt2 + d2p/ds2 (df/dt)^2
        acceleration = rate * np.tile(f_acceleration, edge_count) + curvature * np.tile(f_rate**2, edge_count)
        squares = (acceleration**2).sum(axis=0).reshape(edge_count, _NODES)
        return squares @ weights

    return integral


def normalised_length(limits: Array) -> Callable[[Array, Array], Array]:
    """Return a function of a (k, n) and b (k, n): Euclidean lengths (k,) where each joint's range counts as 1.

    `limits` (n, 2) are those of the driven joints in m or rad, and finite.
    """
    spans = np.ptp(np.asarray(limits, float), axis=1)
    spans = np.where(spans > 0, spans, 1.0)  # a joint without a range does not move

    def lengths(a: Array, b: Array) -> Array:
        return np.linalg.norm((b - a) / spans, axis=1)

    return lengths


def published_cost(mechanism: Mechanism, limits: Array, eta: tuple[float, float] = ETA) -> Callable[..., Array]:
    """Return eq. (1) of the Raven paper as a cost of straight connections from a (k, n) to b (k, n).

    Args:
        mechanism: the arm; it has no loops.
        limits: (n, 2) limits of the driven joints in m or rad, finite; the paper normalises joint positions to the
            range 0 to 1.
        eta: weights of the length, and of the integral in m2/s3.

    Raises:
        ProtocolError: see `tip_derivatives`.
    """
    eta_length, eta_acceleration = eta
    lengths = normalised_length(limits)
    if eta_acceleration == 0:
        return lambda a, b: eta_length * lengths(a, b)
    integral = squared_acceleration(mechanism)

    def cost(a: Array, b: Array) -> Array:
        return eta_length * lengths(a, b) + eta_acceleration * integral(a, b)

    return cost
