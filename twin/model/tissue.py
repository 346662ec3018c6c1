"""A soft organ: a grid of moving nodes, a surface that follows these nodes, a material, and pins that fix nodes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.spatial import Array, Index
from twin.core.units import MM
from twin.model.body import Mesh
from twin.model.deformable import Deformable
from twin.model.surface import Surface


@dataclass(frozen=True)
class Pin:
    """A box in the World with the corners `low` and `high` (3,) in m; nodes of the grid inside the box are fixed."""

    name: str
    low: Array
    high: Array


@dataclass(frozen=True)
class Tissue:
    """A soft organ. The nodes of its grid move; the vertices of its surface follow by trilinear interpolation.

    Attributes:
        name: identifier, unique among deformables, robots, props and objects.
        surface: closed surface at rest, in the World.
        cells: number of cells along the three axes of the grid.
        young: Young's modulus in Pa.
        poisson: Poisson's ratio.
        damping: damping divided by stiffness (Rayleigh damping), in s.
        density: in kg/m3.
        friction: coefficient of sliding friction.
        pins: boxes in which nodes are fixed.
        color_rgba: linear, 0..1.
        upright: true: the axes of the grid are the axes of the World; false: they are the principal axes of the
            surface, the longest first.
    """

    name: str
    surface: Surface
    cells: tuple[int, int, int]
    young: float
    poisson: float
    damping: float
    density: float
    friction: float
    pins: tuple[Pin, ...]
    color_rgba: tuple[float, float, float, float] = (0.7, 0.3, 0.3, 1.0)
    upright: bool = False

    @cached_property
    def T_world_grid(self) -> Array:  # noqa: N802
        """Pose (4, 4) of the grid in the World; the origin is the grid's corner with the smallest coordinates."""
        vertices = self.surface.vertices
        if self.upright:
            return spatial.pose(p=vertices.min(axis=0))
        axes = np.linalg.svd(vertices - vertices.mean(axis=0), full_matrices=False)[2]
        # the sign of a principal axis is arbitrary; it is chosen so that the largest component is positive
        largest = np.argmax(np.abs(axes), axis=1)
        axes *= np.sign(np.take_along_axis(axes, largest[:, None], 1))
        axes[2] = np.cross(axes[0], axes[1])
        T = spatial.pose(axes.T)
        T[:3, 3] = axes.T @ ((vertices @ axes.T).min(axis=0))
        return T

    @cached_property
    def vertices_in_grid(self) -> Array:
        """Vertices (n, 3) in m at rest, in the frame of the grid."""
        T = self.T_world_grid
        return (self.surface.vertices - T[:3, 3]) @ T[:3, :3]

    @cached_property
    def cell_size(self) -> Array:
        """Edge lengths (3,) of a cell of the grid in m."""
        return self.vertices_in_grid.max(axis=0) / self.cells

    @cached_property
    def nodes(self) -> Array:
        """Nodes (k, 3) in m at rest, in the World; the index along the third axis of the grid changes fastest."""
        x_cells, y_cells, z_cells = self.cells
        index = np.moveaxis(np.indices((x_cells + 1, y_cells + 1, z_cells + 1)), 0, -1).reshape(-1, 3)
        T = self.T_world_grid
        return (index * self.cell_size) @ T[:3, :3].T + T[:3, 3]

    @cached_property
    def weights(self) -> Array:
        """Weights (n, k): vertices = weights @ nodes."""
        return self._interpolated(self.vertices_in_grid, None)

    @cached_property
    def gradients(self) -> Array:
        """Deformation gradients at the vertices as weights (3, n, k) of the nodes.

        gradients[i] @ nodes is (n, 3), dimensionless: the derivative of the position in the World with respect to the
        coordinate along axis i of the grid at rest.
        """
        return np.stack(
            [
                self._interpolated(self.vertices_in_grid, 0),
                self._interpolated(self.vertices_in_grid, 1),
                self._interpolated(self.vertices_in_grid, 2),
            ]
        )

    def _interpolated(self, local: Array, axis: int | None) -> Array:
        """Return weights (n, k) of the nodes at points (n, 3) in the grid frame, or the derivatives along `axis`."""
        cells = np.array(self.cells)
        at = local / self.cell_size
        low = np.clip(np.floor(at).astype(int), 0, cells - 1)
        part = at - low
        weights = np.zeros((len(at), len(self.nodes)))
        rows = np.arange(len(at))
        for corner in np.ndindex(2, 2, 2):
            i, j, k = (low + corner).T
            shares = np.where(corner, part, 1 - part)
            if axis is not None:
                # the derivative of `part` or of 1 - `part`
                sign = -1
                if corner[axis]:
                    sign = 1
                shares[:, axis] = sign / self.cell_size[axis]
            weights[rows, (i * (cells[1] + 1) + j) * (cells[2] + 1) + k] += shares.prod(axis=1)
        return weights

    @cached_property
    def pinned_nodes(self) -> Index:
        """Indices of the nodes that pins fix.

        Raises:
            TwinError: a pin contains no node, or all pins together do not contain three nodes that form a triangle.
        """
        is_pinned = np.zeros(len(self.nodes), bool)
        for pin in self.pins:
            is_in_box = ((self.nodes >= pin.low) & (self.nodes <= pin.high)).all(axis=1)
            if not is_in_box.any():
                low = np.round(self.nodes.min(axis=0) / MM).tolist()
                high = np.round(self.nodes.max(axis=0) / MM).tolist()
                raise TwinError(f"tissue '{self.name}': pin '{pin.name}' holds none of the {len(self.nodes)} nodes of "
                                f"the grid, which are between {low} and {high} mm; enlarge its box")  # fmt: skip
            is_pinned |= is_in_box
        index = np.flatnonzero(is_pinned)
        spread = np.zeros((1, 3))
        if len(index):
            spread = self.nodes[index] - self.nodes[index].mean(axis=0)
        if np.linalg.matrix_rank(spread, tol=MM) < 2:
            raise TwinError(
                f"tissue '{self.name}': its pins hold {len(index)} nodes; at least three that are not in one line are "
                "needed, or the organ moves as a whole"
            )
        return index

    @property
    def deformable(self) -> Deformable:
        """The organ as a `Deformable` that is fixed to the World; its signal is `<name>.nodes`."""
        mesh = Mesh(self.name, self.surface.vertices, self.surface.triangles.astype(np.int32), self.color_rgba)
        return Deformable(self.name, mesh, weights=self.weights)
