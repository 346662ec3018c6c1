"""Search the fit with the fewest conventions and, if none makes two sides agree, the fewest deviating joints.

One search by increasing cost (a bound that never exceeds the cost) chooses the joints that turn the other way, one by
one, fits all values, and then chooses which evidence fixes what the lines leave open.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from twin.comparison.evidence import CONVENTION, LIMIT, Evidence, StatedEvidence, turning_columns
from twin.comparison.fit import FitSolution, Problem, Unknowns, open_directions, size_of, values_of, with_values
from twin.comparison.frames import gaps, leaf_gaps
from twin.comparison.invariants import Local, local
from twin.comparison.side import ONE_COORDINATE
from twin.core import spatial
from twin.core.spatial import Array

_FLIPS = 3
"""Maximum number of changed conventions in a solution with deviating joints."""

_SETS = 3
"""Number of deviating joints up to which all sets are tried."""

_DEVIATING = 6
"""Maximum number of deviating joints that are searched."""

_FITS = 160
"""Maximum number of sets of signs that are fitted."""

_NODES = 400
"""Maximum number of choices of evidence that are fitted."""

_NODES_WITH_MANY = 60
"""The same where many joints deviate: conventions then mean little, and the values of each fit are many."""

_SHRINKS = 12
"""Maximum number of steps to the smallest deviations."""

_SMALL_TURN = 0.5
"""Largest change of a value in rad or m in one of these steps."""

_DEVIATION = 2.6
"""Cost of a deviating joint where conventions are an explanation as well: one convention and limits are likelier."""

_INNER = 0.01
"""Cost of a moved frame of an inner link: it decides between as many conventions."""

_SAME = 1e-6
"""Difference of costs up to which two solutions need as many changes."""

_NEAR = 100.0
"""Factor of the tolerance up to which a value may be inaccuracy of the file, so that zero is tried."""

_OPEN = 1e-5
"""Change of evidence along a direction that the lines leave open, from which it can fix this direction."""

_STEP = 1e-7
"""Step of the unknowns in m and rad for derivatives by differences."""


@dataclass(frozen=True)
class _Signs:
    """Signs of the first joints of the order, and the zeros that they need."""

    deviating: tuple[int, ...]
    signs: tuple[float, ...]
    zeros: frozenset[int]


@dataclass(frozen=True)
class _Choice:
    """A fit of which some values are fixed.

    Attributes:
        solution: the fit.
        free: (unknowns,) the values that may still change.
        conditions: the evidence that must stay equal.
        kept: all evidence that fixed values.
        final: whether no more evidence can fix anything.
    """

    solution: FitSolution
    free: Array
    conditions: tuple[Evidence, ...]
    kept: frozenset[Evidence]
    final: bool = False


class _Search:
    """The search over some sets of deviating joints; `run` returns all solutions with the lowest cost."""

    def __init__(self, problem: Problem, known: Local, most: float, most_nodes: int = _NODES) -> None:
        self.problem = problem
        self.known = known
        self.most = most
        self.stated = StatedEvidence(problem)
        self.turning = turning_columns(problem)
        self.heap: list[tuple[float, int, _Signs | _Choice]] = []
        self.serial = 0
        self.seen: set[tuple[object, ...]] = set()
        self.fits = 0
        self.nodes = 0
        self.most_nodes = most_nodes

    def _push(self, bound: float, node: _Signs | _Choice) -> None:
        if bound > self.most + _SAME:
            return
        self.serial += 1
        heapq.heappush(self.heap, (bound, self.serial, node))

    def run(self, sets: Sequence[tuple[int, ...]]) -> list[FitSolution]:
        """Return the solutions with the lowest cost for these sets of deviating joints."""
        for deviating in sets:
            self._push(0.0, _Signs(deviating, (), frozenset()))
        solutions: list[FitSolution] = []
        lowest = np.inf
        while self.heap:
            bound, _, node = heapq.heappop(self.heap)
            if bound > lowest + _SAME:
                break
            if isinstance(node, _Signs):
                self._signs(node)
                continue
            if self._differs_in_nothing(node):
                lowest = 0.0
                solutions.append(node.solution)
                continue
            if not node.final and self.nodes < self.most_nodes and self._branches(node, min(self.most, lowest) - bound):
                continue
            # what was open, and no evidence fixed, may differ
            cost = _cost(self.stated, node.solution.unknowns)
            if cost > bound + _SAME:
                self._push(cost, replace(node, final=True))
                continue
            lowest = min(lowest, bound)
            solutions.append(node.solution)
        return solutions

    def _differs_in_nothing(self, choice: _Choice) -> bool:
        """Return whether no joint deviates and all evidence is equal: other values could only be as good."""
        u = choice.solution.unknowns
        return not u.deviating and _cost(self.stated, u) == 0.0

    # -- signs ----------------------------------------------------------------------------------------

    def _signs(self, node: _Signs) -> None:
        """Choose the sign of the next joint, or fit if all are chosen."""
        order = self.problem.order
        count = len(node.signs)
        if count == self.problem.count:
            if self.fits < _FITS:
                self.fits += 1
                self._fit(node)
            return
        joint = order[count]
        choices = (1.0, -1.0) if joint in self.problem.signed else (1.0,)
        for sign in choices:
            chosen = (*node.signs, sign)
            by_joint = dict(zip(order, chosen, strict=False))
            needed = self.known.zeros(by_joint, joint, node.deviating)
            if needed is None:
                continue
            zeros = node.zeros | needed
            flips = sum(value < 0 for value in chosen)
            self._push(CONVENTION * (flips + len(zeros)), _Signs(node.deviating, chosen, zeros))

    def _fit(self, node: _Signs) -> None:
        signs = np.ones(self.problem.count)
        signs[self.problem.order] = node.signs
        solution = self.problem.solve(signs, node.deviating)
        if not self.problem.holds(solution.gap):
            return
        choice = self._rounded(_Choice(solution, self.problem.free(node.deviating), (), frozenset()))
        self._push(self._bound(choice), choice)

    def _rounded(self, choice: _Choice) -> _Choice:
        """Return the choice with a base and zeros that are only inaccuracies set to zero, as far as the lines agree."""
        problem = self.problem
        values = values_of(choice.solution.unknowns)
        small = [[6 + i] for i in range(problem.count)]
        small.insert(0, list(range(6)))
        for columns in small:
            size = np.abs(values[columns]).max()
            if size == 0.0 or size > _NEAR * problem.tolerance:
                continue
            tried = values_of(choice.solution.unknowns)
            tried[columns] = 0.0
            free = choice.free.copy()
            free[columns] = False
            refined = problem.refine(with_values(choice.solution.unknowns, tried), free)
            if problem.holds(refined.gap):
                # the values may still change later: other evidence may need it
                choice = replace(choice, solution=refined)
        return choice

    # -- evidence -------------------------------------------------------------------------------------

    def _derivatives(self, choice: _Choice, known: Sequence[Evidence]) -> Array:
        """Return the derivatives (rows, free unknowns) of lines, conditions and evidence, in this order."""
        u = choice.solution.unknowns
        columns = np.flatnonzero(choice.free)
        x = values_of(u)
        moved = np.repeat(x[None], len(columns) + 1, axis=0)
        moved[np.arange(len(columns)), columns] += _STEP
        parents, children, groups = self.problem.motions(u.signs, moved, u.deviating)
        rows = [self.problem.rows(u.signs, parents, children)]
        rows.append(self.stated.residuals_of([*choice.conditions, *known], u.signs, moved, groups))
        table = np.concatenate(rows, axis=1)
        return (table[:-1] - table[-1]).T / _STEP

    def _open(self, choice: _Choice, known: Sequence[Evidence]) -> tuple[Array, list[Array]]:
        """Return (directions (free unknowns, k) that are still open, derivatives of each evidence along them)."""
        J = self._derivatives(choice, known)
        sizes = [self.stated.rows(evidence) for evidence in known]
        fixed = J[: len(J) - sum(sizes)]
        directions = _separated(open_directions(fixed).T).T
        along = []
        start = len(J) - sum(sizes)
        for size in sizes:
            along.append(J[start : start + size] @ directions)
            start += size
        return directions, along

    def _bound(self, choice: _Choice) -> float:
        """Return the cost of what no open direction can change."""
        u = choice.solution.unknowns
        cost = CONVENTION * len(u.flips)
        known = self.stated.violated(self.stated.known(u.signs), u)
        _, along = self._open(choice, known)
        for evidence, J in zip(known, along, strict=True):
            is_open = bool(J.size and np.abs(J).max() > _OPEN)
            if not is_open or not self.stated.may_hold(evidence, u):
                cost += evidence.weight
        return cost

    def _branches(self, choice: _Choice, left: float) -> bool:
        """Fix one open direction by each evidence that can; return whether any does, or the choice costs too much.

        `left` is the cost that may still be added: evidence that costs more, and differs, must be made equal.
        """
        u = choice.solution.unknowns
        known = []
        for evidence in self.stated.known(u.signs):
            if evidence not in choice.kept and self.stated.may_hold(evidence, u):
                known.append(evidence)
        directions, along = self._open(choice, known)
        violated = set(self.stated.violated(known, u))
        for evidence, J in zip(known, along, strict=True):
            is_open = bool(J.size and np.abs(J).max() > _OPEN)
            if is_open and evidence in violated and evidence.weight > left + _SAME:
                self._keep(choice, evidence, directions, J)
                return True
        impossible: set[Evidence] = set()
        for direction in _fewest_first(along):
            any_fixed = False
            for evidence, J in zip(known, along, strict=True):
                if evidence in impossible or not np.abs(J[:, direction]).max() > _OPEN:
                    continue
                if self._keep(choice, evidence, directions, J):
                    any_fixed = True
                else:
                    impossible.add(evidence)
            if any_fixed:
                return True
        return False

    def _keep(self, choice: _Choice, evidence: Evidence, directions: Array, J: Array) -> bool:
        """Fit with one more piece of evidence; return whether that is possible."""
        u = choice.solution.unknowns
        key = (u.deviating, tuple(u.signs), choice.kept | {evidence})
        if key in self.seen:
            return True
        self.nodes += 1
        fixed = self._fixed(choice, evidence, directions, J)
        if fixed is None:
            return False
        self.seen.add(key)
        self._push(self._bound(fixed), fixed)
        return True

    def _fixed(self, choice: _Choice, evidence: Evidence, directions: Array, J: Array) -> _Choice | None:
        """Return the fit that keeps a piece of evidence as well; None if there is none."""
        problem = self.problem
        u = choice.solution.unknowns
        free = choice.free.copy()
        stated = self.stated.fixed(evidence, u.signs)
        conditions = choice.conditions
        if not stated:
            conditions = (*conditions, evidence)
        free[list(stated)] = False
        x = values_of(u)
        for column, value in stated.items():
            if not choice.free[column] and abs(x[column] - value) > problem.tolerance:
                return None
        for start in self._starts(choice, evidence, directions, J):
            for column, value in stated.items():
                start[column] = value
            refined = self._refined(with_values(u, start), free, conditions)
            if not problem.holds(refined.gap):
                continue
            keeps = [*conditions, *(kept for kept in choice.kept if kept.kind in ("tool", "inertia")), evidence]
            if not self.stated.violated(keeps, refined.unknowns):
                return _Choice(refined, free, conditions, choice.kept | {evidence})
        return None

    def _starts(self, choice: _Choice, evidence: Evidence, directions: Array, J: Array) -> Iterator[Array]:
        """Yield values to begin with: a step along the open directions, and turns along the one that matters most."""
        u = choice.solution.unknowns
        x = values_of(u)
        columns = np.flatnonzero(choice.free)
        r = self.stated.residuals([evidence], u.signs, x[None], u.deviating)[0]
        step = directions @ np.linalg.lstsq(J, -r, rcond=1e-6)[0]
        moved = x.copy()
        moved[columns] += step
        yield moved
        if evidence.kind not in ("tool", "inertia"):
            return
        most = directions @ np.linalg.svd(J)[2][0]
        turns = [k for k, column in enumerate(columns) if column in self.turning]
        turned = float(np.abs(most[turns]).max(initial=0.0))
        if turned < 1e-3:
            return
        for angle in (0.5 * np.pi, np.pi, 1.5 * np.pi):
            moved = x.copy()
            moved[columns] += most / turned * angle
            yield moved

    def _refined(self, u: Unknowns, free: Array, conditions: Sequence[Evidence]) -> FitSolution:
        def more(values: Array, groups: Array) -> Array:
            return self.stated.residuals_of(conditions, u.signs, values, groups)

        return self.problem.refine(u, free, more if conditions else None)


def _separated(directions: Array) -> Array:
    """Return other directions (k, unknowns) of the same space, each of which changes as few unknowns as possible."""
    rows = directions.copy()
    used: list[int] = []
    # from the last unknown: a zero is a better name for a direction than the base
    for column in reversed(range(rows.shape[1])):
        pivot = len(used)
        if pivot == len(rows):
            break
        largest = pivot + int(np.argmax(np.abs(rows[pivot:, column])))
        if abs(rows[largest, column]) < 1e-4:
            continue
        rows[[pivot, largest]] = rows[[largest, pivot]]
        rows[pivot] /= rows[pivot, column]
        for other in range(len(rows)):
            if other != pivot:
                rows[other] -= rows[other, column] * rows[pivot]
        used.append(column)
    return rows


def _fewest_first(along: Sequence[Array]) -> list[int]:
    """Return the open directions that evidence can fix, those with the fewest pieces of evidence first."""
    if not along:
        return []
    touching = np.array([np.abs(J).max(axis=0) > _OPEN for J in along])
    counts = touching.sum(axis=0)
    return [int(k) for k in np.argsort(counts, kind="stable") if counts[k] > 0]


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
    if max(apart) > LIMIT:
        return shift
    return shift - float(u.signs[i]) * turns * 2 * np.pi


def base_moved(problem: Problem, u: Unknowns) -> bool:
    """Return whether the base frames differ."""
    turn = float(np.linalg.norm(u.base[:3]))
    shift = float(np.linalg.norm(u.base[3:]))
    return shift > problem.tolerance or turn > problem.angle_tolerance


def conventions(problem: Problem) -> list[FitSolution]:
    """Return the likeliest solutions, all with as many changes; [] if no conventions explain the difference.

    Conventions explain all differences where they can. Only where they leave limits or inertias different that one
    deviating joint makes equal, with far fewer changes, is this joint the explanation.
    """
    known = local(problem)
    found: list[FitSolution] = []
    if not any(True for _ in known.contradictions()):
        found = _ordered(problem, _Search(problem, known, np.inf).run([()]))
    if not found:
        return []
    stated = StatedEvidence(problem)
    most = _cost(stated, found[0].unknowns) - _DEVIATION
    if most < 0.0 or not _contradicted(stated, found[0].unknowns):
        return found
    sets = [(place,) for place in _places(problem)]
    others = _Search(problem, known, most - 2 * _SAME).run(sets)
    return _explained(problem, others) or found


def _cost(stated: StatedEvidence, u: Unknowns) -> float:
    """Return the cost of signs and of all evidence that differs."""
    return CONVENTION * len(u.flips) + sum(evidence.weight for evidence in stated.violated(stated.known(u.signs), u))


def _contradicted(stated: StatedEvidence, u: Unknowns) -> bool:
    """Return whether limits or inertias differ that other conventions could make equal."""
    return any(evidence.weight > CONVENTION for evidence in stated.violated(stated.known(u.signs), u))


def _places(problem: Problem) -> list[int]:
    """Return what may deviate: the place of each joint, and the axis alone of each joint that has one."""
    axes = [problem.turned_axis(i) for i in problem.signed if not problem.axes[i].closing]
    return [*range(problem.count), *axes]


def deviations(problem: Problem) -> list[FitSolution]:
    """Return all solutions with the fewest deviating joints, those with the fewest conventions first.

    The result is empty if no `_DEVIATING` joints explain the difference.
    """
    known = local(problem)
    contradictions = list(known.contradictions())
    for size in range(1, _SETS + 1):
        if size == _SETS and not contradictions:
            break
        places = list(range(problem.count))
        if size < _SETS:
            places = _places(problem)
        sets = []
        for chosen in combinations(places, size):
            if all(difference.is_explained(chosen) for difference in contradictions):
                sets.append(chosen)
        solutions = _Search(problem, known, _FLIPS).run(sets)
        if solutions:
            return _explained(problem, solutions)
    return _greedy(problem, known)


def _ordered(problem: Problem, solutions: Sequence[FitSolution]) -> list[FitSolution]:
    """Return different solutions, those with most frames of inner links equal and the fewest changed numbers first."""
    different: list[FitSolution] = []
    for found in solutions:
        solution = replace(found, unknowns=_short_turn(found.unknowns))
        if not any(_same(problem, solution.unknowns, other.unknowns) for other in different):
            different.append(solution)
    keys = []
    for solution in different:
        inner = 0
        for gap in gaps(problem, solution.unknowns):
            if not gap.leaf and gap.differs(problem):
                inner += 1
        keys.append(_INNER * inner + 1e-3 * _INNER * _changed_numbers(solution))
    return [different[k] for k in np.argsort(keys, kind="stable")]


def _explained(problem: Problem, solutions: Sequence[FitSolution]) -> list[FitSolution]:
    """Return the solutions with few changed numbers; of those with the same conventions and joints, the first."""
    different: list[FitSolution] = []
    for solution in solutions:
        if not any(_same(problem, _undeviated(solution), _undeviated(other)) for other in different):
            different.append(solution)
    return _ordered(problem, [_sparse(problem, smallest_deviations(problem, solution)) for solution in different])


def _undeviated(solution: FitSolution) -> Unknowns:
    """Return the unknowns with the deviating joints, but without the size of their deviations."""
    u = solution.unknowns
    return replace(u, deviations=np.zeros((len(u.deviating), 6)))


def _short_turn(u: Unknowns) -> Unknowns:
    """Return unknowns with the turns of base and deviations below half a turn."""
    base = u.base.copy()
    base[:3] = _short_vector(base[:3])
    if u.deviations is None:
        return replace(u, base=base)
    deviations = u.deviations.copy()
    for k, values in enumerate(u.deviations):
        deviations[k, :3] = _short_vector(values[:3])
    return replace(u, base=base, deviations=deviations)


def _short_vector(turn: Array) -> Array:
    """Return a rotation vector (3,) in rad with the same rotation, at most half a turn."""
    if np.linalg.norm(turn) <= np.pi:
        return turn
    return spatial.log_so3(spatial.exp_so3(turn))


def _same(problem: Problem, u: Unknowns, other: Unknowns) -> bool:
    """Return whether two solutions differ only by inaccuracies."""
    if u.deviating != other.deviating or np.any(u.signs != other.signs):
        return False
    difference = values_of(u) - values_of(other)
    turning = turning_columns(problem)
    difference[turning] = np.arctan2(np.sin(difference[turning]), np.cos(difference[turning]))
    return bool(np.abs(difference).max() <= _NEAR * problem.tolerance)


def smallest_deviations(problem: Problem, solution: FitSolution) -> FitSolution:
    """Return the solution with the smallest deviations: lines and frames that agree may leave them open in part.

    Conventions, and all evidence of tools and inertias that agrees, stay as found.
    """
    best = replace(solution, unknowns=_short_turn(solution.unknowns))
    u = best.unknowns
    free = problem.free(u.deviating)
    free[: 6 + problem.count] = False
    columns = np.flatnonzero(free)
    stated = StatedEvidence(problem)
    kept = [evidence for evidence in stated.known(u.signs) if evidence.kind in ("tool", "inertia")]
    differing = stated.violated(kept, u)
    kept = [evidence for evidence in kept if evidence not in differing]

    def more(values: Array, groups: Array) -> Array:
        return stated.residuals_of(kept, u.signs, values, groups)

    for _ in range(_SHRINKS):
        x = values_of(best.unknowns)
        moved = np.repeat(x[None], len(columns) + 1, axis=0)
        moved[np.arange(len(columns)), columns] += _STEP
        parents, children, groups = problem.motions(u.signs, moved, u.deviating)
        rows = np.concatenate([problem.rows(u.signs, parents, children), more(moved, groups)], axis=1)
        undetermined = open_directions((rows[:-1] - rows[-1]).T / _STEP)
        excess = undetermined @ (undetermined.T @ x[columns])
        if np.abs(excess).max() < problem.tolerance:
            break
        tried = x.copy()
        # only a small turn keeps the directions
        tried[columns] -= excess * min(1.0, _SMALL_TURN / float(np.abs(excess).max()))
        refined = problem.refine(with_values(u, tried), free, more)
        smaller = np.linalg.norm(values_of(refined.unknowns)[columns]) < np.linalg.norm(x[columns])
        if not smaller or not problem.holds(refined.gap) or stated.violated(kept, refined.unknowns):
            break
        best = refined
    return best


def _sparse(problem: Problem, solution: FitSolution) -> FitSolution:
    """Return the solution with as few changed numbers of its deviations as possible, with the conventions as found."""
    u = solution.unknowns
    x = values_of(u)
    first = 6 + problem.count
    free = np.zeros(len(x), bool)
    free[first:] = True
    tools = [gap.T for gap in leaf_gaps(problem, u)]
    groups: list[list[int]] = []
    for k in range(len(u.deviating)):
        start = first + 6 * k
        groups += [[start, start + 1, start + 2], [start + 3, start + 4, start + 5]]
        groups += [[start + j] for j in range(6)]
    free &= problem.free(u.deviating)
    best = solution
    for group in groups:
        if not free[group].any():
            continue
        current = values_of(best.unknowns)
        current[group] = 0.0
        tried = free.copy()
        tried[group] = False
        refined = problem.refine(with_values(best.unknowns, current), tried)
        if problem.holds(refined.gap) and _tools_stay(problem, refined.unknowns, tools):
            best = refined
            free = tried
    return best


def _tools_stay(problem: Problem, u: Unknowns, before: Sequence[Array]) -> bool:
    """Return whether the frames of leaf links that were equal are still equal."""
    leaves = leaf_gaps(problem, u)
    for gap, T in zip(leaves, before, strict=True):
        was = replace(gap, T=T)
        if gap.differs(problem) and not was.differs(problem):
            return False
    return True


def _changed_numbers(solution: FitSolution) -> float:
    deviations = solution.unknowns.deviations
    if deviations is None:
        return 0.0
    return float(np.count_nonzero(np.abs(deviations) > 1e-9))


def _greedy(problem: Problem, known: Local) -> list[FitSolution]:
    """Return solutions whose deviating joints are added one by one, each that lowers the gap most."""
    chosen = tuple(sorted(known.different))
    signs = np.ones(problem.count)
    for candidate in _sign_sets(problem, _FLIPS):
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
        if best is None:
            return []
        chosen = best.unknowns.deviating
        if problem.holds(best.gap):
            needed = _needed(problem, signs, chosen)
            found = _Search(problem, known, _FLIPS, _NODES_WITH_MANY).run([needed])
            return _explained(problem, found)
    return []


def _needed(problem: Problem, signs: Array, chosen: tuple[int, ...]) -> tuple[int, ...]:
    """Return the deviating joints without those that a later choice has made needless."""
    needed = list(chosen)
    for joint in chosen:
        fewer = tuple(other for other in needed if other != joint)
        if fewer and problem.holds(problem.solve(signs, fewer).gap):
            needed.remove(joint)
    return tuple(needed)


def _sign_sets(problem: Problem, most: int) -> Iterator[Array]:
    """Yield signs (joints,), fewest changes first, up to `most` changes."""
    for flips in range(min(most, len(problem.signed)) + 1):
        for chosen in combinations(problem.signed, flips):
            signs = np.ones(problem.count)
            signs[list(chosen)] = -1.0
            yield signs
