"""The closed loops of any mechanism as CasADi expressions: residuals, their derivatives, and the pose of every body.

Unknowns are the coordinates of the passive tree joints. The state of a ball joint is a unit quaternion (w x y z), and a
step multiplies this quaternion by a small rotation, so that no orientation is singular. The gap of a loop is expressed
in the frame of the body at which the two branches of the loop separate, so that the joints common to both branches
cancel.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.model.joint import Joint
from twin.model.mechanism import Coupling, Mechanism

LENGTH_SCALE = 0.1
"""Length in m by which radians are multiplied in residuals."""

STATE_SIZES = {"fixed": 0, "revolute": 1, "prismatic": 1, "cylindrical": 2, "spherical": 4, "free": 7}
"""Count of numbers in the state of a passive joint, by type; lengths before angles, or before a quaternion."""

STEP_SIZES = {"fixed": 0, "revolute": 1, "prismatic": 1, "cylindrical": 2, "spherical": 3, "free": 6}
"""Count of numbers in a step of a passive joint, by type; lengths before angles."""

_ROTATION_X = 3
"""Number of the rotation about x among the six `free_axes` of a joint, which are shifts first."""

_ROTATION_Z = 5
"""Number of the rotation about z among the six `free_axes` of a joint."""

_QUATERNION_TYPES = ("spherical", "free")
"""Types whose state ends in a unit quaternion."""

_ROUNDING = 4e-16
"""Difference from 0, 1 or -1 below which an entry of a measured rotation is rounded to this number."""


@dataclass(frozen=True)
class Passive:
    """A passive joint of the tree: symbols of its state and of a step of the state."""

    joint: Joint
    state: ca.SX
    step: ca.SX

    @property
    def name(self) -> str:
        """Name of the joint."""
        return self.joint.name

    @property
    def key(self) -> str:
        """Name of the joint's state in kernels, with a prefix that no input name and no result name has."""
        return f"joint.{self.joint.name}"

    def stepped(self, step: ca.SX) -> ca.SX:
        """Return the state of the joint after a step (m or rad; a small rotation for a quaternion)."""
        if self.joint.type not in _QUATERNION_TYPES:
            return self.state + step
        lengths = self.state[:-4]
        quat_wxyz = self.state[-4:]
        turn = step[-3:] / 2
        w = quat_wxyz[0]
        v = quat_wxyz[1:]
        turned = ca.vertcat(w - ca.dot(v, turn), v + w * turn + ca.cross(v, turn))
        return ca.vertcat(lengths + step[:-3], turned / ca.sqrt(ca.sumsqr(turned)))


def stepped(passive: Iterable[Passive], step: ca.SX) -> dict[str, ca.SX]:
    """Return {key: state} of passive joints after a step; `step` stacks the steps of all these joints."""
    states: dict[str, ca.SX] = {}
    start = 0
    for joint in passive:
        end = start + joint.step.numel()
        states[joint.key] = joint.stepped(step[start:end])
        start = end
    return states


def _unknown_joints(mechanism: Mechanism) -> list[Passive]:
    """Return the passive joints of a mechanism's tree, with symbols for their states and steps."""
    joints: list[Passive] = []
    for joint in mechanism.tree:
        if joint.active or joint.type == "fixed":
            continue
        state = ca.SX.sym(joint.name, STATE_SIZES[joint.type])
        step = ca.SX.sym(f"d_{joint.name}", STEP_SIZES[joint.type])
        joints.append(Passive(joint, state, step))
    return joints


@dataclass(frozen=True)
class _FrameError:
    """A frame error (6,) in the frame's own axes: shift in m, rotation in rad; `back`: the inverse error applies."""

    shift_and_turn: ca.SX
    back: bool


Chain = list[Array | Joint | _FrameError]
"""A chain from a body to a frame: fixed poses (4, 4), moving joints, and frame errors."""


class LoopEquations:
    """The loop equations of a mechanism and their derivatives.

    Attributes:
        mechanism: the mechanism with these loops.
        q: active joints (n,), in the order of `Mechanism.active`.
        passive: the passive joints, whose coordinates are the unknowns.
        residual: (m,) offsets in m and misalignments times `LENGTH_SCALE`; couplings last. A misalignment is the sine
            of an angle, which is the angle in rad as far as it is small.
        jacobian: (m, steps) derivative of the residual with respect to the steps of all unknowns, joint by joint.
        row_names: for each row, the name of the loop joint or coupling to which the row belongs.
        offset, tilt: norm of the offsets of all loops in m; norm of the misalignments of all loops, in which an
            inverted joint counts as 1.
        T_base_tool: (4, 4) pose of the tool.
        errors: symbols or expressions (6,) of the error of a joint frame, by (joint, "parent" or "child"), in the
            frame's own axes: shift in m, then rotation in rad. The equations are accurate to second order in the
            rotation. Empty if not requested.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        *,
        with_errors: bool = False,
        errors: Mapping[tuple[str, str], ca.SX] | None = None,
    ) -> None:
        """Build the equations; `errors` are expressions (6,) of frame errors, `with_errors` a symbol for each frame."""
        self.mechanism = mechanism
        self.errors = dict(errors or {})
        if with_errors:
            for joint in mechanism.joints:
                for side in ("parent", "child"):
                    self.errors[joint.name, side] = ca.SX.sym(f"e_{joint.name}_{side}", 6)
        self.q = ca.SX.sym("q", len(mechanism.active))
        # {active joint: its index in q}
        self._active_index: dict[str, int] = {}
        for i, joint in enumerate(mechanism.active):
            self._active_index[joint.name] = i

        self.passive = _unknown_joints(mechanism)
        self._passive_by_name: dict[str, Passive] = {}
        for passive in self.passive:
            self._passive_by_name[passive.name] = passive
        self.states = _stack(passive.state for passive in self.passive)
        self.steps = _stack(passive.step for passive in self.passive)

        names: list[str] = []
        rows: list[ca.SX] = []
        stepping_rows: list[ca.SX] = []  # the same after a step, of which only the derivative is used
        squared_offsets = [ca.SX(0)]
        squared_tilts = [ca.SX(0)]
        for joint in mechanism.loops:
            length, angle, cosine = self._misfit(joint, stepping=False)
            rows += [length, LENGTH_SCALE * angle]
            names += [joint.name] * (length.numel() + angle.numel())
            squared_offsets.append(ca.sumsqr(length))
            # An inverted joint, whose cosine is -1, has a sine of 0 as a closed one has: it must count as open.
            squared_tilts.append(ca.sumsqr(angle) + ca.if_else(cosine < 0, 1, 0))
            length, angle, _ = self._misfit(joint, stepping=True)
            stepping_rows += [length, LENGTH_SCALE * angle]

        for coupling in mechanism.couplings:
            total = self._coupling_residual(coupling, stepping=False)
            stepping_total = self._coupling_residual(coupling, stepping=True)
            names.append(coupling.name)
            if mechanism.joint(coupling.joints[0]).is_angle:
                rows.append(LENGTH_SCALE * total)
                squared_tilts.append(total**2)
                stepping_rows.append(LENGTH_SCALE * stepping_total)
            else:
                rows.append(total)
                squared_offsets.append(total**2)
                stepping_rows.append(stepping_total)

        self.row_names = tuple(names)
        self.residual = _stack(rows)
        jacobian = ca.jacobian(_stack(stepping_rows), self.steps)
        self.jacobian = ca.substitute(jacobian, self.steps, 0)
        # A sum keeps NaN; a maximum could drop it.
        self.offset = ca.sqrt(ca.sum1(ca.vertcat(*squared_offsets)))
        self.tilt = ca.sqrt(ca.sum1(ca.vertcat(*squared_tilts)))
        tool = mechanism.frame(mechanism.tool)
        self.T_base_tool = self.pose(tool.body, tool.T_body_frame)

    def pose(self, body: str, T_body_frame: Array | None = None, stepping: bool = False) -> ca.SX:
        """Return T_base_frame (4, 4) of a frame on a body.

        With `stepping`, this is the pose after a step of the unknowns, to first order in the step.
        """
        chain = self._chain(self.mechanism.path(body))
        if T_body_frame is not None:
            chain.append(_rounded(T_body_frame))
        axes = self._axes(chain, stepping)
        origin = self._origin(chain, stepping)
        T = ca.horzcat(*axes, origin)
        return ca.vertcat(T, ca.SX([[0, 0, 0, 1]]))

    def frames(self, joint: Joint, stepping: bool = False) -> tuple[list[ca.SX], list[ca.SX]]:
        """Return (origin, x, y, z) of the joint's frame on its parent and on its child, in one common frame.

        With `stepping`, these are the frames after a step of the unknowns, to first order in the step.
        """
        sides: list[list[ca.SX]] = []
        chain_parent, chain_child, _ = self._chains_to_joint(joint)
        for chain in (chain_parent, chain_child):
            axes = self._axes(chain, stepping)
            origin = self._origin(chain, stepping)
            sides.append([origin, *axes])
        return sides[0], sides[1]

    def split(self) -> ca.Function:
        """Return the function that splits the values of all unknowns into the states of the passive joints."""
        seed = ca.SX.sym("seed", self.states.numel())
        parts: list[ca.SX] = []
        start = 0
        for joint in self.passive:
            end = start + joint.state.numel()
            parts.append(seed[start:end])
            start = end
        return ca.Function("split", [seed], parts)

    def links(self) -> dict[str, ca.SX]:
        """Return {body: T_base_body (3, 4)} of all bodies; each pose is composed from the pose of the parent body.

        For a single frame, `pose` is faster: it transforms vectors along the whole path from the base.
        """
        poses: dict[str, ca.SX | Array] = {self.mechanism.base: np.eye(4)}
        for joint in self.mechanism.tree:
            T_base_parent = poses[joint.parent]
            chain = self._chain([joint])
            if len(chain) == 1 and isinstance(T_base_parent, np.ndarray):
                (only_part,) = chain
                if isinstance(only_part, np.ndarray):  # a fixed joint: `_chain` merges consecutive fixed poses
                    poses[joint.child] = T_base_parent @ only_part
                    continue
            axes = self._axes(chain)
            T = ca.horzcat(*axes, self._origin(chain))
            if isinstance(T_base_parent, np.ndarray):
                T_base_parent = ca.SX(_rounded(T_base_parent))
            R = T_base_parent[:3, :3]
            p = T_base_parent[:3, 3]
            poses[joint.child] = ca.horzcat(R @ T[:, :3], R @ T[:, 3] + p)

        links: dict[str, ca.SX] = {}
        for body in self.mechanism.bodies:
            links[body.name] = ca.SX(poses[body.name])[:3, :]
        return links

    def rest(self) -> tuple[Array, list[Array]]:
        """Return q (n,) and the state of each passive joint in the rest poses (as drawn in the CAD)."""
        rest_poses = self.mechanism.rest
        q = np.zeros(len(self._active_index))
        states: list[Array] = []
        for joint in self.mechanism.tree:
            T_base_parent = rest_poses.get(joint.parent, np.eye(4))
            T_base_child = rest_poses.get(joint.child, np.eye(4))
            T = joint.relative(T_base_parent, T_base_child)
            angle = joint.angle(T)
            if joint.name in self._active_index:
                i = self._active_index[joint.name]
                if joint.is_angle:
                    q[i] = angle
                else:
                    q[i] = T[2, 3]
            elif joint.name in self._passive_by_name:
                states.append(_joint_state(joint.type, T, angle))
        return q, states

    def _misfit(self, joint: Joint, stepping: bool) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Return (offset in m, misalignment, cosine of the misalignment angle) of a loop joint.

        The misalignment contains sines about axes, which are angles in rad as far as these are small. Only the locked
        directions of the joint are counted.
        """
        chain_parent, chain_child, common = self._chains_to_joint(joint)
        gap = self._origin(chain_child, stepping) - self._origin(chain_parent, stepping)
        locked = sorted(set(range(6)) - set(joint.free_axes))
        frame = self._axes(chain_parent, stepping)
        if locked[:3] == [0, 1, 2]:
            # The gap is expressed in a fixed frame (that of the rest poses), so that the out-of-plane components of a
            # planar loop are exactly zero.
            rest_poses = self.mechanism.rest
            T_common_base = spatial.inverse(rest_poses.get(common, np.eye(4)))
            T_common_joint = T_common_base @ rest_poses.get(joint.parent, np.eye(4)) @ joint.T_parent_joint
            R = _rounded(T_common_joint[:3, :3])
            length = ca.SX(R.T) @ gap
        else:
            lengths = []
            for i in locked:
                if i < _ROTATION_X:  # a direction of translation
                    lengths.append(ca.dot(frame[i], gap))
            length = ca.vertcat(*lengths)

        if _ROTATION_X in joint.free_axes:  # a ball joint: no direction of rotation is locked
            return length, ca.SX(0, 1), ca.SX(1)
        frame_child = self._axes(chain_child, stepping)
        if _ROTATION_Z in joint.free_axes:  # rotation about z is free: only the z axes must agree
            sine_x = ca.dot(frame[0], frame_child[2])
            sine_y = ca.dot(frame[1], frame_child[2])
            return length, ca.vertcat(sine_x, sine_y), ca.dot(frame[2], frame_child[2])
        R = ca.horzcat(*frame).T @ ca.horzcat(*frame_child)
        return length, ca.inv_skew((R - R.T) / 2), (ca.trace(R) - 1) / 2

    def _coupling_residual(self, coupling: Coupling, stepping: bool) -> ca.SX:
        """Return the residual of a coupling in m or rad: the weighted sum of its joints, less its constant total."""
        residual = ca.SX(-coupling.total)
        for name, ratio in zip(coupling.joints, coupling.ratios, strict=True):
            residual = residual + ratio * self._coordinate(name, stepping)
        return residual

    def _chains_to_joint(self, joint: Joint) -> tuple[Chain, Chain, str]:
        """Return (chain to the joint frame on the parent, to that on the child, body at which the chains start)."""
        path_parent = list(self.mechanism.path(joint.parent))
        path_child = list(self.mechanism.path(joint.child))
        # Joints common to both paths move both sides alike.
        while path_parent and path_child and path_parent[0].name == path_child[0].name:
            path_parent.pop(0)
            path_child.pop(0)
        if path_parent:
            common = path_parent[0].parent
        elif path_child:
            common = path_child[0].parent
        else:
            common = joint.parent
        chain_parent = self._chain(path_parent) + self._frame(joint, "parent")
        chain_child = self._chain(path_child) + self._frame(joint, "child")
        return chain_parent, chain_child, common

    def _coordinate(self, name: str, stepping: bool) -> ca.SX:
        """Return the state of a joint, that of an active one being its coordinate in m or rad."""
        if name in self._active_index:
            return self.q[self._active_index[name]]
        passive = self._passive_by_name[name]
        if stepping:
            return passive.state + passive.step
        return passive.state

    def _frame(self, joint: Joint, side: str, back: bool = False) -> Chain:
        """Return the chain from a body to its joint frame; `back`: the inverse chain."""
        T = joint.T_child_joint
        if side == "parent":
            T = joint.T_parent_joint
        symbols = self.errors.get((joint.name, side))
        errors: Chain = []
        if symbols is not None:
            errors.append(_FrameError(symbols, back))
        if back:
            return [*errors, spatial.inverse(T)]
        return [T, *errors]

    def _chain(self, joints: Sequence[Joint]) -> Chain:
        """Return the chain along joints of the tree; consecutive fixed poses are merged."""
        parts: Chain = []
        for joint in joints:
            parts += self._frame(joint, "parent")
            if joint.type != "fixed":
                parts.append(joint)
            parts += self._frame(joint, "child", back=True)
        merged: Chain = []
        for part in parts:
            last_part = merged[-1] if merged else None
            if isinstance(part, np.ndarray) and isinstance(last_part, np.ndarray):
                merged[-1] = last_part @ part
            else:
                merged.append(part)
        return merged

    def _axes(self, chain: Chain, stepping: bool = False) -> list[ca.SX]:
        """Return the axes x, y, z (3,) of the frame at the end of a chain, in the frame at its start."""
        axes = []
        for axis in np.eye(3):
            axes.append(self._transformed(chain, ca.SX(axis), False, stepping))
        return axes

    def _origin(self, chain: Chain, stepping: bool = False) -> ca.SX:
        """Return the origin (3,) of the frame at the end of a chain, in the frame at its start, in m."""
        return self._transformed(chain, ca.SX.zeros(3), True, stepping)

    def _transformed(self, chain: Chain, vector: ca.SX, point: bool, stepping: bool) -> ca.SX:
        """Transform a point or a direction (3,) from the frame at the end of a chain to the frame at its start."""
        fixed: Array | None = None  # product of the fixed poses since the last moving part
        for part in reversed(chain):
            if isinstance(part, np.ndarray):
                if fixed is not None:
                    part = part @ fixed
                fixed = part
                continue
            if fixed is not None:
                vector = _moved_by_pose(_rounded(fixed), vector, point)
                fixed = None
            if isinstance(part, _FrameError):
                vector = _moved_by_error(part, vector, point)
                continue
            vector = self._moved_by_joint(part, vector, point, stepping)
        if fixed is not None:
            vector = _moved_by_pose(_rounded(fixed), vector, point)
        return vector

    def _moved_by_joint(self, joint: Joint, vector: ca.SX, point: bool, stepping: bool) -> ca.SX:
        """Transform a point or a direction (3,) from the moving frame of a joint to its fixed frame."""
        kind = joint.type
        if kind in _QUATERNION_TYPES and joint.name not in self._active_index:
            return self._moved_by_ball(joint, vector, point, stepping)
        x = self._coordinate(joint.name, stepping)
        if kind in ("revolute", "cylindrical"):
            c = ca.cos(x[-1])
            s = ca.sin(x[-1])
            vector = ca.vertcat(c * vector[0] - s * vector[1], s * vector[0] + c * vector[1], vector[2])
        if kind in ("prismatic", "cylindrical") and point:
            vector = vector + ca.vertcat(0, 0, x[0])
        return vector

    def _moved_by_ball(self, joint: Joint, vector: ca.SX, point: bool, stepping: bool) -> ca.SX:
        """Do the same for a passive joint whose orientation is a quaternion."""
        passive = self._passive_by_name[joint.name]
        if stepping:  # to first order, because only the derivative is used
            vector = vector + ca.cross(passive.step[-3:], vector)
        vector = rotated_by_quaternion(passive.state[-4:], vector)
        if not point or joint.type != "free":
            return vector
        shift = passive.state[:-4]
        if stepping:
            shift = shift + passive.step[:-3]
        return vector + shift


def rotated_by_quaternion(quat: ca.SX, vector: ca.SX) -> ca.SX:
    """Return v (3,) rotated by a unit quaternion (4,), w first: from a ball joint's moving axes to its fixed ones."""
    w, x, y, z = ca.vertsplit(quat)
    R = ca.vertcat(
        ca.horzcat(1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        ca.horzcat(2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        ca.horzcat(2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return R @ vector


def _moved_by_pose(T: Array, vector: ca.SX, point: bool) -> ca.SX:
    """Return the point or direction v (3,) transformed by a fixed pose."""
    turned = ca.SX(T[:3, :3]) @ vector
    if not point:
        return turned
    return turned + ca.SX(T[:3, 3])


def _moved_by_error(error: _FrameError, vector: ca.SX, point: bool) -> ca.SX:
    """Return the point or direction v (3,) moved by the error of a frame, or by the inverse error."""
    shift = error.shift_and_turn[:3]
    turn = error.shift_and_turn[3:]
    if error.back:
        turn = -turn
        if point:
            vector = vector - shift
    vector = vector + ca.cross(turn, vector) + ca.cross(turn, ca.cross(turn, vector)) / 2
    if point and not error.back:
        vector = vector + shift
    return vector


def _rounded(T: Array) -> Array:
    """Return a pose or rotation with entries near 0, 1 or -1 rounded, so that fewer terms remain."""
    T = np.array(T, float)
    R = T[:3, :3]
    for value in (0.0, 1.0, -1.0):
        R[np.abs(R - value) < _ROUNDING] = value
    return T


def _stack(parts: Iterable[ca.SX]) -> ca.SX:
    """Return the parts as one column; without parts, a column without rows."""
    parts = list(parts)
    if not parts:
        return ca.SX(0, 1)
    return ca.vertcat(*parts)


def _joint_state(kind: str, T: Array, angle: Array | float) -> Array:
    """Return the state of a passive joint of this type from the pose of its child frame in its parent frame."""
    if kind == "revolute":
        return np.array([angle])
    if kind == "prismatic":
        return T[2:3, 3]
    if kind == "cylindrical":
        return np.array([T[2, 3], angle])
    quat_wxyz = spatial.quat_from_matrix_wxyz(T[:3, :3])
    if kind == "spherical":
        return quat_wxyz
    return np.concatenate([T[:3, 3], quat_wxyz])
