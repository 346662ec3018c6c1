"""Local planes of the contacts of instruments and of the objects that they hold, for the forces on the hands."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Sequence

import mujoco
import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.simulation.local_plane import COUNT, SIZE, LocalPlane, rows
from twin.simulation.plants.contact.gripper import Gripper
from twin.simulation.plants.contact.levers import Levers

NAME = "planes"
"""Last part of the name of the signal with the planes of a robot."""

_OPPOSITE = -0.5
"""Cosine of the angle between two normals; below this cosine, the normals belong to opposite sides of a part."""

_Touch = tuple[float, tuple[int, int], int, Array, Array]
"""A contact of an instrument: depth, both geoms (first the instrument's), body and deepest point of the instrument,
normal out of the other geom."""


class Feel:
    """Finds the planes of all contacts at the present joint values.

    Contacts of instruments are found at the commanded joint values, not at the simulated poses: a jaw whose torque is
    limited yields when it presses, and may vibrate. A held object yields too: it stays outside of the parts that it
    touches, and slips between the jaws. The depth of a held object is measured at the point where the contact would be
    without slip. Objects that are not held have no planes.

    A part does not stop an instrument, which can move through it. If the normal of a contact changes to the opposite
    side meanwhile, the previous plane is kept: the force pushes the instrument back to the side from which it came.
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
            whose: for each geom: index of its object, index of its instrument, index of its jaw; -1: none.
        """
        self._grippers, self._whose = tuple(grippers), whose
        self._hands = [m.body(f"{g.robot}/{g.hand.name}").id for g in grippers]
        self._bodies = m.geom_bodyid.tolist()
        self._links = {m.body(f"{g.robot}/{b.name}").id: i for g in grippers for i, b in enumerate(g.links) if i > 0}
        self._items = [m.body(name).id for name in objects]
        self._grasps: dict[int, tuple[int, Array]] = {}
        self._levers = [Levers(g, 2 * k) for k, g in enumerate(grippers)]
        self._sides: dict[tuple[int, int], LocalPlane] = {}
        self._step, self._felt = 0, False
        self._rigid = copy.copy(m)  # the instruments and the fixed parts, without the objects
        self._rigid.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
        for geom, (item, _, _) in enumerate(whose):
            if item >= 0:
                self._rigid.geom_contype[geom] = self._rigid.geom_conaffinity[geom] = 0
        self._at = mujoco.MjData(self._rigid)
        self._none = dict.fromkeys((f"{g.robot}.{NAME}" for g in grippers), np.zeros(SIZE))
        self.outputs = dict(self._none)

    def planes(
        self, d: mujoco.MjData, place: Callable[[Array], None], q: Sequence[Array], holders: Sequence[int]
    ) -> dict[str, Array]:
        """Return the signals that may have changed.

        Args:
            d: data after a step; its contacts and poses belong to the start of the step.
            place: function that writes the present positions of all links and jaws into qpos.
            q: joint values (n,) of each instrument.
            holders: index of the instrument that holds each object; -1: none.
        """
        self._step += 1
        at = self._at
        place(at.qpos)
        mujoco.mj_kinematics(self._rigid, at)
        mujoco.mj_collision(self._rigid, at)
        tools = [self._tool(at, k) for k in range(len(self._grippers))]
        found: list[list[LocalPlane]] = [[] for _ in self._grippers]
        sides, self._sides = self._sides, {}
        for arm, contacts in enumerate(self._instruments()):
            for k, (_, key, *_, normal) in enumerate(contacts):
                if (side := sides.get(key)) is not None and side.normal @ normal < _OPPOSITE:
                    self._sides[key] = side
                    contacts[k] = (side.depth(tools[arm]), *contacts[k][1:])
            contacts.sort(key=lambda contact: -contact[0])
            for depth, key, body, point, normal in contacts[:COUNT]:
                if key not in self._sides:
                    self._sides[key] = self._plane(q[arm], arm, tools[arm], depth, body, point, normal)
                found[arm].append(self._sides[key])
        for arm, plane in self._held(d, holders):
            found[arm].append(plane)
        if not any(found):
            out, self._felt = (self._none if self._felt else {}), False
            return out
        self._felt = True
        return {f"{g.robot}.{NAME}": rows(found[k], tools[k]) for k, g in enumerate(self._grippers)}

    def _instruments(self) -> list[list[_Touch]]:
        """Return the contacts of each instrument."""
        out: list[list[_Touch]] = [[] for _ in self._grippers]
        for pair, normal, point, depth in _deepest(self._at):
            for geom, other, n in ((*pair, -normal), (*pair[::-1], normal)):
                if (arm := self._whose[geom][1]) >= 0:
                    out[arm].append((depth, (geom, other), self._bodies[geom], point - n * (depth / 2), n))
        return out

    def _plane(self, q: Array, arm: int, T: Array, depth: float, body: int, point: Array, normal: Array) -> LocalPlane:
        if body not in self._links:  # the hand or a jaw
            return LocalPlane.at_tool(T, point, normal, depth)
        twist = self._levers[arm].twists(q, self._step)[self._links[body]]
        x, y, z = point - self._at.xpos[body]
        turned = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ normal
        lever = twist[:3].T @ normal + twist[3:].T @ turned
        return LocalPlane.at_shaft(T, lever, normal, depth)

    def _held(self, d: mujoco.MjData, holders: Sequence[int]) -> Iterator[tuple[int, LocalPlane]]:
        """Yield (instrument, plane) of each held object that touches anything but its instrument."""
        pushed = set()
        for pair, normal, point, depth in _deepest(d) if max(holders, default=-1) >= 0 else ():
            for geom, other, sign in ((*pair, -1.0), (*pair[::-1], 1.0)):
                item, arm = self._whose[geom][0], holders[self._whose[geom][0]] if self._whose[geom][0] >= 0 else -1
                if arm < 0 or self._whose[other][1] == arm:
                    continue
                pushed.add(item)
                if item in self._grasps:
                    n = sign * normal
                    back = _pose(d, self._hands[arm]) @ self._grasps[item][1] @ _back(d, self._items[item])
                    would = back[:3, :3] @ (point - n * (depth / 2)) + back[:3, 3]
                    slipped = max(float(n @ (point - n * (depth / 2) - would)), 0.0)
                    yield arm, LocalPlane.at_tool(self._tool(d, arm), would, n, depth + slipped)
        for i, arm in enumerate(holders):
            if arm < 0:
                self._grasps.pop(i, None)
            elif i not in pushed or self._grasps.get(i, (-1,))[0] != arm:
                # While an object touches nothing else, its present pose in the jaws is the one without slip.
                self._grasps[i] = arm, _back(d, self._hands[arm]) @ _pose(d, self._items[i])

    def _tool(self, d: mujoco.MjData, arm: int) -> Array:
        return _pose(d, self._hands[arm]) @ self._grippers[arm].T_hand_tool


def _deepest(d: mujoco.MjData) -> Iterator[tuple[tuple[int, int], Array, Array, float]]:
    """Yield (geoms, normal from the first to the second, point between both, depth) of each pair's deepest contact."""
    if not d.ncon:
        return
    contact, found = d.contact, {}
    for k, (pair, distance) in enumerate(zip(contact.geom.tolist(), contact.dist.tolist(), strict=True)):
        if distance < found.get(tuple(pair), (0.0, 0))[0]:
            found[tuple(pair)] = distance, k
    for pair, (distance, k) in found.items():
        yield pair, contact.frame[k, :3].copy(), contact.pos[k].copy(), -distance


def _pose(d: mujoco.MjData, body: int) -> Array:
    return spatial.pose(d.xmat[body].reshape(3, 3), d.xpos[body])


def _back(d: mujoco.MjData, body: int) -> Array:
    return spatial.inverse(_pose(d, body))
