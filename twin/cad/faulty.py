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
from twin.cad.frames import DrawnFrames, Faces, Given, drawn
from twin.cad.lengths import measure, pair
from twin.cad.step import Face
from twin.core import spatial
from twin.core.errors import CadError
from twin.core.spatial import Array
from twin.core.units import DEG, MM, UM, decimals

_LEVER = 0.1
"""Length in m by which angles are multiplied to compare them with offsets."""

_STEPS = 5
"""Number of Newton steps that correct the position of a feature; the first step is nearly exact."""

_ENTRIES = ("origin", "at", "z", "x_along", "x_towards", "y_towards")
"""Entries of a frame that name features."""

_COAXIAL = 1e-7
"""Maximum distance in m, and maximum sine of the angle, between the axes of two cylinders that count as coaxial."""


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
    given: Given = field(default_factory=dict)

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
    d = cad.description
    open_joints = _open_joints(d, drawn(d, cad.measured))
    found = []
    for body, names, joint in _candidates(cad, open_joints):
        suspect = _suspect(cad, body, names, joint, open_joints)
        if suspect is not None:
            found.append(suspect)
    faults = []
    unexplained = list(open_joints)
    while unexplained:
        # Without a suspect that explains them, each joint is a fault of its own.
        joints = _most_explained(found, unexplained) or (unexplained[0],)
        suspects = []
        for suspect in _plainest([s for s in found if s.joints == joints], _placed(d)):
            suspects.append(_weighed(cad, suspect, nominal or {}))
        suspects.sort(key=lambda s: -s.score)
        faults.append(FrameMismatch(joints, tuple(suspects)))
        unexplained = [joint for joint in unexplained if joint not in joints]
    return faults


def _most_explained(suspects: list[Suspect], joints: list[str]) -> tuple[str, ...]:
    """Return the largest set of `joints` that one suspect explains; () if no suspect explains any."""
    most: tuple[str, ...] = ()
    for suspect in suspects:
        if set(suspect.joints) <= set(joints) and len(suspect.joints) > len(most):
            most = suspect.joints
    return most


def _open_joints(d: Description, at: DrawnFrames) -> list[str]:
    """Return the names of the joints whose two frames do not coincide."""
    return list(dict.fromkeys(finding.where for finding in meeting.meetings(d, at)))


def _plainest(suspects: list[Suspect], placed: set[tuple[str, str]]) -> list[Suspect]:
    """Return, for each part, the suspects with the fewest features, and suspects that can be distinguished from these.

    A suspect with more features can be distinguished, by comparison with the equations, if one of the additional
    features defines a named frame or point.
    """
    fewest: dict[str, int] = {}
    for suspect in suspects:
        if suspect.features:  # without features, the placement of the whole part is wrong
            count = len(suspect.features)
            fewest[suspect.body] = min(count, fewest.get(suspect.body, count))
    plain = [s for s in suspects if not s.features or len(s.features) == fewest[s.body]]
    plain_features: set[tuple[str, str]] = set()
    for suspect in plain:
        plain_features |= _features(suspect)
    others = [s for s in suspects if s not in plain and (_features(s) - plain_features) & placed]
    return plain + others


def _features(suspect: Suspect) -> set[tuple[str, str]]:
    """Return the features of a suspect as (body, name)."""
    return {(suspect.body, name) for name in suspect.features}


def _placed(d: Description) -> set[tuple[str, str]]:
    """Return the features that define named frames and points, each as (body, name)."""
    placed = set()
    for frame in d.frame.values():
        for name in frame.at.features(*_ENTRIES):
            placed.add((frame.body, name))
    for point in d.point.values():
        for name in (point.origin, point.at):
            if name:
                placed.add((point.body, name))
    return placed


# -- candidates --------------------------------------------------------------------------------------------------


def _candidates(cad: CadModel, open_joints: list[str]) -> Iterator[tuple[str, tuple[str, ...], str]]:
    """Yield candidates (part, features, joint).

    (part, features, ""): the features may be wrong together. (part, (), joint): the given frame of the joint may be
    wrong. (part, (), ""): the placement of the whole part may be wrong.
    """
    d = cad.description
    seen: set[tuple[str, tuple[str, ...]]] = set()
    for joint in d.joint:
        if joint.name not in open_joints:
            continue
        for body, spec in joint.sides:
            if spec.position_mm is not None:
                yield body, (), joint.name
            own = cad.measured.get(body, {})
            names = spec.features(*_ENTRIES)
            groups = [(name,) for name in names]
            groups += [_on_axis(own, name) for name in names]
            groups += [spec.features("origin", "at"), ()]
            for group in groups:
                # The base is the world of all other parts: its placement cannot be wrong.
                if (body, group) not in seen and not (group == () and body == d.base):
                    seen.add((body, group))
                    yield body, group, ""


def _on_axis(own: Mapping[str, MeasuredFeature], name: str) -> tuple[str, ...]:
    """Return the cylinders of a part that are coaxial with the feature `name` and may be misplaced together with it."""
    cylinder = own[name].face
    coaxial = []
    for other, measured in own.items():
        if cylinder.kind == "cylinder" and measured.face.kind == "cylinder" and _coaxial(measured.face, cylinder):
            coaxial.append(other)
    return tuple(coaxial) or (name,)


def _coaxial(a: Face, b: Face) -> bool:
    sine = np.linalg.norm(np.cross(a.direction, b.direction))
    if not sine < _COAXIAL:
        return False
    return bool(spatial.point_to_line(a.point, b.point, b.direction) < _COAXIAL)


def _least(misfit: Callable[[Array], Array]) -> Array:
    """Return the twist (6,) at which `misfit` is least, by Gauss-Newton steps with central differences."""
    x = np.zeros(6)
    for _ in range(_STEPS):
        columns = []
        for step in 1e-6 * np.eye(6):
            columns.append((misfit(x + step) - misfit(x - step)) / 2e-6)
        J = np.stack(columns, axis=1)
        x = x - np.linalg.pinv(J, rcond=1e-5) @ misfit(x)
    return x


def _suspect(cad: CadModel, body: str, names: tuple[str, ...], typed: str, open_joints: list[str]) -> Suspect | None:
    """Return a part as a suspect, with features moved so that the frames of its joints coincide; None if impossible.

    Args:
        cad: the CAD model.
        body: the part.
        names: the features that may move; empty: all features of the part.
        typed: a joint whose frame on the part is given by numbers: this frame is moved instead of features; else "".
        open_joints: joints whose two frames do not coincide.
    """
    d = cad.description
    still = drawn(d, cad.measured).on
    own = cad.measured.get(body, {})
    moving = names or tuple(own)
    if typed:
        moving = ()
    users = _users(d, body, names, typed)
    if not (moving or typed) or not any(joint.name in open_joints for joint in users):
        return None
    given = np.eye(4)
    if typed:
        on_parent, on_child = still[typed]
        given = on_parent if users[0].parent == body else on_child
    centre = given[:3, 3]
    if moving:
        centre = np.mean([own[name].face.point for name in moving], axis=0)

    def put(twist: Array) -> tuple[dict[str, MeasuredFeature], dict[tuple[str, str], Array]]:
        """Return the features and the given frames of the part, moved by a twist about the centre."""
        T = spatial.pose(spatial.exp_so3(twist[3:] / _LEVER), twist[:3])
        T[:3, 3] += centre - T[:3, :3] @ centre
        faces = dict(own)
        for name in moving:
            faces[name] = _moved(own[name], T)
        frames = {(typed, body): T @ given} if typed else {}
        return faces, frames

    def misfit(twist: Array) -> Array:
        """Return the offsets in m, and the angles times the lever, of the joints of the part."""
        faces, frames = put(twist)
        parts = []
        for joint in users:
            on = []
            for i, (side, spec) in enumerate(joint.sides):
                if side != body:
                    on.append(still[joint.name][i])
                elif (joint.name, side) in frames:
                    on.append(frames[joint.name, side])
                else:
                    on.append(features.frame(spec, faces))
            offset, turn = meeting.locked(spatial.inverse(on[0]) @ on[1], joint.type)
            parts += [offset, _LEVER * turn]
        return np.concatenate(parts)

    try:
        x = _least(misfit)
        faces, frames = put(x)
        corrected = {**cad.measured, body: faces}
        still_open = _open_joints(d, drawn(d, corrected, frames))
    except (CadError, np.linalg.LinAlgError):
        return None
    used = {joint.name for joint in users}
    if used & set(still_open):
        return None
    joints = tuple(joint for joint in open_joints if joint in used)
    offset = float(np.linalg.norm(x[:3]))
    tilt = float(np.linalg.norm(x[3:]) / _LEVER)
    return Suspect(body, names, joints, offset, tilt, corrected, given=frames)


def _users(d: Description, body: str, names: tuple[str, ...], typed: str) -> list[JointSpec]:
    """Return the joints of a part whose frames move with the features `names`, or with the given frame of `typed`."""
    users = []
    for joint in d.joint:
        for side, spec in joint.sides:
            if side == body and _uses(joint.name, spec, names, typed):
                users.append(joint)
    return users


def _uses(joint: str, spec: FrameSpec, names: tuple[str, ...], typed: str) -> bool:
    """Return whether the frame of a joint moves with the features `names`, or with the given frame of joint `typed`."""
    if typed:
        return joint == typed
    return not names or bool(set(names) & set(spec.features(*_ENTRIES)))


def _moved(m: MeasuredFeature, T: Array) -> MeasuredFeature:
    R = T[:3, :3]
    return replace(m, face=replace(m.face, point=R @ m.face.point + T[:3, 3], direction=R @ m.face.direction),
                   direction=R @ m.direction)  # fmt: skip


# -- evidence in the drawing -----------------------------------------------------------------------------------------


def _weighed(cad: CadModel, s: Suspect, nominal: Mapping[str, float]) -> Suspect:
    for_it = []
    against_it = []
    for equal, text in (*_lengths(cad, s, nominal), *_alike(cad, s)):
        if equal:
            for_it.append(text)
        else:
            against_it.append(text)
    return replace(s, for_it=tuple(for_it), against_it=tuple(against_it))


def _lengths(cad: CadModel, s: Suspect, nominal: Mapping[str, float]) -> Iterator[tuple[bool, str]]:
    """Yield (equal, text) for each length that equals its value elsewhere only before, or only after, the correction.

    `equal`: whether the length is equal after the correction. Elsewhere: on other parts, and in `nominal`.
    """
    limit = cad.description.tolerance.meeting_um * UM
    try:
        before = measure(cad)
        after = measure(replace(cad, measured=s.faces))  # type: ignore[arg-type]
    except CadError:  # the distance between tilted axes is undefined
        return
    for i, (length, corrected) in enumerate(zip(before, after, strict=True)):
        if length.body != s.body:
            continue
        others = [o.value for k, o in enumerate(before) if o.parameter == length.parameter and k != i]
        if length.parameter in nominal:
            others.append(nominal[length.parameter])
        if not others:
            continue
        true = float(np.median(others))
        equal_before = abs(length.value - true) <= limit
        equal_after = abs(corrected.value - true) <= limit
        if equal_before == equal_after:
            continue
        if equal_after:
            text = f"{length.parameter} on '{s.body}' measures {_compared_mm(length.value, true)}"
        else:
            text = f"{length.parameter} on '{s.body}' would measure {_compared_mm(corrected.value, true)}"
        yield equal_after, text


def _compared_mm(value: float, true: float) -> str:
    n = decimals(abs(value - true) / MM)
    return f"{value / MM:.{n}f} mm; in other places, this length is {true / MM:.{n}f} mm"


def _alike(cad: CadModel, s: Suspect) -> Iterator[tuple[bool, str]]:
    """Yield (equal, text) if the part equals one with the same features only before, or only after, the correction."""
    measured = cad.measured
    kinds = _kinds(measured[s.body]) if s.body in measured else {}
    twins = [body for body in measured if body != s.body and _kinds(measured[body]) == kinds]
    if not twins or not s.features:
        return
    before = [body for body in twins if _same(cad, measured[s.body], measured[body], s.features)]
    after = [body for body in twins if _same(cad, s.faces[s.body], measured[body], s.features)]
    if after and not before:
        yield True, f"'{s.body}' differs from {_quoted(after)}"
    elif before and not after:
        yield False, f"'{s.body}' equals {_quoted(before)}"


def _kinds(measured: Mapping[str, MeasuredFeature]) -> dict[str, tuple[str, float]]:
    """Return {feature: (kind, radius in m)}."""
    return {name: (m.face.kind, round(m.face.radius, 6)) for name, m in measured.items()}


def _quoted(names: Iterable[str]) -> str:
    return ", ".join(f"'{name}'" for name in names)


def _same(
    cad: CadModel, a: Mapping[str, MeasuredFeature], b: Mapping[str, MeasuredFeature], names: Iterable[str]
) -> bool:
    limits = np.array([cad.description.tolerance.meeting_deg * DEG, cad.description.tolerance.meeting_um * UM])
    for name in names:
        for other in a:
            if other == name:
                continue
            difference = np.abs(np.array(pair(a[name], a[other])) - np.array(pair(b[name], b[other])))
            defined = np.isfinite(difference)  # parallel axes have no distance along them
            if (difference[defined] > limits[defined]).any():
                return False
    return True
