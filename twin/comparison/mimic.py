"""A linkage with loops against a description that replaces its loops by linear couplings (mimic joints).

A gripper's finger is often a four-bar linkage, which URDF cannot close: its files open the loops, and let joints follow
the driven one linearly. The joints then correspond only in part, so that no joint-by-joint comparison exists. Here the
hinges of both sides are matched by their places: hinges that only the linkage has are either held in the other side
(its links are one link there), or missing (its loop is open there). The loops are closed along the stroke of the driven
joint, by Newton steps on the joint lines, and the links are compared with those that the couplings place.

This works for linkages whose hinges are all parallel, at state zero of all hinges of the coupled side.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np

from twin.comparison.properties import followed_of
from twin.comparison.side import Axis, RobotSide
from twin.core import spatial
from twin.core.json_types import JsonObject
from twin.core.quantity import deg, mm, moved
from twin.core.spatial import Array
from twin.core.units import DEG, MM

NEAR = 2e-3
"""Distance in m up to which two hinges are taken for the same one, drawn inaccurately."""

_PARALLEL = 1e-3
"""Angle in rad up to which hinges are parallel."""

_STATES = 81
"""Number of states along the stroke."""

_SAME = 1e-6
"""Distance in m up to which the hinges on the base coincide as they are drawn."""

_MOST_HINGES = 6
"""Maximum number of hinges on the base whose assignments are tried."""

_ROUNDS = 30
"""Maximum number of Newton steps that close the loops at one state."""

_CLOSED = 1e-9
"""Gap in m up to which a loop is closed."""

_LARGEST_STEP = 0.05
"""Largest step of the driver in rad on the way from its drawn state to zero."""

_STEP = 1e-7
"""Step in rad for derivatives by differences."""


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


@dataclass(frozen=True)
class MimicError:
    """What the couplings of one side say about the loops of the other.

    Attributes:
        linkage, coupled: labels of the side with loops, and of the side with couplings.
        leader: the driven joint of the coupled side; `stroke` is its common range in m or rad.
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

    def within(self, distance: float, angle: float) -> bool:
        """Return whether no hinge or link is further away than a distance in m, or turned more than an angle in rad."""
        if any(apart > distance for _, apart in self.moved_hinges):
            return False
        return all(link.distance <= distance and link.angle <= angle for link in self.links)

    def text(self) -> str:
        """Return the errors as one sentence."""
        worst = self.worst
        most_turned = max(self.links, key=lambda link: link.angle)
        low, high = (moved(value, True) for value in self.stroke)
        return (
            f"the mimic joints of {self.coupled} place link '{worst.link}' up to {mm(worst.distance)} away from where "
            f"the loops of {self.linkage} place it, at '{self.leader}' = {moved(worst.at_distance, True)}, and turn "
            f"'{most_turned.link}' up to {deg(most_turned.angle)} too far or too little, at '{self.leader}' = "
            f"{moved(most_turned.at_angle, True)} (stroke {low} .. {high})"
        )

    def part_text(self) -> str:
        """Return which joints correspond only in part, and why."""
        parts = []
        for names, what in ((self.held, "holds"), (self.missing, "opens the loops at")):
            if names:
                parts.append(f"{self.coupled} {what} {', '.join(names)}")
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
        return {
            "linkage": self.linkage,
            "coupled": self.coupled,
            "leader": self.leader,
            "stroke_deg": [value / DEG for value in self.stroke],
            "links": links,
            "moved_hinges_mm": {name: distance / MM for name, distance in self.moved_hinges},
            "held": list(self.held),
            "missing": list(self.missing),
        }


def mimic_error(linkage: RobotSide, coupled: RobotSide) -> MimicError | None:
    """Return the error of the couplings of one side over the stroke; None if the sides are no such pair."""
    leaders = _leaders(coupled)
    if not linkage.looped or coupled.looped or not coupled.couplings or len(leaders) != 1:
        return None
    if any(axis.kind != "revolute" for axis in (*linkage.tree, *coupled.tree)):
        return None
    closing = [axis for axis in linkage.axes if axis.closing]
    if any(axis.kind not in ("revolute", "spherical") for axis in closing):
        return None  # a loop is closed by a point that both links share: a slide or a cylinder shares none
    pins = [axis for axis in closing if axis.kind == "revolute"]
    if not _parallel([*linkage.tree, *pins]) or not _parallel(coupled.axes):
        return None
    return _Linkages(linkage, coupled, leaders[0]).error()


def _parallel(axes: Sequence[Axis]) -> bool:
    """Return whether all hinges are parallel; which way along their lines is positive does not matter."""
    turned = [np.linalg.norm(np.cross(axis.direction, axes[0].direction)) for axis in axes]
    return float(max(turned)) <= _PARALLEL


def _leaders(side: RobotSide) -> list[int]:
    followers = followed_of(side)
    return [i for i in range(len(side.axes)) if i not in followers]


class _Linkages:
    def __init__(self, linkage: RobotSide, coupled: RobotSide, leader: int) -> None:
        self.linkage = linkage
        self.coupled = coupled
        self.leader = leader
        self.driver = -1
        self.X = np.eye(4)
        self.held: set[int] = set()
        self.zero = np.tile(np.eye(4), (len(linkage.groups), 1, 1))
        """Motions (groups, 4, 4) of the linkage from its drawn state to the state zero of its driver."""

    def error(self) -> MimicError | None:
        """Return the error; None if the hinges of the coupled side are not those of the linkage."""
        X = self._base()
        if X is None:
            return None
        self.X = X
        driver = self._nearest(self.coupled.axes[self.leader], self._points(), ())
        if driver is None or driver >= len(self.linkage.tree):
            return None
        self.driver = driver
        # the hinges of the coupled side are known at zero: those of the linkage must be at the same state
        if self._to_zero() is None:
            return None
        points = self._points()
        partners: dict[int, int] = {}
        for k, axis in enumerate(self.coupled.axes):
            partner = self._nearest(axis, points, list(partners.values()))
            if partner is None:
                return None
            partners[k] = partner
        groups = self._groups(partners)
        if groups is None or partners[self.leader] != self.driver:
            return None
        return self._measured(partners, groups)

    # -- matching -------------------------------------------------------------------------------------

    def _points(self) -> Array:
        """Return the points (joints, 3) of the linkage's hinges at `zero`, in the base of the coupled side."""
        points = []
        for axis in self.linkage.axes:
            motion = self.zero[axis.parent]
            points.append(motion[:3, :3] @ axis.point + motion[:3, 3])
        return np.array(points) @ self.X[:3, :3].T + self.X[:3, 3]

    def _base(self) -> Array | None:
        """Return the motion (4, 4) of the linkage's base that brings the hinges on the base together."""
        own_hinges = [axis for axis in self.linkage.tree if axis.parent == 0]
        target = [axis for axis in self.coupled.tree if axis.parent == 0]
        if len(own_hinges) < 2 or len(own_hinges) != len(target) or len(own_hinges) > _MOST_HINGES:
            return None
        goal = np.array([axis.point for axis in target])
        along = target[0].direction
        same = np.eye(4)
        for chosen in permutations(own_hinges):
            points = np.array([axis.point for axis in chosen])
            if (
                _off(same, points, goal, along).max() < _SAME
                and abs(own_hinges[0].direction @ along) > 1.0 - _PARALLEL**2
            ):
                return same  # two hinges also coincide after half a turn about the line across them
        best: Array | None = None
        least = np.inf
        for chosen in permutations(own_hinges):
            points = np.array([axis.point for axis in chosen])
            for direction in (own_hinges[0].direction, -own_hinges[0].direction):
                if _off(_plane_fit(points, goal, direction, along), points, goal, along).max() > NEAR:
                    continue
                # two hinges that coincide are likelier than all that nearly do
                for pair in combinations(range(len(points)), 2):
                    X = _plane_fit(points[list(pair)], goal[list(pair)], direction, along)
                    gap = float(_off(X, points, goal, along).sum())
                    if gap < least - 1e-9:
                        least = gap
                        best = X
        return best

    def _nearest(self, axis: Axis, points: Array, used: Collection[int]) -> int | None:
        """Return the hinge of the linkage nearest to a hinge of the coupled side, within `NEAR`."""
        offsets = points - axis.point
        distances = np.linalg.norm(offsets - np.outer(offsets @ axis.direction, axis.direction), axis=1)
        for i in used:
            distances[i] = np.inf
        nearest = int(np.argmin(distances))
        if distances[nearest] > NEAR:
            return None
        return nearest

    def _groups(self, partners: dict[int, int]) -> dict[int, int] | None:
        """Return {group of the coupled side: group of the linkage}; hinges of the linkage between them are held."""
        groups = {0: 0}
        matched = set(partners.values())
        for k, axis in enumerate(self.coupled.axes):
            partner = self.linkage.axes[partners[k]]
            start = groups[axis.parent]
            ends = (partner.parent, partner.child)
            if start not in ends:
                bridges = []
                for i, other in enumerate(self.linkage.tree):
                    if i in matched:
                        continue
                    if other.parent == start and other.child in ends:
                        bridges.append((i, other.child))
                if len(bridges) != 1:
                    return None
                self.held.add(bridges[0][0])
                start = bridges[0][1]
            groups[axis.child] = ends[1] if ends[0] == start else ends[0]
        return groups

    # -- motion ---------------------------------------------------------------------------------------

    def _free(self) -> list[int]:
        """Return the joints of the linkage's tree that close its loops."""
        followers = followed_of(self.linkage)
        free = []
        for i in range(len(self.linkage.tree)):
            coupled = i in followers or self._leads(i)
            if i != self.driver and i not in self.held and not coupled:
                free.append(i)
        return free

    def _leads(self, i: int) -> bool:
        """Return whether a joint moves with the driver by a coupling."""
        return any(self.linkage.axes[i].name in coupling.ratios for coupling in self.linkage.couplings)

    def _with_driver(self, value: float, free: Sequence[int], x: Array) -> Array:
        """Return the displacements (joints of the tree,) of the linkage at a coordinate of the driver."""
        tree = self.linkage.tree
        q = np.array([axis.drawn for axis in self.linkage.axes])
        q[self.driver] = value
        q[list(free)] = x
        for i, (ratios, offset) in followed_of(self.linkage).items():
            if i == self.driver:  # the driver follows in the file: move its leader
                leader = int(np.argmax(np.abs(ratios)))
                q[leader] = (value - offset) / ratios[leader]
        for i, (ratios, offset) in followed_of(self.linkage).items():
            if i != self.driver:
                q[i] = ratios @ q + offset
        return (q - np.array([axis.drawn for axis in self.linkage.axes]))[: len(tree)]

    def _gaps(self, values: Array) -> Array:
        """Return the gaps of the loops (k, rows) for displacements (k, joints of the tree)."""
        motions = self.linkage.poses(values)
        rows = []
        for axis in self.linkage.axes:
            if not axis.closing:
                continue
            ends = []
            for group in (axis.parent, axis.child):
                ends.append(motions[:, group, :3, :3] @ axis.point + motions[:, group, :3, 3])
            rows.append(ends[0] - ends[1])
        return np.concatenate(rows, axis=1)

    def _closed(self, value: float, free: Sequence[int], x: Array) -> Array | None:
        """Return the values of the free joints that close the loops, near `x`; None if they do not close."""
        for _ in range(_ROUNDS):
            tried = [x, *(x + _STEP * row for row in np.eye(len(x)))]
            r = self._gaps(np.array([self._with_driver(value, free, one) for one in tried]))
            if np.abs(r[0]).max() < _CLOSED:
                return x
            J = (r[1:] - r[0]).T / _STEP
            x = x - np.linalg.lstsq(J, r[0], rcond=1e-9)[0]
        return None

    def _to_zero(self) -> Array | None:
        """Return the values of the free joints at the state zero of the driver, and set `zero`; None if it opens."""
        free = self._free()
        x: Array | None = np.array([self.linkage.axes[i].drawn for i in free])
        drawn = self.linkage.axes[self.driver].drawn
        steps = 1 + int(np.ceil(abs(drawn) / _LARGEST_STEP))
        for value in np.linspace(drawn, 0.0, steps + 1)[1:]:
            assert x is not None
            x = self._closed(float(value), free, x)
            if x is None:
                return None
        assert x is not None
        self.zero = self.linkage.poses(self._with_driver(0.0, free, x)[None])[0]
        return x

    def _measured(self, partners: dict[int, int], groups: dict[int, int]) -> MimicError | None:
        axis = self.coupled.axes[self.leader]
        driver = self.linkage.axes[self.driver]
        sign = float(np.sign(axis.direction @ (self.X[:3, :3] @ driver.direction)))
        ends: tuple[float, float] | None = None
        if driver.limits is not None:
            first, last = sorted(sign * limit for limit in driver.limits)
            ends = (first, last)
        stroke_ends = _stroke(axis.limits, ends)
        if stroke_ends is None:
            return None
        low, high = stroke_ends
        free = self._free()
        stroke = np.linspace(low, high, _STATES)
        start = int(np.argmin(np.abs(stroke)))
        x0 = self._to_zero()  # again: now the joints that the coupled side holds are known
        if x0 is None:
            return None
        solved: dict[int, Array] = {}
        for order in (range(start, _STATES), range(start - 1, -1, -1)):
            x = x0
            for k in order:
                found = self._closed(float(sign * stroke[k]), free, x)
                if found is None:
                    return None
                x = solved[k] = found
        closed = []
        for k in range(_STATES):
            closed.append(self._with_driver(float(sign * stroke[k]), free, solved[k]))
        loops = np.array(closed)
        at_zero = self._with_driver(0.0, free, x0)
        motions = self.linkage.poses(np.vstack([at_zero, loops]))
        # the linkage's motions since the state zero of the driver, in the base of the coupled side
        since = self.X @ motions[1:] @ spatial.inverse(motions[0]) @ spatial.inverse(self.X)
        coupled = self._coupled(stroke)
        links = []
        for group, partner in groups.items():
            if group:
                links.append(self._link(group, since[:, partner], coupled[:, group], stroke))
        moved_hinges = self._moved(partners)
        names = [one.name for one in self.linkage.axes]
        known = {*partners.values(), *self.held}
        return MimicError(
            self.linkage.label,
            self.coupled.label,
            axis.name,
            (float(low), float(high)),
            tuple(links),
            moved_hinges,
            tuple(names[i] for i in sorted(self.held)),
            tuple(name for i, name in enumerate(names) if i not in known),
            self._base_motion(axis.direction),
            self._tool(groups),
            (ends, axis.limits),
        )

    def _base_motion(self, along: Array) -> Array:
        """Return `X` without what no hinge determines: a shift along them."""
        X = self.X.copy()
        X[:3, 3] -= along * (along @ X[:3, 3])
        return X

    def _tool(self, groups: dict[int, int]) -> Array | None:
        """Return T_linkage_coupled (4, 4) of the tool frames at state zero, or None."""
        for side in (self.linkage, self.coupled):
            if side.guessed_tool or side.tool not in side.frames:
                return None
        own_group, T_own = self.linkage.frames[self.linkage.tool]
        group, T = self.coupled.frames[self.coupled.tool]
        if groups.get(group) != own_group:
            return None
        T_linkage = self.X @ self.zero[own_group] @ T_own
        if not np.array_equal(self.X, np.eye(4)):  # how far the bases are apart along the hinges is not known
            along = self.coupled.axes[self.leader].direction
            T_linkage[:3, 3] += along * (along @ (T[:3, 3] - T_linkage[:3, 3]))
        return spatial.inverse(T_linkage) @ T

    def _coupled(self, stroke: Array) -> Array:
        """Return the motions (k, groups, 4, 4) of the coupled side along its stroke."""
        q = np.zeros((len(stroke), len(self.coupled.axes)))
        q[:, self.leader] = stroke
        for i, (ratios, offset) in followed_of(self.coupled).items():
            q[:, i] = q @ ratios + offset
        return self.coupled.poses(q - np.array([axis.drawn for axis in self.coupled.axes]))

    def _link(self, group: int, linkage: Array, coupled: Array, stroke: Array) -> LinkError:
        """Return the largest error of a link at its hinges and the frames on it."""
        side = self.coupled
        points = [axis.point for axis in side.axes if group in (axis.parent, axis.child)]
        points += [T[:3, 3] for of_group, T in side.frames.values() if of_group == group]
        inertia = side.groups[group].inertia
        if inertia is not None:
            points.append(inertia.p_body_com)
        placed = []
        for motions in (linkage, coupled):
            placed.append(np.array(points) @ np.swapaxes(motions[:, :3, :3], 1, 2) + motions[:, None, :3, 3])
        distances = np.linalg.norm(placed[0] - placed[1], axis=2).max(axis=1)
        angles = spatial.rotation_angle(np.swapaxes(linkage[:, :3, :3], 1, 2) @ coupled[:, :3, :3])
        k = int(np.argmax(distances))
        n = int(np.argmax(angles))
        name = side.groups[group].bodies[0]
        return LinkError(name, float(distances[k]), float(angles[n]), float(stroke[k]), float(stroke[n]))

    def _moved(self, partners: dict[int, int]) -> tuple[tuple[str, float], ...]:
        """Return the hinges whose places differ by more than a hundredth of a millimetre."""
        points = self._points()
        moved_hinges = []
        for k, i in partners.items():
            axis = self.coupled.axes[k]
            offset = points[i] - axis.point
            distance = float(np.linalg.norm(offset - axis.direction * (offset @ axis.direction)))
            if distance > 1e-5:
                moved_hinges.append((axis.name, distance))
        return tuple(moved_hinges)


def _stroke(first: tuple[float, float] | None, second: tuple[float, float] | None) -> tuple[float, float] | None:
    """Return the common range in rad of two limits, half a turn where none is finite; None if there is none."""
    low = -np.pi
    high = np.pi
    finite: list[list[float]] = [[], []]
    for limits in (first, second):
        for k, end in enumerate(limits or ()):
            if np.isfinite(end):
                finite[k].append(end)
    if finite[0]:
        low = max(finite[0])
    if finite[1]:
        high = min(finite[1])
    return (float(low), float(high)) if low < high else None


def _off(X: Array, points: Array, goal: Array, along: Array) -> Array:
    """Return the distances (n,) of moved points from others; along the hinges, nothing is compared."""
    offsets = points @ X[:3, :3].T + X[:3, 3] - goal
    return np.linalg.norm(offsets - np.outer(offsets @ along, along), axis=1)


def _plane_fit(points: Array, goal: Array, direction: Array, target: Array) -> Array:
    """Return the motion (4, 4) that turns `direction` onto `target` and best brings points (n, 3) onto others."""
    R_direction = spatial.frame_from_axes(direction, spatial.unit_across(direction))
    R_target = spatial.frame_from_axes(target, spatial.unit_across(target))
    R0 = R_target @ R_direction.T
    turned_points = (points - points.mean(axis=0)) @ R0.T
    other = goal - goal.mean(axis=0)
    other = other - np.outer(other @ target, target)
    turned_points = turned_points - np.outer(turned_points @ target, target)
    a = float(np.sum(turned_points * other))
    b = float(np.sum(np.cross(turned_points, other) @ target))
    R = spatial.exp_so3(np.arctan2(b, a) * target) @ R0
    return spatial.pose(R, goal.mean(axis=0) - R @ points.mean(axis=0))
