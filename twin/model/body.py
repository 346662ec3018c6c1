"""A rigid body with its meshes and materials, and the named frames and points on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.core.spatial import Array
from twin.model.inertia import Inertia

TOOL = "tool"
"""Name of the tool frame if a file does not name one."""


@dataclass(frozen=True)
class Finish:
    """Surface properties of a mesh for a renderer.

    Attributes:
        material: name of the part's material, or "" if unknown.
        metallic: 0 for paint, plastic and glass, 1 for bare metal.
        roughness: 0 for a mirror, 1 for chalk.
    """

    material: str = ""
    metallic: float = 0.0
    roughness: float = 0.5


@dataclass(frozen=True)
class Material:
    """A material: a name that is unique in the robot, a linear RGBA colour 0..1, and a finish."""

    name: str
    color_rgba: tuple[float, float, float, float]
    finish: Finish


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh with one colour, in the frame of its body.

    Attributes:
        name: identifier, unique in the mechanism.
        vertices: (n, 3) float64, in m.
        triangles: (m, 3) int32, counter-clockwise seen from outside.
        color_rgba: linear, 0..1.
        finish: finish of its surface.
    """

    name: str
    vertices: Array
    triangles: np.ndarray
    color_rgba: tuple[float, float, float, float] = (0.6, 0.6, 0.6, 1.0)
    finish: Finish = Finish()


@dataclass(frozen=True)
class Body:
    """A rigid body.

    Attributes:
        name: identifier.
        meshes: meshes that are displayed and checked for collisions.
        inertia: mass properties in the frame of the body; None if unknown.
        whole: whether the meshes show the whole body. If shapes of its file were left out, or its shapes are for
            display only, they cannot show that its mass is wrong.
    """

    name: str
    meshes: tuple[Mesh, ...] = ()
    inertia: Inertia | None = None
    whole: bool = True


@dataclass(frozen=True)
class Frame:
    """A named frame on a body, T_body_frame (4, 4)."""

    name: str
    body: str
    T_body_frame: Array


@dataclass(frozen=True)
class Point:
    """A named point on a body, p_body (3,) in m."""

    name: str
    body: str
    p_body: Array
