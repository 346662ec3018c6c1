"""Limits, bodies and couplings of the first side in the terms of the second, after the conventions of a solution."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from twin.comparison.convention_sizes import zero_of
from twin.comparison.coupled_motion import CoupledFollower, coupling_constraints, followers_by_elimination
from twin.comparison.fit_problem import FitProblem
from twin.comparison.line_gaps import FitSolution
from twin.comparison.side import RobotSide
from twin.comparison.unknowns import values_of
from twin.core.spatial import Array


def mapped_limits(problem: FitProblem, solution: FitSolution, joint: int) -> tuple[float, float] | None:
    """Return the limits of the first side as values of the second in m or rad, or None."""
    limits = problem.axes[joint].limits
    if limits is None:
        return None
    sign = solution.unknowns.signs[joint]
    zero = zero_of(problem, solution.unknowns, joint)
    low, high = np.sort(sign * (np.array(limits) - zero)).tolist()
    return low, high


def partner_groups(problem: FitProblem) -> dict[int, int]:
    """Return {group of the first side: group of the second side}."""
    partners = {0: 0}
    for i, axis in enumerate(problem.axes):
        if not axis.closes_loop:
            partners[axis.child] = problem.second.axes[i].child
    return partners


def body_motions(problem: FitProblem, solution: FitSolution) -> Array:
    """Return the motions (groups, 4, 4) of the bodies of the first side onto those of the second."""
    unknowns = solution.unknowns
    _, _, motions = problem.motions(unknowns.signs, values_of(unknowns)[None], unknowns.deviating)
    return motions[0]


class CoupledSides(NamedTuple):
    """What follows in each side, as values of the second side, and the order in which joints are made followers."""

    first: dict[int, CoupledFollower]
    second: dict[int, CoupledFollower]
    order: list[int]


def coupled_sides(problem: FitProblem, solution: FitSolution) -> CoupledSides:
    """Return the followers of both sides, so that the same joints follow in both where the couplings allow it."""
    unknowns = solution.unknowns
    zeros = np.zeros(problem.count)
    for joint in range(problem.count):
        zeros[joint] = zero_of(problem, unknowns, joint)
    ratios, totals = coupling_constraints(problem.first, problem.axes)
    # q_first = sign * q_second + zero
    ratios_of_first = ratios * unknowns.signs
    totals_of_first = totals - ratios @ zeros
    ratios_of_second, totals_of_second = coupling_constraints(problem.second, problem.second.axes)
    order = _follower_order(problem)
    first = followers_by_elimination(ratios_of_first, totals_of_first, order)
    second = followers_by_elimination(ratios_of_second, totals_of_second, order)
    return CoupledSides(first, second, order)


def _followers(side: RobotSide) -> set[str]:
    """Return the names of the joints that a coupling lets follow others."""
    return {coupling.follower for coupling in side.couplings}


def _follower_order(problem: FitProblem) -> list[int]:
    """Return the joints: those that follow in the second side, then those that follow in the first, then all others."""
    first_followers = _followers(problem.first)
    second_followers = _followers(problem.second)
    order = []
    for i, axis in enumerate(problem.second.axes):
        if axis.name in second_followers:
            order.append(i)
    for i, axis in enumerate(problem.axes):
        if axis.name in first_followers and i not in order:
            order.append(i)
    for i in range(problem.count):
        if i not in order:
            order.append(i)
    return order
