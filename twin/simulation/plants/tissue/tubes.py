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

_DRAG = 2.0
"""Viscous drag in N s/m per metre of vessel; ASSUMED. A free end comes to rest in about 0.1 s."""

_BEND = 0.02
"""Bending stiffness divided by stretching stiffness; ASSUMED, for a thin wall."""

_SLIDE = 0.5 * MM
"""Distance in m by which jaws slide in a step at twice the force limit; proportional to the force above the limit."""

_STILL = 1e-7
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
        self.vessel, self.points = vessel, vessel.points.copy()
        n = vessel.segments
        self.cut, self.flat = np.zeros(n, int), np.zeros(n + 1)
        self.across, self.held = np.array([0.0, 0.0, 1.0]), dict[int, Held]()
        self.reaction = np.zeros(3)
        self._creeps, self._drawn = True, ((), np.zeros((0, 3)))
        self._stiff = vessel.young * np.pi * vessel.radius**2 / vessel.lengths
        self._drag = _DRAG * float(vessel.lengths.mean()) / period

    def step(self, first: Array) -> None:
        """Step the chain, with its first node at `first` (3,) in the World in m; a chain at rest is not computed."""
        if not self._creeps and not self.held and np.abs(first - self.points[0]).max() < _STILL:
            return
        x, n = self.points, self.vessel.segments
        whole = self.cut == 0
        d = np.diff(x, axis=0)
        size = np.maximum(np.linalg.norm(d, axis=1), 1e-9)
        along = d / size[:, None]
        tension = np.where(whole, self._stiff * (size - self.vessel.lengths), 0.0)
        F = np.zeros_like(x)
        F[:-1] += tension[:, None] * along
        F[1:] -= tension[:, None] * along
        H = np.zeros((n + 1, 3, n + 1, 3))
        outer = along[:, :, None] * along[:, None, :]
        slack = np.maximum(0.0, 1.0 - self.vessel.lengths / size)[:, None, None]
        block = (whole * self._stiff)[:, None, None] * (outer + slack * (np.eye(3) - outer))
        i = np.arange(n)
        H[i, :, i, :] += block
        H[i + 1, :, i + 1, :] += block
        H[i, :, i + 1, :] -= block
        H[i + 1, :, i, :] -= block
        bend = _BEND * self._stiff[1:] * whole[1:] * whole[:-1]
        curve = x[:-2] - 2 * x[1:-1] + x[2:]
        for offset, factor in ((0, 1.0), (1, -2.0), (2, 1.0)):
            F[offset : n - 1 + offset] -= factor * bend[:, None] * curve
            for other, second in ((0, 1.0), (1, -2.0), (2, 1.0)):
                a, b = np.arange(n - 1) + offset, np.arange(n - 1) + other
                H[a, :, b, :] += (factor * second * bend)[:, None, None] * np.eye(3)
        K = H.reshape(3 * n + 3, 3 * n + 3)
        K[np.diag_indices(3 * n + 3)] += self._drag
        given = {0: first, n: x[n]} | {h.node: h.p for h in self.held.values()}
        dx = np.zeros_like(x)
        for node, p in given.items():
            dx[node] = p - x[node]
        free = np.setdiff1d(np.arange(n + 1), list(given))
        rows = (3 * free[:, None] + np.arange(3)).ravel()
        dx[free] = np.linalg.solve(K[np.ix_(rows, rows)], (F.ravel() - K @ dx.ravel())[rows]).reshape(-1, 3)
        rest = (F.ravel() - K @ dx.ravel()).reshape(-1, 3) + self._drag * dx
        self.points = x + dx
        self._creeps = float(np.abs(dx).max()) > _STILL
        self.reaction = rest[0]
        for h in self.held.values():
            h.force = -rest[h.node]  # force of the jaws on the node
            much = float(np.linalg.norm(h.force)) / h.limit
            if much > 1.0:
                slide = min(much - 1.0, 2.0) * _SLIDE
                h.p = h.p - h.force / np.linalg.norm(h.force) * slide
                h.slipped += slide

    # -- places along the vessel --------------------------------------------------------------------------

    def at(self, s: float) -> Array:
        """Return the point (3,) in the World at arc length s in m; s is measured on the vessel at rest."""
        arc = self.vessel.arc
        k = int(np.clip(np.searchsorted(arc, s) - 1, 0, self.vessel.segments - 1))
        part = (s - arc[k]) / self.vessel.lengths[k]
        return (1 - part) * self.points[k] + part * self.points[k + 1]

    def crossed(self, base: Array, tip: Array) -> tuple[float, float, float, float]:
        """Find where the vessel is nearest to a straight line from base (3,) to tip (3,), both in m in the World.

        Returns:
            (distance in m between vessel and line, distance in m from the base along the line, position in m along
            the vessel, sine of the angle between vessel and line). The first distance is infinite if the whole vessel
            is cut away.
        """
        a, d = self.points[:-1], np.diff(self.points, axis=0)
        best = (np.inf, 0.0, 0.0, 1.0)
        long = float(np.linalg.norm(tip - base))
        u = (tip - base) / long
        for k in np.flatnonzero(self.cut == 0).tolist():
            L = float(np.linalg.norm(d[k]))
            if L < 1e-9:
                continue
            v, w = d[k] / L, base - a[k]
            b = float(u @ v)
            down = 1 - b * b
            t = np.clip(float(((w @ v) - b * (w @ u)) / down) if down > 1e-9 else 0.0, 0.0, L)
            s = float(np.clip((a[k] + t * v - base) @ u, 0.0, long))
            t = float(np.clip((base + s * u - a[k]) @ v, 0.0, L))
            far = float(np.linalg.norm(base + s * u - a[k] - t * v))
            if far < best[0] - 1e-12:
                arc = float(self.vessel.arc[k] + t / L * self.vessel.lengths[k])
                best = (far, s, arc, max(down, 1e-6) ** 0.5)
        return best

    def sever(self, s: float) -> int:
        """Cut away the segment at a position s in m along the vessel; return the index of the segment."""
        k = int(np.clip(np.searchsorted(self.vessel.arc, s) - 1, 0, self.vessel.segments - 1))
        self.cut[k], self._creeps = 1, True
        return k

    def nodes(self) -> Array:
        """Return the nodes (6 n, 3) of the deformable in the World in m."""
        state = tuple(x.tobytes() for x in (self.points, self.cut, self.flat, self.across))
        if state != self._drawn[0]:
            self._drawn = state, self.vessel.rings(self.points, self.cut, self.flat, self.across)
        return self._drawn[1]
