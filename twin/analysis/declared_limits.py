"""Find states of a robot that are beyond limits that the robot declares."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from twin.api.robot import Robot
from twin.core.errors import AssemblyError
from twin.core.findings import Finding, Kind
from twin.core.quantity import moved
from twin.core.spatial import Array
from twin.core.units import ROUNDING
from twin.kinematics.closed_loops import LoopSolver
from twin.kinematics.closed_loops.bounds import bounds_of

_EXCEEDED = {
    "lower": "joint {} is below its lower limit by {}",
    "upper": "joint {} is above its upper limit by {}",
    "motor": "motor {} exceeds its limits by {}",
    "gap": "the gap of joints {} is too small by {}",
}
"""Message by kind of bound."""

_BEYOND = Kind("limit.state", "warning", "correct the state or the limit: the robot cannot be in this state", word="")


def beyond_limits(robot: Robot, solver: LoopSolver, states: Sequence[tuple[str, Array]]) -> Iterator[Finding]:
    """Yield a finding for each limit that a state exceeds, with all loops closed.

    Driven joints, motors, gaps on a rail, and passive joints (ranges and cones) are checked; collisions are not.

    Args:
        robot: the robot.
        solver: the loop solver of its mechanism.
        states: name and active joints q (n,) in m or rad of each state.

    Raises:
        AssemblyError: the loops cannot be closed at a state: its passive joints have no positions.
    """
    mechanism = robot.mechanism
    bounds = bounds_of(mechanism, robot.gaps)
    rotary = set()  # joints and motors whose coordinate is an angle
    for driven in (*mechanism.active, *mechanism.actuators):
        if driven.is_angle:
            rotary.add(driven.name)
    qs = np.array([q for _, q in states])
    # all states at once: closing the loops one by one would take longer than all else here
    closed_states = solver.forward_many(qs)
    for (state, _), T_base_tool in zip(states, closed_states.Ts_base_tool, strict=True):
        if not np.isfinite(T_base_tool).all():
            raise AssemblyError(f"state {state}: the loops cannot be closed, so that no limits can be checked")
    links = solver.link_poses(qs, closed_states.states)
    for state_number, (state, q) in enumerate(states):
        for bound in bounds:
            excess = -bound.slack(q)
            if excess > ROUNDING:
                size = moved(excess, bound.name in rotary)
                message = _EXCEEDED[bound.kind].format(bound.name, size)
                yield _BEYOND(bound.name, message, size, when=state)
        for joint in mechanism.limited:
            excesses = joint.beyond(links[joint.parent], links[joint.child])
            excess = float(excesses[state_number])
            if excess > ROUNDING:
                size = moved(excess, joint.is_angle or joint.cone is not None)
                message = f"passive joint {joint.name} exceeds its limits by {size}"
                yield _BEYOND(joint.name, message, size, when=state)
