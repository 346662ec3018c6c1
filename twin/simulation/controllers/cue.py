"""Haptic cue: a force towards the model's tip when the machine's tip deviates from it.

The equations are (3) to (6) of "Surgeon Training in Telerobotic Surgery via a Hardware-in-the-Loop Simulator".

p is the position of a tip in mm and v its velocity in mm/s; dp = p_model - p_machine, dv likewise. The force F d acts
along d = dp / |dp|:

- "printed": F = 0.05 where |dp| > tol, and else kp |dp| + kd |dv|. So the force falls when |dp| exceeds tol, and is
  not 0 below tol; the unit of 0.05 is not printed.
- "corrected": F = 0 where |dp| <= tol, and else min(kp |dp| + kd |dv|, most). This reading, kp, kd and the largest
  force are ASSUMED: they are not published. At the limit, the force jumps by kp tol + kd |dv|; with `blend`, it grows
  from 0 over the distance `blend`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from twin.core.errors import TwinError
from twin.core.spatial import Array, length

_MM_PER_M = 1e3

_PRINTED_FORCE = 0.05
"""Force above the limit in the printed equation; the paper prints no unit."""


@dataclass(frozen=True)
class Cue:
    """Parameters of the cue.

    Attributes:
        reading: "printed" or "corrected" equation (5).
        tol: deviation in mm above which the force acts.
        kp, kd: gains in N/mm and N s/mm.
        most: largest force in N, of both readings.
        blend: distance in mm beyond `tol` over which the corrected force grows from 0; 0: the force jumps at `tol`.
    """

    reading: Literal["printed", "corrected"] = "corrected"
    tol: float = 3.0
    kp: float = 0.1
    kd: float = 0.002
    most: float = 1.5
    blend: float = 0.0

    def __post_init__(self) -> None:
        for name in ("tol", "kp", "kd", "most", "blend"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise TwinError(f"cue: {name} is {value:g}; it must be finite and at least 0")

    def force(self, dp: Array, dv: Array) -> Array:
        """Return the force (3,) in N on the operator's hand.

        Args:
            dp: (3,) tip of the model minus tip of the machine, m.
            dv: (3,) linear velocity of the model's tip minus that of the machine's tip, m/s.
        """
        distance = _MM_PER_M * length(dp)
        speed = _MM_PER_M * length(dv)
        if distance == 0:
            return np.zeros(3)  # the force has no direction
        magnitude = self.kp * distance + self.kd * speed
        if self.reading == "printed":
            if distance > self.tol:
                magnitude = _PRINTED_FORCE
        elif distance <= self.tol:
            magnitude = 0.0
        elif self.blend:
            s = min((distance - self.tol) / self.blend, 1.0)
            magnitude *= s * s * (3 - 2 * s)
        return min(magnitude, self.most) * _MM_PER_M / distance * np.asarray(dp, float)
