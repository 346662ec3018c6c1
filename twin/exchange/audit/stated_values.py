"""State the values of all compared quantities of each file: of links, joints, frames, couplings, motors, the world.

A subject such as "joint 'q1'" has values by quantity. A file that does not state a value is not compared; a file that
lists all joints, and lacks one that others have, states that it does not exist.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from twin.exchange.audit.compared_quantities import NOTHING
from twin.exchange.audit.file_content import Content
from twin.exchange.audit.file_joints import ONE_COORDINATE, WORLD, FileJoint
from twin.exchange.audit.file_view import FileView
from twin.exchange.audit.mechanism_data import TOOL, FileMechanism
from twin.exchange.audit.poses import Array
from twin.exchange.audit.reduced_couplings import reduced_couplings
from twin.exchange.audit.reference_joints import (
    known_links_of,
    matching_name,
    reference_joints_of,
    stated_name,
    whole_name,
)
from twin.exchange.audit.value_differences import Value
from twin.exchange.format import Holds
from twin.exchange.formats import is_leading_kind


def state_all(views: Sequence[FileView], contents: Sequence[Content]) -> None:
    """Store the values of all quantities that the files state, and which subjects they lack."""
    for view in views:
        for content in contents:
            if content.file == view.file:
                declared = content.declared or ()
                view.mechanism.links = tuple(dict.fromkeys((*declared, *view.mechanism.links)))
    known_links = known_links_of(views)
    reference_joints = reference_joints_of(views, known_links)
    trocars = set()
    for view in views:
        trocars |= view.mechanism.trocars
    for view in views:
        _state_file(view, reference_joints, known_links, trocars, views)
        if view.holds(Holds.JOINT_TREE) and _is_for_one_motion(view, views):
            _remove_places_on_world(view)
    _state_absent_declarations(views)
    keys = stated_keys(views)
    for view in views:
        listed = _listed_kinds(view.mechanism)
        for subject, name in keys:
            if name != "existence" or not subject.startswith(listed):
                continue
            if view.mechanism.couples_pairs and _couples_several(subject, views):
                continue
            view.values.setdefault((subject, name), False)


_DECLARATIONS = {
    "further declarations": "motion_declarations",
    "declarations of contact or look": "contact_declarations",
    "settings of single programs": "program_settings",
}
"""Quantities of what formats declare beside all others, with the attributes of `FileMechanism`."""


def _state_absent_declarations(views: Sequence[FileView]) -> None:
    """State further declarations as text; files that could hold some and do not state "nothing"."""
    for quantity, attribute in _DECLARATIONS.items():
        subjects: set[str] = set()
        for view in views:
            subjects |= set(getattr(view.mechanism, attribute) or ())
        for view in views:
            declared = getattr(view.mechanism, attribute)
            if declared is None:
                continue
            for subject in sorted(subjects):
                fields = []
                for name, value in declared.get(subject, {}).items():
                    fields.append(f"{name} {value}")
                view.state(subject, {quantity: ", ".join(fields) or NOTHING})


def stated_keys(views: Sequence[FileView]) -> list[tuple[str, str]]:
    """Return (subject, quantity) of all values that files state, in the order of the files."""
    keys: dict[tuple[str, str], None] = {}
    for view in views:
        keys |= dict.fromkeys(view.values)
    return list(keys)


def _is_for_one_motion(view: FileView, views: Sequence[FileView]) -> bool:
    """Return whether a file <robot>_<protocol> stands beside a file <robot> of the same format."""
    for other in views:
        whole = other.file.rsplit(".", 1)[0]
        if other.format == view.format and view.file.startswith(f"{whole}_"):
            return True
    return False


def _remove_places_on_world(view: FileView) -> None:
    """Remove the places of joints on links that are fixed to the world.

    A file for a single motion has other trocar positions; its `play` checks whether the loops close.
    """
    mechanism = view.mechanism
    fixed_links = mechanism.fixed_to_world
    if not fixed_links:  # links that no joint moves
        children = {joint.child for joint in mechanism.joints}
        fixed_links = set(mechanism.links) - children
    endings = tuple(f" on '{link}'" for link in fixed_links)
    for subject, name in list(view.values):
        if name == "place" and subject.endswith(endings):
            del view.values[subject, name]


def _listed_kinds(mechanism: FileMechanism) -> tuple[str, ...]:
    """Return the first words of the subjects of which a file states all that the robot has."""
    kinds = list(mechanism.fully_listed)
    if mechanism.complete:
        kinds += ["joint", "body"]
        if mechanism.all_motors:
            kinds.append("motor")
    if mechanism.couplings is not None:
        kinds.append("coupling")
    return tuple(kinds)


def _couples_several(subject: str, views: Sequence[FileView]) -> bool:
    """Return whether a subject is, in one of the files, a coupling of more than two joints."""
    if not subject.startswith("coupling"):
        return False
    return any(len(view.values.get((subject, "links"), ())) > 2 for view in views)


def _state_file(
    view: FileView,
    reference_joints: Mapping[str, FileJoint],
    known_links: set[str],
    trocars: set[str],
    views: Sequence[FileView],
) -> None:
    """State all values of a file. Reports list quantities in the order in which they are stated here."""
    mechanism = view.mechanism
    immobile_links = mechanism.immobile_links(known_links)
    _state_links(view, known_links, immobile_links)
    _state_joints(view, reference_joints, known_links, trocars)
    _state_frames(view)
    _state_robot_and_postures(view, _is_for_one_motion(view, views))
    _state_world(view, immobile_links)
    for name, (ratios, total) in reduced_couplings(mechanism.couplings or {}).items():
        joints = tuple(sorted(ratios))
        numbers = np.array([ratios[joint] for joint in joints])
        view.state(f"coupling of '{name}'", {"existence": True, "links": joints, "ratios": numbers, "sum": total})
    _state_motors(view)


def _state_frames(view: FileView) -> None:
    mechanism = view.mechanism
    frames = dict(mechanism.frames)
    if mechanism.tool in frames:
        frames.setdefault(TOOL, frames[mechanism.tool])
    for name, frame in frames.items():
        if name == TOOL:
            view.state("the tool frame", {"link": frame.link, "frame pose": frame.T})
        else:
            view.state(f"frame '{name}'", {"existence": True, "link": frame.link, "frame pose": frame.T})
    for name, point in mechanism.points.items():
        view.state(f"point '{name}'", {"existence": True, "link": point.link, "point": point.T[:3, 3]})


def _state_robot_and_postures(view: FileView, is_for_one_motion: bool) -> None:
    """State the names of robot and tool, and the postures; `is_for_one_motion`: see `_is_for_one_motion`."""
    mechanism = view.mechanism
    if mechanism.robot and not is_for_one_motion:
        view.state("the robot", {"robot": mechanism.robot})
    for name, coordinates in (mechanism.postures or {}).items():
        view.state(f"posture '{name}'", {"coordinates": coordinates})
    home_posture = mechanism.home_posture or (mechanism.postures or {}).get("home")
    if home_posture and not view.is_mechanism:
        view.state("posture 'home'", {"home coordinates": home_posture})
    if not is_for_one_motion:  # with other trocars, home is another pose
        for name, coordinate in (mechanism.home or {}).items():
            view.state(f"joint '{name}'", {"home": coordinate})
    if mechanism.postures is not None and mechanism.tool:
        view.state("the robot", {"name of the tool": mechanism.tool})


def _state_world(view: FileView, immobile_links: frozenset[str] | None) -> None:
    mechanism = view.mechanism
    world = {
        "gravity": mechanism.gravity,
        "medium": mechanism.medium,
        "collisions of its own links": mechanism.self_collision,
    }
    view.state("the world", world)
    if immobile_links is not None:
        view.state("the world", {"held": tuple(sorted(immobile_links))})
    view.state("the loops", {"opening": mechanism.opening})


def _state_motors(view: FileView) -> None:
    mechanism = view.mechanism
    for name, motor in (mechanism.motors or {}).items():
        subject = f"motor '{name}'"
        if mechanism.all_motors:
            view.state(subject, {"existence": True})
        values = {
            "row": motor.row,
            "kind": motor.kind,
            "limits": motor.limits,
            "largest effort": motor.effort,
            "largest speed": motor.speed,
            "rotor inertia": motor.inertia,
            "stiffness": motor.stiffness,
            "damping": motor.damping,
            "law": motor.law,
        }
        view.state(subject, values)


def _state_joints(
    view: FileView, reference_joints: Mapping[str, FileJoint], known_links: set[str], trocars: set[str]
) -> None:
    """State the joints between known links, and which of the reference joints a file lacks."""
    mechanism = view.mechanism
    matched_names = set()
    nameless = 0
    for joint in mechanism.joints_between(known_links):
        link_pair = {joint.parent, joint.child}
        if not link_pair <= known_links | {""}:
            continue
        name = matching_name(joint, reference_joints, view)
        if name:
            matched_names.add(name)
            _state_joint(view, name, joint, reference_joints[name], name in trocars)
        elif not joint.names:
            nameless += 1
        elif joint.kind != "fixed" or joint.tied:
            view.state(f"joint '{whole_name(joint)}'", {"existence": True})
    # A GLB states only names of joints, an MJCF has no names for fixed joints.
    names_only = []
    for name, joint in reference_joints.items():
        if name not in matched_names and not joint.kind and not joint.parent:
            names_only.append(name)
    if len(names_only) <= nameless:
        matched_names.update(names_only)
        for name in names_only:
            view.state(f"joint '{name}'", {"existence": True})
    for link in mechanism.load_links(known_links):
        view.state(f"body '{link}'", {"existence": True})
    for joint in mechanism.added_joints(known_links):
        view.state(f"joint '{whole_name(joint)}'", {"existence": True})
    for name, joint in reference_joints.items():
        is_bare = joint.kind == "fixed" and not joint.parent
        if name not in matched_names and not is_bare and _lists_all_of(view, joint):
            view.state(f"joint '{name}'", {"existence": False})


def _lists_all_of(view: FileView, joint: FileJoint) -> bool:
    """Return whether a file would contain a joint if it belonged to the robot."""
    if view.mechanism.complete:
        return True
    if view.holds(Holds.COORDINATES) and is_leading_kind(view.format) and joint.kind in ONE_COORDINATE:
        return True
    return view.holds(Holds.ALL_MOTIONS) and bool(view.mechanism.joints)


def _state_links(view: FileView, known_links: set[str], immobile_links: frozenset[str] | None) -> None:
    """State shapes, colours and masses of the known links; `immobile_links` are those that cannot move."""
    mechanism = view.mechanism
    for link in dict.fromkeys((*mechanism.shown, *view.shapes)):
        if link in known_links:
            view.state(f"link '{link}'", {"shown": mechanism.shown.get(link, True)})
    for link, collides in mechanism.collides.items():
        if link in known_links:
            view.state(f"link '{link}'", {"collides": collides})
    for link, shape in view.shapes.items():
        if link in known_links:
            view.state(f"link '{link}'", {"surface": shape.points})
            # Whether a mesh is closed counts only if the rounding of its points has no influence on it.
            if shape.closed == shape.nearly_closed:
                view.state(f"link '{link}'", {"closed": shape.closed})
    for link, shares in view.colors.items():
        if link in known_links:
            view.state(f"link '{link}'", {"colours": shares})
    for link, shares in view.finishes.items():
        if link in known_links:
            view.state(f"link '{link}'", {"finish": shares})
    for link, share in (mechanism.weight_shares or {}).items():
        if link in known_links:
            view.state(f"link '{link}'", {"weightless": share})
    for link, mass in mechanism.masses.items():
        if link in known_links:
            if link not in mechanism.assumed:
                view.state(f"link '{link}'", {"weighed": True})
            view.state(f"link '{link}'", {"mass": mass.mass, "mass centre": mass.center, "inertia": mass.inertia})
    if view.holds(Holds.MASSES) and mechanism.masses:
        weightless = (known_links & set(mechanism.links)) - set(mechanism.masses) - {WORLD}
        if immobile_links is not None:  # the mass of a link that cannot move has no influence
            weightless -= immobile_links
        for link in sorted(weightless):
            view.state(f"link '{link}'", {"weighed": False})


def _state_joint(view: FileView, name: str, joint: FileJoint, reference: FileJoint, is_trocar: bool) -> None:
    subject = f"joint '{name}'"
    identity: dict[str, Value] = {"existence": True}
    if not joint.stated_kind or joint.names == reference.names:  # else one coordinate of a ball joint, in a track
        if joint.names:
            identity["name"] = stated_name(name, joint)
        if joint.kind:
            identity["kind"] = joint.kind
    if joint.parent:
        identity["links"] = tuple(sorted((joint.parent, joint.child)))
    elif joint.child and reference.parent and joint.child not in (reference.parent, reference.child):
        identity["links"] = (joint.child,)  # the file states one of the two links, and it is neither
    view.state(subject, identity)
    if joint.parent and not joint.kind.startswith(("chain", "free")):
        for link in (joint.parent, joint.child):
            end = joint.end(link)
            if end is not None:
                _state_line(view, f"{subject} on '{link}'", joint, end, is_trocar)
    has_pose = joint.kind in ("fixed", *ONE_COORDINATE) and not joint.tied
    if has_pose and joint.T is not None and joint.parent and not is_trocar:
        # Files may exchange parent and child: the pose is that from the first link in alphabetical order.
        ordered = joint
        if joint.parent >= joint.child:
            ordered = joint.reversed()
        quantity = "pose" if joint.kind == "fixed" else "zero"
        view.state(subject, {quantity: ordered.T})
    if joint.kind == "spherical":
        view.state(subject, {"cone": joint.drive.cone})
        view.state(f"{subject} on '{joint.parent}'", {"axis of its cone": joint.drive.cone_axis})
    if joint.kind in ONE_COORDINATE:
        drive = joint.drive
        if joint.tied:  # a tie is between points, and has no coordinate of its own
            drive = replace(drive, limits=None, soft=None, joint_dynamics=None, control=None)
        values = {
            "limits": drive.limits,
            "soft limits": drive.soft,
            "range of control": drive.control,
            "driven": drive.driven,
            "reduction": _reduction(view.mechanism, joint),
            "passive": drive.joint_dynamics,
            "law": drive.law,
            "breaks": drive.breaks,
            "stiffness": drive.stiffness,
            "damping": drive.damping,
            "largest effort": drive.effort,
            "largest speed": drive.speed,
            "largest acceleration": drive.acceleration,
            "largest jerk": drive.jerk,
        }
        view.state(subject, values)


def _state_line(
    view: FileView, subject: str, joint: FileJoint, end: tuple[Array, Array | None], is_trocar: bool
) -> None:
    """State the place and the direction of a joint's axis on one of its links."""
    _, direction = end
    if joint.kind != "prismatic" and not is_trocar:  # a slide has a direction, but no place
        view.state(subject, {"place": end})
    if direction is not None:
        view.state(subject, {"axis": (direction, not joint.tied)})


def _reduction(mechanism: FileMechanism, joint: FileJoint) -> float | None:
    """Return motor coordinate / joint coordinate of a joint with a motor of its own; None if it is not stated.

    In files with all motors, driven joints without one have the drive at the joint, which is a reduction of 1.
    """
    name = joint.names[0] if len(joint.names) == 1 else ""
    if mechanism.reductions is not None:
        return mechanism.reductions.get(name)
    if not mechanism.all_motors or mechanism.motors is None or not joint.drive.driven:
        return None
    rows = []
    for motor in mechanism.motors.values():
        if motor.row and name in motor.row:
            rows.append(motor.row)
    if not rows:
        return 1.0
    if len(rows) > 1 or len(rows[0]) > 1:  # several motors move the joint, or the motor moves several joints
        return None
    return rows[0][name]
