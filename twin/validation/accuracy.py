"""Simulate the accuracy test of a console: move haptic pens along their axes and measure the tool's displacement.

The error is the tool's displacement minus the pen's displacement, both in {H}, the frame of the hand. This definition
differs from eq. (7) as printed in the console's paper.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from twin.core.json_types import JsonMapping
from twin.core.units import MM
from twin.validation.console import Laws

_REPEATS = 100
"""Number of repetitions of the test, for the long-run standard deviation."""

_REACH, _WAY, _ASIDE = 50 * MM, (20 * MM, 60 * MM), 1 * MM
"""Maximum distance of a start position from 0 along each axis, (minimum, maximum) displacement, and maximum additional
motion along each axis; all in m, and ASSUMED because the paper does not state them."""


def measure(console: Laws, displacements: int, resolution: float, seed: int = 0) -> tuple[JsonMapping, list[float]]:
    """Simulate the accuracy test; return (plain data, standard deviation of the error along each axis in mm).

    `displacements` is the number of displacements along each axis, `resolution` in m is the resolution of the pen's
    position. The motion scale is 1.
    """
    rng = np.random.default_rng(seed)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_rotvec((0.5, -0.4, 0.9)).as_matrix(), (0.1, 0.05, -0.2)
    axis = np.tile(np.repeat(np.eye(3), displacements, axis=0), (_REPEATS, 1))
    start = rng.uniform(-_REACH, _REACH, axis.shape)
    way = axis * rng.choice([-1, 1], (len(axis), 1)) * rng.uniform(*_WAY, (len(axis), 1))
    end = start + way + rng.uniform(-_ASIDE, _ASIDE, axis.shape)
    P = np.eye(4)
    P[:3, 3] = (0, 0, -0.1)

    def errors(step: float) -> np.ndarray:
        """Return the errors (k, 3) in m, in {H}, for a pen with resolution `step` in m (0: exact)."""
        out = np.zeros_like(start)
        for i, (a, b) in enumerate(zip(start, end, strict=True)):
            W_0, W_1 = np.eye(4), np.eye(4)
            W_0[:3, 3], W_1[:3, 3] = (np.round(np.array([a, b]) / step) * step) if step else (a, b)
            moved = console.tool(P, W_0, W_1, T, 1.0)[:3, 3] - P[:3, 3]
            out[i] = T[:3, :3].T @ moved - (b - a)
        return out

    exact, read = errors(0.0), errors(resolution)
    once = read[: 3 * displacements]
    std = read.std(axis=0) / MM
    data = {
        "displacements_per_axis": displacements,
        "resolution_mm": resolution / MM,
        "predicted_std_mm": resolution / MM * np.sqrt(2 / 12),
        "std_mm": std.tolist(),
        "std_once_mm": (once.std(axis=0, ddof=1) / MM).tolist(),
        "rms_3d_mm": float(np.sqrt(np.mean(np.sum(read**2, axis=1)))) / MM,
        "largest_error_mm": float(np.linalg.norm(read, axis=1).max()) / MM,
        "largest_error_unquantised_mm": float(np.linalg.norm(exact, axis=1).max()) / MM,
    }
    return data, std.tolist()
