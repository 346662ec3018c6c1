"""Triangle meshes: read files with a declared unit, find open surfaces, and compute mass properties.

Most mesh files do not state a unit, so the description must declare the unit; for 3MF, the stated and the declared unit
must be equal. A Collada file is read in the unit that it states. A part with an implausible size is reported as a
finding.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from twin.cad.collada import TO_Z_UP, read_collada
from twin.cad.threemf import UNITS, read_3mf
from twin.core.errors import BudgetError, CadError
from twin.core.findings import Finding, warning
from twin.core.foreign.admit import admit
from twin.core.foreign.budget import GLTF_SUFFIXES
from twin.core.quantity import Quantity
from twin.core.spatial import Array
from twin.core.units import LENGTH, MM
from twin.model.body import Mesh
from twin.model.inertia import Inertia

SUFFIXES = (".stl", ".obj", *GLTF_SUFFIXES, ".3mf", ".ply", ".dae")
"""Suffixes of the mesh files that are read."""

_PLAUSIBLE_SIZES = (0.5 * MM, 20.0)
"""Minimum and maximum plausible size of a robot part in m; for another size, the declared unit is probably wrong."""

_TO_Z_UP = {"z": np.eye(3), "y": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])}
"""{axis that points up in a file: rotation (3, 3) to z up}."""


def load_mesh(
    path: Path,
    unit: str | None,
    up: Literal["z", "y"] | None = "z",
    color: Sequence[float] = (0.6, 0.6, 0.6),
    *,
    apply_up_axis: bool = True,
) -> tuple[Mesh, list[Finding]]:
    """Read an STL, OBJ, GLB, 3MF, PLY or Collada file, converted to m and z up.

    `unit` is a key of `LENGTH`; `up` is the axis that points up in the file, None: the axis of the format (y for
    glTF, else z). A Collada file states both, so `unit` and `up` have no effect on it. Without `apply_up_axis`, its
    vertices keep the axes of the file; the finding `cad.up_axis` then reports an axis other than z. `color` is linear
    RGB, or RGB and alpha.

    Raises:
        CadError: the unit is missing, or the file is missing, unreadable or empty.
        BudgetError: reading the file would exceed the limits of its format.
    """
    import trimesh

    if unit is None:
        raise CadError(f"{path}: a mesh file does not state its unit; give unit = 'mm' (or {', '.join(LENGTH)})")
    if unit not in LENGTH:
        raise CadError(f"{path}: unit '{unit}' is not known; use one of {', '.join(LENGTH)}")
    if path.suffix.lower() not in SUFFIXES:
        raise CadError(f"{path}: suffix '{path.suffix}' is not supported; use STEP or one of {', '.join(SUFFIXES)}")
    if not path.is_file():
        raise CadError(f"{path}: the mesh file does not exist")
    stated = None
    findings = []
    size = LENGTH[unit]
    suffix = path.suffix.lower()
    if up is None:
        up = "y" if suffix in GLTF_SUFFIXES else "z"
    try:
        admit(path)
        if suffix == ".dae":
            vertices, triangles, stated_up = read_collada(path)
            up = "z"
            size = 1.0
            if apply_up_axis:
                vertices = vertices @ TO_Z_UP[stated_up].T
            elif stated_up != "Z_UP":
                findings.append(_kept_axes(path.name, stated_up))
        elif suffix == ".3mf":
            vertices, triangles, stated = read_3mf(path)
        else:
            loaded = trimesh.load_scene(path, skip_materials=True).to_mesh()
            vertices, triangles = np.asarray(loaded.vertices, float), np.asarray(loaded.faces)
    except BudgetError:
        raise
    except Exception as error:  # foreign readers raise any exception on damaged files
        raise CadError(f"{path}: cannot be read as {path.suffix[1:].upper()} ({error})") from error
    if len(triangles) == 0:
        raise CadError(f"{path}: the file has no triangles")
    if stated is not None and UNITS[stated] != LENGTH[unit]:
        raise CadError(f"{path}: unit '{unit}' is declared, but the file states {stated}; declare the unit of the file")
    vertices, triangles = weld(vertices * size @ _TO_Z_UP[up].T, triangles)
    extent = float(np.ptp(vertices, axis=0).max())
    if not _PLAUSIBLE_SIZES[0] <= extent <= _PLAUSIBLE_SIZES[1]:
        findings.append(
            warning(
                "cad.implausible_size",
                str(path),
                f"{path.name} has an implausible size when read in {unit}",
                Quantity(extent, "m"),
                suggestion="check the declared unit",
            )
        )
    r, g, b, *alpha = color
    # With any density: only an open surface has no inertia.
    if inertia(vertices, triangles, 1.0) is None:
        findings.append(open_mesh(path.stem))
    return Mesh(path.stem, vertices, triangles, (r, g, b, alpha[0] if alpha else 1.0)), findings


def _kept_axes(name: str, up: str) -> Finding:
    """Return a warning: the up axis of a Collada file has no effect; it says what the other reading would be."""
    turned = {"X_UP": "(-y, -z, x)", "Y_UP": "(x, -z, y)"}[up]
    text = (
        f"the up axis of mesh {name} is {up}; it is not applied, as in RViz, Gazebo and Pinocchio. A program that "
        f"applies it, such as Bullet, shows the points (x, y, z) of the mesh at {turned}"
    )
    return warning(
        "cad.up_axis", name, text, suggestion="save the mesh with up_axis Z_UP, which all programs read alike"
    )


def open_mesh(name: str) -> Finding:
    """Return a warning: the mesh `name` is not closed, so it has no volume and its mass is not counted."""
    text = f"'{name}' is not watertight: its volume is undefined, so its mass is not counted"
    return warning("cad.open_mesh", name, text, suggestion="close the surface in the CAD, or export a solid")


def inverted_mesh(name: str) -> Finding:
    """Return a warning: the triangles of the closed mesh `name` face inwards, so its mass would be negative."""
    text = f"'{name}' is inside out: its triangles are clockwise seen from outside, so its mass is not counted"
    return warning("cad.inverted_mesh", name, text, suggestion="reverse the faces, and save the mesh again")


def weld(vertices: Array, triangles: np.ndarray) -> tuple[Array, np.ndarray]:
    """Merge coincident vertices and remove triangles without area, so that closed solids become closed meshes."""
    import trimesh

    mesh = trimesh.Trimesh(vertices, triangles, process=False)
    mesh.merge_vertices(merge_norm=True, merge_tex=True)
    mesh.update_faces(mesh.nondegenerate_faces())
    mesh.remove_unreferenced_vertices()
    return np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int32)


def inertia(vertices: Array, triangles: np.ndarray, density: float) -> Inertia | None:
    """Return mass, centre of mass and inertia of a welded mesh with uniform density in kg/m3; None if it is open.

    The mass is negative if the triangles are clockwise seen from outside.
    """
    import trimesh

    mesh = trimesh.Trimesh(vertices, triangles, process=False)
    if not mesh.is_watertight or not mesh.is_winding_consistent:
        return None
    mesh.density = density
    return Inertia(float(mesh.mass), np.asarray(mesh.center_mass), np.asarray(mesh.moment_inertia))
