"""meshes/<mesh>.obj: the shapes that MJCF and URDF share. In mm: short numbers; both files scale by `SCALE`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from twin.core.units import MM
from twin.model.mechanism import Mechanism, Mesh

SCALE = "0.001 0.001 0.001"
"""From the millimetres of the files to metres."""

DECIMALS = 3
"""Of a millimetre: vertices are within 0.5 um of the mechanism's."""


def mesh_file(mesh: Mesh) -> str:
    """Return the path of a mesh below the folder that holds the robot's file."""
    return f"meshes/{mesh.name}.obj"


def write_meshes(mechanism: Mechanism, folder: Path) -> list[Path]:
    """Write every mesh of the mechanism below `folder`, in the frame of its body; return the files."""
    (folder / "meshes").mkdir(parents=True, exist_ok=True)
    out = []
    for body in mechanism.bodies:
        for mesh in body.meshes:
            path = folder / mesh_file(mesh)
            path.write_text(_obj(mesh), "ascii", newline="\n")
            out.append(path)
    return out


def _obj(mesh: Mesh) -> str:
    vertices = np.round(np.asarray(mesh.vertices, float) / MM, DECIMALS) + 0.0
    lines = [f"# {mesh.name}, in mm"]
    lines += ["v " + " ".join(f"{c:.{DECIMALS}f}".rstrip("0").rstrip(".") for c in row) for row in vertices.tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (np.asarray(mesh.triangles) + 1).tolist()]
    return "\n".join(lines) + "\n"
