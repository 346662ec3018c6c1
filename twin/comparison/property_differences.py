"""What differs in a property of two sides, as numbers in SI units that an edit must make zero."""

from __future__ import annotations

import numpy as np

from twin.comparison.fit_problem import FitProblem
from twin.comparison.line_gaps import FitSolution
from twin.comparison.mapped_properties import body_motions, coupled_sides, mapped_limits, partner_groups
from twin.comparison.properties import BODY_KINDS
from twin.core.spatial import Array


def property_difference(problem: FitProblem, solution: FitSolution, kind: str, index: int) -> Array:
    """Return what differs in a row of some kind, as numbers in SI units; `index` as in `PropertyRow`.

    (0,) if a side does not state the value.
    """
    if kind in BODY_KINDS:
        return _difference_of_bodies(problem, solution, kind, index)
    if kind == "couplings":
        return _difference_of_couplings(problem, solution, index)
    if kind == "limits":
        return _difference_of_limits(problem, solution, index)
    first = problem.axes[index]
    second = problem.second.axes[index]
    if kind == "efforts":
        return _difference_of_numbers(problem.first.efforts.get(first.name), problem.second.efforts.get(second.name))
    return _difference_of_numbers(first.max_speed, second.max_speed)


def _difference_of_numbers(first: float | None, second: float | None) -> Array:
    """Return the difference (1,) of two values; (0,) if a side does not state it."""
    if first is None or second is None:
        return np.zeros(0)
    return np.array([first - second])


def _difference_of_limits(problem: FitProblem, solution: FitSolution, joint: int) -> Array:
    """Return the differences (2,) of both ends of a range in m or rad."""
    mapped = mapped_limits(problem, solution, joint)
    limits = problem.second.axes[joint].limits
    if mapped is None or limits is None:
        return np.zeros(0)
    differences = np.zeros(2)
    for k in range(2):
        if mapped[k] != limits[k]:  # equal limits can be infinite
            differences[k] = mapped[k] - limits[k]
    return differences


def _difference_of_bodies(problem: FitProblem, solution: FitSolution, kind: str, group: int) -> Array:
    """Return the difference of mass (1,) in kg, centre (3,) in m or tensor (9,) in kg m2 of a group of bodies."""
    # an edit may have left no joint that carries the group
    partner = partner_groups(problem).get(group, 0)
    first = problem.first.groups[group].inertia
    second = problem.second.groups[partner].inertia
    if first is None or second is None:
        return np.zeros(0)
    first_moved = first.seen_from(body_motions(problem, solution)[group])
    if kind == "masses":
        return np.array([first_moved.mass - second.mass])
    if kind == "centres of mass":
        return first_moved.p_body_com - second.p_body_com
    return (first_moved.I_com - second.I_com).ravel()


def _difference_of_couplings(problem: FitProblem, solution: FitSolution, joint: int) -> Array:
    """Return the differences (joints + 1,) of the ratios with which a joint follows, then of its offset."""
    coupled = coupled_sides(problem, solution)
    first = coupled.first.get(joint)
    second = coupled.second.get(joint)
    if first is None or second is None:
        return np.zeros(0)
    return np.append(first.ratios - second.ratios, first.offset - second.offset)
