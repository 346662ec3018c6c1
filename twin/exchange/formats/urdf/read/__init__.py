"""Read a URDF, with its loops from a closure YAML.

Joint frames are the frames in the URDF, rotated so that z is the axis. A link becomes a named frame on its parent if it
is fixed to the parent and has no shape and no mass. A planar joint becomes two slides and a hinge. Data that a
mechanism cannot hold cause a warning (friction, efforts, textures).

closures, link_structure    the YAML; the tree of links, and which of them are no bodies
driven_joints, gears, bounds    what the file states of drives, transmissions and limits
joint_builder, visuals    joints, couplings and shapes of the mechanism
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from twin.core import spatial
from twin.core.errors import NoMechanismError, SourceError, unknown
from twin.core.spatial import Array
from twin.exchange.formats.urdf.read.closures import Closures, read_closures
from twin.exchange.formats.urdf.read.driven_joints import driven_joints, drop_mimics_of_fixed, motors_and_transmissions
from twin.exchange.formats.urdf.read.joint_builder import JointBuilder
from twin.exchange.formats.urdf.read.link_structure import LinkStructure
from twin.exchange.formats.urdf.read.visuals import Visuals, origin
from twin.exchange.read.imported_robot import (
    Findings,
    Imported,
    Names,
    Options,
    assemble,
    possible_inertia,
)
from twin.exchange.read.shapes import shows_all
from twin.exchange.read.start_values import rest_at_values
from twin.exchange.read.xml_file import Xml
from twin.exchange.xacro import SUFFIX, Expanded, XacroSettings, expand, is_xacro
from twin.model.body import Body, Frame
from twin.model.inertia import Inertia
from twin.model.mechanism import WORLD, Coupling

_WITHOUT_EFFECT = ("calibration", "joint_properties")
"""Elements of a joint that have no effect on the mechanism."""

_READ_ELEMENTS = {
    "robot": {"link", "joint", "material", "transmission", "gazebo", "ros2_control"},
    "joint": {"origin", "parent", "child", "axis", "limit", "mimic", "dynamics", "safety_controller", *_WITHOUT_EFFECT},
    "link": {"visual", "collision", "inertial"},
}
"""Child elements that this module reads or knows to be without effect, by the tag of their parent."""


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
        xml, path: the file.
        closures, closure_file: content and path of the closure YAML; None without one.
        findings: receives what is changed and left out.
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

    def read(self) -> Imported:
        """Return the mechanism. The order of the steps is that of the findings.

        Raises:
            SourceError: the file is invalid or unsupported.
        """
        root = self.xml.root
        findings = self.findings
        self._report_unread(root, "robot", "robot")
        links = self._named_elements("link")
        joint_elements = self._named_elements("joint")
        structure = LinkStructure(self.xml, links, joint_elements, self.closures, self.closure_file, findings)
        frame_links = structure.find_frame_links()
        joint_frames = structure.find_joint_frames()
        bodiless_links = self._bodiless_links(structure, frame_links, joint_frames)
        loop_closers = structure.find_loop_closers(bodiless_links)
        for link, partner in loop_closers.items():
            bodiless_links[link] = (partner, np.eye(4))
        # Only the base can be the world: in an MJCF, a body of this name is the world itself.
        reserved = () if structure.base == WORLD else (WORLD,)
        links_with_body = [link for link in links if link not in bodiless_links]
        body_names = Names("link", links_with_body, findings, reserved)
        parts: list[str] = []
        for name in joint_elements:
            parts += structure.part_names(name)
        names = Names("joint", parts, findings)
        body_of_link = _placed_links(links, body_names, bodiless_links)
        if self.closures is None:
            self._report_cut_loops([*joint_elements, *links])
        drop_mimics_of_fixed(structure)
        driven = driven_joints(structure)
        builder = JointBuilder(structure, names, body_of_link)
        dropped_joints = {*frame_links.values(), *joint_frames.values()}
        joints = builder.tree_and_loop_joints(dropped_joints, loop_closers, driven)
        bodies = self._bodies(links, body_names, bodiless_links) + builder.inserted_bodies
        loop_links = structure.loop_links()
        # The ends of loops are no frames of the robot.
        frames = self._frames([link for link in frame_links if link not in loop_links], body_of_link)
        couplings: list[Coupling] = []
        for name, joint in joint_elements.items():
            if joint.find("mimic") is not None:
                couplings.append(builder.mimic_coupling(name))
        couplings += builder.closure_couplings()
        joints += builder.closure_joints(loop_closers)
        actuators, transmissions = motors_and_transmissions(structure, driven, names)
        efforts: dict[str, float] = {}
        for name, effort in builder.efforts.items():
            if structure.joint_links[name][1] not in frame_links:
                efforts[names[name]] = effort
        for text in self.xml.repaired:
            findings.warn("xml", text, self.path.name)
        label = root.get("name") or self.path.stem
        imported = assemble(
            self.path, label, body_names[structure.base], bodies, joints, frames, couplings, findings, efforts=efforts
        )
        mechanism = replace(imported.mechanism, actuators=actuators, transmissions=transmissions)
        # Only the type continuous states that a joint has no limits; a missing <limit> states nothing.
        unlimited = set()
        for name, joint in joint_elements.items():
            if joint.get("type") == "continuous" and name in names:
                unlimited.add(names[name])
        imported = replace(imported, mechanism=mechanism, posed=False, unlimited=frozenset(unlimited))
        return self._at_home(imported, names)

    def _bodiless_links(
        self, structure: LinkStructure, frame_links: Mapping[str, str], joint_frames: Mapping[str, str]
    ) -> dict[str, tuple[str, Array]]:
        """Return {link: (the link that carries it, T_carrier_link (4, 4))} of links that are frames only.

        `frame_links` is {link: the fixed joint to its parent}, `joint_frames` {link: the fixed joint to its child}.
        """
        bodiless_links: dict[str, tuple[str, Array]] = {}
        for link, joint in frame_links.items():
            T_parent_link = origin(self.xml, structure.joints[joint], f"joint '{joint}'")
            bodiless_links[link] = (structure.joint_links[joint][0], T_parent_link)
        for link, joint in joint_frames.items():
            T_link_child = origin(self.xml, structure.joints[joint], joint)
            bodiless_links[link] = (structure.joint_links[joint][1], spatial.inverse(T_link_child))
        return bodiless_links

    def _bodies(self, links: Mapping[str, Element], body_names: Names, bodiless_links: Collection[str]) -> list[Body]:
        visuals = Visuals(self.xml, self.findings)
        bodies: list[Body] = []
        for name, link in links.items():
            if name not in bodiless_links:
                meshes = visuals.meshes(name, link)
                inertia = self._inertia(name, link)
                bodies.append(Body(body_names[name], tuple(meshes), inertia, shows_all(link, len(meshes))))
        return bodies

    def _frames(self, links: Sequence[str], body_of_link: Mapping[str, tuple[str, Array]]) -> list[Frame]:
        """Return named frames for links that are no bodies; for `body_of_link` see `JointBuilder`."""
        names = Names("frame", links, self.findings)
        frames = []
        for link in links:
            body, T_body_link = body_of_link[link]
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


def _placed_links(
    links: Iterable[str], body_names: Names, bodiless_links: Mapping[str, tuple[str, Array]]
) -> dict[str, tuple[str, Array]]:
    """Return {link: (body that carries it, T_body_link (4, 4))}; a link that is a body carries itself.

    `bodiless_links` is {link: (the link that carries it, T_carrier_link (4, 4))}.
    """
    body_of_link: dict[str, tuple[str, Array]] = {}
    for link in links:
        if link not in bodiless_links:
            body_of_link[link] = (body_names[link], np.eye(4))
    # A link without body may be on another one, so each pass places those whose carrier has been placed.
    for _ in bodiless_links:
        for link, (carrier, T_carrier_link) in bodiless_links.items():
            if carrier in body_of_link and link not in body_of_link:
                body, T_body_carrier = body_of_link[carrier]
                body_of_link[link] = (body, T_body_carrier @ T_carrier_link)
    return body_of_link


def read(path: Path, options: Options) -> Imported:
    """Return the mechanism of a URDF, with the loops in its closure YAML; see `read_urdf`."""
    closures = options.closures
    beside = path.with_suffix(".yaml")
    # the folder of a xacro has YAML files of parameters, whose names mean other things
    if closures is None and path.suffix.lower() != SUFFIX and beside.is_file():
        closures = beside
    return read_urdf(path, closures, options.xacro)
