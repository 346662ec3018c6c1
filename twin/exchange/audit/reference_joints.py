"""The joints that files are compared by: which joint of a file, or part of one, is which joint of the others.

Formats name and divide joints differently: a ball is three hinges <joint>_x, <joint>_y, <joint>_z in one, one joint in
another, and a pair of ties <joint>_0, <joint>_1 in a third. Of each joint, that of the first file that has it undivided
is the reference; the joints of all files are matched with it by name or, if they have others, by their two links.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from twin.exchange.audit.file_joints import ONE_COORDINATE, FileJoint
from twin.exchange.audit.file_view import FileView
from twin.exchange.format import Holds
from twin.exchange.formats import family_rank

_MAX_AUXILIARY_MASS = 1e-5
"""Maximum mass in kg of a link that is only between two hinges; simulators reject such links without any mass."""


def known_links_of(views: Sequence[FileView]) -> set[str]:
    """Return the links of the first source with links: the mechanism, or the file with the smallest rank.

    Files with auxiliary links, for example between the hinges of a ball joint, are used only if there are no others;
    then their links count, without those that are auxiliary.
    """
    links: set[str] = set()
    exact_views: list[FileView] = []
    for view in views:
        links.update(view.mechanism.links)
        if view.mechanism.links and (view.is_mechanism or view.holds(Holds.LINKS)):
            exact_views.append(view)
    if exact_views:
        return set(min(exact_views, key=_rank_of_family).mechanism.links)
    stating = []
    for view in views:
        if view.mechanism.links:
            stating.append(view)
    links_without_auxiliary = set()
    for link in links:
        if not _is_auxiliary(link, stating):
            links_without_auxiliary.add(link)
    return links_without_auxiliary


def _is_auxiliary(link: str, views: Sequence[FileView]) -> bool:
    """Return whether a link is not in all files, and is only between joints where it is: no shape, no mass that counts.

    A link at the end of a chain is none: with it, its joint would be left out.
    """
    if all(link in view.mechanism.links for view in views):
        return False
    for view in views:
        joint_count = 0
        for joint in view.mechanism.joints:
            joint_count += link in (joint.parent, joint.child)
        if link in view.mechanism.links and joint_count < 2:
            return False
        mass = view.mechanism.masses.get(link)
        has_weight = mass is not None and mass.mass > _MAX_AUXILIARY_MASS
        if link in view.shapes or view.mechanism.shown.get(link) or has_weight:
            return False
    return True


def _rank_of_family(view: FileView) -> int:
    """Return the smallest rank of the files in the format of a source, 0 for the mechanism."""
    if view.is_mechanism:
        return 0
    return family_rank(view.format)


def reference_joints_of(views: Sequence[FileView], known_links: set[str]) -> dict[str, FileJoint]:
    """Return {name: joint} for the joints between known links; each joint is from the first file that has it."""
    reference_joints: dict[str, FileJoint] = {}
    prefixes, coordinates = _names_of_coordinates(views, known_links)
    # Files with a tree of joints come last, because they may divide joints.
    for view in sorted(views, key=lambda v: v.holds(Holds.JOINT_TREE)):
        for joint in view.mechanism.joints_between(known_links):
            link_pair = {joint.parent, joint.child}
            if not link_pair <= known_links | {""} or not joint.names or matching_name(joint, reference_joints, view):
                continue
            first = joint.names[0]
            if view.holds(Holds.COORDINATES) and (first.startswith(prefixes) or first in coordinates):
                continue  # one coordinate of a ball or cylindrical joint
            if joint.kind == "fixed" and view.holds(Holds.UNNAMED_FIXED_JOINTS):
                continue
            reference_joints[whole_name(joint)] = joint
    return reference_joints


def _names_of_coordinates(views: Sequence[FileView], known_links: set[str]) -> tuple[tuple[str, ...], set[str]]:
    """Return (prefixes, names) by which a track may name the single coordinates of joints in other files."""
    prefixes = []
    names = set()
    for view in views:
        if view.holds(Holds.COORDINATES):
            continue
        for joint in view.mechanism.joints_between(known_links):
            if not joint.names:
                continue
            whole = whole_name(joint)
            if joint.kind == "":  # a GLB contains the names of joints, but not their kinds
                names |= {f"{whole}_x", f"{whole}_y", f"{whole}_z", f"{whole}_slide"}
            elif joint.kind not in ("fixed", *ONE_COORDINATE):
                prefixes.append(f"{whole}_")
    return tuple(prefixes), names


def whole_name(joint: FileJoint) -> str:
    """Return the name <joint> of a joint from the names of its parts, such as <joint>_0 (a tie) or <joint>_x (a hinge).

    A tie is a pair of coinciding points. From a single name, a number at the end is removed only if the joint is a tie:
    `setup_1` can be the name of a joint.
    """
    first, *others = joint.names
    if not others and not joint.tied:
        return first
    if not others:
        return re.sub(r"_\d+$", "", first)
    short = min(joint.names, key=len)
    if are_parts(joint, short):
        return short
    common = first
    for name in others:
        while not name.startswith(common):
            common = common[:-1]
    return common.rstrip("_") or short


def matching_name(joint: FileJoint, reference_joints: Mapping[str, FileJoint], view: FileView) -> str:
    """Return the name of the reference joint with the same name or the same links as a joint; "" if there is none."""
    if joint.names:
        for name in (joint.names[0], whole_name(joint)):
            if name in reference_joints:
                return name
        if len(joint.names) > 1 or view.holds(Holds.COORDINATES):
            divided_name = _divided_name(joint, reference_joints)
            if divided_name:
                return divided_name
    if not joint.parent:
        return ""
    link_pair = {joint.parent, joint.child}
    names_in_file = _joint_and_part_names(view.mechanism.joints)
    candidates = []
    for name, candidate in reference_joints.items():
        if {candidate.parent, candidate.child} == link_pair and name not in names_in_file:
            candidates.append(name)
    if len(candidates) != 1:  # none, or several between the same two links
        return ""
    return candidates[0]


def _divided_name(joint: FileJoint, reference_joints: Mapping[str, FileJoint]) -> str:
    """Return the longest name of a reference joint whose parts are all parts of a joint; "" if there is none.

    Tracks have the coordinates of a ball as separate joints, each with one name.
    """
    longest = ""
    for name, candidate in reference_joints.items():
        divisible = len(joint.names) > 1 or candidate.kind not in ONE_COORDINATE
        if divisible and are_parts(joint, name) and len(name) > len(longest):
            longest = name
    return longest


def _joint_and_part_names(joints: Sequence[FileJoint]) -> set[str]:
    """Return the names of the parts of joints, and of the joints without their parts."""
    names = set()
    for joint in joints:
        if joint.names:
            names |= {*joint.names, whole_name(joint)}
    return names


def are_parts(joint: FileJoint, name: str) -> bool:
    """Return whether all names of a joint are those of parts of the joint `name`, such as <name>_x."""
    return all(part == name or part.startswith(f"{name}_") for part in joint.names)


def stated_name(name: str, joint: FileJoint) -> str:
    """Return the reference's name of a joint if the joint has it too, also in the names of its parts; else its own."""
    tie_name = _name_of_odd_tie(name, joint)
    if tie_name:
        return tie_name
    whole = whole_name(joint)
    divided = len(joint.names) > 1 and are_parts(joint, name)
    if name in joint.names or name == whole or divided:
        return name
    return whole


def _name_of_odd_tie(name: str, joint: FileJoint) -> str:
    """Return the name of a tie that is none of the parts <name>_0, <name>_1, … of a joint; "" without one.

    If no tie is numbered, the file names its ties in another way, which says nothing.
    """
    if not joint.tied:
        return ""
    part_name = re.compile(rf"{re.escape(name)}_\d+")
    other_names = []
    for part in joint.names:
        if part_name.fullmatch(part) is None:
            other_names.append(part)
    if len(other_names) == len(joint.names):
        return ""
    if other_names:
        return other_names[0]
    if len(joint.names) < len(joint.tied):
        return f"{', '.join(joint.names)} and a tie without a name"
    return ""
