"""A deformable object for tests: a square cloth that hangs from two corners and swings.

The model has springs along the edges and the diagonals of a grid, and semi-implicit Euler steps of about 1 ms. It is
deterministic: the same arguments give the same bytes.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy import sparse

from twin.simulation.frame import WorldFrame
from twin.ui.session.deformable_feed import FieldSurface

GRAVITY = np.array([0.0, 0.0, -9.81])
RATE = 60.0
STEPS = 16
"""Number of steps per frame. A step is 1/960 s; above 1.6 ms the stiffest spring is unstable."""


class Cloth:
    """A feed: `n` by `n` vertices, with edge length `edge` in m, horizontal at the start.

    The first row begins at `corner` (3,) in m and extends along x; its two ends are fixed.

    Attributes:
        surfaces, duration: see `twin.ui.session.deformable_feed.Feed`.
        edges: (k, 2) indices of the vertices that each spring connects.
        rest: (k,) rest lengths of the springs in m.
    """

    def __init__(self, corner=(0.0, 0.0, 1.0), edge=0.3, n=13, duration=2.0):
        self.corner, self.edge, self.n, self.duration = np.array(corner, float), edge, n, duration
        at = np.arange(n * n).reshape(n, n)
        quads = [(at[i, j], at[i, j + 1], at[i + 1, j + 1], at[i + 1, j]) for i in range(n - 1) for j in range(n - 1)]
        triangles = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
        self.surfaces = {"cloth": FieldSurface(triangles, (0.16, 0.55, 0.5), 1.0)}
        pairs = [(at[:, :-1], at[:, 1:]), (at[:-1], at[1:]), (at[:-1, :-1], at[1:, 1:]), (at[:-1, 1:], at[1:, :-1])]
        self.edges = np.concatenate([np.stack([a.ravel(), b.ravel()], 1) for a, b in pairs])
        start = self._start()
        self.rest = np.linalg.norm(start[self.edges[:, 0]] - start[self.edges[:, 1]], axis=1)

    def _start(self):
        x, y = np.meshgrid(np.linspace(0, self.edge, self.n), np.linspace(0, self.edge, self.n))
        return self.corner + np.stack([x.ravel(), y.ravel(), np.zeros(self.n**2)], 1)

    @cached_property
    def _played(self):
        """Vertices (frames, n * n, 3) in m, `RATE` frames per second."""
        k, count = len(self.edges), self.n**2
        rows, signs = np.repeat(np.arange(k), 2), np.tile([-1.0, 1.0], k)
        across = sparse.csr_matrix((signs, (rows, self.edges.ravel())), (k, count))
        held = [0, self.n - 1]
        mass = 0.05 / count
        stiffness, damping, drag = 60.0, 2e-3, 1.0 * mass
        x, v, dt = self._start(), np.zeros((count, 3)), 1 / (RATE * STEPS)
        out = [x.copy()]
        for _ in range(round(self.duration * RATE)):
            for _ in range(STEPS):
                d, w = across @ x, across @ v
                long = np.linalg.norm(d, axis=1, keepdims=True)
                along = d / long
                pull = stiffness * (long - self.rest[:, None]) + damping * np.sum(w * along, axis=1, keepdims=True)
                v = v + dt * (GRAVITY - (across.T @ (pull * along) + drag * v) / mass)
                v[held] = 0.0
                x = x + dt * v
            out.append(x.copy())
        return np.stack(out)

    def at(self, t):
        """Return the frame at a time in s."""
        k = int(np.clip(round(t * RATE), 0, len(self._played) - 1))
        return WorldFrame(k / RATE, {}, {"cloth": self._played[k]})
