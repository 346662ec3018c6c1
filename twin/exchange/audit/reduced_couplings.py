"""Couplings of joints in a form that does not depend on how a file states them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

_ZERO_RATIO = 1e-6
"""Maximum absolute value of a coupling's ratio that counts as zero (rounding of single precision).

Before the comparison, the ratios are divided by the largest absolute ratio of the coupling."""


def reduced_couplings(
    couplings: Mapping[str, tuple[Mapping[str, float], float]],
) -> dict[str, tuple[dict[str, float], float]]:
    """Return couplings in reduced row echelon form; the key of a row is its first joint in alphabetical order.

    A coupling is ({joint: ratio}, constant): the sum of ratio times joint coordinate equals the constant. The reduced
    form does not depend on whether a file couples each of several joints to the next, or all to the first. Couplings
    with numbers that are not finite are left out.
    """
    coupled: set[str] = set()
    for ratios, _ in couplings.values():
        coupled |= ratios.keys()
    joints = sorted(coupled)
    rows = np.zeros((len(couplings), len(joints) + 1))
    for row, (ratios, total) in zip(rows, couplings.values(), strict=True):
        for joint, ratio in ratios.items():
            row[joints.index(joint)] = ratio
        row[-1] = total
    usable = np.isfinite(rows).all(axis=1) & rows[:, :-1].any(axis=1)
    rows = rows[usable]
    if not len(rows):
        return {}
    # Gauss-Jordan elimination with partial pivoting; rows that depend on others are zero and stay below the pivots.
    rows /= np.abs(rows[:, :-1]).max(axis=1, keepdims=True)
    couplings_by_first_joint: dict[str, tuple[dict[str, float], float]] = {}
    pivot_count = 0
    for column in range(len(joints)):
        if pivot_count == len(rows):
            break
        pivot = pivot_count + int(np.argmax(np.abs(rows[pivot_count:, column])))
        if abs(rows[pivot, column]) <= _ZERO_RATIO:
            continue
        rows[[pivot_count, pivot]] = rows[[pivot, pivot_count]]
        rows[pivot_count] /= rows[pivot_count, column]
        others = np.arange(len(rows)) != pivot_count
        rows[others] -= rows[others, column, None] * rows[pivot_count]
        pivot_count += 1
    for row in rows[:pivot_count]:
        ratios = {}
        for joint, ratio in zip(joints, row[:-1], strict=True):
            if abs(ratio) > _ZERO_RATIO:
                ratios[joint] = float(ratio)
        first = next(iter(ratios))
        couplings_by_first_joint[first] = (ratios, float(row[-1]))
    return couplings_by_first_joint
