"""Simulate the accuracy test of a console: move haptic pens along their axes and measure the tool's displacement.

The error is the tool's displacement minus the pen's displacement, both in {H}, the frame of the hand. This definition
differs from eq. (7) as printed in the console's paper.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from twin.core.json_types import JsonMapping
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.validation.console_clauses import JudgedConsole

_REPEATS = 100
"""Number of repetitions of the test, for the long-run standard deviation."""

# in m, and ASSUMED because the paper does not state them
_REACH = 50 * MM  # maximum distance of a start position from 0 along each axis
_SHORTEST = 20 * MM  # displacement
_LONGEST = 60 * MM  # displacement
_ASIDE = 1 * MM  # maximum additional motion along each axis
_TILT = 30 * DEG  # maximum of each gimbal angle at the start
_SMALLEST = 10 * DEG  # rotation
_LARGEST = 40 * DEG  # rotation


def measure(console: JudgedConsole, displacements: int, resolution: float) -> tuple[JsonMapping, list[float]]:
    """Simulate the accuracy test; return (plain data, standard deviation of the error along each axis in mm).

    `displacements` is the number of displacements along each axis, `resolution` in m is the resolution of the pen's
    position. The motion scale is 1.
    """
    rng = np.random.default_rng(0)
    axis = np.tile(np.repeat(np.eye(3), displacements, axis=0), (_REPEATS, 1))
    start = rng.uniform(-_REACH, _REACH, axis.shape)
    signs = rng.choice([-1, 1], (len(axis), 1))
    lengths = rng.uniform(_SHORTEST, _LONGEST, (len(axis), 1))
    end = start + axis * signs * lengths + rng.uniform(-_ASIDE, _ASIDE, axis.shape)
    errors = _errors(console, start, end, resolution)
    exact_errors = _errors(console, start, end, 0.0)
    # one repetition, as a paper measures it: its deviation scatters about the long-run one
    first_test = errors[: 3 * displacements]
    std = errors.std(axis=0) / MM
    data = {
        "displacements_per_axis": displacements,
        "resolution_mm": resolution / MM,
        # the difference of two rounded positions, each with the variance resolution^2 / 12
        "predicted_std_mm": resolution / MM * np.sqrt(2 / 12),
        "std_mm": std.tolist(),
        "std_once_mm": (first_test.std(axis=0, ddof=1) / MM).tolist(),
        "rms_3d_mm": float(np.sqrt(np.mean(np.sum(errors**2, axis=1)))) / MM,
        "largest_error_mm": float(np.linalg.norm(errors, axis=1).max()) / MM,
        "largest_error_unquantised_mm": float(np.linalg.norm(exact_errors, axis=1).max()) / MM,
    }
    return data, std.tolist()


def measure_angles(console: JudgedConsole, rotations: int, resolution: float) -> tuple[JsonMapping, list[float]]:
    """Simulate the test with rotations; return (plain data, standard deviation of the error about x, y, z in degrees).

    The pen hangs in a gimbal of three angles, read with a resolution. The error is the tool's rotation without the
    pen's, both in {H}, as ZYX Euler angles, as in the console's paper. `rotations` is the number of rotations about
    each axis, `resolution` in rad is the resolution of each gimbal angle.
    """
    rng = np.random.default_rng(0)
    axis = np.tile(np.repeat(np.eye(3), rotations, axis=0), (_REPEATS, 1))
    start = rng.uniform(-_TILT, _TILT, axis.shape)
    signs = rng.choice([-1, 1], (len(axis), 1))
    turns = axis * signs * rng.uniform(_SMALLEST, _LARGEST, (len(axis), 1))
    end = (Rotation.from_rotvec(turns) * Rotation.from_euler("ZYX", start)).as_euler("ZYX")
    errors = _turn_errors(console, start, end, resolution) / DEG
    exact_errors = _turn_errors(console, start, end, 0.0) / DEG
    std = errors.std(axis=0)
    data = {
        "rotations_per_axis": rotations,
        "resolution_deg": resolution / DEG,
        "std_deg": std.tolist(),
        "std_once_deg": errors[: 3 * rotations].std(axis=0, ddof=1).tolist(),
        "largest_error_deg": float(np.abs(errors).max()),
        "largest_error_unquantised_deg": float(np.abs(exact_errors).max()),
    }
    return data, std.tolist()


def _turn_errors(console: JudgedConsole, start: Array, end: Array, resolution: float) -> Array:
    """Return the errors (k, 3) about x, y, z of rotations from gimbal angles `start` to `end` (k, 3), all in rad."""
    T = _console_pose()
    R_T = Rotation.from_matrix(T[:3, :3])
    errors = np.zeros_like(start)
    for i, (start_angles, end_angles) in enumerate(zip(start, end, strict=True)):
        turned = Rotation.from_euler("ZYX", end_angles) * Rotation.from_euler("ZYX", start_angles).inv()
        W_0 = np.eye(4)
        W_1 = np.eye(4)
        W_0[:3, :3] = Rotation.from_euler("ZYX", _quantised(start_angles, resolution)).as_matrix()
        W_1[:3, :3] = Rotation.from_euler("ZYX", _quantised(end_angles, resolution)).as_matrix()
        P_1 = console.tool(np.eye(4), W_0, W_1, T, 1.0)
        of_tool = R_T.inv() * Rotation.from_matrix(P_1[:3, :3]) * R_T
        # ZYX angles are about z, y, x; the errors are about x, y, z
        errors[i] = (of_tool * turned.inv()).as_euler("ZYX")[::-1]
    return errors


def _console_pose() -> Array:
    """Return the pose T (4, 4) of {H} in {RB} of the simulated test; any pose gives the same errors."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec((0.5, -0.4, 0.9)).as_matrix()
    T[:3, 3] = (0.1, 0.05, -0.2)
    return T


def _errors(console: JudgedConsole, start: Array, end: Array, resolution: float) -> Array:
    """Return the errors (k, 3) in m, in {H}, of displacements from `start` to `end` (k, 3) in m in {H}.

    `resolution` in m is that of the pen; 0: exact.
    """
    T = _console_pose()
    P = np.eye(4)
    P[:3, 3] = (0, 0, -0.1)
    errors = np.zeros_like(start)
    for i, (p_start, p_end) in enumerate(zip(start, end, strict=True)):
        W_0 = np.eye(4)
        W_1 = np.eye(4)
        W_0[:3, 3] = _quantised(p_start, resolution)
        W_1[:3, 3] = _quantised(p_end, resolution)
        displacement = console.tool(P, W_0, W_1, T, 1.0)[:3, 3] - P[:3, 3]
        # the tool moves in {RB}, the pen in {H}
        errors[i] = T[:3, :3].T @ displacement - (p_end - p_start)
    return errors


def _quantised(p: Array, resolution: float) -> Array:
    if not resolution:
        return p
    return np.round(p / resolution) * resolution
