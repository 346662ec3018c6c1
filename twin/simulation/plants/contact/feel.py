"""Local planes of the contacts of instruments and of the objects that they hold, for the forces on the hands."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.simulation.local_plane import SIZE, LocalPlane, rows
from twin.simulation.plants.contact.gripper import Gripper

NAME = "planes"
"""Last part of the name of the signal with the planes of a robot."""


class Feel:
    """Finds the planes of all contacts of the last step of MuJoCo.

    The plane of an instrument touches its deepest point. An object that jaws hold stays outside of what it touches, and
    slips between the jaws instead; its plane touches the point where the object would be if it did not slip. Objects
    that nobody holds give way, and are not felt.
    """

    def __init__(
        self,
        m: mujoco.MjModel,
        grippers: Sequence[Gripper],
        objects: Sequence[str],
        whose: Sequence[tuple[int, int, int]],
    ) -> None:
        """Find bodies and geoms.

        Args:
            m: the model.
            grippers: the instruments.
            objects: names of the movable objects.
            whose: index of object, of instrument and of jaw of each geom; -1: none.
        """
        self._grippers, self._whose = tuple(grippers), whose
        self._hands = [m.body(f"{g.robot}/{g.hand.name}").id for g in grippers]
        self._bodies = m.geom_bodyid.tolist()
        self._links = {m.body(f"{g.robot}/{b.name}").id: i for g in grippers for i, b in enumerate(g.links) if i > 0}
        self._items = [m.body(name).id for name in objects]
        self._grasps: dict[int, tuple[int, Array]] = {}
        self._none = dict.fromkeys((f"{g.robot}.{NAME}" for g in grippers), np.zeros(SIZE))
        self._felt = False
        self.outputs = dict(self._none)

    def planes(self, d: mujoco.MjData, q: Sequence[Array], holders: Sequence[int]) -> dict[str, Array]:
        """Return the signals that may have changed.

        Args:
            d: data after a step; its contacts and poses belong to the start of the step.
            q: joint values (n,) of each instrument.
            holders: index of the instrument that holds each object; -1: none.
        """
        found: list[list[LocalPlane]] = [[] for _ in self._grippers]
        pushed = self._contacts(d, q, holders, found) if d.ncon else set[int]()
        for i, arm in enumerate(holders):
            if arm < 0:
                self._grasps.pop(i, None)
            elif i not in pushed or self._grasps.get(i, (-1,))[0] != arm:
                # While an object touches nothing else, its place in the jaws is the one that it would keep.
                self._grasps[i] = arm, spatial.inverse(_pose(d, self._hands[arm])) @ _pose(d, self._items[i])
        if not any(found):
            out, self._felt = (self._none if self._felt else {}), False
            return out
        self._felt = True
        return {
            f"{g.robot}.{NAME}": rows(planes, self._tool(d, k))
            for k, (g, planes) in enumerate(zip(self._grippers, found, strict=True))
        }

    def _contacts(
        self, d: mujoco.MjData, q: Sequence[Array], holders: Sequence[int], found: list[list[LocalPlane]]
    ) -> set[int]:
        """Add the planes of all contacts; return the held objects that touch fixed parts or each other."""
        contact, pushed = d.contact, set[int]()
        for k, (pair, distance) in enumerate(zip(contact.geom.tolist(), contact.dist.tolist(), strict=True)):
            if distance >= 0:
                continue
            for side, other in ((0, 1), (1, 0)):
                item, arm, _ = self._whose[pair[side]]
                if self._whose[pair[other]][0] >= 0 and arm >= 0:
                    continue  # an object in the jaws, or one that gives way
                if item >= 0 and (holders[item] < 0 or self._whose[pair[other]][1] == holders[item]):
                    continue
                normal = contact.frame[k, :3] * (1.0 if side else -1.0)
                point = contact.pos[k] + normal * (distance / 2)
                if arm >= 0:
                    found[arm].append(self._plane(d, q[arm], arm, self._bodies[pair[side]], point, normal, -distance))
                elif item >= 0:
                    pushed.add(item)
                    if item in self._grasps:
                        found[holders[item]].append(self._held(d, item, point, normal, -distance))
        return pushed

    def _plane(
        self, d: mujoco.MjData, q: Array, arm: int, body: int, point: Array, normal: Array, depth: float
    ) -> LocalPlane:
        T = self._tool(d, arm)
        link = self._links.get(body)
        if link is None:  # the hand or a jaw
            return LocalPlane.at_tool(T, point, normal, depth)
        at = spatial.inverse(_pose(d, body)) @ np.append(point, 1.0)
        return LocalPlane.at_shaft(T, self._grippers[arm].carried(q, link, at[:3]).T @ normal, normal, depth)

    def _held(self, d: mujoco.MjData, item: int, point: Array, normal: Array, depth: float) -> LocalPlane:
        arm, T_hand_item = self._grasps[item]
        at = spatial.inverse(_pose(d, self._items[item])) @ np.append(point, 1.0)
        would = (_pose(d, self._hands[arm]) @ T_hand_item @ at)[:3]
        slipped = float(normal @ (point - would))
        return LocalPlane.at_tool(self._tool(d, arm), would, normal, max(slipped, 0.0) + depth)

    def _tool(self, d: mujoco.MjData, arm: int) -> Array:
        return _pose(d, self._hands[arm]) @ self._grippers[arm].T_hand_tool


def _pose(d: mujoco.MjData, body: int) -> Array:
    return spatial.pose(d.xmat[body].reshape(3, 3), d.xpos[body])
