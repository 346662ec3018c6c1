"""What two consecutive joint lines have in common, whatever base frame, tool frame and zeros are chosen.

Distance and angle of two lines on one link do not change with any of these conventions. They show, before a fit, which
joints must have another place on their link, and which sets of signs are impossible.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.comparison.fit import Problem
from twin.comparison.frames import carriers
from twin.comparison.side import TURNING
from twin.core.spatial import Array

_SLACK = 3.0
"""Factor of the tolerances: a fit spreads errors over several joints."""


@dataclass(frozen=True)
class Local:
    """What the pairs of consecutive joints say.

    Attributes:
        different: joints whose distance or angle to the joint before them differs.
        products: {(joint before, joint): product of their signs, 1 or -1}, where the pair determines it.
    """

    different: frozenset[int]
    products: dict[tuple[int, int], float]

    def allows(self, signs: Array, deviating: tuple[int, ...]) -> bool:
        """Return whether a set of signs is possible if these joints deviate."""
        for (i, k), product in self.products.items():
            if k not in deviating and signs[i] * signs[k] != product:
                return False
        return True


def local(problem: Problem) -> Local:
    """Compare all pairs of consecutive joints of the tree."""
    carrier = carriers(problem)
    different = set()
    products = {}
    for k, axis in enumerate(problem.axes):
        i = carrier.get(axis.parent)
        if i is None or axis.closing:
            continue
        kinds = (problem.kinds[i], axis.kind)
        if "spherical" in kinds or "free" in kinds:
            continue
        first = _invariants(problem.points, problem.directions, i, k)
        second = _invariants(problem.target_points, problem.target_directions, i, k)
        turning = kinds[0] in TURNING and kinds[1] in TURNING
        product = _product(problem, first, second, turning)
        if product == 0.0:
            different.add(k)
        elif product is not None:
            products[i, k] = product
    return Local(frozenset(different), products)


def _invariants(points: Array, directions: Array, i: int, k: int) -> tuple[float, float, float]:
    """Return (cosine, sine, distance) of two lines; the distance is signed by d_i x d_k, or that of parallel lines."""
    normal = np.cross(directions[i], directions[k])
    sine = float(np.linalg.norm(normal))
    cosine = float(directions[i] @ directions[k])
    between = points[k] - points[i]
    if sine < 1e-4:
        return cosine, sine, float(np.linalg.norm(np.cross(between, directions[i])))
    return cosine, sine, float(between @ normal) / sine


def _product(
    problem: Problem, first: tuple[float, float, float], second: tuple[float, float, float], turning: bool
) -> float | None:
    """Return the product of the signs of two joints, None if both are possible, or 0 if neither is."""
    possible = []
    parallel = min(first[1], second[1]) < 1e-4
    angle_limit = _SLACK * problem.angle_tolerance
    for product in (1.0, -1.0):
        angle = np.arctan2(first[1], product * first[0])
        target = np.arctan2(second[1], second[0])
        if abs(angle - target) > angle_limit:
            continue
        distance = first[2] if parallel else product * first[2]
        limit = _SLACK * problem.tolerance
        if not parallel:
            limit /= min(first[1], second[1])
        if turning and abs(distance - second[2]) > limit:
            continue
        possible.append(product)
    if len(possible) == 2:
        return None
    if not possible:
        return 0.0
    return possible[0]
