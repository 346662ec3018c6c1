"""Foreign descriptions turned into a robot folder: `twin new`.

    source     what every reader gives: a mechanism with its findings; XML that names file and element
    shapes     boxes, cylinders, spheres and mesh files as meshes of a body
    urdf       URDF, with loops from a closure YAML beside it
    closures   the closure YAML
    mjcf       MJCF with equality constraints, as MuJoCo compiles it
    sdf        SDF
    folder     the robot folder: description, meshes, templates

All these formats are data: nothing in them is run.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from twin.errors import SourceError
from twin.importing.source import Imported

SUFFIXES = {
    ".urdf": "URDF",
    ".xml": "MJCF",
    ".mjcf": "MJCF",
    ".sdf": "SDF",
    ".usd": "USD",
    ".usda": "USD",
    ".usdc": "USD",
    ".usdz": "USD",
}
"""Format by the end of the file's name."""


def read(path: Path, closures: Path | None = None, root: str | None = None) -> Imported:
    """Return the mechanism of a URDF, MJCF, SDF or USD file in SI units, and what was changed or left out.

    Args:
        path: the file.
        closures: the closure YAML of a URDF; None: the .yaml of the same name beside it, if there is one.
        root: prim path of the robot on a USD stage that holds several.

    Raises:
        SourceError: the file cannot be read, or holds what a mechanism here cannot express; it is named.
        TwinError: a stage that is wrong.
    """
    kind = SUFFIXES.get(path.suffix.lower())
    if kind is None:
        raise SourceError(f"{path}: '{path.suffix}' is not read; use one of {', '.join(SUFFIXES)}")
    if not path.is_file():
        raise SourceError(f"{path}: there is no such file")
    if closures is not None and kind != "URDF":
        raise SourceError(f"{path}: {kind} holds its loops itself; a closure YAML belongs to a URDF")
    if root is not None and kind != "USD":
        raise SourceError(f"{path}: a root prim is chosen on a USD stage only")
    if kind == "URDF":
        from twin.importing.urdf import read_urdf

        beside = path.with_suffix(".yaml")
        return read_urdf(path, closures or (beside if beside.is_file() else None))
    if kind == "MJCF":
        from twin.importing.mjcf import read_mjcf

        return read_mjcf(path)
    if kind == "SDF":
        from twin.importing.sdf import read_sdf

        return read_sdf(path)
    return _read_stage(path, root)


def _read_stage(path: Path, root: str | None) -> Imported:
    """Read a stage; a foreign one has no tool, so it gets one."""
    from twin.importing.source import with_tool
    from twin.stage.read import inspect_stage

    mechanism, findings = inspect_stage(path, root)
    if all(f.name != mechanism.tool for f in mechanism.frames):
        tool, frames = with_tool(mechanism, findings)
        mechanism = replace(mechanism, tool=tool, frames=frames)
    return Imported(mechanism, findings)
