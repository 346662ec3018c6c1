"""Write a robot as MJCF for MuJoCo: a tree, and equality constraints that close the loops.

Bodies are placed at home, so that a simulation starts with closed loops. The `ref` of a joint is its coordinate at
home, so that joint coordinates in the file are equal to the coordinates of the mechanism. A control is the displacement
of a drive from home: the initial value zero holds the robot at home. A ball joint has no scalar coordinate; its
quaternion is relative to home. A <connect> has a single anchor point for both bodies. One point is sufficient, because
loops are closed at `ref`, and Drake reads no other form. Loops and couplings are written as follows:

    spherical       one connect at the ball
    revolute        two connects, at two points of the pin
    fixed           one weld, site to site
    with a slide    an auxiliary body (carrier, 1 g without weight), with a slide (and hinge) on one body and a weld to
                    the other
    free            none: the body is at the top level, with a freejoint; on a moving parent three slides and a ball
    couplings       a fixed tendon of constant length

A motor with a transmission is written as an actuator that pulls a fixed tendon. The tendon's coefficients are the
motor's row of the inverse transmission matrix, so that the tendon's length is the motor's coordinate.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from twin.core import spatial
from twin.core.findings import Finding
from twin.core.spatial import Array
from twin.exchange.write.assumed_masses import inertia_of, partly_shown, unweighed
from twin.exchange.write.meshes import SCALE, mesh_file, write_meshes
from twin.exchange.write.omissions import left_out, limits_left_out, motors_left_out
from twin.exchange.write.order import Order
from twin.exchange.write.xml_text import gains, numbers, srgb, write_xml, xml_text
from twin.model.hull import flat
from twin.model.inertia import Inertia
from twin.model.joint import Joint
from twin.model.mechanism import EARTH, WORLD, Mechanism
from twin.usd.write.spanning import spanning

CONNECT_DISTANCE = 0.05
"""Distance in m along the pin between the two <connect> points of a revolute joint."""

CARRIER_INERTIA = Inertia(1e-3, np.zeros(3), 1e-7 * np.eye(3))
"""Inertia of the auxiliary body (carrier) of a loop closure with a slide."""

SITE_SIZE = "0.002"
"""Radius in m with which sites are displayed."""

CONSTRAINT_SOLVER = {"solref": "0.001 1", "solimp": "0.9999 0.9999 0.001 0.5 2"}
"""Solver parameters of the equality constraints. With the softer defaults of MuJoCo, loops open under load."""

OPTION = {"timestep": "0.001", "integrator": "discrete", "iterations": "100", "tolerance": "1e-12"}
"""Simulation options; the integrator "discrete" solves drives and equality constraints together.

Other implicit integrators correct accelerations after the constraints are solved: at a time step of 1 ms the loops of
SHER oscillate by 14 mm (measured). With an explicit integrator LAPBOT is unstable.
"""

STEPPING_COMMENT = (
    "The constraints that close loops act as springs. At this time step, with this integrator (MuJoCo 3.13 or newer), "
    "the loops of the robots that come with twin stay closed within 1 um: 10 s at rest under gravity, and along their "
    "protocols. With an older MuJoCo use implicitfast and 0.0001 s."
)

CONTROLS_COMMENT = (
    "A control is the displacement of its joint from home, in m or rad: ctrl = coordinate - ref. Zero holds the robot "
    "at home, where its weight is compensated. A motor has no gains: its control is its force."
)


MOTORS_COMMENT = (
    "A tendon with the name of its actuator is a motor: its length is the motor's coordinate, in rad or m as stated by "
    "the text of that name; a tuple names the joints and the motors of a transmission. Controls of motors are also "
    "displacements from home."
)


def write_mjcf(mechanism: Mechanism, folder: Path, name: str = "") -> Path:
    """Write <robot>.xml, or <name>.xml, and the mesh files that it uses; return the path of the .xml file.

    Masses that the mechanism lacks are assumed (`mjcf_findings` reports them). `name` is the file name without suffix,
    if a robot has several files (one for each trocar position).

    Raises:
        AssemblyError: the loops of the mechanism cannot be closed.
    """
    folder.mkdir(parents=True, exist_ok=True)
    write_meshes(mechanism, folder)
    path = folder / f"{name or mechanism.name}.xml"
    return write_xml(_Writer(mechanism, path.name).root, path)


def mjcf_text(mechanism: Mechanism) -> str:
    """Return the MJCF of a mechanism as text. Meshes are in separate files (see `write_meshes`).

    Raises:
        AssemblyError: the loops of the mechanism cannot be closed.
    """
    return xml_text(_Writer(mechanism, f"{mechanism.name}.xml").root)


def mjcf_findings(mechanism: Mechanism, file: str = "") -> list[Finding]:
    """Return findings on differences between the MJCF and the mechanism; the MJCF contains the same findings.

    `file` is the name of the MJCF file, by default <robot>.xml.
    """
    file = file or f"{mechanism.name}.xml"
    findings = [*unweighed(mechanism, file), *partly_shown(mechanism, file)]
    findings += motors_left_out(mechanism, file, "max_speed")
    # MJCF can limit the rotation angle of a ball joint, but not the cone of its axis.
    fields = ("soft_limits", "max_speed", "max_acceleration", "max_jerk", "cone")
    return [*findings, *left_out(mechanism, file, *fields), *limits_left_out(mechanism, file)]


class _Writer:
    """Builder of the MJCF document `file`: writes the tree of bodies, and collects the elements of all other sections.

    Attributes:
        spanning: the joints of the tree, and those at which loops are cut.
        home, efforts: the state at home, and the efforts {joint: N or N m} that hold the robot there.
        weld_sites: {body: [(site, T_body_site)]} at the ends of welds.
        carriers: {body: loop joints with a slide, each of which needs an auxiliary body on it}.
        qpos: MuJoCo's coordinates at home, in the order in which joints are written.
        root: the element <mujoco>.
    """

    def __init__(self, mechanism: Mechanism, file: str) -> None:
        from twin.reference import ReferenceModel
        from twin.reference.holding_efforts import holding_efforts

        self.mechanism = mechanism
        self.spanning = spanning(mechanism)
        model = ReferenceModel(mechanism)
        self.home = model.home()
        self.efforts = holding_efforts(model, self.home)
        self.weld_sites: dict[str, list[tuple[str, Array]]] = {}
        self.carriers: dict[str, list[Joint]] = {}
        self.qpos: list[float] = []
        self.root = root = ET.Element("mujoco", model=mechanism.name)
        for finding in mjcf_findings(mechanism, file):
            root.append(ET.Comment(f" {finding.message} "))
        ET.SubElement(root, "compiler", angle="radian", autolimits="true")
        root.append(ET.Comment(f" {STEPPING_COMMENT} "))
        option = ET.SubElement(root, "option", OPTION)
        if mechanism.gravity != EARTH:
            option.set("gravity", numbers(mechanism.gravity))
        asset = ET.SubElement(root, "asset")
        for material in dict.fromkeys(mechanism.materials.values()):  # meshes share materials: each is written once
            attributes = {
                "name": material.name,
                "rgba": srgb(material.color_rgba),
                "metallic": numbers([material.finish.metallic]),
                "roughness": numbers([material.finish.roughness]),
            }
            ET.SubElement(asset, "material", attributes)
        for body in mechanism.bodies:
            for mesh in body.meshes:
                # inertia="shell" accepts open meshes; masses come from <inertial>, not from meshes.
                ET.SubElement(asset, "mesh", name=mesh.name, file=mesh_file(mesh), scale=SCALE, inertia="shell")
        equality = ET.Element("equality")
        for joint in self.spanning.cut:
            self._close_loop(equality, joint)
        self.fixed_to_base = self._bodies_fixed_to_base()
        top = ET.SubElement(root, "worldbody")
        self._body(top, mechanism.base, None)
        for joint in self.spanning.tree:
            if self._is_freejoint(joint):
                self._body(top, joint.child, joint)
        # The order of the sections: tendons of couplings come before those of motors.
        self._couplings(equality)
        self._motors()
        root.append(equality)
        self._actuators()

    def _body(self, parent: ET.Element, name: str, joint: Joint | None) -> None:
        """Write a body and all bodies below it into `parent`; `joint` connects it to its parent, None at the base."""
        T = np.eye(4)
        if joint is not None:
            T = self._body_pose(joint.parent, joint.child)
            if self._is_freejoint(joint):
                T = self._body_pose(self.mechanism.base, joint.child)
        # MuJoCo's own fixed body has the name "world"; a base of that name is written as this body.
        is_world = joint is None and name == WORLD
        element = parent
        if not is_world:
            element = ET.SubElement(parent, "body", {"name": name, **_pos_and_quat(T)})
        body = self.mechanism.body(name)
        if joint is not None:
            self._joint(element, joint)
        if not is_world and (joint is not None or body.inertia is not None):
            _inertial(element, inertia_of(body))
        for mesh in body.meshes:
            # Adjacent links overlap at joints: links collide with the world (contype 1), not with each other.
            # MuJoCo makes a convex hull of each mesh that collides, and rejects a flat one.
            shape = {
                "type": "mesh",
                "mesh": mesh.name,
                "material": self.mechanism.materials[mesh.name].name,
                "mass": "0",
                "contype": "0",
                "conaffinity": "0" if flat(mesh.vertices) else "1",
            }
            ET.SubElement(element, "geom", shape)
        for site, T_body_site in self._sites(name):
            ET.SubElement(element, "site", {"name": site, "size": SITE_SIZE, **_pos_and_quat(T_body_site)})
        for child in self.spanning.tree:
            if child.parent == name and not self._is_freejoint(child):
                self._body(element, child.child, child)
        for slide in self.carriers.get(name, []):
            T = slide.T_parent_joint @ self._joint_pose(slide)
            carrier = ET.SubElement(element, "body", {"name": f"{slide.name}_carrier", **_pos_and_quat(T)})
            carrier.set("gravcomp", "1")  # no part of the robot: no drive has to hold its weight
            self._axis_joints(carrier, slide, np.eye(4))
            _inertial(carrier, CARRIER_INERTIA)
            ET.SubElement(carrier, "site", name=f"{slide.name}_0_parent", size=SITE_SIZE)

    def _sites(self, body: str) -> list[tuple[str, Array]]:
        """Return (name, T_body_site) of the sites of a body: its frames, its points, and ends of welds."""
        sites: list[tuple[str, Array]] = []
        for frame in self.mechanism.frames:
            if frame.body == body:
                sites.append((f"frame_{frame.name}", frame.T_body_frame))
        for point in self.mechanism.points:
            if point.body == body:
                sites.append((f"point_{point.name}", spatial.pose(p=point.p_body)))
        return sites + self.weld_sites.get(body, [])

    def _bodies_fixed_to_base(self) -> set[str]:
        """Return the bodies that only fixed joints of the tree connect with the base."""
        bodies = {self.mechanism.base}
        for joint in self.spanning.tree:  # outwards
            if joint.type == "fixed" and joint.parent in bodies:
                bodies.add(joint.child)
        return bodies

    def _is_freejoint(self, joint: Joint) -> bool:
        """Return whether a joint is written as a freejoint: MuJoCo has free bodies only in the world."""
        return joint.type == "free" and joint.parent in self.fixed_to_base

    def _joint(self, element: ET.Element, joint: Joint) -> None:
        if self._is_freejoint(joint):
            ET.SubElement(element, "freejoint", name=joint.name)
            T = self._body_pose(self.mechanism.base, joint.child)
            self.qpos += [*T[:3, 3].tolist(), *spatial.quat_from_matrix_wxyz(T[:3, :3]).tolist()]
            return
        if joint.type == "free":
            pos = numbers(joint.T_child_joint[:3, 3])
            for name, axis in zip("xyz", joint.T_child_joint[:3, :3].T, strict=True):
                attributes = {"name": f"{joint.name}_{name}", "type": "slide", "pos": pos, "axis": numbers(axis)}
                ET.SubElement(element, "joint", attributes)
                self.qpos.append(0.0)
        elif joint.type != "spherical":
            self._axis_joints(element, joint, joint.T_child_joint)
            return
        ET.SubElement(element, "joint", name=joint.name, type="ball", pos=numbers(joint.T_child_joint[:3, 3]))
        self.qpos += [1.0, 0.0, 0.0, 0.0]

    def _axis_joints(self, element: ET.Element, joint: Joint, T_body_joint: Array) -> None:
        """Write a joint as a slide, a hinge, or both. The axis is z of the joint's frame on the moving body."""
        T = self._joint_pose(joint)
        # The solved coordinate may be beyond half a turn, where the angle of the pose is another one.
        angle = self.home.q_full.get(joint.name, float(np.arctan2(T[1, 0], T[0, 0])))
        # 2 and 5 are the translation along z and the rotation about z.
        for kind, axis, value in (("slide", 2, T[2, 3]), ("hinge", 5, angle)):
            if axis not in joint.free_axes:
                continue
            name = joint.name
            if joint.type == "cylindrical" and kind == "slide":
                name = f"{joint.name}_slide"
            pos = numbers(T_body_joint[:3, 3])
            attributes = {"name": name, "type": kind, "pos": pos, "axis": numbers(T_body_joint[:3, 2])}
            joint_element = ET.SubElement(element, "joint", attributes)
            if value:
                joint_element.set("ref", numbers([value]))
            # Limits are of a single coordinate: of a slide with a hinge, they do not say of which.
            if joint.limits is not None and len(joint.free_axes) == 1:
                joint_element.set("range", numbers(joint.limits))
            self.qpos.append(float(value))

    def _body_pose(self, parent: str, child: str) -> Array:
        """Return T_parent_child (4, 4) of two bodies at home."""
        return spatial.inverse(self.home.link_poses[parent]) @ self.home.link_poses[child]

    def _joint_pose(self, joint: Joint) -> Array:
        """Return the pose (4, 4) of the joint's child frame in its parent frame, at home."""
        return joint.relative(self.home.link_poses[joint.parent], self.home.link_poses[joint.child])

    def _close_loop(self, equality: ET.Element, joint: Joint) -> None:
        """Add the equality constraint of a loop closure, and store the sites and carriers that it needs."""
        if joint.type in ("spherical", "revolute"):
            # One common point leaves a ball; two on the axis leave a hinge.
            distances = (-CONNECT_DISTANCE / 2, CONNECT_DISTANCE / 2) if joint.type == "revolute" else (0.0,)
            for index, distance in enumerate(distances):
                anchor = numbers(joint.T_parent_joint[:3, 3] + distance * joint.T_parent_joint[:3, 2])
                bodies = {"body1": joint.parent, "body2": joint.child, "anchor": anchor}
                ET.SubElement(equality, "connect", {"name": f"{joint.name}_{index}", **bodies, **CONSTRAINT_SOLVER})
            return
        ends = {"site1": f"{joint.name}_0_parent", "site2": f"{joint.name}_0_child"}
        self.weld_sites.setdefault(joint.child, []).append((ends["site2"], joint.T_child_joint))
        if 2 in joint.free_axes:
            self.carriers.setdefault(joint.parent, []).append(joint)
        else:
            self.weld_sites.setdefault(joint.parent, []).append((ends["site1"], joint.T_parent_joint))
        ET.SubElement(equality, "weld", {"name": f"{joint.name}_0", **ends, **CONSTRAINT_SOLVER})

    def _couplings(self, equality: ET.Element) -> None:
        if not self.mechanism.couplings:
            return
        tendons = ET.SubElement(self.root, "tendon")
        for coupling in self.mechanism.couplings:
            tendon = ET.SubElement(tendons, "fixed", name=coupling.name)
            for name, ratio in zip(coupling.joints, coupling.ratios, strict=True):
                ET.SubElement(tendon, "joint", joint=name, coef=numbers([ratio]))
            # MuJoCo measures the length relative to the joints' `ref`, where the coupling is satisfied.
            attributes = {"name": coupling.name, "tendon1": coupling.name, "polycoef": "0 0 0 0 0"}
            ET.SubElement(equality, "tendon", {**attributes, **CONSTRAINT_SOLVER})

    def _motors(self) -> None:
        """Write a tendon for each motor, and a <tuple> for each transmission with its joints and motors."""
        mechanism = self.mechanism
        if not mechanism.transmissions:
            return
        self.root.append(ET.Comment(f" {MOTORS_COMMENT} "))
        tendons = self.root.find("tendon")  # there is one if the robot has couplings
        if tendons is None:
            tendons = ET.SubElement(self.root, "tendon")
        custom = ET.SubElement(self.root, "custom")
        for transmission in mechanism.transmissions:
            tuple_element = ET.Element("tuple", name=transmission.name)
            for kind, names in (("joint", transmission.joints), ("actuator", transmission.actuators)):
                for name in names:
                    ET.SubElement(tuple_element, "element", objtype=kind, objname=name)
            custom.append(tuple_element)
            for motor, row in zip(map(mechanism.actuator, transmission.actuators), transmission.inverse, strict=True):
                ET.SubElement(custom, "text", name=motor.name, data=motor.kind)
                tendon = ET.SubElement(tendons, "fixed", name=motor.name)
                if motor.limits is not None:
                    tendon.set("range", numbers(motor.limits))
                if motor.rotor_inertia is not None:
                    tendon.set("armature", f"{motor.rotor_inertia:.12g}")
                for joint, coefficient in zip(transmission.joints, row, strict=True):
                    if coefficient:
                        ET.SubElement(tendon, "joint", joint=joint, coef=f"{coefficient:.12g}")

    def _actuators(self) -> None:
        """Write an actuator for each motor; it drives a joint directly or, with a transmission, pulls a tendon."""
        self.root.append(ET.Comment(f" {CONTROLS_COMMENT} "))
        actuators = ET.SubElement(self.root, "actuator")
        control = []
        mechanism = self.mechanism
        q_home = np.array([self.home.q_full[joint.name] for joint in mechanism.active])
        joint_efforts = np.array([self.efforts[joint.name] for joint in mechanism.active])
        motor_homes = mechanism.motors(q_home).tolist()
        efforts = mechanism.motor_efforts(joint_efforts).tolist()
        for joint, name, home, effort in zip(
            mechanism.active, mechanism.motor_names, motor_homes, efforts, strict=True
        ):
            if name == joint.name:  # without a transmission, the drive of the joint is its motor
                servo = joint.drive
                limits = joint.limits
                attributes = {"name": name, "joint": name}
                if servo is not None and not servo.stiffness:
                    servo = None
            else:
                servo = mechanism.actuator(name)
                limits = servo.limits
                attributes = {"name": name, "tendon": name}
            if servo is None or servo.stiffness is None:
                element = ET.SubElement(actuators, "motor", attributes)
                control.append(effort)
            else:
                # Position servo of MuJoCo; force = kp (ctrl + home - q) - kv dq/dt + effort at home.
                kp = servo.stiffness
                bias = f"{numbers([kp * home + effort])} {gains([-kp, -servo.damping])}"
                law = {"gainprm": gains([kp]), "biastype": "affine", "biasprm": bias}
                element = ET.SubElement(actuators, "general", {**attributes, **law})
                if limits is not None:
                    low, high = limits
                    element.set("ctrlrange", numbers([low - home, high - home]))
                control.append(0.0)
            if servo is not None and servo.max_effort is not None:
                element.set("forcerange", gains([-servo.max_effort, servo.max_effort]))
        keyframe = ET.SubElement(self.root, "keyframe")
        ET.SubElement(keyframe, "key", name="home", qpos=numbers(self.qpos), ctrl=numbers(control))


def _pos_and_quat(T: Array) -> dict[str, str]:
    return {"pos": numbers(T[:3, 3]), "quat": numbers(spatial.quat_from_matrix_wxyz(T[:3, :3]))}


def _inertial(element: ET.Element, inertia: Inertia) -> None:
    I = inertia.I_com  # noqa: E741 - the symbol of the field
    # Twelve significant digits, not decimals, because real products of inertia can be a few 1e-9 kg m2.
    components = (I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2])
    fullinertia = " ".join(map("{:.12g}".format, components))
    mass = f"{inertia.mass:.12g}"
    ET.SubElement(element, "inertial", pos=numbers(inertia.p_body_com), mass=mass, fullinertia=fullinertia)


def write(order: Order, folder: Path) -> list[Finding]:
    """Write a robot, and a file for each motion with other trocars, into `folder`; return what is left out."""
    write_mjcf(order.mechanism, folder)
    for scene in order.elsewhere:
        write_mjcf(scene.mechanism, folder, f"{order.mechanism.name}_{scene.clip.name}")
    return mjcf_findings(order.mechanism)


def files(order: Order) -> list[tuple[str, str]]:
    """Return (file, content) for README.txt."""
    name = order.mechanism.name
    rows = [(f"{name}.xml", "MJCF, loops closed by constraints; shapes in meshes/ (mm)")]
    for scene in order.elsewhere:
        rows.append((f"{name}_{scene.clip.name}.xml", f"the same with the trocars of {scene.clip.name}"))
    return rows
