"""Write meshes/<mesh>.obj, the mesh files to which both MJCF and URDF refer.

Coordinates are in mm, which keeps the numbers short. MJCF and URDF scale the coordinates by `SCALE`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from twin.core.units import MM
from twin.model.body import Mesh
from twin.model.mechanism import Mechanism

SCALE = "0.001 0.001 0.001"
"""Scale factors x, y, z from millimetres in the files to metres."""

DECIMALS = 3
"""Number of decimals of coordinates in mm: rounding error at most 0.5 um."""


def mesh_file(mesh: Mesh) -> str:
    """Return the path of a mesh file relative to the folder of the robot's file."""
    return f"meshes/{mesh.name}.obj"


def write_meshes(mechanism: Mechanism, folder: Path) -> list[Path]:
    """Write every mesh of the mechanism below `folder`, in the frame of its body, and return the paths of the files."""
    (folder / "meshes").mkdir(parents=True, exist_ok=True)
    paths = []
    for body in mechanism.bodies:
        for mesh in body.meshes:
            path = folder / mesh_file(mesh)
            path.write_text(_obj(mesh), "ascii", newline="\n")  # the same bytes on Windows
            paths.append(path)
    return paths


def _obj(mesh: Mesh) -> str:
    """Return a mesh as the text of an OBJ file."""
    # Adding 0.0 removes negative zeros.
    vertices = np.round(np.asarray(mesh.vertices, float) / MM, DECIMALS) + 0.0
    lines = [f"# {mesh.name}, in mm"]
    for x, y, z in vertices.tolist():
        lines.append(f"v {_coordinate_text(x)} {_coordinate_text(y)} {_coordinate_text(z)}")
    indices = np.asarray(mesh.triangles) + 1  # OBJ counts from 1
    for a, b, c in indices.tolist():
        lines.append(f"f {a} {b} {c}")
    return "\n".join(lines) + "\n"


def _coordinate_text(value: float) -> str:
    """Return a number with `DECIMALS` decimals, without zeros at the end."""
    return f"{value:.{DECIMALS}f}".rstrip("0").rstrip(".")
