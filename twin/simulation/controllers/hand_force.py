"""Compute the force on one hand in one tick by one compiled function.

Eq. (5) of `console` acts along the line from the tool to its proxy, the nearest point outside of all planes that the
tool touches; the energy observer of the hand bounds the force (`passivity`).
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from twin.formula import symbolic
from twin.formula.symbol import from_sx, to_sx
from twin.simulation.controllers.console_equations import DAMPING, LARGEST, STIFFNESS, Console
from twin.simulation.controllers.passivity import bounded, clipped, observed, smoothing, stored
from twin.simulation.limits import JointLimits
from twin.simulation.local_plane import PLANE_COUNT, PLANE_SIZE, SIGNAL_SIZE
from twin.simulation.proxy import proxy

DEVICE_DAMPING = 2.0
"""Damping in N s/m of a pen and the fingers that hold it; ASSUMED: no value is published for this pen."""

FORCE = slice(0, 3)
"""Indices, in the state of a hand, of the force (3,) in N in {H}."""

LAST_POSITION = slice(3, 6)
"""Indices of the position (3,) of the hand in this tick, in m in {H}."""

ENERGY = 6
"""Index of the observed energy in J."""

DEPTH = 7
"""Index of the depth in m."""

RATE = 8
"""Index of the filtered rate of the depth in m/s."""

STATE_SIZE = 9
"""Number of values of the state of a hand."""

_SMALLEST_SCALE = 1e-3
"""Motion scale below which it is not divided by it."""

_SMALLEST_DEPTH = 1e-9
"""Distance in m from goal to tool up to which it has no direction."""

_LIMIT_TOLERANCE = 1e-6
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
    moves_tool: np.ndarray,
    source_count: int,
    dt: float,
    is_bounded: bool = True,
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
        moves_tool: (n,) bool, whether each joint moves the tool.
        source_count: number of signals with planes.
        dt: duration of a tick in s.
        is_bounded: whether the observed energy bounds the force.
    """
    sizes = [STATE_SIZE, 3, 1, 1, 1, 16, 16, 16, 16, 16, len(moves_tool)]
    sizes += [SIGNAL_SIZE] * source_count
    arguments = []
    for i, size in enumerate(sizes):
        arguments.append(ca.SX.sym(f"x{i}", size))
    state, pulse, on, follows, scale, hand, view, base, tool, goal, q, *rows_of_sources = arguments
    b = surface.device_damping
    h = symbolic.unflat(hand, 4, 4)[:3, 3]
    energy = observed(state[ENERGY], state[FORCE], h - state[LAST_POSITION], b, dt)
    T = symbolic.unflat(tool, 4, 4)
    planes = []
    for rows in rows_of_sources:
        planes.append(symbolic.unflat(rows, PLANE_COUNT, PLANE_SIZE))
    planes.append(_wall(symbolic.unflat(base, 4, 4), T, symbolic.unflat(goal, 4, 4), q, limits, moves_tool))
    to_proxy, pull = proxy(ca.vertcat(*planes), T)
    is_on = ca.logic_and(on > 0.5, follows > 0.5)
    depth = ca.if_else(is_on, symbolic.norm(to_proxy), 0.0)
    is_touching = depth > 0
    rate = state[RATE] + smoothing(dt) * ((depth - state[DEPTH]) / dt - state[RATE])
    rate = ca.if_else(is_touching, rate, 0.0)
    eq5 = laws.laws["eq5"]
    size = -to_sx(eq5(from_sx(depth), from_sx(rate), surface.stiffness, surface.damping, surface.largest))
    surface_force = pull * (size / ca.if_else(is_touching, depth, 1.0))
    R_view_world = symbolic.unflat(view, 4, 4)[:3, :3].T
    force = R_view_world @ ca.if_else(is_touching, surface_force, ca.SX.zeros(3))
    force = clipped(force + ca.if_else(is_on, pulse, ca.SX.zeros(3)), surface.largest)
    # Limit the energy to the energy stored at this depth plus the energy stored at the largest force. Otherwise, energy
    # from motion long ago would allow new forces.
    most_stored = stored(ca.SX(surface.largest / surface.stiffness), surface.stiffness, surface.largest)
    most_energy = stored(depth, surface.stiffness, surface.largest) / ca.fmax(scale, _SMALLEST_SCALE) + most_stored
    energy = ca.fmin(energy, most_energy)
    if is_bounded:
        force = bounded(force, energy, b, dt)
    new_state = ca.vertcat(force, h, energy, depth, rate)
    return ca.Function("haptic_hand", arguments, [ca.densify(new_state)])


def _wall(base: ca.SX, T: ca.SX, goal: ca.SX, q: ca.SX, limits: JointLimits, moves_tool: np.ndarray) -> ca.SX:
    """Return the row of the plane that holds the tool while a joint is at its limit; otherwise zeros.

    The goal follows the hand, but the tool stays behind: the distance from the goal to the tool is the depth.
    """
    p_goal = (base @ goal)[:3, 3]
    back = T[:3, 3] - p_goal
    depth = symbolic.norm(back)
    joints = np.flatnonzero(moves_tool).tolist()
    low = ca.DM(limits.lower[joints])
    high = ca.DM(limits.upper[joints])
    room = ca.mmin(ca.fmin(q[joints] - low, high - q[joints]))
    is_at_limit = ca.logic_and(room < _LIMIT_TOLERANCE, depth > _SMALLEST_DEPTH)
    normal = back / ca.if_else(is_at_limit, depth, 1.0)
    row = ca.vertcat(normal, normal, ca.SX.zeros(3), ca.dot(normal, T[:3, 3]) + depth)
    return ca.if_else(is_at_limit, row, ca.SX.zeros(PLANE_SIZE)).T
