"""Write a workspace as a point cloud for other programs: PLY (MeshLab, CloudCompare, Blender) and USD."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from twin.analysis.workspace_result import COLUMNS, Workspace
from twin.core.spatial import Array

MOST = 400_000
"""Maximum number of points in a cloud; of a larger cloud, only every n-th point is written."""


def points(found: Workspace) -> tuple[Array, np.ndarray, np.ndarray]:
    """Return reached positions (k, 3) in m, their values (k, 4) in the order of `COLUMNS`, and colours (k, 3) uint8.

    The colours show the inverse condition numbers; without condition numbers, they show the joint-limit margins.
    """
    from matplotlib import colormaps

    reached = np.flatnonzero(found.reached)
    every = max(1, math.ceil(len(reached) / MOST))
    shown = reached[::every]
    values = found.values[shown]
    conditions = values[:, 1]
    colored = conditions if conditions.any() else values[:, 2]
    # The scale ends at the 99th percentile: a few outliers would leave all other points in one colour.
    top = float(np.quantile(colored, 0.99)) if len(colored) else 1.0
    rgba = colormaps["viridis"](np.clip(colored / max(top, 1e-12), 0, 1), bytes=True)
    return found.grid.position(shown), values, np.asarray(rgba)[:, :3]


def write_ply(found: Workspace, path: Path) -> None:
    """Write a binary PLY file; each vertex has x, y, z in m, red, green, blue (0..255), and the values of `COLUMNS`."""
    p, values, rgb = points(found)
    fields = []
    head = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment workspace of {found.robot}, metres, base frame, z up",
        f"element vertex {len(p)}",
    ]
    for name in ("x", "y", "z", "red", "green", "blue", *COLUMNS):
        is_color = name in ("red", "green", "blue")
        fields.append((name, "u1" if is_color else "<f4"))
        head.append(f"property {'uchar' if is_color else 'float'} {name}")
    head.append("end_header\n")
    table = np.zeros(len(p), fields)
    columns = np.concatenate([p, rgb, values], axis=1)
    for k, (name, _) in enumerate(fields):
        table[name] = columns[:, k]
    path.write_bytes("\n".join(head).encode() + table.tobytes())


def write_usd(found: Workspace, path: Path) -> None:
    """Write a USD layer with one Points prim in the robot's base frame, to be referenced next to the robot."""
    from pxr import Sdf, Usd, UsdGeom, Vt

    from twin.usd.write.layers import describe, new_layer, save

    p, values, rgb = points(found)
    layer = new_layer(path)
    stage = Usd.Stage.Open(layer)
    prim = UsdGeom.Points.Define(stage, "/workspace")
    describe(layer, "workspace")
    p32 = p.astype(np.float32)
    prim.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(p32))
    prim.CreateWidthsAttr(Vt.FloatArray([float(found.grid.step)]))
    prim.SetWidthsInterpolation(UsdGeom.Tokens.constant)
    # The extent contains the points with their widths.
    half = np.array([[-0.5], [0.5]], np.float32) * np.float32(found.grid.step)
    corners = np.stack([p32.min(axis=0), p32.max(axis=0)]) + half
    prim.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(corners))
    color = prim.CreateDisplayColorPrimvar(UsdGeom.Tokens.vertex)
    linear = (rgb / 255.0).astype(np.float32) ** np.float32(2.2)  # from sRGB
    color.Set(Vt.Vec3fArray.FromNumpy(linear))
    primvars = UsdGeom.PrimvarsAPI(prim)
    for i, name in enumerate(COLUMNS):
        primvar = primvars.CreatePrimvar(name, Sdf.ValueTypeNames.FloatArray, UsdGeom.Tokens.vertex)
        column = np.ascontiguousarray(values[:, i])
        primvar.Set(Vt.FloatArray.FromNumpy(column))
    save(layer, path)
