"""A linkage with loops against a description that replaces its loops by linear couplings (mimic joints).

A gripper's finger is often a four-bar linkage, which URDF cannot close: its files open the loops, and let joints follow
the driven one linearly. The joints then correspond only in part, so that no joint-by-joint comparison exists. Here the
hinges of both sides are matched by their places: hinges that only the linkage has are either held in the other side
(its links are one link there), or missing (its loop is open there). The loops are closed along the stroke of the driven
joint, by Newton steps on the joint lines, and the links are compared with those that the couplings place.

This works for linkages whose hinges are all parallel, at state zero of all hinges of the coupled side.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin.comparison.coupled_motion import followers_of
from twin.comparison.hinge_matching import PARALLEL_ANGLE, base_motion, matched_links, nearest_hinge
from twin.comparison.linkage_motion import LinkageMotion
from twin.comparison.side import Axis, RobotSide
from twin.core import spatial
from twin.core.json_types import JsonObject
from twin.core.quantity import deg, mm, moved
from twin.core.spatial import Array
from twin.core.units import DEG, MM

_STROKE_STATES = 81
"""Number of states along the stroke."""

_SMALLEST_SHOWN_DISTANCE = 1e-5
"""Distance in m from which the place of a hinge is told as another one."""


@dataclass(frozen=True)
class LinkError:
    """The largest errors of a link of the coupled side over the stroke.

    Attributes:
        link: its name.
        distance: of its hinges, of its frames and of its centre of mass, in m.
        angle: of its direction, in rad.
        at_distance, at_angle: coordinates of the leader at which they are largest, in rad.
    """

    link: str
    distance: float
    angle: float
    at_distance: float
    at_angle: float

    def is_within(self, distance: float, angle: float) -> bool:
        """Return whether the link is no further away than a distance in m, and turned no more than an angle in rad."""
        return self.distance <= distance and self.angle <= angle


@dataclass(frozen=True)
class MimicError:
    """What the couplings of one side say about the loops of the other.

    Attributes:
        linkage, coupled: labels of the side with loops, and of the side with couplings.
        leader: the driven joint of the coupled side, a hinge; `stroke` is its common range in rad.
        links: the errors of its links.
        moved_hinges: (joint, distance in m) of hinges whose places differ, with their names in the coupled side.
        held, missing: hinges of the linkage that the coupled side holds, and those at which it opens a loop.
        base: (4, 4) motion of the base of the linkage onto that of the coupled side, without shifts along the hinges.
        tool: (4, 4) T_linkage_coupled of the tool frames at state zero; None if a side names none, or has it on a link
            that the other lacks.
        limits: limits of the driver of the linkage as values of the leader, and of the leader, as in `side.Axis`.
    """

    linkage: str
    coupled: str
    leader: str
    stroke: tuple[float, float]
    links: tuple[LinkError, ...]
    moved_hinges: tuple[tuple[str, float], ...]
    held: tuple[str, ...]
    missing: tuple[str, ...]
    base: Array
    tool: Array | None
    limits: tuple[tuple[float, float] | None, tuple[float, float] | None]

    @property
    def worst(self) -> LinkError:
        """The link with the largest distance."""
        return max(self.links, key=lambda link: link.distance)

    def is_within(self, distance: float, angle: float) -> bool:
        """Return whether no hinge or link is further away than a distance in m, or turned more than an angle in rad."""
        for _, offset in self.moved_hinges:
            if offset > distance:
                return False
        # a link may turn about a hinge that does not move
        return all(link.is_within(distance, angle) for link in self.links)

    def text(self) -> str:
        """Return the errors as one sentence."""
        worst = self.worst
        most_turned = max(self.links, key=lambda link: link.angle)
        low = moved(self.stroke[0], True)
        high = moved(self.stroke[1], True)
        return (
            f"the mimic joints of {self.coupled} place link '{worst.link}' up to {mm(worst.distance)} away from where "
            f"the loops of {self.linkage} place it, at '{self.leader}' = {moved(worst.at_distance, True)}, and turn "
            f"'{most_turned.link}' up to {deg(most_turned.angle)} too far or too little, at '{self.leader}' = "
            f"{moved(most_turned.at_angle, True)} (stroke {low} .. {high})"
        )

    def part_text(self) -> str:
        """Return which joints correspond only in part, and why."""
        parts = []
        if self.held:
            parts.append(f"{self.coupled} holds {', '.join(self.held)}")
        if self.missing:
            parts.append(f"{self.coupled} opens the loops at {', '.join(self.missing)}")
        for name, distance in self.moved_hinges:
            parts.append(f"joint '{name}' is {mm(distance)} away from that of {self.linkage}")
        return "; ".join(parts)

    def as_dict(self) -> JsonObject:
        """Return the errors as plain data, in mm and degrees."""
        links = []
        for link in self.links:
            links.append(
                {
                    "link": link.link,
                    "distance_mm": link.distance / MM,
                    "angle_deg": link.angle / DEG,
                    "at_distance_deg": link.at_distance / DEG,
                    "at_angle_deg": link.at_angle / DEG,
                }
            )
        moved_hinges_mm: dict[str, float] = {}
        for name, distance in self.moved_hinges:
            moved_hinges_mm[name] = distance / MM
        return {
            "linkage": self.linkage,
            "coupled": self.coupled,
            "leader": self.leader,
            "stroke_deg": [value / DEG for value in self.stroke],
            "links": links,
            "moved_hinges_mm": moved_hinges_mm,
            "held": list(self.held),
            "missing": list(self.missing),
        }


def mimic_error(linkage: RobotSide, coupled: RobotSide) -> MimicError | None:
    """Return the error of the couplings of one side over the stroke; None if the sides are no such pair."""
    leaders = _leaders(coupled)
    if not linkage.has_loops or coupled.has_loops or not coupled.couplings or len(leaders) != 1:
        return None
    # the links are matched and compared in one plane, in which only parallel hinges move them
    if {axis.kind for axis in (*linkage.tree, *coupled.tree)} != {"revolute"}:
        return None
    pins: list[Axis] = []
    for axis in linkage.axes:
        if not axis.closes_loop:
            continue
        if axis.kind not in ("revolute", "spherical"):
            return None  # a loop is closed by a point that both links share: a slide or a cylinder shares none
        if axis.kind == "revolute":
            pins.append(axis)
    if not _are_parallel([*linkage.tree, *pins]) or not _are_parallel(coupled.axes):
        return None
    pair = _match_sides(linkage, coupled, leaders[0])
    if pair is None:
        return None
    return pair.error()


def _are_parallel(axes: Sequence[Axis]) -> bool:
    """Return whether all hinges are parallel; which way along their lines is positive does not matter."""
    directions = np.array([axis.direction for axis in axes])
    sines = np.linalg.norm(np.cross(directions, directions[0]), axis=1)
    return float(sines.max()) <= PARALLEL_ANGLE


def _leaders(side: RobotSide) -> list[int]:
    """Return the joints that follow no other."""
    followers = followers_of(side)
    return sorted(set(range(len(side.axes))) - followers.keys())


def _match_sides(linkage: RobotSide, coupled: RobotSide, leader: int) -> _MatchedSides | None:
    """Return the two sides with their hinges and links matched; None if the hinges are not at the same places."""
    X = base_motion(linkage, coupled)
    if X is None:
        return None
    as_drawn = _hinge_points(linkage, np.tile(np.eye(4), (len(linkage.groups), 1, 1)), X)
    driver = nearest_hinge(coupled.axes[leader], as_drawn, ())
    if driver is None or driver >= len(linkage.tree):
        return None
    # the hinges of the coupled side are known at zero: those of the linkage must be at the same state
    motion = LinkageMotion(linkage, driver)
    x_zero = motion.values_at_zero()
    if x_zero is None:
        return None
    points = _hinge_points(linkage, _motions_to_zero(motion, x_zero), X)
    partners: dict[int, int] = {}
    for k, axis in enumerate(coupled.axes):
        partner = nearest_hinge(axis, points, list(partners.values()))
        if partner is None:
            return None
        partners[k] = partner
    links = matched_links(linkage, coupled, partners)
    if links is None or partners[leader] != driver:
        return None
    groups, held = links
    # again: now the joints that the coupled side holds are known
    motion = LinkageMotion(linkage, driver, held)
    x_zero = motion.values_at_zero()
    if x_zero is None:
        return None
    return _MatchedSides(motion, coupled, leader, X, x_zero, partners, groups)


def _motions_to_zero(motion: LinkageMotion, x_zero: Array) -> Array:
    """Return the motions (groups, 4, 4) of the links of a linkage from its drawn state to the state zero."""
    return motion.linkage.group_motions(motion.displacements(0.0, x_zero)[None])[0]


def _hinge_points(linkage: RobotSide, motions: Array, X: Array) -> Array:
    """Return the points (joints, 3) of the linkage's hinges after motions (groups, 4, 4), in the other side's base."""
    points = []
    for axis in linkage.axes:
        M = motions[axis.parent]
        points.append(M[:3, :3] @ axis.point + M[:3, 3])
    return np.array(points) @ X[:3, :3].T + X[:3, 3]


@dataclass(frozen=True)
class _MatchedSides:
    """A linkage and a coupled side whose hinges are at the same places at state zero.

    Attributes:
        motion: the motion of the linkage by its driver.
        coupled: the side with couplings.
        leader: the joint of the coupled side that the others follow.
        X: (4, 4) motion of the linkage's base onto that of the coupled side.
        x_zero: (free joints,) values of the joints of the linkage that close its loops, at zero of the driver.
        partners: {hinge of the coupled side: hinge of the linkage}.
        groups: {group of the coupled side: group of the linkage}.
    """

    motion: LinkageMotion
    coupled: RobotSide
    leader: int
    X: Array
    x_zero: Array
    partners: Mapping[int, int]
    groups: Mapping[int, int]

    def error(self) -> MimicError | None:
        """Return the errors of all links over the common stroke; None without one, or if a loop opens on it."""
        linkage = self.motion.linkage
        leader = self.coupled.axes[self.leader]
        driver = linkage.axes[self.motion.driver]
        # which way along the hinge is positive may differ
        sign = float(np.sign(leader.direction @ (self.X[:3, :3] @ driver.direction)))
        driver_limits: tuple[float, float] | None = None
        if driver.limits is not None:
            ends_along_leader = (sign * driver.limits[0], sign * driver.limits[1])
            first, last = sorted(ends_along_leader)
            driver_limits = (first, last)
        ends = _common_stroke(leader.limits, driver_limits)
        if ends is None:
            return None
        low, high = ends
        stroke = np.linspace(low, high, _STROKE_STATES)
        displacements = self.motion.displacements_along(sign * stroke, self.x_zero)
        if displacements is None:
            return None
        held: list[str] = []
        missing: list[str] = []
        for i, name in enumerate(linkage.joint_names):
            if i in self.motion.held:
                held.append(name)
            elif i not in self.partners.values():
                missing.append(name)
        return MimicError(
            linkage=linkage.label,
            coupled=self.coupled.label,
            leader=leader.name,
            stroke=(float(low), float(high)),
            links=self._link_errors(displacements, stroke),
            moved_hinges=self._moved_hinges(),
            held=tuple(held),
            missing=tuple(missing),
            base=self._base_motion(),
            tool=self._tool_frames_gap(),
            limits=(driver_limits, leader.limits),
        )

    def _link_errors(self, displacements: Array, stroke: Array) -> tuple[LinkError, ...]:
        """Return the errors of all links but the base, for displacements (k, joints of the tree) along the stroke."""
        at_zero = self.motion.displacements(0.0, self.x_zero)
        motions = self.motion.linkage.group_motions(np.vstack([at_zero, displacements]))
        # the linkage's motions since the state zero of the driver, in the base of the coupled side
        of_linkage = self.X @ motions[1:] @ spatial.inverse(motions[0]) @ spatial.inverse(self.X)
        of_coupled = self._coupled_motions(stroke)
        links = []
        for group, partner in self.groups.items():
            if group:
                links.append(self._link_error(group, of_linkage[:, partner], of_coupled[:, group], stroke))
        return tuple(links)

    def _link_error(self, group: int, of_linkage: Array, of_coupled: Array, stroke: Array) -> LinkError:
        """Return the largest error of a link at its hinges and the frames on it, for its motions (k, 4, 4)."""
        points = np.array(self._points_on(group))
        places = points @ np.swapaxes(of_linkage[:, :3, :3], 1, 2) + of_linkage[:, None, :3, 3]
        places_of_coupled = points @ np.swapaxes(of_coupled[:, :3, :3], 1, 2) + of_coupled[:, None, :3, 3]
        distances = np.linalg.norm(places - places_of_coupled, axis=2).max(axis=1)
        angles = spatial.rotation_angle(np.swapaxes(of_linkage[:, :3, :3], 1, 2) @ of_coupled[:, :3, :3])
        farthest = int(np.argmax(distances))
        most_turned = int(np.argmax(angles))
        return LinkError(
            link=self.coupled.groups[group].bodies[0],
            distance=float(distances[farthest]),
            angle=float(angles[most_turned]),
            at_distance=float(stroke[farthest]),
            at_angle=float(stroke[most_turned]),
        )

    def _points_on(self, group: int) -> list[Array]:
        """Return the points (3,) of a link of the coupled side: of its hinges, its frames and its centre of mass."""
        side = self.coupled
        points = []
        for axis in side.axes:
            if group in (axis.parent, axis.child):
                points.append(axis.point)
        for group_of_frame, T in side.frames.values():
            if group_of_frame == group:
                points.append(T[:3, 3])
        inertia = side.groups[group].inertia
        if inertia is not None:
            points.append(inertia.p_body_com)
        return points

    def _coupled_motions(self, stroke: Array) -> Array:
        """Return the motions (k, groups, 4, 4) of the coupled side along its stroke."""
        q = np.zeros((len(stroke), len(self.coupled.axes)))
        q[:, self.leader] = stroke
        for i, (ratios, offset) in followers_of(self.coupled).items():
            q[:, i] = q @ ratios + offset
        # `poses` takes displacements from the posture in which the side is drawn
        drawn = np.array([axis.drawn for axis in self.coupled.axes])
        return self.coupled.group_motions(q - drawn)

    def _base_motion(self) -> Array:
        """Return `X` without what no hinge determines: a shift along them."""
        along = self.coupled.axes[self.leader].direction
        X = self.X.copy()
        X[:3, 3] -= along * (along @ X[:3, 3])
        return X

    def _tool_frames_gap(self) -> Array | None:
        """Return T_linkage_coupled (4, 4) of the tool frames at state zero, or None."""
        linkage = self.motion.linkage
        for side in (linkage, self.coupled):
            if side.is_tool_guessed or side.tool not in side.frames:
                return None
        own_group, T_own = linkage.frames[linkage.tool]
        group, T = self.coupled.frames[self.coupled.tool]
        if self.groups.get(group) != own_group:
            return None
        T_linkage = self.X @ _motions_to_zero(self.motion, self.x_zero)[own_group] @ T_own
        if not np.array_equal(self.X, np.eye(4)):  # how far the bases are apart along the hinges is not known
            along = self.coupled.axes[self.leader].direction
            T_linkage[:3, 3] += along * (along @ (T[:3, 3] - T_linkage[:3, 3]))
        return spatial.inverse(T_linkage) @ T

    def _moved_hinges(self) -> tuple[tuple[str, float], ...]:
        """Return (name, distance in m) of the hinges whose places differ at state zero."""
        points = _hinge_points(self.motion.linkage, _motions_to_zero(self.motion, self.x_zero), self.X)
        moved_hinges = []
        for k, i in self.partners.items():
            axis = self.coupled.axes[k]
            offset = points[i] - axis.point
            distance = float(np.linalg.norm(offset - axis.direction * (offset @ axis.direction)))
            if distance > _SMALLEST_SHOWN_DISTANCE:
                moved_hinges.append((axis.name, distance))
        return tuple(moved_hinges)


def _common_stroke(first: tuple[float, float] | None, second: tuple[float, float] | None) -> tuple[float, float] | None:
    """Return the common range in rad of two limits, half a turn where none is finite; None if there is none."""
    lows = []
    highs = []
    for limits in (first, second):
        if limits is None:
            continue
        if np.isfinite(limits[0]):
            lows.append(limits[0])
        if np.isfinite(limits[1]):
            highs.append(limits[1])
    low = max(lows, default=-np.pi)
    high = min(highs, default=np.pi)
    if low >= high:
        return None
    return float(low), float(high)
