"""The solutions with the lowest cost for given sets of deviating joints.

A best-first search with a bound that never exceeds the cost: it chooses the joints that turn the other way, one by one,
fits all values, and then chooses which evidence fixes what the lines leave open.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin.comparison.coupled_motion import eliminate_column
from twin.comparison.evidence import CONVENTION_COST, Evidence, StatedEvidence, rotation_columns
from twin.comparison.fit_problem import FitProblem
from twin.comparison.fit_starts import fit_from_starts
from twin.comparison.invariants import NeighbourLines
from twin.comparison.line_gaps import FitSolution, line_residuals, lines_coincide
from twin.comparison.refinement import DIFFERENCE_STEP, open_directions, refine, stepped_values
from twin.comparison.smallest_deviations import INACCURACY_FACTOR
from twin.comparison.unknowns import (
    BASE_VALUES,
    JointDeviation,
    Unknowns,
    free_values,
    values_of,
    with_values,
    zero_column,
)
from twin.core.spatial import Array

_MAX_SIGN_FITS = 160
"""Maximum number of sets of signs that are fitted."""

_MAX_EVIDENCE_FITS = 400
"""Maximum number of choices of evidence that are fitted."""

MAX_EVIDENCE_FITS_OF_MANY = 60
"""The same where many joints deviate: conventions then mean little, and the values of each fit are many."""

COST_TOLERANCE = 1e-6
"""Difference of costs up to which two solutions need as many changes."""

_OPEN_DERIVATIVE = 1e-5
"""Change of evidence along a direction that the lines leave open, from which it can fix this direction."""

_SMALLEST_PIVOT = 1e-4
"""Size of an element below which it separates no directions: derivatives by differences have such errors."""

_SMALLEST_TURN_SHARE = 1e-3
"""Share of a unit direction in rad below which turns along it are turns of nothing."""


@dataclass(frozen=True)
class _SignChoice:
    """Signs of the first joints of the order, and the zeros that they need."""

    deviating: tuple[JointDeviation, ...]
    signs: tuple[float, ...]
    zeros: frozenset[int]


@dataclass(frozen=True)
class _FitChoice:
    """A fit of which some values are fixed.

    Attributes:
        solution: the fit.
        free: (unknowns,) the values that may still change.
        conditions: the evidence that must stay equal.
        used_evidence: all evidence that fixed values.
        is_final: whether no more evidence can fix anything.
    """

    solution: FitSolution
    free: Array
    conditions: tuple[Evidence, ...]
    used_evidence: frozenset[Evidence]
    is_final: bool = False


class EvidenceSearch:
    """The search over some sets of deviating joints; `run` returns all solutions with the lowest cost.

    Attributes:
        problem: the two sides.
        neighbours: what consecutive joint lines say before a fit.
        largest_cost: costs above it are not searched.
        max_evidence_fits: maximum number of choices of evidence that are fitted.
    """

    def __init__(
        self,
        problem: FitProblem,
        neighbours: NeighbourLines,
        largest_cost: float,
        max_evidence_fits: int = _MAX_EVIDENCE_FITS,
    ) -> None:
        self.problem = problem
        self.neighbours = neighbours
        self.largest_cost = largest_cost
        self.max_evidence_fits = max_evidence_fits
        self.stated = StatedEvidence(problem)
        self._rotation_columns = rotation_columns(problem)
        self._heap: list[tuple[float, int, _SignChoice | _FitChoice]] = []
        self._pushed_count = 0
        self._fitted_choices: set[tuple[object, ...]] = set()
        self._sign_fit_count = 0
        self._evidence_fit_count = 0

    def _push(self, bound: float, choice: _SignChoice | _FitChoice) -> None:
        """Add a choice whose cost is at least `bound` to those that are searched, unless this is too much."""
        if bound > self.largest_cost + COST_TOLERANCE:
            return
        # of equal bounds the first one: choices cannot be compared
        self._pushed_count += 1
        heapq.heappush(self._heap, (bound, self._pushed_count, choice))

    def run(self, sets: Sequence[tuple[JointDeviation, ...]]) -> list[FitSolution]:
        """Return the solutions with the lowest cost for these sets of deviating joints."""
        for deviating in sets:
            self._push(0.0, _SignChoice(deviating, (), frozenset()))
        solutions: list[FitSolution] = []
        lowest_cost = np.inf
        while self._heap:
            bound, _, choice = heapq.heappop(self._heap)
            if bound > lowest_cost + COST_TOLERANCE:  # so are all that remain on the heap
                break
            if isinstance(choice, _SignChoice):
                self._push_signs(choice)
                continue
            if self._differs_in_nothing(choice):
                lowest_cost = 0.0
                solutions.append(choice.solution)
                continue
            may_branch = not choice.is_final and self._evidence_fit_count < self.max_evidence_fits
            if may_branch and self._push_branches(choice, min(self.largest_cost, lowest_cost) - bound):
                continue
            # what was open, and no evidence fixed, may differ
            exact_cost = cost_of(self.stated, choice.solution.unknowns)
            if exact_cost > bound + COST_TOLERANCE:
                self._push(exact_cost, replace(choice, is_final=True))
                continue
            lowest_cost = min(lowest_cost, bound)
            solutions.append(choice.solution)
        return solutions

    def _differs_in_nothing(self, choice: _FitChoice) -> bool:
        """Return whether no joint deviates and all evidence is equal: other values could only be as good."""
        unknowns = choice.solution.unknowns
        return not unknowns.deviating and cost_of(self.stated, unknowns) == 0.0

    # -- signs ----------------------------------------------------------------------------------------

    def _push_signs(self, choice: _SignChoice) -> None:
        """Choose the sign of the next joint, or fit if all are chosen."""
        order = self.problem.order
        count = len(choice.signs)
        if count == self.problem.count:
            if self._sign_fit_count < _MAX_SIGN_FITS:
                self._sign_fit_count += 1
                self._push_fit(choice)
            return
        joint = order[count]
        # the sign of a ball, or of a line without a direction, changes nothing
        possible = (1.0, -1.0) if joint in self.problem.signed else (1.0,)
        for sign in possible:
            signs = (*choice.signs, sign)
            by_joint = dict(zip(order, signs, strict=False))
            needed = self.neighbours.needed_zeros(by_joint, joint, choice.deviating)
            if needed is None:
                continue
            zeros = choice.zeros | needed
            conventions = signs.count(-1.0) + len(zeros)
            self._push(CONVENTION_COST * conventions, _SignChoice(choice.deviating, signs, zeros))

    def _push_fit(self, choice: _SignChoice) -> None:
        """Fit all values with the chosen signs."""
        signs = np.ones(self.problem.count)
        signs[self.problem.order] = choice.signs
        solution = fit_from_starts(self.problem, signs, choice.deviating)
        if not lines_coincide(self.problem, solution.gap):
            return
        free = free_values(self.problem.count, choice.deviating)
        fitted = self._without_inaccuracies(_FitChoice(solution, free, (), frozenset()))
        self._push(self._cost_bound(fitted), fitted)

    def _without_inaccuracies(self, choice: _FitChoice) -> _FitChoice:
        """Return the choice with a base and zeros that are only inaccuracies set to zero, as far as the lines agree."""
        problem = self.problem
        values = values_of(choice.solution.unknowns)
        conventions = [list(range(BASE_VALUES))]  # columns of the base, then of each zero
        for i in range(problem.count):
            conventions.append([zero_column(i)])
        for columns in conventions:
            size = np.abs(values[columns]).max()
            if size == 0.0 or size > INACCURACY_FACTOR * problem.tolerance:
                continue
            values_tried = values_of(choice.solution.unknowns)
            values_tried[columns] = 0.0
            free = choice.free.copy()
            free[columns] = False
            refined = refine(problem, with_values(choice.solution.unknowns, values_tried), free)
            if lines_coincide(problem, refined.gap):
                # the values may still change later: other evidence may need it
                choice = replace(choice, solution=refined)
        return choice

    # -- evidence -------------------------------------------------------------------------------------

    def _derivatives(self, choice: _FitChoice, pieces: Sequence[Evidence]) -> Array:
        """Return the derivatives (rows, free unknowns) of lines, conditions and evidence, in this order."""
        unknowns = choice.solution.unknowns
        columns = np.flatnonzero(choice.free)
        x = values_of(unknowns)
        stepped = stepped_values(x, columns)
        parents, children, groups = self.problem.motions(unknowns.signs, stepped, unknowns.deviating)
        lines = line_residuals(self.problem, unknowns.signs, parents, children)
        evidence = self.stated.residuals_of([*choice.conditions, *pieces], unknowns.signs, stepped, groups)
        rows = np.concatenate([lines, evidence], axis=1)
        return (rows[:-1] - rows[-1]).T / DIFFERENCE_STEP

    def _open_directions(self, choice: _FitChoice, pieces: Sequence[Evidence]) -> tuple[Array, list[Array]]:
        """Return (directions (free unknowns, k) that are still open, derivatives of each evidence along them)."""
        J = self._derivatives(choice, pieces)
        sizes = list(map(self.stated.row_count, pieces))
        start = len(J) - sum(sizes)
        directions = _sparse_directions(open_directions(J[:start]).T).T
        along = []
        for size in sizes:
            along.append(J[start : start + size] @ directions)
            start += size
        return directions, along

    def _cost_bound(self, choice: _FitChoice) -> float:
        """Return the cost of what no open direction can change."""
        unknowns = choice.solution.unknowns
        bound = CONVENTION_COST * len(unknowns.flipped_joints)
        pieces = self.stated.violated(self.stated.satisfiable(unknowns.signs), unknowns)
        _, along = self._open_directions(choice, pieces)
        for evidence, J in zip(pieces, along, strict=True):
            if not _is_open(J) or not self.stated.may_be_equal(evidence, unknowns):
                bound += evidence.weight
        return bound

    def _push_branches(self, choice: _FitChoice, budget: float) -> bool:
        """Fix one open direction by each evidence that can; return whether any does, or the choice costs too much.

        `budget` is the cost that may still be added: evidence that costs more, and differs, must be made equal.
        """
        unknowns = choice.solution.unknowns
        pieces = []
        for evidence in self.stated.satisfiable(unknowns.signs):
            if evidence not in choice.used_evidence and self.stated.may_be_equal(evidence, unknowns):
                pieces.append(evidence)
        directions, along = self._open_directions(choice, pieces)
        violated = set(self.stated.violated(pieces, unknowns))
        for evidence, J in zip(pieces, along, strict=True):
            if _is_open(J) and evidence in violated and evidence.weight > budget + COST_TOLERANCE:
                self._push_fit_with(choice, evidence, directions, J)
                return True
        impossible: set[Evidence] = set()
        for direction in _fewest_first(along):
            is_fixed = False
            for evidence, J in zip(pieces, along, strict=True):
                # a fit with evidence is the same for all directions: what failed fails again
                if evidence in impossible or not _is_open(J[:, direction]):
                    continue
                if self._push_fit_with(choice, evidence, directions, J):
                    is_fixed = True
                else:
                    impossible.add(evidence)
            if is_fixed:
                return True
        return False

    def _push_fit_with(self, choice: _FitChoice, evidence: Evidence, directions: Array, J: Array) -> bool:
        """Fit with one more piece of evidence; return whether that is possible."""
        unknowns = choice.solution.unknowns
        key = (unknowns.deviating, tuple(unknowns.signs), choice.used_evidence | {evidence})
        if key in self._fitted_choices:  # the same evidence in another order
            return True
        self._evidence_fit_count += 1
        fixed = self._choice_with_evidence(choice, evidence, directions, J)
        if fixed is None:
            return False
        self._fitted_choices.add(key)
        self._push(self._cost_bound(fixed), fixed)
        return True

    def _choice_with_evidence(
        self, choice: _FitChoice, evidence: Evidence, directions: Array, J: Array
    ) -> _FitChoice | None:
        """Return the fit that keeps a piece of evidence as well; None if there is none."""
        problem = self.problem
        unknowns = choice.solution.unknowns
        free = choice.free.copy()
        stated = self.stated.fixed_values(evidence, unknowns.signs)
        conditions = choice.conditions
        if not stated:
            conditions = (*conditions, evidence)
        free[list(stated)] = False
        x = values_of(unknowns)
        for column, value in stated.items():
            # other evidence has fixed this value elsewhere
            if not choice.free[column] and abs(x[column] - value) > problem.tolerance:
                return None
        must_hold = [*conditions, evidence]
        for evidence_kept in choice.used_evidence:
            if evidence_kept.kind in ("tool", "inertia"):
                must_hold.append(evidence_kept)
        for start in self._starts(choice, evidence, directions, J):
            for column, value in stated.items():
                start[column] = value
            refined = self._refined(with_values(unknowns, start), free, conditions)
            if lines_coincide(problem, refined.gap) and not self.stated.violated(must_hold, refined.unknowns):
                return _FitChoice(refined, free, conditions, choice.used_evidence | {evidence})
        return None

    def _starts(self, choice: _FitChoice, evidence: Evidence, directions: Array, J: Array) -> Iterator[Array]:
        """Yield values to begin with: a step along the open directions, and turns along the one that matters most."""
        unknowns = choice.solution.unknowns
        x = values_of(unknowns)
        columns = np.flatnonzero(choice.free)
        r = self.stated.residuals([evidence], unknowns.signs, x[None], unknowns.deviating)[0]
        step = directions @ np.linalg.lstsq(J, -r, rcond=1e-6)[0]
        start = x.copy()
        start[columns] += step
        yield start
        if evidence.kind not in ("tool", "inertia"):
            return
        # from a frame that is turned by a right angle or more, no small step leads to the other one
        _, _, Vt = np.linalg.svd(J)
        steepest = directions @ Vt[0]
        turns = np.isin(columns, self._rotation_columns)
        largest_turn = float(np.abs(steepest[turns]).max(initial=0.0))
        if largest_turn < _SMALLEST_TURN_SHARE:
            return
        for angle in (0.5 * np.pi, np.pi, 1.5 * np.pi):
            start = x.copy()
            start[columns] += steepest / largest_turn * angle
            yield start

    def _refined(self, unknowns: Unknowns, free: Array, conditions: Sequence[Evidence]) -> FitSolution:
        """Return the fit of the free values (unknowns,) of lines and conditions."""
        if not conditions:
            return refine(self.problem, unknowns, free)

        def residuals_of_conditions(values: Array, groups: Array) -> Array:
            return self.stated.residuals_of(conditions, unknowns.signs, values, groups)

        return refine(self.problem, unknowns, free, residuals_of_conditions)


def _is_open(J: Array) -> bool:
    """Return whether a change along some directions, with derivatives J (rows, ...), changes evidence."""
    return bool(J.size and np.abs(J).max() > _OPEN_DERIVATIVE)


def _sparse_directions(directions: Array) -> Array:
    """Return other directions (k, unknowns) of the same space, each of which changes as few unknowns as possible."""
    rows = directions.copy()
    pivot_columns: list[int] = []
    # from the last unknown: a zero is a better name for a direction than the base
    for column in reversed(range(rows.shape[1])):
        pivot = len(pivot_columns)
        if pivot == len(rows):
            break
        largest = pivot + int(np.argmax(np.abs(rows[pivot:, column])))
        if abs(rows[largest, column]) < _SMALLEST_PIVOT:
            continue
        eliminate_column(rows, pivot, largest, column)
        pivot_columns.append(column)
    return rows


def _fewest_first(along: Sequence[Array]) -> list[int]:
    """Return the open directions that evidence can fix, those with the fewest pieces of evidence first."""
    if not along:
        return []
    counts = np.zeros(along[0].shape[1], int)
    for J in along:
        counts += np.abs(J).max(axis=0) > _OPEN_DERIVATIVE
    order = np.argsort(counts, kind="stable")
    return order[counts[order] > 0].tolist()


def cost_of(stated: StatedEvidence, unknowns: Unknowns) -> float:
    """Return the cost of signs and of all evidence that differs."""
    cost_of_evidence = 0.0
    for evidence in stated.violated(stated.satisfiable(unknowns.signs), unknowns):
        cost_of_evidence += evidence.weight
    return CONVENTION_COST * len(unknowns.flipped_joints) + cost_of_evidence
