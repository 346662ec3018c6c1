"""Limits, speeds, efforts, masses, inertias and couplings as text, in mm, degrees, kg and N."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from twin.comparison.coupled_motion import SMALLEST_RATIO, CoupledFollower
from twin.comparison.evidence import LIMIT_TOLERANCE
from twin.comparison.fit_problem import FitProblem
from twin.comparison.side import UNLIMITED, Axis, RobotSide
from twin.core import format
from twin.core.quantity import moved
from twin.core.spatial import Array

_SIGNIFICANT_DIGITS = (4, 6, 9)
"""Numbers of significant digits with which two texts are tried until they differ."""


def distinct_texts(texts_with: Callable[[int], tuple[str, str]]) -> tuple[str, str]:
    """Return the texts of two values with as few significant digits as make them differ: four, or more."""
    texts = texts_with(_SIGNIFICANT_DIGITS[0])
    for digits in _SIGNIFICANT_DIGITS:
        texts = texts_with(digits)
        if texts[0] != texts[1]:
            break
    return texts


def position_text(value: float, is_angle: bool, digits: int) -> str:
    """Return a value in m or rad as text in mm or degrees."""
    size = moved(value, is_angle)
    if digits == _SIGNIFICANT_DIGITS[0]:
        return str(size)
    return format.shown(size.value, size.unit, digits)


def interval_text(limits: tuple[float, float] | None, is_angle: bool, digits: int = _SIGNIFICANT_DIGITS[0]) -> str:
    """Return a range in m or rad as text in mm or degrees; "-" if a side states none."""
    if limits is None:
        return "-"
    if limits == UNLIMITED:
        return "no limits"
    return f"{position_text(limits[0], is_angle, digits)} .. {position_text(limits[1], is_angle, digits)}"


def part_texts(axis: Axis, side: RobotSide) -> dict[str, list[str]]:
    """Return {kind: texts} of the limits, speeds and efforts of the joints that a side writes instead of one."""
    texts: dict[str, list[str]] = {"limits": [], "speeds": [], "efforts": []}
    for part in axis.merged_axes:
        if part.limits is not None and part.limits != UNLIMITED:
            texts["limits"].append(f"{part.name} {interval_text(part.limits, part.is_angle)}")
        if part.max_speed is not None:
            texts["speeds"].append(f"{part.name} {speed_text(part.max_speed, part)}")
        if part.name in side.efforts:
            texts["efforts"].append(f"{part.name} {effort_text(side.efforts[part.name], part)}")
    return texts


def speed_text(value: float, axis: Axis) -> str:
    """Return a speed in m/s or rad/s as text."""
    return f"{moved(value, axis.is_angle)}/s"


def effort_text(value: float, axis: Axis) -> str:
    """Return a torque in N m, or a force in N, as text."""
    unit = "N m" if axis.is_angle else "N"
    return f"{value:g} {unit}"


def mass_text(value: float) -> str:
    """Return a mass in kg as text."""
    return f"{value:g} kg"


def point_text(p: Array) -> str:
    """Return a point (3,) in m as text in mm."""
    x, y, z = np.round(1e3 * p, 3) + 0.0
    return f"({x:g}, {y:g}, {z:g}) mm"


def moments_text(tensor: Array) -> str:
    """Return the principal moments of an inertia tensor (3, 3) in kg m2 as text, smallest first."""
    # principal moments: a tensor in other axes shows the same three numbers
    values = map("{:.4g}".format, np.linalg.eigvalsh(tensor))
    return f"moments {', '.join(values)} kg m2"


def tensor_text(tensor: Array, digits: int) -> str:
    """Return the entries of an inertia tensor as text, in the base of the second side."""
    entries = []
    for row, column in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)):
        entries.append(f"i{'xyz'[row]}{'xyz'[column]} {tensor[row, column]:.{digits}g}")
    return f"{', '.join(entries)} kg m2 in the base"


def coupling_text(problem: FitProblem, joint: int, follower: CoupledFollower | None, digits: int) -> str:
    """Return how joint i follows others as a sum, with the names of the second side."""
    if follower is None:
        return "moves freely"
    parts = []
    is_angle = problem.second.axes[joint].is_angle
    for k in np.flatnonzero(np.abs(follower.ratios) > SMALLEST_RATIO):
        leader = problem.second.axes[k]
        unit = ""
        if leader.is_angle != is_angle:
            unit = " rad/m" if is_angle else " m/rad"
        parts.append(f"{follower.ratios[k]:g}{unit} × {leader.name}")
    if abs(follower.offset) > LIMIT_TOLERANCE or not parts:
        parts.append(position_text(follower.offset, is_angle, digits))
    return " + ".join(parts)
