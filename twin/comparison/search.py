"""Search the fit with the fewest conventions and, if none makes two sides agree, the fewest deviating joints."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from twin.comparison.fit import FitSolution, Problem, Unknowns, size_of, values_of, with_values
from twin.comparison.frames import gaps
from twin.comparison.invariants import Local, local
from twin.comparison.side import ONE_COORDINATE
from twin.core.spatial import Array

_ALL_SIGNS = 8
"""Number of joints up to which all sets of signs are tried; for more, those with at most `_FLIPS` changes."""

_FLIPS = 3

_PAIR = 2
"""Number of deviating joints up to which all sets are tried."""

_DEVIATING = 6
"""Maximum number of deviating joints that are searched."""

_INNER = 0.01
"""Cost of a moved frame of an inner link, and of limits that differ: it decides between as many conventions."""

_LIMIT = 1e-4
"""Difference of limits in rad or m up to which they are equal."""

_NEEDED = 1e-9
"""Size of a value, in m or rad, from which it is a change."""

_STEPS = 6
"""Gauss-Newton steps of an explanation with tool frames."""

_STEP = 1e-7
"""Step of the unknowns in m and rad for derivatives by differences."""


def sign_sets(problem: Problem, most: int) -> Iterator[tuple[int, Array]]:
    """Yield (number of changes, signs (joints,)), fewest changes first, up to `most` changes."""
    for flips in range(min(most, len(problem.signed)) + 1):
        for chosen in combinations(problem.signed, flips):
            signs = np.ones(problem.count)
            signs[list(chosen)] = -1.0
            yield flips, signs


def sparse(problem: Problem, solution: FitSolution) -> FitSolution:
    """Return the solution with as few changed values as possible: each value that is not needed becomes zero."""
    u = solution.unknowns
    x = values_of(u)
    free = np.ones(len(x), bool)
    groups: list[list[int]] = []
    # Base and zeros come first: while they are free, a wrong length could be traded for two zeros and another length.
    groups.append(list(range(6)))
    groups += [[0, 1, 2], [3, 4, 5]]
    groups += [[6 + i] for i in reversed(range(problem.count))]
    first = 6 + problem.count
    for k in range(len(u.deviating)):
        start = first + 6 * k
        groups += [[start, start + 1, start + 2], [start + 3, start + 4, start + 5]]
        groups += [[start + j] for j in range(6)]
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


def cost(problem: Problem, solution: FitSolution) -> float:
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
    changed += _INNER * _wrong_limits(problem, u)
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
    """Return by how much the zero of a joint differs in m or rad.

    An angle in -pi..pi, or that plus the full turns with which the limits of both sides are the same.
    """
    shift = float(u.zeros[i])
    axis = problem.axes[i]
    if not axis.is_angle:
        return shift
    shift = float(np.arctan2(np.sin(shift), np.cos(shift)))
    limits = axis.limits
    target = problem.second.axes[i].limits
    if limits is None or target is None or not np.isfinite([*limits, *target]).all():
        return shift
    mapped = sorted(float(u.signs[i] * (value - shift)) for value in limits)
    turns = round((target[0] - mapped[0]) / (2 * np.pi))
    apart = [abs(end + turns * 2 * np.pi - other) for end, other in zip(mapped, target, strict=True)]
    if max(apart) > _LIMIT:
        return shift
    return shift - float(u.signs[i]) * turns * 2 * np.pi


def base_moved(problem: Problem, u: Unknowns) -> bool:
    """Return whether the base frames differ."""
    turn = float(np.linalg.norm(u.base[:3]))
    shift = float(np.linalg.norm(u.base[3:]))
    return shift > problem.tolerance or turn > problem.angle_tolerance


def _variants(problem: Problem, solution: FitSolution) -> list[FitSolution]:
    """Return other explanations of moved base and tool frames: the free values also fit the tools, or a zero moves.

    Only the limits of the first joint and the frames of links distinguish its zero from the base frame; the same holds
    for the zero of the last joint and the tool frame.
    """
    u = solution.unknowns
    values = values_of(u)
    needed = [int(k) for k in np.flatnonzero(np.abs(values) > _NEEDED)]
    tool_moved = any(gap.leaf and gap.differs(problem) for gap in gaps(problem, u))
    if base_moved(problem, u):
        needed = sorted({*needed, *range(6)})
    starts: list[tuple[Unknowns, list[int]]] = []
    if tool_moved:
        starts.append((u, needed))
        for i in problem.signed:
            columns = sorted({*needed, 6 + i})
            # a zero that is wrong by half a turn is no start for small steps
            half_turn = np.pi if problem.axes[i].is_angle else 0.0
            for by in (0.0, half_turn):
                starts.append((replace(u, zeros=_shifted(u.zeros, i, by)), columns))
    if base_moved(problem, u):
        fixed = with_values(u, np.concatenate([np.zeros(6), values[6:]]))
        others = [k for k in needed if k >= 6]
        for i in problem.signed:
            starts.append((fixed, sorted({*others, 6 + i})))
    found = []
    for start, columns in starts:
        candidate = _with_tools(problem, start, columns)
        if problem.holds(candidate.gap):
            found.append(candidate)
    return found


def _shifted(zeros: Array, joint: int, by: float) -> Array:
    shifted = zeros.copy()
    shifted[joint] += by
    return shifted


def _with_tools(problem: Problem, u: Unknowns, columns: Sequence[int]) -> FitSolution:
    """Return the unknowns after Gauss-Newton steps of some values on lines and tool frames together."""
    r = _residual_with_tools(problem, u)
    for _ in range(_STEPS):
        if not len(columns) or np.abs(r).max() < 1e-12:
            break
        values = values_of(u)
        derivatives = []
        for k in columns:
            moved = values.copy()
            moved[k] += _STEP
            derivatives.append((_residual_with_tools(problem, with_values(u, moved)) - r) / _STEP)
        step = np.linalg.lstsq(np.array(derivatives).T, -r, rcond=1e-9)[0]
        values[columns] += step
        u = with_values(u, values)
        r = _residual_with_tools(problem, u)
    return FitSolution(u, problem.gap(u))


def _residual_with_tools(problem: Problem, u: Unknowns) -> Array:
    parts = [problem.residuals(u.signs, values_of(u)[None], u.deviating)[0]]
    for gap in gaps(problem, u):
        if gap.leaf:
            parts.append((gap.T - np.eye(4))[:3].ravel())
    return np.concatenate(parts)


def _wrong_limits(problem: Problem, u: Unknowns) -> int:
    """Return the number of joints whose limits differ after the conventions."""
    wrong = 0
    for i, axis in enumerate(problem.axes):
        limits = axis.limits
        target = problem.second.axes[i].limits
        if limits is None or target is None or axis.kind not in ONE_COORDINATE:
            continue
        ends = sorted(float(u.signs[i] * (value - zero_of(problem, u, i))) for value in limits)
        if max(abs(ends[0] - target[0]), abs(ends[1] - target[1])) > _LIMIT:
            wrong += 1
    return wrong


def conventions(problem: Problem) -> list[FitSolution]:
    """Return the solutions without deviating joints that change the fewest conventions; [] if there are none."""
    known = local(problem)
    if known.different:
        return []
    most = len(problem.signed)
    if most > _ALL_SIGNS:
        most = _FLIPS
    found: list[FitSolution] = []
    lowest = np.inf
    for flips, signs in sign_sets(problem, most):
        if flips > lowest:
            break
        if not known.allows(signs, ()):
            continue
        fitted = problem.solve(signs)
        if not problem.holds(fitted.gap):
            continue
        fitted = sparse(problem, fitted)
        found += [fitted, *_variants(problem, fitted)]
        lowest = min(cost(problem, solution) for solution in found)
    return cheapest(problem, found)


def cheapest(problem: Problem, solutions: Sequence[FitSolution]) -> list[FitSolution]:
    """Return the solutions with the fewest changes, those with most link frames and limits equal first."""
    costs = [cost(problem, solution) for solution in solutions]
    order = np.argsort(costs, kind="stable")
    return [solutions[k] for k in order if int(costs[k]) == int(min(costs))]


def deviations(problem: Problem) -> list[FitSolution]:
    """Return all solutions with the fewest deviating joints, those with the fewest conventions first.

    The result is empty if no `_DEVIATING` joints explain the difference.
    """
    known = local(problem)
    least = max(len(known.different), 1)
    for size in range(least, max(least, _PAIR) + 1):
        hits = _deviating_sets(problem, known, size)
        if hits:
            return hits
    return _greedy(problem, known)


def _deviating_sets(problem: Problem, known: Local, size: int) -> list[FitSolution]:
    """Return the solutions with `size` deviating joints, which contain those that the pairs of lines demand."""
    hits: list[FitSolution] = []
    level = 0
    others = [i for i in range(problem.count) if i not in known.different]
    for flips, signs in sign_sets(problem, _FLIPS):
        if hits and flips > level:
            break
        level = flips
        for more in combinations(others, size - len(known.different)):
            deviating = tuple(sorted((*known.different, *more)))
            if not known.allows(signs, deviating):
                continue
            found = problem.solve(signs, deviating)
            if problem.holds(found.gap):
                fitted = sparse(problem, found)
                hits += [fitted, *_variants(problem, fitted)]
    hits.sort(key=_size_of_deviation)
    return cheapest(problem, hits)


def _size_of_deviation(solution: FitSolution) -> float:
    deviations = solution.unknowns.deviations
    if deviations is None:
        return 0.0
    return float(np.count_nonzero(np.abs(deviations) > 1e-9))


def _greedy(problem: Problem, known: Local) -> list[FitSolution]:
    """Return one solution whose deviating joints are added one by one, each that lowers the gap most."""
    chosen = tuple(sorted(known.different))
    signs = np.ones(problem.count)
    for _, candidate in sign_sets(problem, _FLIPS):
        if known.allows(candidate, chosen):
            signs = candidate
            break
    for _ in range(min(_DEVIATING, problem.count)):
        best: FitSolution | None = None
        for joint in range(problem.count):
            if joint in chosen:
                continue
            found = problem.solve(signs, tuple(sorted((*chosen, joint))))
            if best is None or size_of(found.gap) < size_of(best.gap):
                best = found
        assert best is not None
        chosen = best.unknowns.deviating
        if problem.holds(best.gap):
            fitted = sparse(problem, best)
            return cheapest(problem, [fitted, *_variants(problem, fitted)])
    return []
