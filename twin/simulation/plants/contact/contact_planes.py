"""Compute the local planes of contacts of instruments and held objects, for the forces on the hands."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from typing import NamedTuple

import casadi as ca
import mujoco
import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.formula import symbolic
from twin.formula.evaluator import attach
from twin.simulation.local_plane import PLANE_COUNT, PLANE_SIZE, SIGNAL_SIZE, LocalPlane, rows
from twin.simulation.plants.contact.collision_shapes import NONE, GeomOwner
from twin.simulation.plants.contact.gripper import Gripper
from twin.simulation.plants.contact.levers import ToolLevers
from twin.simulation.proxy import proxy
from twin.simulation.world.signal_kinds import ROBOT_PLANES

PLANES_SIGNAL = ROBOT_PLANES.what
"""Last part of the name of the signal with the planes of a robot."""

_CONTACT_MARGIN = 0.2e-3
"""Distance in m between a proxy and a part below which a contact is found, although they do not touch; ASSUMED."""

_LARGEST_PROXY_STEP = 1e-3
"""Largest motion of a proxy in m in one step; ASSUMED, less than half of the thickness of parts."""


class _Touch(NamedTuple):
    """A contact of an instrument.

    Attributes:
        depth: depth in m; negative: distance.
        body: body of the instrument.
        point: (3,) deepest point of the instrument in m in the World.
        normal: (3,) unit vector that points out of the other geom.
    """

    depth: float
    body: int
    point: Array
    normal: Array


class _PairContact(NamedTuple):
    """The deepest contact of two geoms: normal from the first to the second geom, point midway, depth in m."""

    geoms: tuple[int, int]
    normal: Array
    point: Array
    depth: float


class _Grasp(NamedTuple):
    """The instrument that holds an object, and the pose (4, 4) of the object in its hand without slip."""

    arm: int
    T_hand_object: Array


class ContactPlanes:
    """Finds the planes of all contacts.

    Whether an instrument is in contact is computed from the commanded joint values. The simulated poses are not used,
    because a jaw whose torque is limited yields when it presses, and may vibrate. A held object yields too: it stays
    outside of the parts that it touches, and slips between the jaws. The depth of a held object is measured at the
    point where the contact would be without slip. Objects that are not held have no planes.

    A part does not stop an instrument: the instrument can move through the part. Therefore, contacts are found at the
    proxy of the instrument, which stays outside of the part, on the side from which the instrument came (Ruspini,
    Kolarov and Khatib, SIGGRAPH 1997). The proxy moves towards the nearest point outside of the latest planes, in steps
    of at most `_LARGEST_PROXY_STEP`, which is less than the thickness of parts. When the instrument has passed through
    the part and touches nothing, the proxy returns to the instrument.
    """

    def __init__(
        self,
        m: mujoco.MjModel,
        grippers: Sequence[Gripper],
        objects: Sequence[str],
        owners: Sequence[GeomOwner],
    ) -> None:
        """Find the bodies and geoms of instruments and objects in the model.

        Args:
            m: the model.
            grippers: the instruments.
            objects: names of the movable objects.
            owners: for each geom: its object, or its instrument and jaw.
        """
        self._grippers = tuple(grippers)
        self._owners = owners
        self._body_of_geom = m.geom_bodyid.tolist()
        self._hand_bodies: list[int] = []
        self._link_index: dict[int, int] = {}  # body -> index in `Gripper.links`, without the hand
        self._levers: list[ToolLevers] = []
        self._proxies: list[_Proxy] = []
        self._addresses: list[list[int]] = []  # of the links' free joints in qpos
        self.outputs: dict[str, Array] = {}
        for k, gripper in enumerate(grippers):
            addresses = []
            for i, link in enumerate(gripper.links):
                name = f"{gripper.robot}/{link.name}"
                addresses.append(m.joint(name).qposadr[0])
                if i == 0:
                    self._hand_bodies.append(m.body(name).id)
                else:
                    self._link_index[m.body(name).id] = i
            self._addresses.append(addresses)
            # Different phases: the instruments do not compute their levers in the same step.
            self._levers.append(ToolLevers(gripper, 2 * k))
            self._proxies.append(_Proxy())
            self.outputs[ROBOT_PLANES.of(gripper.robot)] = np.zeros(SIGNAL_SIZE)
        self._object_bodies = [m.body(name).id for name in objects]
        self._grasps: dict[int, _Grasp] = {}
        self._step = 0
        self._turn_quaternion = np.zeros(4)
        self._rotation_values = np.zeros(9)
        self._had_held_planes = [False] * len(grippers)
        self._model_without_objects = copy.copy(m)  # the instruments and the fixed parts, without the objects
        self._model_without_objects.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
        for geom, owner in enumerate(owners):
            if owner.item != NONE:
                self._model_without_objects.geom_contype[geom] = 0
                self._model_without_objects.geom_conaffinity[geom] = 0
        self._model_without_objects.geom_margin[:] = _CONTACT_MARGIN
        self._data = mujoco.MjData(self._model_without_objects)  # at the joint values, or at a proxy

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
        place(self._data.qpos)
        # One collision test a step: at the joint values, or with one of the instruments at its proxy, in turn.
        arms_in_contact = []
        for arm in range(len(self._proxies)):
            if self._proxies[arm].touches:
                arms_in_contact.append(arm)
        turn = self._step % (len(arms_in_contact) + 1)
        if turn == 0:
            changed = self._at_joints(q)
        else:
            changed = [arms_in_contact[turn - 1]]
            self._at_proxy(arms_in_contact[turn - 1], q)
        held_planes = self._held(d, holders)
        signals: dict[str, Array] = {}
        for arm, arm_proxy in enumerate(self._proxies):
            planes = held_planes[arm]
            # A plane of a held object that was in the last signal must be taken out of it, too.
            if arm in changed or planes or self._had_held_planes[arm]:
                if planes:
                    values = rows([*arm_proxy.local_planes, *planes], self._tool(d, arm))
                else:
                    values = arm_proxy.planes.copy()
                signals[ROBOT_PLANES.of(self._grippers[arm].robot)] = values
            self._had_held_planes[arm] = bool(planes)
        return signals

    def _at_joints(self, q: Sequence[Array]) -> list[int]:
        """Start each proxy at its first contact, and release it when nothing is touched; return changed instruments."""
        changed = []
        for arm, touches in enumerate(self._touches()):
            arm_proxy = self._proxies[arm]
            deepest = 0.0
            for touch in touches:
                deepest = max(deepest, touch.depth)
            if (deepest > 0) == arm_proxy.touches:
                continue
            changed.append(arm)
            if deepest > 0:
                T = self._tool(self._data, arm)
                arm_proxy.find(T, self._planes_of(touches, q[arm], arm, T))
            else:
                arm_proxy.release()
        return changed

    def _at_proxy(self, arm: int, q: Sequence[Array]) -> None:
        """Move the proxy of an instrument, and find the planes at the proxy."""
        start = self._addresses[arm][0]
        position = self._data.qpos[start : start + 3]
        mujoco.mju_quat2Mat(self._rotation_values, self._data.qpos[start + 3 : start + 7])
        T = spatial.pose(self._rotation_values.reshape(3, 3), position) @ self._grippers[arm].T_hand_tool
        offset = self._proxies[arm].move(T)
        self._displace(self._data.qpos, arm, q[arm], offset)
        T_proxy = spatial.pose(T[:3, :3], T[:3, 3] + offset)
        touches = self._touches()[arm]
        self._proxies[arm].find(T, self._planes_of(touches, q[arm], arm, T_proxy))

    def _touches(self) -> list[list[_Touch]]:
        """Return the contacts of each instrument at the positions in `_data`."""
        mujoco.mj_kinematics(self._model_without_objects, self._data)
        mujoco.mj_collision(self._model_without_objects, self._data)
        touches: list[list[_Touch]] = [[] for _ in self._grippers]
        for (first, second), normal, point, depth in _deepest(self._data, _CONTACT_MARGIN):
            # MuJoCo's normal points out of the first geom
            for geom, outward in ((first, -normal), (second, normal)):
                arm = self._owners[geom].arm
                if arm != NONE:
                    deepest_point = point - outward * (depth / 2)
                    touches[arm].append(_Touch(depth, self._body_of_geom[geom], deepest_point, outward))
        return touches

    def _displace(self, qpos: Array, arm: int, q: Array, offset: Array) -> None:
        """Displace the links of an instrument so that its tool moves by `offset` (3,) in m at constant orientation."""
        twists = self._levers[arm].twists(q, self._step)
        for start, twist in zip(self._addresses[arm], twists, strict=True):
            position = qpos[start : start + 3]
            quaternion = qpos[start + 3 : start + 7]
            position += twist[:3] @ offset
            turn = twist[3:] @ offset
            angle = float(np.linalg.norm(turn))
            if angle > 0:
                mujoco.mju_axisAngle2Quat(self._turn_quaternion, turn / angle, angle)
                mujoco.mju_mulQuat(quaternion, self._turn_quaternion, quaternion.copy())

    def _planes_of(self, touches: Sequence[_Touch], q: Array, arm: int, T_world_tool: Array) -> list[LocalPlane]:
        """Return the planes of contacts of an instrument at joint values q (n,) with its tool at T_world_tool."""
        planes = []
        for depth, body, point, normal in touches:
            if body in self._link_index:
                lever = self._lever(q, arm, body, point, normal)
                plane = LocalPlane.at_shaft(T_world_tool, lever, normal, depth)
            else:  # the hand or a jaw
                plane = LocalPlane.at_tool(T_world_tool, point, normal, depth)
            planes.append(plane)
        return planes

    def _lever(self, q: Array, arm: int, body: int, point: Array, normal: Array) -> Array:
        """Return the displacement (3,) of a link's point along the normal per displacement of the tool."""
        twist = self._levers[arm].twists(q, self._step)[self._link_index[body]]
        x, y, z = point - self._data.xpos[body]
        moment = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ normal
        return twist[:3].T @ normal + twist[3:].T @ moment

    def _held(self, d: mujoco.MjData, holders: Sequence[int]) -> list[list[LocalPlane]]:
        """Return planes for each instrument: contacts of its held objects with anything but this instrument."""
        planes: list[list[LocalPlane]] = [[] for _ in self._grippers]
        pushed_items = set()
        contacts: list[_PairContact] = []
        if max(holders, default=NONE) != NONE:
            contacts = _deepest(d)
        for (first, second), normal, point, depth in contacts:
            for geom, other_geom, outward in ((first, second, -normal), (second, first, normal)):
                item = self._owners[geom].item
                if item == NONE:
                    continue
                arm = holders[item]
                if arm == NONE or self._owners[other_geom].arm == arm:
                    continue
                pushed_items.add(item)
                if item in self._grasps:
                    touched_point = point - outward * (depth / 2)
                    T_world_hand = _pose(d, self._hand_bodies[arm])
                    T_object_world = spatial.inverse(_pose(d, self._object_bodies[item]))
                    undo_slip = T_world_hand @ self._grasps[item].T_hand_object @ T_object_world
                    point_without_slip = undo_slip[:3, :3] @ touched_point + undo_slip[:3, 3]
                    slip = max(float(outward @ (touched_point - point_without_slip)), 0.0)
                    plane = LocalPlane.at_tool(self._tool(d, arm), point_without_slip, outward, depth + slip)
                    planes[arm].append(plane)
        self._store_grasps(d, holders, pushed_items)
        return planes

    def _store_grasps(self, d: mujoco.MjData, holders: Sequence[int], pushed_items: set[int]) -> None:
        """Store the pose in the hand of each held object that is not in `pushed_items`: nothing else touches it."""
        for item, arm in enumerate(holders):
            if arm == NONE:
                self._grasps.pop(item, None)
                continue
            grasp = self._grasps.get(item)
            if item not in pushed_items or grasp is None or grasp.arm != arm:
                # While an object touches nothing else, its present pose in the jaws is the one without slip.
                T_hand_world = spatial.inverse(_pose(d, self._hand_bodies[arm]))
                self._grasps[item] = _Grasp(arm, T_hand_world @ _pose(d, self._object_bodies[item]))

    def _tool(self, d: mujoco.MjData, arm: int) -> Array:
        return _pose(d, self._hand_bodies[arm]) @ self._grippers[arm].T_hand_tool


class _Proxy:
    """The proxy of an instrument's tool.

    Attributes:
        local_planes: the latest planes.
        planes: (SIZE,) rows of the planes in `local_planes`.
        touches: whether the instrument touches something; if not, the proxy is at the tool.
    """

    def __init__(self) -> None:
        """Compile the function that computes the displacement from the tool to the proxy."""
        self.local_planes: list[LocalPlane] = []
        self.planes = np.zeros(SIGNAL_SIZE)
        self.touches = False
        self._T = np.zeros(16)
        self._position = np.zeros(3)
        planes = ca.SX.sym("planes", SIGNAL_SIZE)
        T = ca.SX.sym("T", 16)
        planes_by_row = symbolic.unflat(planes, PLANE_COUNT, PLANE_SIZE)
        levers = ca.horzcat(
            planes_by_row[:, :3], planes_by_row[:, :3], planes_by_row[:, 6:]
        )  # levers instead of normals
        displacement, _ = proxy(levers, symbolic.unflat(T, 4, 4))
        function = ca.Function("proxy", [planes, T], [ca.densify(displacement)])
        self._displacement, self._compute = attach(function, self.planes, self._T)

    def release(self) -> None:
        """Move the proxy to the tool."""
        self.local_planes = []
        self.touches = False
        self.planes[:] = 0

    def find(self, T: Array, planes: list[LocalPlane]) -> None:
        """Set the planes of a tool at T (4, 4); the first call after `release` starts the proxy at the tool."""
        if not self.touches:
            self._position = T[:3, 3].copy()
            self.touches = True
        self.local_planes = planes
        self.planes[:] = rows(planes, T)

    def move(self, T: Array) -> Array:
        """Move the proxy towards its target for a tool at T (4, 4); return the offset (3,) in m from tool to proxy."""
        self._T[:] = T.ravel()
        self._compute()
        step = T[:3, 3] + self._displacement - self._position
        length = max(float(np.linalg.norm(step)), 1e-12)  # not 0, by which it is divided
        self._position = self._position + step * min(1.0, _LARGEST_PROXY_STEP / length)
        return self._position - T[:3, 3]


def _deepest(d: mujoco.MjData, margin: float = 0.0) -> list[_PairContact]:
    """Return the deepest contact of each pair of geoms.

    Pairs that do not touch but are closer than `margin` in m are included; their depth is negative.
    """
    if not d.ncon:
        return []
    contact = d.contact
    distances = contact.dist.tolist()
    indices: dict[tuple[int, int], int] = {}
    for k, (first, second) in enumerate(contact.geom.tolist()):
        limit = margin
        if (first, second) in indices:
            limit = distances[indices[first, second]]
        if distances[k] < limit:
            indices[first, second] = k
    deepest = []
    for pair, k in indices.items():
        deepest.append(_PairContact(pair, contact.frame[k, :3].copy(), contact.pos[k].copy(), -distances[k]))
    return deepest


def _pose(d: mujoco.MjData, body: int) -> Array:
    return spatial.pose(d.xmat[body].reshape(3, 3), d.xpos[body])
