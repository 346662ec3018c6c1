"""Write a workspace as a point cloud for other programs: PLY (MeshLab, CloudCompare, Blender) and USD."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from twin.analysis.workspace import COLUMNS, Workspace
from twin.core.spatial import Array

MOST = 400_000
"""Maximum number of points in a cloud; of a larger cloud, only every n-th point is written."""


def points(found: Workspace) -> tuple[Array, np.ndarray, np.ndarray]:
    """Return reached positions (k, 3) in m, their values (k, 4) in the order of `COLUMNS`, and colours (k, 3) uint8.

    The colours show the inverse condition numbers; without condition numbers, they show the joint-limit margins.
    """
    from matplotlib import colormaps

    at = np.flatnonzero(found.reached)
    at = at[:: max(1, -(-len(at) // MOST))]
    values = found.values[at]
    known = values[:, 1] if values[:, 1].any() else values[:, 2]
    most = float(np.quantile(known, 0.99)) if len(known) else 1.0
    rgba = colormaps["viridis"](np.clip(known / max(most, 1e-12), 0, 1), bytes=True)
    return found.grid.position(at), values, np.asarray(rgba)[:, :3]


def write_ply(found: Workspace, path: Path) -> None:
    """Write a binary PLY file; each vertex has x, y, z in m, red, green, blue (0..255), and the values of `COLUMNS`."""
    p, values, rgb = points(found)
    kinds = [
        *((n, "<f4") for n in "xyz"),
        *((n, "u1") for n in ("red", "green", "blue")),
        *((n, "<f4") for n in COLUMNS),
    ]
    table = np.zeros(len(p), kinds)
    for column, name in zip(np.concatenate([p, rgb, values], axis=1).T, table.dtype.names or (), strict=True):
        table[name] = column
    words = {"f": "float", "u": "uchar"}
    properties = [f"property {words[kind.lstrip('<')[0]]} {name}" for name, kind in kinds]
    head = ["ply", "format binary_little_endian 1.0", f"comment workspace of {found.robot}, metres, base frame, z up"]
    head += [f"element vertex {len(p)}", *properties, "end_header"]
    path.write_bytes(("\n".join(head) + "\n").encode() + table.tobytes())


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
    half = np.array([[-0.5], [0.5]], np.float32) * np.float32(found.grid.step)
    prim.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(np.stack([p32.min(axis=0), p32.max(axis=0)]) + half))
    color = prim.CreateDisplayColorPrimvar(UsdGeom.Tokens.vertex)
    color.Set(Vt.Vec3fArray.FromNumpy((rgb / 255.0).astype(np.float32) ** np.float32(2.2)))  # sRGB to linear
    primvars = UsdGeom.PrimvarsAPI(prim)
    for i, name in enumerate(COLUMNS):
        made = primvars.CreatePrimvar(name, Sdf.ValueTypeNames.FloatArray, UsdGeom.Tokens.vertex)
        made.Set(Vt.FloatArray.FromNumpy(np.ascontiguousarray(values[:, i])))
    save(layer, path)
