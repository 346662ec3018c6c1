"""Robots with loops whose links differ: which joint has another place on which link.

Each link of the first side is moved, as a rigid body, onto the link of the second side that carries the same joints.
All links together must bring the lines of all joints together, on the parent and on the child: then both robots are the
same up to conventions. If they do not, the fewest places of joints are searched without which all other places agree.
A joint can have another place on its parent, on its child, or, as where a file states one point for both, on both.

The search of deviating joints in `search` follows a tree, in which a joint that closes a loop has no child to move;
here all joints are treated alike, and the posture in which a side is drawn does not matter.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Literal

import numpy as np

from twin.comparison.fit import Problem
from twin.comparison.items import ComparedItem, placed
from twin.comparison.side import ONE_COORDINATE, TURNING, Axis, JointGroup, RobotSide
from twin.core import spatial
from twin.core.spatial import Array

Where = Literal["parent", "child", "both"]

_ENDS: tuple[Where, ...] = ("parent", "child")

_ROUNDS = 12
"""Maximum number of Gauss-Newton steps."""

_DONE = 1e-12
"""Step in m and rad that is no longer made."""

_DAMPING = 1e-11
"""Damping, relative to the largest diagonal element, of motions that do not change the lines: a bar between balls."""

_REWEIGHTED = 12
"""Number of fits that find the places which differ most, each with less weight for places that do not fit."""

_PAIRED = 8
"""Number of joints of which two are tried together."""


@dataclass(frozen=True)
class JointPlace:
    """The place of a joint on its parent, its child, or both, which differs: shift (3,) in m, turn (3,) in rad."""

    joint: int
    where: Where
    shift: Array
    turn: Array


class LinkMotions:
    """The motions of the links of the first side onto those of the second."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.groups = len(problem.first.groups)
        rows: list[tuple[int, Where]] = []
        for i, kind in enumerate(problem.kinds):
            if kind == "free":
                continue
            rows += _at(i, _ENDS)
            if kind in ("revolute", "prismatic"):
                rows.append((i, "both"))
        self.blocks = rows

    def block(self, T: Array, i: int, where: Where) -> tuple[Array, Array]:
        """Return (residual (rows,), derivatives (rows, 6 groups)) of one place, or of what a joint's places share."""
        axis = self.problem.axes[i]
        kind = self.problem.kinds[i]
        if where != "both":
            return self._place(T, i, axis.parent if where == "parent" else axis.child)
        along = self.problem.target_directions[i]
        on_parent, moved_parent = self._point(T, i, axis.parent)
        on_child, moved_child = self._point(T, i, axis.child)
        apart = on_parent - on_child
        moved = moved_parent - moved_child
        if kind == "prismatic":
            J = np.zeros((3, 6 * self.groups))
            between = T[axis.parent, :3, :3] @ T[axis.child, :3, :3].T
            J[:, 6 * axis.parent : 6 * axis.parent + 3] = np.eye(3)
            J[:, 6 * axis.child : 6 * axis.child + 3] = -np.eye(3)
            # a slide may begin anywhere, but the child moves only along it
            rows = [spatial.log_so3(between), np.cross(apart, along)]
            return np.concatenate(rows), np.vstack([J, -spatial.hat(along) @ moved])
        return np.array([along @ apart]), (along @ moved)[None]

    def _point(self, T: Array, i: int, group: int) -> tuple[Array, Array]:
        """Return the point (3,) of a joint on a link, and its derivatives (3, 6 groups)."""
        point = T[group, :3, :3] @ self.problem.points[i] + T[group, :3, 3]
        moved = np.zeros((3, 6 * self.groups))
        moved[:, 6 * group : 6 * group + 3] = -spatial.hat(point)
        moved[:, 6 * group + 3 : 6 * group + 6] = np.eye(3)
        return point, moved

    def _place(self, T: Array, i: int, group: int) -> tuple[Array, Array]:
        kind = self.problem.kinds[i]
        point, moved = self._point(T, i, group)
        to_line = point - self.problem.target_points[i]
        if kind == "spherical":
            return to_line, moved
        target = self.problem.target_directions[i]
        direction = T[group, :3, :3] @ self.problem.directions[i]
        if direction @ target < 0.0:  # which way is positive is a convention
            direction = -direction
        turned = np.zeros((3, 6 * self.groups))
        turned[:, 6 * group : 6 * group + 3] = -spatial.hat(direction)
        rows = [direction - target]
        derivatives = [turned]
        if kind in TURNING:
            rows.append(np.cross(to_line, target))
            derivatives.append(-spatial.hat(target) @ moved)
        return np.concatenate(rows), np.vstack(derivatives)

    def solved(self, kept: Sequence[tuple[int, Where]], weights: Sequence[float], start: Array) -> Array:
        """Return the motions (groups, 4, 4) that bring the kept places together, in the sense of least squares."""
        T = start.copy()
        for _ in range(_ROUNDS):
            parts = [self.block(T, i, where) for i, where in kept]
            r = np.concatenate([weight * part[0] for weight, part in zip(weights, parts, strict=True)])
            J = np.vstack([weight * part[1] for weight, part in zip(weights, parts, strict=True)])
            normal = J.T @ J
            damping = _DAMPING * float(normal.diagonal().max())
            step = np.linalg.solve(normal + damping * np.eye(len(normal)), -J.T @ r).reshape(self.groups, 6)
            T = spatial.pose(spatial.exp_so3(step[:, :3]), step[:, 3:]) @ T
            # a rotation about the origin, then the shift: the derivatives are those of points after the motion
            if np.abs(step).max() < _DONE:
                break
        return T

    def misfit(self, T: Array, i: int, where: Where) -> float:
        """Return by how much a place differs, in units of the tolerance."""
        kind = self.problem.kinds[i]
        r = self.block(T, i, where)[0]
        # a ball is a point, and the places of a hinge share a shift along its line: lengths without an angle
        if kind == "spherical" or (kind == "revolute" and where == "both"):
            return float(np.linalg.norm(r)) / self.problem.tolerance
        turn = float(np.linalg.norm(r[:3])) / self.problem.angle_tolerance
        shift = float(np.linalg.norm(r[3:])) / self.problem.tolerance
        return max(turn, shift)

    def fit(self, T: Array, kept: Sequence[tuple[int, Where]]) -> bool:
        """Return whether the kept places agree within the tolerance."""
        return max(self.misfit(T, i, where) for i, where in kept) <= 1.0

    def together(self) -> Array:
        """Return the motions (groups, 4, 4) that bring all places together, in the sense of least squares."""
        identity = np.tile(np.eye(4), (self.groups, 1, 1))
        return self.solved(self.blocks, np.ones(len(self.blocks)).tolist(), identity)

    def without(self, left_out: Sequence[tuple[int, Where]]) -> list[tuple[int, Where]]:
        """Return the places without some: leaving a place out leaves out what it shares with the other one."""
        kept = []
        for i, where in self.blocks:
            left_out_here = [chosen for joint, chosen in left_out if joint == i]
            if left_out_here and (where == "both" or "both" in left_out_here or where in left_out_here):
                continue
            kept.append((i, where))
        return kept

    def explained(self, left_out: Sequence[tuple[int, Where]], start: Array) -> tuple[JointPlace, ...] | None:
        """Return the places that are left out, if all others agree without them; else None."""
        kept = self.without(left_out)
        T = self.solved(kept, np.ones(len(kept)).tolist(), start)
        if not self.fit(T, kept):
            return None
        return tuple(self._gap(T, i, where) for i, where in left_out)

    def _gap(self, T: Array, i: int, where: Where) -> JointPlace:
        """Return how the place of a joint in the first side differs from that in the second."""
        axis = self.problem.axes[i]
        group = axis.child if where == "child" else axis.parent
        point, _ = self._point(T, i, group)
        target = self.problem.target_directions[i]
        shift = point - self.problem.target_points[i]
        turn = np.zeros(3)
        kind = self.problem.kinds[i]
        if kind != "spherical":
            direction = T[group, :3, :3] @ self.problem.directions[i]
            if direction @ target < 0.0:
                direction = -direction
            across = np.cross(target, direction)
            sine = float(np.linalg.norm(across))
            if sine > 0.0:
                turn = np.arctan2(sine, target @ direction) * across / sine
            shift = shift - target * (shift @ target)
        if kind == "prismatic":
            shift = np.zeros(3)  # a slide has no place by itself, but its two links have one across it
        if kind in ONE_COORDINATE and where != "both":
            other = axis.parent if where == "child" else axis.child
            apart = point - self._point(T, i, other)[0]
            along = target * (target @ apart)
            shift = shift + (along if kind == "revolute" else apart - along)
        return JointPlace(i, where, shift, turn)


def posed(problem: Problem) -> tuple[RobotSide, RobotSide] | None:
    """Return both sides, the first in the posture in which the second is drawn; None if its links differ.

    The bodies of the first side stay where its base is. The spin of a bar between two balls is not known: neither side
    then has the inertia of the bar.
    """
    links = LinkMotions(problem)
    T = links.together()
    if not links.fit(T, links.blocks):
        return None
    moves = spatial.inverse(T[0]) @ T
    axes: list[Axis] = []
    for axis in problem.first.axes:
        displacement = _displacement(axis, moves)
        if displacement is None:
            return None
        M = moves[axis.parent]
        point = M[:3, :3] @ axis.point + M[:3, 3]
        direction = M[:3, :3] @ axis.direction
        axes.append(replace(axis, point=point, direction=direction, drawn=axis.drawn + displacement))
    frames: dict[str, tuple[int, Array]] = {}
    for name, (group, frame) in problem.first.frames.items():
        frames[name] = (group, moves[group] @ frame)
    groups: list[JointGroup] = []
    for group, M in zip(problem.first.groups, moves, strict=True):
        inertia = group.inertia
        groups.append(replace(group, inertia=None if inertia is None else inertia.seen_from(M)))
    partners = list(problem.second.groups)
    for i, axis in enumerate(problem.axes):
        if _spins(problem, axis.child):
            groups[axis.child] = replace(groups[axis.child], inertia=None)
            partner = problem.second.axes[i].child
            partners[partner] = replace(partners[partner], inertia=None)
    first = replace(problem.first, axes=tuple(axes), frames=frames, groups=tuple(groups))
    return first, replace(problem.second, groups=tuple(partners))


def _displacement(axis: Axis, moves: Array) -> float | None:
    """Return by how much a joint moves, in m or rad, if its links move by `moves` (groups, 4, 4).

    None if its child is turned around across its line, which no motion of the joint does.
    """
    T = spatial.inverse(moves[axis.parent]) @ moves[axis.child]
    R = T[:3, :3]
    turned_around = axis.direction @ R @ axis.direction < 0.0
    if turned_around and axis.kind not in ("spherical", "free"):
        return None
    if axis.kind not in ONE_COORDINATE:
        return 0.0
    if axis.kind == "prismatic":
        moved_point = R @ axis.point + T[:3, 3]
        return float(axis.direction @ (moved_point - axis.point))
    return float(axis.direction @ spatial.log_so3(R))


def _spins(problem: Problem, group: int) -> bool:
    """Return whether a group is a bar between at most two balls, which can spin about its line."""
    kinds = [axis.kind for axis in problem.axes if group in (axis.parent, axis.child)]
    return group != 0 and len(kinds) <= 2 and set(kinds) == {"spherical"}


def differing_places(problem: Problem) -> list[tuple[JointPlace, ...]]:
    """Return the explanations with the fewest places of joints that differ; [] if no two places explain all.

    Each explanation is a tuple of one or two places. Several explanations are as good: of a bar with two joints,
    either has another place. A place that differs by less than the tolerance explains nothing.
    """
    explanations: list[tuple[JointPlace, ...]] = []
    for places in _explanations(problem):
        if not all(_same(problem, place) for place in places):
            explanations.append(places)
    return explanations


def _same(problem: Problem, place: JointPlace) -> bool:
    shift = float(np.linalg.norm(place.shift))
    turn = float(np.linalg.norm(place.turn))
    return shift <= problem.tolerance and turn <= problem.angle_tolerance


def _explanations(problem: Problem) -> list[tuple[JointPlace, ...]]:
    links = LinkMotions(problem)
    start = links.together()
    singles: list[tuple[int, Where]] = []
    for i, kind in enumerate(problem.kinds):
        if kind != "free":
            singles += _at(i, _ENDS)
    found = [links.explained([one], start) for one in singles]
    known = [explanation for explanation in found if explanation is not None]
    if known:
        return known
    suspects = _suspects(links, start)
    both: Where = "both"
    found = [links.explained([(i, both)], start) for i in suspects]
    known = [explanation for explanation in found if explanation is not None]
    if known:
        return known
    places: list[tuple[int, Where]] = []
    for i in suspects[:_PAIRED]:
        places += _at(i, (*_ENDS, both))
    for one, other in combinations(places, 2):
        if one[0] == other[0]:
            continue
        explanation = links.explained([one, other], start)
        if explanation is not None:
            known.append(explanation)
    # what moves on one link is a simpler explanation than what moves on both
    simplest: list[tuple[JointPlace, ...]] = []
    fewest = math.inf
    for explanation in known:
        on_both = sum(place.where == "both" for place in explanation)
        if on_both < fewest:
            simplest = []
            fewest = on_both
        if on_both == fewest:
            simplest.append(explanation)
    return simplest


def _at(joint: int, wheres: Sequence[Where]) -> list[tuple[int, Where]]:
    places: list[tuple[int, Where]] = []
    for where in wheres:
        places.append((joint, where))
    return places


def _suspects(links: LinkMotions, start: Array) -> list[int]:
    """Return the joints, those first that fit least if as many places as possible fit."""
    T = start
    for _ in range(_REWEIGHTED):
        weights = [1.0 / np.sqrt(max(links.misfit(T, i, where), 1e-2)) for i, where in links.blocks]
        T = links.solved(links.blocks, weights, T)
    worst = np.zeros(links.problem.count)
    for i, where in links.blocks:
        worst[i] = max(worst[i], links.misfit(T, i, where))
    return [int(i) for i in np.argsort(-worst, kind="stable")]


def place_items(problem: Problem, places: Sequence[JointPlace]) -> list[ComparedItem]:
    """Return the differences as items."""
    items = []
    for place in places:
        joint = problem.second.axes[place.joint]
        groups = problem.second.groups
        names = {"parent": groups[joint.parent].bodies[-1], "child": groups[joint.child].bodies[-1]}
        link = names["child" if place.where == "child" else "parent"]
        on = f"on link '{link}'"
        if place.where == "both":
            on = f"on links '{names['parent']}' and '{names['child']}'"
        shift = place.shift if np.linalg.norm(place.shift) > 1e-9 else np.zeros(3)
        turn = place.turn if np.linalg.norm(place.turn) > 1e-9 else np.zeros(3)
        text = f"the place of joint '{joint.name}' {on} differs by {placed(shift, turn)}"
        length = float(np.linalg.norm(shift))
        items.append(ComparedItem("link", joint.name, text, link, length, float(np.linalg.norm(turn))))
    return items
