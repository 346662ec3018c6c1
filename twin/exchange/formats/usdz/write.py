"""Write one .usdz for AR Quick Look and other viewers: shape and motion, no physics.

The archive has one flattened .usdc, y up, in metres. The robot's root prim rotates z up to y up; poses of links are
relative to the robot's base frame, as in the tracks and in the GLB. Only links that move have samples. Viewers repeat
the motion; if the last pose differs from the first, the last pose is held for `HOLD` seconds before the motion repeats.
"""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom

from twin.core.atomic import Scratch
from twin.core.findings import Finding
from twin.core.spatial import Array
from twin.exchange.write.clip import rounded
from twin.exchange.write.home_poses import home_poses
from twin.exchange.write.order import Order
from twin.model.mechanism import Mechanism
from twin.usd.write import BakedMotion, write_motion
from twin.usd.write.geometry import write_geometry
from twin.usd.write.layers import TIME_CODES_PER_SECOND, save

if TYPE_CHECKING:
    from twin.exchange.write.clip import Clip

HOLD = 1.0
"""Time in s for which the last pose is held before the motion repeats."""

STILL = 1e-9
"""Maximum change of a link's pose (in m, and in entries of the rotation matrix) for which no samples are written."""

_ALIGNMENT = 64
"""Alignment in bytes of files in the archive (USDZ specification), so that readers can map the files into memory."""

_PADDING = 0x1986
"""Identifier of the zip extra field that pads a header to the alignment, as in usd-core."""


def write_usdz(mechanism: Mechanism, clip: Clip | None, path: Path) -> Path:
    """Write the robot, with a motion or at rest, as one .usdz file, which is reproducible byte by byte.

    The file contains meshes and materials, but no frames, points or joints. Without a clip, the robot is at home.

    Raises:
        StageError: the clip does not match the mechanism, or USD cannot write a layer.
        OSError: the disk is full, or the archive cannot be written.
        AssemblyError: there is no clip, and the loops of the mechanism cannot be closed.
    """
    with Scratch() as name:
        folder = Path(name)
        geometry = str(write_geometry(mechanism, folder / "geometry.usdc", _rest(mechanism, clip)))
        if clip is None:
            flat = _flattened(mechanism, [geometry], 0.0)
        else:
            moving = {}
            end = float(clip.times[-1])
            returns = True
            for link, Ts in rounded(clip.links).items():
                if np.abs(Ts - Ts[0]).max() > STILL:
                    moving[link] = Ts
                    returns = returns and np.abs(Ts[-1] - Ts[0]).max() < STILL
            if not returns:
                end += HOLD
            motion = write_motion(mechanism, folder, BakedMotion(clip.name, clip.times, moving))
            flat = _flattened(mechanism, [str(motion.layer), geometry], end * TIME_CODES_PER_SECOND)
        package(save(flat, folder / f"{mechanism.name}.usdc"), path)
    return path


def _rest(mechanism: Mechanism, clip: Clip | None) -> dict[str, Array]:
    """Return {body: T_world_body (4, 4)} at the start of the motion; if there is no motion, at home."""
    if clip is not None:
        first_poses = {}
        for name, Ts in clip.links.items():
            first_poses[name] = Ts[0]
        return rounded(first_poses)
    return home_poses(mechanism)


def _flattened(mechanism: Mechanism, layers: list[str], end: float) -> Sdf.Layer:
    """Merge `layers` (strongest first) into one layer, rotate it to y up, remove twin's custom data, and return it."""
    stage = Usd.Stage.CreateInMemory()
    # Set the rate before adding sublayers: USD rescales the times of sublayers with a different rate.
    stage.SetTimeCodesPerSecond(TIME_CODES_PER_SECOND)
    stage.GetRootLayer().subLayerPaths = layers
    flat = stage.Flatten(False)
    stage = Usd.Stage.Open(flat)
    root = stage.GetPrimAtPath(f"/{mechanism.name}")
    for prim in list(stage.Traverse()):
        imageable = UsdGeom.Imageable(prim)
        if imageable and imageable.GetPurposeAttr().Get() == UsdGeom.Tokens.guide:
            stage.RemovePrim(prim.GetPath())
            continue
        for attribute in prim.GetAuthoredAttributes():
            if attribute.GetName().startswith("twin:"):
                prim.RemoveProperty(attribute.GetName())
    _single_precision(flat)
    UsdGeom.Xformable(root).AddRotateXOp().Set(-90.0)
    stage.SetDefaultPrim(root)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetTimeCodesPerSecond(TIME_CODES_PER_SECOND)
    stage.SetFramesPerSecond(TIME_CODES_PER_SECOND)
    stage.SetStartTimeCode(0.0)
    stage.SetEndTimeCode(end)
    return flat


def _single_precision(layer: Sdf.Layer) -> None:
    """Convert translations to float3, the precision of viewers.

    The reader of three.js (r187) does not support the packed form in which usdc stores double3 values of small whole
    numbers: a link with translation (0, 0, 0) is not displayed, and no error is reported.
    """
    paths: list[Sdf.Path] = []
    layer.Traverse(Sdf.Path.absoluteRootPath, paths.append)
    for path in paths:
        if path.name != "xformOp:translate":
            continue
        old = layer.GetAttributeAtPath(path)
        if old.typeName != Sdf.ValueTypeNames.Double3:
            continue
        # The values must be read before the attribute is removed; USD cannot change its type.
        default = old.default
        samples = {}
        for code in layer.ListTimeSamplesForPath(path):
            samples[code] = layer.QueryTimeSample(path, code)
        prim = layer.GetPrimAtPath(path.GetPrimPath())
        prim.RemoveProperty(old)
        new = Sdf.AttributeSpec(prim, path.name, Sdf.ValueTypeNames.Float3)
        if default is not None:
            new.default = Gf.Vec3f(default)
        for code, value in samples.items():
            layer.SetTimeSample(path, code, Gf.Vec3f(value))


def package(layer: Path, path: Path) -> None:
    """Pack one layer file into an undated .usdz archive, uncompressed and aligned to 64 bytes as USDZ requires.

    Raises:
        OSError: the archive cannot be written.
    """
    header = zipfile.ZipInfo(layer.name, (1980, 1, 1, 0, 0, 0))
    header.create_system = 3  # Unix, also if the archive is written on Windows
    header.external_attr = 0o644 << 16
    # The data follow a header of 30 bytes, the name, and the extra field, whose own header has 4 bytes.
    padding = -(30 + len(layer.name) + 4) % _ALIGNMENT
    header.extra = _PADDING.to_bytes(2, "little") + padding.to_bytes(2, "little") + bytes(padding)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        archive.writestr(header, layer.read_bytes())


def write(order: Order, folder: Path) -> list[Finding]:
    """Write a file for each quick look of a robot, or one file at rest, into `folder`."""
    name = order.mechanism.name
    clips = {clip.name: clip for clip in order.clips}
    first: Clip | None = None
    if order.quick_looks:
        first = clips[order.quick_looks[0]]
    write_usdz(order.mechanism, first, folder / f"{name}_ar.usdz")
    for clip in order.quick_looks[1:]:
        write_usdz(order.mechanism, clips[clip], folder / f"{name}_{clip}_ar.usdz")
    return []


def files(order: Order) -> list[tuple[str, str]]:
    """Return (file, content) for README.txt."""
    name = order.mechanism.name
    first = "at rest"
    if order.quick_looks:
        first = f"for AR Quick Look, playing {order.quick_looks[0]}"
    rows = [(f"{name}_ar.usdz", first)]
    for clip in order.quick_looks[1:]:
        rows.append((f"{name}_{clip}_ar.usdz", f"the same robot, playing {clip}"))
    return rows
