"""Joints of a URDF, and the auxiliary links that they need: see the docstring of the package."""

from __future__ import annotations

from dataclasses import replace
from xml.etree import ElementTree as ET

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.exchange.formats.urdf.write.closure_yaml import ends
from twin.exchange.write.xml_text import gains, numbers
from twin.model.inertia import Inertia
from twin.model.joint import Joint

AUXILIARY_INERTIA = Inertia(1e-6, np.zeros(3), 1e-9 * np.eye(3))
"""Inertia of an auxiliary link: negligible, but large enough for simulators."""

UNKNOWN_BOUNDS = {"effort": "1e6", "velocity": "1e6"}
"""Values that mean "unknown" for numbers that URDF requires."""

NO_LIMIT = 1e3
"""Number in m or rad for a side without a limit: URDF requires both limits, and its parsers refuse infinity."""

_ON_AXIS = 1e-12
"""Maximum distance in m between a body's origin and its pin axis at which the origin counts as a point on the axis."""


def add_joint(root: ET.Element, joint: Joint, T_home: Array) -> None:
    """Write a joint of the tree as one URDF joint, or as a chain of URDF joints over auxiliary links.

    `T_home` (4, 4) is the pose of the joint's frame on the child in its frame on the parent, at home.
    """
    if len(joint.free_axes) > 1:
        # They are of a single coordinate, and do not say of which: a slide in m, or a hinge in rad.
        joint = replace(joint, limits=None, max_speed=None, drive=None)
    name = joint.name
    T_child_joint = joint.T_child_joint
    T_joint_child = spatial.inverse(T_child_joint)
    pin_point = T_child_joint[:3, 3]
    pin_axis = T_child_joint[:3, 2]
    # A joint of URDF is at the origin of its child: another pin needs an auxiliary link on its axis.
    through_origin = np.linalg.norm(np.cross(pin_point, pin_axis)) < _ON_AXIS
    if joint.type in ("fixed", "prismatic") or (joint.type == "revolute" and through_origin):
        _add_urdf_joint(
            root, joint, name, joint.type, (joint.parent, joint.child), joint.T_parent_joint @ T_joint_child, pin_axis
        )
        return
    x, y, z = np.eye(3)
    T = joint.T_parent_joint
    chain = [(name, "revolute", z)]
    if joint.type == "cylindrical":
        chain = [(f"{name}_slide", "prismatic", z), (name, "revolute", z)]
    elif joint.type == "spherical":
        chain = [(f"{name}_x", "revolute", x), (f"{name}_y", "revolute", y), (f"{name}_z", "revolute", z)]
        T = T @ spatial.pose(T_home[:3, :3])  # so that all three angles are zero at home, far from their singularity
    inner = joint.parent
    if joint.type == "free":
        _add_urdf_joint(root, joint, name, "floating", (inner, joint.child), T @ T_home @ T_joint_child, z)
        return
    for part, kind, axis in chain:
        outer = f"{part}_axis"
        if part == chain[-1][0]:  # the link of the last axis has the name of the joint
            outer = f"{name}_axis"
        add_inertial(ET.SubElement(root, "link", name=outer), AUXILIARY_INERTIA)
        _add_urdf_joint(root, joint, part, kind, (inner, outer), T, axis)
        inner = outer
        T = np.eye(4)  # the further axes are at the same place
    _add_urdf_joint(root, joint, f"{name}_body", "fixed", (inner, joint.child), T_joint_child, z)


def add_loop_closure(root: ET.Element, joint: Joint) -> None:
    """Write the two links that coincide if the loop at a joint is closed, and the joint itself if it moves in one.

    No joint has the name of a link: Pinocchio could not tell their frames apart by name.
    """
    first, second = ends(joint)
    z = np.eye(3)[2]
    if joint.type in ("revolute", "prismatic", "cylindrical"):
        joint_to_first = replace(joint, child=first, T_child_joint=np.eye(4))
        add_inertial(ET.SubElement(root, "link", name=first), AUXILIARY_INERTIA)
        add_joint(root, joint_to_first, np.eye(4))
    else:
        ET.SubElement(root, "link", name=first)
        _add_urdf_joint(root, joint, f"{first}_fixed", "fixed", (joint.parent, first), joint.T_parent_joint, z)
    ET.SubElement(root, "link", name=second)
    _add_urdf_joint(root, joint, f"{second}_fixed", "fixed", (joint.child, second), joint.T_child_joint, z)


def _add_urdf_joint(
    root: ET.Element, joint: Joint, name: str, kind: str, links: tuple[str, str], T: Array, axis: Array
) -> None:
    """Write one URDF joint of type `kind` between `links`, (parent, child), at T (4, 4) in the parent's frame."""
    is_continuous = kind == "revolute" and joint.limits is None
    element = ET.SubElement(root, "joint", name=name, type="continuous" if is_continuous else kind)
    # Turns about the moving axes z, y, x are turns about the fixed axes x, y, z in the opposite order, as in `rpy`.
    yaw_pitch_roll = spatial.euler_angles(T[:3, :3], "zyx")
    ET.SubElement(element, "origin", xyz=numbers(T[:3, 3]), rpy=numbers(yaw_pitch_roll[::-1]))
    ET.SubElement(element, "parent", link=links[0])
    ET.SubElement(element, "child", link=links[1])
    if kind in ("fixed", "floating"):
        return
    ET.SubElement(element, "axis", xyz=numbers(axis))
    limit = dict(UNKNOWN_BOUNDS)
    if not is_continuous:
        low, high = joint.limits or (-np.inf, np.inf)
        if not np.isfinite(low):
            low = -NO_LIMIT
        if not np.isfinite(high):
            high = NO_LIMIT
        limit |= {"lower": numbers([low]), "upper": numbers([high])}
    if joint.drive is not None and joint.drive.max_effort is not None:
        limit["effort"] = gains([joint.drive.max_effort])
    if joint.max_speed is not None:
        limit["velocity"] = gains([joint.max_speed])
    ET.SubElement(element, "limit", limit)


def add_inertial(link: ET.Element, inertia: Inertia) -> None:
    """Write the mass, the centre of mass and the inertia tensor of a link."""
    element = ET.SubElement(link, "inertial")
    ET.SubElement(element, "origin", xyz=numbers(inertia.p_body_com), rpy="0 0 0")
    ET.SubElement(element, "mass", value=f"{inertia.mass:.12g}")
    I = inertia.I_com  # noqa: E741 - the symbol of the field
    entries = {"ixx": I[0, 0], "ixy": I[0, 1], "ixz": I[0, 2], "iyy": I[1, 1], "iyz": I[1, 2], "izz": I[2, 2]}
    attributes = {}
    for name, value in entries.items():
        attributes[name] = f"{value:.12g}"
    ET.SubElement(element, "inertia", attributes)
