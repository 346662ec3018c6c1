"""The tree of links of a URDF, and which of its links become frames of the mechanism, or ends of loops, not bodies.

A link without shape and mass is no body. It is
    a named frame on its parent, if it is fixed to it;
    the frame of the joint above it on the body that is fixed to it, if there is one such body;
    the end of a loop, if it is welded to another link by the closure YAML: the joint above it then closes the loop.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from xml.etree.ElementTree import Element

from twin.core.errors import SourceError, unknown
from twin.exchange.formats.urdf.read.closures import Closures
from twin.exchange.formats.urdf.read.gears import MOVING
from twin.exchange.read.imported_robot import Findings
from twin.exchange.read.xml_file import Xml

PLANAR = "planar"
"""Joint type of URDF that becomes three joints: slides along x and y of the plane, and a hinge about its normal z."""

_MAX_MASSLESS = 1e-6
"""Maximum mass in kg of a link without shape that becomes a frame instead of a body."""


class LinkStructure:
    """The links and joints of a URDF, with its closure YAML.

    Attributes:
        xml: the file.
        links, joints: elements of the file by name.
        closures: the content of the closure YAML, or None.
        closure_file: its path, or None.
        findings: receives what becomes of links.
        joint_links: {joint: (parent link, child link)}.
        parent_joints: {link: the joint of which it is the child}.
        retyped: {joint: new type} of the joints whose type the closure YAML replaces.
        base: the root link.
    """

    def __init__(
        self,
        xml: Xml,
        links: Mapping[str, Element],
        joints: Mapping[str, Element],
        closures: Closures | None,
        closure_file: Path | None,
        findings: Findings,
    ) -> None:
        """Read the links that the joints join.

        Raises:
            SourceError: the links are no tree, or the closure YAML names a joint that is not there.
        """
        self.xml = xml
        self.links = links
        self.joints = joints
        self.closures = closures
        self.closure_file = closure_file
        self.findings = findings
        self.joint_links: dict[str, tuple[str, str]] = {}
        for name, joint in joints.items():
            self.joint_links[name] = self._read_joint_links(name, joint)
        self.retyped = self._read_retyped()
        self.parent_joints: dict[str, str] = {}
        self.base = self._find_base()

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

    def _find_base(self) -> str:
        """Return the root link, and fill `parent_joints`."""
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
            raise SourceError(f"{self.xml.path}: expected one root link, found {names_of_roots}")
        return roots[0]

    def find_frame_links(self) -> dict[str, str]:
        """Return {link: the fixed joint to its parent} for the links that become named frames."""
        marks = {}
        for joint, (_, child) in self.joint_links.items():
            fixed = self.joints[joint].get("type") == "fixed" or self.retyped.get(joint) == "FIXED"
            if fixed and child != self.base and not self.has_body(child):
                marks[child] = joint
                text = f"link '{child}' has no shape and no mass: it becomes a frame on its parent."
                self.findings.note("mark", text, child)
        return marks

    def find_joint_frames(self) -> dict[str, str]:
        """Return {link: fixed joint} for links without body between a moving joint and the body fixed to them.

        Such a link is only the frame of the joint on this body.
        """
        joint_frames: dict[str, str] = {}
        for name in self.links:
            inner = self.parent_joints.get(name)
            if inner is None or inner in self.retyped or self.has_body(name):
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
            if moving and kind.lower() == "fixed" and self.has_body(child):
                joint_frames[name] = outer
                text = f"link '{name}' has no shape and no mass: it becomes one body with '{child}', fixed to it."
                self.findings.note("mark", text, name)
        return joint_frames

    def find_loop_closers(self, bodiless_links: Collection[str]) -> dict[str, str]:
        """Return {link: the link welded to it by a loop} for links without body at the end of a moving joint.

        The moving joint then closes the loop.
        """
        loop_closers: dict[str, str] = {}
        if self.closures is None:
            return loop_closers
        parents = {parent for parent, _ in self.joint_links.values()}
        loop_links = self.loop_links()
        for first_name, second_name, kind in self.closures.loops:
            if kind != "fixed":
                continue
            first_link = self.link_of(first_name)
            second_link = self.link_of(second_name)
            for name, partner in ((first_link, second_link), (second_link, first_link)):
                if name not in self.parent_joints or partner not in self.links or partner in loop_closers:
                    continue
                joint = self.parent_joints[name]
                moving = joint not in self.retyped and self.joints[joint].get("type") in MOVING
                leaf = name not in parents and name not in bodiless_links and loop_links.count(name) == 1
                if moving and leaf and not self.has_body(name):
                    loop_closers[name] = partner
                    break  # the other end stays where it is: one moving joint closes the loop
        return loop_closers

    def loop_links(self) -> list[str]:
        """Return the links that the closure YAML joins, two for each loop."""
        links: list[str] = []
        if self.closures is not None:
            for a, b, _ in self.closures.loops:
                links += [self.link_of(a), self.link_of(b)]
        return links

    def link_of(self, name: str) -> str:
        """Return the link that a closure means: a link of this name, or the child of the joint of this name."""
        return self.joint_links[name][1] if name in self.joint_links else name

    def has_body(self, name: str) -> bool:
        """Return whether a link has a mass or a shape."""
        link = self.links[name]
        mass = link.find("inertial/mass")
        value = "0" if mass is None else mass.get("value")
        kilograms = self.xml.number(f"link '{name}'", "mass", value, 0.0)
        return abs(kilograms) > _MAX_MASSLESS or link.find("visual") is not None or link.find("collision") is not None

    def part_names(self, name: str) -> list[str]:
        """Return the names of the joints made from one URDF joint.

        A universal joint becomes two hinges, a planar joint two slides and a hinge, each other joint one joint.
        """
        kind = self.retyped.get(name, "")
        if kind.startswith("UJOINT"):
            return [f"{name}_{axis}" for axis in kind[-2:]]
        if not kind and self.joints[name].get("type") == PLANAR:
            return [f"{name}_x", f"{name}_y", f"{name}_z"]
        return [name]
