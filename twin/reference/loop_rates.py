"""Rates of a mechanism with closed loops: what the passive joints and the tool do when the active joints move.

With A the Jacobian of the loop residuals, and A_a and A_p its columns for the active and the passive joints, closed
loops need A_a qd + A_p v = 0. The passive rates v are its solution in the least-squares sense, by a pseudoinverse of
A_p: redundant constraints cause no problem, and of an internal freedom (the spin of a rod between two ball joints) the
slowest rates are taken.
"""

from __future__ import annotations

import numpy as np

from twin.core.spatial import Array
from twin.reference.tree import Tree

_RELATIVE_ZERO = 1e-9
"""Singular values below this fraction of the largest one count as zero."""


def jacobians(tree: Tree, X: Array) -> tuple[Array, Array]:
    """Return loop Jacobians (k, m, nv) and tool Jacobians (k, 6, nv) at configurations X (k, nq).

    The tool Jacobians are in base at the tool's origin, linear rows first.
    """
    poses, J = tree.update(X, closing_only=True)
    _, A = tree.loops.evaluate(X, poses, J)
    return A, tree.tool_jacobian(poses, J)


def pseudoinverse_of(tree: Tree, A: Array) -> Array:
    """Return the pseudoinverses (k, np, m) of the passive columns of loop Jacobians A (k, m, nv).

    They give the change of the passive joints per change of the loop residual.
    """
    passive = tree.passive
    if not A.shape[1] or not len(passive):
        return np.zeros((len(A), len(passive), A.shape[1]))
    inverse = np.linalg.pinv(A[:, :, passive], rcond=_RELATIVE_ZERO)
    return np.asarray(inverse, float)


def gains_of(tree: Tree, A: Array, inverse: Array) -> Array:
    """Return the gains (k, nv, n): the rate of each tree joint per rate of each active joint.

    Args:
        tree: the spanning tree.
        A: (k, m, nv) loop Jacobians.
        inverse: (k, np, m) their pseudoinverses, from `pseudoinverse_of`.
    """
    gain = np.zeros((len(A), tree.model.nv, len(tree.active)))
    gain[:, tree.active] = np.eye(len(tree.active))
    gain[:, tree.passive] = -inverse @ A[:, :, tree.active]
    return gain


def gains(tree: Tree, X: Array) -> Array:
    """Return the gains (k, nv, n) of `gains_of` at configurations X (k, nq)."""
    A, _ = jacobians(tree, X)
    return gains_of(tree, A, pseudoinverse_of(tree, A))


def motion(tree: Tree, X: Array, qd: Array, qdd: Array) -> tuple[Array, Array, Array]:
    """Return V, dV/dt (k, nv) and the gains G (k, nv, n) at configurations X (k, nq); see `ReferenceModel.motion`."""
    A, _ = jacobians(tree, X)
    inverse = pseudoinverse_of(tree, A)
    gain = gains_of(tree, A, inverse)
    V = np.einsum("kij,kj->ki", gain, qd)
    Vd = np.einsum("kij,kj->ki", gain, qdd)
    if tree.loops.names:
        # the loops stay closed only if the passive joints also cancel dA/dt V
        drift, _ = tree.drift(X, V)
        Vd[:, tree.passive] -= np.einsum("kij,kj->ki", inverse, drift)
    return V, Vd, gain


def tool_motion(tree: Tree, X: Array, qd: Array, qdd: Array) -> tuple[Array, Array]:
    """Return tool twists and accelerations (k, 6) at configurations X (k, nq); see `ReferenceModel.rates`."""
    V, Vd, _ = motion(tree, X, qd, qdd)
    _, J = jacobians(tree, X)
    _, drift = tree.drift(X, V)
    twists = np.einsum("kij,kj->ki", J, V)
    accelerations = np.einsum("kij,kj->ki", J, Vd) + drift
    return twists, accelerations


def tool_jacobians(tree: Tree, X: Array) -> Array:
    """Return the Jacobians (k, 6, n) from rates of the active joints to the tool twist in base, linear rows first.

    X (k, nq) are configurations with closed loops.
    """
    A, J = jacobians(tree, X)
    return J @ gains_of(tree, A, pseudoinverse_of(tree, A))
