"""A vessel: a thin tube along a line, made of closed segments; a cut removes one segment."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from pydantic import Field

from twin.core.errors import TwinError
from twin.core.provenance import Parameter
from twin.core.spatial import Array, Index
from twin.core.units import MM
from twin.model.body import Mesh
from twin.model.deformable import Deformable
from twin.schema import Identifier, Row, Sourced, Vector

MAX_SEGMENTS = 60
"""Maximum number of segments of a vessel; more segments increase the computing time of a step."""

_LARGEST_COORDINATE = 1e6
"""Largest coordinate of a vessel in mm."""

_PRISM_SIDES = 8
"""Number of sides of a drawn segment."""

_SHORTEST_SEGMENT = 1e-9
"""Length in m by which a segment without a length is divided."""

_PARALLEL_SINE = 1e-3
"""Sine of the angle between a segment and the direction of a clip below which they count as parallel."""

_FLATTENED_SHARE = 0.95
"""Share of a radius that a closed clip takes away; a prism without a thickness has no volume to draw."""


class VesselTable(Sourced):
    """A vessel along a line in the world frame, in segments of about `segment_mm`.

    The first point is on the surface of `organ` and moves with the organ; without `organ`, the first point is fixed.
    The last point is fixed.
    """

    line_mm: list[Vector] = Field(min_length=2, max_length=20)
    organ: Identifier | None = None
    radius_mm: float = Field(ge=0.2, le=20)
    segment_mm: float = Field(ge=0.5, le=20)
    young_kpa: float = Field(ge=0.1, le=1000)
    color: str = Field("#b0a060", pattern="^#[0-9a-f]{6}$", description="sRGB")


@dataclass(frozen=True, eq=False)
class Vessel:
    """A vessel at rest. Its nodes are on its centre line; a segment is between two nodes.

    Attributes:
        name: identifier, unique among deformables, robots, props and objects.
        points: (n + 1, 3) nodes in m at rest, in the World.
        organ: name of the organ with which the first node moves; "": the first node is fixed.
        radius: in m.
        young: Young's modulus in Pa.
        color_rgba: linear, 0..1.
    """

    name: str
    points: Array
    organ: str
    radius: float
    young: float
    color_rgba: tuple[float, float, float, float] = (0.4, 0.35, 0.1, 1.0)

    @property
    def segments(self) -> int:
        """Number of segments."""
        return len(self.points) - 1

    @cached_property
    def lengths(self) -> Array:
        """Lengths (n,) in m of the segments at rest."""
        return np.linalg.norm(np.diff(self.points, axis=0), axis=1)

    @cached_property
    def arc(self) -> Array:
        """Distances (n + 1,) in m from the first node to each node, along the vessel at rest."""
        return np.concatenate([[0.0], np.cumsum(self.lengths)])

    def rings(self, points: Array, cut: Index, flat: Array, across: Array) -> Array:
        """Return the nodes (6 n, 3) of the deformable: three for each of the two ends of each segment.

        The three nodes are the centre of the end, and the outer points of two perpendicular radii. A segment that is
        cut away has no volume.

        Args:
            points: (n + 1, 3) nodes in m of the centre line, in the World.
            cut: (n,) 1 for each segment that is cut away, else 0.
            flat: (n + 1,) fraction by which a clip flattens the vessel at each node.
            across: (3,) direction in which a clip flattens the vessel.
        """
        along = np.diff(points, axis=0)
        z = along / np.maximum(np.linalg.norm(along, axis=1), _SHORTEST_SEGMENT)[:, None]
        across_unit = across - z * (z @ across)[:, None]
        parallel = np.linalg.norm(across_unit, axis=1) < _PARALLEL_SINE
        other_axis = np.eye(3)[np.argmin(np.abs(z), axis=1)]
        # the axis that is farthest from the segment stands in for a direction parallel to the segment
        other_across = other_axis - z * np.einsum("ij,ij->i", z, other_axis)[:, None]
        across_unit = np.where(parallel[:, None], other_across, across_unit)
        across_unit /= np.linalg.norm(across_unit, axis=1)[:, None]
        second_across = np.cross(z, across_unit)
        thickness = 1.0 - _FLATTENED_SHARE * flat
        nodes = np.zeros((self.segments, 2, 3, 3))
        for side in (0, 1):
            p = points[side : side + self.segments]
            thin = thickness[side : side + self.segments, None]
            nodes[:, side, 0] = p
            nodes[:, side, 1] = p + self.radius * thin * across_unit
            # A flattened vessel becomes wider.
            nodes[:, side, 2] = p + self.radius * np.sqrt(2 - thin) * second_across
        is_cut = cut > 0
        nodes[is_cut] = points[:-1][is_cut][:, None, None, :]
        return nodes.reshape(-1, 3)

    @cached_property
    def deformable(self) -> Deformable:
        """The vessel as a `Deformable` fixed to the World, one closed prism per segment. The signal: `<name>.nodes`."""
        segment_count = self.segments
        angles = 2 * np.pi * np.arange(_PRISM_SIDES) / _PRISM_SIDES
        c = np.cos(angles)
        s = np.sin(angles)
        ring = np.column_stack([1 - c - s, c, s])  # weights of the centre and of the ends of the two radii
        ring = np.vstack([ring, [1.0, 0.0, 0.0]])  # the centre itself, for the closed end
        vertices_per_end = _PRISM_SIDES + 1
        weights = np.zeros((2 * segment_count * vertices_per_end, 6 * segment_count))
        for end in range(2 * segment_count):
            weights[end * vertices_per_end : (end + 1) * vertices_per_end, 3 * end : 3 * end + 3] = ring
        i = np.arange(_PRISM_SIDES)
        j = (i + 1) % _PRISM_SIDES
        first_centre = np.full(_PRISM_SIDES, _PRISM_SIDES)
        last_centre = vertices_per_end + first_centre
        sides = [
            np.column_stack([i, j, vertices_per_end + j]),
            np.column_stack([i, vertices_per_end + j, vertices_per_end + i]),
        ]
        ends = [
            np.column_stack([first_centre, j, i]),
            np.column_stack([last_centre, vertices_per_end + i, vertices_per_end + j]),
        ]
        prism = np.concatenate([*sides, *ends])
        triangles = (
            prism + 2 * vertices_per_end * np.arange(segment_count)[:, None, None]
        )  # (n, triangles of a prism, 3)
        uncut = np.zeros(segment_count, int)
        round_ends = np.zeros(segment_count + 1)
        nodes = self.rings(self.points, uncut, round_ends, np.array([0.0, 0.0, 1.0]))
        mesh = Mesh(self.name, weights @ nodes, triangles.reshape(-1, 3).astype(np.int32), self.color_rgba)
        return Deformable(self.name, mesh, weights=weights)


def vessel(name: str, table: VesselTable, rgba: tuple[float, float, float, float]) -> Vessel:
    """Return the `Vessel` that a table describes, in SI units.

    Raises:
        TwinError: the vessel would have too many segments, or two successive points of its line are equal, or a
            coordinate is too large.
    """
    coordinates = np.array(table.line_mm)
    farthest = coordinates.flat[np.argmax(np.abs(coordinates))]
    if abs(farthest) > _LARGEST_COORDINATE:
        raise TwinError(
            f"vessel '{name}': a point of line_mm is at {farthest:g} mm; the limit is ±{_LARGEST_COORDINATE:g} mm"
        )
    line = coordinates * MM
    lengths = np.linalg.norm(np.diff(line, axis=0), axis=1)
    if not lengths.min() > 0:
        raise TwinError(f"vessel '{name}': two points of line_mm are equal; remove one")
    arc = np.concatenate([[0.0], np.cumsum(lengths)])
    count = max(4, round(float(arc[-1]) / (table.segment_mm * MM)))
    if count > MAX_SEGMENTS:
        raise TwinError(
            f"vessel '{name}' has {count} segments; the limit is {MAX_SEGMENTS}: increase segment_mm "
            f"({table.segment_mm:g} mm)"
        )
    even = np.linspace(0, arc[-1], count + 1)
    points = np.zeros((count + 1, 3))
    for axis in range(3):
        points[:, axis] = np.interp(even, arc, line[:, axis])
    return Vessel(name, points, table.organ or "", table.radius_mm * MM, table.young_kpa * 1e3, rgba)


def listed(name: str, table: VesselTable) -> Iterator[Parameter]:
    """Yield the numbers of a vessel as parameters with provenance."""
    rows: list[Row] = [
        ("radius", table.radius_mm, "mm"),
        ("segment", table.segment_mm, "mm"),
        ("Young's modulus", table.young_kpa, "kPa"),
    ]
    for k, point in enumerate(table.line_mm, 1):
        rows.append((str(k), point, "mm"))
    return table.parameters(f"vessel {name}", rows)
