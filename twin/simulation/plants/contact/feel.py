"""Compute the local planes of contacts of instruments and held objects, for the forces on the hands."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Sequence

import casadi as ca
import mujoco
import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.formula import symbolic
from twin.formula.flow import attach
from twin.simulation.local_plane import COUNT, SIZE, WIDTH, LocalPlane, rows
from twin.simulation.plants.contact.gripper import Gripper
from twin.simulation.plants.contact.levers import Levers
from twin.simulation.proxy import proxy

NAME = "planes"
"""Last part of the name of the signal with the planes of a robot."""

_NEAR = 0.2e-3
"""Distance in m between a proxy and a part below which a contact is found, although they do not touch; ASSUMED."""

_FAR = 1e-3
"""Largest motion of a proxy in m in one step; ASSUMED, less than half of the thickness of parts."""

_Touch = tuple[float, int, Array, Array]
"""A contact of an instrument: depth (negative: distance), body of the instrument, deepest point of the instrument, and
normal that points out of the other geom."""


class Feel:
    """Finds the planes of all contacts.

    Whether an instrument is in contact is computed from the commanded joint values. The simulated poses are not used,
    because a jaw whose torque is limited yields when it presses, and may vibrate. A held object yields too: it stays
    outside of the parts that it touches, and slips between the jaws. The depth of a held object is measured at the
    point where the contact would be without slip. Objects that are not held have no planes.

    A part does not stop an instrument: the instrument can move through the part. Therefore, contacts are found at the
    proxy of the instrument, which stays outside of the part, on the side from which the instrument came (Ruspini,
    Kolarov and Khatib, SIGGRAPH 1997). The proxy moves towards the nearest point outside of the latest planes, in steps
    of at most `_FAR`, which is less than the thickness of parts. When the instrument has passed through the part and
    touches nothing, the proxy returns to the instrument.
    """

    def __init__(
        self,
        m: mujoco.MjModel,
        grippers: Sequence[Gripper],
        objects: Sequence[str],
        whose: Sequence[tuple[int, int, int]],
    ) -> None:
        """Find the bodies and geoms of instruments and objects in the model.

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
        self._proxies = [_Proxy() for _ in grippers]
        self._step, self._turn, self._R = 0, np.zeros(4), np.zeros(9)
        self._pushed = [False] * len(grippers)
        self._rigid = copy.copy(m)  # the instruments and the fixed parts, without the objects
        self._rigid.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
        for geom, (item, _, _) in enumerate(whose):
            if item >= 0:
                self._rigid.geom_contype[geom] = self._rigid.geom_conaffinity[geom] = 0
        self._rigid.geom_margin[:] = _NEAR
        self._at = mujoco.MjData(self._rigid)
        self._free = [[m.joint(f"{g.robot}/{b.name}").qposadr[0] for b in g.links] for g in grippers]
        self.outputs = dict.fromkeys((f"{g.robot}.{NAME}" for g in grippers), np.zeros(SIZE))

    def planes(
        self, d: mujoco.MjData, place: Callable[[Array], None], q: Sequence[Array], holders: Sequence[int]
    ) -> dict[str, Array]:
        """Return the signals `<robot>.planes` that have changed; the keys are the names of the signals.

        Args:
            d: data after a step; its contacts and poses belong to the start of the step.
            place: function that writes the present positions of all links and jaws into qpos.
            q: joint values (n,) of each instrument.
            holders: index of the instrument that holds each object; -1: none.
        """
        self._step += 1
        at = self._at
        place(at.qpos)
        # One collision test a step: at the joint values, or with one of the instruments at its proxy, in turn.
        away = [arm for arm, ghost in enumerate(self._proxies) if ghost.away]
        turn = self._step % (len(away) + 1)
        now = self._at_proxy(away[turn - 1], q) if turn else self._at_joints(q)
        held: list[list[LocalPlane]] = [[] for _ in self._grippers]
        for arm, plane in self._held(d, holders):
            held[arm].append(plane)
        out: dict[str, Array] = {}
        for arm, (ghost, planes) in enumerate(zip(self._proxies, held, strict=True)):
            if arm in now or planes or self._pushed[arm]:
                found = rows([*ghost.found, *planes], self._tool(d, arm)) if planes else ghost.planes.copy()
                out[f"{self._grippers[arm].robot}.{NAME}"] = found
            self._pushed[arm] = bool(planes)
        return out

    def _at_joints(self, q: Sequence[Array]) -> list[int]:
        """Start each proxy at its first contact, and release it when nothing is touched; return changed instruments."""
        changed, touched = [], self._touched()
        for arm, (ghost, contacts) in enumerate(zip(self._proxies, touched, strict=True)):
            touches = max((depth for depth, *_ in contacts), default=0.0) > 0
            if touches == ghost.away:
                continue
            changed.append(arm)
            if touches:
                T = self._tool(self._at, arm)
                ghost.find(T, [self._plane(q[arm], arm, T, *contact) for contact in contacts])
            else:
                ghost.release()
        return changed

    def _at_proxy(self, arm: int, q: Sequence[Array]) -> list[int]:
        """Move the proxy of an instrument, and find the planes at the proxy; return the instrument in a list."""
        at, ghost, start = self._at, self._proxies[arm], self._free[arm][0]
        mujoco.mju_quat2Mat(self._R, at.qpos[start + 3 : start + 7])
        T = spatial.pose(self._R.reshape(3, 3), at.qpos[start : start + 3]) @ self._grippers[arm].T_hand_tool
        way = ghost.move(T)
        self._displace(at.qpos, arm, q[arm], way)
        T_proxy = spatial.pose(T[:3, :3], T[:3, 3] + way)
        ghost.find(T, [self._plane(q[arm], arm, T_proxy, *contact) for contact in self._touched()[arm]])
        return [arm]

    def _touched(self) -> list[list[_Touch]]:
        """Return the contacts of each instrument at the positions in `_at`."""
        mujoco.mj_kinematics(self._rigid, self._at)
        mujoco.mj_collision(self._rigid, self._at)
        out: list[list[_Touch]] = [[] for _ in self._grippers]
        for pair, normal, point, depth in _deepest(self._at, _NEAR):
            for geom, n in ((pair[0], -normal), (pair[1], normal)):
                if (arm := self._whose[geom][1]) >= 0:
                    out[arm].append((depth, self._bodies[geom], point - n * (depth / 2), n))
        return out

    def _displace(self, qpos: Array, arm: int, q: Array, way: Array) -> None:
        """Displace the links of an instrument so that its tool moves by `way` (3,) in m at constant orientation."""
        for start, twist in zip(self._free[arm], self._levers[arm].twists(q, self._step), strict=True):
            place, quat = qpos[start : start + 3], qpos[start + 3 : start + 7]
            place += twist[:3] @ way
            turn = twist[3:] @ way
            if (angle := float(np.linalg.norm(turn))) > 0:
                mujoco.mju_axisAngle2Quat(self._turn, turn / angle, angle)
                mujoco.mju_mulQuat(quat, self._turn, quat.copy())

    def _plane(self, q: Array, arm: int, T: Array, depth: float, body: int, point: Array, normal: Array) -> LocalPlane:
        if body not in self._links:  # the hand or a jaw
            return LocalPlane.at_tool(T, point, normal, depth)
        twist = self._levers[arm].twists(q, self._step)[self._links[body]]
        x, y, z = point - self._at.xpos[body]
        turned = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ normal
        lever = twist[:3].T @ normal + twist[3:].T @ turned
        return LocalPlane.at_shaft(T, lever, normal, depth)

    def _held(self, d: mujoco.MjData, holders: Sequence[int]) -> Iterator[tuple[int, LocalPlane]]:
        """Yield (instrument, plane) for contacts of held objects with anything but the instruments that hold them."""
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


class _Proxy:
    """The proxy of an instrument's tool.

    Attributes:
        found: the latest planes.
        planes: (SIZE,) rows of the planes in `found`.
        away: whether the instrument touches something; if not, the proxy is at the tool.
    """

    def __init__(self) -> None:
        """Compile the function that computes the displacement from the tool to the proxy."""
        self.found: list[LocalPlane] = []
        self.planes, self.away, self._T, self._place = np.zeros(SIZE), False, np.zeros(16), np.zeros(3)
        planes, T = ca.SX.sym("planes", SIZE), ca.SX.sym("T", 16)
        found = symbolic.unflat(planes, COUNT, WIDTH)
        levers = ca.horzcat(found[:, :3], found[:, :3], found[:, 6:])  # levers instead of normals
        way, _ = proxy(levers, symbolic.unflat(T, 4, 4))
        self._way, self._compute = attach(ca.Function("proxy", [planes, T], [ca.densify(way)]), self.planes, self._T)

    def release(self) -> None:
        """Move the proxy to the tool."""
        self.found, self.away = [], False
        self.planes[:] = 0

    def find(self, T: Array, planes: list[LocalPlane]) -> None:
        """Set the planes of a tool at T (4, 4); the first call after `release` starts the proxy at the tool."""
        if not self.away:
            self._place, self.away = T[:3, 3].copy(), True
        self.found, self.planes[:] = planes, rows(planes, T)

    def move(self, T: Array) -> Array:
        """Move the proxy towards its target for a tool at T (4, 4); return the offset (3,) in m from tool to proxy."""
        self._T[:] = T.ravel()
        self._compute()
        move = T[:3, 3] + self._way - self._place
        self._place = self._place + move * min(1.0, _FAR / max(float(np.linalg.norm(move)), 1e-12))
        return self._place - T[:3, 3]


def _deepest(d: mujoco.MjData, near: float = 0.0) -> Iterator[tuple[tuple[int, int], Array, Array, float]]:
    """Yield (pair of geoms, normal from first to second geom, point midway, depth) of each pair's deepest contact.

    Pairs that do not touch but are closer than `near` in m are included; their depth is negative.
    """
    if not d.ncon:
        return
    contact, found = d.contact, {}
    for k, (pair, distance) in enumerate(zip(contact.geom.tolist(), contact.dist.tolist(), strict=True)):
        if distance < found.get(tuple(pair), (near, 0))[0]:
            found[tuple(pair)] = distance, k
    for pair, (distance, k) in found.items():
        yield pair, contact.frame[k, :3].copy(), contact.pos[k].copy(), -distance


def _pose(d: mujoco.MjData, body: int) -> Array:
    return spatial.pose(d.xmat[body].reshape(3, 3), d.xpos[body])


def _back(d: mujoco.MjData, body: int) -> Array:
    return spatial.inverse(_pose(d, body))
