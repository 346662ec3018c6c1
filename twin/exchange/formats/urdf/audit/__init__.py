"""Audit a URDF: its content is compared with other files, its poses along tracks are computed, and it is checked.

A URDF contains the tree, inertias and limits of a mechanism; it cannot contain loops, named frames or gravity. A
closure YAML of the same name contains the loops.

attributes, joint_elements, link_elements, transmissions    what the elements of the file state
tree, closures    the joints as a tree, and the loops of the YAML
elements, collisions, loop_checks    faults that the two files show by themselves
program_settings    what the file says to single programs
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from twin.core.errors import BudgetError, SourceError, TwinError
from twin.core.foreign.admit import admit
from twin.exchange.audit import poses
from twin.exchange.audit.chain_poses import chain_end, solve_chain
from twin.exchange.audit.comment_statements import assumed_masses, partly_shown
from twin.exchange.audit.file_content import Content, FileClip
from twin.exchange.audit.ledger import Ledger, ReadError
from twin.exchange.audit.mechanism_data import FileMechanism
from twin.exchange.audit.mesh_files import mesh_path
from twin.exchange.audit.poses import Array
from twin.exchange.audit.reader_context import Context, played
from twin.exchange.audit.xml_root import parse_xml
from twin.exchange.formats.urdf.audit.attributes import scale_and_pose
from twin.exchange.formats.urdf.audit.closures import FileClosures, read_closures
from twin.exchange.formats.urdf.audit.collisions import check_collisions
from twin.exchange.formats.urdf.audit.elements import check_elements
from twin.exchange.formats.urdf.audit.joint_elements import read_joints
from twin.exchange.formats.urdf.audit.link_elements import partly_read_links, read_masses, read_shapes
from twin.exchange.formats.urdf.audit.loop_checks import (
    LIMIT_ROUNDING,
    check_driven_joints,
    check_driven_order,
    check_home,
    check_loop_along,
    check_loop_ends,
)
from twin.exchange.formats.urdf.audit.program_settings import program_settings
from twin.exchange.formats.urdf.audit.transmissions import (
    check_transmission_names,
    driven_in_order,
    driven_joints,
    read_motors,
    read_reductions,
)
from twin.exchange.formats.urdf.audit.tree import UrdfTree
from twin.exchange.xacro import Expanded, expand, is_xacro

_NO_MASS = 1.5e-6
"""Mass in kg up to which a link is a frame: simulators require a mass of links behind joints that move."""

_TRACK_UNLIMITED = 1e29
"""Absolute value from which a limit in a track means none: JSON has no infinity, so tracks state 1e30."""


class Urdf:
    """A URDF, or an expanded xacro, that gives its poses along tracks (see `reader_context.JointTree`).

    Attributes:
        tree: its links and joints.
        closures: the loops of the closure YAML beside it; none without such a file.
        content: what the file contains, in the form of all formats.
    """

    def __init__(self, path: Path, ledger: Ledger, expanded: Expanded | None = None) -> None:
        """Read a file, and report its faults.

        Raises:
            ReadError: the file is no URDF, is no tree, or has an attribute that is not a number.
        """
        self._ledger = ledger
        root = parse_xml(path, None if expanded is None else expanded.data)
        if root.tag != "robot":
            raise ReadError(f"the root element is <{root.tag}>, expected <robot>")
        links = [element.get("name", "") for element in root.findall("link")]
        _report_duplicates("links", links, ledger)
        joint_names = [element.get("name", "") for element in root.findall("joint")]
        _report_duplicates("joints", joint_names, ledger)
        check_elements(root, ledger)
        self.tree = UrdfTree(links, read_joints(root, links, ledger), ledger)
        self.content = Content(ledger, "urdf")
        self.content.facts = {"units": "m (URDF)", "up_axis": "Z (URDF)", "handedness": "right (URDF)"}
        self.content.rest = dict.fromkeys(links, np.eye(4))
        self.content.shapes, self.content.colors = read_shapes(root, path, ledger)
        check_collisions(root, ledger, lambda name: mesh_path(path, name), scale_and_pose)
        self._read_mechanism(root, path)

    def _read_mechanism(self, root: ET.Element, path: Path) -> None:
        """Set `closures` and the mechanism of `content`, from the element <robot> and the closure YAML; check both."""
        masses = read_masses(root)
        driven = driven_joints(root)
        closure_file = path.with_suffix(".yaml")
        has_closure_file = closure_file.is_file()
        closures = None
        if has_closure_file:
            closures = read_closures(closure_file, self.tree.links, self.tree.joint_names, self._ledger)
        if closures is not None:
            check_driven_joints(closures, driven, closure_file.name, self._ledger)
            check_driven_order(closures, driven_in_order(root), closure_file.name, self._ledger)
        self.closures = closures or FileClosures()

        bodies = self._bodies()
        mechanism = FileMechanism(tuple(bodies), masses)
        mechanism.robot = root.get("name", "")
        mechanism.joints = [joint.as_file_joint(driven) for joint in self.tree.joints]
        mechanism.joints += self.closures.joints()
        mechanism.couplings = self._couplings()
        mechanism.home = self.closures.home or None
        mechanism.couples_pairs = not has_closure_file  # a mimic couples two joints; the YAML any number
        mechanism.shown, mechanism.collides = _shown_and_colliding(root, bodies)
        mechanism.assumed = assumed_masses(path)
        mechanism.partly_shown = partly_shown(path) | partly_read_links(root)
        mechanism.motors = read_motors(root)
        mechanism.reductions = read_reductions(root, driven)
        mechanism.program_settings = program_settings(root)
        self.content.mechanism = mechanism

        check_transmission_names(root, self.tree.joint_names, self._ledger)
        check_home(self.tree, self.closures, closure_file.name, self._ledger)
        if has_closure_file:

            def is_part(link: str) -> bool:
                """Return whether a link has a shape, or more mass than the 1 mg that stands for none."""
                has_mass = link in masses and masses[link].mass > _NO_MASS
                return link in self.content.shapes or has_mass

            check_loop_ends(self.tree, self.closures, is_part, closure_file.name, self._ledger)

    def _bodies(self) -> list[str]:
        """Return the links of the mechanism: all but the ends of loops, which are frames unless they have a shape."""
        loop_ends: set[str] = set()
        for pair in self.closures.pairs:
            loop_ends.update((pair.first, pair.second))
        return [link for link in self.tree.links if link not in loop_ends or link in self.content.shapes]

    def _couplings(self) -> dict[str, tuple[Mapping[str, float], float]]:
        """Return {name: ({joint: ratio}, sum)} of the mimics of the URDF, and of the couplings of the YAML."""
        couplings: dict[str, tuple[Mapping[str, float], float]] = {}
        for joint in self.tree.joints:
            if joint.mimic is not None:
                leader, multiplier, offset = joint.mimic
                couplings[f"{joint.name}_mimic"] = ({joint.name: 1.0, leader: -multiplier}, offset)
        if self.closures.couplings is not None:
            couplings |= dict(self.closures.couplings)
        return couplings

    def play(self, clip: FileClip) -> FileClip:
        """Return a clip of the link poses T_world_link (k, 4, 4), computed from the joint values of `clip`.

        Loops that are open at a key of the clip are reported.
        """
        count = len(clip.times)
        root = self.tree.root
        link_poses: dict[str, Array] = {}
        link_poses[root] = clip.links.get(root, np.broadcast_to(np.eye(4), (count, 4, 4)))
        for name in self.tree.parents_first():
            if name not in clip.links or name == root:
                continue
            path = self.tree.path_from(name, link_poses)
            if path.has_free_joint:  # every pose of the link is a pose of the joint
                link_poses[name] = clip.links[name]
                continue
            # Values that the track lacks are computed from the pose of the link in the track.
            T_world_ancestor = clip.links.get(path.ancestor, link_poses[path.ancestor])
            T_ancestor_link = poses.inverse(T_world_ancestor) @ clip.links[name]
            values = solve_chain(path.steps, path.values(clip), T_ancestor_link)
            link_poses[name] = link_poses[path.ancestor] @ chain_end(path.steps, values, count)
        for pair in self.closures.pairs:
            check_loop_along(self.tree, pair, link_poses, clip, self._ledger)
        # The root and links in between may have no pose in the clip, and then nothing is compared with theirs.
        links = {link: T for link, T in link_poses.items() if link in clip.links}
        return FileClip(clip.name, clip.times, links)

    def check_limits(self, name: str, low: Mapping[str, float], high: Mapping[str, float]) -> None:
        """Compare the joint limits of the file with the joint limits in a track.

        `name` is the file name of the track. `low` and `high` map joints to their limits in the track, in m or rad.
        """
        for joint in self.tree.joints:
            if joint.name not in low or joint.limits is None:
                continue
            lower, upper = joint.limits
            difference = 0.0
            for limit, track_limit in ((lower, low[joint.name]), (upper, high[joint.name])):
                if abs(track_limit) < _TRACK_UNLIMITED:
                    difference = max(difference, abs(limit - track_limit))
            if difference > LIMIT_ROUNDING:
                text = (
                    f"joint '{joint.name}' has limits {lower:g} .. {upper:g}; in {name} they are "
                    f"{low[joint.name]:g} .. {high[joint.name]:g}."
                )
                self._ledger.wrong("urdf.limits", text, joint.name, size=difference)


def _report_duplicates(kind: str, names: Sequence[str], ledger: Ledger) -> None:
    """Report the alphabetically first name that several elements have; `kind` is their plural noun."""
    duplicates = {name for name in names if names.count(name) > 1}
    if duplicates:
        name = min(duplicates)
        ledger.wrong("urdf.duplicate_name", f"two {kind} are named '{name}'.", name)


def _shown_and_colliding(root: ET.Element, bodies: Sequence[str]) -> tuple[dict[str, bool], dict[str, bool]]:
    """Return ({body: whether it has a visual shape}, {body: True} of the bodies with a collision shape)."""
    shown: dict[str, bool] = {}
    collides: dict[str, bool] = {}
    for link in root.findall("link"):
        name = link.get("name", "")
        if name not in bodies:
            continue
        shown[name] = link.find("visual") is not None
        if link.find("collision") is not None:
            collides[name] = True
    return shown, collides


def read(path: Path, ledger: Ledger, context: Context) -> Content:
    """Return the content of a URDF with its poses along the tracks, and report its faults."""
    admit(path)
    ledger.tool = "twin.exchange.audit urdf"
    ledger.version = "1"
    expanded: Expanded | None = None
    if is_xacro(path):
        try:
            expanded = expand(path, context.xacro)
        except (BudgetError, SourceError):
            raise
        except TwinError as error:
            # No consent, or no package `xacro`: only this file cannot be read, and the audit of a folder goes on.
            raise ReadError(f"{error}", "urdf.xacro") from error
        for text in expanded.omitted:
            ledger.add("urdf.xacro", "warning", text, path.name)
    return played(Urdf(path, ledger, expanded), path, ledger, context)
