"""Compute how the links of an instrument move when its tool is displaced, for the forces of contacts of the shaft."""

from __future__ import annotations

import numpy as np

from twin.core.spatial import Array
from twin.simulation.plants.contact.gripper import Gripper

_SMALL = 1e-5
"""Change in rad or m of a joint from which displacements of the links are computed."""

_OFTEN, _OLD = 4, 20
"""Number of steps after which the next joint is computed; number of steps without a call after which all joints are
computed."""


class Levers:
    """Twists of the links of an instrument per displacement of its tool at constant orientation.

    The effects of all joints are computed at the first call. Later, the effect of one joint is computed again every
    `_OFTEN` steps, because the effects change slowly and a tick must be short.
    """

    def __init__(self, gripper: Gripper, phase: int = 0) -> None:
        """Store the instrument; `phase`: delay in steps, different for each instrument to spread the computing time."""
        self._gripper, self._phase, self._step, self._next, self._renewed = gripper, phase, -_OLD, 0, 0
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
        if step - self._step >= _OLD:
            self._joints = [i for i in range(len(q)) if i != self._gripper.jaw]
            self._columns = np.zeros((6 + 6 * len(self._gripper.links), len(self._joints)))
            now, self._renewed = range(len(self._joints)), step + self._phase
        elif step - self._renewed >= _OFTEN:  # not in each step: planes are found in some steps only
            self._renewed = step
            now, self._next = (self._next,), (self._next + 1) % len(self._joints)
        else:
            self._step = step
            return self._twists
        self._step = step
        start = self._poses(q)
        for k in now:
            shifted = q.copy()
            shifted[self._joints[k]] += _SMALL
            pairs = zip(start, self._poses(shifted), strict=True)
            self._columns[:, k] = np.concatenate([_twist(a, b) for a, b in pairs]) / _SMALL
        # Small singular values: joints that hardly move the tool do not carry the links either.
        per_tool = self._columns[6:] @ np.linalg.pinv(self._columns[:6], rcond=1e-6)[:, :3]
        self._twists = np.split(per_tool, len(self._gripper.links))
        return self._twists

    def _poses(self, q: Array) -> list[Array]:
        """Return the poses (4, 4) of the tool and of the links in the World."""
        poses = self._gripper.poses(q)
        return [poses[0] @ self._gripper.T_hand_tool, *poses]


def _twist(T: Array, T_new: Array) -> Array:
    """Return the displacement (3,) and the rotation vector (3,) of a small motion in one vector (6,)."""
    D = T_new[:3, :3] @ T[:3, :3].T
    turn = 0.5 * np.array([D[2, 1] - D[1, 2], D[0, 2] - D[2, 0], D[1, 0] - D[0, 1]])
    return np.concatenate([T_new[:3, 3] - T[:3, 3], turn])
