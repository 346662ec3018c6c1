"""Solids that a file draws as surroundings, by a table of TOML: the keys of each shape, and the surface it describes.

`drawn_surfaces` computes the surfaces.
"""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Literal

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.schema import Identifier, Keys, Table, Vector, error_at
from twin.ui.session import drawn_surfaces
from twin.ui.session.drawn_surfaces import Surface


class SolidTable(Table):
    """A solid, in a frame that its user names.

    Shapes: `ellipsoid`, `dome` (the upper half of an ellipsoid), `box`, `cylinder` (about its z axis), `bed` (a rough
    oval ground that ends at its rim), `drape` (a cloth over something round, hanging down at both sides; open below)
    and `limb` (a round body along points).

    Attributes:
        size_mm: extent along the axes of the solid; not of a limb.
        centre_mm: centre of the solid, or of the lower side of a bed or a drape; not of a limb.
        angles_deg: angles about z, y and x.
        line_mm: points of a limb.
        width_mm: thickness of a limb at each of its points.
        color: linear RGB or RGBA, 0..1.
    """

    name: Identifier
    shape: Literal["ellipsoid", "dome", "box", "cylinder", "limb", "bed", "drape"]
    size_mm: tuple[float, float, float] | None = None
    centre_mm: Vector | None = None
    angles_deg: Vector = (0.0, 0.0, 0.0)
    line_mm: list[Vector] | None = None
    width_mm: list[float] | None = None
    color: tuple[float, float, float] | tuple[float, float, float, float]


def check_solid(path: Path, keys: Keys, solid: SolidTable) -> None:
    """Raise an error if a solid lacks what its shape requires, or has what its shape does not use.

    Raises:
        DescriptionError: with file, line, key and the allowed values.
    """
    if solid.shape == "limb":
        _check_limb(path, keys, solid)
        return
    if solid.line_mm is not None or solid.width_mm is not None:
        text = f"a {solid.shape} has no line_mm and no width_mm: these belong to a limb"
        raise error_at(path, (*keys, "shape"), text)
    if solid.size_mm is None or solid.centre_mm is None:
        raise error_at(path, (*keys, "shape"), f"a {solid.shape} needs size_mm and centre_mm")
    if min(solid.size_mm) <= 0:
        raise error_at(path, (*keys, "size_mm"), f"{list(solid.size_mm)} is not above 0")


def _check_limb(path: Path, keys: Keys, solid: SolidTable) -> None:
    line = solid.line_mm or []
    widths = solid.width_mm or []
    if solid.size_mm is not None or solid.centre_mm is not None or any(solid.angles_deg):
        text = "a limb has line_mm and width_mm: remove the other lengths and angles"
        raise error_at(path, (*keys, "shape"), text)
    if len(line) < 2 or len(widths) != len(line):
        text = "a limb needs line_mm with two points or more, and as many numbers in width_mm: "
        text += f"it has {len(line)} points and {len(widths)} numbers"
        raise error_at(path, (*keys, "shape"), text)
    if min(widths) <= 0:
        raise error_at(path, (*keys, "width_mm"), f"{widths} is not above 0")
    for point, following in itertools.pairwise(line):
        if point == following:
            raise error_at(path, (*keys, "line_mm"), f"two points in sequence are equal: {list(point)}")


def pose_of(solid: SolidTable) -> Array:
    """Return the pose (4, 4) of a solid in its frame, in m; of a limb, the identity."""
    if solid.centre_mm is None:
        return np.eye(4)
    about_z, about_y, about_x = solid.angles_deg
    R_z = spatial.rotation_z(about_z * DEG)
    R_y = spatial.exp_so3([0, about_y * DEG, 0])
    R_x = spatial.exp_so3([about_x * DEG, 0, 0])
    return spatial.pose(R_z @ R_y @ R_x, np.array(solid.centre_mm) * MM)


def surface_of(solid: SolidTable) -> Surface:
    """Return points in m and triangles of a solid that is not a limb, in its own frame at its centre."""
    half_edges = np.array(solid.size_mm) * 0.5 * MM
    if solid.shape == "bed":
        return drawn_surfaces.bed(2 * half_edges)
    if solid.shape == "drape":
        return drawn_surfaces.drape(2 * half_edges)
    if solid.shape == "box":
        return drawn_surfaces.box(2 * half_edges)
    if solid.shape == "cylinder":
        points, triangles = drawn_surfaces.unit_cylinder()
    else:
        points, triangles = drawn_surfaces.unit_ball(solid.shape == "dome")
    return points * half_edges, triangles


def placed_surface(solid: SolidTable) -> Surface:
    """Return points in m and triangles of a solid, in the frame of its table."""
    if solid.shape == "limb":
        return drawn_surfaces.limb(np.array(solid.line_mm) * MM, np.array(solid.width_mm) * MM)
    points, triangles = surface_of(solid)
    T = pose_of(solid)
    return points @ T[:3, :3].T + T[:3, 3], triangles
