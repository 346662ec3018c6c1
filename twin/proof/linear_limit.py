"""Limits of joint values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class LinearLimit:
    """A limit of joints: the sum of weight times value must be at least `least`, in m or rad.

    Attributes:
        name: what is limited, as "q1 lower".
        weights: {joint: weight}.
        least: the limit.
    """

    name: str
    weights: Mapping[str, float]
    least: float
