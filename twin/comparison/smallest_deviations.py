"""The smallest deviations of a solution, with as few changed numbers as possible.

Lines and frames that agree may leave the deviations of joints open in part: of equal explanations, the smallest is
told.

The unknowns are the columns of `unknowns`: base (6), zeros (joints), then six for each deviation, a rotation vector in
rad and a shift in m. `smallest_deviations` takes away the part of the deviations that lies in the null space of the
derivatives of all residuals, and corrects what is left by Gauss-Newton steps (`refine`), until nothing is left in it.
Small means the norm of all these numbers, rad and m side by side: a turn of 1 rad counts as a shift of 1 m.
`with_few_numbers` then holds one group of numbers after the other at zero, as long as lines and tools still agree.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from twin.comparison.evidence import StatedEvidence
from twin.comparison.fit_problem import FitProblem
from twin.comparison.frame_gaps import leaf_frame_gaps
from twin.comparison.line_gaps import FitSolution, line_residuals, lines_coincide
from twin.comparison.refinement import DIFFERENCE_STEP, open_directions, refine, stepped_values
from twin.comparison.unknowns import Unknowns, convention_count, deviation_columns, free_values, values_of, with_values
from twin.core import spatial
from twin.core.spatial import Array

INACCURACY_FACTOR = 100.0
"""Factor of the tolerance up to which a value may be inaccuracy of the file, so that zero is tried."""

_MAX_STEPS = 12
"""Maximum number of steps to the smallest deviations."""

_LARGEST_CHANGE = 0.5
"""Largest change of a value in rad or m in one of these steps."""


def smallest_deviations(problem: FitProblem, solution: FitSolution) -> FitSolution:
    """Return the solution with the smallest deviations: lines and frames that agree may leave them open in part.

    Conventions, and all evidence of tools and inertias that agrees, stay as found.
    """
    best = replace(solution, unknowns=with_short_turns(solution.unknowns))
    unknowns = best.unknowns
    free = free_values(problem.count, unknowns.deviating)
    free[: convention_count(problem.count)] = False  # base and zeros stay as found
    columns = np.flatnonzero(free)
    stated = StatedEvidence(problem)
    of_bodies = []
    for evidence in stated.satisfiable(unknowns.signs):
        if evidence.kind in ("tool", "inertia"):
            of_bodies.append(evidence)
    differing = stated.violated(of_bodies, unknowns)
    # what differs anyway must not pull the deviations towards itself
    agreeing = []
    for evidence in of_bodies:
        if evidence not in differing:
            agreeing.append(evidence)

    def residuals_of_agreeing(values: Array, groups: Array) -> Array:
        return stated.residuals_of(agreeing, unknowns.signs, values, groups)

    for _ in range(_MAX_STEPS):
        x = values_of(best.unknowns)
        stepped = stepped_values(x, columns)
        parents, children, groups = problem.motions(unknowns.signs, stepped, unknowns.deviating)
        lines = line_residuals(problem, unknowns.signs, parents, children)
        rows = np.concatenate([lines, residuals_of_agreeing(stepped, groups)], axis=1)
        undetermined = open_directions((rows[:-1] - rows[-1]).T / DIFFERENCE_STEP)
        # the part of the deviations that neither lines nor evidence determine
        excess = undetermined @ (undetermined.T @ x[columns])
        if np.abs(excess).max() < problem.tolerance:
            break
        x_tried = x.copy()
        # only a small turn keeps the directions
        x_tried[columns] -= excess * min(1.0, _LARGEST_CHANGE / float(np.abs(excess).max()))
        refined = refine(problem, with_values(unknowns, x_tried), free, residuals_of_agreeing)
        smaller = np.linalg.norm(values_of(refined.unknowns)[columns]) < np.linalg.norm(x[columns])
        if not smaller or not lines_coincide(problem, refined.gap) or stated.violated(agreeing, refined.unknowns):
            break
        best = refined
    return best


def with_few_numbers(problem: FitProblem, solution: FitSolution) -> FitSolution:
    """Return the solution with as few changed numbers of its deviations as possible, with the conventions as found."""
    unknowns = solution.unknowns
    tools = [gap.T for gap in leaf_frame_gaps(problem, unknowns)]
    free = free_values(problem.count, unknowns.deviating)
    free[: convention_count(problem.count)] = False
    best = solution
    for columns in _columns_of_deviations(problem, unknowns):
        if not free[columns].any():
            continue
        values = values_of(best.unknowns)
        values[columns] = 0.0
        fewer_free = free.copy()
        fewer_free[columns] = False
        refined = refine(problem, with_values(best.unknowns, values), fewer_free)
        if lines_coincide(problem, refined.gap) and _tools_stay(problem, refined.unknowns, tools):
            best = refined
            free = fewer_free
    return best


def _columns_of_deviations(problem: FitProblem, unknowns: Unknowns) -> Iterator[list[int]]:
    """Yield the unknowns that are held at zero together: of each joint its turn, its shift, then each number."""
    for k in range(len(unknowns.deviating)):
        place = deviation_columns(problem.count, k)
        columns = list(range(place.start, place.stop))
        yield columns[:3]
        yield columns[3:]
        for column in columns:
            yield [column]


def _tools_stay(problem: FitProblem, unknowns: Unknowns, before: Sequence[Array]) -> bool:
    """Return whether the frames of leaf links that were equal are still equal."""
    leaves = leaf_frame_gaps(problem, unknowns)
    for gap, T in zip(leaves, before, strict=True):
        gap_before = replace(gap, T=T)
        if gap.differs(problem) and not gap_before.differs(problem):
            return False
    return True


def with_short_turns(unknowns: Unknowns) -> Unknowns:
    """Return unknowns with the turns of base and deviations of at most half a turn."""
    base = unknowns.base.copy()
    base[:3] = _shortest_vector(base[:3])
    if unknowns.deviations is None:
        return replace(unknowns, base=base)
    deviations = unknowns.deviations.copy()
    for k, values in enumerate(unknowns.deviations):
        deviations[k, :3] = _shortest_vector(values[:3])
    return replace(unknowns, base=base, deviations=deviations)


def _shortest_vector(turn: Array) -> Array:
    """Return a rotation vector (3,) in rad with the same rotation, at most half a turn."""
    if np.linalg.norm(turn) <= np.pi:
        return turn
    return spatial.log_so3(spatial.exp_so3(turn))
