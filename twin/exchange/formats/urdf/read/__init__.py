"""Read a URDF, with its loops from a closure YAML.

Joint frames are the frames in the URDF, rotated so that z is the axis. A link becomes a named frame on its parent if it
is fixed to the parent and has no shape and no mass. A planar joint becomes two slides and a hinge. Data that a
mechanism cannot hold cause a warning (friction, efforts, textures).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from os.path import commonprefix
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from twin.core import spatial
from twin.core.errors import NoMechanismError, SourceError, unknown
from twin.core.identifiers import identifier
from twin.core.spatial import Array
from twin.exchange.formats.urdf.read.bounds import JointBounds, read_bounds
from twin.exchange.formats.urdf.read.closures import Closures, read_closures
from twin.exchange.formats.urdf.read.gears import MOVING, read_gears
from twin.exchange.formats.urdf.read.visuals import Visuals, origin
from twin.exchange.read.imported_robot import (
    Findings,
    Imported,
    Names,
    Options,
    assemble,
    pose_along,
    possible_inertia,
    unique_identifiers,
)
from twin.exchange.read.shapes import shows_all
from twin.exchange.read.start_values import rest_at_values
from twin.exchange.read.xml_file import Xml
from twin.exchange.xacro import SUFFIX, Expanded, XacroSettings, expand, is_xacro
from twin.model.body import Body, Frame
from twin.model.inertia import Inertia
from twin.model.joint import Joint, JointType
from twin.model.mechanism import WORLD, Coupling
from twin.model.transmission import Actuator, Transmission

TYPES: dict[str, JointType] = {
    "revolute": "revolute",
    "continuous": "revolute",
    "prismatic": "prismatic",
    "fixed": "fixed",
    "floating": "free",
}
"""Joint types of URDF that become one joint of a mechanism."""

_PLANAR = "planar"
"""Joint type of URDF that becomes three joints: slides along x and y of the plane, and a hinge about its normal z."""

_WITHOUT_EFFECT = ("calibration", "joint_properties")
"""Elements of a joint that have no effect on the mechanism."""

_READ_ELEMENTS = {
    "robot": {"link", "joint", "material", "transmission", "gazebo", "ros2_control"},
    "joint": {"origin", "parent", "child", "axis", "limit", "mimic", "dynamics", "safety_controller", *_WITHOUT_EFFECT},
    "link": {"visual", "collision", "inertial"},
}
"""Child elements that this module reads or knows to be without effect, by the tag of their parent."""

_MAX_MASSLESS = 1e-6
"""Maximum mass in kg of a link without shape that becomes a frame instead of a body."""


def read_urdf(path: Path, closures: Path | None = None, settings: XacroSettings | None = None) -> Imported:
    """Read a URDF and, unless `closures` is None, the closure YAML at the path `closures`.

    A xacro is expanded first, with `settings`.

    Raises:
        SourceError: the file is invalid or unsupported; the message names file, element and fault.
    """
    expanded: Expanded | None = None
    try:
        if is_xacro(path):
            expanded = expand(path, settings or XacroSettings())
    except OSError as error:
        raise SourceError(f"{path}: cannot be read ({error.strerror or error})") from error
    if expanded is None and settings is not None and settings.arguments:
        raise SourceError(f"{path}: this is a URDF without expressions of xacro: omit --arg")
    content = None if closures is None else read_closures(closures)
    imported = _Urdf(path, content, closures, expanded).read()
    if expanded is not None:
        imported.places = dict(expanded.places)
    return imported


class _Urdf:
    """Reader of one URDF.

    Attributes:
        links, joints: elements of the file by name.
        retyped: {joint: new type} of the joints whose type the closure YAML replaces.
        efforts: {joint: maximum effort in N or N m}, filled as the joints are read.
        inserted_bodies: bodies without mass between the joints that replace one URDF joint.
        body_of_link: {link: (body that carries it, T_body_link)}; a link that is a body carries itself.
        joint_links: {joint: (parent link, child link)}.
        parent_joints: {link: the joint of which it is the child}.
        frame_links: {link: the fixed joint to its parent} of the links that become named frames.
    """

    def __init__(
        self, path: Path, closures: Closures | None, closure_file: Path | None, expanded: Expanded | None
    ) -> None:
        self.xml = Xml(path, "robot", None if expanded is None else expanded.data)
        self.path = path
        self.closures = closures
        self.closure_file = closure_file
        self.findings = Findings()
        if expanded is not None:
            for text in expanded.omitted:
                self.findings.warn("xacro", text, path.name)
        self.efforts: dict[str, float] = {}
        self.inserted_bodies: list[Body] = []
        self.body_of_link: dict[str, tuple[str, Array]] = {}
        self.joint_links: dict[str, tuple[str, str]] = {}
        self.parent_joints: dict[str, str] = {}

    def read(self) -> Imported:
        root = self.xml.root
        findings = self.findings
        self._report_unread(root, "robot", "robot")
        self.links = self._named_elements("link")
        self.joints = self._named_elements("joint")
        for name, joint in self.joints.items():
            self.joint_links[name] = self._read_joint_links(name, joint)
        self.retyped = self._read_retyped()
        base = self._find_base()
        self.frame_links = self._find_frame_links(base)
        bodiless_links: dict[str, tuple[str, Array]] = {}
        for link, joint in self.frame_links.items():
            bodiless_links[link] = (
                self.joint_links[joint][0],
                origin(self.xml, self.joints[joint], f"joint '{joint}'"),
            )
        joint_frames = self._find_joint_frames()
        for link, joint in joint_frames.items():
            T_link_body = origin(self.xml, self.joints[joint], joint)
            bodiless_links[link] = (self.joint_links[joint][1], spatial.inverse(T_link_body))
        loop_closers = self._find_loop_closers(bodiless_links)
        for link, partner in loop_closers.items():
            bodiless_links[link] = (partner, np.eye(4))
        # Only the base can be the world: in an MJCF, a body of this name is the world itself.
        reserved = () if base == WORLD else (WORLD,)
        links_with_body = [link for link in self.links if link not in bodiless_links]
        body_names = Names("link", links_with_body, findings, reserved)
        parts: list[str] = []
        for name in self.joints:
            parts += self._part_names(name)
        names = Names("joint", parts, findings)
        self._place_links(body_names, bodiless_links)
        if self.closures is None:
            self._report_cut_loops([*self.joints, *self.links])
        self._drop_mimics_of_fixed()
        driven = self._driven_joints(root)
        joints = self._make_joints(names, {*self.frame_links.values(), *joint_frames.values()}, loop_closers, driven)
        bodies = self._bodies(body_names, bodiless_links)
        frames = self._frames()
        couplings: list[Coupling] = []
        for name, joint in self.joints.items():
            if joint.find("mimic") is not None:
                couplings.append(self._mimic_coupling(name, names))
        couplings += self._closure_couplings(names)
        joints += self._closure_joints(names, loop_closers)
        actuators, transmissions = self._motors_and_transmissions(driven, names)
        efforts: dict[str, float] = {}
        for name, effort in self.efforts.items():
            if self.joint_links[name][1] not in self.frame_links:
                efforts[names[name]] = effort
        for text in self.xml.repaired:
            findings.warn("xml", text, self.path.name)
        label = root.get("name") or self.path.stem
        imported = assemble(
            self.path, label, body_names[base], bodies, joints, frames, couplings, findings, efforts=efforts
        )
        mechanism = replace(imported.mechanism, actuators=actuators, transmissions=transmissions)
        # Only the type continuous states that a joint has no limits; a missing <limit> states nothing.
        unlimited = set()
        for name, joint in self.joints.items():
            if joint.get("type") == "continuous" and name in names:
                unlimited.add(names[name])
        imported = replace(imported, mechanism=mechanism, posed=False, unlimited=frozenset(unlimited))
        return self._at_home(imported, names)

    def _place_links(self, body_names: Names, bodiless_links: Mapping[str, tuple[str, Array]]) -> None:
        """Fill `body_of_link`. `bodiless_links` is {link: (the link that carries it, T_carrier_link)}."""
        for link in self.links:
            if link not in bodiless_links:
                self.body_of_link[link] = (body_names[link], np.eye(4))
        # A link without body may be on another one, so each pass places those whose carrier has been placed.
        for _ in bodiless_links:
            for link, (carrier, T_carrier_link) in bodiless_links.items():
                if carrier in self.body_of_link and link not in self.body_of_link:
                    body, T_body_carrier = self.body_of_link[carrier]
                    self.body_of_link[link] = (body, T_body_carrier @ T_carrier_link)

    def _make_joints(
        self, names: Names, dropped: Collection[str], loop_closers: Collection[str], driven: Collection[str]
    ) -> list[Joint]:
        """Return the joints of the mechanism: first those of the tree, then those that close loops."""
        tree: list[str] = []
        loops: list[str] = []
        for name in self.joints:
            if self.joint_links[name][1] in loop_closers:
                loops.append(name)
            elif name not in dropped:
                tree.append(name)
        joints: list[Joint] = []
        for name in (*tree, *loops):
            if name in self.retyped:
                joints += self._replacement_joints(name, names, driven)
            elif self.joints[name].get("type") == _PLANAR:
                joints += self._planar_joints(name, names)
            else:
                joints.append(self._joint(name, names[name], name in driven))
        return joints

    def _bodies(self, body_names: Names, bodiless_links: Collection[str]) -> list[Body]:
        visuals = Visuals(self.xml, self.findings)
        bodies: list[Body] = []
        for name, link in self.links.items():
            if name not in bodiless_links:
                meshes = visuals.meshes(name, link)
                inertia = self._inertia(name, link)
                bodies.append(Body(body_names[name], tuple(meshes), inertia, shows_all(link, len(meshes))))
        return bodies + self.inserted_bodies

    def _frames(self) -> list[Frame]:
        paired = self._loop_links()
        marked = [
            link for link in self.frame_links if link not in paired
        ]  # the ends of loops are no frames of the robot
        names = Names("frame", marked, self.findings)
        frames = []
        for link in marked:
            body, T_body_link = self.body_of_link[link]
            frames.append(Frame(names[link], body, T_body_link))
        return frames

    def _at_home(self, imported: Imported, names: Names) -> Imported:
        """Return the import at the posture `home` of the closure YAML, if there is one."""
        home = self.closures.home if self.closures else {}
        if not home:
            return imported
        values: dict[str, float] = {}
        for name, value in home.items():
            if name not in names:
                raise SourceError(f"{self.closure_file}: home: {unknown('joint', name, names.known())}")
            values[names[name]] = value
        mechanism = replace(imported.mechanism, rest=rest_at_values(imported.mechanism, values))
        return replace(imported, mechanism=mechanism, keys={"home": values}, posed=True)

    # -- structure ------------------------------------------------------------------------------------

    def _named_elements(self, kind: str) -> dict[str, Element]:
        elements = self.xml.named(self.xml.root, kind)
        for name, element in elements.items():
            self._report_unread(element, kind, f"{kind} '{name}'")
        if not elements:
            text = f"{self.path}: the file has no <{kind}>, so there is no mechanism"
            if kind == "link" and self.xml.root.find("joint") is not None:
                raise SourceError(text)
            raise NoMechanismError(text)
        return elements

    def _report_unread(self, element: Element, kind: str, where: str) -> None:
        """Report the unsupported child elements of an element, each tag once."""
        tags = dict.fromkeys(str(child.tag) for child in element)
        for tag in tags:
            if tag not in _READ_ELEMENTS[kind]:
                self.findings.warn("unread", f"{where}: <{tag}> is not read.", where)
            elif tag in _WITHOUT_EFFECT:
                self.findings.note("unread", f"{where}: <{tag}> is not imported.", where)
            elif tag == "gazebo":
                self.findings.warn("unread", f"{where}: <gazebo> is not imported: plug-ins are not supported.", where)
        dynamics = element.find("dynamics")
        if kind != "joint" or dynamics is None:
            return
        for key in ("damping", "friction"):
            text = dynamics.get(key)
            if self.xml.number(where, key, text, 0.0):
                self.findings.warn("friction", f"{where}: {key} {text} is not imported.", where)

    def _read_joint_links(self, name: str, joint: Element) -> tuple[str, str]:
        ends = []
        for end in ("parent", "child"):
            element = joint.find(end)
            link = None if element is None else element.get("link")
            if link is None:
                self.xml.fail(f"joint '{name}'", f"the joint has no <{end} link>")
            if link not in self.links:
                self.xml.fail(f"joint '{name}', {end}", unknown("link", link, self.links))
            ends.append(link)
        parent, child = ends
        return parent, child

    def _find_base(self) -> str:
        """Return the root link, and set `above`: {link: the joint of which it is the child}."""
        for joint, (_, child) in self.joint_links.items():
            if child in self.parent_joints:
                text = (
                    f"the link is the child of two joints, '{self.parent_joints[child]}' and '{joint}', but a URDF is "
                    "a tree. Remove one of the joints, and close the loop in a YAML file given with --closures"
                )
                self.xml.fail(f"link '{child}'", text)
            self.parent_joints[child] = joint
        roots = [link for link in self.links if link not in self.parent_joints]
        if len(roots) != 1:
            names_of_roots = ", ".join(roots) or "none: the joints form a cycle"
            raise SourceError(f"{self.path}: expected one root link, found {names_of_roots}")
        return roots[0]

    def _find_frame_links(self, base: str) -> dict[str, str]:
        """Return {link: the fixed joint to its parent} for the links that become named frames."""
        marks = {}
        for joint, (_, child) in self.joint_links.items():
            fixed = self.joints[joint].get("type") == "fixed" or self.retyped.get(joint) == "FIXED"
            if fixed and child != base and not self._has_body(child):
                marks[child] = joint
                text = f"link '{child}' has no shape and no mass: it becomes a frame on its parent."
                self.findings.note("mark", text, child)
        return marks

    def _find_joint_frames(self) -> dict[str, str]:
        """Return {link: fixed joint} for links without body between a moving joint and the body fixed to them.

        Such a link is only the frame of the joint on this body.
        """
        joint_frames: dict[str, str] = {}
        for name in self.links:
            inner = self.parent_joints.get(name)
            if inner is None or inner in self.retyped or self._has_body(name):
                continue
            child_joints: list[str] = []
            for joint, (parent, _) in self.joint_links.items():
                if parent == name:
                    child_joints.append(joint)
            if len(child_joints) != 1:
                continue
            outer = child_joints[0]
            child = self.joint_links[outer][1]
            kind = self.retyped.get(outer, str(self.joints[outer].get("type")))
            moving = self.joints[inner].get("type") != "fixed"
            if moving and kind.lower() == "fixed" and self._has_body(child):
                joint_frames[name] = outer
                text = f"link '{name}' has no shape and no mass: it becomes one body with '{child}', fixed to it."
                self.findings.note("mark", text, name)
        return joint_frames

    def _find_loop_closers(self, bodiless_links: Collection[str]) -> dict[str, str]:
        """Return {link: the link welded to it by a loop} for links without body at the end of a moving joint.

        The moving joint then closes the loop.
        """
        loop_closers: dict[str, str] = {}
        if self.closures is None:
            return loop_closers
        parents = {parent for parent, _ in self.joint_links.values()}
        loop_links = self._loop_links()
        for first_name, second_name, kind in self.closures.loops:
            if kind != "fixed":
                continue
            first_link = self._link(first_name)
            second_link = self._link(second_name)
            for name, partner in ((first_link, second_link), (second_link, first_link)):
                if name not in self.parent_joints or partner not in self.links or partner in loop_closers:
                    continue
                joint = self.parent_joints[name]
                moving = joint not in self.retyped and self.joints[joint].get("type") in MOVING
                leaf = name not in parents and name not in bodiless_links and loop_links.count(name) == 1
                if moving and leaf and not self._has_body(name):
                    loop_closers[name] = partner
                    break  # the other end stays where it is: one moving joint closes the loop
        return loop_closers

    def _loop_links(self) -> list[str]:
        """Return the links that the closure YAML joins, two for each loop."""
        links: list[str] = []
        if self.closures is not None:
            for a, b, _ in self.closures.loops:
                links += [self._link(a), self._link(b)]
        return links

    def _link(self, name: str) -> str:
        """Return the link that a closure means: a link of this name, or the child of the joint of this name."""
        return self.joint_links[name][1] if name in self.joint_links else name

    def _has_body(self, name: str) -> bool:
        link = self.links[name]
        mass = link.find("inertial/mass")
        value = "0" if mass is None else mass.get("value")
        kilograms = self.xml.number(f"link '{name}'", "mass", value, 0.0)
        return kilograms > _MAX_MASSLESS or link.find("visual") is not None or link.find("collision") is not None

    def _report_cut_loops(self, names: list[str]) -> None:
        """If there is no closure YAML, report pairs of names that look like the two ends of a cut loop."""
        stems: list[str] = []
        for name in dict.fromkeys(names):
            stem = name[:-1]
            if name.endswith("A") and f"{stem}B" in names and "loop" in name.lower():
                stems.append(stem)
        if stems:
            first = stems[0]
            text = (
                f"{len(stems)} pairs such as '{first}A' and '{first}B' look like ends of cut loops, but there is no "
                "closure YAML, so the robot is read as a tree. Put the YAML file next to the URDF, or name the file "
                "with --closures."
            )
            self.findings.warn("closures", text, first)

    def _read_retyped(self) -> dict[str, str]:
        """Return {joint: new type} for the joints whose type the closure YAML replaces."""
        if self.closures is None:
            return {}
        leaders: set[str | None] = set()
        for joint in self.joints.values():
            mimic = joint.find("mimic")
            if mimic is not None:
                leaders.add(mimic.get("joint"))
        for name in self.closures.retyped:
            where = f"{self.closure_file}: joint_name"
            if name not in self.joints:
                raise SourceError(f"{where}: {unknown('joint', name, self.joints)}")
            # A mimic is of one coordinate, which a joint of another type may not have.
            if self.joints[name].find("mimic") is not None or name in leaders:
                raise SourceError(f"{where}: joint '{name}' mimics a joint or is mimicked: its type cannot be changed")
        return self.closures.retyped

    def _part_names(self, name: str) -> list[str]:
        """Return the names of the joints made from one URDF joint.

        A universal joint becomes two hinges, a planar joint two slides and a hinge, each other joint one joint.
        """
        kind = self.retyped.get(name, "")
        if kind.startswith("UJOINT"):
            return [f"{name}_{axis}" for axis in kind[-2:]]
        if not kind and self.joints[name].get("type") == _PLANAR:
            return [f"{name}_x", f"{name}_y", f"{name}_z"]
        return [name]

    def _driven_joints(self, root: Element) -> set[str]:
        """Return the driven joints: from the closure YAML, else from the transmissions, else all movable joints."""
        if self.closures is not None:
            self._check_motors(self.closures.motors)
            return set(self.closures.motors)
        stated = self._ros2_control_joints(root) or self._transmission_joints(root)
        if stated:
            return stated
        moving: set[str] = set()
        for name, joint in self.joints.items():
            if joint.get("type") in MOVING and joint.find("mimic") is None:
                moving.add(name)
        return moving

    def _check_motors(self, motors: Sequence[str]) -> None:
        """Raise `SourceError` if the closure YAML names a driven joint that does not exist or cannot be driven."""
        where = f"{self.closure_file}: name_mot"
        owners: dict[str, str] = {}
        for name in self.joints:
            for part in self._part_names(name):
                owners[part] = name
        for motor in motors:
            if motor not in owners:
                raise SourceError(f"{where}: {unknown('joint', motor, owners)}")
            name = owners[motor]
            kind = self.retyped.get(name, self.joints[name].get("type"))
            if kind not in MOVING and not str(kind).startswith("UJOINT"):
                raise SourceError(f"{where}: joint '{motor}' is {kind} and cannot be driven")

    def _drop_mimics_of_fixed(self) -> None:
        """Remove the <mimic> of each fixed joint, with a warning: tools that fix the joints of a hand often keep it."""
        for name, joint in self.joints.items():
            mimic = joint.find("mimic")
            if mimic is None or joint.get("type") != "fixed" or name in self.retyped:
                continue
            joint.remove(mimic)
            self.findings.warn("mimic", f"joint '{name}' is fixed, so its mimic has no effect.", name)

    def _transmission_joints(self, root: Element) -> set[str]:
        """Return the joints that transmissions move.

        Left out are joints that mimic another joint, which the other joint moves, and, with a warning, fixed joints and
        names of no joint: files of a part of a robot often keep the transmissions of the whole robot.
        """
        driven = set()
        for transmission in root.findall("transmission"):
            label = str(transmission.get("name"))
            for element in transmission.findall("joint"):
                name = str(element.get("name"))
                joint = self.joints.get(name)
                if joint is None:
                    text = f"transmission '{label}' moves nothing: {unknown('joint', name, self.joints)}"
                    self.findings.warn("gear", text, label)
                elif joint.get("type") == "fixed":
                    text = f"transmission '{label}': joint '{name}' is fixed, so the transmission moves nothing."
                    self.findings.warn("gear", text, label)
                elif joint.find("mimic") is not None:
                    text = f"joint '{name}' mimics another joint, so its transmission drives nothing."
                    self.findings.note("gear", text, name)
                else:
                    driven.add(name)
        return driven

    def _ros2_control_joints(self, root: Element) -> set[str]:
        """Return the joints that have a command interface in a <ros2_control>; all other joints are then passive."""
        driven = set()
        for system in root.findall("ros2_control"):
            for element in system.findall("joint"):
                name = str(element.get("name"))
                if element.find("command_interface") is None or element.find("mimic") is not None:
                    continue
                if name not in self.joints:
                    self.xml.fail("ros2_control", unknown("joint", name, self.joints))
                joint = self.joints[name]
                if joint.get("type") in MOVING and joint.find("mimic") is None:
                    driven.add(name)
        return driven

    def _motors_and_transmissions(
        self, driven: Collection[str], names: Names
    ) -> tuple[tuple[Actuator, ...], tuple[Transmission, ...]]:
        """Return (motors, transmissions) of the joints whose gear ratio is not 1; other joints are driven directly."""
        gears = read_gears(self.xml, self.joints, self.retyped, driven, self.findings)
        motor_names: list[tuple[str, str]] = []
        transmission_names: list[tuple[str, str]] = []
        for name, gear in gears.items():
            motor_names.append((name, gear.motor))
            transmission_names.append((name, gear.transmission))
        motors = unique_identifiers("motor", motor_names, set(names.values()), self.findings)
        labels = unique_identifiers("transmission", transmission_names, (), self.findings)
        transmissions: list[Transmission] = []
        for name, gear in gears.items():
            matrix = np.array([[1 / gear.ratio]])
            transmissions.append(Transmission(labels[name], (names[name],), (motors[name],), matrix))
        return tuple(map(Actuator, motors.values())), tuple(transmissions)

    # -- parts ----------------------------------------------------------------------------------------

    def _axis(self, where: str, joint: Element) -> Array:
        element = joint.find("axis")
        text = None if element is None else element.get("xyz")
        return self.xml.axis(where, "axis", text, (1, 0, 0))  # x is the default of URDF

    def _joint(self, name: str, label: str, active: bool) -> Joint:
        """Return the joint called `label` for a URDF joint with one coordinate, none, or six."""
        where = f"joint '{name}'"
        joint = self.joints[name]
        kind = joint.get("type")
        if kind not in TYPES:
            self.xml.fail(where, unknown("joint type", str(kind), (*TYPES, _PLANAR)))
        # URDF states an axis in the frame of the joint; a joint of a mechanism moves along its z.
        T_joint_axis = np.eye(4)
        bounds = JointBounds()
        if kind in MOVING:
            T_joint_axis = pose_along(self._axis(where, joint))
            bounds = read_bounds(self.xml, name, joint, self.findings)
            if bounds.max_effort is not None:
                self.efforts[name] = bounds.max_effort
        if kind == "floating":
            self.findings.warn("free", f"{where} is a floating joint: the robot is not fixed to the world.", name)
        parent, child = self.joint_links[name]
        inner, T_inner_parent = self.body_of_link[parent]
        outer, T_outer_child = self.body_of_link[child]
        return Joint(
            label,
            TYPES[kind],
            inner,
            outer,
            T_inner_parent @ origin(self.xml, joint, where) @ T_joint_axis,
            T_outer_child @ T_joint_axis,
            active=active,
            limits=bounds.limits,
            soft_limits=bounds.soft_limits,
            max_speed=bounds.max_speed,
        )

    def _replacement_joints(self, name: str, names: Names, driven: Collection[str]) -> list[Joint]:
        """Return the joints that replace a URDF joint according to the closure YAML, in the frame of the URDF joint."""
        where = f"joint '{name}'"
        kind = self.retyped[name]
        parent, T_parent_link = self.body_of_link[self.joint_links[name][0]]
        T_parent_joint = T_parent_link @ origin(self.xml, self.joints[name], where)
        # The child is a body, so its pose on the body is the identity: `_find_joint_frames` keeps such a link as one.
        child, _ = self.body_of_link[self.joint_links[name][1]]
        text = f"{where}: the closure YAML sets the type {kind}, so the axis and limits of the URDF are not imported."
        self.findings.note("retyped", text, name)
        if kind == "SPHERICAL":
            return [Joint(names[name], "spherical", parent, child, T_parent_joint)]
        if kind == "FIXED":
            return [Joint(names[name], "fixed", parent, child, T_parent_joint)]
        first, second = self._part_names(name)
        cross = self._insert_body(f"{name}_cross")
        joints = []
        for part, inner, outer, T_inner in ((first, parent, cross, T_parent_joint), (second, cross, child, np.eye(4))):
            axis = np.eye(3)["XYZ".index(part[-1])]  # the names of the parts end with their axis
            T_joint_axis = pose_along(axis)
            is_driven = part in driven
            joints.append(
                Joint(names[part], "revolute", inner, outer, T_inner @ T_joint_axis, T_joint_axis, active=is_driven)
            )
        return joints

    def _planar_joints(self, name: str, names: Names) -> list[Joint]:
        """Return slides along x and y of the plane, and a hinge about its normal z, for a planar joint.

        As for a floating joint, no motor moves these joints. The limits of the URDF do not say which coordinate they
        limit, so they are not imported.
        """
        where = f"joint '{name}'"
        joint = self.joints[name]
        T_joint_normal = pose_along(self._axis(where, joint))
        parent, T_parent_link = self.body_of_link[self.joint_links[name][0]]
        child, T_child_joint = self.body_of_link[self.joint_links[name][1]]
        first, second, third = self._part_names(name)
        x_carriage = self._insert_body(f"{name}_moved_x")
        y_carriage = self._insert_body(f"{name}_moved_y")
        text = f"{where} is planar: it becomes the slides '{names[first]}' and '{names[second]}' and the hinge "
        self.findings.warn("planar", f"{text}'{names[third]}', which no motor drives.", name)
        limit = joint.find("limit")
        if limit is not None and (limit.get("lower") or limit.get("upper")):
            text = f"{where} is planar: the limits {limit.get('lower')} .. {limit.get('upper')} are not imported."
            self.findings.warn("limits", text, name)
        x_axis = pose_along(np.array([1.0, 0.0, 0.0]))
        y_axis = pose_along(np.array([0.0, 1.0, 0.0]))
        T_parent_plane = T_parent_link @ origin(self.xml, joint, where) @ T_joint_normal
        return [
            Joint(names[first], "prismatic", parent, x_carriage, T_parent_plane @ x_axis, x_axis),
            Joint(names[second], "prismatic", x_carriage, y_carriage, y_axis, y_axis),
            Joint(names[third], "revolute", y_carriage, child, np.eye(4), T_child_joint @ T_joint_normal),
        ]

    def _insert_body(self, name: str) -> str:
        """Insert a body without mass between two joints that replace one, and return its name: `name` if it is free."""
        taken_names: set[str] = set()
        for carrier, _ in self.body_of_link.values():
            taken_names.add(carrier)
        for inserted in self.inserted_bodies:
            taken_names.add(inserted.name)
        body = identifier(name)
        while body in taken_names:
            body += "_1"
        self.inserted_bodies.append(Body(body))
        return body

    def _mimic_coupling(self, name: str, names: Names) -> Coupling:
        where = f"joint '{name}', mimic"
        mimic = self.joints[name].find("mimic")
        assert mimic is not None  # the caller asks only for joints with one
        leader = mimic.get("joint")
        if leader is None or leader not in self.joints:
            self.xml.fail(where, unknown("joint", str(leader), self.joints))
        if _PLANAR in (self.joints[name].get("type"), self.joints[leader].get("type")):
            self.xml.refuse(where, "a planar joint has three coordinates, so it cannot mimic or be mimicked")
        ratio = self.xml.number(where, "multiplier", mimic.get("multiplier"), 1.0)
        if ratio == 0:
            self.xml.refuse(where, "mimic multiplier is 0; use a fixed joint")
        offset = self.xml.number(where, "offset", mimic.get("offset"), 0.0)
        # joint = ratio * leader + offset, written as the sum of a coupling: 1 * joint - ratio * leader = offset
        return Coupling(f"{names[name]}_mimic", (names[name], names[leader]), (1.0, -ratio), offset)

    def _closure_couplings(self, names: Names) -> list[Coupling]:
        """Return the couplings of the closure YAML."""
        couplings: list[Coupling] = []
        if self.closures is None:
            return couplings
        for name, joints, ratios, total in self.closures.couplings:
            coupled: list[str] = []
            for joint in joints:
                if joint not in names:
                    raise SourceError(f"{self.closure_file}: coupling: {unknown('joint', joint, names.known())}")
                coupled.append(names[joint])
            couplings.append(Coupling(identifier(name), tuple(coupled), ratios, total))
        return couplings

    def _closure_joints(self, names: Names, loop_closers: Collection[str]) -> list[Joint]:
        """Return the joints that the closure YAML adds. If the YAML names a joint, its child link is meant."""
        closure_joints: list[Joint] = []
        if self.closures is None:
            return closure_joints
        for index, (first_name, second_name, kind) in enumerate(self.closures.loops):
            first_link = self._link(first_name)
            second_link = self._link(second_name)
            for name, link in ((first_name, first_link), (second_name, second_link)):
                if link not in self.links:
                    known_names = [*self.joint_links, *self.links]
                    raise SourceError(
                        f"{self.closure_file}: closed_loop: {unknown('joint or link', name, known_names)}"
                    )
            if first_link in loop_closers or second_link in loop_closers:
                continue  # a moving joint closes this loop
            # The common part of the two names, such as `closedloop1` of `closedloop1_A` and `closedloop1_B`.
            common = commonprefix((first_name, second_name))  # noqa: RUF071 - of characters, not of folders
            label = identifier(common.rstrip("_-"))
            used_names = {joint.name for joint in closure_joints}
            if label in used_names or label in names:
                label = f"loop{index + 1}_closure"
            first_body, T_first = self.body_of_link[first_link]
            second_body, T_second = self.body_of_link[second_link]
            if first_body == second_body:
                text = f"'{first_name}' and '{second_name}' are on the same body, '{first_body}'"
                raise SourceError(f"{self.closure_file}: closed_loop: {text}")
            closure_joints.append(Joint(label, kind, first_body, second_body, T_first, T_second))
        return closure_joints

    def _inertia(self, name: str, link: Element) -> Inertia | None:
        where = f"link '{name}'"
        element = link.find("inertial")
        if element is None:
            return None
        T_link_com = origin(self.xml, element, where)
        mass = element.find("mass")
        tensor = element.find("inertia")
        if mass is None or tensor is None:
            lacking = "mass" if mass is None else "inertia"
            text = f"{where}: the <inertial> has no <{lacking}>: the link is imported without mass."
            self.findings.warn("inertia", text, name)
            return None
        kilograms = self.xml.number(where, "mass", mass.get("value"))
        R = T_link_com[:3, :3]
        I = R @ self.xml.tensor(where, tensor.get) @ R.T  # noqa: E741
        # The mean with the transpose is symmetric in all digits, which rotations by rounded matrices are not.
        symmetric = 0.5 * (I + I.T)
        return possible_inertia(Inertia(kilograms, T_link_com[:3, 3], symmetric), name, self.findings)


def read(path: Path, options: Options) -> Imported:
    """Return the mechanism of a URDF, with the loops in its closure YAML; see `read_urdf`."""
    closures = options.closures
    beside = path.with_suffix(".yaml")
    # the folder of a xacro has YAML files of parameters, whose names mean other things
    if closures is None and path.suffix.lower() != SUFFIX and beside.is_file():
        closures = beside
    return read_urdf(path, closures, options.xacro)
