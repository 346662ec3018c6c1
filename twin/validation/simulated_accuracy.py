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

# The ranges in m and rad of the random motions are ASSUMED, because the paper does not state them.

_START_RANGE = 50 * MM
"""Largest distance of a start position from 0 along each axis."""

_DISPLACEMENT_RANGE = (20 * MM, 60 * MM)
"""Shortest and longest displacement along an axis."""

_SIDE_MOTION = 1 * MM
"""Largest additional motion along each axis, as of a hand that moves along one axis."""

_START_ANGLE_RANGE = 30 * DEG
"""Largest of each gimbal angle at the start."""

_ROTATION_RANGE = (10 * DEG, 40 * DEG)
"""Smallest and largest rotation about an axis."""

_GIMBAL_ORDER = "ZYX"
"""Order of the gimbal angles, as in the console's paper: the first angle is about z, the last one about x."""


def measure(console: JudgedConsole, displacements: int, resolution: float) -> tuple[JsonMapping, list[float]]:
    """Simulate the accuracy test; return (plain data, standard deviation of the error along each axis in mm).

    `displacements` is the number of displacements along each axis, `resolution` in m is the resolution of the pen's
    position. The motion scale is 1.
    """
    rng = np.random.default_rng(0)
    axes = _axes_of_motions(displacements)
    start = rng.uniform(-_START_RANGE, _START_RANGE, axes.shape)
    signs = rng.choice([-1, 1], (len(axes), 1))
    lengths = rng.uniform(*_DISPLACEMENT_RANGE, (len(axes), 1))
    side_motion = rng.uniform(-_SIDE_MOTION, _SIDE_MOTION, axes.shape)
    end = start + axes * signs * lengths + side_motion
    errors = _displacement_errors(console, start, end, resolution)
    exact_errors = _displacement_errors(console, start, end, 0.0)
    # one repetition, as a paper measures it: its deviation scatters about the long-run one
    first_test = errors[: 3 * displacements]
    std = errors.std(axis=0) / MM
    squared_lengths = np.sum(errors**2, axis=1)
    # the difference of two rounded positions, each with the variance resolution^2 / 12
    predicted_std_mm = resolution / MM * np.sqrt(2 / 12)
    data = {
        "displacements_per_axis": displacements,
        "resolution_mm": resolution / MM,
        "predicted_std_mm": predicted_std_mm,
        "std_mm": std.tolist(),
        "std_once_mm": (first_test.std(axis=0, ddof=1) / MM).tolist(),
        "rms_3d_mm": float(np.sqrt(squared_lengths.mean())) / MM,
        "largest_error_mm": _longest(errors) / MM,
        "largest_error_unquantised_mm": _longest(exact_errors) / MM,
    }
    return data, std.tolist()


def measure_angles(console: JudgedConsole, rotations: int, resolution: float) -> tuple[JsonMapping, list[float]]:
    """Simulate the test with rotations; return (plain data, standard deviation of the error about x, y, z in degrees).

    The pen hangs in a gimbal of three angles, read with a resolution. The error is the tool's rotation without the
    pen's, both in {H}, as angles in `_GIMBAL_ORDER`. `rotations` is the number of rotations about each axis,
    `resolution` in rad is the resolution of each gimbal angle.
    """
    rng = np.random.default_rng(0)
    axes = _axes_of_motions(rotations)
    start = rng.uniform(-_START_ANGLE_RANGE, _START_ANGLE_RANGE, axes.shape)
    signs = rng.choice([-1, 1], (len(axes), 1))
    angles = rng.uniform(*_ROTATION_RANGE, (len(axes), 1))
    turns = Rotation.from_rotvec(axes * signs * angles)
    end = (turns * _gimbal_rotation(start)).as_euler(_GIMBAL_ORDER)
    errors = _rotation_errors(console, start, end, resolution) / DEG
    exact_errors = _rotation_errors(console, start, end, 0.0) / DEG
    std = errors.std(axis=0)
    first_test = errors[: 3 * rotations]  # one repetition, as a paper measures it
    data = {
        "rotations_per_axis": rotations,
        "resolution_deg": resolution / DEG,
        "std_deg": std.tolist(),
        "std_once_deg": first_test.std(axis=0, ddof=1).tolist(),
        "largest_error_deg": float(np.abs(errors).max()),
        "largest_error_unquantised_deg": float(np.abs(exact_errors).max()),
    }
    return data, std.tolist()


def _axes_of_motions(motions: int) -> Array:
    """Return the axis (k, 3) of each motion: x for `motions` of them, then y and z, and all that `_REPEATS` times."""
    one_test = np.repeat(np.eye(3), motions, axis=0)
    return np.tile(one_test, (_REPEATS, 1))


def _longest(errors: Array) -> float:
    """Return the length in m of the longest of the errors (k, 3) in m."""
    return float(np.linalg.norm(errors, axis=1).max())


def _gimbal_rotation(angles: Array) -> Rotation:
    """Return the rotations of the pen in {H} for gimbal angles (..., 3) in rad."""
    return Rotation.from_euler(_GIMBAL_ORDER, angles)


def _rotation_errors(console: JudgedConsole, start: Array, end: Array, resolution: float) -> Array:
    """Return the errors (k, 3) in rad about x, y, z of rotations from gimbal angles `start` to `end` (k, 3) in rad.

    `resolution` in rad is that of each gimbal angle; 0: exact.
    """
    T = _console_pose()
    R_T = Rotation.from_matrix(T[:3, :3])
    errors = np.zeros_like(start)
    for i, (start_angles, end_angles) in enumerate(zip(start, end, strict=True)):
        pen_rotation = _gimbal_rotation(end_angles) * _gimbal_rotation(start_angles).inv()
        W_0 = np.eye(4)
        W_1 = np.eye(4)
        W_0[:3, :3] = _gimbal_rotation(_quantised(start_angles, resolution)).as_matrix()
        W_1[:3, :3] = _gimbal_rotation(_quantised(end_angles, resolution)).as_matrix()
        P_1 = console.tool(np.eye(4), W_0, W_1, T, 1.0)
        # the tool turns in {RB}, the pen in {H}
        tool_rotation = R_T.inv() * Rotation.from_matrix(P_1[:3, :3]) * R_T
        error_zyx = (tool_rotation * pen_rotation.inv()).as_euler(_GIMBAL_ORDER)
        errors[i] = error_zyx[::-1]  # about x, y, z
    return errors


def _console_pose() -> Array:
    """Return the pose T (4, 4) of {H} in {RB} of the simulated test; any pose gives the same errors."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec((0.5, -0.4, 0.9)).as_matrix()
    T[:3, 3] = (0.1, 0.05, -0.2)
    return T


def _displacement_errors(console: JudgedConsole, start: Array, end: Array, resolution: float) -> Array:
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


def _quantised(values: Array, resolution: float) -> Array:
    """Return values rounded to multiples of a resolution in their unit; unchanged if it is 0."""
    if not resolution:
        return values
    return np.round(values / resolution) * resolution
