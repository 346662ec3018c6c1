"""Tool error caused by the rounding of joint frames, which UsdPhysics stores in single precision."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.model.joint import Joint
from twin.reference.loops import LENGTH_SCALE
from twin.reference.model import ReferenceModel


@dataclass(frozen=True)
class Sensitivity:
    """Expected tool error (m, rad) if the joint frames are rounded.

    Attributes:
        expected: (2,) standard deviation, if each rounding error is uniformly distributed up to its maximum.
        bound: (2,) sum of the effects of all rounding errors at their maximum.
        worst_joint: the joint whose rounding contributes most.
    """

    expected: tuple[float, float]
    bound: tuple[float, float]
    worst_joint: str


def of_rounding(model: ReferenceModel, x: Array, epsilon: float = 2.0**-24) -> Sensitivity:
    """Return the tool error at configuration x (nq,) if joint frames are stored with relative precision epsilon.

    Each position coordinate and each component of the unit quaternion of a frame has an error of at most half a unit in
    its last place. The effects are computed to first order through the loop closures.
    """
    tree = model.tree
    poses, J = tree.update(x[None])
    A = tree.loops.evaluate(x[None], poses, J)[1][0]
    J_tool = tree.tool_jacobian(poses, J)[0]
    T_tool = tree.tool(poses)[0]
    links = {b.name: poses[0, i] @ T for b in model.mechanism.bodies for i, T in [tree.body(b.name)]}
    # Change of the passive joints: d(passive) = -pinv(A_passive) d(residual).
    give = J_tool[:, tree.passive] @ np.linalg.pinv(A[:, tree.passive], rcond=1e-9)

    effects: dict[str, list[Array]] = {}
    for joint in model.mechanism.joints:
        for body, T_body_joint in ((joint.parent, joint.T_parent_joint), (joint.child, joint.T_child_joint)):
            frame = links[body] @ T_body_joint
            for twist in _roundings(T_body_joint, epsilon):
                effects.setdefault(joint.name, []).append(_effect(model, joint, frame, twist, links, T_tool, give))
    by_joint = {n: np.array(e) for n, e in effects.items()}
    everything = np.concatenate(list(by_joint.values()))
    size = np.stack([np.linalg.norm(everything[:, :3], axis=1), np.linalg.norm(everything[:, 3:], axis=1)], axis=1)
    worst = max(by_joint, key=lambda n: float(np.linalg.norm(by_joint[n][:, :3], axis=1).sum()))
    expected, bound = np.sqrt((size**2).sum(axis=0) / 3), size.sum(axis=0)
    return Sensitivity((float(expected[0]), float(expected[1])), (float(bound[0]), float(bound[1])), worst)


def _roundings(T: Array, epsilon: float) -> Array:
    """Return the twists (7, 6), in the axes of the frame T, caused by rounding.

    Each twist belongs to one number of the pose (position, quaternion), changed by half a unit in the last place.
    """

    def half_ulp(values: Array) -> Array:
        return np.where(values == 0, 0.0, epsilon * 2.0 ** np.floor(np.log2(np.maximum(np.abs(values), 1e-300))))

    w, x, y, z = q_wxyz = spatial.quat_from_matrix_wxyz(T[:3, :3])
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
    give: Array,
) -> Array:
    """Return the tool's small motion (6,) in base if a joint's child side moves by a twist in the joint's frame."""
    loops = model.tree.loops
    R = frame[:3, :3]
    v, w = R @ twist[:3], R @ twist[3:]  # velocity of the point frame[:3, 3], and angular velocity
    outboard = _outboard(model, joint)
    moved = model.mechanism.frame(model.mechanism.tool).body in outboard
    direct = np.concatenate([v + np.cross(w, T_tool[:3, 3] - frame[:3, 3]), w]) if moved else np.zeros(6)
    if not loops.names:
        return direct
    rows = [np.zeros(0)]
    for loop in loops.joints:
        sign = (loop.child in outboard) - (loop.parent in outboard) if loop is not joint else 1
        T0 = links[loop.parent] @ loop.T_parent_joint
        p1 = (links[loop.child] @ loop.T_child_joint)[:3, 3]
        R0t = T0[:3, :3].T
        offset, turn = R0t @ (v + np.cross(w, p1 - frame[:3, 3])), R0t @ w
        row = sign * np.concatenate([offset, LENGTH_SCALE * turn])
        rows.append(row[[axis for axis in range(6) if axis not in loop.free_axes]])
    return direct - give @ np.concatenate([*rows, np.zeros(len(loops.couplings))])  # couplings have no frames


def _outboard(model: ReferenceModel, joint: Joint) -> set[str]:
    """Return the bodies moved by a tree joint; empty for a loop joint."""
    tree = model.mechanism.tree
    children = {j.name: j.child for j in tree}
    if joint.name not in children:
        return set()
    out = {children[joint.name]}
    for j in tree:  # parents come first
        if j.parent in out:
            out.add(j.child)
    return out
