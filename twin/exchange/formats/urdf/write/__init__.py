"""Write a robot as URDF, and its loops beside it as a closure YAML, because URDF cannot hold loops.

Links have the names and the frames of the mechanism's bodies. A URDF joint rotates about a line through the origin of
its child link. If the origin of a body is not on its pin, the body is therefore the child of an auxiliary link
`<joint>_axis` at the pin. A ball joint becomes three hinges about x, y and z. Their angles are zero at home, far from
their singularity. A free joint is `floating`; its zero is the pose at home. `joints` writes joints and auxiliary links,
`transmissions` and `closure_yaml` what their names say, and `findings` states what neither file can hold.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

from twin.core.findings import Finding
from twin.core.spatial import Array
from twin.exchange.formats.urdf.write.closure_yaml import write_closures
from twin.exchange.formats.urdf.write.findings import couplings_without_mimic, loop_joints, mimics, urdf_findings
from twin.exchange.formats.urdf.write.joints import add_inertial, add_joint, add_loop_closure
from twin.exchange.formats.urdf.write.transmissions import add_transmissions
from twin.exchange.write.assumed_masses import inertia_of
from twin.exchange.write.meshes import SCALE, mesh_file, write_meshes
from twin.exchange.write.order import Order
from twin.exchange.write.xml_text import numbers, srgb, write_xml
from twin.model.body import Body, Material
from twin.model.joint import Drive, Joint
from twin.model.mechanism import Mechanism
from twin.usd.write.spanning import spanning


def write_urdf(mechanism: Mechanism, folder: Path, name: str = "") -> Path:
    """Write <robot>.urdf, or <name>.urdf, and the mesh files that it uses; return the path of the .urdf file.

    `urdf_findings` lists the data that the file cannot hold. Masses that the mechanism lacks are assumed. Loops are cut
    at joints chosen by `twin.usd.write.spanning`, and stated in a closure YAML of the same name. `name` is the name of
    the files without suffix, if a robot has several (one for each trocar position).

    Raises:
        AssemblyError: the loops of the mechanism cannot be closed.
    """
    from twin.reference import ReferenceModel

    folder.mkdir(parents=True, exist_ok=True)
    write_meshes(mechanism, folder)
    path = folder / f"{name or mechanism.name}.urdf"
    home = ReferenceModel(mechanism).home().link_poses
    cut = loop_joints(mechanism)
    couplings = couplings_without_mimic(mechanism)
    if has_closures(mechanism):
        values = _values((*spanning(mechanism).tree, *cut), home)
        driven = [joint.name for joint in mechanism.active]
        write_closures(cut, couplings, driven, values, path.with_suffix(".yaml"))
    return write_xml(_document(mechanism, home, path.stem), path)


def has_closures(mechanism: Mechanism) -> bool:
    """Return whether `write_urdf` writes a closure YAML: for loops, and for couplings that are no mimics."""
    return bool(loop_joints(mechanism) or couplings_without_mimic(mechanism))


def _values(joints: Iterable[Joint], home: Mapping[str, Array]) -> dict[str, float]:
    """Return {joint of the URDF: value in m or rad} at the link poses `home`; hinges of a ball joint are at zero."""
    values = {}
    for joint in joints:
        T = joint.relative(home[joint.parent], home[joint.child])
        if joint.type == "cylindrical":
            values[f"{joint.name}_slide"] = float(T[2, 3])
            values[joint.name] = float(joint.angle(T))
        elif joint.type in ("revolute", "prismatic"):
            values[joint.name] = float(joint.coordinate(home[joint.parent], home[joint.child]))
    return values


def _document(mechanism: Mechanism, home: Mapping[str, Array], name: str) -> ET.Element:
    root = ET.Element("robot", name=mechanism.name)
    for finding in urdf_findings(mechanism, name):
        comment = f" {finding.message}. ".replace("--", "-")  # two hyphens would end a comment of XML
        root.append(ET.Comment(comment))
    for material in dict.fromkeys(mechanism.materials.values()):
        element = ET.SubElement(root, "material", name=material.name)
        ET.SubElement(element, "color", rgba=srgb(material.color_rgba))
    for body in mechanism.bodies:
        # The base does not move, so no mass is assumed for it.
        has_inertial = body.name != mechanism.base or body.inertia is not None
        _link(root, body, mechanism.materials, has_inertial)
    add_transmissions(root, mechanism)
    for joint in spanning(mechanism).tree:
        add_joint(root, _as_driven(mechanism, joint), joint.relative(home[joint.parent], home[joint.child]))
    for joint in loop_joints(mechanism):
        add_loop_closure(root, _as_driven(mechanism, joint))
    joint_elements = {element.get("name"): element for element in root.findall("joint")}
    for follower in mimics(mechanism).values():
        attributes = {
            "joint": follower.leader,
            "multiplier": numbers([follower.multiplier]),
            "offset": numbers([follower.offset]),
        }
        ET.SubElement(joint_elements[follower.joint], "mimic", attributes)
    return root


def _as_driven(mechanism: Mechanism, joint: Joint) -> Joint:
    """Return a joint with the maximum effort and speed of its motor, if a single motor drives the joint."""
    transmission = mechanism.transmission_of(joint.name)
    single = transmission and transmission.single(joint.name)
    if not single:
        return joint
    actuator, signed_ratio = single
    motor = mechanism.actuator(actuator)
    ratio = abs(signed_ratio)  # joint value = ratio * motor value; the efforts are the other way round
    drive: Drive | None = None
    if motor.max_effort is not None:
        drive = Drive(0.0, 0.0, motor.max_effort / ratio)
    max_speed = joint.max_speed
    if not max_speed and motor.max_speed is not None:
        max_speed = motor.max_speed * ratio
    return replace(joint, drive=drive, max_speed=max_speed)


def _link(root: ET.Element, body: Body, materials: Mapping[str, Material], has_inertial: bool) -> None:
    link = ET.SubElement(root, "link", name=body.name)
    if has_inertial:
        add_inertial(link, inertia_of(body))
    for mesh in body.meshes:
        for use in ("visual", "collision"):
            shape = ET.SubElement(link, use, name=f"{mesh.name}_{use}")
            geometry = ET.SubElement(shape, "geometry")
            ET.SubElement(geometry, "mesh", filename=mesh_file(mesh), scale=SCALE)
            if use == "visual":
                ET.SubElement(shape, "material", name=materials[mesh.name].name)


def write(order: Order, folder: Path) -> list[Finding]:
    """Write a robot, and a file for each motion with other trocars, into `folder`; return what is left out."""
    write_urdf(order.mechanism, folder)
    for scene in order.elsewhere:
        write_urdf(scene.mechanism, folder, f"{order.mechanism.name}_{scene.clip.name}")
    return urdf_findings(order.mechanism)


def files(order: Order) -> list[tuple[str, str]]:
    """Return (file, content) for README.txt."""
    name = order.mechanism.name
    rows = [(f"{name}.urdf", "URDF, loops cut open; shapes in meshes/ (mm)")]
    if has_closures(order.mechanism):
        rows.append((f"{name}.yaml", "loops and couplings that the URDF cannot hold"))
    for scene in order.elsewhere:
        rows.append((f"{name}_{scene.clip.name}.urdf", f"the same with the trocars of {scene.clip.name}"))
        if has_closures(scene.mechanism):
            rows.append((f"{name}_{scene.clip.name}.yaml", "its loops and couplings with these trocars"))
    return rows
