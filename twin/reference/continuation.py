"""Continue the closed loops of several separate motions of one mechanism from tick to tick, with their rates.

The motions are those of simulations side by side, in small steps. In each step, the passive joints are predicted by
their gains in the middle of the step, which are extrapolated from the last two steps: the error is of third order.
A correction by the pseudoinverse of the loop Jacobian, which also gives the rates, reduces this error to its square.
With ticks of 1 ms, the residuals are about 1e-9 m after the prediction, and rounding errors after the correction. A
larger residual is corrected once more before, and a step that is too long for this is solved by Newton's method
(`ReferenceModel.follow`).
"""

from __future__ import annotations

import numpy as np

from twin.core.spatial import Array
from twin.reference.model import ReferenceModel

_STRIDE = 0.05
"""Largest step of a coordinate (m, rad) that is predicted; longer steps are solved by Newton's method."""

_NEAR = 1e-8
"""Largest residual of a state whose Jacobian is used: one correction reduces the residual to a rounding error."""


class LoopContinuation:
    """States of k separate motions of one mechanism with loops, at the active joint values of the last tick.

    Attributes:
        X: (k, nq) configurations; empty before the first tick.
    """

    def __init__(self, model: ReferenceModel) -> None:
        self._model = model
        self.X = np.zeros((0, model.tree.model.nq))
        self._q = np.zeros((0, 0))
        self._gain = np.zeros((0, 0, 0))  # of the last step
        self._half = np.zeros((0, 0, 0))  # half of its change in the last step
        self._give = np.zeros((0, 0, 0))

    def motion(self, q: Array, qd: Array, qdd: Array) -> tuple[Array, Array, Array]:
        """Continue to joint values q (k, n); return V, dV/dt (k, nv) and G (k, nv, n) as `ReferenceModel.motion` does.

        Args:
            q: joint values (k, n) of the active joints, each row near that of the last call.
            qd: rates (k, n) of the active joints.
            qdd: accelerations (k, n) of the active joints.

        Raises:
            AssemblyError: the loops of a row cannot be closed.
        """
        if not len(self.X):
            self._begin(q)
        X, solved = self._near(q)
        tree = self._model.tree
        poses, J = tree.update(X, closing_only=True)
        r, A = tree.loops.evaluate(X, poses, J)
        # a row whose Jacobian is not yet accurate is corrected once more before
        rough = ~(np.abs(r).max(axis=1, initial=0.0) <= _NEAR)  # NaN counts as rough
        if rough.any():
            X[rough] = self._moved(X[rough], self._give[rough], r[rough])
            poses[rough], J[rough] = tree.update(X[rough], closing_only=True)
            r[rough], A[rough] = tree.loops.evaluate(X[rough], poses[rough], J[rough])
        far = ~(np.abs(r).max(axis=1, initial=0.0) <= _NEAR)
        if far.any():
            X[far] = self._model.follow(self.X[far], q[far])
            poses[far], J[far] = tree.update(X[far], closing_only=True)
            r[far], A[far] = tree.loops.evaluate(X[far], poses[far], J[far])
        give = self._model.pseudoinverse_of(A)
        self.X = self._moved(X, give, r)
        gain = self._model.gains_of(A, give)
        self._half = (gain - self._gain) / 2
        self._half[solved | far] = 0.0
        self._q = np.array(q, float)
        self._give = give
        self._gain = gain
        V = np.einsum("kij,kj->ki", self._gain, qd)
        change = np.einsum("kij,kj->ki", self._gain, qdd)
        drift, _ = tree.drift_at(poses, J, V)
        change[:, tree.passive] -= np.einsum("kij,kj->ki", give, drift)
        return V, change, self._gain

    def _begin(self, q: Array) -> None:
        """Solve the states at q (k, n) from home."""
        model = self._model
        self.X = np.array([model.solve(row).x for row in q])
        _, A = model.loops_only(self.X, np.arange(len(q)))
        self._give = model.pseudoinverse_of(A)
        self._gain = model.gains_of(A, self._give)
        self._half = np.zeros_like(self._gain)
        self._q = np.array(q, float)

    def _near(self, q: Array) -> tuple[Array, np.ndarray]:
        """Return states (k, nq) at q (k, n), and (k,) bool: whether Newton's method solved a row; else predicted."""
        steps = np.einsum("kij,kj->ki", self._gain + self._half, q - self._q)
        X = self._model.tree.step(self.X, steps)
        solved = np.abs(steps).max(axis=1, initial=0.0) > _STRIDE
        if solved.any():
            X[solved] = self._model.follow(self.X[solved], q[solved])
        return X, solved

    def _moved(self, X: Array, give: Array, r: Array) -> Array:
        """Return configurations X (k, nq) with passive joints moved against the residuals r (k, m)."""
        tree = self._model.tree
        steps = np.zeros((len(X), tree.model.nv))
        steps[:, tree.passive] = -np.einsum("kij,kj->ki", give, r)
        return tree.step(X, steps)
