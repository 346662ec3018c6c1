"""The motion of all links along a trajectory, by the equations of the robot and the compiled loops of its mechanism.

This motion drives the joints of USD stages and of exported clips. The reference model does not compute it, because it
judges it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from twin.core.errors import AssemblyError
from twin.core.spatial import Array
from twin.core.units import MM
from twin.planning.trajectory import Trajectory

if TYPE_CHECKING:
    from twin.kinematics.closed_loops import LoopSolver
    from twin.reference import ReferenceModel
    from twin.reference.states import SolvedSamples

BY_EQUATIONS = "inverse of the equations at the planned poses"
BY_PLAN = "joint values of the plan"
LOOPS = "compiled loops of the mechanism"

_SAME_SOLUTION = 1e-3
"""Largest difference (m, rad) of the inverse from the planned joint values; above, it is another solution."""

_REACHED = 1e-10
"""Largest difference (m, entries of the rotation) between the planned pose and the pose at the inverse's values."""


@dataclass(frozen=True)
class LinkMotion:
    """Joint values and link poses at times.

    Attributes:
        times: (k,) in s.
        q: (k, n) values of the driven joints in m or rad, in the order of `Mechanism.active`.
        joints: {joint: coordinates (k,) in m or rad} of all joints with a single coordinate, active and passive.
        links: {body: T_base_body (k, 4, 4)}.
        by_plan: whether q are the interpolated joint values of the plan, not the inverse at the planned poses.
    """

    times: Array
    q: Array
    joints: Mapping[str, Array]
    links: Mapping[str, Array]
    by_plan: bool

    @property
    def driver(self) -> str:
        """What determined the joint values, as text for reports."""
        origin = BY_EQUATIONS
        if self.by_plan:
            origin = BY_PLAN
        return f"driven joints: {origin}; other joints: {LOOPS}"

    def on(self, model: ReferenceModel, trajectory: Trajectory) -> SolvedSamples:
        """Return the `SolvedSamples` of a `ReferenceModel` at the same times, to judge this motion.

        The reference model is solved for the planned poses or, if `by_plan`, for the joint values.
        """
        if self.by_plan:
            return model.run(self.q)
        return model.run_poses(trajectory.poses(self.times), near=self.q)


def link_motion(
    loops: LoopSolver, trajectory: Trajectory, times: Array, inverse: Callable[[Array], Array] | None
) -> LinkMotion:
    """Return the motion of all links of a mechanism at times (k,) in s of a planned trajectory.

    The driven joints have the values of `inverse`, a function of tool poses (k, 4, 4) that returns q (k, n), at the
    planned poses. In three cases they have the joint values of the plan, which are those of the inverse at the samples
    of the plan, interpolated: without an inverse; if the joint values define the motion (`Trajectory.followed`); if
    the mechanism cannot assume the poses between two samples (fewer than six degrees of freedom), or the inverse
    returns another solution of a redundant mechanism. The other joints follow from `loops`.

    Raises:
        AssemblyError: the loops cannot be closed at one of the times; the message names it.
    """
    mechanism = loops.mechanism
    q = trajectory.joints(times)
    closed = None
    if inverse is not None and not trajectory.followed:
        Ts = trajectory.poses(times)
        solved = _near(inverse(Ts), q, loops)
        if np.isfinite(solved).all() and np.abs(solved - q).max(initial=0.0) <= _SAME_SOLUTION:
            reached = loops.forward_many(solved)
            if np.abs(reached.Ts_base_tool - Ts).max(initial=0.0) <= _REACHED:
                q = solved
                closed = reached
    by_plan = closed is None
    closed = closed or loops.forward_many(q)
    open_rows = np.flatnonzero(~np.isfinite(closed.Ts_base_tool).all(axis=(1, 2)))
    if len(open_rows):
        first_open = int(open_rows[0])
        gap = float(closed.offset[first_open])
        raise AssemblyError(
            f"{mechanism.name}: the loops cannot be closed at t = {times[first_open]:.3f} s of "
            f"'{trajectory.protocol}': the smallest gap is {gap / MM:.3g} mm; check the limits and the CAD with "
            "`twin validate`",
            gap=gap,
        )
    links = loops.link_poses(q, closed.states)
    joints = {joint.name: q[:, i] for i, joint in enumerate(mechanism.active)}
    for joint in mechanism.joints:
        if joint.name in joints or len(joint.free_axes) != 1:
            continue
        values = joint.coordinate(links[joint.parent], links[joint.child])
        if joint.is_angle and joint.limits is None:  # a pose does not determine the number of full turns
            values = np.unwrap(values)
        joints[joint.name] = values
    return LinkMotion(times, q, joints, links, by_plan)


def _near(q: Array, planned: Array, loops: LoopSolver) -> Array:
    """Return joint values (k, n) of the inverse with full turns and auxiliary joints as planned."""
    q_near = q.copy()
    auxiliary = {joint.name for joint in loops.mechanism.auxiliary}
    for i, joint in enumerate(loops.mechanism.active):
        if joint.name in auxiliary:
            q_near[:, i] = planned[:, i]
        elif joint.is_angle:
            # The inverse returns angles within one turn; a plan may have turned further.
            turns = np.round((planned[:, i] - q_near[:, i]) / (2 * np.pi))
            q_near[:, i] += 2 * np.pi * turns
    return q_near
