"""Poses of all bodies of a mechanism that moves little from call to call, as in a simulation."""

from __future__ import annotations

import numpy as np

from twin.core.spatial import Array
from twin.kinematics.closed_loops.solver import LoopSolver

_MAX_CHANGE = 0.5
"""Largest change (m, rad) of an unknown in one call; after a larger change, the state is solved from the rest poses."""


class LinkPoses:
    """Function object that returns the body poses at joint values; each call starts from the previous solution."""

    def __init__(self, loops: LoopSolver) -> None:
        """Store the loop solver of a mechanism; the first call starts from the rest poses."""
        self._loops = loops
        self._names = [b.name for b in loops.mechanism.bodies]
        self._states: Array | None = None

    def __call__(self, q: Array) -> dict[str, Array]:
        """Return {body: T_base_body (4, 4)} of all bodies at active joint values q (n,) in m or rad.

        Raises:
            AssemblyError: the loops cannot be closed at q.
            MechanismError: q has the wrong length or is not finite.
        """
        self._states = self._solved_states(np.asarray(q, float))
        Ts = np.zeros((len(self._names), 4, 4))
        Ts[:, :3] = self._loops.links_at(q, self._states).reshape(-1, 3, 4)
        Ts[:, 3, 3] = 1.0
        return dict(zip(self._names, Ts, strict=True))

    def _solved_states(self, q: Array) -> Array:
        if self._states is not None:
            states = self._loops.close(q, self._states)
            if states is not None:
                change = np.abs(states - self._states).max(initial=0.0)
                if change < _MAX_CHANGE:
                    return states
        solved = self._loops.forward_many(q[None])
        if not np.isfinite(solved.Ts_base_tool).all():
            self._loops.forward(q)  # raises, with the joint values
        return solved.states[0]
