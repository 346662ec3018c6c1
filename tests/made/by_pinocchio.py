"""Poses of the links of a URDF, as Pinocchio's own reader computes them."""

from __future__ import annotations

from types import MappingProxyType

import numpy as np
import pinocchio as pin


def by_pinocchio(path, coordinates, planar=MappingProxyType({})):
    """Return {link: T_world_link (4, 4)} of a URDF at the joints' coordinates; a floating base is at its origin.

    `planar` has three coordinates for each planar joint.
    """
    model = pin.buildModelFromUrdf(str(path))
    data = model.createData()
    q = pin.neutral(model)
    for name, value in coordinates.items():
        joint = model.joints[model.getJointId(name)]
        if joint.nq == 2:  # a continuous joint has the cosine and the sine
            q[joint.idx_q : joint.idx_q + 2] = np.cos(value), np.sin(value)
        elif joint.nq == 1:
            q[joint.idx_q] = value
    for name, (x, y, angle) in planar.items():
        joint = model.joints[model.getJointId(name)]
        q[joint.idx_q : joint.idx_q + 4] = x, y, np.cos(angle), np.sin(angle)
    pin.framesForwardKinematics(model, data, q)
    poses = {}
    for i, frame in enumerate(model.frames):
        if frame.type == pin.FrameType.BODY:
            poses[frame.name] = data.oMf[i].homogeneous
    return poses
