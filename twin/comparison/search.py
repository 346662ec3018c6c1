"""The fit with the fewest conventions and, if none makes two sides agree, with the fewest deviating joints."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from twin.comparison.evidence import CONVENTION_COST, StatedEvidence, rotation_columns
from twin.comparison.evidence_search import COST_TOLERANCE, MAX_EVIDENCE_FITS_OF_MANY, EvidenceSearch, cost_of
from twin.comparison.fit_problem import FitProblem
from twin.comparison.fit_starts import fit_from_starts
from twin.comparison.frame_gaps import frame_gaps
from twin.comparison.invariants import Contradiction, NeighbourLines, neighbour_lines
from twin.comparison.line_gaps import FitSolution, lines_coincide
from twin.comparison.smallest_deviations import (
    INACCURACY_FACTOR,
    smallest_deviations,
    with_few_numbers,
    with_short_turns,
)
from twin.comparison.unknowns import JointDeviation, Unknowns, values_of
from twin.core.spatial import Array

_MAX_CONVENTIONS = 3
"""Maximum number of changed conventions in a solution with deviating joints."""

_MAX_SET_SIZE = 3
"""Number of deviating joints up to which all sets are tried."""

_MAX_DEVIATING_JOINTS = 6
"""Maximum number of deviating joints that are searched."""

_DEVIATION_COST = 2.6
"""Cost of a deviating joint where conventions are an explanation as well: one convention and limits are likelier."""

_INNER_FRAME_COST = 0.01
"""Cost of a moved frame of an inner link: it decides between as many conventions."""

_CHANGED_NUMBER_COST = 1e-3 * _INNER_FRAME_COST
"""Cost of a changed number: it decides between as many moved frames."""

_SMALLEST_CHANGE = 1e-9
"""Size of a deviation in m or rad below which it changes no number."""


def fits_by_conventions(problem: FitProblem) -> list[FitSolution]:
    """Return the likeliest solutions, all with as many changes; [] if no conventions explain the difference.

    Conventions explain all differences where they can. Only where they leave limits or inertias different that one
    deviating joint makes equal, with far fewer changes, is this joint the explanation.
    """
    neighbours = neighbour_lines(problem)
    if next(neighbours.contradictions(), None) is not None:
        return []
    by_conventions = _ordered(problem, EvidenceSearch(problem, neighbours, np.inf).run([()]))
    if not by_conventions:
        return []
    likeliest = by_conventions[0].unknowns
    evidence = StatedEvidence(problem)
    largest_cost = cost_of(evidence, likeliest) - _DEVIATION_COST
    if largest_cost < 0.0 or not _has_unlikely_violation(evidence, likeliest):
        return by_conventions
    sets = [(place,) for place in _places_and_axes(problem)]
    by_one_joint = EvidenceSearch(problem, neighbours, largest_cost - 2 * COST_TOLERANCE).run(sets)
    return _simplified(problem, by_one_joint) or by_conventions


def _has_unlikely_violation(stated: StatedEvidence, unknowns: Unknowns) -> bool:
    """Return whether limits or inertias differ that other conventions could make equal."""
    violated = stated.violated(stated.satisfiable(unknowns.signs), unknowns)
    return any(evidence.weight > CONVENTION_COST for evidence in violated)


def _places(problem: FitProblem) -> list[JointDeviation]:
    """Return the place of each joint."""
    return [JointDeviation(joint) for joint in range(problem.count)]


def _places_and_axes(problem: FitProblem) -> list[JointDeviation]:
    """Return what may deviate: the place of each joint, and the axis alone of each joint that has one."""
    places = _places(problem)
    for i in problem.signed:
        if not problem.axes[i].closes_loop:
            places.append(JointDeviation(i, axis_only=True))
    return places


def fits_by_deviations(problem: FitProblem) -> list[FitSolution]:
    """Return all solutions with the fewest deviating joints, those with the fewest conventions first.

    The result is empty if no `_MAX_DEVIATING_JOINTS` joints explain the difference.
    """
    neighbours = neighbour_lines(problem)
    contradictions = list(neighbours.contradictions())
    for size in range(1, _MAX_SET_SIZE + 1):
        # without contradictions, nothing excludes any of the many sets: each would be fitted
        if size == _MAX_SET_SIZE and not contradictions:
            break
        places = _places(problem)
        if size < _MAX_SET_SIZE:
            places = _places_and_axes(problem)
        sets = []
        for chosen in combinations(places, size):
            if _explains(chosen, contradictions):
                sets.append(chosen)
        solutions = EvidenceSearch(problem, neighbours, _MAX_CONVENTIONS).run(sets)
        if solutions:
            return _simplified(problem, solutions)
    return _added_one_by_one(problem, neighbours)


def _explains(deviating: Collection[JointDeviation], contradictions: Sequence[Contradiction]) -> bool:
    """Return whether a set of deviating joints may remove all contradictions."""
    return all(contradiction.is_explained(deviating) for contradiction in contradictions)


def _ordered(problem: FitProblem, solutions: Sequence[FitSolution]) -> list[FitSolution]:
    """Return different solutions, those with most frames of inner links equal and the fewest changed numbers first."""
    different: list[FitSolution] = []
    for candidate in solutions:
        solution = replace(candidate, unknowns=with_short_turns(candidate.unknowns))
        known = [known_solution.unknowns for known_solution in different]
        if not _is_one_of(problem, solution.unknowns, known):
            different.append(solution)
    costs = []
    for solution in different:
        moved_frames = 0
        for gap in frame_gaps(problem, solution.unknowns):
            if not gap.leaf and gap.differs(problem):
                moved_frames += 1
        costs.append(_INNER_FRAME_COST * moved_frames + _CHANGED_NUMBER_COST * _changed_number_count(solution))
    # stable: solutions of one cost keep the order of the search
    cheapest_first = np.argsort(costs, kind="stable")
    return [different[k] for k in cheapest_first]


def _simplified(problem: FitProblem, solutions: Sequence[FitSolution]) -> list[FitSolution]:
    """Return the solutions with few changed numbers; of those with the same conventions and joints, the first."""
    different: list[FitSolution] = []
    for solution in solutions:
        known = list(map(_undeviated, different))
        if not _is_one_of(problem, _undeviated(solution), known):
            different.append(solution)
    simplified = []
    for solution in different:
        smallest = smallest_deviations(problem, solution)
        simplified.append(with_few_numbers(problem, smallest))
    return _ordered(problem, simplified)


def _is_one_of(problem: FitProblem, unknowns: Unknowns, known: Sequence[Unknowns]) -> bool:
    """Return whether a solution differs from one of some others only by inaccuracies."""
    return any(_is_same(problem, unknowns, other_unknowns) for other_unknowns in known)


def _undeviated(solution: FitSolution) -> Unknowns:
    """Return the unknowns with the deviating joints, but without the size of their deviations."""
    unknowns = solution.unknowns
    return replace(unknowns, deviations=np.zeros((len(unknowns.deviating), 6)))


def _is_same(problem: FitProblem, unknowns: Unknowns, other_unknowns: Unknowns) -> bool:
    """Return whether two solutions differ only by inaccuracies."""
    if unknowns.deviating != other_unknowns.deviating or np.any(unknowns.signs != other_unknowns.signs):
        return False
    difference = values_of(unknowns) - values_of(other_unknowns)
    turning = rotation_columns(problem)
    difference[turning] = np.arctan2(np.sin(difference[turning]), np.cos(difference[turning]))
    return bool(np.abs(difference).max() <= INACCURACY_FACTOR * problem.tolerance)


def _changed_number_count(solution: FitSolution) -> float:
    """Return how many numbers of the deviations are not zero."""
    deviations = solution.unknowns.deviations
    if deviations is None:
        return 0.0
    return float(np.count_nonzero(np.abs(deviations) > _SMALLEST_CHANGE))


def _added_one_by_one(problem: FitProblem, neighbours: NeighbourLines) -> list[FitSolution]:
    """Return solutions whose deviating joints are added one by one, each that lowers the gap most."""
    deviating = tuple(JointDeviation(joint) for joint in sorted(neighbours.differing_pairs))
    signs = np.ones(problem.count)
    for candidate_signs in _sign_sets(problem):
        if neighbours.allows(candidate_signs, deviating):
            signs = candidate_signs
            break
    for _ in range(min(_MAX_DEVIATING_JOINTS, problem.count)):
        # greedily: all sets of so many joints would be far too many
        best: FitSolution | None = None
        for place in _places(problem):
            if place in deviating:
                continue
            solution = fit_from_starts(problem, signs, tuple(sorted((*deviating, place))))
            if best is None or solution.gap.size < best.gap.size:
                best = solution
        if best is None:
            return []
        deviating = best.unknowns.deviating
        if lines_coincide(problem, best.gap):
            needed = _without_needless(problem, signs, deviating)
            solutions = EvidenceSearch(problem, neighbours, _MAX_CONVENTIONS, MAX_EVIDENCE_FITS_OF_MANY).run([needed])
            return _simplified(problem, solutions)
    return []


def _without_needless(
    problem: FitProblem, signs: Array, deviating: tuple[JointDeviation, ...]
) -> tuple[JointDeviation, ...]:
    """Return the deviating joints without those that a later choice has made needless."""
    needed = list(deviating)
    for deviation in deviating:
        fewer = tuple([kept for kept in needed if kept != deviation])
        if fewer and lines_coincide(problem, fit_from_starts(problem, signs, fewer).gap):
            needed.remove(deviation)
    return tuple(needed)


def _sign_sets(problem: FitProblem) -> Iterator[Array]:
    """Yield signs (joints,), fewest changes first, up to `_MAX_CONVENTIONS` changes."""
    for flips in range(min(_MAX_CONVENTIONS, len(problem.signed)) + 1):
        for chosen in combinations(problem.signed, flips):
            signs = np.ones(problem.count)
            signs[list(chosen)] = -1.0
            yield signs
