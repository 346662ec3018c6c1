"""Propose joints from fitting faces: the type, the two bodies, and a frame measured on the faces of each body.

Directions and positions that faces determine are measured on both bodies, so that differences between the two frames
are found when the description is loaded. Faces do not determine the position of a slide along its axis or the rotation
of a round pin: this position or rotation is written as a number, on one or both bodies.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin.cad.description import Feature, FrameSpec, Tolerance
from twin.cad.features import find, frame
from twin.cad.meeting import locked_error
from twin.cad.step import Face, Part
from twin.core import spatial
from twin.core.errors import CadError
from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.exchange.read.pairs import GROSS, Pair, Round, perpendicular, same_axis, shared
from twin.exchange.read.text import frame as given
from twin.model.joint import JointType

MEETING = (0.001 * MM, 0.001 * DEG)
"""Distance in m and angle in rad up to which the frames of a joint on its two bodies count as coincident."""

_TOLERANCE = Tolerance(gross_mm=1, gross_deg=1, meeting_um=1, meeting_deg=0.001)
"""Values of the section [tolerance] of a new description."""

_RAIL = 2.0
"""Ratio of shaft length to bush length above which a shaft without stops is assumed to be a rail."""


@dataclass(frozen=True)
class Side:
    """A joint's frame on one body, and the features to which the frame refers by name, as inline TOML tables."""

    frame: JsonObject
    features: dict[str, JsonObject]


@dataclass(frozen=True)
class Proposal:
    """A joint that fitting faces suggest, and the evidence for it.

    Attributes:
        name, type: name and type of the joint.
        parent, child: names of the joint's two bodies.
        on_parent, on_child: frames of the joint on the parent and on the child.
        pair: the pair of faces that determines the position of the joint.
        offset, tilt: distance in m and angle in rad between the two frames in the CAD, in the locked directions of the
            joint.
        why: the evidence, as text.
    """

    name: str
    type: JointType
    parent: str
    child: str
    on_parent: Side
    on_child: Side
    pair: Pair
    offset: float
    tilt: float
    why: str

    @property
    def misses(self) -> bool:
        """Whether the two frames of the joint differ in the CAD."""
        return self.offset > MEETING[0] or self.tilt > MEETING[1]

    @property
    def miss(self) -> str:
        """Text with the distance and the angle between the two frames."""
        return f"{round(self.offset / MM, 6):.4g} mm and {round(self.tilt / DEG, 6):.4g}°"


def propose(parts: Mapping[str, Sequence[Part]], pairs: Sequence[Pair], base: str) -> tuple[list[Proposal], list[Pair]]:
    """Return (proposed joints from the base outwards, fits that are not used for a joint).

    Each ball fit between two bodies becomes a spherical joint. If two bodies have no ball fit, all their fits together
    become one joint.
    """
    fits: dict[tuple[str, str], list[Pair]] = {}
    for pair in pairs:
        fits.setdefault((pair.a.body, pair.b.body), []).append(pair)
    reached, todo, out, left = [base], dict(fits), [], []
    while todo:
        # If no remaining pair of bodies is connected to the base, continue with the first remaining pair.
        key = next((k for r in reached for k in todo if r in k), next(iter(todo)))
        own = todo.pop(key)
        parent = min(key, key=lambda b: reached.index(b) if b in reached else len(reached))
        child = key[1] if parent == key[0] else key[0]
        reached += [b for b in (parent, child) if b not in reached]
        kinds, others = _kinds(own)
        left += others
        for kind, pair, why in kinds:
            out.append(_joint(f"j{len(out) + 1}", kind, parent, child, pair, parts, why))
    return out, left


def _kinds(pairs: list[Pair]) -> tuple[list[tuple[JointType | None, Pair, str]], list[Pair]]:
    """Return (joints, unused fits) for the fits between two bodies; a joint is (type, fit, evidence).

    The fit determines the position of the joint. The type of a single coaxial fit is None, because it depends on stops
    along the axis.
    """
    balls = [p for p in pairs if p.kind == "concentric"]
    axes = sorted((p for p in pairs if p.kind == "coaxial"), key=lambda p: (p.near, p.clearance, -p.overlap))
    if balls:
        return [("spherical", p, f"A ball fits a socket: {p.radii}.") for p in balls], axes
    first = axes[0]
    # A second fit that is nearly on the axis of the first is a defect of the CAD, not a second axis.
    again = [p for p in axes[1:] if same_axis(first.a, p.a, GROSS) and same_axis(first.b, p.b, GROSS)]
    doubtful = [p for p in axes[1:] if p not in again and p.confidence == "low"]
    axes = [p for p in axes if p not in again and p not in doubtful]
    left = again + doubtful
    if [p for p in axes if np.linalg.norm(np.cross(p.a.face.direction, first.a.face.direction)) > np.sin(GROSS[1])]:
        text = (
            f"{len(axes)} pins fit bores, and their axes are not parallel: the parts are bolted, or one axis is a "
            f"hinge. The closest fit: {first.radii}."
        )
        return [("fixed", first, text)], left + [p for p in axes[1:] if p.near]
    if len(axes) > 1:
        longest = max(axes, key=lambda p: (not p.near, p.overlap))
        text = f"{len(axes)} fits have parallel axes: a slide on rails, or bolted parts. The longest: {longest.radii}."
        return [("prismatic", longest, text)], left + [p for p in axes if p.near and p is not longest]
    return [(None, first, f"One coaxial fit: {first.radii}.")], left


def _joint(
    name: str,
    kind: JointType | None,
    parent: str,
    child: str,
    pair: Pair,
    parts: Mapping[str, Sequence[Part]],
    why: str,
) -> Proposal:
    p, c = (pair.a, pair.b) if pair.a.body == parent else (pair.b, pair.a)
    if pair.kind == "concentric":
        specs = [_Frame(r.body, f"{name}_ball", r.part, r.face, np.eye(3)) for r in (p, c)]
    else:
        kind, specs, more = _along_axis(name, kind, pair, p, c, parts)
        why += more
    assert kind is not None
    try:
        frames = [s.measured(parts[s.body]) for s in specs]
    except CadError as error:
        at = spatial.pose(specs[0].R, p.face.point)
        why += f" NOT MEASURED: both frames are given as numbers, because {error}"
        return Proposal(name, kind, parent, child, Side(given(at), {}), Side(given(at), {}), pair, 0.0, 0.0, why)
    offset, tilt = locked_error(spatial.inverse(frames[0]) @ frames[1], kind)
    return Proposal(name, kind, parent, child, specs[0].side(), specs[1].side(), pair, offset, tilt, why)


class _Frame:
    """Builder of a measured frame: features and TOML keys. Directions that are not measured are taken from R (3, 3)."""

    def __init__(self, body: str, origin: str, part: Part, face: Face, R: Array) -> None:
        self.body, self.R = body, R
        self.features: dict[str, Feature] = {}
        self.keys: JsonObject = {"origin": self.name(origin, part, face, R[:, 2])}

    def name(self, name: str, part: Part, face: Face, towards: Array) -> str:
        """Add a feature called `name` for a face, and return `name`.

        If the direction of the face points against `towards`, the feature has the opposite direction.
        """
        sign = 1.0 if face.direction @ towards >= 0 else -1.0
        x, y, z = np.round(sign * face.direction, 9).tolist()
        near_x, near_y, near_z = np.round(face.point / MM, 4).tolist()
        self.features[name] = Feature(
            kind=face.kind,  # pyright: ignore[reportArgumentType] - a face's kind is one of these
            near_mm=(near_x, near_y, near_z),
            direction=(x, y, z) if any((x, y, z)) else None,
            radius_mm=round(face.radius / MM, 6) if face.radius else None,
            part=part.name,
        )
        return name

    def _spec(self) -> JsonObject:
        typed = (
            {}
            if "x_along" in self.keys
            else {"angles_deg": tuple(float(v) for v in spatial.euler_angles(self.R, "zyx") / DEG)}
        )
        return {**self.keys, **typed}

    def measured(self, parts: Sequence[Part]) -> Array:
        """Return the frame (4, 4) in the coordinates of the CAD, measured like the frames of a description."""
        found = {n: find(self.body, n, s, parts, _TOLERANCE) for n, s in self.features.items()}
        return frame(FrameSpec(**self._spec()), found)

    def side(self) -> Side:
        """Return the frame and its features."""
        return Side(self._spec(), {n: f.model_dump(exclude_none=True) for n, f in self.features.items()})


def _along_axis(
    name: str, kind: JointType | None, pair: Pair, p: Round, c: Round, parts: Mapping[str, Sequence[Part]]
) -> tuple[JointType, list[_Frame], str]:
    """Return (type, frames, evidence) of a joint about or along the common axis of two faces.

    The origins of both frames are on the axis. If the bodies touch at plane faces perpendicular to the axis, the
    origins are on these faces. Otherwise, a number shifts the child's frame along the axis to the origin of the
    parent's frame.
    """
    low, high = shared(p, c)
    middle = p.face.point + 0.5 * (low + high) * p.face.direction
    zs = [p.face.direction, c.face.direction * (1.0 if c.face.direction @ p.face.direction > 0 else -1.0)]
    across = [[(part, f, float((f.point - middle) @ z)) for part, f in perpendicular(parts[r.body], z)]
              for r, z in zip((p, c), zs, strict=True)]  # fmt: skip
    reach = MEETING[0] + (pair.offset + pair.tilt * pair.overlap if pair.near else 0.0)
    touching = sorted(
        (abs(a[2] - b[2]) > MEETING[0], abs(a[2]), i, k)
        for i, a in enumerate(across[0])
        for k, b in enumerate(across[1])
        if abs(a[2] - b[2]) < reach
    )
    if touching:
        _, _, i, k = touching[0]
        stops = [across[0][i], across[1][k]]
        more = ""
        if kind is None:
            more = " Faces stop the motion along the axis: assumed to be a pin; could also be cylindrical or a slide."
        kind = kind or "revolute"
    else:
        stops = [min(own, key=lambda s: abs(s[2]), default=None) for own in across]
        if kind is None:
            rail = max(p.length, c.length) > _RAIL * min(p.length, c.length)
            kind = "prismatic" if rail else "revolute"
            more = " No face stops the motion along the axis: " + (
                "assumed to be a slide, because the shaft is long; it could also be a pin or cylindrical."
                if rail
                else "assumed to be a pin, because the shaft is short; it could also be a slide or cylindrical."
            )
        else:
            more = " No face stops the motion along the axis."
    flats = _flats([parts[r.body] for r in (p, c)], zs, MEETING[1] if kind == "revolute" else GROSS[1])
    x = flats[0][1].direction if flats else np.eye(3)[int(np.argmin(np.abs(zs[0])))]
    frames, origins = [], []
    for i, (r, z, stop) in enumerate(zip((p, c), zs, stops, strict=True)):
        made = _Frame(r.body, f"{name}_axis", r.part, r.face, spatial.frame_from_axes(z, x))
        made.keys["z"] = f"{name}_axis"
        if stop is not None:
            made.keys["at"] = made.name(f"{name}_face", stop[0], stop[1], z)
        if flats:
            made.keys["x_along"] = made.name(f"{name}_flat", *flats[i], x)
        at = stop[2] if stop is not None else float((r.face.point - middle) @ z)
        if i and not touching:
            made.keys["offset_mm"] = round((origins[0] - at) / MM, 6)
        origins.append(at)
        frames.append(made)
    if not flats and kind != "revolute":
        more += " The rotation about the axis is given as a number, because no two flat faces match."
    return kind, frames, more


def _flats(parts: Sequence[Sequence[Part]], zs: Sequence[Array], within: float) -> list[tuple[Part, Face]] | None:
    """Return two plane faces parallel to the axes, one of each body, with the smallest angle between them.

    Return None if a body has no such face, or if the angle is at least `within` rad.
    """
    planes = [
        [(part, f) for part in own for f in part.faces if f.kind == "plane" and abs(float(f.direction @ z)) < 1e-4]
        for own, z in zip(parts, zs, strict=True)
    ]
    if not all(planes):
        return None
    a, b = (np.array([f.direction for _, f in own]) for own in planes)
    apart = np.linalg.norm(np.cross(a[:, None], b[None]), axis=-1)
    i, k = np.unravel_index(int(np.argmin(np.round(apart, 9))), apart.shape)
    return [planes[0][i], planes[1][k]] if apart[i, k] < within else None
