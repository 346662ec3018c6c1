"""Write the meshes of a robot folder: each an OBJ, or a binary STL if the OBJ could be too large to be read back."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from twin.core.foreign.budget import BUDGETS, over
from twin.core.spatial import Array
from twin.model.body import Mesh

_MAX_OBJ_BYTES = (50, 30)
"""Maximum bytes of a row of an OBJ for a vertex, and for a triangle."""

_STL_BYTES = (84, 50)
"""Bytes of the head of a binary STL, and of each of its triangles."""


def mesh_file(mesh: Mesh) -> str:
    """Return the name of the file of a mesh: an OBJ, or a binary STL if the OBJ could be too large to be read back."""
    vertex, triangle = _MAX_OBJ_BYTES
    size = vertex * len(mesh.vertices) + triangle * len(mesh.triangles)
    if size <= BUDGETS["OBJ"].bytes:
        return f"{mesh.name}.obj"
    return f"{mesh.name}.stl"


def write_mesh(path: Path, mesh: Mesh, T: Array) -> None:
    """Write a mesh whose body has the pose T (4, 4), in the frame of the base.

    Raises:
        BudgetError: the file would be too large to be read back.
    """
    points = mesh.vertices @ T[:3, :3].T + T[:3, 3]
    if path.suffix == ".stl":
        head, triangle = _STL_BYTES
        size = head + triangle * len(mesh.triangles)
        if size > BUDGETS["STL"].bytes:
            over(Path(path.name), "STL", "bytes", size, BUDGETS["STL"].bytes)
        solid = np.zeros(len(mesh.triangles), np.dtype([("numbers", "<f4", (4, 3)), ("rest", "<u2")]))
        solid["numbers"][:, 1:] = points[mesh.triangles]  # the first row, the normal, is computed by readers
        # A binary STL has 80 bytes of any text, the number of triangles, and the triangles.
        path.write_bytes(bytes(80) + len(solid).to_bytes(4, "little") + solid.tobytes())
        return
    lines = []
    for x, y, z in points.tolist():
        lines.append(f"v {x:.9g} {y:.9g} {z:.9g}")
    for a, b, c in (mesh.triangles + 1).tolist():  # an OBJ counts vertices from 1
        lines.append(f"f {a} {b} {c}")
    path.write_text("\n".join(lines) + "\n", "ascii")
