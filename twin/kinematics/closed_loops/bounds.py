"""Limits of active joints as linear bounds: of joints, of their motors, and of the distance of two joints on a rail."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from twin.core.spatial import Array
from twin.model.mechanism import Mechanism

_UNLIMITED = (-np.inf, np.inf)


@dataclass(frozen=True)
class Bound:
    """A limit of active joints: weights @ q must be at least `least`.

    Attributes:
        name: name of the joint, of the pair of joints, or of the motor.
        kind: "lower" or "upper" (limit of a joint), "gap" (between two joints on a rail), or "motor" (limit of the
            actuator of a transmission).
        weights: (n,) coefficients of q.
        least: the bound, in m or rad.
    """

    name: str
    kind: str
    weights: Array
    least: float

    def slack(self, q: Array) -> float:
        """Return the distance of q (n,) from the bound, in m or rad; negative if q violates the bound."""
        return float(self.weights @ q - self.least)


def bounds_of(mechanism: Mechanism, gaps: Sequence[tuple[str, str, float]] = ()) -> tuple[Bound, ...]:
    """Return the bounds: hard limits of active joints and their motors, and minimum distances on a rail.

    `gaps` are (lower joint, upper joint, minimum distance in m) for pairs of joints on one rail.
    """
    eye = np.eye(len(mechanism.active))
    index = {}
    for i, joint in enumerate(mechanism.active):
        index[joint.name] = i
    bounds: list[Bound] = []
    for joint in mechanism.active:
        bounds += _range_bounds(joint.name, ("lower", "upper"), eye[index[joint.name]], joint.limits)

    # The motor of a directly driven joint has the joint's name; the limits of this joint are bounds already.
    for name, weights in zip(mechanism.motor_names, mechanism.motors(eye).T, strict=True):
        if name not in index:
            bounds += _range_bounds(name, ("motor", "motor"), weights, mechanism.actuator(name).limits)

    for lower, upper, least in gaps:
        weights = eye[index[upper]] - eye[index[lower]]
        bounds.append(Bound(f"{lower} {upper}", "gap", weights, least))
    return tuple(bounds)


def _range_bounds(
    name: str, kinds: tuple[str, str], weights: Array, limits: tuple[float, float] | None
) -> Iterator[Bound]:
    """Yield the bounds of a range of weights @ q; an end that is infinite is none."""
    low, high = limits or _UNLIMITED
    if np.isfinite(low):
        yield Bound(name, kinds[0], weights, low)
    if np.isfinite(high):
        yield Bound(name, kinds[1], -weights, -high)
