"""The closed loops of any mechanism as CasADi expressions: residuals, their derivatives, and the pose of every body.

Unknowns are the coordinates of the passive tree joints. The state of a ball joint is a unit quaternion (w x y z), and a
step multiplies this quaternion by a small rotation, so that no orientation is singular. The gap of a loop is expressed
in the frame of the body at which the two branches of the loop separate, so that the joints common to both branches
cancel.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism

LENGTH_SCALE = 0.1
"""Length in m by which radians are multiplied in residuals."""

STATES = {"fixed": 0, "revolute": 1, "prismatic": 1, "cylindrical": 2, "spherical": 4, "free": 7}
STEPS = {"fixed": 0, "revolute": 1, "prismatic": 1, "cylindrical": 2, "spherical": 3, "free": 6}
"""Count of numbers in the state (STATES) and in a step (STEPS) of a passive joint, by type; lengths before angles."""

_ROUNDED = 4e-16
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
        kind = self.joint.type
        if kind not in ("spherical", "free"):
            return self.state + step
        lengths, quat, turn = self.state[:-4], self.state[-4:], step[-3:] / 2
        w, v = quat[0], quat[1:]
        turned = ca.vertcat(w - ca.dot(v, turn), v + w * turn + ca.cross(v, turn))
        return ca.vertcat(lengths + step[:-3], turned / ca.sqrt(ca.sumsqr(turned)))


def stepped(passive: Iterable[Passive], step: ca.SX) -> dict[str, ca.SX]:
    """Return {key: state} of passive joints after a step; `step` stacks the steps of all these joints."""
    out, at = {}, 0
    for p in passive:
        out[p.key] = p.stepped(step[at : at + p.step.numel()])
        at += p.step.numel()
    return out


Chain = list[Any]
"""A chain from a body to a frame: fixed poses (4, 4), moving joints, and frame errors."""


@dataclass(frozen=True)
class _Error:
    """A frame error (6,) in the frame's own axes: shift in m, rotation in rad; `back`: the inverse error applies."""

    e: ca.SX
    back: bool


class Equations:
    """The loop equations of a mechanism and their derivatives.

    Attributes:
        mechanism: the mechanism with these loops.
        q: active joints (n,), in the order of `Mechanism.active`.
        passive: the passive joints, whose coordinates are the unknowns.
        residual: (m,) offsets in m and misalignments in rad times `LENGTH_SCALE`; couplings last.
        jacobian: (m, steps) derivative of the residual with respect to the steps of all unknowns, joint by joint.
        row_names: for each row, the name of the loop joint or coupling to which the row belongs.
        offset, tilt: norm of the offsets of all loops in m; norm of the misalignments of all loops in rad, in which
            an inverted joint counts as 1 rad.
        T_base_tool: (4, 4) pose of the tool.
        errors: symbols (6,) of the error of a joint frame, by (joint, "parent" or "child"), in the frame's own axes:
            shift in m, then rotation in rad. The equations are accurate to second order in the rotation. Empty if not
            requested.
    """

    def __init__(self, mechanism: Mechanism, *, with_errors: bool = False) -> None:
        self.mechanism = mechanism
        sides = [(j.name, side) for j in mechanism.joints for side in ("parent", "child")] if with_errors else []
        self.errors = {key: ca.SX.sym(f"e_{'_'.join(key)}", 6) for key in sides}
        self.q = ca.SX.sym("q", len(mechanism.active))
        self._active = {j.name: i for i, j in enumerate(mechanism.active)}
        free = [j for j in mechanism.tree if not j.active and j.type != "fixed"]
        self.passive = [
            Passive(j, ca.SX.sym(j.name, STATES[j.type]), ca.SX.sym(f"d_{j.name}", STEPS[j.type])) for j in free
        ]
        self._passive = {p.name: p for p in self.passive}
        self.states, self.steps = _stack(p.state for p in self.passive), _stack(p.step for p in self.passive)
        rows, moved, names = [], [], []
        offsets, tilts = [ca.SX(0)], [ca.SX(0)]
        for joint in mechanism.loops:
            for stepping, out in ((False, rows), (True, moved)):
                length, angle, cosine = self._misfit(joint, stepping)
                out += [length, LENGTH_SCALE * angle]
                if not stepping:
                    names += [joint.name] * (length.numel() + angle.numel())
                    offsets.append(ca.sumsqr(length))
                    # for an inverted joint, the sine is also small
                    tilts.append(ca.sumsqr(angle) + ca.if_else(cosine < 0, 1, 0))
        for coupling in mechanism.couplings:
            for stepping, out in ((False, rows), (True, moved)):
                pairs = zip(coupling.joints, coupling.ratios, strict=True)
                total = sum((k * self._coordinate(n, stepping) for n, k in pairs), ca.SX(-coupling.total))
                angle = mechanism.joint(coupling.joints[0]).is_angle
                out.append(LENGTH_SCALE * total if angle else total)
                if not stepping:
                    names.append(coupling.name)
                    (tilts if angle else offsets).append(total**2)
        self.row_names = tuple(names)
        self.residual = _stack(rows)
        self.jacobian = ca.substitute(ca.jacobian(_stack(moved), self.steps), self.steps, 0)
        # A sum keeps NaN; a maximum could drop it.
        self.offset, self.tilt = (ca.sqrt(ca.sum1(ca.vertcat(*x))) for x in (offsets, tilts))
        tool = mechanism.frame(mechanism.tool)
        self.T_base_tool = self.pose(tool.body, tool.T_body_frame)

    def pose(self, body: str, T_body_frame: Array | None = None, stepping: bool = False) -> ca.SX:
        """Return T_base_frame (4, 4) of a frame on a body.

        With `stepping`, this is the pose after a step of the unknowns, to first order in the step.
        """
        chain = self._chain(self.mechanism.path(body)) + ([] if T_body_frame is None else [_rounded(T_body_frame)])
        axes = [self._carried(chain, ca.SX(e), False, stepping) for e in np.eye(3)]
        T = ca.horzcat(*axes, self._carried(chain, ca.SX.zeros(3), True, stepping))
        return ca.vertcat(T, ca.SX([[0, 0, 0, 1]]))

    def frames(self, joint: Joint, stepping: bool = False) -> tuple[list[ca.SX], list[ca.SX]]:
        """Return (origin, x, y, z) of the joint's frame on its parent and on its child, in one common frame.

        With `stepping`, these are the frames after a step of the unknowns, to first order in the step.
        """
        a, b, _ = self._sides(joint)
        sides = []
        for chain in (a, b):
            axes = [self._carried(chain, ca.SX(e), False, stepping) for e in np.eye(3)]
            sides.append([self._carried(chain, ca.SX.zeros(3), True, stepping), *axes])
        return sides[0], sides[1]

    def split(self) -> ca.Function:
        """Return the function that splits the values of all unknowns into the states of the passive joints."""
        seed, ends = ca.SX.sym("seed", self.states.numel()), np.cumsum([0, *(p.state.numel() for p in self.passive)])
        return ca.Function("split", [seed], [seed[a:b] for a, b in pairwise(ends.tolist())])

    def links(self) -> dict[str, ca.SX]:
        """Return {body: T_base_body (3, 4)} of all bodies; each pose is composed from the pose of the parent body.

        For a single frame, `pose` is faster: it transforms vectors along the whole path from the base.
        """
        poses: dict[str, ca.SX | Array] = {self.mechanism.base: np.eye(4)}
        for joint in self.mechanism.tree:
            before = poses[joint.parent]
            chain = self._chain([joint])
            if all(isinstance(part, np.ndarray) for part in chain) and isinstance(before, np.ndarray):
                poses[joint.child] = before @ chain[0]
                continue
            axes = [self._carried(chain, ca.SX(e), False, False) for e in np.eye(3)]
            T = ca.horzcat(*axes, self._carried(chain, ca.SX.zeros(3), True, False))
            first = ca.SX(_rounded(before)) if isinstance(before, np.ndarray) else before
            R, p = first[:3, :3], first[:3, 3]
            poses[joint.child] = ca.horzcat(R @ T[:, :3], R @ T[:, 3] + p)
        return {b.name: ca.SX(poses[b.name])[:3, :] for b in self.mechanism.bodies}

    def rest(self) -> tuple[Array, list[Array]]:
        """Return q (n,) and the state of each passive joint in the rest poses (as drawn in the CAD)."""
        rest = self.mechanism.rest
        q, states = np.zeros(len(self._active)), []
        for joint in self.mechanism.tree:
            T = joint.relative(rest.get(joint.parent, np.eye(4)), rest.get(joint.child, np.eye(4)))
            angle = joint.angle(T)
            if joint.name in self._active:
                q[self._active[joint.name]] = angle if joint.is_angle else T[2, 3]
            elif joint.name in self._passive:
                quat = spatial.quat_from_matrix_wxyz(T[:3, :3])
                states.append(
                    {
                        "revolute": np.array([angle]),
                        "prismatic": T[2:3, 3],
                        "cylindrical": np.array([T[2, 3], angle]),
                        "spherical": quat,
                        "free": np.concatenate([T[:3, 3], quat]),
                    }[joint.type]
                )
        return q, states

    def _misfit(self, joint: Joint, stepping: bool) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Return (offset in m, misalignment in rad, cosine of the misalignment angle) of a loop joint.

        Only the locked directions of the joint are counted.
        """
        a, b, parted = self._sides(joint)
        gap = self._carried(b, ca.SX.zeros(3), True, stepping) - self._carried(a, ca.SX.zeros(3), True, stepping)
        locked = [i for i in range(6) if i not in joint.free_axes]
        frame = [self._carried(a, ca.SX(e), False, stepping) for e in np.eye(3)]
        if locked[:3] == [0, 1, 2]:
            # The gap is expressed in a fixed frame (that of the rest poses), so that the out-of-plane components of a
            # planar loop are exactly zero.
            rest = self.mechanism.rest
            R = spatial.inverse(rest.get(parted, np.eye(4))) @ rest.get(joint.parent, np.eye(4)) @ joint.T_parent_joint
            length = ca.SX(_rounded(R[:3, :3]).T) @ gap
        else:
            length = ca.vertcat(*[ca.dot(frame[i], gap) for i in locked if i < 3])
        if 3 in joint.free_axes:
            return length, ca.SX(0, 1), ca.SX(1)
        others = [self._carried(b, ca.SX(e), False, stepping) for e in np.eye(3)]
        if 5 in joint.free_axes:
            return length, ca.vertcat(*[ca.dot(frame[i], others[2]) for i in (0, 1)]), ca.dot(frame[2], others[2])
        R = ca.horzcat(*frame).T @ ca.horzcat(*others)
        return length, ca.inv_skew((R - R.T) / 2), (ca.trace(R) - 1) / 2

    def _sides(self, joint: Joint) -> tuple[Chain, Chain, str]:
        """Return (chain to the joint frame on the parent, to that on the child, body at which the chains start)."""
        ways = [list(self.mechanism.path(b)) for b in (joint.parent, joint.child)]
        while ways[0] and ways[1] and ways[0][0].name == ways[1][0].name:
            ways = [w[1:] for w in ways]
        a = self._chain(ways[0]) + self._frame(joint, "parent")
        b = self._chain(ways[1]) + self._frame(joint, "child")
        parted = ways[0][0].parent if ways[0] else ways[1][0].parent if ways[1] else joint.parent
        return a, b, parted

    def _coordinate(self, name: str, stepping: bool) -> ca.SX:
        if name in self._active:
            return self.q[self._active[name]]
        p = self._passive[name]
        return p.state + p.step if stepping else p.state

    def _frame(self, joint: Joint, side: str, back: bool = False) -> Chain:
        """Return the chain from a body to its joint frame; `back`: the inverse chain."""
        T = joint.T_parent_joint if side == "parent" else joint.T_child_joint
        error = [_Error(e, back)] if (e := self.errors.get((joint.name, side))) is not None else []
        return [*error, spatial.inverse(T)] if back else [T, *error]

    def _chain(self, joints: Sequence[Joint]) -> Chain:
        """Return the chain along joints of the tree; consecutive fixed poses are merged."""
        parts: Chain = []
        for joint in joints:
            moving = [] if joint.type == "fixed" else [joint]
            parts += [*self._frame(joint, "parent"), *moving, *self._frame(joint, "child", back=True)]
        out: Chain = []
        for part in parts:
            if isinstance(part, np.ndarray) and out and isinstance(out[-1], np.ndarray):
                out[-1] = out[-1] @ part
            else:
                out.append(part)
        return out

    def _carried(self, chain: Chain, v: ca.SX, point: bool, stepping: bool) -> ca.SX:
        """Transform a point or a direction (3,) from the frame at the end of a chain to the frame at its start."""
        fixed: Array | None = None
        for part in [*reversed(chain), None]:
            if isinstance(part, np.ndarray):
                fixed = part if fixed is None else part @ fixed
                continue
            if fixed is not None:
                v, fixed = _moved(_rounded(fixed), v, point), None
            if isinstance(part, _Error):
                v = _off(part, v, point)
            elif part is not None:
                v = self._motion(part, v, point, stepping)
        return v

    def _motion(self, joint: Joint, v: ca.SX, point: bool, stepping: bool) -> ca.SX:
        kind, name = joint.type, joint.name
        if name in self._active:
            x = self.q[self._active[name]]
        else:
            p = self._passive[name]
            x = p.state
            if kind in ("spherical", "free"):
                if stepping:  # to first order, because only the derivative is used
                    v = v + ca.cross(p.step[-3:], v)
                v = _turned(x[-4:], v)
                shift = x[:-4] + p.step[:-3] if stepping else x[:-4]
                return v + shift if point and kind == "free" else v
            if stepping:
                x = x + p.step
        if kind in ("revolute", "cylindrical"):
            c, s = ca.cos(x[-1]), ca.sin(x[-1])
            v = ca.vertcat(c * v[0] - s * v[1], s * v[0] + c * v[1], v[2])
        if kind in ("prismatic", "cylindrical") and point:
            v = v + ca.vertcat(0, 0, x[0])
        return v


def _turned(quat: ca.SX, v: ca.SX) -> ca.SX:
    """Return v (3,) rotated by a unit quaternion (4,), w first."""
    w, x, y, z = ca.vertsplit(quat)
    R = ca.vertcat(
        ca.horzcat(1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        ca.horzcat(2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        ca.horzcat(2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return R @ v


def _moved(T: Array, v: ca.SX, point: bool) -> ca.SX:
    out = ca.SX(T[:3, :3]) @ v
    return out + ca.SX(T[:3, 3]) if point else out


def _off(error: _Error, v: ca.SX, point: bool) -> ca.SX:
    """Return the point or direction v (3,) moved by the error of a frame, or by the inverse error."""
    shift, turn = error.e[:3], error.e[3:]
    if error.back:
        turn = -turn
        v = v - shift if point else v
    v = v + ca.cross(turn, v) + ca.cross(turn, ca.cross(turn, v)) / 2
    return v + shift if point and not error.back else v


def _rounded(T: Array) -> Array:
    """Return a pose or rotation with entries near 0, 1 or -1 rounded, so that fewer terms remain."""
    T = np.array(T, float)
    R = T[:3, :3]
    for value in (0.0, 1.0, -1.0):
        R[np.abs(R - value) < _ROUNDED] = value
    return T


def _stack(parts: Iterable[ca.SX]) -> ca.SX:
    parts = list(parts)
    return ca.vertcat(*parts) if parts else ca.SX(0, 1)
