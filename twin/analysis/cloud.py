"""Write a workspace as a point cloud for other programs: PLY (MeshLab, CloudCompare, Blender) and USD."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from twin.analysis.workspace_result import COLUMNS, Workspace
from twin.core.spatial import Array

MOST_POINTS = 400_000
"""Maximum number of points in a cloud; of a larger cloud, only every n-th point is written."""

_TOP_QUANTILE = 0.99
"""Quantile at which the scale of colours ends: a few outliers would leave all other points in one colour."""

_SMALLEST_TOP = 1e-12
"""Smallest end of the scale, so that values of 0 alone are not divided by 0."""

_GAMMA = 2.2
"""Exponent from a share of sRGB to a share of light, which USD expects."""


def points(space: Workspace) -> tuple[Array, np.ndarray, np.ndarray]:
    """Return reached positions (k, 3) in m, their values (k, 4) in the order of `COLUMNS`, and colours (k, 3) uint8.

    The colours show the inverse condition numbers; without condition numbers, they show the joint-limit margins.
    """
    from matplotlib import colormaps

    reached = np.flatnonzero(space.reached)
    every = max(1, math.ceil(len(reached) / MOST_POINTS))
    shown_indices = reached[::every]
    values = space.values[shown_indices]
    conditions = values[:, COLUMNS.index("inverse_condition")]
    margins = values[:, COLUMNS.index("limit_margin")]
    colored = margins
    if conditions.any():
        colored = conditions
    top = 1.0
    if len(colored):
        top = float(np.quantile(colored, _TOP_QUANTILE))
    shares = np.clip(colored / max(top, _SMALLEST_TOP), 0, 1)
    rgba = colormaps["viridis"](shares, bytes=True)
    return space.grid.position(shown_indices), values, np.asarray(rgba)[:, :3]


def write_ply(space: Workspace, path: Path) -> None:
    """Write a binary PLY file; each vertex has x, y, z in m, red, green, blue (0..255), and the values of `COLUMNS`."""
    positions, values, rgb = points(space)
    fields = []
    head = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment workspace of {space.robot}, metres, base frame, z up",
        f"element vertex {len(positions)}",
    ]
    for name in ("x", "y", "z", "red", "green", "blue", *COLUMNS):
        if name in ("red", "green", "blue"):
            fields.append((name, "u1"))
            head.append(f"property uchar {name}")
        else:
            fields.append((name, "<f4"))
            head.append(f"property float {name}")
    head.append("end_header\n")
    table = np.zeros(len(positions), fields)
    columns = np.concatenate([positions, rgb, values], axis=1)
    for k, (name, _) in enumerate(fields):
        table[name] = columns[:, k]
    path.write_bytes("\n".join(head).encode() + table.tobytes())


def write_usd(space: Workspace, path: Path) -> None:
    """Write a USD layer with one Points prim in the robot's base frame, to be referenced next to the robot."""
    from pxr import Sdf, Usd, UsdGeom, Vt

    from twin.usd.write.layers import describe, new_layer, save

    positions, values, rgb = points(space)
    layer = new_layer(path)
    stage = Usd.Stage.Open(layer)
    prim = UsdGeom.Points.Define(stage, "/workspace")
    describe(layer, "workspace")
    p32 = positions.astype(np.float32)
    prim.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(p32))
    prim.CreateWidthsAttr(Vt.FloatArray([float(space.grid.step)]))
    prim.SetWidthsInterpolation(UsdGeom.Tokens.constant)
    if len(p32):
        # The extent contains the points with their widths, or a viewer would cull the outermost ones.
        half = np.array([[-0.5], [0.5]], np.float32) * np.float32(space.grid.step)
        corners = np.stack([p32.min(axis=0), p32.max(axis=0)]) + half
        prim.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(corners))
    color = prim.CreateDisplayColorPrimvar(UsdGeom.Tokens.vertex)
    linear = (rgb / 255.0).astype(np.float32) ** np.float32(_GAMMA)
    color.Set(Vt.Vec3fArray.FromNumpy(linear))
    primvars = UsdGeom.PrimvarsAPI(prim)
    for i, name in enumerate(COLUMNS):
        primvar = primvars.CreatePrimvar(name, Sdf.ValueTypeNames.FloatArray, UsdGeom.Tokens.vertex)
        column = np.ascontiguousarray(values[:, i])
        primvar.Set(Vt.FloatArray.FromNumpy(column))
    save(layer, path)
