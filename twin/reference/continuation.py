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
from twin.reference import loop_rates
from twin.reference.model import ReferenceModel

_LONGEST_PREDICTED_STEP = 0.05
"""Largest step of a coordinate (m, rad) that is predicted; longer steps are solved by Newton's method."""

_SMALL_RESIDUAL = 1e-8
"""Largest residual of a state whose Jacobian is used: one correction reduces the residual to a rounding error."""


_LARGEST_CONDITION = 1e8
"""Largest condition number of P^T P with which P is inverted by it; others by singular values."""


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
        self._half_gain_change = np.zeros((0, 0, 0))  # half of its change in the last step
        self._pseudoinverse = np.zeros((0, 0, 0))

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
        X, is_solved = self._predicted_or_solved(q)
        model = self._model
        tree = model.tree
        loops = tree.loops
        poses, J = tree.update(X, closing_only=True)
        T0, T = loops.relative(poses)
        r, A = loops.evaluate_at(X, T0, T, J)
        # a row whose Jacobian is not yet accurate is corrected once more before
        is_rough = _is_open(r)
        if is_rough.any():
            X[is_rough] = self._corrected(X[is_rough], self._pseudoinverse[is_rough], r[is_rough])
            poses, J = tree.update(X, closing_only=True)
            T0, T = loops.relative(poses)
            r, A = loops.evaluate_at(X, T0, T, J)
        is_open = _is_open(r)
        if is_open.any():
            X[is_open] = model.follow(self.X[is_open], q[is_open])
            poses, J = tree.update(X, closing_only=True)
            T0, T = loops.relative(poses)
            r, A = loops.evaluate_at(X, T0, T, J)
        pseudoinverse = self._pseudoinverses(A)
        self.X = self._corrected(X, pseudoinverse, r)
        gain = loop_rates.gains_of(tree, A, pseudoinverse)
        self._half_gain_change = (gain - self._gain) / 2
        self._half_gain_change[is_solved | is_open] = 0.0
        self._q = np.array(q, float)
        self._pseudoinverse = pseudoinverse
        self._gain = gain
        V = _times(gain, qd)
        Vd = _times(gain, qdd)
        twists, biases = tree.motions(J, V)
        drift = loops.drift(T0, T, twists, biases)
        Vd[:, tree.passive] -= _times(pseudoinverse, drift)
        return V, Vd, gain

    def _begin(self, q: Array) -> None:
        """Solve the states at q (k, n) from home."""
        model = self._model
        self.X = np.array([model.solve(row).x for row in q])
        _, A = model.loops_only(self.X, np.arange(len(q)))
        self._pseudoinverse = loop_rates.pseudoinverse_of(model.tree, A)
        self._gain = loop_rates.gains_of(model.tree, A, self._pseudoinverse)
        self._half_gain_change = np.zeros_like(self._gain)
        self._q = np.array(q, float)

    def _predicted_or_solved(self, q: Array) -> tuple[Array, np.ndarray]:
        """Return states (k, nq) at q (k, n), and (k,) bool: whether Newton's method solved a row; else predicted."""
        steps = _times(self._gain + self._half_gain_change, q - self._q)
        X = self._model.tree.step(self.X, steps)
        solved = np.maximum.reduce(np.abs(steps), axis=1, initial=0.0) > _LONGEST_PREDICTED_STEP
        if solved.any():
            X[solved] = self._model.follow(self.X[solved], q[solved])
        return X, solved

    def _pseudoinverses(self, A: Array) -> Array:
        """Return what `loop_rates.pseudoinverse_of` returns, in a third of the time for the loops of SILS.

        Where the columns of the passive joints, P, are independent, the pseudoinverse is (P^T P)^-1 P^T. Its rounding
        error grows with the square of the condition number of P; the step G + (I - G P) G squares this error.
        """
        P = A[:, :, self._model.tree.passive]
        Pt = P.swapaxes(1, 2)
        squares = Pt @ P
        try:
            inverses = np.asarray(np.linalg.inv(squares), float)
        except np.linalg.LinAlgError:  # at least one row has dependent columns
            return loop_rates.pseudoinverse_of(self._model.tree, A)
        pseudoinverse = inverses @ Pt
        pseudoinverse += (np.eye(P.shape[2]) - pseudoinverse @ P) @ pseudoinverse
        condition = _norms(squares) * _norms(inverses)
        is_ill_conditioned = ~(condition <= _LARGEST_CONDITION)  # also where it is NaN
        if is_ill_conditioned.any():
            pseudoinverse[is_ill_conditioned] = loop_rates.pseudoinverse_of(self._model.tree, A[is_ill_conditioned])
        return pseudoinverse

    def _corrected(self, X: Array, pseudoinverse: Array, r: Array) -> Array:
        """Return configurations X (k, nq) with passive joints moved against the residuals r (k, m)."""
        tree = self._model.tree
        steps = np.zeros((len(X), tree.model.nv))
        steps[:, tree.passive] = -_times(pseudoinverse, r)
        return tree.step(X, steps)


def _is_open(r: Array) -> np.ndarray:
    """Return (k,) bool: whether the largest of the residuals r (k, m) is above `_SMALL_RESIDUAL`, or not a number."""
    return ~(np.maximum.reduce(np.abs(r), axis=1, initial=0.0) <= _SMALL_RESIDUAL)


def _norms(matrices: Array) -> Array:
    """Return the Frobenius norms (k,) of matrices (k, i, j)."""
    return np.sqrt(np.add.reduce(matrices * matrices, axis=(1, 2)))


def _times(matrices: Array, vectors: Array) -> Array:
    """Return the products (k, i) of matrices (k, i, j) and vectors (k, j); for few rows, faster than `numpy.einsum`."""
    return (matrices @ vectors[:, :, None])[:, :, 0]
