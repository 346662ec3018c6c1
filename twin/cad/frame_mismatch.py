"""Find the wrong part if the two frames of a joint (one on each part) do not coincide in the CAD.

A feature (a face of a part that defines a joint) is a suspect if a displacement of this feature alone makes the two
frames of every joint that uses the feature coincide. Often the CAD contains evidence for or against a suspect: lengths
that several parts have in common, and identical parts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from twin.cad import features, meeting
from twin.cad.build import CadModel
from twin.cad.description import Description, FrameSpec, JointSpec
from twin.cad.features import MeasuredFeature
from twin.cad.frames import DrawnFrames, Faces, GivenFrames, drawn
from twin.cad.lengths import angle_and_distance, measured_lengths
from twin.cad.step import Face
from twin.core import spatial
from twin.core.errors import CadError
from twin.core.spatial import Array
from twin.core.units import DEG, MM, UM, decimals

_LEVER = 0.1
"""Length in m by which angles are multiplied to compare them with offsets."""

_NEWTON_STEPS = 5
"""Number of Newton steps that correct the position of a feature; the first step is nearly exact."""

_FEATURE_ENTRIES = ("origin", "at", "z", "x_along", "x_towards", "y_towards")
"""Entries of a frame that name features."""

_COAXIAL_LIMIT = 1e-7
"""Maximum distance in m, and maximum sine of the angle, between the axes of two cylinders that count as coaxial."""

_DIFFERENCE_STEP = 1e-6
"""Step in m of the central differences, for translations and for rotations times the lever."""

_RANK_RATIO = 1e-5
"""Singular values below this fraction of the largest one count as 0: such a motion moves no joint of the part."""


@dataclass(frozen=True, eq=False)
class Suspect:
    """A part that may be faulty.

    Attributes:
        body: name of the part.
        features: names of the faulty features; empty if only the placement of the part is wrong.
        joints: the joints whose two frames coincide after the correction.
        offset, tilt: position error in m and orientation error in rad of the features.
        faces: every feature of every part, with the faulty features corrected.
        given: corrected frames by (joint, part), only for frames that the description gives by numbers.
        for_it, against_it: texts of the evidence in the CAD for and against this suspect.
    """

    body: str
    features: tuple[str, ...]
    joints: tuple[str, ...]
    offset: float
    tilt: float
    faces: Faces
    for_it: tuple[str, ...] = ()
    against_it: tuple[str, ...] = ()
    given: GivenFrames = field(default_factory=dict)

    @property
    def score(self) -> int:
        """Number of entries in `for_it` minus number of entries in `against_it`."""
        return len(self.for_it) - len(self.against_it)


@dataclass(frozen=True)
class FrameMismatch:
    """Joints whose two frames do not coincide, and the suspects (none if no single part explains the fault)."""

    joints: tuple[str, ...]
    suspects: tuple[Suspect, ...]


def faults(cad: CadModel, nominal: Mapping[str, float] | None = None) -> list[FrameMismatch]:
    """Return the faults of a CAD model, each with its suspects, the most likely first.

    `nominal` is {parameter name in the description: length in m from another source}; it may be incomplete.
    """
    description = cad.description
    open_joints = _open_joints(description, drawn(description, cad.measured))
    suspects = []
    for body, names, joint in _candidates(cad, open_joints):
        suspect = _suspect(cad, body, names, joint, open_joints)
        if suspect is not None:
            suspects.append(suspect)
    defining_frames = _features_of_frames_and_points(description)
    faults = []
    unexplained = list(open_joints)
    while unexplained:
        # Without a suspect that explains them, each joint is a fault of its own.
        joints = _most_explained(suspects, unexplained) or (unexplained[0],)
        suspects_of_joints = [suspect for suspect in suspects if suspect.joints == joints]
        with_evidence = []
        for suspect in _distinguishable(suspects_of_joints, defining_frames):
            with_evidence.append(_with_evidence(cad, suspect, nominal or {}))
        with_evidence.sort(key=lambda suspect: -suspect.score)
        faults.append(FrameMismatch(joints, tuple(with_evidence)))
        unexplained = [joint for joint in unexplained if joint not in joints]
    return faults


def _most_explained(suspects: list[Suspect], joints: list[str]) -> tuple[str, ...]:
    """Return the largest set of `joints` that one suspect explains; () if no suspect explains any."""
    most: tuple[str, ...] = ()
    for suspect in suspects:
        if set(suspect.joints) <= set(joints) and len(suspect.joints) > len(most):
            most = suspect.joints
    return most


def _open_joints(description: Description, drawn_frames: DrawnFrames) -> list[str]:
    """Return the names of the joints whose two frames do not coincide."""
    findings = meeting.meetings(description, drawn_frames)
    return list(dict.fromkeys(finding.where for finding in findings))  # a joint may be offset and tilted


def _distinguishable(suspects: list[Suspect], defining_frames: set[tuple[str, str]]) -> list[Suspect]:
    """Return, for each part, the suspects with the fewest features, and suspects that can be distinguished from these.

    A suspect with more features can be distinguished, by comparison with the equations, if one of the additional
    features defines a named frame or point; `defining_frames` are the features that do, as (body, name).
    """
    fewest: dict[str, int] = {}
    for suspect in suspects:
        if suspect.features:  # without features, the placement of the whole part is wrong
            count = len(suspect.features)
            fewest[suspect.body] = min(count, fewest.get(suspect.body, count))
    plain = []
    more_features = []
    for suspect in suspects:
        if not suspect.features or len(suspect.features) == fewest[suspect.body]:
            plain.append(suspect)
        else:
            more_features.append(suspect)
    plain_features: set[tuple[str, str]] = set()
    for suspect in plain:
        plain_features |= _features(suspect)
    for suspect in more_features:
        additional = _features(suspect) - plain_features
        if additional & defining_frames:
            plain.append(suspect)
    return plain


def _features(suspect: Suspect) -> set[tuple[str, str]]:
    """Return the features of a suspect as (body, name)."""
    return {(suspect.body, name) for name in suspect.features}


def _features_of_frames_and_points(description: Description) -> set[tuple[str, str]]:
    """Return the features that define named frames and points, each as (body, name)."""
    features_of_frames = set()
    for frame in description.frame.values():
        for name in frame.at.features(*_FEATURE_ENTRIES):
            features_of_frames.add((frame.body, name))
    for point in description.point.values():
        for name in (point.origin, point.at):
            if name:
                features_of_frames.add((point.body, name))
    return features_of_frames


# -- candidates --------------------------------------------------------------------------------------------------


def _candidates(cad: CadModel, open_joints: list[str]) -> Iterator[tuple[str, tuple[str, ...], str]]:
    """Yield candidates (part, features, joint).

    (part, features, ""): the features may be wrong together. (part, (), joint): the given frame of the joint may be
    wrong. (part, (), ""): the placement of the whole part may be wrong.
    """
    description = cad.description
    yielded: set[tuple[str, tuple[str, ...]]] = set()
    for joint in description.joint:
        if joint.name not in open_joints:
            continue
        for body, spec in joint.sides:
            if spec.position_mm is not None:
                yield body, (), joint.name
            for group in _feature_groups(cad.measured.get(body, {}), spec):
                # The base is the world of all other parts: its placement cannot be wrong.
                is_base = group == () and body == description.base
                if (body, group) not in yielded and not is_base:
                    yielded.add((body, group))
                    yield body, group, ""


def _feature_groups(features_of_part: Mapping[str, MeasuredFeature], spec: FrameSpec) -> list[tuple[str, ...]]:
    """Return the groups of a part's features that may be wrong together at one of its frames; (): the whole part."""
    names = spec.features(*_FEATURE_ENTRIES)
    groups: list[tuple[str, ...]] = []
    for name in names:
        groups.append((name,))
    for name in names:  # bores on one axis may be misplaced together
        groups.append(_coaxial_features(features_of_part, name))
    groups.append(spec.features("origin", "at"))
    groups.append(())
    return groups


def _coaxial_features(features_of_part: Mapping[str, MeasuredFeature], name: str) -> tuple[str, ...]:
    """Return the cylinders of a part that are coaxial with the feature `name` and may be misplaced together with it."""
    cylinder = features_of_part[name].face
    if cylinder.kind != "cylinder":
        return (name,)
    coaxial = []
    for other_name, measured in features_of_part.items():
        if measured.face.kind == "cylinder" and _are_coaxial(measured.face, cylinder):
            coaxial.append(other_name)
    return tuple(coaxial) or (name,)


def _are_coaxial(first: Face, second: Face) -> bool:
    """Return whether two cylinders have one axis; False if a direction is not a number."""
    sine = np.linalg.norm(np.cross(first.direction, second.direction))
    if not sine < _COAXIAL_LIMIT:
        return False
    return bool(spatial.point_to_line(first.point, second.point, second.direction) < _COAXIAL_LIMIT)


def _least_misfit(misfit: Callable[[Array], Array]) -> Array:
    """Return the twist (6,) at which `misfit` is least, by Gauss-Newton steps with central differences."""
    twist = np.zeros(6)
    for _ in range(_NEWTON_STEPS):
        columns = []
        for step in _DIFFERENCE_STEP * np.eye(6):
            columns.append((misfit(twist + step) - misfit(twist - step)) / (2 * _DIFFERENCE_STEP))
        J = np.stack(columns, axis=1)
        twist = twist - np.linalg.pinv(J, rcond=_RANK_RATIO) @ misfit(twist)
    return twist


def _suspect(
    cad: CadModel, body: str, names: tuple[str, ...], given_joint: str, open_joints: list[str]
) -> Suspect | None:
    """Return a part as a suspect, with features moved so that the frames of its joints coincide; None if impossible.

    Args:
        cad: the CAD model.
        body: the part.
        names: the features that may move; empty: all features of the part.
        given_joint: a joint whose frame on the part is given by numbers: this frame is moved instead of features;
            else "".
        open_joints: joints whose two frames do not coincide.
    """
    description = cad.description
    drawn_frames = drawn(description, cad.measured).on
    features_of_part = cad.measured.get(body, {})
    moving = names or tuple(features_of_part)
    if given_joint:
        moving = ()
    users = _users(description, body, names, given_joint)
    user_names = {joint.name for joint in users}
    if not (moving or given_joint) or user_names.isdisjoint(open_joints):
        return None
    T_given = np.eye(4)  # the frame given by numbers, in drawn coordinates
    if given_joint:
        on_parent, on_child = drawn_frames[given_joint]
        T_given = on_parent if users[0].parent == body else on_child
    centre = T_given[:3, 3]
    if moving:  # about their middle, the translation of the twist is the displacement of the features
        centre = np.mean([features_of_part[name].face.point for name in moving], axis=0)

    def displaced(twist: Array) -> tuple[dict[str, MeasuredFeature], dict[tuple[str, str], Array]]:
        """Return the features and the given frames of the part, moved by a twist about the centre."""
        T = spatial.pose(spatial.exp_so3(twist[3:] / _LEVER), twist[:3])
        T[:3, 3] += centre - T[:3, :3] @ centre
        faces = dict(features_of_part)
        for name in moving:
            faces[name] = _displaced_feature(features_of_part[name], T)
        frames = {}
        if given_joint:
            frames[given_joint, body] = T @ T_given
        return faces, frames

    def misfit(twist: Array) -> Array:
        """Return the offsets in m, and the angles times the lever, of the joints of the part."""
        faces, frames = displaced(twist)
        parts = []
        for joint in users:
            sides = []  # the frames on the parent and on the child
            for i, (side, spec) in enumerate(joint.sides):
                if side != body:
                    sides.append(drawn_frames[joint.name][i])
                elif (joint.name, side) in frames:
                    sides.append(frames[joint.name, side])
                else:
                    sides.append(features.frame(spec, faces))
            on_parent, on_child = sides
            offset, turn = meeting.locked_gap(spatial.inverse(on_parent) @ on_child, joint.type)
            parts += [offset, _LEVER * turn]
        return np.concatenate(parts)

    try:
        twist = _least_misfit(misfit)
        faces, frames = displaced(twist)
        corrected = {**cad.measured, body: faces}
        still_open = _open_joints(description, drawn(description, corrected, frames))
    except (CadError, np.linalg.LinAlgError):
        return None
    if not user_names.isdisjoint(still_open):
        return None
    joints = tuple(joint for joint in open_joints if joint in user_names)
    offset = float(np.linalg.norm(twist[:3]))
    tilt = float(np.linalg.norm(twist[3:]) / _LEVER)
    return Suspect(body, names, joints, offset, tilt, corrected, given=frames)


def _users(description: Description, body: str, names: tuple[str, ...], given_joint: str) -> list[JointSpec]:
    """Return the joints of a part whose frames move with the features `names`, or with the frame of `given_joint`."""
    users = []
    for joint in description.joint:
        for side, spec in joint.sides:
            if side == body and _uses(joint.name, spec, names, given_joint):
                users.append(joint)
    return users


def _uses(joint: str, spec: FrameSpec, names: tuple[str, ...], given_joint: str) -> bool:
    """Return whether the frame of a joint moves with the features `names`, or with the frame of `given_joint`."""
    if given_joint:
        return joint == given_joint
    return not names or bool(set(names) & set(spec.features(*_FEATURE_ENTRIES)))


def _displaced_feature(feature: MeasuredFeature, T: Array) -> MeasuredFeature:
    """Return a feature moved by T (4, 4), in drawn coordinates."""
    R = T[:3, :3]
    point = R @ feature.face.point + T[:3, 3]
    face = replace(feature.face, point=point, direction=R @ feature.face.direction)
    return replace(feature, face=face, direction=R @ feature.direction)


# -- evidence in the drawing -----------------------------------------------------------------------------------------


def _with_evidence(cad: CadModel, suspect: Suspect, nominal: Mapping[str, float]) -> Suspect:
    """Return a suspect with the evidence for and against it."""
    for_it = []
    against_it = []
    for equal, text in (*_length_evidence(cad, suspect, nominal), *_equal_part_evidence(cad, suspect)):
        if equal:
            for_it.append(text)
        else:
            against_it.append(text)
    return replace(suspect, for_it=tuple(for_it), against_it=tuple(against_it))


def _length_evidence(cad: CadModel, suspect: Suspect, nominal: Mapping[str, float]) -> Iterator[tuple[bool, str]]:
    """Yield (equal, text) for each length that equals its value elsewhere only before, or only after, the correction.

    `equal`: whether the length is equal after the correction. Elsewhere: on other parts, and in `nominal`.
    """
    limit = cad.description.tolerance.meeting_um * UM
    try:
        before = measured_lengths(cad)
        after = measured_lengths(replace(cad, measured=suspect.faces))  # type: ignore[arg-type]
    except CadError:  # the distance between tilted axes is undefined
        return
    for index, (length, corrected) in enumerate(zip(before, after, strict=True)):
        if length.body != suspect.body:
            continue
        others = []
        for other_index, other in enumerate(before):
            if other.parameter == length.parameter and other_index != index:
                others.append(other.value)
        if length.parameter in nominal:
            others.append(nominal[length.parameter])
        if not others:
            continue
        elsewhere = float(np.median(others))
        equal_before = abs(length.value - elsewhere) <= limit
        equal_after = abs(corrected.value - elsewhere) <= limit
        if equal_before == equal_after:
            continue
        if equal_after:
            text = f"{length.parameter} on '{suspect.body}' measures {_compared_mm(length.value, elsewhere)}"
        else:
            text = f"{length.parameter} on '{suspect.body}' would measure {_compared_mm(corrected.value, elsewhere)}"
        yield equal_after, text


def _compared_mm(value: float, elsewhere: float) -> str:
    """Return a text with two lengths in m, with enough decimals to tell them apart."""
    digits = decimals(abs(value - elsewhere) / MM)
    return f"{value / MM:.{digits}f} mm; in other places, this length is {elsewhere / MM:.{digits}f} mm"


def _equal_part_evidence(cad: CadModel, suspect: Suspect) -> Iterator[tuple[bool, str]]:
    """Yield (equal, text) if the part equals one with the same features only before, or only after, the correction."""
    measured = cad.measured
    if not suspect.features or suspect.body not in measured:
        return
    kinds = _kinds(measured[suspect.body])
    before = []
    after = []
    for body, other_features in measured.items():
        if body == suspect.body or _kinds(other_features) != kinds:
            continue
        if _have_same_gaps(cad, measured[suspect.body], other_features, suspect.features):
            before.append(body)
        if _have_same_gaps(cad, suspect.faces[suspect.body], other_features, suspect.features):
            after.append(body)
    if after and not before:
        yield True, f"'{suspect.body}' differs from {_quoted(after)}"
    elif before and not after:
        yield False, f"'{suspect.body}' equals {_quoted(before)}"


def _kinds(measured: Mapping[str, MeasuredFeature]) -> dict[str, tuple[str, float]]:
    """Return {feature: (kind, radius in m, rounded to 1 µm)}."""
    kinds: dict[str, tuple[str, float]] = {}
    for name, feature in measured.items():
        kinds[name] = (feature.face.kind, round(feature.face.radius, 6))
    return kinds


def _quoted(names: Iterable[str]) -> str:
    return ", ".join(f"'{name}'" for name in names)


def _have_same_gaps(
    cad: CadModel, first: Mapping[str, MeasuredFeature], second: Mapping[str, MeasuredFeature], names: Iterable[str]
) -> bool:
    """Return whether the features `names` have the same angles and distances to all others of their part in a and b."""
    tolerance = cad.description.tolerance
    limits = np.array([tolerance.meeting_deg * DEG, tolerance.meeting_um * UM])
    for name in names:
        for other_name in first:
            if other_name == name:
                continue
            # (angle, distance)
            pair_a = np.array(angle_and_distance(first[name], first[other_name]))
            pair_b = np.array(angle_and_distance(second[name], second[other_name]))
            difference = np.abs(pair_a - pair_b)
            is_defined = np.isfinite(difference)  # parallel axes have no distance along them
            if (difference[is_defined] > limits[is_defined]).any():
                return False
    return True
