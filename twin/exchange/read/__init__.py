"""Foreign descriptions turned into a robot folder: `twin new`.

    source     what every reader gives: a mechanism with its findings
    xml        XML that names file and element when it is wrong
    shapes     boxes, cylinders, spheres and mesh files as meshes of a body
    urdf       URDF, with loops from a closure YAML beside it (closures)
    mjcf       MJCF with equality constraints, as MuJoCo compiles it; mjcf_robots: one of several
    sdf        SDF; sdf_world: one model of several, includes and nested models written out
    usd        UsdPhysics stages
    closing    the loops closed, and what stays open
    step       a STEP assembly as a skeleton: bodies, fitting faces (pairs), proposed joints (proposals)
    folder     the robot folder: description, meshes, notes; templates of formula and protocol

All these formats are data: nothing in them is run.
"""

from __future__ import annotations

from pathlib import Path

from twin.core.errors import SourceError
from twin.exchange.read.source import Imported

SUFFIXES = {
    ".urdf": "URDF",
    ".xml": "MJCF",
    ".mjcf": "MJCF",
    ".sdf": "SDF",
    ".usd": "USD",
    ".usda": "USD",
    ".usdc": "USD",
    ".usdz": "USD",
    ".step": "STEP",
    ".stp": "STEP",
}
"""Format by the end of the file's name."""


def kind_of(path: Path) -> str:
    """Return the format of a file that is there.

    Raises:
        SourceError: there is no such file, or its name ends in nothing that is read.
    """
    kind = SUFFIXES.get(path.suffix.lower())
    if kind is None:
        raise SourceError(f"{path}: '{path.suffix}' is not read; use one of {', '.join(SUFFIXES)}")
    if not path.is_file():
        raise SourceError(f"{path}: there is no such file")
    return kind


def read(path: Path, closures: Path | None = None, root: str | None = None, guarded: bool = True) -> Imported:
    """Return the mechanism of a URDF, MJCF, SDF or USD file in SI units, and what was changed or left out.

    Args:
        path: the file.
        closures: the closure YAML of a URDF; None: the .yaml of the same name beside it, if there is one.
        root: which robot of several: its prim path (USD), model (SDF) or a body of it (MJCF).
        guarded: let the native parsers of MJCF and USD try the file in a process of their own first, so that one that
            crashes or hangs is an error. It takes about half a second.

    Raises:
        SourceError: the file cannot be read, or holds what a mechanism here cannot express; it is named.
        TwinError: a stage that is wrong.
    """
    kind = kind_of(path)
    if closures is not None and kind != "URDF":
        raise SourceError(f"{path}: {kind} holds its loops itself; a closure YAML belongs to a URDF")
    if root is not None and kind not in ("USD", "SDF", "MJCF"):
        raise SourceError(f"{path}: a {kind} holds one robot: there is no root to choose")
    if kind == "STEP":
        raise SourceError(f"{path}: a STEP has no joints: it becomes a skeleton (twin new), not a mechanism")
    if kind == "URDF":
        from twin.exchange.read.urdf import read_urdf

        beside = path.with_suffix(".yaml")
        return read_urdf(path, closures or (beside if beside.is_file() else None))
    if kind == "SDF":
        from twin.exchange.read.sdf import read_sdf

        return read_sdf(path, root)
    if kind == "MJCF":
        from twin.exchange.read.mjcf import refuse_nan

        refuse_nan(path)
    if guarded:
        from twin.core.foreign.admit import admit

        admit(path)
    if kind == "MJCF":
        from twin.exchange.read.mjcf import read_mjcf

        return read_mjcf(path, root)
    from twin.exchange.read.usd import read_usd

    return read_usd(path, root)
