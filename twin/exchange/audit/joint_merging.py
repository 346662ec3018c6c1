"""Join the parts into which a format splits a joint, so that joints of different formats can be compared.

Some formats split a joint into parts: a ball joint into three hinges with auxiliary links, or a loop closure into two
ties.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from twin.exchange.audit.file_drives import FileDrive
from twin.exchange.audit.file_joints import WORLD, FileJoint
from twin.exchange.audit.poses import Array


def merged_joints(all_joints: Collection[FileJoint], known_links: Collection[str]) -> list[FileJoint]:
    """Return the joints between known links.

    An unknown link with two joints is removed, and its two joints become one joint; if the pose of one of them is
    not stated, both are removed with the link. An unknown link with one joint is removed together with the joint.
    An unknown link with three or more joints remains.
    If a file states joints by ties (`FileJoint.tied`), all ties between the same two links become one joint.
    """
    joints = []
    for joint in all_joints:
        if not joint.tied:
            joints.append(joint)
    # Files attach a joint of the ground to the world or to the base fixed to it: one of both must be chosen.
    if WORLD not in known_links:
        joints = _mounted_on_base(joints)
    unknown_links: list[str] = []
    for joint in joints:
        for link in (joint.parent, joint.child):
            if link and link not in known_links and link not in unknown_links:
                unknown_links.append(link)
    while unknown_links:
        link = _next_removable(unknown_links, joints)
        if link is None:
            break
        unknown_links.remove(link)
        joints = _without_link(link, joints)
    return joints + _joined_ties(all_joints)


def _joined_ties(joints: Collection[FileJoint]) -> list[FileJoint]:
    """Return one joint for all ties between the same two links."""
    ties: dict[tuple[str, str], list[FileJoint]] = {}
    for joint in joints:
        if joint.tied:
            ties.setdefault((joint.parent, joint.child), []).append(joint)
    joined = []
    for group in ties.values():
        names: list[str] = []
        points: list[tuple[Array, Array]] = []
        for joint in group:
            names += joint.names
            points += joint.tied
        joined.append(replace(group[0], names=tuple(names), tied=tuple(points)))
    return joined


def joints_of(link: str, joints: Collection[FileJoint]) -> list[FileJoint]:
    """Return the joints of a link."""
    joints_of_link = []
    for joint in joints:
        if link in (joint.parent, joint.child):
            joints_of_link.append(joint)
    return joints_of_link


def _next_removable(links: Collection[str], joints: Collection[FileJoint]) -> str | None:
    """Return the first of the links with at most two joints; None if there is none."""
    for link in links:
        if len(joints_of(link, joints)) <= 2:
            return link
    return None


def _without_link(link: str, joints: list[FileJoint]) -> list[FileJoint]:
    """Return joints without a link: if two joints have it, they become one, with the motions of both.

    Two joints, of which one has no stated pose, cannot become one: both are left out.
    """
    joined: list[FileJoint] = []
    others: list[FileJoint] = []
    for joint in joints:
        if link in (joint.parent, joint.child):
            joined.append(joint)
        else:
            others.append(joint)
    if len(joined) != 2:
        return others
    first, second = joined
    if first.T is None or second.T is None:
        return others
    if first.child != link:
        first = first.reversed()
    if second.parent != link:
        second = second.reversed()
    return [*others, _joined_to_one(first, second)]


def _mounted_on_base(joints: list[FileJoint]) -> list[FileJoint]:
    """Return joints on the link that is fixed to the world instead of on the world; others are unchanged."""
    mount = _mount(joints)
    if mount is None:
        return joints
    base = mount.reversed()
    mounted_joints = []
    for joint in joints:
        if joint is mount:
            continue
        if joint.parent == WORLD and joint.T is not None:
            mounted_joints.append(_joined_to_one(base, joint))
        else:
            mounted_joints.append(joint)
    return mounted_joints


def _mount(joints: list[FileJoint]) -> FileJoint | None:
    """Return the first joint that fixes a link to the world; None if there is none."""
    for joint in joints:
        if joint.parent == WORLD and joint.kind == "fixed" and joint.T is not None:
            return joint
    return None


def _joined_to_one(first: FileJoint, second: FileJoint) -> FileJoint:
    """Return two joints as one; it has the drive of the one that moves, and none if both or neither do."""
    assert first.T is not None
    assert second.T is not None
    drive = FileDrive()
    if first.motions and not second.motions:
        drive = first.drive
    elif second.motions and not first.motions:
        drive = replace(second.drive, cone_axis=None)  # the parent is another one
    motions = list(first.motions)
    for line in second.motions:
        motions.append(line.transformed(first.T))
    names = first.names + second.names
    return FileJoint(names, first.parent, second.child, first.T @ second.T, tuple(motions), drive)
