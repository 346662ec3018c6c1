"""Tool error caused by the rounding of joint frames, which UsdPhysics stores in single precision."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.model.joint import Joint
from twin.reference.loops import LENGTH_SCALE
from twin.reference.model import ReferenceModel

_RELATIVE_ZERO = 1e-9
"""Singular values of the loop Jacobian below this fraction of the largest one count as zero."""

_SINGLE_PRECISION = 2.0**-24
"""Relative precision of a float32."""


@dataclass(frozen=True)
class Sensitivity:
    """Expected tool error (m, rad) if the joint frames are rounded.

    Attributes:
        expected: (2,) standard deviation, if each rounding error is uniformly distributed up to its maximum.
        bound: (2,) sum of the effects of all rounding errors at their maximum.
        worst_joint: the joint whose rounding contributes most to the position bound.
    """

    expected: tuple[float, float]
    bound: tuple[float, float]
    worst_joint: str


def of_rounding(model: ReferenceModel, x: Array, epsilon: float = _SINGLE_PRECISION) -> Sensitivity:
    """Return the tool error at configuration x (nq,) if joint frames are stored with relative precision epsilon.

    Each position coordinate and each component of the unit quaternion of a frame has an error of at most half a unit in
    its last place. The effects are computed to first order through the loop closures.
    """
    tree = model.tree
    poses, J = tree.update(x[None])
    _, A = tree.loops.evaluate(x[None], poses, J)
    J_tool = tree.tool_jacobian(poses, J)[0]
    T_tool = tree.tool(poses)[0]
    links = {}
    for body in model.mechanism.bodies:
        number, T_joint_body = tree.body(body.name)
        links[body.name] = poses[0, number] @ T_joint_body
    # Change of the passive joints: d(passive) = -pinv(A_passive) d(residual).
    A_passive = A[0][:, tree.passive]
    tool_per_residual = J_tool[:, tree.passive] @ np.linalg.pinv(A_passive, rcond=_RELATIVE_ZERO)

    by_joint: dict[str, Array] = {}
    for joint in model.mechanism.joints:
        sides = ((joint.parent, joint.T_parent_joint), (joint.child, joint.T_child_joint))
        effects = []
        for name, T_body_joint in sides:
            frame = links[name] @ T_body_joint
            for twist in _roundings(T_body_joint, epsilon):
                effect = _effect(model, joint, frame, twist, links, T_tool, tool_per_residual)
                effects.append(effect)
        by_joint[joint.name] = np.array(effects)
    effects_of_all = np.concatenate(list(by_joint.values()))
    shift = np.linalg.norm(effects_of_all[:, :3], axis=1)
    turn = np.linalg.norm(effects_of_all[:, 3:], axis=1)
    size = np.stack([shift, turn], axis=1)

    def contribution(joint: str) -> float:
        shifts = by_joint[joint][:, :3]
        return float(np.linalg.norm(shifts, axis=1).sum())

    worst = max(by_joint, key=contribution)
    # the variance of a uniform distribution from -a to a is a**2 / 3
    expected_shift, expected_turn = np.sqrt((size**2).sum(axis=0) / 3)
    bound_shift, bound_turn = size.sum(axis=0)
    expected = (float(expected_shift), float(expected_turn))
    bound = (float(bound_shift), float(bound_turn))
    return Sensitivity(expected, bound, worst)


def _roundings(T: Array, epsilon: float) -> Array:
    """Return the twists (7, 6), in the axes of the frame T, caused by rounding.

    Each twist belongs to one number of the pose (position, quaternion), changed by half a unit in the last place.
    """

    def half_ulp(values: Array) -> Array:
        # 1e-300: the logarithm of 0 is infinite; 0 itself has no rounding error
        size = np.maximum(np.abs(values), 1e-300)
        # with p bits, epsilon is 2**-p, and a unit in the last place is 2 epsilon times the power of two below a value
        half = epsilon * 2.0 ** np.floor(np.log2(size))
        return np.where(values == 0, 0.0, half)

    q_wxyz = spatial.quat_from_matrix_wxyz(T[:3, :3])
    w, x, y, z = q_wxyz
    # Twice the vector part of conjugate(q) times a change of each component.
    turns = 2 * np.array([[-x, -y, -z], [w, z, -y], [-z, w, x], [y, -x, w]])
    twists = np.zeros((7, 6))
    twists[:3, :3] = half_ulp(T[:3, 3])[:, None] * T[:3, :3]
    twists[3:, 3:] = half_ulp(q_wxyz)[:, None] * turns
    return twists


def _effect(
    model: ReferenceModel,
    joint: Joint,
    frame: Array,
    twist: Array,
    links: dict[str, Array],
    T_tool: Array,
    tool_per_residual: Array,
) -> Array:
    """Return the tool's small motion (6,) in base if a joint's child side moves by a twist in the joint's frame.

    Args:
        model: the mechanism's model.
        joint: the joint.
        frame: pose (4, 4) of the joint's frame in base.
        twist: (6,) small motion in the axes of this frame, linear part first.
        links: {body: pose (4, 4) in base}.
        T_tool: pose (4, 4) of the tool in base.
        tool_per_residual: (6, m) motion of the tool by the passive joints that cancel a residual of the loops.
    """
    loops = model.tree.loops
    R = frame[:3, :3]
    p = frame[:3, 3]
    v = R @ twist[:3]  # velocity of the point p
    w = R @ twist[3:]
    outboard = _outboard(model, joint)
    direct = np.zeros(6)  # with the passive joints at rest
    if model.mechanism.frame(model.mechanism.tool).body in outboard:
        v_tool = v + np.cross(w, T_tool[:3, 3] - p)
        direct = np.concatenate([v_tool, w])
    if not loops.names:
        return direct
    rows = [np.zeros(0)]
    for loop in loops.joints:
        # a loop changes if the twist moves one of its two bodies but not the other
        sign = 1
        if loop is not joint:
            sign = (loop.child in outboard) - (loop.parent in outboard)
        T0 = links[loop.parent] @ loop.T_parent_joint
        T1 = links[loop.child] @ loop.T_child_joint
        R0t = T0[:3, :3].T
        offset = R0t @ (v + np.cross(w, T1[:3, 3] - p))
        turn = R0t @ w
        row = sign * np.concatenate([offset, LENGTH_SCALE * turn])
        locked_axes = [axis for axis in range(6) if axis not in loop.free_axes]
        rows.append(row[locked_axes])
    rows.append(np.zeros(len(loops.couplings)))  # couplings have no frames
    return direct - tool_per_residual @ np.concatenate(rows)


def _outboard(model: ReferenceModel, joint: Joint) -> set[str]:
    """Return the bodies moved by a tree joint; empty for a loop joint."""
    tree = model.mechanism.tree
    children = {other.name: other.child for other in tree}
    if joint.name not in children:
        return set()
    bodies = {children[joint.name]}
    for other in tree:  # parents come first
        if other.parent in bodies:
            bodies.add(other.child)
    return bodies
