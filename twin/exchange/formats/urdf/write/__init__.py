"""Write a robot as URDF, and its loops beside it as a closure YAML, because URDF cannot hold loops.

Links have the names and the frames of the mechanism's bodies. A URDF joint rotates about a line through the origin of
its child link. If the origin of a body is not on its pin, the body is therefore the child of an auxiliary link
`<joint>_axis` at the pin. A ball joint becomes three hinges about x, y and z. Their angles are zero at home, far from
their singularity. A free joint is `floating`; its zero is the pose at home.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from twin.core import spatial
from twin.core.findings import Finding, Kind, info, warning
from twin.core.spatial import Array
from twin.exchange.formats.urdf.write.closure_yaml import ends, write_closures
from twin.exchange.write.assumed_masses import inertia_of, partly_shown, unweighed
from twin.exchange.write.left_out import left_out, motors_left_out
from twin.exchange.write.meshes import SCALE, mesh_file, write_meshes
from twin.exchange.write.order import Order
from twin.exchange.write.xml_text import gains, numbers, srgb, write_xml
from twin.model.body import Body, Material
from twin.model.inertia import Inertia
from twin.model.joint import Drive, Joint
from twin.model.mechanism import EARTH, Coupling, Mechanism
from twin.model.mimic_joints import Following, following
from twin.usd.write.spanning import spanning

SMALL = Inertia(1e-6, np.zeros(3), 1e-9 * np.eye(3))
"""Inertia of an auxiliary link: negligible, but large enough for simulators."""

UNKNOWN = {"effort": "1e6", "velocity": "1e6"}
"""Values that mean "unknown" for numbers that URDF requires."""

SIMPLE = "transmission_interface/SimpleTransmission"
"""Transmission type of one motor and one joint: motor value = mechanicalReduction * joint value."""

COUPLED = "twin/LinearTransmission"
"""Transmission type of several motors and joints; URDF cannot contain the transmission matrix."""

FAR = 1e3
"""Limit in m of a slide without limits, because URDF requires a limit."""

_ON_AXIS = 1e-12
"""Maximum distance in m between a body's origin and its pin axis at which the origin counts as a point on the axis."""


_TRANSMISSION = Kind("export.urdf_transmission", "warning", "use MJCF or USD if motors matter")
_LOOPS = Kind("export.urdf_loops", "warning", "use MJCF or USD where programs do not read the closure YAML")


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
    cut = _loop_joints(mechanism)
    couplings = _couplings_without_mimic(mechanism)
    if has_closures(mechanism):
        values = _values((*spanning(mechanism).tree, *cut), home)
        driven = [joint.name for joint in mechanism.active]
        write_closures(cut, couplings, driven, values, path.with_suffix(".yaml"))
    return write_xml(_document(mechanism, home, path.stem), path)


def has_closures(mechanism: Mechanism) -> bool:
    """Return whether `write_urdf` writes a closure YAML: for loops, and for couplings that are no mimics."""
    return bool(_loop_joints(mechanism) or _couplings_without_mimic(mechanism))


def urdf_findings(mechanism: Mechanism, name: str = "") -> list[Finding]:
    """Return findings on data that URDF cannot hold; the URDF file contains the findings as comments.

    `name` is the name of the URDF and of its closure YAML without suffix, by default that of the robot.
    """
    name = name or mechanism.name
    file = f"{name}.urdf"
    findings = [*unweighed(mechanism, file), *partly_shown(mechanism, file)]
    findings += motors_left_out(mechanism, file, "limits", "rotor_inertia", "stiffness")
    for transmission in mechanism.transmissions:
        if not all(map(transmission.single, transmission.joints)):
            text = (
                f"{file}: URDF cannot hold the matrix of transmission {transmission.name} ({transmission.equations}), "
                "only the names of its joints and actuators"
            )
            findings.append(_TRANSMISSION(transmission.name, text))
    cut_names = []
    cut_joints = []
    for joint in _loop_joints(mechanism):
        cut_names.append(joint.name)
        cut_joints.append(f"{joint.name} ({joint.type}, {joint.parent} to {joint.child})")
    if cut_joints:
        text = (
            f"{file}: URDF cannot close loops; {name}.yaml closes them, at {', '.join(cut_joints)}. Programs "
            "that do not read it have correct link poses only with the values of the passive joints from the tracks"
        )
        findings.append(_LOOPS(", ".join(cut_names), text))
    for coupling in _couplings_without_mimic(mechanism):
        terms = []
        for joint_name, ratio in zip(coupling.joints, coupling.ratios, strict=True):
            terms.append(f"{ratio:g} {joint_name}")
        text = (
            f"{file}: URDF cannot hold coupling {coupling.name}: {' + '.join(terms)} = {coupling.total:g}; it is in "
            f"{name}.yaml"
        )
        findings.append(warning("export.urdf_coupling", coupling.name, text))
    findings += left_out(mechanism, file, "soft_limits", "max_acceleration", "max_jerk", "cone")
    if mechanism.gravity != EARTH:
        vector = ", ".join(map("{:g}".format, mechanism.gravity))
        text = f"{file}: the format cannot hold gravity, which is ({vector}) m/s2; set it in the simulator"
        findings.append(info("export.left_out", "gravity", text))
    if mechanism.frames or mechanism.points:
        names = ", ".join(part.name for part in (*mechanism.frames, *mechanism.points))
        findings.append(info("export.left_out", names, f"{file}: URDF cannot hold the frames and points {names}"))
    return findings


def _mimics(mechanism: Mechanism) -> dict[str, Following]:
    """Return {coupling: its leader and follower} for couplings of two joints of the tree; URDF can hold no others."""
    one_coordinate_joints = set()
    for joint in spanning(mechanism).tree:
        if joint.type in ("revolute", "prismatic"):
            one_coordinate_joints.add(joint.name)
    return following(mechanism, one_coordinate_joints)


def _couplings_without_mimic(mechanism: Mechanism) -> list[Coupling]:
    """Return the couplings that are no mimics of URDF."""
    mimics = _mimics(mechanism)
    return [coupling for coupling in mechanism.couplings if coupling.name not in mimics]


def _loop_joints(mechanism: Mechanism) -> list[Joint]:
    """Return the joints that close loops; a free joint closes none."""
    return [joint for joint in spanning(mechanism).cut if joint.type != "free"]


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
    _transmissions(root, mechanism)
    for joint in spanning(mechanism).tree:
        _joint(root, _as_driven(mechanism, joint), joint.relative(home[joint.parent], home[joint.child]))
    for joint in _loop_joints(mechanism):
        _loop_closure(root, _as_driven(mechanism, joint))
    joint_elements = {element.get("name"): element for element in root.findall("joint")}
    for follower in _mimics(mechanism).values():
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


def _transmissions(root: ET.Element, mechanism: Mechanism) -> None:
    """Write a transmission for every driven joint; joints without a transmission are passive."""
    for joint in mechanism.active:
        transmission = mechanism.transmission_of(joint.name)
        name = f"{joint.name}_transmission"
        single: tuple[str, float] | None = (joint.name, 1.0)  # a drive at the joint itself is written as a motor, too
        if transmission is not None:
            single = transmission.single(joint.name)
            if len(transmission.joints) == 1:
                name = transmission.name
        if single:
            actuator, ratio = single
            _transmission(root, name, SIMPLE, [joint.name], {actuator: 1 / ratio})
    for transmission in mechanism.transmissions:
        joints = []
        coupled_motors = dict.fromkeys(transmission.actuators)  # those without a transmission of their own above
        for name in transmission.joints:
            single = transmission.single(name)
            if single:
                coupled_motors.pop(single[0], None)
            else:
                joints.append(name)
        if joints:
            _transmission(root, transmission.name, COUPLED, joints, coupled_motors)


def _transmission(
    root: ET.Element, name: str, kind: str, joints: list[str], motors: Mapping[str, float | None]
) -> None:
    """Write a transmission; `motors` is {motor: its reduction, None if the transmission has a matrix instead}."""
    transmission = ET.SubElement(root, "transmission", name=name)
    ET.SubElement(transmission, "type").text = kind
    for joint in joints:
        _interfaced_part(transmission, "joint", joint)
    for motor, reduction in motors.items():
        element = _interfaced_part(transmission, "actuator", motor)
        if reduction is not None:
            ET.SubElement(element, "mechanicalReduction").text = f"{reduction:.12g}"


def _interfaced_part(transmission: ET.Element, tag: str, name: str) -> ET.Element:
    """Add a joint or an actuator with a position interface, which ros_control requires, to a transmission."""
    element = ET.SubElement(transmission, tag, name=name)
    ET.SubElement(element, "hardwareInterface").text = "hardware_interface/PositionJointInterface"
    return element


def _link(root: ET.Element, body: Body, materials: Mapping[str, Material], has_inertial: bool) -> None:
    link = ET.SubElement(root, "link", name=body.name)
    if has_inertial:
        _inertial(link, inertia_of(body))
    for mesh in body.meshes:
        for use in ("visual", "collision"):
            shape = ET.SubElement(link, use, name=f"{mesh.name}_{use}")
            geometry = ET.SubElement(shape, "geometry")
            ET.SubElement(geometry, "mesh", filename=mesh_file(mesh), scale=SCALE)
            if use == "visual":
                ET.SubElement(shape, "material", name=materials[mesh.name].name)


def _joint(root: ET.Element, joint: Joint, T_home: Array) -> None:
    """Write a joint of the tree as one URDF joint, or as a chain of URDF joints over auxiliary links."""
    name = joint.name
    T_child_joint = joint.T_child_joint
    T_joint_child = spatial.inverse(T_child_joint)
    pin_point = T_child_joint[:3, 3]
    pin_axis = T_child_joint[:3, 2]
    # A joint of URDF is at the origin of its child: another pin needs an auxiliary link on its axis.
    through_origin = np.linalg.norm(np.cross(pin_point, pin_axis)) < _ON_AXIS
    if joint.type in ("fixed", "prismatic") or (joint.type == "revolute" and through_origin):
        _single(
            root, joint, name, joint.type, (joint.parent, joint.child), joint.T_parent_joint @ T_joint_child, pin_axis
        )
        return
    x, y, z = np.eye(3)
    T = joint.T_parent_joint
    steps = [(name, "revolute", z)]
    if joint.type == "cylindrical":
        steps = [(f"{name}_slide", "prismatic", z), (name, "revolute", z)]
    elif joint.type == "spherical":
        steps = [(f"{name}_x", "revolute", x), (f"{name}_y", "revolute", y), (f"{name}_z", "revolute", z)]
        T = T @ spatial.pose(T_home[:3, :3])  # so that all three angles are zero at home, far from their singularity
    inner = joint.parent
    if joint.type == "free":
        _single(root, joint, name, "floating", (inner, joint.child), T @ T_home @ T_joint_child, z)
        return
    for step, (part, kind, axis) in enumerate(steps):
        outer = f"{part}_axis"
        if step == len(steps) - 1:
            outer = f"{name}_axis"
        _inertial(ET.SubElement(root, "link", name=outer), SMALL)
        _single(root, joint, part, kind, (inner, outer), T, axis)
        inner = outer
        T = np.eye(4)  # the further axes are at the same place
    _single(root, joint, f"{name}_body", "fixed", (inner, joint.child), T_joint_child, z)


def _loop_closure(root: ET.Element, joint: Joint) -> None:
    """Write the two links that coincide if the loop at a joint is closed, and the joint itself if it moves in one.

    No joint has the name of a link: Pinocchio could not tell their frames apart by name.
    """
    first, second = ends(joint)
    z = np.eye(3)[2]
    if joint.type in ("revolute", "prismatic", "cylindrical"):
        joint_to_first = replace(joint, child=first, T_child_joint=np.eye(4))
        _inertial(ET.SubElement(root, "link", name=first), SMALL)
        _joint(root, joint_to_first, np.eye(4))
    else:
        ET.SubElement(root, "link", name=first)
        _single(root, joint, f"{first}_fixed", "fixed", (joint.parent, first), joint.T_parent_joint, z)
    ET.SubElement(root, "link", name=second)
    _single(root, joint, f"{second}_fixed", "fixed", (joint.child, second), joint.T_child_joint, z)


def _single(
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
    limit = dict(UNKNOWN)
    if not is_continuous:
        low, high = joint.limits or (-FAR, FAR)
        limit |= {"lower": numbers([low]), "upper": numbers([high])}
    if joint.drive is not None and joint.drive.max_effort is not None:
        limit["effort"] = gains([joint.drive.max_effort])
    if joint.max_speed is not None:
        limit["velocity"] = gains([joint.max_speed])
    ET.SubElement(element, "limit", limit)


def _inertial(link: ET.Element, inertia: Inertia) -> None:
    element = ET.SubElement(link, "inertial")
    ET.SubElement(element, "origin", xyz=numbers(inertia.p_body_com), rpy="0 0 0")
    ET.SubElement(element, "mass", value=f"{inertia.mass:.12g}")
    I = inertia.I_com  # noqa: E741 - the symbol of the field
    entries = {"ixx": I[0, 0], "ixy": I[0, 1], "ixz": I[0, 2], "iyy": I[1, 1], "iyz": I[1, 2], "izz": I[2, 2]}
    attributes = {}
    for name, value in entries.items():
        attributes[name] = f"{value:.12g}"
    ET.SubElement(element, "inertia", attributes)


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
