"""Write a mechanism as SDF, which twin itself does not write: a body is a link, a joint that closes a loop a joint."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from twin.core import spatial
from twin.exchange.write.meshes import SCALE, mesh_file, write_meshes
from twin.model.body import Body
from twin.model.joint import Joint
from twin.model.mechanism import Coupling, Mechanism
from twin.reference import ReferenceModel

_TYPES = {"revolute": "revolute", "prismatic": "prismatic", "spherical": "ball", "fixed": "fixed"}


def write_sdf(m: Mechanism, folder: Path) -> Path:
    """Write <robot>.sdf and its mesh files; return the path of the .sdf file.

    In SDF every joint is zero in the written poses: these are the poses at home. A plug-in names the driven joints.
    SDF has no coupling of more than two joints; such a coupling is left out, and one of its passive joints driven.
    """
    write_meshes(m, folder)
    home = ReferenceModel(m).home().link_poses
    joints = [*m.tree, *m.loops]
    at = {}
    for joint in joints:
        if len(joint.free_axes) == 1:
            at[joint.name] = float(joint.coordinate(home[joint.parent], home[joint.child]))
    root = ET.Element("sdf", version="1.11")
    world = ET.SubElement(root, "world", name="world")
    ET.SubElement(world, "gravity").text = _text(m.gravity)
    model = ET.SubElement(world, "model", name=m.name)
    for body in m.bodies:
        _link(model, body, home[body.name])
    base = ET.SubElement(model, "joint", name="stand", type="fixed")
    ET.SubElement(base, "parent").text = "world"
    ET.SubElement(base, "child").text = m.base
    driven = {j.name for j in m.active}
    follow = {}
    for coupling in m.couplings:
        passive = next(n for n in coupling.joints if n not in driven and n not in follow)
        if len(coupling.joints) == 2:
            follow[passive] = coupling
        else:
            driven.add(passive)
    for joint in joints:
        _joint(model, joint, at, follow.get(joint.name))
    plugin = ET.SubElement(model, "plugin", name="drives", filename="drives")
    for name in sorted(driven):
        ET.SubElement(plugin, "joint_name").text = name
    path = folder / f"{m.name}.sdf"
    ET.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
    return path


def _link(model: ET.Element, body: Body, T: np.ndarray) -> None:
    link = ET.SubElement(model, "link", name=body.name)
    ET.SubElement(link, "pose").text = _pose(T)
    if body.inertia is not None:
        inertial = ET.SubElement(link, "inertial")
        ET.SubElement(inertial, "pose").text = _text([*body.inertia.p_body_com, 0, 0, 0])
        ET.SubElement(inertial, "mass").text = _text([body.inertia.mass])
        tensor = ET.SubElement(inertial, "inertia")
        for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
            ET.SubElement(tensor, f"i{'xyz'[i]}{'xyz'[j]}").text = _text([body.inertia.I_com[i, j]])
    for mesh in body.meshes:
        for use in ("visual", "collision"):
            shape = ET.SubElement(link, use, name=f"{mesh.name}_{use}")
            file = ET.SubElement(ET.SubElement(shape, "geometry"), "mesh")
            ET.SubElement(file, "uri").text = mesh_file(mesh)
            ET.SubElement(file, "scale").text = SCALE


def _joint(model: ET.Element, joint: Joint, at: dict[str, float], coupling: Coupling | None) -> None:
    element = ET.SubElement(model, "joint", name=joint.name, type=_TYPES[joint.type])
    ET.SubElement(element, "pose").text = _pose(joint.T_child_joint)  # in the child link
    ET.SubElement(element, "parent").text = joint.parent
    ET.SubElement(element, "child").text = joint.child
    if joint.name not in at:
        return
    axis = ET.SubElement(element, "axis")
    ET.SubElement(axis, "xyz").text = "0 0 1"
    if joint.limits is not None:
        limit = ET.SubElement(axis, "limit")
        low, high = joint.limits
        ET.SubElement(limit, "lower").text = _text([low - at[joint.name]])
        ET.SubElement(limit, "upper").text = _text([high - at[joint.name]])
    if coupling is not None:
        ratios = dict(zip(coupling.joints, coupling.ratios, strict=True))
        leader = next(n for n in coupling.joints if n != joint.name)
        shifted = coupling.total - sum(r * at[n] for n, r in ratios.items())
        mimic = ET.SubElement(axis, "mimic", joint=leader)
        ET.SubElement(mimic, "multiplier").text = _text([-ratios[leader] / ratios[joint.name]])
        ET.SubElement(mimic, "offset").text = _text([shifted / ratios[joint.name]])
        ET.SubElement(mimic, "reference").text = "0"


def _pose(T: np.ndarray) -> str:
    return _text([*T[:3, 3], *spatial.euler_angles(T[:3, :3], "zyx")[::-1]])


def _text(values) -> str:
    return " ".join(f"{float(v):.17g}" for v in values)
