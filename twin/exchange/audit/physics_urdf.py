"""Read the mechanism data of a URDF: tree, inertias and limits; URDF cannot hold loops, frames and gravity."""

from __future__ import annotations

from collections.abc import Iterable
from xml.etree import ElementTree as ET

import numpy as np

from twin.exchange.audit.physics import Drive, Joint, Line, Mass, Motor, Physics
from twin.exchange.audit.poses import Array

NO_LIMIT = 100.0
"""Limit in m from which a slide counts as unlimited, because URDF requires a limit."""

NO_BOUND = 1e6
"""Effort (N, N m) or speed (m/s, rad/s) from which a value counts as unknown, because URDF requires a number."""


def inertial(element: ET.Element, pose_of, numbers) -> Mass | None:
    """Return the mass properties of a <link>; None if it has no <inertial>.

    `pose_of` returns the pose (4, 4) of an <origin>; `numbers` returns the numbers of an attribute.
    """
    here = element.find("inertial")
    if here is None:
        return None
    mass, tensor, T = here.find("mass"), here.find("inertia"), pose_of(here.find("origin"))
    value = {k: float(numbers(None if tensor is None else tensor.get(k), 1, (0.0,))[0]) for k in _PARTS}
    xx, xy, xz, yy, yz, zz = (value[k] for k in _PARTS)
    own = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    R = T[:3, :3]
    return Mass(float(numbers(None if mass is None else mass.get("value"), 1, (0.0,))[0]), T[:3, 3], R @ own @ R.T)


_PARTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def tree_physics(links: Iterable[str], masses: dict[str, Mass], joints: Iterable) -> Physics:
    """Return the mechanism data of a tree of `UrdfJoint`."""
    out = Physics(tuple(links), masses)
    for j in joints:
        T, axis = j.link.fixed, j.link.axis
        motions: tuple[Line, ...] = ()
        if j.link.kind != "fixed" and axis is not None:
            motions = (Line(j.link.kind, T[:3, 3], _unit(T[:3, :3] @ axis)),)
        low, high = j.limits or (-np.inf, np.inf)
        if j.link.kind == "slide" and max(abs(low), abs(high)) >= NO_LIMIT:
            low, high = -np.inf, np.inf
        effort, speed = (None if b is None or b >= NO_BOUND else b for b in (j.effort, j.speed))
        drive = Drive((low, high), None, None, None, effort, speed) if motions else Drive()
        out.joints.append(Joint((j.name,), j.parent, j.child, T, motions, drive))
    return out


def motors(root: ET.Element, number) -> dict[str, Motor]:
    """Return the motors of <transmission> elements with one joint; `number` converts a text to a number.

    A motor with the same name as its joint is omitted, because it is the drive of the joint.
    """
    out = {}
    for t in root.findall("transmission"):
        joints, names = ([str(e.get("name")) for e in t.findall(k)] for k in ("joint", "actuator"))
        reductions = [float(number(r.text, 1, ())[0]) for r in t.iter("mechanicalReduction")]
        if len(joints) == len(names) == len(reductions) == 1 and names != joints:
            out[names[0]] = Motor({joints[0]: reductions[0]})
    return out


def _unit(v: Array) -> Array:
    size = float(np.linalg.norm(v))
    return v / size if size > 0 else v
