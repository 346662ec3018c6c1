"""Create and save layers with common metadata, and give prims unique names."""

from __future__ import annotations

import os
from pathlib import Path

from pxr import Sdf, Tf, Usd, UsdGeom, UsdPhysics

from twin.core.atomic import DISK_FULL
from twin.core.errors import StageError

TIME_CODES_PER_SECOND = 60.0
"""Time codes per second and frames per second of every layer; both are equal, because viewers use either rate."""


def new_layer(path: Path) -> Sdf.Layer:
    """Return a new layer for `path`; .usda is readable text, .usdc is binary.

    Layers are anonymous until `save`, so that writing a file twice in one process does not conflict with the layer that
    USD caches in memory.
    """
    return Sdf.Layer.CreateAnonymous(path.name)


def describe(layer: Sdf.Layer, name: str, end_time_code: float = 0.0) -> None:
    """Set default prim, up axis, units, frame rate and time range of a layer."""
    stage = Usd.Stage.Open(layer)
    layer.defaultPrim = name
    # USD takes axis and units from the root layer of a stage alone; each layer has them, as it may be opened by
    # itself.
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdPhysics.SetStageKilogramsPerUnit(stage, 1.0)
    layer.timeCodesPerSecond = TIME_CODES_PER_SECOND
    layer.framesPerSecond = TIME_CODES_PER_SECOND
    layer.startTimeCode = 0.0
    layer.endTimeCode = end_time_code


def save(layer: Sdf.Layer, path: Path) -> Path:
    """Write a layer to `path` and return the path.

    Raises:
        OSError: the disk is full.
        StageError: USD cannot write the file.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        written = layer.Export(str(path))
    except Tf.ErrorException as error:
        for number in DISK_FULL:  # replaces the message of USD, which has forty lines
            if os.strerror(number) in str(error):
                raise OSError(number, os.strerror(number), str(path)) from None
        raise StageError(f"cannot write {path}: {error}") from error
    if not written:
        raise StageError(f"cannot write {path}")
    return path


def root_layer(path: Path, name: str, sublayers: list[str], end_time_code: float, comment: str) -> Path:
    """Write a root layer that only lists sublayers, strongest first, and return its path."""
    layer = new_layer(path)
    Sdf.CreatePrimInLayer(layer, f"/{name}").specifier = Sdf.SpecifierOver
    describe(layer, name, end_time_code)
    layer.comment = comment
    layer.subLayerPaths = sublayers
    return save(layer, path)


class LeafNames:
    """Generator of unique leaf names for the prims of a robot.

    USD allows equal leaf names below different parents, but Blender renames one of the prims and Unity clips move the
    wrong prim. In a mechanism, a frame, a point, a mesh and a body may have the same name.
    """

    def __init__(self, reserved: set[str]) -> None:
        self._taken = set(reserved)

    def take(self, name: str, suffix: str) -> str:
        """Return `name` if it is not used yet; otherwise append `_<suffix>` and, if necessary, a number."""
        free = name
        if free in self._taken:
            free = f"{name}_{suffix}"
        number = 2
        while free in self._taken:
            free = f"{name}_{suffix}_{number}"
            number += 1
        self._taken.add(free)
        return free
