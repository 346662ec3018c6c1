"""Find the wrong part if the two frames of a joint (one on each part) do not coincide in the CAD.

A feature (a face of a part that defines a joint) is a suspect if a displacement of this feature alone makes the two
frames of every joint that uses the feature coincide. Often the CAD contains evidence for or against a suspect: lengths
that several parts have in common, and identical parts.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from twin.cad import features, meeting
from twin.cad.build import CadModel
from twin.cad.description import Description
from twin.cad.features import Measured
from twin.cad.frames import Drawn, Faces, Given, drawn
from twin.cad.lengths import measure, pair
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
class Fault:
    """Joints whose two frames do not coincide, and the suspects (none if no single part explains the fault)."""

    joints: tuple[str, ...]
    suspects: tuple[Suspect, ...]


def faults(cad: CadModel, nominal: Mapping[str, float] | None = None) -> list[Fault]:
    """Return the faults of a CAD model, each with its suspects, the most likely first.

    `nominal` is {parameter name in the description: length in m from another source}; it may be incomplete.
    """
    d = cad.description
    bad = _apart(d, drawn(d, cad.measured))
    found = [s for c in _candidates(cad, bad) if (s := _suspect(cad, *c, bad)) is not None]
    out, left = [], list(bad)
    while left:
        best = max((s.joints for s in found if set(s.joints) <= set(left)), key=len, default=(left[0],))
        mine = _plainest([s for s in found if s.joints == best], _placed(d))
        mine = [_weighed(cad, s, nominal or {}) for s in mine]
        out.append(Fault(best, tuple(sorted(mine, key=lambda s: -s.score))))
        left = [j for j in left if j not in best]
    return out


def _apart(d: Description, at: Drawn) -> list[str]:
    """Return the names of the joints whose two frames do not coincide."""
    return list(dict.fromkeys(f.where for f in meeting.meetings(d, at)))


def _plainest(suspects: list[Suspect], placed: set[tuple[str, str]]) -> list[Suspect]:
    """Return, for each part, the suspects with the fewest features, and suspects that can be distinguished from these.

    A suspect with more features can be distinguished, by comparison with the equations, if one of the additional
    features defines a named frame or point.
    """
    few = {s.body: min(len(o.features) or 99 for o in suspects if o.body == s.body) for s in suspects}
    plain = [s for s in suspects if not s.features or len(s.features) == few[s.body]]
    alone = {(s.body, n) for s in plain for n in s.features}
    return plain + [s for s in suspects if s not in plain and ({(s.body, n) for n in s.features} - alone) & placed]


def _placed(d: Description) -> set[tuple[str, str]]:
    """Return the features that define named frames and points, each as (body, name)."""
    frames = {(f.body, n) for f in d.frame.values() for n in f.at.features(*_ENTRIES)}
    points = {(p.body, n) for p in d.point.values() for n in (p.origin, p.at) if n}
    return frames | points


# -- candidates --------------------------------------------------------------------------------------------------


def _candidates(cad: CadModel, bad: list[str]) -> Iterator[tuple[str, tuple[str, ...], str]]:
    """Yield candidates (part, features, joint).

    (part, features, ""): the features may be wrong together. (part, (), joint): the given frame of the joint may be
    wrong. (part, (), ""): the placement of the whole part may be wrong.
    """
    d = cad.description
    seen: set[tuple[str, tuple[str, ...]]] = set()
    for joint in (j for j in d.joint if j.name in bad):
        for body, spec in joint.sides:
            if spec.position_mm is not None:
                yield body, (), joint.name
            own = cad.measured.get(body, {})
            every = spec.features(*_ENTRIES)
            axes = (_on_axis(own, n) for n in every)
            for names in (*((n,) for n in every), *axes, spec.features("origin", "at"), ()):
                if (body, names) not in seen and not (names == () and body == d.base):
                    seen.add((body, names))
                    yield body, names, ""


def _on_axis(own: Mapping[str, Measured], name: str) -> tuple[str, ...]:
    """Return the cylinders of a part that are coaxial with the feature `name` and may be misplaced together with it."""
    a = own[name].face
    return tuple(
        n
        for n, m in own.items()
        if m.face.kind == a.kind == "cylinder"
        and np.linalg.norm(np.cross(m.face.direction, a.direction)) < _COAXIAL
        and spatial.point_to_line(m.face.point, a.point, a.direction) < _COAXIAL
    ) or (name,)


def _suspect(cad: CadModel, body: str, names: tuple[str, ...], typed: str, bad: list[str]) -> Suspect | None:
    """Return a part as a suspect, with features moved so that the frames of its joints coincide; None if impossible.

    Args:
        cad: the CAD model.
        body: the part.
        names: the features that may move; empty: all features of the part.
        typed: a joint whose frame on the part is given by numbers: this frame is moved instead of features; else "".
        bad: joints whose two frames do not coincide.
    """
    d, still = cad.description, drawn(cad.description, cad.measured).on
    own = cad.measured.get(body, {})
    moving = () if typed else names or tuple(own)
    sides = [(j, s) for j in d.joint for b, s in j.sides if b == body]
    users = [
        j for j, s in sides if (j.name == typed if typed else not names or set(names) & set(s.features(*_ENTRIES)))
    ]
    if not (moving or typed) or not any(j.name in bad for j in users):
        return None
    given = still[typed][0 if users[0].parent == body else 1] if typed else np.eye(4)
    centre = np.mean([own[n].face.point for n in moving], axis=0) if moving else given[:3, 3]

    def put(twist: Array) -> tuple[dict[str, Measured], dict[tuple[str, str], Array]]:
        T = spatial.pose(spatial.exp_so3(twist[3:] / _LEVER), twist[:3])
        T[:3, 3] += centre - T[:3, :3] @ centre
        faces = {n: _moved(m, T) if n in moving else m for n, m in own.items()}
        return faces, {(typed, body): T @ given} if typed else {}

    def misfit(twist: Array) -> Array:
        faces, other = put(twist)
        parts = []
        for j in users:
            on = [
                other.get((j.name, b), features.frame(s, faces)) if b == body else still[j.name][i]
                for i, (b, s) in enumerate(j.sides)
            ]
            offset, turn = meeting.locked(spatial.inverse(on[0]) @ on[1], j.type)
            parts += [offset, _LEVER * turn]
        return np.concatenate(parts)

    x = np.zeros(6)
    try:
        for _ in range(_STEPS):
            r = misfit(x)
            J = np.stack([(misfit(x + h) - misfit(x - h)) / 2e-6 for h in 1e-6 * np.eye(6)], axis=1)
            x = x - np.linalg.pinv(J, rcond=1e-5) @ r
        faces, other = put(x)
        right = {**cad.measured, body: faces}
        apart = _apart(d, drawn(d, right, other))
    except (CadError, np.linalg.LinAlgError):
        return None
    if any(j.name in apart for j in users):
        return None
    joints = tuple(j for j in bad if any(j == u.name for u in users))
    offset, tilt = float(np.linalg.norm(x[:3])), float(np.linalg.norm(x[3:]) / _LEVER)
    return Suspect(body, names, joints, offset, tilt, right, given=other)


def _moved(m: Measured, T: Array) -> Measured:
    R = T[:3, :3]
    return replace(m, face=replace(m.face, point=R @ m.face.point + T[:3, 3], direction=R @ m.face.direction),
                   direction=R @ m.direction)  # fmt: skip


# -- evidence in the drawing -----------------------------------------------------------------------------------------


def _weighed(cad: CadModel, s: Suspect, nominal: Mapping[str, float]) -> Suspect:
    lengths = _lengths(cad, s, nominal)
    alike = _alike(cad, s)
    told = [*lengths, *alike]
    return replace(
        s, for_it=tuple(text for good, text in told if good), against_it=tuple(text for good, text in told if not good)
    )


def _lengths(cad: CadModel, s: Suspect, nominal: Mapping[str, float]) -> Iterator[tuple[bool, str]]:
    """Yield (equal, text) for each length that equals its value elsewhere only before, or only after, the correction.

    `equal`: whether the length is equal after the correction. Elsewhere: on other parts, and in `nominal`.
    """
    limit = cad.description.tolerance.meeting_um * UM
    try:
        before, after = measure(cad), measure(replace(cad, measured=s.faces))  # type: ignore[arg-type]
    except CadError:  # the distance between tilted axes is undefined
        return
    for i, (a, b) in enumerate(zip(before, after, strict=True)):
        if a.body != s.body:
            continue
        others = [o.value for k, o in enumerate(before) if o.parameter == a.parameter and k != i]
        others += [nominal[a.parameter]] if a.parameter in nominal else []
        if not others:
            continue
        true = float(np.median(others))
        was, now = abs(a.value - true) <= limit, abs(b.value - true) <= limit
        if was != now:
            value = a.value if now else b.value
            text = f"{a.parameter} on '{s.body}' {'measures' if now else 'would measure'} {_apart_mm(value, true)}"
            yield now, text


def _apart_mm(value: float, true: float) -> str:
    n = decimals(abs(value - true) / MM)
    return f"{value / MM:.{n}f} mm; in other places, this length is {true / MM:.{n}f} mm"


def _alike(cad: CadModel, s: Suspect) -> Iterator[tuple[bool, str]]:
    """Yield (equal, text) if the part equals one with the same features only before, or only after, the correction."""
    kinds = {b: {n: (m.face.kind, round(m.face.radius, 6)) for n, m in f.items()} for b, f in cad.measured.items()}
    twins = [b for b in kinds if b != s.body and kinds[b] == kinds[s.body]]
    if not twins or not s.features:
        return
    was = [b for b in twins if _same(cad, cad.measured[s.body], cad.measured[b], s.features)]
    now = [b for b in twins if _same(cad, s.faces[s.body], cad.measured[b], s.features)]
    if bool(was) != bool(now):
        names = ", ".join(f"'{b}'" for b in was or now)
        text = f"'{s.body}' {'differs from' if now else 'equals'} {names}"
        yield bool(now), text


def _same(cad: CadModel, a: Mapping[str, Measured], b: Mapping[str, Measured], names: Iterable[str]) -> bool:
    limits = np.array([cad.description.tolerance.meeting_deg * DEG, cad.description.tolerance.meeting_um * UM])
    for n in names:
        for other in a:
            off = np.abs(np.array(pair(a[n], a[other])) - np.array(pair(b[n], b[other])))
            if other != n and (off[np.isfinite(off)] > limits[np.isfinite(off)]).any():
                return False
    return True
