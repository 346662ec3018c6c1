"""Checks of joint values given by callers."""

from __future__ import annotations

import numpy as np

from twin.core.errors import MechanismError
from twin.core.spatial import Array
from twin.model.mechanism import Mechanism


def one(mechanism: Mechanism, q: Array) -> Array:
    """Return active joints (n,) in m or rad.

    Raises:
        MechanismError: they have the wrong length, or are not finite.
    """
    q = np.asarray(q, float)
    names = [j.name for j in mechanism.active]
    if q.shape != (len(names),):
        raise MechanismError(f"q has shape {q.shape}; expected ({len(names)},) for {', '.join(names)}")
    if not np.all(np.isfinite(q)):
        raise MechanismError(f"q is not finite: {dict(zip(names, q.tolist(), strict=True))}")
    return q


def along(mechanism: Mechanism, q: Array) -> Array:
    """Return active joints (k, n) along a motion.

    Raises:
        MechanismError: they have the wrong shape, or are not finite; the message gives the sample.
    """
    q = np.asarray(q, float)
    names = [j.name for j in mechanism.active]
    if q.ndim != 2 or q.shape[1] != len(names):
        raise MechanismError(f"q has shape {q.shape}; expected (k, {len(names)}) for {', '.join(names)}")
    if not len(q):
        raise MechanismError("q has no samples")
    if not np.isfinite(q).all():
        k = int(np.argmin(np.isfinite(q).all(axis=1)))
        raise MechanismError(f"q is not finite at sample {k}: {dict(zip(names, q[k].tolist(), strict=True))}")
    return q
