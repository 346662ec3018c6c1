"""Joints that fitting faces suggest: type, bodies, and frames measured on faces where these allow it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin import spatial
from twin.cad.description import Feature, FrameSpec, Tolerance
from twin.cad.features import find, frame
from twin.cad.step import Face, Part
from twin.errors import CadError
from twin.importing.pairs import Pair, Round, perpendicular
from twin.importing.text import frame as given
from twin.importing.text import number, numbers, string
from twin.mechanism import JointType
from twin.spatial import Array
from twin.units import DEG, MM

_PIN = ": a pin; or cylindrical, or a slide"

_MEETING = 0.001 * MM
"""Measured frames that meet less well than this are given instead."""

_TOLERANCE = Tolerance(gross_mm=1, gross_deg=1, meeting_um=1, meeting_deg=0.001)
"""That of a new description."""


@dataclass(frozen=True)
class Side:
    """A joint's frame on one body as TOML, and the features it needs, by name."""

    text: str
    features: dict[str, str]


@dataclass(frozen=True)
class Proposal:
    """A joint that faces suggest, and why."""

    name: str
    type: JointType
    parent: str
    child: str
    on_parent: Side
    on_child: Side
    why: str


def propose(parts: Mapping[str, Sequence[Part]], pairs: Sequence[Pair], base: str) -> list[Proposal]:
    """Return joints from the base outwards; two bodies that fit in several ways get the joint that all leave free."""
    fits: dict[tuple[str, str], list[Pair]] = {}
    for pair in pairs:
        fits.setdefault((pair.a.body, pair.b.body), []).append(pair)
    reached, todo, out = [base], dict(fits), []
    while todo:
        key = next((k for r in reached for k in todo if r in k), None)
        if key is None:
            break
        own = todo.pop(key)
        parent = min(key, key=lambda b: reached.index(b) if b in reached else len(reached))
        child = key[1] if parent == key[0] else key[0]
        if child not in reached:
            reached.append(child)
        for kind, pair, why in _kinds(own):
            out.append(_joint(f"j{len(out) + 1}", kind, parent, child, pair, parts, why))
    return out


def _kinds(pairs: list[Pair]) -> list[tuple[JointType, Pair, str]]:
    """Return the joints that the fits between two bodies suggest, with the fit that places each."""
    balls = [p for p in pairs if p.kind == "concentric"]
    axes = sorted((p for p in pairs if p.kind == "coaxial"), key=lambda p: (p.clearance, -p.overlap))
    if balls:
        return [("spherical", p, f"a ball, {_radii(p)}") for p in balls]
    first = axes[0]
    others = [p for p in axes[1:] if np.linalg.norm(np.cross(p.a.face.direction, first.a.face.direction)) > 1e-3]
    if others:
        return [("fixed", first, f"{len(axes)} fits, not parallel: bolted, or hinged about one of them")]
    if len(axes) > 1:
        longest = max(axes, key=lambda p: p.overlap)
        return [("prismatic", longest, f"{len(axes)} parallel fits: a slide on rails, or bolted; {_radii(longest)}")]
    return [("revolute", first, f"one coaxial fit, {_radii(first)}{_PIN}")]


def _radii(pair: Pair) -> str:
    return (
        f"radii {pair.a.face.radius / MM:.4g} mm on '{pair.a.part}' and {pair.b.face.radius / MM:.4g} mm on "
        f"'{pair.b.part}'"
    )


def _joint(
    name: str,
    kind: JointType,
    parent: str,
    child: str,
    pair: Pair,
    parts: Mapping[str, Sequence[Part]],
    why: str,
) -> Proposal:
    p, c = (pair.a, pair.b) if pair.a.body == parent else (pair.b, pair.a)
    sides = _measured(name, kind, p, c, parts)
    if sides is None:
        z = p.face.direction if pair.kind == "coaxial" else np.array([0.0, 0.0, 1.0])
        T = spatial.pose(spatial.frame_from_axes(z, np.eye(3)[int(np.argmin(np.abs(z)))]), _amid(p, c))
        sides = (Side(given(T), {}), Side(given(T), {}))
        if kind == "revolute":
            kind, why = "prismatic", why.replace(_PIN, ": nothing stops it along its axis, a slide; or a pin")
    return Proposal(name, kind, parent, child, *sides, why)


def _amid(p: Round, c: Round) -> Array:
    """Return the middle of what the two share, on the first's axis."""
    d = p.face.direction
    offset = float((c.face.point - p.face.point) @ d)
    reach = c.reach if c.face.direction @ d > 0 else (-c.reach[1], -c.reach[0])
    low, high = max(p.reach[0], offset + reach[0]), min(p.reach[1], offset + reach[1])
    return p.face.point + 0.5 * (low + high) * d


def _measured(
    name: str, kind: JointType, p: Round, c: Round, parts: Mapping[str, Sequence[Part]]
) -> tuple[Side, Side] | None:
    """Return measured frames on both bodies: axis, faces that touch across it, a face along it; None if they lack."""
    if kind not in ("revolute", "prismatic"):
        return None
    axis, middle = p.face.direction, _amid(p, c)
    across_p, across_c = (list(perpendicular(parts[r.body], axis)) for r in (p, c))
    touching = [
        (abs(float((a.point - middle) @ axis)), i, k)
        for i, (_, a) in enumerate(across_p)
        for k, (_, b) in enumerate(across_c)
        if abs(float((a.point - b.point) @ axis)) < _MEETING
    ]
    if not touching:
        return None
    _, i, k = min(touching)
    sides, frames = [], []
    for round_, (part, plane) in ((p, across_p[i]), (c, across_c[k])):
        flat = _flat(parts[round_.body], axis)
        if flat is None:
            return None
        x = _spread(flat[1].direction, axis, frames[0] if frames else None)
        named = {
            f"{name}_axis": (round_.part, round_.face, _along(round_.face.direction, axis)),
            f"{name}_face": (part.name, plane, _along(plane.direction, axis)),
            f"{name}_flat": (flat[0].name, flat[1], x),
        }
        specs = {n: _spec(face, direction, of) for n, (of, face, direction) in named.items()}
        try:
            found = {n: find(round_.body, n, s, parts[round_.body], _TOLERANCE) for n, s in specs.items()}
            spec = FrameSpec(origin=f"{name}_axis", at=f"{name}_face", z=f"{name}_axis", x_along=f"{name}_flat")
            frames.append(frame(spec, found))
        except CadError:
            return None
        text = f'{{ origin = "{name}_axis", at = "{name}_face", z = "{name}_axis", x_along = "{name}_flat" }}'
        sides.append(Side(text, {n: _table(s) for n, s in specs.items()}))
    T = spatial.inverse(frames[0]) @ frames[1]
    turned = kind == "prismatic" and float(spatial.rotation_angle(T[:3, :3])) > 0.001 * DEG
    if np.linalg.norm(T[:3, 3]) > _MEETING or turned:
        return None
    return sides[0], sides[1]


def _flat(parts: Sequence[Part], axis: Array) -> tuple[Part, Face] | None:
    """Return the first plane along an axis."""
    for part in parts:
        for face in part.faces:
            if face.kind == "plane" and abs(float(face.direction @ axis)) < 1e-4:
                return part, face
    return None


def _along(direction: Array, axis: Array) -> Array:
    return direction if direction @ axis > 0 else -direction


def _spread(direction: Array, axis: Array, first: Array | None) -> Array:
    """Return the direction with the sign that comes nearest to the x of the first frame."""
    return direction if first is None or direction @ first[:3, 0] > 0 else -direction


def _spec(face: Face, direction: Array, part: str) -> Feature:
    rounded = tuple(float(v) for v in np.round(face.point / MM, 4))
    pointing = tuple(float(v) for v in np.round(direction, 9))
    radius = round(face.radius / MM, 6) if face.radius else None
    return Feature(kind=face.kind, near_mm=rounded, direction=pointing, radius_mm=radius, part=part)  # pyright: ignore[reportArgumentType] - a face's kind is one of these


def _table(spec: Feature) -> str:
    text = f'{{ kind = "{spec.kind}", near_mm = {numbers(spec.near_mm)}, direction = {numbers(spec.direction or ())}'
    if spec.radius_mm:
        text += f", radius_mm = {number(spec.radius_mm)}"
    return f"{text}, part = {string(spec.part or '')} }}"
