"""Compute how the links of an instrument move when its tool is displaced, for the forces of contacts of the shaft."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from twin.core.spatial import Array
from twin.simulation.plants.contact.gripper import Gripper

_SMALL = 1e-5
"""Change in rad or m of a joint from which displacements of the links are computed."""

_OFTEN = 4
"""Number of steps after which the next joint is computed."""

_OLD = 20
"""Number of steps without a call after which all joints are computed."""


class ToolLevers:
    """Twists of the links of an instrument per displacement of its tool at constant orientation.

    The effects of all joints are computed at the first call. Later, the effect of one joint is computed again every
    `_OFTEN` steps, because the effects change slowly and a tick must be short.
    """

    def __init__(self, gripper: Gripper, phase: int = 0) -> None:
        """Store the instrument; `phase`: delay in steps, different for each instrument to spread the computing time."""
        self._gripper = gripper
        self._phase = phase
        self._last_call = -_OLD
        self._renewed = 0  # step in which a joint was computed last
        self._next = 0  # joint to compute next
        self._twists: list[Array] = []
        self._joints: list[int] = []
        self._columns = np.zeros((0, 0))

    def twists(self, q: Array, step: int) -> list[Array]:
        """Return one matrix (6, 3) per link of `Gripper.links`: twist of the link per displacement of the tool.

        The first three rows are the velocity of the link's origin, the others its angular velocity, in the World.

        Args:
            q: (n,) joint values.
            step: number of the step.
        """
        unused = step - self._last_call
        self._last_call = step
        if unused >= _OLD:
            self._joints = list(range(len(q)))
            if self._gripper.jaw >= 0:
                self._joints.remove(self._gripper.jaw)
            self._columns = np.zeros((6 + 6 * len(self._gripper.links), len(self._joints)))
            self._renewed = step + self._phase
            self._compute(q, range(len(self._joints)))
        elif step - self._renewed >= _OFTEN:  # not in each step: planes are found in some steps only
            self._renewed = step
            self._compute(q, [self._next])
            self._next = (self._next + 1) % len(self._joints)
        return self._twists

    def _compute(self, q: Array, joints: Iterable[int]) -> None:
        """Compute the effects of joints at joint values q (n,), then the twists."""
        start = self._poses(q)
        for k in joints:
            shifted = q.copy()
            shifted[self._joints[k]] += _SMALL
            twists = list(map(_twist, start, self._poses(shifted)))
            self._columns[:, k] = np.concatenate(twists) / _SMALL
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
