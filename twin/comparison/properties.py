"""Limits, speeds, efforts, masses and couplings of two sides, each kind with its own verdict."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from twin.comparison.evidence import CENTRE, LIMIT, RELATIVE
from twin.comparison.fit import FitSolution, Problem, values_of
from twin.comparison.items import NumberEdit
from twin.comparison.search import zero_of
from twin.comparison.side import ONE_COORDINATE, UNLIMITED, Axis, RobotSide
from twin.core.json_types import JsonObject
from twin.core.quantity import moved
from twin.core.spatial import Array

RATIO = 1e-4
"""Difference of ratios of couplings up to which they are equal, relative."""

KINDS: tuple[str, ...] = ("limits", "speeds", "efforts", "masses", "centres of mass", "inertias", "couplings")


@dataclass(frozen=True)
class PropertyRow:
    """One compared value that differs, or that only one side states.

    Attributes:
        kind: one of `KINDS`.
        where: name of the joint or link in the second side.
        first, second: the values as text, "-" if a side does not state it.
        stated: whether both sides state it, so that they disagree.
        index: the joint; for masses, centres and inertias the group of the first side.
        edits: edits that make both sides agree.
        together: whether all edits of one side are needed, not only one of them.
    """

    kind: str
    where: str
    first: str
    second: str
    stated: bool
    index: int = -1
    edits: tuple[NumberEdit, ...] = ()
    together: bool = False

    def as_dict(self) -> JsonObject:
        """Return the row as plain data."""
        return {
            "kind": self.kind,
            "where": self.where,
            "first": self.first,
            "second": self.second,
            "stated_by_both": self.stated,
            "edits": [edit.as_dict() for edit in self.edits],
            "edits_together": self.together,
        }


@dataclass(frozen=True)
class Properties:
    """Rows that differ, and for each kind how many values were compared."""

    rows: tuple[PropertyRow, ...]
    compared: dict[str, int]

    def verdict(self, kind: str) -> str:
        """Return "agree", "disagree" or "not stated" for one kind."""
        for row in self.rows:
            if row.kind == kind and row.stated:
                return "disagree"
        if self.compared[kind]:
            return "agree"
        return "not stated"


def compare(problem: Problem, solution: FitSolution) -> Properties:
    """Compare the properties of two sides after the conventions of a solution."""
    rows: list[PropertyRow] = []
    compared: dict[str, int] = dict.fromkeys(KINDS, 0)
    for i, axis in enumerate(problem.axes):
        if axis.kind in ONE_COORDINATE:
            _joint(problem, solution, i, rows, compared)
        else:
            _parts(problem, i, rows)
    _masses(problem, solution, rows, compared)
    _couplings(problem, solution, rows, compared)
    return Properties(tuple(rows), compared)


def _joint(problem: Problem, solution: FitSolution, i: int, rows: list[PropertyRow], compared: dict[str, int]) -> None:
    first = problem.axes[i]
    second = problem.second.axes[i]

    def angle(value: float) -> str:
        return str(moved(value, second.is_angle))

    def interval(limits: tuple[float, float] | None) -> str:
        if limits is None:
            return "-"
        if limits == UNLIMITED:
            return "no limits"
        return f"{angle(limits[0])} .. {angle(limits[1])}"

    mapped = mapped_limits(problem, solution, i)
    if mapped is not None and second.limits is not None:
        compared["limits"] += 1
        low = abs(mapped[0] - second.limits[0])
        high = abs(mapped[1] - second.limits[1])
        if not (low <= LIMIT or mapped[0] == second.limits[0]) or not (high <= LIMIT or mapped[1] == second.limits[1]):
            # no edit of a number makes limits of none: the type of the joint, or an attribute, is another
            bounded = np.array_equal(np.isfinite(mapped), np.isfinite(second.limits))
            index = i if bounded else -1
            rows.append(PropertyRow("limits", second.name, interval(mapped), interval(second.limits), True, index))
    elif (mapped or UNLIMITED) != (second.limits or UNLIMITED):
        rows.append(PropertyRow("limits", second.name, interval(mapped), interval(second.limits), False))
    _number("speeds", i, second.name, first.max_speed, second.max_speed, lambda v: f"{angle(v)}/s", rows, compared)
    effort_of_first = problem.first.efforts.get(first.name)
    effort_of_second = problem.second.efforts.get(second.name)
    unit = "N m" if second.is_angle else "N"
    _number("efforts", i, second.name, effort_of_first, effort_of_second, lambda v: f"{v:g} {unit}", rows, compared)


def _parts(problem: Problem, i: int, rows: list[PropertyRow]) -> None:
    """Add what joints state of which one side has several, and the other one: it has no partner to compare it with."""
    both = (problem.axes[i], problem.second.axes[i])
    where = both[1].name
    free = any(not axis.joined and axis.limits == UNLIMITED for axis in both)
    limits: list[list[str]] = [[], []]
    speeds: list[list[str]] = [[], []]
    efforts: list[list[str]] = [[], []]
    for k, side in enumerate((problem.first, problem.second)):
        for part in both[k].joined:
            if part.limits is not None and part.limits != UNLIMITED:
                low, high = (moved(value, part.is_angle) for value in part.limits)
                limits[k].append(f"{part.name} {low} .. {high}")
            if part.max_speed is not None:
                speeds[k].append(f"{part.name} {moved(part.max_speed, part.is_angle)}/s")
            if part.name in side.efforts:
                efforts[k].append(f"{part.name} {side.efforts[part.name]:g} {'N m' if part.is_angle else 'N'}")
    for kind, texts in (("limits", limits), ("speeds", speeds), ("efforts", efforts)):
        if texts[0] == texts[1]:
            continue
        stated = kind == "limits" and free
        nothing = "no limits" if stated else "-"
        first, second = (", ".join(found) or nothing for found in texts)
        rows.append(PropertyRow(kind, where, first, second, stated))


def mapped_limits(problem: Problem, solution: FitSolution, i: int) -> tuple[float, float] | None:
    """Return the limits of the first side as values of the second, or None."""
    limits = problem.axes[i].limits
    if limits is None:
        return None
    sign = solution.unknowns.signs[i]
    zero = zero_of(problem, solution.unknowns, i)
    ends = sorted(float(sign * (value - zero)) for value in limits)
    return ends[0], ends[1]


def _number(
    kind: str,
    index: int,
    where: str,
    first: float | None,
    second: float | None,
    shown: Callable[[float], str],
    rows: list[PropertyRow],
    compared: dict[str, int],
) -> None:
    if first is None and second is None:
        return
    if first is None or second is None:
        texts = ["-" if value is None else shown(value) for value in (first, second)]
        rows.append(PropertyRow(kind, where, texts[0], texts[1], False))
        return
    compared[kind] += 1
    if abs(first - second) > RELATIVE * max(abs(first), abs(second)):
        rows.append(PropertyRow(kind, where, shown(first), shown(second), True, index))


def _masses(problem: Problem, solution: FitSolution, rows: list[PropertyRow], compared: dict[str, int]) -> None:
    """Compare mass, centre and tensor of the bodies on each joint, the first side moved by the conventions."""
    u = solution.unknowns
    _, _, motions = problem.motions(u.signs, values_of(u)[None], u.deviating)
    pairs = [(0, 0)]
    for i, axis in enumerate(problem.axes):
        if not axis.closing:
            pairs.append((axis.child, problem.second.axes[i].child))
    for group, partner in pairs:
        first = problem.first.groups[group].inertia
        second = problem.second.groups[partner].inertia
        where = problem.second.groups[partner].bodies[-1]
        masses = [None if inertia is None else inertia.mass for inertia in (first, second)]
        _number("masses", group, where, masses[0], masses[1], lambda v: f"{v:g} kg", rows, compared)
        if first is None or second is None:
            continue
        seen = first.seen_from(motions[0, group])
        compared["centres of mass"] += 1
        if np.linalg.norm(seen.p_body_com - second.p_body_com) > CENTRE:
            texts = [_point(p) for p in (seen.p_body_com, second.p_body_com)]
            rows.append(PropertyRow("centres of mass", where, texts[0], texts[1], True, group))
        compared["inertias"] += 1
        size = float(np.linalg.norm(second.I_com))
        if np.linalg.norm(seen.I_com - second.I_com) > RELATIVE * max(size, float(np.linalg.norm(seen.I_com))):
            texts = [_moments(I_com) for I_com in (seen.I_com, second.I_com)]
            rows.append(PropertyRow("inertias", where, texts[0], texts[1], True, group))


def difference(problem: Problem, solution: FitSolution, kind: str, i: int) -> Array:
    """Return what differs in a row of some kind, as numbers in SI units; `i` as `PropertyRow.index`."""
    if kind in ("masses", "centres of mass", "inertias"):
        return _difference_of_bodies(problem, solution, kind, i)
    if kind == "couplings":
        return _difference_of_couplings(problem, solution, i)
    if kind == "limits":
        limits = problem.second.axes[i].limits
        mapped = mapped_limits(problem, solution, i)
        if mapped is None or limits is None:
            return np.zeros(0)
        apart = [0.0 if one == other else one - other for one, other in zip(mapped, limits, strict=True)]
        return np.array(apart)
    first = problem.axes[i]
    second = problem.second.axes[i]
    values = (first.max_speed, second.max_speed)
    if kind == "efforts":
        values = (problem.first.efforts.get(first.name), problem.second.efforts.get(second.name))
    if values[0] is None or values[1] is None:
        return np.zeros(0)
    return np.array([values[0] - values[1]])


def _difference_of_bodies(problem: Problem, solution: FitSolution, kind: str, group: int) -> Array:
    u = solution.unknowns
    _, _, motions = problem.motions(u.signs, values_of(u)[None], u.deviating)
    partner = 0
    for i, axis in enumerate(problem.axes):
        if axis.child == group and not axis.closing:
            partner = problem.second.axes[i].child
    first = problem.first.groups[group].inertia
    second = problem.second.groups[partner].inertia
    if first is None or second is None:
        return np.zeros(0)
    seen = first.seen_from(motions[0, group])
    if kind == "masses":
        return np.array([seen.mass - second.mass])
    if kind == "centres of mass":
        return seen.p_body_com - second.p_body_com
    return (seen.I_com - second.I_com).ravel()


def _difference_of_couplings(problem: Problem, solution: FitSolution, i: int) -> Array:
    motions = [side.get(i) for side in _followed(problem, solution)[:2]]
    if motions[0] is None or motions[1] is None:
        return np.zeros(0)
    return np.append(motions[0][0] - motions[1][0], motions[0][1] - motions[1][1])


def _point(p: Array) -> str:
    x, y, z = np.round(1e3 * p, 3) + 0.0
    return f"({x:g}, {y:g}, {z:g}) mm"


def _moments(tensor: Array) -> str:
    values = [f"{value:.4g}" for value in np.linalg.eigvalsh(tensor)]
    return f"moments {', '.join(values)} kg m2"


def _couplings(problem: Problem, solution: FitSolution, rows: list[PropertyRow], compared: dict[str, int]) -> None:
    """Compare the motions that the couplings allow, whichever joint of a coupling each side calls the leader."""
    first, second, order = _followed(problem, solution)
    for i in order:
        if i not in first and i not in second:
            continue
        compared["couplings"] += 1
        if i in first and i in second and _same_motion(first[i], second[i]):
            continue
        texts = [_coupling(problem, side.get(i)) for side in (first, second)]
        rows.append(PropertyRow("couplings", problem.second.axes[i].name, texts[0], texts[1], True, i))


_Followed = dict[int, tuple[Array, float]]


def _followed(problem: Problem, solution: FitSolution) -> tuple[_Followed, _Followed, list[int]]:
    """Return `followed` of both sides, as values of the second side, and the order of the joints that it used."""
    u = solution.unknowns
    zeros = np.array([zero_of(problem, u, i) for i in range(problem.count)])
    stated = [constraints(problem.first, problem.axes), constraints(problem.second, problem.second.axes)]
    ratios, totals = stated[0]
    # q_first = sign * q_second + zero
    stated[0] = (ratios * u.signs, totals - ratios @ zeros)
    first_followers = {coupling.follower for coupling in problem.first.couplings}
    second_followers = {coupling.follower for coupling in problem.second.couplings}
    followers = [i for i, axis in enumerate(problem.second.axes) if axis.name in second_followers]
    for i, axis in enumerate(problem.axes):
        if axis.name in first_followers and i not in followers:
            followers.append(i)
    order = [*followers, *(i for i in range(problem.count) if i not in followers)]
    return followed(*stated[0], order), followed(*stated[1], order), order


def constraints(side: RobotSide, axes: Sequence[Axis]) -> tuple[Array, Array]:
    """Return (ratios (couplings, joints), totals (couplings,)) of a side, for joints in the order of `axes`.

    For all states that the couplings allow, ratios @ q = totals, in m and rad.
    """
    index = {axis.name: i for i, axis in enumerate(axes)}
    ratios = []
    totals = []
    for coupling in side.couplings:
        if not coupling.ratios.keys() <= index.keys():
            continue
        row = np.zeros(len(axes))
        for name, ratio in coupling.ratios.items():
            row[index[name]] = ratio
        ratios.append(row)
        totals.append(coupling.total)
    return np.array(ratios).reshape(-1, len(axes)), np.array(totals)


def followed(ratios: Array, totals: Array, order: Sequence[int]) -> dict[int, tuple[Array, float]]:
    """Return {joint: (ratios (joints,), offset)} of the joints that others move: q_joint = ratios @ q + offset.

    The joints in `ratios` move freely. Of the joints of a coupling, the one that is first in `order` is moved.
    """
    rows = np.column_stack([ratios[:, list(order)], totals])
    pivots: list[int] = []
    for column in range(len(order)):
        below = rows[len(pivots) :, column]
        if not len(below) or np.abs(below).max() < RATIO:
            continue
        pivot = len(pivots)
        largest = pivot + int(np.argmax(np.abs(below)))
        rows[[pivot, largest]] = rows[[largest, pivot]]
        rows[pivot] /= rows[pivot, column]
        for other in range(len(rows)):
            if other != pivot:
                rows[other] -= rows[other, column] * rows[pivot]
        pivots.append(column)
    followers = {}
    for row, column in zip(rows, pivots, strict=False):
        moving = np.zeros(len(order))
        moving[list(order)] = -row[:-1]
        moving[order[column]] = 0.0
        followers[order[column]] = (moving, float(row[-1]))
    return followers


def followed_of(side: RobotSide) -> dict[int, tuple[Array, float]]:
    """Return `followed` of the couplings of one side, for joints in the order of its axes."""
    names = {coupling.follower for coupling in side.couplings}
    followers = []
    others = []
    for i, axis in enumerate(side.axes):
        if axis.name in names:
            followers.append(i)
        else:
            others.append(i)
    ratios, totals = constraints(side, side.axes)
    return followed(ratios, totals, [*followers, *others])


def _same_motion(first: tuple[Array, float], second: tuple[Array, float]) -> bool:
    ratios, offset = first
    other_ratios, other_offset = second
    limits = RATIO * np.maximum(np.abs(ratios), np.abs(other_ratios)) + 1e-9
    same_ratios = bool(np.all(np.abs(ratios - other_ratios) <= limits))
    return same_ratios and abs(offset - other_offset) <= LIMIT


def _coupling(problem: Problem, motion: tuple[Array, float] | None) -> str:
    if motion is None:
        return "moves freely"
    ratios, offset = motion
    parts = []
    for k in np.flatnonzero(np.abs(ratios) > 1e-9):
        parts.append(f"{ratios[k]:g} × {problem.second.axes[k].name}")
    if abs(offset) > LIMIT or not parts:
        parts.append(f"{offset:g}")
    return " + ".join(parts)
