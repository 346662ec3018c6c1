"""A trajectory as a CSV table for other programs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from twin.core import spatial
from twin.core.units import MM, display_unit
from twin.planning.trajectory import Trajectory


def write_csv(trajectory: Trajectory, path: Path, revolute: Sequence[bool] = ()) -> None:
    """Write one row per sample, with units in the header: joints, their rates, tool position and quaternion.

    Args:
        trajectory: the trajectory.
        path: the file.
        revolute: (n,) whether each joint is an angle in rad; empty: all joints are lengths.
    """
    revolute = revolute or [False] * len(trajectory.joint_names)
    units = []
    factors = []
    for is_angle in revolute:
        unit, factor = display_unit(is_angle)
        units.append(unit)
        factors.append(factor)
    header = ["t_s"]
    columns = [trajectory.t[:, None]]
    for suffix, values in (("", trajectory.q), ("_s", trajectory.qd), ("_s2", trajectory.qdd)):
        for name, unit in zip(trajectory.joint_names, units, strict=True):
            header.append(f"{name}_{unit}{suffix}")
        columns.append(values / np.array(factors))
    Ts = trajectory.Ts_base_tool
    header += ["tool_x_mm", "tool_y_mm", "tool_z_mm", "tool_qw", "tool_qx", "tool_qy", "tool_qz"]
    columns += [Ts[:, :3, 3] / MM, spatial.quat_from_matrix_wxyz(Ts[:, :3, :3])]
    np.savetxt(path, np.hstack(columns), fmt="%.9g", delimiter=",", header=",".join(header), comments="")
