"""Propose joints from fitting faces: the type, the two bodies, and a frame measured on the faces of each body.

Directions and positions that faces determine are measured on both bodies, so that differences between the two frames
are found when the description is loaded. Faces do not determine the position of a slide along its axis or the rotation
of a round pin: this position or rotation is written as a number, on one or both bodies.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin.cad.description import CadTolerance, Feature, FrameSpec
from twin.cad.face_feature import feature_of
from twin.cad.features import find, frame
from twin.cad.meeting import locked_gap_sizes
from twin.cad.step import Face, Part
from twin.core import spatial
from twin.core.errors import CadError
from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.exchange.read.description_text import frame_table
from twin.exchange.read.fitting_faces import NEAR_FIT, FacePair, RoundFace, perpendicular, same_axis, shared
from twin.model.joint import JointType

MEETING_TOLERANCE = (0.001 * MM, 0.001 * DEG)
"""Distance in m and angle in rad up to which the frames of a joint on its two bodies count as coincident."""

_NEW_TOLERANCE = CadTolerance(gross_mm=1, gross_deg=1, meeting_um=1, meeting_deg=0.001)
"""Values of the section [tolerance] of a new description."""

_PARALLEL_COSINE = 1e-4
"""Largest cosine of the angle between an axis and the normal of a face that is parallel to the axis: 0.006 degrees."""

_MIN_RAIL_RATIO = 2.0
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
        evidence: the evidence, as text.
    """

    name: str
    type: JointType
    parent: str
    child: str
    on_parent: Side
    on_child: Side
    pair: FacePair
    offset: float
    tilt: float
    evidence: str

    @property
    def misses(self) -> bool:
        """Whether the two frames of the joint differ in the CAD."""
        return self.offset > MEETING_TOLERANCE[0] or self.tilt > MEETING_TOLERANCE[1]

    @property
    def miss(self) -> str:
        """Text with the distance and the angle between the two frames."""
        return f"{round(self.offset / MM, 6):.4g} mm and {round(self.tilt / DEG, 6):.4g}°"


def propose(
    parts: Mapping[str, Sequence[Part]], pairs: Sequence[FacePair], base: str
) -> tuple[list[Proposal], list[FacePair]]:
    """Return (proposed joints from the base outwards, fits that are not used for a joint).

    Each ball fit between two bodies becomes a spherical joint. If two bodies have no ball fit, all their fits together
    become one joint.
    """
    fits: dict[tuple[str, str], list[FacePair]] = {}
    for pair in pairs:
        fits.setdefault((pair.a.body, pair.b.body), []).append(pair)
    reached = [base]
    proposals: list[Proposal] = []
    unused: list[FacePair] = []
    while fits:
        bodies = _next_bodies(fits, reached)
        joining = fits.pop(bodies)
        parent, child = bodies
        # From the base outwards: the parent is the body that the base reaches first.
        if _rank_from_base(child, reached) < _rank_from_base(parent, reached):
            parent, child = child, parent
        for body in (parent, child):
            if body not in reached:
                reached.append(body)
        joints, others = _joints_of_fits(joining)
        unused += others
        for joint_type, pair, evidence in joints:
            name = f"j{len(proposals) + 1}"
            proposals.append(_proposal(name, joint_type, parent, child, pair, parts, evidence))
    return proposals, unused


def _next_bodies(fits: Mapping[tuple[str, str], list[FacePair]], reached: Sequence[str]) -> tuple[str, str]:
    """Return the first pair of bodies with the body that was reached first; if there is none, the first pair."""
    for body in reached:
        for bodies in fits:
            if body in bodies:
                return bodies
    return next(iter(fits))


def _rank_from_base(body: str, reached: Sequence[str]) -> int:
    """Return when a body was reached from the base; bodies that are not reached come last."""
    if body not in reached:
        return len(reached)
    return reached.index(body)


def _joints_of_fits(pairs: list[FacePair]) -> tuple[list[tuple[JointType | None, FacePair, str]], list[FacePair]]:
    """Return (joints, unused fits) for the fits between two bodies; a joint is (type, fit, evidence).

    The fit determines the position of the joint. The type of a single coaxial fit is None, because it depends on stops
    along the axis.
    """
    joints: list[tuple[JointType | None, FacePair, str]] = []
    axes: list[FacePair] = []
    for pair in pairs:
        if pair.kind == "concentric":
            joints.append(("spherical", pair, f"A ball fits a socket: {pair.radii}."))
        else:
            axes.append(pair)
    axes.sort(key=lambda p: (p.near, p.clearance, -p.overlap))
    # A ball in a socket already allows all turns: pins of the same two bodies can only be its stops or bolts.
    if joints:
        return joints, axes
    first, *others = axes
    repeated = []
    doubtful = []
    pins = [first]
    for pair in others:
        # A second fit that is nearly on the axis of the first is a defect of the CAD, not a second axis.
        if same_axis(first.a, pair.a, NEAR_FIT) and same_axis(first.b, pair.b, NEAR_FIT):
            repeated.append(pair)
        elif pair.confidence == "low":
            doubtful.append(pair)
        else:
            pins.append(pair)
    unused = repeated + doubtful
    if not _have_parallel_axes(first, pins):
        text = (
            f"{len(pins)} pins fit bores, and their axes are not parallel: the parts are bolted, or one axis is a "
            f"hinge. The closest fit: {first.radii}."
        )
        return [("fixed", first, text)], unused + _other_near_fits(pins, first)
    if len(pins) > 1:
        # The direction of a long fit is measured best: an error at its ends turns it least.
        longest = max(pins, key=lambda p: (not p.near, p.overlap))
        text = f"{len(pins)} fits have parallel axes: a slide on rails, or bolted parts. The longest: {longest.radii}."
        return [("prismatic", longest, text)], unused + _other_near_fits(pins, longest)
    return [(None, first, f"One coaxial fit: {first.radii}.")], unused


def _other_near_fits(pairs: Sequence[FacePair], used_pair: FacePair) -> list[FacePair]:
    """Return the fits whose axes do not coincide, except the one that is used for a joint."""
    near_pairs = []
    for pair in pairs:
        if pair.near and pair is not used_pair:
            near_pairs.append(pair)
    return near_pairs


def _have_parallel_axes(first: FacePair, pairs: Sequence[FacePair]) -> bool:
    """Return whether the axes of all fits are parallel to that of the first, within the larger tolerance."""
    _, angle = NEAR_FIT
    for pair in pairs:
        sine = np.linalg.norm(np.cross(pair.a.face.direction, first.a.face.direction))
        if sine > np.sin(angle):
            return False
    return True


def _proposal(
    name: str,
    joint_type: JointType | None,
    parent: str,
    child: str,
    pair: FacePair,
    parts: Mapping[str, Sequence[Part]],
    evidence: str,
) -> Proposal:
    parent_round = pair.a
    child_round = pair.b
    if parent_round.body != parent:
        parent_round, child_round = child_round, parent_round
    if pair.kind == "concentric":
        on_parent = _FrameBuilder(parent_round.body, f"{name}_ball", parent_round.part, parent_round.face, np.eye(3))
        on_child = _FrameBuilder(child_round.body, f"{name}_ball", child_round.part, child_round.face, np.eye(3))
    else:
        joint_type, frames, evidence_of_axis = _along_axis(name, joint_type, pair, parent_round, child_round, parts)
        on_parent, on_child = frames
        evidence += evidence_of_axis
    assert joint_type is not None
    try:
        T_parent = on_parent.measured(parts[on_parent.body])
        T_child = on_child.measured(parts[on_child.body])
    except CadError as error:
        numbers = frame_table(spatial.pose(on_parent.R, parent_round.face.point))
        evidence += f" NOT MEASURED: both frames are given as numbers, because {error}"
        return Proposal(
            name, joint_type, parent, child, Side(numbers, {}), Side(dict(numbers), {}), pair, 0.0, 0.0, evidence
        )
    offset, tilt = locked_gap_sizes(spatial.inverse(T_parent) @ T_child, joint_type)
    return Proposal(name, joint_type, parent, child, on_parent.side(), on_child.side(), pair, offset, tilt, evidence)


class _FrameBuilder:
    """Builder of a measured frame: features and TOML keys. Directions that are not measured are taken from R (3, 3)."""

    def __init__(self, body: str, origin: str, part: Part, face: Face, R: Array) -> None:
        self.body = body
        self.R = R
        self.features: dict[str, Feature] = {}
        self.keys: JsonObject = {"origin": self.add_feature(origin, part, face, R[:, 2])}

    def add_feature(self, name: str, part: Part, face: Face, towards: Array) -> str:
        """Add a feature called `name` for a face, and return `name`.

        If the direction of the face points against `towards`, the feature has the opposite direction.
        """
        self.features[name] = feature_of(face, towards, part.name)
        return name

    def _spec(self) -> JsonObject:
        spec = dict(self.keys)
        if "x_along" not in spec:
            angles = spatial.euler_angles(self.R, "zyx") / DEG
            spec["angles_deg"] = tuple(angles.tolist())
        return spec

    def measured(self, parts: Sequence[Part]) -> Array:
        """Return the frame (4, 4) in the coordinates of the CAD, measured like the frames of a description."""
        positions = {}
        for name, feature in self.features.items():
            positions[name] = find(self.body, name, feature, parts, _NEW_TOLERANCE)
        return frame(FrameSpec(**self._spec()), positions)

    def side(self) -> Side:
        """Return the frame and its features."""
        features: dict[str, JsonObject] = {}
        for name, feature in self.features.items():
            features[name] = feature.model_dump(exclude_none=True)
        return Side(self._spec(), features)


def _along_axis(
    name: str,
    joint_type: JointType | None,
    pair: FacePair,
    parent_round: RoundFace,
    child_round: RoundFace,
    parts: Mapping[str, Sequence[Part]],
) -> tuple[JointType, list[_FrameBuilder], str]:
    """Return (type, frames, evidence) of a joint about or along the common axis of two faces.

    The origins of both frames are on the axis. If the bodies touch at plane faces perpendicular to the axis, the
    origins are on these faces. Otherwise, a number shifts the child's frame along the axis to the origin of the
    parent's frame.
    """
    low, high = shared(parent_round, child_round)
    middle = parent_round.face.point + 0.5 * (low + high) * parent_round.face.direction
    z_parent = parent_round.face.direction
    # The axis of the child's frame points in the direction of that of the parent's.
    z_child = child_round.face.direction
    if not z_child @ z_parent > 0:
        z_child = -z_child
    on_parent = _stops(parts[parent_round.body], z_parent, middle)
    on_child = _stops(parts[child_round.body], z_child, middle)
    reach, _ = MEETING_TOLERANCE
    if pair.near:
        reach += pair.offset + pair.tilt * pair.overlap
    touching = _touching_stops(on_parent, on_child, reach)
    evidence = ""
    if touching is not None:
        stops = touching
        if joint_type is None:
            joint_type = "revolute"
            evidence = (
                " Faces stop the motion along the axis: assumed to be a pin; could also be cylindrical or a slide."
            )
    else:
        stops = (_nearest_stop(on_parent), _nearest_stop(on_child))
        evidence = " No face stops the motion along the axis."
        if joint_type is None:
            joint_type, assumption = _assumed_kind(parent_round, child_round)
            evidence = f" No face stops the motion along the axis: {assumption}"
    # For a pin, whose rotation is free, only flats that are parallel within rounding count.
    _, tilt = MEETING_TOLERANCE if joint_type == "revolute" else NEAR_FIT
    flats = _matching_flats((parts[parent_round.body], parts[child_round.body]), (z_parent, z_child), tilt)
    x = spatial.unit_across(z_parent)  # the axis of the CAD that is farthest from z
    if flats:
        _, flat = flats[0]
        x = flat.direction
    frames = []
    origins = []
    for side_number, round_face in enumerate((parent_round, child_round)):
        axis = (z_parent, z_child)[side_number]
        stop = stops[side_number]
        R = spatial.frame_from_axes(axis, x)
        side_frame = _FrameBuilder(round_face.body, f"{name}_axis", round_face.part, round_face.face, R)
        side_frame.keys["z"] = f"{name}_axis"
        origin = float((round_face.face.point - middle) @ axis)
        if stop is not None:
            part, face, origin = stop
            side_frame.keys["at"] = side_frame.add_feature(f"{name}_face", part, face, axis)
        if flats:
            side_frame.keys["x_along"] = side_frame.add_feature(f"{name}_flat", *flats[side_number], x)
        if side_number == 1 and touching is None:  # the child's frame moves to the origin of the parent's
            side_frame.keys["offset_mm"] = round((origins[0] - origin) / MM, 6)
        origins.append(origin)
        frames.append(side_frame)
    if not flats and joint_type != "revolute":
        evidence += " The rotation about the axis is given as a number, because no two flat faces match."
    return joint_type, frames, evidence


def _assumed_kind(a: RoundFace, b: RoundFace) -> tuple[JointType, str]:
    """Return (type, evidence) of a joint of two cylinders that no faces stop along their axis."""
    longer = max(a.length, b.length)
    shorter = min(a.length, b.length)
    if longer > _MIN_RAIL_RATIO * shorter:
        text = "assumed to be a slide, because the shaft is long; it could also be a pin or cylindrical."
        return "prismatic", text
    return "revolute", "assumed to be a pin, because the shaft is short; it could also be a slide or cylindrical."


_Stop = tuple[Part, Face, float]
"""A plane face perpendicular to an axis, its part, and its distance in m along the axis."""


def _stops(parts: Sequence[Part], axis: Array, origin: Array) -> list[_Stop]:
    stops = []
    for part, face in perpendicular(parts, axis):
        stops.append((part, face, float((face.point - origin) @ axis)))
    return stops


def _touching_stops(on_parent: Sequence[_Stop], on_child: Sequence[_Stop], reach: float) -> tuple[_Stop, _Stop] | None:
    """Return two faces that touch, or nearly so (closer than `reach` in m); None if there are none.

    Faces that touch are preferred, then the nearest to the origin on the axis.
    """
    candidates = []
    for parent_number, (_, _, at_parent) in enumerate(on_parent):
        for child_number, (_, _, at_child) in enumerate(on_child):
            distance = abs(at_parent - at_child)
            if distance < reach:
                candidates.append((distance > MEETING_TOLERANCE[0], abs(at_parent), parent_number, child_number))
    if not candidates:
        return None
    _, _, parent_number, child_number = min(candidates)
    return on_parent[parent_number], on_child[child_number]


def _nearest_stop(stops: Sequence[_Stop]) -> _Stop | None:
    return min(stops, key=lambda stop: abs(stop[2]), default=None)


def _matching_flats(
    parts: Sequence[Sequence[Part]], axes: Sequence[Array], max_angle: float
) -> list[tuple[Part, Face]] | None:
    """Return two plane faces parallel to the axes, one of each body, with the smallest angle between them.

    Return None if a body has no such face, or if the angle is at least `max_angle` in rad.
    """
    on_parent = _planes_along(parts[0], axes[0])
    on_child = _planes_along(parts[1], axes[1])
    if not on_parent or not on_child:
        return None
    parent_directions = np.array([face.direction for _, face in on_parent])
    child_directions = np.array([face.direction for _, face in on_child])
    sines = np.linalg.norm(np.cross(parent_directions[:, None], child_directions[None]), axis=-1)
    # Rounded, so that of equally good faces the first is chosen on every processor.
    parent_number, child_number = np.unravel_index(int(np.argmin(np.round(sines, 9))), sines.shape)
    if not sines[parent_number, child_number] < max_angle:
        return None
    return [on_parent[parent_number], on_child[child_number]]


def _planes_along(parts: Sequence[Part], axis: Array) -> list[tuple[Part, Face]]:
    """Return (part, face) for each plane face that is parallel to an axis."""
    planes = []
    for part in parts:
        for face in part.faces:
            if face.kind == "plane" and abs(float(face.direction @ axis)) < _PARALLEL_COSINE:
                planes.append((part, face))
    return planes
