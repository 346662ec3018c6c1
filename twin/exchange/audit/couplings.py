"""Convert couplings of joints to a unique form, because files may state the same constraints differently."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

_SAME = 1e-6
"""Magnitude up to which a ratio counts as zero, after each row is divided by its largest ratio (single precision)."""


def solved(couplings: Mapping[str, tuple[Mapping[str, float], float]]) -> dict[str, tuple[dict[str, float], float]]:
    """Return couplings in reduced row echelon form; the key of a row is its first joint in alphabetical order.

    The form is the same whether a file couples each joint of a chain to the next or all joints to the first. Couplings
    with numbers that are not finite are left out.

    Args:
        couplings: (ratios by joint, constant sum of ratio times joint coordinate) by name.
    """
    joints = sorted({n for ratios, _ in couplings.values() for n in ratios})
    rows = np.array([[*(ratios.get(n, 0.0) for n in joints), total] for ratios, total in couplings.values()], float)
    rows = rows[np.isfinite(rows).all(axis=1) & rows[:, :-1].any(axis=1)] if len(rows) else rows
    if not len(rows):
        return {}
    rows /= np.abs(rows[:, :-1]).max(axis=1, keepdims=True)
    out: dict[str, tuple[dict[str, float], float]] = {}
    done = 0
    for k in range(len(joints)):
        if done == len(rows):
            break
        at = done + int(np.argmax(np.abs(rows[done:, k])))
        if abs(rows[at, k]) <= _SAME:
            continue
        rows[[done, at]] = rows[[at, done]]
        rows[done] /= rows[done, k]
        others = np.arange(len(rows)) != done
        rows[others] -= rows[others, k, None] * rows[done]
        done += 1
    for row in rows[:done]:
        ratios = {n: float(r) for n, r in zip(joints, row[:-1], strict=True) if abs(r) > _SAME}
        out[next(iter(ratios))] = ratios, float(row[-1])
    return out
