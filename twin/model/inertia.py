"""Mass, centre of mass and inertia tensor of a body."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations

import numpy as np

from twin.core.spatial import Array

_ROUNDING = 1e-6
"""Share by which the largest moment may exceed the sum of the others: a flat plate's is equal, but for rounding."""


@dataclass(frozen=True)
class Inertia:
    """Mass in kg, centre of mass (3,) in m, and inertia (3, 3) in kg m^2 about that centre, in the body frame."""

    mass: float
    p_body_com: Array
    I_com: Array

    def __add__(self, other: Inertia) -> Inertia:
        """Return the inertia of two bodies fixed to each other, both in the same frame (parallel axis theorem)."""
        mass = self.mass + other.mass
        centre = (self.mass * self.p_body_com + other.mass * other.p_body_com) / mass
        tensor = np.zeros((3, 3))
        for part in (self, other):
            offset = part.p_body_com - centre
            tensor += part.I_com + part.mass * ((offset @ offset) * np.eye(3) - np.outer(offset, offset))
        return Inertia(mass, centre, tensor)

    def seen_from(self, T: Array) -> Inertia:
        """Return this inertia in another frame; T (4, 4) is the pose of the current frame in the other frame."""
        R = T[:3, :3]
        return Inertia(self.mass, R @ self.p_body_com + T[:3, 3], R @ self.I_com @ R.T)

    def principal(self) -> tuple[Array, Array]:
        """Return the principal moments (3,) in kg m2, and the rotation (3, 3) whose columns are the principal axes.

        Order and signs of the axes are chosen so that the rotation is nearest to identity. The axes then do not jump
        when a length changes slightly, and the axes of aligned parts are easy to read.
        """
        # eigh reads one triangle only: the mean with the transpose takes both into account.
        moments, axes = np.linalg.eigh(0.5 * (self.I_com + self.I_com.T))

        def alignment(order: tuple[int, ...]) -> float:
            return np.sum(np.abs(np.diag(axes[:, order])))

        best = list(max(permutations(range(3)), key=alignment))
        moments = moments[best]
        ordered = axes[:, best]
        # An eigenvector has no sign of its own: turned towards its axis of the body, it stays the same from file to
        # file.
        ordered = ordered * np.where(np.diag(ordered) < 0, -1.0, 1.0)
        if np.linalg.det(ordered) < 0:  # right-handed with the smallest change
            ordered[:, np.argmin(np.diag(ordered))] *= -1
        return moments, ordered

    def pseudo(self) -> Array:
        """Return the pseudo-inertia (4, 4) about the origin of the frame: [[Sigma, h], [h^T, m]].

        Sigma (kg m2) contains the second moments of mass, tr(I) / 2 - I about the origin; h (kg m) is the first moment.
        The matrix is positive definite if, and only if, a mass distribution with these values exists.

        Source: P. M. Wensing, S. Kim, J.-J. E. Slotine, Linear matrix inequalities for physically consistent inertial
        parameter identification, IEEE Robotics and Automation Letters 3 (2018) 60-67.
        """
        p = self.p_body_com
        moments_at_com = 0.5 * np.trace(self.I_com) * np.eye(3) - self.I_com
        pseudo = np.zeros((4, 4))
        pseudo[:3, :3] = moments_at_com + self.mass * np.outer(p, p)
        pseudo[:3, 3] = self.mass * p
        pseudo[3, :3] = pseudo[:3, 3]
        pseudo[3, 3] = self.mass
        return pseudo

    def violations(self) -> list[str]:
        """Return the reasons why no rigid body can have this mass and tensor; empty if a rigid body can have them."""
        reasons = []
        if not (np.isfinite(self.mass) and self.mass > 0):
            reasons.append(f"mass {self.mass:g} kg is not positive")
        low, middle, high = np.linalg.eigvalsh(0.5 * (self.I_com + self.I_com.T))
        if low <= 0:
            reasons.append(f"smallest principal moment {low:.3g} kg m2 is not positive")
        if high > (low + middle) * (1 + _ROUNDING):
            reasons.append(
                f"principal moments {low:.3g}, {middle:.3g}, {high:.3g} kg m2 violate the "
                "triangle inequality: no mass distribution has such moments"
            )
        return reasons
