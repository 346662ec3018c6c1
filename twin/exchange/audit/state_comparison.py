"""Compare files without motion with a mechanism at joint states sampled from its whole range.

A file whose links have the names of the mechanism is played at these states like a track, and its poses are compared.
In a file with other names, joints are found by their names or, if their names are unknown too, by structure: each joint
of the file is a joint of the mechanism of the same kind, between the corresponding parts. The lines of two joints, seen
from each other, do not depend on the frames of the links. If all agree, and the frames are those of the mechanism too,
the links get the names of the mechanism, so that masses, limits and drives are compared as well.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np

from twin.exchange.audit import poses
from twin.exchange.audit.file_content import Content
from twin.exchange.audit.joint_assignment import base_link, joint_assignments
from twin.exchange.audit.joint_lines import ANGLE_TOL, LINE_TOL, JointPair, joint_values, pair_differences, place_links
from twin.exchange.audit.ledger import MECHANISM, um
from twin.exchange.audit.mechanism_data import FileMechanism
from twin.exchange.audit.pose_deviation import POSITION_TOL, ROTATION_TOL, pose_deviation
from twin.exchange.audit.poses import Array
from twin.exchange.audit.sampled_states import SampledStates


def same_names(names: Collection[str], links: Collection[str]) -> bool:
    """Return whether the links of a file have the names of a mechanism's links, at least half of them."""
    shared = len(set(names) & set(links))
    return 2 * shared >= min(len(set(names)), len(links))


def compare_states(content: Content, truth: FileMechanism, states: SampledStates) -> None:
    """Compare the joints of a file, whose links have other names than the mechanism, at the sampled states.

    Differences are reported in the file's ledger. If no assignment of the joints is possible, nothing is reported.
    """
    mechanism = content.mechanism
    if mechanism is None:
        return
    assignments = joint_assignments(mechanism, truth)
    by_name = False
    if len(assignments) == 1:
        by_name = list(assignments[0].keys()) == list(assignments[0].values())
    compared: list[tuple[float, list[JointPair], dict[str, str]]] = []
    for assignment in assignments:
        pairs = pair_differences(mechanism, truth, states, assignment, by_name)
        if pairs:
            worst_pair = max(pairs, key=lambda p: p.share)
            compared.append((worst_pair.share, pairs, assignment))
    if not compared:
        return
    # The assignment with the smallest of the largest differences; of equal ones the first.
    _, pairs, assignment = min(compared, key=lambda c: c[0])
    ledger = content.ledger
    assigned_by = "by name" if by_name else "by structure"
    kind = f"of joints (assigned {assigned_by}) against {MECHANISM}, {len(assignment)} joints x {states.count} states"
    pair = max(pairs, key=lambda p: p.distance)
    ledger.row(f"distances {kind}", pair.distance, "m", LINE_TOL, where=pair.names, against=MECHANISM)
    pair = max(pairs, key=lambda p: p.cosine)
    ledger.row(f"angles {kind}", pair.cosine, "1", ANGLE_TOL, where=pair.names, against=MECHANISM)
    ledger.placed = True
    wrong = []
    for pair in pairs:
        if pair.share > 1:
            wrong.append(pair)
    if not wrong:
        _take_names(content, assignment, truth, states)
        return
    # Joints on one rigid part differ whatever the zero positions are: the geometry of the part is another one.
    rigid = []
    for pair in wrong:
        if pair.rigid:
            rigid.append(pair)
    if by_name or rigid:
        reported = rigid or wrong
        reported.sort(key=lambda p: (p.separation, -p.share))
        for pair in reported:
            ledger.wrong("states.joints", pair.text(), pair.first, size=um(pair.distance, LINE_TOL))
        return
    first = wrong[0]
    text = (
        f"{content.file}: its joints were assigned to those of {MECHANISM} by structure only; the zero positions of "
        f"the joints or the distances along their axes differ: {first.text()}"
    )
    advice = "give joints and links the names of the robot"
    ledger.add("audit.not_compared", "error", text, first.first, suggestion=advice)


def _take_names(content: Content, assignment: Mapping[str, str], truth: FileMechanism, states: SampledStates) -> None:
    """Give links and joints of a file the names of the mechanism, if their frames are those of the mechanism.

    Otherwise, state in the file's ledger that masses, shapes and limits are not compared.
    """
    mechanism = content.mechanism
    assert mechanism is not None
    links = place_links(mechanism, joint_values(states, assignment), states.count)
    bodies = _bodies_of_links(links, truth, states)
    if len(bodies) < len(truth.links):
        lacking = []
        for body in truth.links:
            if body not in bodies.values():
                lacking.append(body)
        others_text = ""
        if len(lacking) > 1:
            others_text = f" and {len(lacking) - 1} more"
        text = (
            f"{content.file}: the joints agree with {MECHANISM}, but no link has the frame of '{lacking[0]}'"
            f"{others_text}: masses, shapes and limits are not compared."
        )
        content.ledger.add("audit.not_compared", "error", text, lacking[0], suggestion="give links the robot's names")
        return
    joint_of_ends = {}
    for joint in truth.joints:
        joint_of_ends[frozenset((joint.parent, joint.child))] = joint.names[0]
    joints = dict(assignment)
    for joint in mechanism.joints:
        ends = frozenset((bodies.get(joint.parent, ""), bodies.get(joint.child, "")))
        if len(joint.names) == 1 and not joint.tied and ends in joint_of_ends:
            joints.setdefault(joint.names[0], joint_of_ends[ends])
    content.rename(bodies, joints)
    # The joints of links without a body have no counterpart by name: in a URDF, two such links join the ends of a loop.
    named = {"", *truth.links}
    for i, joint in enumerate(mechanism.joints):
        if not {joint.parent, joint.child} <= named:
            mechanism.joints[i] = replace(joint, names=())
    renamed_links = []
    for link, body in bodies.items():
        if link != body:
            renamed_links.append(f"{link} is {body}")
    text = f"links have other names than in {MECHANISM}: {', '.join(renamed_links)}."
    content.ledger.add("states.names", "info", text)


def _bodies_of_links(links: Mapping[str, Array], truth: FileMechanism, states: SampledStates) -> dict[str, str]:
    """Return {link: body of the mechanism with the same frame at all states}."""
    from_base = poses.inverse(states.links[base_link(truth)])
    bodies: dict[str, str] = {}
    for body in truth.links:
        expected = from_base @ states.links[body]
        for link, T in links.items():
            difference = pose_deviation(np.broadcast_to(T, expected.shape), expected)
            same = difference.distance <= POSITION_TOL and difference.angle <= ROTATION_TOL
            if same and link not in bodies:
                bodies[link] = body
                break
    return bodies
