"""The frame of an instrument's closed jaws, measured on their meshes."""

from __future__ import annotations

import numpy as np

from twin.core import spatial
from twin.core.errors import WorldError
from twin.core.spatial import Array
from twin.model.mechanism import Mechanism
from twin.simulation.plants.contact.gripper import GripperJaw, jaws_of


def grip_frame(mechanism: Mechanism) -> Array:
    """Return the pose (4, 4) of the frame of the closed jaws in the tool frame, measured on the meshes of the jaws.

    The origin is between the tips of the jaws, z points out of the jaws, and the jaws close along y.

    Raises:
        WorldError: the robot has no jaws.
    """
    tool = mechanism.frame(mechanism.tool)
    jaws: tuple[GripperJaw, ...] = ()
    if mechanism.auxiliary:
        names = [joint.name for joint in mechanism.active]
        jaws = jaws_of(mechanism, tool.body, names.index(mechanism.auxiliary[0].name))
    if not jaws:
        raise WorldError(f"'{mechanism.name}' has no jaws that turn by an auxiliary joint")
    tips = []
    for jaw in jaws:
        vertices = np.concatenate([part.vertices for part in jaw.body.meshes])
        in_hand = vertices @ jaw.T_hand_jaw[:3, :3].T + jaw.T_hand_jaw[:3, 3]
        from_axis = in_hand - jaw.point
        from_axis -= np.outer(from_axis @ jaw.axis, jaw.axis)
        farthest = np.argmax(np.linalg.norm(from_axis, axis=1))
        tips.append(from_axis[farthest])
    tip = np.mean(tips, axis=0)
    z = tip / np.linalg.norm(tip)
    x = jaws[0].axis
    R_hand_grip = np.column_stack([x, np.cross(z, x), z])
    T_hand_grip = spatial.pose(R_hand_grip, jaws[0].point + tip)
    return spatial.inverse(tool.T_body_frame) @ T_hand_grip
