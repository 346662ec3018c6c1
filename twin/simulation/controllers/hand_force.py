"""Compute the force on one hand in one tick by one compiled function.

Eq. (5) of `console` acts along the line from the tool to its proxy, the nearest point outside of all planes that the
tool touches; the energy observer of the hand bounds the force (`passive`).
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from twin.formula import symbolic
from twin.formula.symbol import from_sx, to_sx
from twin.simulation.controllers.console_equations import DAMPING, LARGEST, STIFFNESS, Console
from twin.simulation.controllers.passive import bounded, clipped, observed, smoothing, stored
from twin.simulation.limits import JointLimits
from twin.simulation.local_plane import COUNT, SIZE, WIDTH
from twin.simulation.proxy import proxy

DEVICE_DAMPING = 2.0
"""Damping in N s/m of a pen and the fingers that hold it; ASSUMED: no value is published for this pen."""

FORCE, LAST, ENERGY, DEPTH, RATE = slice(0, 3), slice(3, 6), 6, 7, 8
STATE = 9
"""Number of values of the state of a hand. Their indices: FORCE (3,) in N, and LAST (3,), the position of the hand in
this tick in m, both in {H}; ENERGY, observed, in J; DEPTH in m; RATE, the filtered rate of the depth in m/s."""

_AT_LIMIT = 1e-6
"""Tolerance in rad or m within which a joint counts as being at its limit."""


@dataclass(frozen=True)
class ForceParameters:
    """Parameters of the forces on the hands.

    Attributes:
        stiffness: stiffness of a surface in N/m.
        damping: damping of a surface in N s/m.
        largest: limit in N of the total force on a hand; a larger force is clipped.
        device_damping: damping in N s/m of the device and the fingers that hold it.
    """

    stiffness: float = STIFFNESS
    damping: float = DAMPING
    largest: float = LARGEST
    device_damping: float = DEVICE_DAMPING


def hand_force(
    laws: Console,
    surface: ForceParameters,
    limits: JointLimits,
    moves: np.ndarray,
    sources: int,
    dt: float,
    bounds: bool = True,
) -> ca.Function:
    """Return the function of one tick, (arguments) -> state (STATE,).

    The arguments of this function are, in this order: state (STATE,) after the previous tick; pulse (3,), a force in N
    in {H}; on, 0 or 1; follows, 0 or 1; motion scale; pose of the hand in {H}; pose of {H} in the World; pose of the
    arm's base in the World; pose of the tool in the World; goal of the tool in the arm's base; joint values q (n,); and
    for each source, rows of planes (SIZE,). Poses are (16,), row by row.

    Args:
        laws: equations of the console.
        surface: parameters of the forces.
        limits: joint limits of the arm.
        moves: (n,) bool, whether each joint moves the tool.
        sources: number of signals with planes.
        dt: duration of a tick in s.
        bounds: whether the observed energy bounds the force.
    """
    shapes = (STATE, 3, 1, 1, 1, 16, 16, 16, 16, 16, len(moves), *(SIZE for _ in range(sources)))
    given = [ca.SX.sym(f"x{i}", n) for i, n in enumerate(shapes)]
    state, pulse, on, follows, scale, hand, view, base, tool, goal, q, *found = given
    b = surface.device_damping
    h = symbolic.unflat(hand, 4, 4)[:3, 3]
    energy = observed(state[ENERGY], state[FORCE], h - state[LAST], b, dt)
    T = symbolic.unflat(tool, 4, 4)
    planes = [symbolic.unflat(x, COUNT, WIDTH) for x in found]
    planes.append(_wall(symbolic.unflat(base, 4, 4), T, symbolic.unflat(goal, 4, 4), q, limits, moves))
    way, pull = proxy(ca.vertcat(*planes), T)
    acts = ca.logic_and(on > 0.5, follows > 0.5)
    depth = ca.if_else(acts, symbolic.norm(way), 0.0)
    touches = depth > 0
    rate = state[RATE] + smoothing(dt) * ((depth - state[DEPTH]) / dt - state[RATE])
    rate = ca.if_else(touches, rate, 0.0)
    size = -to_sx(laws.laws["eq5"](from_sx(depth), from_sx(rate), surface.stiffness, surface.damping, surface.largest))
    away = pull * (size / ca.if_else(touches, depth, 1.0))
    force = symbolic.unflat(view, 4, 4)[:3, :3].T @ ca.if_else(touches, away, ca.SX.zeros(3))
    force = clipped(force + ca.if_else(acts, pulse, ca.SX.zeros(3)), surface.largest)
    # Limit the energy to the energy stored at this depth plus the energy stored at the largest force. Otherwise, energy
    # from motion long ago would allow new forces.
    full = stored(ca.SX(surface.largest / surface.stiffness), surface.stiffness, surface.largest)
    kept = stored(depth, surface.stiffness, surface.largest) / ca.fmax(scale, 1e-3) + full
    energy = ca.fmin(energy, kept)
    if bounds:
        force = bounded(force, energy, b, dt)
    return ca.Function("haptic_hand", given, [ca.densify(ca.vertcat(force, h, energy, depth, rate))])


def _wall(base: ca.SX, T: ca.SX, goal: ca.SX, q: ca.SX, limits: JointLimits, moves: np.ndarray) -> ca.SX:
    """Return the row of the plane that holds the tool while a joint is at its limit; otherwise zeros.

    The goal follows the hand, but the tool stays behind: the distance from the goal to the tool is the depth.
    """
    wanted = (base @ goal)[:3, 3]
    back = T[:3, 3] - wanted
    depth = symbolic.norm(back)
    joints = np.flatnonzero(moves).tolist()
    low, high = ca.DM(limits.lower[joints]), ca.DM(limits.upper[joints])
    room = ca.mmin(ca.fmin(q[joints] - low, high - q[joints]))
    at = ca.logic_and(room < _AT_LIMIT, depth > 1e-9)
    normal = back / ca.if_else(at, depth, 1.0)
    row = ca.vertcat(normal, normal, ca.SX.zeros(3), ca.dot(normal, T[:3, 3]) + depth)
    return ca.if_else(at, row, ca.SX.zeros(WIDTH)).T
