"""A grid of tool positions, with the same orientations at each of them; poses are computed from their indices."""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np

from twin.analysis import measure
from twin.core.spatial import Array
from twin.formula import symbolic


@dataclass(frozen=True)
class PoseGrid:
    """Positions and orientations to evaluate.

    Attributes:
        low: (3,) first position in m, in base.
        step: distance between positions in m.
        shape: number of positions (nx, ny, nz).
        R_base_tool: (3, 3) the central orientation.
        tilt: maximum rotation about each axis of base in rad.
        turns: number of orientations at each position; the first is the central orientation.
    """

    low: Array
    step: float
    shape: tuple[int, int, int]
    R_base_tool: Array
    tilt: float = 0.0
    turns: int = 1

    @property
    def positions(self) -> int:
        """Number of positions."""
        return math.prod(self.shape)  # without overflow

    @property
    def poses(self) -> int:
        """Number of poses: positions times orientations."""
        return self.positions * self.turns

    @property
    def axes(self) -> tuple[int, ...]:
        """Axes (0, 1, 2 for x, y, z) along which there are several positions."""
        return tuple(axis for axis in range(3) if self.shape[axis] > 1)

    def position(self, number: np.ndarray) -> Array:
        """Return the positions (k, 3) in m with indices (k,); x varies fastest."""
        nx, ny, _ = self.shape
        index = np.stack([number % nx, number // nx % ny, number // (nx * ny)], axis=1)
        return self.low + self.step * index

    def pose(self, i: ca.SX) -> ca.SX:
        """Return the pose (4, 4) with index i; the orientations at one position have consecutive indices."""
        nx, ny, _ = self.shape
        # indices are float64: half of a step keeps a rounded quotient from falling below its whole number
        place = ca.floor((i + 0.5) / self.turns)
        row = ca.floor((place + 0.5) / nx)
        layer = ca.floor((row + 0.5) / ny)
        index = (place - nx * row, row - ny * layer, layer)
        position = []
        for low, axis_index in zip(self.low, index, strict=True):
            position.append(float(low) + self.step * axis_index)
        R = ca.SX(self.R_base_tool)
        if self.turns > 1 and self.tilt:
            turn = i - self.turns * place
            rotation_vector = []
            for power in (1, 2, 3):
                part = turn / measure.ROOT**power
                # The fractional part is shifted by a half: the first orientation, with part 0, is not rotated.
                rotation_vector.append(2 * self.tilt * (part + 0.5 - ca.floor(part + 0.5) - 0.5))
            R = symbolic.exp_so3(ca.vertcat(*rotation_vector)) @ R
        upper = ca.horzcat(R, ca.vertcat(*position))
        return ca.vertcat(upper, ca.SX([[0, 0, 0, 1]]))
