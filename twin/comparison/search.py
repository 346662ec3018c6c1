"""Search the fit with the fewest conventions and, if none makes two sides agree, the fewest deviating joints."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from twin.comparison.fit import Problem, Solution, Unknowns, size_of, values_of, with_values
from twin.comparison.frames import gaps
from twin.comparison.side import ONE_COORDINATE
from twin.core.spatial import Array

_ALL_SIGNS = 8
"""Number of joints up to which all sets of signs are tried; for more, those with at most `_FLIPS` changes."""

_FLIPS = 3

_DEVIATING = 6
"""Maximum number of deviating joints that are searched."""

_INNER = 0.01
"""Cost of a moved frame of an inner link: it decides only between solutions with as many conventions."""

_SAME = 1e-6
"""Difference of costs below which they are equal."""


def sign_sets(problem: Problem, most: int) -> Iterator[tuple[int, Array]]:
    """Yield (number of changes, signs (joints,)), fewest changes first, up to `most` changes."""
    for flips in range(min(most, len(problem.signed)) + 1):
        for chosen in combinations(problem.signed, flips):
            signs = np.ones(problem.count)
            signs[list(chosen)] = -1.0
            yield flips, signs


def sparse(problem: Problem, solution: Solution) -> Solution:
    """Return the solution with as few changed values as possible: each value that is not needed becomes zero."""
    u = solution.unknowns
    x = values_of(u)
    free = np.ones(len(x), bool)
    groups: list[list[int]] = []
    first = 6 + problem.count
    for k in range(len(u.deviating)):
        start = first + 6 * k
        groups += [[start, start + 1, start + 2], [start + 3, start + 4, start + 5]]
        groups += [[start + j] for j in range(6)]
    groups.append(list(range(6)))
    groups += [[0, 1, 2], [3, 4, 5]]
    groups += [[6 + i] for i in reversed(range(problem.count))]
    best = solution
    for group in groups:
        if not free[group].any():
            continue
        current = values_of(best.unknowns)
        current[group] = 0.0
        tried = free.copy()
        tried[group] = False
        found = problem.refine(with_values(best.unknowns, current), tried)
        if problem.holds(found.gap):
            best = found
            free = tried
    return best


def cost(problem: Problem, solution: Solution) -> float:
    """Return the number of changed conventions, plus a fraction for each moved frame of an inner link."""
    u = solution.unknowns
    changed = float(len(u.flips) + len(moved_zeros(problem, u)))
    if base_moved(problem, u):
        changed += 1
    moved_tools = set()
    for gap in gaps(problem, u):
        if not gap.differs(problem):
            continue
        if gap.leaf:
            moved_tools.add(gap.joint)
        else:
            changed += _INNER
    return changed + len(moved_tools)


def moved_zeros(problem: Problem, u: Unknowns) -> list[int]:
    """Return the joints whose zeros differ by more than the tolerance."""
    moved = []
    for i, axis in enumerate(problem.axes):
        if axis.kind not in ONE_COORDINATE:
            continue
        shift = zero_of(problem, u, i)
        limit = problem.angle_tolerance if axis.is_angle else problem.tolerance
        if abs(shift) > limit:
            moved.append(i)
    return moved


def zero_of(problem: Problem, u: Unknowns, i: int) -> float:
    """Return by how much the zero of a joint differs in m or rad; an angle is in -pi..pi."""
    shift = float(u.zeros[i])
    if problem.axes[i].is_angle:
        shift = float(np.arctan2(np.sin(shift), np.cos(shift)))
    return shift


def base_moved(problem: Problem, u: Unknowns) -> bool:
    """Return whether the base frames differ."""
    turn = float(np.linalg.norm(u.base[:3]))
    shift = float(np.linalg.norm(u.base[3:]))
    return shift > problem.tolerance or turn > problem.angle_tolerance


def conventions(problem: Problem) -> list[Solution]:
    """Return the solutions without deviating joints that change the fewest conventions; [] if there are none."""
    most = len(problem.signed)
    if most > _ALL_SIGNS:
        most = _FLIPS
    best: list[Solution] = []
    lowest = np.inf
    for flips, signs in sign_sets(problem, most):
        if flips > lowest:
            break
        found = problem.solve(signs)
        if not problem.holds(found.gap):
            continue
        found = sparse(problem, found)
        changed = cost(problem, found)
        if changed < lowest - _SAME:
            best = [found]
            lowest = changed
        elif changed <= lowest + _SAME:
            best.append(found)
    return best


def deviations(problem: Problem) -> list[Solution]:
    """Return all solutions with the fewest deviating joints, those with the fewest conventions first.

    The result is empty if no `_DEVIATING` joints explain the difference.
    """
    for size, most_flips in ((1, 2), (2, 1)):
        hits = _deviating_sets(problem, size, most_flips)
        if hits:
            return hits
    return _greedy(problem)


def _deviating_sets(problem: Problem, size: int, most_flips: int) -> list[Solution]:
    hits: list[Solution] = []
    level = 0
    for flips, signs in sign_sets(problem, most_flips):
        if hits and flips > level:
            break
        level = flips
        for deviating in combinations(range(problem.count), size):
            found = problem.solve(signs, deviating)
            if problem.holds(found.gap):
                hits.append(sparse(problem, found))
    hits.sort(key=lambda solution: (cost(problem, solution), _size_of_deviation(solution)))
    return hits


def _size_of_deviation(solution: Solution) -> float:
    deviations = solution.unknowns.deviations
    if deviations is None:
        return 0.0
    return float(np.count_nonzero(np.abs(deviations) > 1e-9))


def _greedy(problem: Problem) -> list[Solution]:
    """Return one solution whose deviating joints are added one by one, each that lowers the gap most."""
    chosen: tuple[int, ...] = ()
    signs = np.ones(problem.count)
    for _ in range(min(_DEVIATING, problem.count)):
        best: Solution | None = None
        for joint in range(problem.count):
            if joint in chosen:
                continue
            found = problem.solve(signs, tuple(sorted((*chosen, joint))))
            if best is None or size_of(found.gap) < size_of(best.gap):
                best = found
        assert best is not None
        chosen = best.unknowns.deviating
        if problem.holds(best.gap):
            return [sparse(problem, best)]
    return []
