"""Compute how the links of an instrument move when its tool is displaced, for the forces of contacts of the shaft."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from twin.core.spatial import Array
from twin.simulation.plants.contact.gripper import Gripper

_JOINT_STEP = 1e-5
"""Change in rad or m of a joint from which displacements of the links are computed."""

_RENEWAL_STEPS = 4
"""Number of steps after which the next joint is computed."""

_OUTDATED_STEPS = 20
"""Number of steps without a call after which all joints are computed."""


class ToolLevers:
    """Twists of the links of an instrument per displacement of its tool at constant orientation.

    The effects of all joints are computed at the first call. Later, the effect of one joint is computed again every
    `_RENEWAL_STEPS` steps, because the effects change slowly and a tick must be short.
    """

    def __init__(self, gripper: Gripper, phase: int = 0) -> None:
        """Store the instrument; `phase`: delay in steps, different for each instrument to spread the computing time."""
        self._gripper = gripper
        self._phase = phase
        self._last_call = -_OUTDATED_STEPS
        self._last_renewal = 0  # step in which a joint was computed last
        self._next_joint = 0  # joint to compute next
        self._twists: list[Array] = []
        self._tool_joints: list[int] = []
        self._columns = np.zeros((0, 0))

    def twists(self, q: Array, step: int) -> list[Array]:
        """Return one matrix (6, 3) per link of `Gripper.links`: twist of the link per displacement of the tool.

        The first three rows are the velocity of the link's origin, the others its angular velocity, in the World.

        Args:
            q: (n,) joint values.
            step: number of the step.
        """
        steps_unused = step - self._last_call
        self._last_call = step
        if steps_unused >= _OUTDATED_STEPS:
            self._tool_joints = list(range(len(q)))
            if self._gripper.jaw >= 0:
                self._tool_joints.remove(self._gripper.jaw)
            self._columns = np.zeros((6 + 6 * len(self._gripper.links), len(self._tool_joints)))
            self._last_renewal = step + self._phase
            self._compute(q, range(len(self._tool_joints)))
        elif step - self._last_renewal >= _RENEWAL_STEPS:  # not in each step: planes are found in some steps only
            self._last_renewal = step
            self._compute(q, [self._next_joint])
            self._next_joint = (self._next_joint + 1) % len(self._tool_joints)
        return self._twists

    def _compute(self, q: Array, joints: Iterable[int]) -> None:
        """Compute the effects of joints at joint values q (n,), then the twists."""
        start = self._poses(q)
        for k in joints:
            shifted = q.copy()
            shifted[self._tool_joints[k]] += _JOINT_STEP
            twists = list(map(_twist, start, self._poses(shifted)))
            self._columns[:, k] = np.concatenate(twists) / _JOINT_STEP
        # Small singular values: joints that hardly move the tool do not carry the links either.
        joints_per_twist = np.linalg.pinv(self._columns[:6], rcond=1e-6)
        per_tool = self._columns[6:] @ joints_per_twist[:, :3]
        self._twists = np.split(per_tool, len(self._gripper.links))

    def _poses(self, q: Array) -> list[Array]:
        """Return the poses (4, 4) of the tool and of the links in the World."""
        poses = self._gripper.poses(q)
        return [poses[0] @ self._gripper.T_hand_tool, *poses]


def _twist(T: Array, T_new: Array) -> Array:
    """Return the displacement (3,) and the rotation vector (3,) of a small motion in one vector (6,)."""
    D = T_new[:3, :3] @ T[:3, :3].T
    turn = 0.5 * np.array([D[2, 1] - D[1, 2], D[0, 2] - D[2, 0], D[1, 0] - D[0, 1]])
    return np.concatenate([T_new[:3, 3] - T[:3, 3], turn])
