"""Read and check the mesh files that a URDF or an MJCF names, and place their shapes in their links."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from twin.exchange.audit.file_content import LinkShape
from twin.exchange.audit.ledger import Ledger, ReadError
from twin.exchange.audit.meshes import check_mesh
from twin.exchange.audit.obj_file import read_obj
from twin.exchange.audit.poses import Array
from twin.exchange.xacro import SUFFIX


def named_mesh(
    path: Path, name: str, scale: Array, checked: dict[str, tuple[Array, Array] | None], ledger: Ledger, code: str
) -> tuple[Array, Array] | None:
    """Return (points (n, 3) in m, triangles (m, 3)) of a mesh file; None if the file cannot be read.

    A mesh file that several links use is read and checked once.

    `name` is the path of the mesh file relative to the robot's file `path`. `scale` (3,) converts the mesh's units to
    m. `checked` stores the meshes already read. `code` is the first part of the codes of the findings.
    """
    key = f"{name} {scale.tolist()}"
    if key in checked:
        return checked[key]
    checked[key] = None  # a file with a fault is reported once
    file = mesh_path(path, name)
    if file is None:
        ledger.wrong(f"{code}.mesh", f"mesh file '{name}' does not exist.", name)
        return None
    if file.suffix.lower() != ".obj":
        ledger.add(f"{code}.mesh", "info", f"mesh '{name}' is not an .obj file and is not read.", name)
        return None
    try:
        vertices, triangles = read_obj(file)
    except ReadError as error:
        ledger.wrong(f"{code}.mesh", f"mesh {error}.", name)
        return None
    vertices = vertices * scale
    if float(np.prod(scale)) < 0:
        ledger.wrong(f"{code}.mirrored", f"mesh '{name}' is mirrored by a negative scale.", name)
    check_mesh(ledger, name, vertices, triangles, None, code)
    checked[key] = (vertices, triangles)
    return checked[key]


def placed_shape(mesh: tuple[Array, Array], T: Array, code: str) -> LinkShape | None:
    """Return the shape of a mesh (points, triangles) at the pose T (4, 4) in its link; None if it has none.

    `named_mesh` has already reported the faults of the mesh.
    """
    points, triangles = mesh
    return check_mesh(Ledger(""), "", points @ T[:3, :3].T + T[:3, 3], triangles, None, code)


def mesh_path(path: Path, name: str) -> Path | None:
    """Return the mesh file `name` of the robot's file `path`; None if it does not exist, or is not below its folder."""
    folder = path.resolve().parent
    file = (folder / name.removeprefix("package://").removeprefix("file://")).resolve()
    # the expansion of a xacro replaces the package of a mesh by its folder, which is not below the file
    of_package = path.suffix == SUFFIX and name.startswith("file:///")
    if not name or not (of_package or file.is_relative_to(folder)) or not file.is_file():
        return None
    return file
