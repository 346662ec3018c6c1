"""The unknowns of a fit of joint lines, and their order as one array of values: base, zeros, deviations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from twin.core.spatial import Array

BASE_VALUES = 6
"""Number of values of the base transform: a rotation vector in rad, then a shift in m."""

_DEVIATION_VALUES = 6
"""Number of values of each deviation: the same, in the frame of the joint."""


class JointDeviation(NamedTuple):
    """What deviates at a joint: its place on its parent link, with all links behind it, or its axis alone.

    Attributes:
        joint: number of the joint in the second side.
        axis_only: whether only the axis is turned about its point, while all links stay.
    """

    joint: int
    axis_only: bool = False


@dataclass(frozen=True)
class Unknowns:
    """Signs and values of a fit.

    Attributes:
        signs: (joints,) 1 or -1 for each joint of the second side.
        base: (6,) rotation vector in rad and shift in m of the base transform X.
        zeros: (joints,) by how much the zero of each joint of the first side differs in m or rad: the coordinate of the
            first side is sign times that of the second plus the zero.
        deviating: what deviates.
        deviations: (deviating, 6) their rotation vectors in rad and shifts in m, in the frame of the joint.
    """

    signs: Array
    base: Array
    zeros: Array
    deviating: tuple[JointDeviation, ...] = ()
    deviations: Array | None = None

    @property
    def flipped_joints(self) -> tuple[int, ...]:
        """Indices of the joints that turn the other way."""
        return tuple(np.flatnonzero(self.signs < 0).tolist())


def values_of(unknowns: Unknowns) -> Array:
    """Return the values (unknowns,) of a fit: base, zeros, deviations."""
    parts = [unknowns.base, unknowns.zeros]
    if unknowns.deviations is not None:
        parts.append(unknowns.deviations.ravel())
    return np.concatenate(parts)


def with_values(unknowns: Unknowns, x: Array) -> Unknowns:
    """Return unknowns with other values (unknowns,), see `values_of`."""
    joint_count = len(unknowns.zeros)
    deviations = x[convention_count(joint_count) :].reshape(-1, _DEVIATION_VALUES)
    return replace(unknowns, base=x[:BASE_VALUES], zeros=x[zero_columns(joint_count)], deviations=deviations)


def convention_count(joint_count: int) -> int:
    """Return the number of values of base and zeros, which stand before those of the deviations."""
    return BASE_VALUES + joint_count


def zero_column(joint: int) -> int:
    """Return the column of the zero of a joint."""
    return BASE_VALUES + joint


def zero_columns(joint_count: int) -> slice:
    """Return the columns of the zeros of all joints."""
    return slice(BASE_VALUES, convention_count(joint_count))


def deviation_columns(joint_count: int, k: int) -> slice:
    """Return the columns of deviation number k: its rotation vector, then its shift."""
    start = convention_count(joint_count) + _DEVIATION_VALUES * k
    return slice(start, start + _DEVIATION_VALUES)


def free_values(joint_count: int, deviating: Sequence[JointDeviation]) -> Array:
    """Return which values (unknowns,) may change: all but the shifts of axes that are only turned."""
    free = np.ones(convention_count(joint_count) + _DEVIATION_VALUES * len(deviating), bool)
    for k, deviation in enumerate(deviating):
        if deviation.axis_only:
            shift = deviation_columns(joint_count, k)
            free[shift.start + 3 : shift.stop] = False
    return free
