"""Convert a URDF, MJCF, SDF, USD or STEP file to a robot folder, for `twin new`.

    imported_robot    the common result of all readers: a mechanism with findings
    xml_file          XML with errors that name file and element
    shapes            boxes, cylinders, spheres and mesh files as meshes of a body
    start_values      the joint values at which the robot starts, within the joint limits
    loop_closing      find a pose in which the loops close; report remaining gaps
    assumed_drives    drives for driven joints for which the file states no gains
    fitting_faces     fitting faces of the solids of a STEP assembly; proposals: joints that these faces propose
    robot_folder      write the robot folder with description_text, mesh_output, and initial files (templates)
    pose_table        tables of measured poses, which `twin validate` compares with a robot

The readers are the modules `read` in twin.exchange.formats. Files of all formats are only read; no code in them is run.
"""

from __future__ import annotations

from pathlib import Path

from twin.core.errors import SourceError
from twin.exchange.format import Format
from twin.exchange.formats import import_formats
from twin.exchange.read.imported_robot import DhOptions, Imported, Options
from twin.exchange.xacro import XacroSettings


def suffixes() -> dict[str, Format]:
    """Return the formats that can be read, by file name suffix."""
    formats_by_suffix: dict[str, Format] = {}
    for format in import_formats():
        for suffix in format.sources:
            formats_by_suffix[suffix] = format
    return formats_by_suffix


def format_of(path: Path) -> Format:
    """Return the format of an existing file.

    Raises:
        SourceError: the file does not exist, or its suffix is not supported.
    """
    formats_by_suffix = suffixes()
    format = formats_by_suffix.get(path.suffix.lower())
    if format is None:
        raise SourceError(f"{path}: suffix '{path.suffix}' is not supported; use one of {', '.join(formats_by_suffix)}")
    if not path.is_file():
        raise SourceError(f"{path}: the file does not exist")
    return format


def read(
    path: Path,
    closures: Path | None = None,
    root: str | None = None,
    guarded: bool = True,
    xacro: XacroSettings | None = None,
    dh: DhOptions | None = None,
) -> Imported:
    """Return the mechanism of a URDF, MJCF, SDF or USD file in SI units, and findings on changed or omitted data.

    Args:
        path: the file.
        closures: path of the closure YAML of a URDF. None: <name>.yaml in the folder of <name>.urdf, if it exists.
        root: selects one of several robots by prim path (USD), model name (SDF) or name of a body of the robot (MJCF).
        guarded: first parse an MJCF or USD file in a separate process, so that a crash or hang of the native parser
            becomes an error. This takes about half a second.
        xacro: arguments and package folders for a xacro.
        dh: convention and units of a table of Denavit-Hartenberg parameters.

    Raises:
        SourceError: the file cannot be read, or its content cannot be expressed as a mechanism.
        TwinError: the stage is invalid.
    """
    format = format_of(path)
    if closures is not None and "closures" not in format.takes:
        raise SourceError(f"{path}: a {format.title} file states its own loops; a closure YAML is for URDF only")
    if root is not None and "root" not in format.takes:
        raise SourceError(f"{path}: a {format.title} file contains one robot: --root does not apply")
    if xacro is not None and xacro.given and "xacro" not in format.takes:
        raise SourceError(f"{path}: --arg and --packages are for a xacro, and this is a {format.title} file: omit them")
    if dh is not None and dh != DhOptions() and "table" not in format.takes:
        raise SourceError(f"{path}: --dh and the units are for a table of Denavit-Hartenberg parameters: omit them")
    options = Options(closures, root, guarded, xacro or XacroSettings(), dh or DhOptions())
    # Imported only here: the parsers of other formats (pxr, MuJoCo, CAD) take seconds to load.
    return format.module("read").read(path, options)
