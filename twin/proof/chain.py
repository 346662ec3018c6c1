"""The pose of the tool of a serial chain as a sum of matrices times sines and cosines of its joints."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from twin.core.errors import TwinError
from twin.core.spatial import Array
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.proof import trigonometric
from twin.proof.rigid_frame import RigidFrame, joint_frames, rigid_frame
from twin.proof.trigonometric import AngleSum, Operand, TrigonometricSum

_PRODUCT_ROUNDING = 8 * 2.0**-52
"""Relative rounding error of an entry of a product of two poses: a sum of four products, with a margin."""

_RADIUS_MARGIN = 1 + 1e-14
"""Factor by which radii are increased, because they are computed in double precision."""


def tool_pose(mechanism: Mechanism, joints: Mapping[str, Operand]) -> TrigonometricSum:
    """Return T_base_tool (4, 4) at given values of the joints on the path from the base to the tool.

    Args:
        mechanism: the mechanism.
        joints: {joint: its value}, an angle or a length in m.

    Raises:
        TwinError: the value of a joint on the path is not given.
    """
    pose = trigonometric.matrix(np.eye(4))
    for step in _steps(mechanism, joints):
        pose = pose.matrix_product(step)
    return pose


def _steps(mechanism: Mechanism, joints: Mapping[str, Operand]) -> Iterator[TrigonometricSum]:
    """Yield the poses whose product is T_base_tool."""
    tool = mechanism.frame(mechanism.tool)
    before = np.eye(4)
    radius = np.zeros((4, 4))
    for joint in mechanism.path(tool.body):
        on_parent, on_child = joint_frames(mechanism.name, joint.name, joint.T_parent_joint, joint.T_child_joint)
        before, radius = _product(before, radius, on_parent)
        if joint.type != "fixed":
            if joint.name not in joints:
                raise TwinError(
                    f"{mechanism.name}: the other side gives no value of joint {joint.name}, on the path to the tool, "
                    "as a sum of joint angles; a bound over all joints needs one"
                )
            yield trigonometric.matrix(before, radius)
            yield _motion(mechanism, joint, joints[joint.name])
            before = np.eye(4)
            radius = np.zeros((4, 4))
        # Frames between two joints are multiplied as numbers: as sums of waves, each product would multiply their
        # terms.
        before, radius = _product(before, radius, on_child.inverse())
    on_body = rigid_frame(tool.T_body_frame, f"{mechanism.name}: frame {mechanism.tool}")
    before, radius = _product(before, radius, on_body)
    yield trigonometric.matrix(before, radius)


def _product(T: Array, radius: Array, frame: RigidFrame) -> tuple[Array, Array]:
    """Return the product (4, 4) of a pose, known within a radius (4, 4), and a frame, and its radius."""
    frame_radius = np.zeros((4, 4))
    frame_radius[:3, :3] = frame.R_radius
    frame_radius[:3, 3] = frame.p_radius
    T_size = np.abs(T)
    frame_size = np.abs(frame.T)
    of_frame = T_size @ frame_radius
    of_pose = radius @ (frame_size + frame_radius)
    rounding = _PRODUCT_ROUNDING * (T_size @ frame_size)
    return T @ frame.T, (of_frame + of_pose + rounding) * _RADIUS_MARGIN


def _motion(mechanism: Mechanism, joint: Joint, value: Operand) -> TrigonometricSum:
    """Return the motion (4, 4) of a joint about or along z."""
    one = trigonometric.constant(1.0)
    zero = trigonometric.constant(0.0)
    entries = [
        [one, zero, zero, zero],
        [zero, one, zero, zero],
        [zero, zero, one, zero],
        [zero, zero, zero, one],
    ]
    if joint.type == "revolute" and isinstance(value, AngleSum):
        cosine = trigonometric.wave(value, sine=False)
        sine = trigonometric.wave(value, sine=True)
        entries[0][0] = entries[1][1] = cosine
        entries[1][0] = sine
        entries[0][1] = -sine
    elif joint.type == "prismatic" and isinstance(value, TrigonometricSum):
        entries[2][3] = value
    else:
        raise TwinError(f"{mechanism.name}: joint {joint.name} is {joint.type}, and its value is of another kind")
    return trigonometric.stacked(entries)


def sliding_range(mechanism: Mechanism, name: str) -> tuple[float, float]:
    """Return (middle, half of the range) of a prismatic joint in m.

    Raises:
        TwinError: it has no finite limits.
    """
    low, high = mechanism.joint(name).limits or (-np.inf, np.inf)
    if not (np.isfinite(low) and np.isfinite(high)):
        raise TwinError(f"{mechanism.name}: prismatic joint {name} has no limits; state them in the description")
    return 0.5 * (low + high), 0.5 * (high - low)
