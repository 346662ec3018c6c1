"""The spanning tree of a mechanism as a Pinocchio model."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports] - installed beside site-packages

from twin.core import spatial
from twin.core.errors import MechanismError
from twin.core.spatial import Array
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.reference.loops import Loops, TreeCoupling, cross_motions, cross_products, point_acceleration

_JOINT_MODELS = {
    "revolute": pin.JointModelRZ,
    "prismatic": pin.JointModelPZ,
    "spherical": pin.JointModelSpherical,
    "free": pin.JointModelFreeFlyer,
}


_TINY = float(np.finfo(float).tiny)
"""Smallest normal number: a divisor instead of 0."""


def _depth_first(mechanism: Mechanism) -> Iterator[Joint]:
    """Yield the joints of the tree depth first; Pinocchio's mass matrix requires consecutive numbers in a subtree."""
    beyond: dict[str, list[Joint]] = {}
    for joint in mechanism.tree:
        beyond.setdefault(joint.parent, []).append(joint)
    pending = beyond.get(mechanism.base, [])[::-1]
    while pending:
        joint = pending.pop()
        yield joint
        pending += beyond.get(joint.child, [])[::-1]


class Tree:
    """Spanning tree of a mechanism as a Pinocchio model.

    Attributes:
        model, data: Pinocchio's model and data.
        joint_id: Pinocchio's joint number, by joint name; fixed joints are missing.
        coordinate, configuration: velocity index and configuration index of each joint with a single coordinate, by
            joint name.
        quaternions: configuration index of the first of the four numbers of each quaternion.
        active, passive: velocity indices of the active joints, in the order of q, and of all others.
        active_places: configuration indices of the active joints, in the order of q.
        are_angles: (n,) bool, whether each active joint is an angle, in the order of q.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        self.model = pin.Model()
        self.joint_id: dict[str, int] = {}
        self._body: dict[str, tuple[int, Array]] = {mechanism.base: (0, np.eye(4))}
        for joint in _depth_first(mechanism):
            self._add(joint)
        for body in mechanism.bodies:
            number, T_joint_body = self._body.get(body.name, (0, np.eye(4)))
            if body.inertia is not None and number:
                inertia = body.inertia.seen_from(T_joint_body)
                body_inertia = pin.Inertia(inertia.mass, inertia.p_body_com, inertia.I_com)
                self.model.appendBodyToJoint(number, body_inertia, pin.SE3.Identity())
        self.data = self.model.createData()
        self.coordinate: dict[str, int] = {}
        self.configuration: dict[str, int] = {}
        for joint in mechanism.tree:
            if len(joint.free_axes) == 1:
                joint_model = self.model.joints[self.joint_id[joint.name]]
                self.coordinate[joint.name] = joint_model.idx_v
                # This index differs from the velocity index after a spherical joint (4 numbers, 3 rates).
                self.configuration[joint.name] = joint_model.idx_q
        count = len(mechanism.active)
        self.active = np.zeros(count, int)
        self.active_places = np.zeros(count, int)
        self.are_angles = np.zeros(count, bool)
        for i, joint in enumerate(mechanism.active):
            self.active[i] = self.coordinate[joint.name]
            self.active_places[i] = self.configuration[joint.name]
            self.are_angles[i] = joint.is_angle
        self.passive = np.setdiff1d(np.arange(self.model.nv), self.active)
        self._mask = self._support_masks()
        tool = mechanism.frame(mechanism.tool)
        self.tool_joint, T_joint_body = self._body[tool.body]
        self.T_joint_tool = T_joint_body @ tool.T_body_frame
        self.loops = Loops(mechanism.loops, self._body, self._mask, self._coupled())
        carriers: set[int] = set()
        for number, _ in self._body.values():
            carriers.add(number)
        self._all = sorted(carriers - {0})  # 0: the base
        closing = {*self.loops.joint_numbers, self.tool_joint}
        for point in mechanism.points:
            number, _ = self._body[point.body]
            closing.add(number)
        self._closing = sorted(closing - {0})
        self._views = self._memory_views()
        self._placements = [T.homogeneous for T in self.model.jointPlacements]
        self._number_joints()

    def __getstate__(self) -> dict[str, object]:
        state = dict(self.__dict__)
        del state["_views"]
        return state

    def __setstate__(self, state: dict[str, object]) -> None:
        self.__dict__ |= state
        self._views = self._memory_views()  # a copied view would no longer show the poses

    def _number_joints(self) -> None:
        """Store the indices of all joints, by type, which `place`, `columns`, `step` and `motions` read."""
        self._chain: list[tuple[int, str, int, int]] = []  # number, kind, configuration index, velocity index
        singles: list[tuple[int, int]] = []  # configuration index, velocity index
        balls: list[tuple[int, int]] = []
        self._flyers: list[int] = []
        self.quaternions: list[int] = []
        self._owner = np.zeros(self.model.nv, int)  # number of the joint of each velocity
        for number in range(1, self.model.njoints):
            joint_model = self.model.joints[number]
            kind = joint_model.shortname()
            place = joint_model.idx_q
            self._chain.append((number, kind, place, joint_model.idx_v))
            self._owner[joint_model.idx_v : joint_model.idx_v + joint_model.nv] = number
            if kind == "JointModelSpherical":
                self.quaternions.append(place)
                balls.append((place, joint_model.idx_v))
            elif kind == "JointModelFreeFlyer":
                self.quaternions.append(place + 3)  # after the position
                self._flyers.append(place)
            else:
                singles.append((place, joint_model.idx_v))
        self._single = np.array(singles, int).reshape(-1, 2).T
        places, columns = np.array(balls, int).reshape(-1, 2).T
        # of each ball: vector and scalar of its quaternion, and its rates
        self._ball_vectors = places[:, None] + np.arange(3)
        self._ball_scalars = places + 3
        self._ball_rates = columns[:, None] + np.arange(3)
        self._fours = np.array(self.quaternions, int)[:, None] + np.arange(4)

    def _add(self, joint: Joint) -> None:
        parent_id, T_id_parent = self._body[joint.parent]
        placement = T_id_parent @ joint.T_parent_joint
        T_joint_child = spatial.inverse(joint.T_child_joint)
        if joint.type == "fixed":
            self._body[joint.child] = (parent_id, placement @ T_joint_child)
            return
        if joint.type == "cylindrical":  # a slide followed by a rotation about the same axis: the order is irrelevant
            parent_id = self.model.addJoint(parent_id, pin.JointModelPZ(), pin.SE3(placement), f"{joint.name}_slide")
            placement = np.eye(4)
            kind = pin.JointModelRZ
        elif joint.type in _JOINT_MODELS:
            kind = _JOINT_MODELS[joint.type]
        else:
            raise MechanismError(f"joint '{joint.name}': the reference model does not support {joint.type} joints")
        number = self.model.addJoint(parent_id, kind(), pin.SE3(placement), joint.name)
        self.joint_id[joint.name] = number
        self._body[joint.child] = (number, T_joint_child)

    def _memory_views(self) -> dict[bool, list[Array]]:
        """Return views of Pinocchio's memory: rotation (3, 3) and position (3, 1) of joint 1, then of joint 2, ...

        The key is the argument `closing_only` of `update`. Copying all views at once takes half the time of copying the
        poses one by one.
        """
        views_of = {}
        for closing_only, numbers in ((True, self._closing), (False, self._all)):
            views = []
            for number in numbers:
                T = self.data.oMi[number]
                views.append(T.rotation)
                views.append(T.translation[:, None])
            views_of[closing_only] = views
        return views_of

    def _coupled(self) -> tuple[TreeCoupling, ...]:
        couplings = []
        for coupling in self.mechanism.couplings:
            columns = []
            places = []
            for name in coupling.joints:
                if name not in self.coordinate:
                    raise MechanismError(
                        f"coupling '{coupling.name}': joint '{name}' closes a loop and therefore has no coordinate; "
                        "list this joint before the joint that should close the loop"
                    )
                columns.append(self.coordinate[name])
                places.append(self.configuration[name])
            ratios = np.array(coupling.ratios)
            angle = self.mechanism.joint(coupling.joints[0]).is_angle
            indices = (np.array(places, int), np.array(columns, int))
            couplings.append(TreeCoupling(coupling.name, *indices, ratios, coupling.total, angle))
        return tuple(couplings)

    def _support_masks(self) -> Array:
        """Return a mask (joints, nv): 1 if a velocity moves a Pinocchio joint, else 0."""
        mask = np.zeros((self.model.njoints, self.model.nv))
        for number in range(1, self.model.njoints):
            joint = self.model.joints[number]
            parent = self.model.parents[number]
            columns = slice(joint.idx_v, joint.idx_v + joint.nv)
            mask[number] = mask[parent]
            mask[number, columns] = 1
        return mask

    def body(self, name: str) -> tuple[int, Array]:
        """Return (number of the Pinocchio joint that carries a body, pose (4, 4) of the body in that joint's frame)."""
        return self._body[name]

    def moves(self, number: int) -> Array:
        """Return a mask (nv,): 1 for each velocity that moves the Pinocchio joint `number`, else 0."""
        return self._mask[number]

    def update(self, X: Array, *, closing_only: bool = False) -> tuple[Array, Array]:
        """Compute joint poses and Jacobians at configurations X (k, nq).

        With `closing_only`, only the poses used by loops, named points and tool are computed, in half the time.

        Returns:
            Poses (k, joints, 4, 4) of the moving joint frames in base, and Jacobians (k, 6, nv). Each column of a
            Jacobian is the twist of one velocity in base at the base origin, linear part first.
        """
        model = self.model
        data = self.data
        count = len(X)
        numbers = self._all
        if closing_only:
            numbers = self._closing
        views = self._views[closing_only]
        poses = np.broadcast_to(np.eye(4), (count, model.njoints, 4, 4)).copy()
        J = np.zeros((count, 6, model.nv))
        # rotations and positions of all joints, side by side
        columns = np.zeros((count, 3, 4 * len(numbers)))
        for k, x in enumerate(X):
            jacobian = pin.computeJointJacobians(model, data, x)
            J[k] = jacobian.reshape(J.shape[1:])  # for one joint: (6,)
            if views:
                np.concatenate(views, axis=1, out=columns[k])
        poses[:, numbers, :3] = columns.reshape(count, 3, len(numbers), 4).swapaxes(1, 2)
        return poses, J

    def place(self, X: Array) -> Array:
        """Return the poses (k, joints, 4, 4) of all joint frames in base at configurations X (k, nq).

        NumPy computes all configurations at once; `update` calls Pinocchio for one configuration at a time.
        """
        poses = np.zeros((len(X), self.model.njoints, 4, 4))
        poses[:, 0] = np.eye(4)
        for number, kind, first, _ in self._chain:
            parent = self.model.parents[number]
            T = poses[:, number]
            np.matmul(poses[:, parent], self._placements[number], out=T)
            x = X[:, first, None]
            if kind == "JointModelPZ":
                T[:, :, 3] += x * T[:, :, 2]
                continue
            if kind == "JointModelRZ":
                c = np.cos(x)
                s = np.sin(x)
                x_axis = c * T[:, :, 0] + s * T[:, :, 1]
                y_axis = c * T[:, :, 1] - s * T[:, :, 0]
                T[:, :, 0] = x_axis
                T[:, :, 1] = y_axis
                continue
            i = first  # of the quaternion
            if kind == "JointModelFreeFlyer":
                i = first + 3
                T[:, :3, 3] += np.einsum("kij,kj->ki", T[:, :3, :3], X[:, first:i])
            q_wxyz = X[:, [i + 3, i, i + 1, i + 2]]  # in Pinocchio, the scalar is the last component
            T[:, :3, :3] = T[:, :3, :3] @ spatial.matrix_from_quat_wxyz(q_wxyz)
        return poses

    def columns(self, poses: Array) -> Array:
        """Return the Jacobians (k, 6, nv) that `update` would return, for poses (k, joints, 4, 4) from `place`."""
        J = np.zeros((len(poses), 6, self.model.nv))
        for number, kind, _, first in self._chain:
            R = poses[:, number, :3, :3]
            p = poses[:, number, :3, 3]
            if kind == "JointModelPZ":
                J[:, :3, first] = R[:, :, 2]
                continue
            column = first
            axes = R
            if kind == "JointModelRZ":
                axes = R[:, :, 2:]
            elif kind == "JointModelFreeFlyer":
                # translations first, then rotations about all axes
                J[:, :3, first : first + 3] = R
                column = first + 3
            turns = slice(column, column + axes.shape[2])
            J[:, :3, turns] = spatial.hat(p) @ axes
            J[:, 3:, turns] = axes
        return J

    def step(self, X: Array, steps: Array) -> Array:
        """Return configurations (k, nq) after tangent steps (k, nv); faster than `integrate` for large k."""
        stepped = np.empty_like(X)
        places, columns = self._single
        stepped[:, places] = X[:, places] + steps[:, columns]
        for place in self._flyers:
            stepped[:, place : place + 7] = self.integrate(X, steps)[:, place : place + 7]
        if not len(self._ball_scalars):
            return self._united(stepped)
        # product of quaternions: (w, v) times (c, u), the rotation of the step
        v = X[:, self._ball_vectors]  # (k, balls, 3)
        w = X[:, self._ball_scalars, None]
        r = steps[:, self._ball_rates] / 2
        half = np.sqrt(np.add.reduce(r * r, axis=-1, keepdims=True))  # a third of the time of np.linalg.norm
        c = np.cos(half)
        # sin(half) / half times r; for half = 0, r is 0 as well
        u = r * (np.sin(half) / np.maximum(half, _TINY))
        stepped[:, self._ball_vectors] = w * u + c * v + cross_products(v, u)
        stepped[:, self._ball_scalars] = (w * c)[..., 0] - np.add.reduce(v * u, axis=-1)
        return self._united(stepped)

    def unit(self, X: Array) -> Array:
        """Return configurations (k, nq) with normalised quaternions; faster than `normalise` for large k."""
        return self._united(X.copy())

    def _united(self, X: Array) -> Array:
        """Normalise the quaternions of configurations X (k, nq) in place, and return X."""
        if self.quaternions:
            four = X[:, self._fours]
            X[:, self._fours] = four / np.sqrt(np.add.reduce(four * four, axis=-1, keepdims=True))
        return X

    def drift(self, X: Array, V: Array) -> tuple[Array, Array]:
        """Return the accelerations at constant velocities V (k, nv) at configurations X (k, nq).

        Returns:
            (k, m) second derivatives of the loop residuals, dA/dt V; and (k, 6) acceleration of the tool in base at its
            origin, dJ/dt V, linear part first.
        """
        poses, J = self.update(X, closing_only=True)
        twists, biases = self.motions(J, V)
        tool = self.tool_joint
        p_tool = self.tool(poses)[:, :3, 3]
        linear = point_acceleration(twists[:, tool], biases[:, tool], p_tool)
        acceleration = np.concatenate([linear, biases[:, tool, 3:]], axis=1)
        T0, T = self.loops.relative(poses)
        return self.loops.drift(T0, T, twists, biases), acceleration

    def motions(self, J: Array, V: Array) -> tuple[Array, Array]:
        """Return (twists, spatial accelerations) of the joints, each (k, joints, 6), at constant velocities V (k, nv).

        Both are in base at the base origin, linear part first. J (k, 6, nv) comes from `update`. The axis of a joint is
        fixed in its body: its derivative is its cross product with the body's twist.
        """
        axes = np.swapaxes(J * V[:, None], 1, 2)  # (k, nv, 6): twist of each velocity
        twists = self._mask @ axes
        bodies = twists[:, self._owner]  # (k, nv, 6): twist of the body that the velocity moves
        return twists, self._mask @ cross_motions(bodies, axes)

    def integrate(self, X: Array, steps: Array) -> Array:
        """Return configurations (k, nq) after tangent steps (k, nv)."""
        return np.array([pin.integrate(self.model, x, v) for x, v in zip(X, steps, strict=True)])

    def normalise(self, X: Array) -> Array:
        """Return configurations (k, nq) with normalised quaternions, for use after interpolation."""
        return np.array([pin.normalize(self.model, x) for x in X])

    def tool(self, poses: Array) -> Array:
        """Return T_base_tool (k, 4, 4) for joint poses from `update`."""
        return poses[:, self.tool_joint] @ self.T_joint_tool

    def tool_jacobian(self, poses: Array, J: Array) -> Array:
        """Return the tool Jacobians (k, 6, nv) in base at the tool's origin, linear part first."""
        twist = J * self._mask[self.tool_joint]
        angular = twist[:, 3:]
        p = self.tool(poses)[:, :3, 3]
        linear = twist[:, :3] - spatial.hat(p) @ angular
        return np.concatenate([linear, angular], axis=1)

    def start(self, rest: Mapping[str, Array]) -> Array:
        """Return the configuration (nq,) nearest to the rest poses `rest`: {name of the body: T_base_body (4, 4)}."""
        x = pin.neutral(self.model)
        for joint in self.mechanism.tree:
            if joint.type == "fixed" or joint.parent not in rest or joint.child not in rest:
                continue
            T = joint.relative(rest[joint.parent], rest[joint.child])
            i = self.model.joints[self.joint_id[joint.name]].idx_q
            angle = float(joint.angle(T))
            if joint.type == "revolute":
                x[i] = angle
            elif joint.type == "prismatic":
                x[i] = T[2, 3]
            elif joint.type == "cylindrical":
                x[i - 1] = T[2, 3]  # the slide is a joint of its own, before the rotation
                x[i] = angle
            else:
                q_wxyz = spatial.quat_from_matrix_wxyz(T[:3, :3])
                q_xyzw = np.roll(q_wxyz, -1)  # in Pinocchio, the scalar is the last component
                if joint.type == "free":
                    x[i : i + 3] = T[:3, 3]
                    i += 3
                x[i : i + 4] = q_xyzw
        return x
