"""Vessels in a World: elastic chains that jaws can hold, clips can close, and blades can cut.

A chain has no inertia: it moves against a viscous drag until its forces balance. Steps use the backward Euler method.
Only the non-negative part of the springs' stiffness is used, so that the step is stable (D. Baraff and A. Witkin,
SIGGRAPH 1998).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.vessel import Vessel

_DRAG_PER_LENGTH = 2.0
"""Viscous drag in N s/m per metre of vessel; ASSUMED. A free end comes to rest in about 0.1 s."""

_BENDING_RATIO = 0.02
"""Bending stiffness divided by stretching stiffness; ASSUMED, for a thin wall."""

_SLIP_STEP = 0.5 * MM
"""Distance in m by which jaws slide in a step at twice the force limit; proportional to the force above the limit."""

_LARGEST_EXCESS = 2.0
"""Largest excess of the force over its limit, as a multiple of the limit, that counts for the slip of a step."""

_REST_STEP = 1e-7
"""A chain is at rest if no node moves further than this distance in m in a step."""


@dataclass
class Held:
    """A node of a vessel, held by jaws.

    Attributes:
        node: index of the node.
        p: (3,) position in m in the World at which the jaws hold the node.
        limit: maximum force in N with which the jaws hold the node.
        force: (3,) force on the node in N.
        slipped: slip of the node in m.
    """

    node: int
    p: Array
    limit: float
    force: Array
    slipped: float = 0.0


class Tube:
    """A vessel that can be held, clipped and cut.

    Attributes:
        vessel: the vessel at rest.
        points: (n + 1, 3) nodes in the World in m.
        cut: (n,) 1: the segment is cut away.
        flat: (n + 1,) fraction by which clips flatten the vessel at its nodes.
        across: (3,) direction in which clips flatten the vessel.
        held: the nodes that jaws hold; the keys are the numbers of the instruments.
        reaction: (3,) force in N that the chain exerts on the support of its first node.
    """

    def __init__(self, vessel: Vessel, period: float) -> None:
        """Start at rest; `period`: time in s between two steps."""
        self.vessel = vessel
        self.points = vessel.points.copy()
        self.cut = np.zeros(vessel.segments, int)
        self.flat = np.zeros(vessel.segments + 1)
        self.across = np.array([0.0, 0.0, 1.0])
        self.held: dict[int, Held] = {}
        self.reaction = np.zeros(3)
        self._is_moving = True
        self._drawn_state: tuple[bytes, ...] = ()
        self._drawn_nodes = np.zeros((0, 3))  # nodes of the deformable in this state
        self._stiffness = vessel.young * np.pi * vessel.radius**2 / vessel.lengths
        self._drag_per_node = _DRAG_PER_LENGTH * float(vessel.lengths.mean()) / period

    def step(self, first: Array) -> None:
        """Step the chain, with its first node at `first` (3,) in the World in m; a chain at rest is not computed.

        With the forces F of the springs at the nodes x, their stiffness H = -dF/dx and the drag b of a node, the step
        dx solves (H + b) dx = F at the free nodes; both ends and held nodes have given positions.
        """
        if not self._is_moving and not self.held and np.abs(first - self.points[0]).max() < _REST_STEP:
            return
        x = self.points
        n = self.vessel.segments
        F = np.zeros_like(x)
        H = np.zeros((n + 1, 3, n + 1, 3))
        self._add_stretching(F, H)
        self._add_bending(F, H)
        K = H.reshape(3 * n + 3, 3 * n + 3)
        K[np.diag_indices(3 * n + 3)] += self._drag_per_node
        stated_positions = {0: first, n: x[n]}  # both ends are attached
        for grasp in self.held.values():
            stated_positions[grasp.node] = grasp.p
        dx = np.zeros_like(x)
        for node, p in stated_positions.items():
            dx[node] = p - x[node]
        free = np.setdiff1d(np.arange(n + 1), list(stated_positions))
        rows = (3 * free[:, None] + np.arange(3)).ravel()
        load = (F.ravel() - K @ dx.ravel())[rows]
        dx[free] = np.linalg.solve(K[np.ix_(rows, rows)], load).reshape(-1, 3)
        # what the forces of the chain leave over at the nodes with given positions
        remaining = (F.ravel() - K @ dx.ravel()).reshape(-1, 3) + self._drag_per_node * dx
        self.points = x + dx
        self._is_moving = float(np.abs(dx).max()) > _REST_STEP
        self.reaction = remaining[0]
        for grasp in self.held.values():
            grasp.force = -remaining[grasp.node]  # force of the jaws on the node
            load_ratio = float(np.linalg.norm(grasp.force)) / grasp.limit
            if load_ratio > 1.0:
                slide = min(load_ratio - 1.0, _LARGEST_EXCESS) * _SLIP_STEP
                grasp.p = grasp.p - grasp.force / np.linalg.norm(grasp.force) * slide
                grasp.slipped += slide

    def _add_stretching(self, F: Array, H: Array) -> None:
        """Add the forces of the springs to F (n + 1, 3), their stiffness to H (n + 1, 3, n + 1, 3)."""
        is_uncut = self.cut == 0
        d = np.diff(self.points, axis=0)
        size = np.maximum(np.linalg.norm(d, axis=1), 1e-9)
        along = d / size[:, None]
        tension = np.where(is_uncut, self._stiffness * (size - self.vessel.lengths), 0.0)
        F[:-1] += tension[:, None] * along
        F[1:] -= tension[:, None] * along
        outer = along[:, :, None] * along[:, None, :]
        # A compressed spring has a negative stiffness across its direction, which is left out: see the module.
        stretch = np.maximum(0.0, 1.0 - self.vessel.lengths / size)[:, None, None]
        block = (is_uncut * self._stiffness)[:, None, None] * (outer + stretch * (np.eye(3) - outer))
        i = np.arange(self.vessel.segments)
        H[i, :, i, :] += block
        H[i + 1, :, i + 1, :] += block
        H[i, :, i + 1, :] -= block
        H[i + 1, :, i, :] -= block

    def _add_bending(self, F: Array, H: Array) -> None:
        """Add forces and stiffness of bending: the second difference of three nodes is drawn to zero."""
        is_uncut = self.cut == 0
        x = self.points
        inner = np.arange(self.vessel.segments - 1)
        bending_stiffness = _BENDING_RATIO * self._stiffness[1:] * is_uncut[1:] * is_uncut[:-1]
        curvature = x[:-2] - 2 * x[1:-1] + x[2:]
        differences = (1.0, -2.0, 1.0)
        for offset, factor in enumerate(differences):
            F[offset : len(inner) + offset] -= factor * bending_stiffness[:, None] * curvature
            for second_offset, second_factor in enumerate(differences):
                block = (factor * second_factor * bending_stiffness)[:, None, None] * np.eye(3)
                H[inner + offset, :, inner + second_offset, :] += block

    # -- places along the vessel --------------------------------------------------------------------------

    def at(self, s: float) -> Array:
        """Return the point (3,) in the World at arc length s in m; s is measured on the vessel at rest."""
        k = self._segment(s)
        fraction = (s - self.vessel.arc[k]) / self.vessel.lengths[k]
        return (1 - fraction) * self.points[k] + fraction * self.points[k + 1]

    def _segment(self, s: float) -> int:
        """Return the index of the segment at arc length s in m."""
        return int(np.clip(np.searchsorted(self.vessel.arc, s) - 1, 0, self.vessel.segments - 1))

    def crossed(self, base: Array, tip: Array) -> tuple[float, float, float, float]:
        """Find where the vessel is nearest to a straight line from base (3,) to tip (3,), both in m in the World.

        Returns:
            (distance in m between vessel and line, distance in m from the base along the line, position in m along
            the vessel, sine of the angle between vessel and line). The first distance is infinite if the whole vessel
            is cut away.
        """
        nearest = (np.inf, 0.0, 0.0, 1.0)
        line_length = float(np.linalg.norm(tip - base))
        u = (tip - base) / line_length
        for k in np.flatnonzero(self.cut == 0).tolist():
            start = self.points[k]
            d = self.points[k + 1] - start
            length = float(np.linalg.norm(d))
            if length < 1e-9:
                continue
            v = d / length
            w = base - start
            cosine = float(u @ v)
            sine_squared = 1 - cosine * cosine
            # Nearest point of the segment to the endless line, then of the line to it, then of the segment again.
            t = 0.0
            if sine_squared > 1e-9:  # not parallel
                t = float(((w @ v) - cosine * (w @ u)) / sine_squared)
            t = np.clip(t, 0.0, length)
            s = float(np.clip((start + t * v - base) @ u, 0.0, line_length))
            t = float(np.clip((base + s * u - start) @ v, 0.0, length))
            distance = float(np.linalg.norm(base + s * u - start - t * v))
            if distance < nearest[0] - 1e-12:
                position = float(self.vessel.arc[k] + t / length * self.vessel.lengths[k])
                nearest = (distance, s, position, max(sine_squared, 1e-6) ** 0.5)
        return nearest

    def sever(self, s: float) -> int:
        """Cut away the segment at a position s in m along the vessel; return the index of the segment."""
        k = self._segment(s)
        self.cut[k] = 1
        self._is_moving = True
        return k

    def nodes(self) -> Array:
        """Return the nodes (6 n, 3) of the deformable in the World in m."""
        state = (self.points.tobytes(), self.cut.tobytes(), self.flat.tobytes(), self.across.tobytes())
        if state != self._drawn_state:
            self._drawn_state = state
            self._drawn_nodes = self.vessel.rings(self.points, self.cut, self.flat, self.across)
        return self._drawn_nodes
