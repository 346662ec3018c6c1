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
from twin.exchange.write.left_out import left_out, motors_left_out
from twin.exchange.write.masses import inertia_of, partly_shown, unweighed
from twin.exchange.write.meshes import SCALE, mesh_file, write_meshes
from twin.exchange.write.order import Order
from twin.exchange.write.xml import gains, numbers, srgb, write_xml, xml_text
from twin.model.hull import flat
from twin.model.inertia import Inertia
from twin.model.joint import Joint
from twin.model.mechanism import EARTH, WORLD, Mechanism
from twin.usd.write.spanning import spanning

PIN = 0.05
"""Distance in m along the pin between the two <connect> points of a revolute joint."""

CARRIER = Inertia(1e-3, np.zeros(3), 1e-7 * np.eye(3))
"""Inertia of the auxiliary body (carrier) of a loop closure with a slide."""

STIFF = {"solref": "0.001 1", "solimp": "0.9999 0.9999 0.001 0.5 2"}
"""Solver parameters of the equality constraints. With the softer defaults of MuJoCo, loops open under load."""

OPTION = {"timestep": "0.001", "integrator": "discrete", "iterations": "100", "tolerance": "1e-12"}
"""Simulation options; the integrator "discrete" solves drives and equality constraints together.

Other implicit integrators correct accelerations after the constraints are solved: at a time step of 1 ms the loops of
SHER oscillate by 14 mm (measured). With an explicit integrator LAPBOT is unstable.
"""

STEPPING = (
    "The constraints that close loops act as springs. At this time step, with this integrator (MuJoCo 3.13 or newer), "
    "the loops of the robots that come with twin stay closed within 1 um: 10 s at rest under gravity, and along their "
    "protocols. With an older MuJoCo use implicitfast and 0.0001 s."
)

CONTROLS = (
    "A control is the displacement of its joint from home, in m or rad: ctrl = coordinate - ref. Zero holds the robot "
    "at home, where its weight is compensated. A motor has no gains: its control is its force."
)


MOTORS = (
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
    return write_xml(_Writer(mechanism).root, folder / f"{name or mechanism.name}.xml")


def mjcf_text(mechanism: Mechanism) -> str:
    """Return the MJCF of a mechanism as text. Meshes are in separate files (see `write_meshes`).

    Raises:
        AssemblyError: the loops of the mechanism cannot be closed.
    """
    return xml_text(_Writer(mechanism).root)


def mjcf_findings(mechanism: Mechanism) -> list[Finding]:
    """Return findings on differences between the MJCF and the mechanism; the MJCF contains the same findings."""
    file = f"{mechanism.name}.xml"
    found = [*unweighed(mechanism, file), *partly_shown(mechanism, file)]
    found += motors_left_out(mechanism, file, "max_speed")
    # MJCF can limit the rotation angle of a ball joint, but not the cone of its axis.
    fields = ("soft_limits", "max_speed", "max_acceleration", "max_jerk", "cone")
    return [*found, *left_out(mechanism, file, *fields)]


class _Writer:
    """Builder of the MJCF document: writes the tree of bodies, and collects the elements of all other sections."""

    def __init__(self, mechanism: Mechanism) -> None:
        from twin.reference import ReferenceModel
        from twin.reference.holding_efforts import holding_efforts

        self.mechanism = mechanism
        self.spanning = spanning(mechanism)
        model = ReferenceModel(mechanism)
        self.home = model.home()
        self.efforts = holding_efforts(model, self.home)
        self.sites: dict[str, list[tuple[str, Array]]] = {}
        self.carriers: dict[str, list[Joint]] = {}
        self.qpos: list[float] = []
        self.root = root = ET.Element("mujoco", model=mechanism.name)
        for finding in mjcf_findings(mechanism):
            root.append(ET.Comment(f" {finding.message} "))
        ET.SubElement(root, "compiler", angle="radian", autolimits="true")
        root.append(ET.Comment(f" {STEPPING} "))
        option = ET.SubElement(root, "option", OPTION)
        if mechanism.gravity != EARTH:
            option.set("gravity", numbers(mechanism.gravity))
        asset = ET.SubElement(root, "asset")
        for look in dict.fromkeys(mechanism.materials.values()):
            finish = {"metallic": numbers([look.finish.metallic]), "roughness": numbers([look.finish.roughness])}
            ET.SubElement(asset, "material", {"name": look.name, "rgba": srgb(look.color_rgba), **finish})
        for body in mechanism.bodies:
            for mesh in body.meshes:
                # inertia="shell" accepts open meshes; masses come from <inertial>, not from meshes.
                ET.SubElement(asset, "mesh", name=mesh.name, file=mesh_file(mesh), scale=SCALE, inertia="shell")
        equality = ET.Element("equality")
        for joint in self.spanning.cut:
            self._tie(equality, joint)
        self.still = self._still()
        top = ET.SubElement(root, "worldbody")
        self._body(top, mechanism.base, None)
        for joint in self.spanning.tree:
            if self._floats(joint):
                self._body(top, joint.child, joint)
        self._couplings(equality)
        self._motors()
        root.append(equality)
        self._actuators()

    def _body(self, parent: ET.Element, name: str, joint: Joint | None) -> None:
        T = np.eye(4) if joint is None else self._relative(joint.parent, joint.child)
        if joint is not None and self._floats(joint):
            T = self._relative(self.mechanism.base, joint.child)
        # MuJoCo's own fixed body has the name "world"; a base of that name is written as this body.
        world = joint is None and name == WORLD
        element = parent if world else ET.SubElement(parent, "body", {"name": name, **_place(T)})
        body = self.mechanism.body(name)
        if joint is not None:
            self._joint(element, joint)
        if not world and (joint is not None or body.inertia is not None):
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
        marks = [(f"frame_{f.name}", f.T_body_frame) for f in self.mechanism.frames if f.body == name]
        marks += [(f"point_{p.name}", spatial.pose(p=p.p_body)) for p in self.mechanism.points if p.body == name]
        for site, at in [*marks, *self.sites.get(name, [])]:
            ET.SubElement(element, "site", {"name": site, "size": "0.002", **_place(at)})
        for child in self.spanning.tree:
            if child.parent == name and not self._floats(child):
                self._body(element, child.child, child)
        for slide in self.carriers.get(name, []):
            T = slide.T_parent_joint @ self._motion(slide)
            carrier = ET.SubElement(element, "body", {"name": f"{slide.name}_carrier", **_place(T)})
            carrier.set("gravcomp", "1")  # no part of the robot: no drive has to hold its weight
            self._moves(carrier, slide, np.eye(4))
            _inertial(carrier, CARRIER)
            ET.SubElement(carrier, "site", name=f"{slide.name}_0_parent", size="0.002")

    def _still(self) -> set[str]:
        """Return the bodies that only fixed joints of the tree connect with the base."""
        out = {self.mechanism.base}
        for joint in self.spanning.tree:  # outwards
            if joint.type == "fixed" and joint.parent in out:
                out.add(joint.child)
        return out

    def _floats(self, joint: Joint) -> bool:
        """Return whether a joint is written as a freejoint: MuJoCo has free bodies only in the world."""
        return joint.type == "free" and joint.parent in self.still

    def _joint(self, element: ET.Element, joint: Joint) -> None:
        if self._floats(joint):
            ET.SubElement(element, "freejoint", name=joint.name)
            T = self._relative(self.mechanism.base, joint.child)
            self.qpos += [*T[:3, 3].tolist(), *spatial.quat_from_matrix_wxyz(T[:3, :3]).tolist()]
            return
        if joint.type == "free":
            at = joint.T_child_joint
            for name, axis in zip("xyz", at[:3, :3].T, strict=True):
                line = {"pos": numbers(at[:3, 3]), "axis": numbers(axis)}
                ET.SubElement(element, "joint", {"name": f"{joint.name}_{name}", "type": "slide", **line})
                self.qpos.append(0.0)
        elif joint.type != "spherical":
            self._moves(element, joint, joint.T_child_joint)
            return
        ET.SubElement(element, "joint", name=joint.name, type="ball", pos=numbers(joint.T_child_joint[:3, 3]))
        self.qpos += [1.0, 0.0, 0.0, 0.0]

    def _moves(self, element: ET.Element, joint: Joint, T_body_joint: Array) -> None:
        """Write a joint as a slide, a hinge, or both. The axis is z of the joint's frame on the moving body."""
        T = self._motion(joint)
        for kind, axis, value in (
            ("slide", 2, T[2, 3]),
            ("hinge", 5, self.home.q_full.get(joint.name, float(np.arctan2(T[1, 0], T[0, 0])))),
        ):
            if axis not in joint.free_axes:
                continue
            name = f"{joint.name}_slide" if joint.type == "cylindrical" and kind == "slide" else joint.name
            line = {"pos": numbers(T_body_joint[:3, 3]), "axis": numbers(T_body_joint[:3, 2])}
            out = ET.SubElement(element, "joint", {"name": name, "type": kind, **line})
            if value:
                out.set("ref", numbers([value]))
            if joint.limits is not None:
                out.set("range", numbers(joint.limits))
            self.qpos.append(float(value))

    def _relative(self, parent: str, child: str) -> Array:
        """Return T_parent_child (4, 4) of two bodies at home."""
        return spatial.inverse(self.home.link_poses[parent]) @ self.home.link_poses[child]

    def _motion(self, joint: Joint) -> Array:
        """Return the pose (4, 4) of the joint's child frame in its parent frame, at home."""
        return joint.relative(self.home.link_poses[joint.parent], self.home.link_poses[joint.child])

    def _tie(self, equality: ET.Element, joint: Joint) -> None:
        """Add the equality constraint of a loop closure, and store the sites and carriers that it needs."""
        for n, along in enumerate({"spherical": (0.0,), "revolute": (-PIN / 2, PIN / 2)}.get(joint.type, ())):
            anchor = numbers(joint.T_parent_joint[:3, 3] + along * joint.T_parent_joint[:3, 2])
            tied = {"body1": joint.parent, "body2": joint.child, "anchor": anchor}
            ET.SubElement(equality, "connect", {"name": f"{joint.name}_{n}", **tied, **STIFF})
        if joint.type in ("spherical", "revolute"):
            return
        ends = {"site1": f"{joint.name}_0_parent", "site2": f"{joint.name}_0_child"}
        self.sites.setdefault(joint.child, []).append((ends["site2"], joint.T_child_joint))
        if 2 in joint.free_axes:
            self.carriers.setdefault(joint.parent, []).append(joint)
        else:
            self.sites.setdefault(joint.parent, []).append((ends["site1"], joint.T_parent_joint))
        ET.SubElement(equality, "weld", {"name": f"{joint.name}_0", **ends, **STIFF})

    def _couplings(self, equality: ET.Element) -> None:
        if not self.mechanism.couplings:
            return
        tendons = ET.SubElement(self.root, "tendon")
        for coupling in self.mechanism.couplings:
            tendon = ET.SubElement(tendons, "fixed", name=coupling.name)
            for name, ratio in zip(coupling.joints, coupling.ratios, strict=True):
                ET.SubElement(tendon, "joint", joint=name, coef=numbers([ratio]))
            # MuJoCo measures the length relative to the joints' `ref`, where the coupling is satisfied.
            line = {"name": coupling.name, "tendon1": coupling.name, "polycoef": "0 0 0 0 0"}
            ET.SubElement(equality, "tendon", {**line, **STIFF})

    def _motors(self) -> None:
        """Write a tendon for each motor, and a <tuple> for each transmission with its joints and motors."""
        m = self.mechanism
        if not m.transmissions:
            return
        self.root.append(ET.Comment(f" {MOTORS} "))
        tendons = self.root.find("tendon")
        tendons = ET.SubElement(self.root, "tendon") if tendons is None else tendons
        custom = ET.SubElement(self.root, "custom")
        for t in m.transmissions:
            group = ET.Element("tuple", name=t.name)
            for kind, names in (("joint", t.joints), ("actuator", t.actuators)):
                for name in names:
                    ET.SubElement(group, "element", objtype=kind, objname=name)
            custom.append(group)
            for motor, row in zip(map(m.actuator, t.actuators), t.inverse, strict=True):
                ET.SubElement(custom, "text", name=motor.name, data=motor.kind)
                tendon = ET.SubElement(tendons, "fixed", name=motor.name)
                if motor.limits is not None:
                    tendon.set("range", numbers(motor.limits))
                if motor.rotor_inertia is not None:
                    tendon.set("armature", f"{motor.rotor_inertia:.12g}")
                for joint, coefficient in zip(t.joints, row, strict=True):
                    if coefficient:
                        ET.SubElement(tendon, "joint", joint=joint, coef=f"{coefficient:.12g}")

    def _actuators(self) -> None:
        """Write an actuator for each motor; it drives a joint directly or, with a transmission, pulls a tendon."""
        self.root.append(ET.Comment(f" {CONTROLS} "))
        actuator = ET.SubElement(self.root, "actuator")
        control = []
        m = self.mechanism
        q_home = np.array([self.home.q_full[joint.name] for joint in m.active])
        joint_efforts = np.array([self.efforts[joint.name] for joint in m.active])
        homes = m.motors(q_home).tolist()
        efforts = m.motor_efforts(joint_efforts).tolist()
        for joint, name, home, effort in zip(m.active, m.motor_names, homes, efforts, strict=True):
            direct = name == joint.name
            servo, limits = (joint.drive, joint.limits) if direct else (m.actuator(name), m.actuator(name).limits)
            if direct and servo is not None and not servo.stiffness:
                servo = None
            line = {"name": name, "joint" if direct else "tendon": name}
            if servo is None or servo.stiffness is None:
                out = ET.SubElement(actuator, "motor", line)
                control.append(effort)
            else:
                # Position servo of MuJoCo; force = kp (ctrl + home - q) - kv dq/dt + effort at home.
                kp, kv = servo.stiffness, servo.damping
                bias = f"{numbers([kp * home + effort])} {gains([-kp, -kv])}"
                law = {"gainprm": gains([kp]), "biastype": "affine", "biasprm": bias}
                out = ET.SubElement(actuator, "general", {**line, **law})
                if limits is not None:
                    out.set("ctrlrange", numbers([end - home for end in limits]))
                control.append(0.0)
            if servo is not None and servo.max_effort is not None:
                out.set("forcerange", gains([-servo.max_effort, servo.max_effort]))
        keyframe = ET.SubElement(self.root, "keyframe")
        ET.SubElement(keyframe, "key", name="home", qpos=numbers(self.qpos), ctrl=numbers(control))


def _place(T: Array) -> dict[str, str]:
    return {"pos": numbers(T[:3, 3]), "quat": numbers(spatial.quat_from_matrix_wxyz(T[:3, :3]))}


def _inertial(element: ET.Element, inertia: Inertia) -> None:
    I = inertia.I_com  # noqa: E741 - the symbol of the field
    # Twelve significant digits, not decimals, because real products of inertia can be a few 1e-9 kg m2.
    six = (I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2])
    full = " ".join(f"{value:.12g}" for value in six)
    ET.SubElement(element, "inertial", pos=numbers(inertia.p_body_com), mass=f"{inertia.mass:.12g}", fullinertia=full)


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
