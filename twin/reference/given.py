"""Check joint values passed by callers."""

from __future__ import annotations

import numpy as np

from twin.core.errors import MechanismError
from twin.core.spatial import Array
from twin.model.mechanism import Mechanism


def one(mechanism: Mechanism, q: Array) -> Array:
    """Check active joint values q in m or rad, and return them as an array (n,).

    Raises:
        MechanismError: q has the wrong length or is not finite.
    """
    q = np.asarray(q, float)
    names = [j.name for j in mechanism.active]
    if q.shape != (len(names),):
        raise MechanismError(f"q has shape {q.shape}; expected ({len(names)},) for {', '.join(names)}")
    if not np.all(np.isfinite(q)):
        values = dict(zip(names, q.tolist(), strict=True))
        raise MechanismError(f"q is not finite: {values}")
    return q


def along(mechanism: Mechanism, q: Array) -> Array:
    """Check active joint values q in m or rad along a motion, and return them as an array (k, n).

    Raises:
        MechanismError: q has the wrong shape or is not finite; the message names the sample.
    """
    q = np.asarray(q, float)
    names = [j.name for j in mechanism.active]
    if q.ndim != 2 or q.shape[1] != len(names):
        raise MechanismError(f"q has shape {q.shape}; expected (k, {len(names)}) for {', '.join(names)}")
    if not len(q):
        raise MechanismError("q has no samples")
    finite = np.isfinite(q).all(axis=1)
    if not finite.all():
        k = int(np.argmin(finite))
        values = dict(zip(names, q[k].tolist(), strict=True))
        raise MechanismError(f"q is not finite at sample {k}: {values}")
    return q
