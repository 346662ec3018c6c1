"""What consecutive joint lines have in common, whatever base frame, tool frame and zeros are chosen.

Distance and angle of two lines on one link do not change with any of these conventions, nor does the distance between
the common normals along the line of a joint between them. They show, before a fit, which joints must have another place
on their link, which sets of signs are impossible, and which zeros a set of signs needs at least.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from twin.comparison.fit_problem import FitProblem
from twin.comparison.frame_gaps import carrier_of_groups
from twin.comparison.side import TURNING_KINDS
from twin.comparison.unknowns import JointDeviation
from twin.core.spatial import Array

_POSSIBLE_SIGNS = (1.0, -1.0)
"""Signs that a joint can have."""

TOLERANCE_FACTOR = 3.0
"""Factor of the tolerances: a fit spreads errors over several joints."""

_PARALLEL_SINE = 1e-4
"""Sine of the angle of two lines below which they are parallel."""

_CROSSING_SINE = 1e-2
"""Sine of the angle of two lines from which their cross product gives the direction of the common normal."""

_SAME_LINE_DISTANCE = 1e-3
"""Distance in m of two parallel lines below which the direction from one to the other is inaccurate."""

ACCURATE_FOOT_SINE = 0.1
"""Sine of the angle of two lines from which the feet of their common normal are accurate."""

FOOT_TOLERANCE_FACTOR = 10.0
"""Factor of the tolerance for the distance of two feet on a line."""

_SMALLEST_NEEDED_TURN = 2e-3
"""Angle in rad from which a needed zero counts; less may be inaccuracy of the normals."""

_SMALLEST_NEEDED_SHIFT = 1e-3
"""The same for slides, in m."""


@dataclass(frozen=True)
class CommonNormal:
    """The common normal of two lines: a vector (3,), whether signs of the joints turn it, the foot on the joint."""

    vector: Array
    signed: bool
    foot: float | None


@dataclass(frozen=True)
class JointNeighbours:
    """A joint with the joint before it and one behind it.

    Attributes:
        before, joint, behind: indices of the joints.
        turns: whether the joint turns.
        first, second: the two common normals at the joint, for each side.
        directions: (2, 3) direction of the joint in each side.
        drawn: coordinates of the joint in both sides at which the lines are compared.
        foot_limit: distance in m up to which the feet are equally far apart, or None if they are not compared.
        angle_limit: angle in rad up to which two angles of normals are equal.
    """

    before: int
    joint: int
    behind: int
    turns: bool
    first: tuple[CommonNormal, CommonNormal]
    second: tuple[CommonNormal, CommonNormal]
    directions: Array
    drawn: tuple[float, float]
    foot_limit: float | None
    angle_limit: float

    def _needed_turn(self, signs: tuple[float, float, float]) -> float:
        """Return by how much the joint of the first side must turn about its signed direction."""
        ahead, back = self._normal_vectors(self.first, signs)
        first = _angle_about(signs[1] * self.directions[0], ahead, back)
        ahead, back = self._normal_vectors(self.second, (1.0, 1.0, 1.0))
        second = _angle_about(self.directions[1], ahead, back)
        return _wrapped(second - first)

    @staticmethod
    def _normal_vectors(
        normals: tuple[CommonNormal, CommonNormal], signs: tuple[float, float, float]
    ) -> tuple[Array, Array]:
        """Return the vectors (3,) of two common normals with signs of the three joints."""
        ahead = normals[0].vector
        if normals[0].signed:
            ahead = signs[0] * signs[1] * ahead
        back = normals[1].vector
        if normals[1].signed:
            back = signs[1] * signs[2] * back
        return ahead, back

    def _foot_distances(self) -> tuple[float, float] | None:
        """Return how far the feet of the normals are apart along the joint, for each side."""
        feet = []
        for normals in (self.first, self.second):
            if normals[0].foot is None or normals[1].foot is None:
                return None
            feet.append(normals[1].foot - normals[0].foot)
        return feet[0], feet[1]

    def is_possible(self, signs: tuple[float, float, float]) -> bool:
        """Return whether the lines can coincide with these signs of the three joints."""
        if not self.turns:  # no displacement of a slide changes the angle between the normals
            return abs(self._needed_turn(signs)) <= self.angle_limit
        # nor does a turn move the feet along the joint
        feet = self._foot_distances()
        if feet is None or self.foot_limit is None:
            return True
        return abs(signs[1] * feet[0] - feet[1]) <= self.foot_limit

    def is_possible_with_any(self) -> bool:
        """Return whether the lines can coincide with some signs of the three joints."""
        return any(map(self.is_possible, itertools.product(_POSSIBLE_SIGNS, _POSSIBLE_SIGNS, _POSSIBLE_SIGNS)))

    def needs_zero(self, signs: tuple[float, float, float]) -> bool:
        """Return whether the zero of the joint must move with these signs of the three joints."""
        sign = signs[1]
        if self.turns:
            zero = sign * self._needed_turn(signs) - sign * self.drawn[1] + self.drawn[0]
            return abs(_wrapped(zero)) > _SMALLEST_NEEDED_TURN
        feet = self._foot_distances()
        if feet is None or self.foot_limit is None:
            return False
        zero = sign * (feet[1] - sign * feet[0]) - sign * self.drawn[1] + self.drawn[0]
        return abs(zero) > _SMALLEST_NEEDED_SHIFT


@dataclass(frozen=True)
class Contradiction:
    """A difference of consecutive joint lines that no convention removes, and what removes it.

    Attributes:
        alone: what may deviate, each of which is enough.
        together: axes of which one is not enough, but two are.
    """

    alone: frozenset[JointDeviation]
    together: frozenset[JointDeviation] = frozenset()

    def is_explained(self, deviating: Collection[JointDeviation]) -> bool:
        """Return whether a set of deviating joints may remove the difference."""
        if not self.alone.isdisjoint(deviating):
            return True
        return len(self.together.intersection(deviating)) >= 2


@dataclass(frozen=True)
class NeighbourLines:
    """What the lines of consecutive joints say, before any fit.

    Attributes:
        differing_pairs: {joint: joint before it} where the distance or the angle of the two differs.
        sufficient_axes: {joint: those axes of the two, one of which is enough to remove this}.
        sign_products: {(joint before, joint): product of their signs, 1 or -1}, where the pair determines it.
        neighbours: joints with a joint before and behind them.
    """

    differing_pairs: dict[int, int]
    sufficient_axes: dict[int, frozenset[JointDeviation]]
    sign_products: dict[tuple[int, int], float]
    neighbours: tuple[JointNeighbours, ...]

    def allows(self, signs: Array, deviating: tuple[JointDeviation, ...]) -> bool:
        """Return whether a set of signs is possible if these joints deviate."""
        for (i, k), product in self.sign_products.items():
            if _deviations_of_pair(i, k).isdisjoint(deviating) and signs[i] * signs[k] != product:
                return False
        for rule in self.neighbours:
            if not _deviations_of_three(rule).isdisjoint(deviating):
                continue
            if not rule.is_possible((signs[rule.before], signs[rule.joint], signs[rule.behind])):
                return False
        return True

    def needed_zeros(
        self, signs: Mapping[int, float], last: int, deviating: tuple[JointDeviation, ...]
    ) -> set[int] | None:
        """Return the zeros that the joints up to `last` need; None if the signs are impossible.

        Args:
            signs: {joint: sign} of the joints before `last` and of `last`.
            last: the joint whose sign was chosen last.
            deviating: as in `Unknowns`.
        """
        for (i, k), product in self.sign_products.items():
            if k != last or not _deviations_of_pair(i, k).isdisjoint(deviating):
                continue
            if signs[i] * signs[k] != product:
                return None
        needed = set()
        for rule in self.neighbours:
            if rule.behind != last or not _deviations_of_three(rule).isdisjoint(deviating):
                continue
            signs_of_three = (signs[rule.before], signs[rule.joint], signs[rule.behind])
            if not rule.is_possible(signs_of_three):
                return None
            if rule.needs_zero(signs_of_three):
                needed.add(rule.joint)
        return needed

    def contradictions(self) -> Iterator[Contradiction]:
        """Yield the differences that some joint must remove."""
        for k, i in self.differing_pairs.items():
            yield Contradiction(
                self.sufficient_axes[k] | {JointDeviation(k)}, _deviations_of_pair(i, k) - {JointDeviation(k)}
            )
        for rule in self.neighbours:
            if not rule.is_possible_with_any():
                yield Contradiction(_deviations_of_three(rule))


def _deviations_of_pair(before: int, joint: int) -> frozenset[JointDeviation]:
    """Return what changes the distance or the angle of two consecutive lines."""
    return frozenset(
        {JointDeviation(joint), JointDeviation(before, axis_only=True), JointDeviation(joint, axis_only=True)}
    )


def _deviations_of_three(rule: JointNeighbours) -> frozenset[JointDeviation]:
    """Return what changes a joint with those before and behind it."""
    changing = {JointDeviation(rule.joint), JointDeviation(rule.behind)}
    for joint in (rule.before, rule.joint, rule.behind):
        changing.add(JointDeviation(joint, axis_only=True))
    return frozenset(changing)


def neighbour_lines(problem: FitProblem) -> NeighbourLines:
    """Compare all pairs of consecutive joints of the tree."""
    carrier = carrier_of_groups(problem)
    different = {}
    turned = {}
    products = {}
    between = []
    for k, axis in enumerate(problem.axes):
        i = carrier.get(axis.parent)
        if i is None or axis.closes_loop:
            continue
        kinds = (problem.kinds[i], axis.kind)
        if "spherical" in kinds or "free" in kinds:  # they have no line
            continue
        first = _line_invariants(problem.points, problem.directions, i, k)
        second = _line_invariants(problem.target_points, problem.target_directions, i, k)
        turning = kinds[0] in TURNING_KINDS and kinds[1] in TURNING_KINDS
        product = _sign_product(problem, first, second, turning)
        if product == 0.0:
            different[k] = i
            turned[k] = _sufficient_axes(problem, i, k, second, turning=turning)
        elif product is not None:
            products[i, k] = product
        before = carrier.get(problem.axes[i].parent)
        if before is not None and problem.kinds[before] not in ("spherical", "free"):
            rule = _joint_neighbours(problem, before, i, k)
            if rule is not None:
                between.append(rule)
    return NeighbourLines(different, turned, products, tuple(between))


def _joint_neighbours(problem: FitProblem, before: int, joint: int, behind: int) -> JointNeighbours | None:
    """Return what three consecutive joints say; None if the normals at the joint in the middle have no direction."""
    if problem.kinds[joint] not in ("revolute", "prismatic"):
        return None
    sides = []
    sines = []
    for points, directions in (
        (problem.points, problem.directions),
        (problem.target_points, problem.target_directions),
    ):
        normals = []
        for i, k in ((before, joint), (joint, behind)):
            turning = problem.kinds[i] in TURNING_KINDS and problem.kinds[k] in TURNING_KINDS
            normal, sine = common_normal(points, directions, (i, k), joint, turning)
            if normal is None:
                return None
            normals.append(normal)
            sines.append(sine)
        sides.append((normals[0], normals[1]))
    # normals of crossing lines, and of parallel ones, are defined in different ways: they cannot be compared
    if sides[0][0].signed != sides[1][0].signed or sides[0][1].signed != sides[1][1].signed:
        return None
    ends_turn = problem.kinds[before] in TURNING_KINDS and problem.kinds[behind] in TURNING_KINDS
    foot_limit = None
    # `common_normal` divides by the square of the sine: so much less accurate are feet than lines
    if ends_turn and min(sines) > ACCURATE_FOOT_SINE:
        foot_limit = FOOT_TOLERANCE_FACTOR * problem.tolerance / min(sines) ** 2
    angle_limit = np.inf
    if min(sines) > ACCURATE_FOOT_SINE:
        angle_limit = FOOT_TOLERANCE_FACTOR * problem.angle_tolerance / min(sines)
    directions = np.array([problem.directions[joint], problem.target_directions[joint]])
    drawn = (float(problem.drawn[joint]), float(problem.target_drawn[joint]))
    turns = problem.kinds[joint] == "revolute"
    return JointNeighbours(
        before, joint, behind, turns, sides[0], sides[1], directions, drawn, foot_limit, float(angle_limit)
    )


def common_normal(
    points: Array, directions: Array, pair: tuple[int, int], joint: int, turning: bool
) -> tuple[CommonNormal | None, float]:
    """Return (common normal of two lines, None if it has no direction; the sine of their angle)."""
    i, k = pair
    normal = np.cross(directions[i], directions[k])
    sine = float(np.linalg.norm(normal))
    between = points[k] - points[i]
    if sine > _CROSSING_SINE:
        # foot of the normal on line i: p_i + a d_i, on line k: p_k + b d_k
        d = directions[joint]
        d_other = directions[k if joint == i else i]
        to_other = between if joint == i else -between
        across = np.cross(d, d_other)
        foot = float(np.cross(to_other, d_other) @ across) / sine**2 + float(points[joint] @ d)
        return CommonNormal(normal / sine, True, foot), sine
    across = between - directions[joint] * (between @ directions[joint])
    distance = float(np.linalg.norm(across))
    # lines that are nearly parallel, or the same, have no normal of which the direction is accurate
    if sine > _PARALLEL_SINE or not turning or distance < _SAME_LINE_DISTANCE:
        return None, sine
    return CommonNormal(across / distance, False, None), sine


def _angle_about(direction: Array, a: Array, b: Array) -> float:
    """Return the angle in rad from vector a to vector b about a direction."""
    return float(np.arctan2(direction @ np.cross(a, b), a @ b - (a @ direction) * (b @ direction)))


def _wrapped(angle: float) -> float:
    """Return an angle in rad in -pi..pi."""
    return float(np.arctan2(np.sin(angle), np.cos(angle)))


def _line_invariants(points: Array, directions: Array, i: int, k: int) -> tuple[float, float, float]:
    """Return (cosine, sine, distance) of two lines; the distance is signed by d_i x d_k, or that of parallel lines."""
    normal = np.cross(directions[i], directions[k])
    sine = float(np.linalg.norm(normal))
    cosine = float(directions[i] @ directions[k])
    between = points[k] - points[i]
    if sine < _PARALLEL_SINE:
        return cosine, sine, float(np.linalg.norm(np.cross(between, directions[i])))
    return cosine, sine, float(between @ normal) / sine


def _sufficient_axes(
    problem: FitProblem, i: int, k: int, target: tuple[float, float, float], *, turning: bool
) -> frozenset[JointDeviation]:
    """Return the axes, one of which gives two lines the distance of their targets.

    An axis is turned about its point, whose distance from the other line stays: the distance of the lines can be any
    up to this one, and of parallel lines it is this one.

    `i` and `k` are the joints of the lines, `target` is what `_line_invariants` returns of their targets, and `turning`
    says whether the lines of both joints have a place.
    """
    axes = set()
    for joint, other in ((i, k), (k, i)):
        if not turning:
            axes.add(JointDeviation(joint, axis_only=True))
            continue
        between = problem.points[joint] - problem.points[other]
        largest = float(np.linalg.norm(np.cross(between, problem.directions[other])))
        between_targets = problem.target_points[joint] - problem.target_points[other]
        reach = float(np.linalg.norm(between) + np.linalg.norm(between_targets))
        parallel = target[1] < _PARALLEL_SINE
        # lines that coincide within the tolerances, and are nearly parallel, are a little further apart at other points
        limit = TOLERANCE_FACTOR * problem.tolerance + (problem.angle_tolerance + parallel * target[1]) * reach
        distance = abs(target[2])
        if distance > largest + limit or (parallel and distance < largest - limit):
            continue
        axes.add(JointDeviation(joint, axis_only=True))
    return frozenset(axes)


def _sign_product(
    problem: FitProblem, first: tuple[float, float, float], second: tuple[float, float, float], turning: bool
) -> float | None:
    """Return the product of the signs of two joints, None if both are possible, or 0 if neither is."""
    possible = []
    parallel = min(first[1], second[1]) < _PARALLEL_SINE
    angle_limit = TOLERANCE_FACTOR * problem.angle_tolerance
    for product in _POSSIBLE_SIGNS:
        angle = np.arctan2(first[1], product * first[0])
        target = np.arctan2(second[1], second[0])
        if abs(angle - target) > angle_limit:
            continue
        distance = first[2] if parallel else product * first[2]
        limit = TOLERANCE_FACTOR * problem.tolerance
        if not parallel:
            # the distance along the normal is inaccurate where the lines are nearly parallel
            limit /= min(first[1], second[1])
        if turning and abs(distance - second[2]) > limit:
            continue
        possible.append(product)
    if len(possible) == 2:
        return None
    if not possible:
        return 0.0
    return possible[0]
