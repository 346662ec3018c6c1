"""Find the probable mistake in a tensor that does not fit its shapes: sign, decimal mark, axes, point of reference.

The stated tensor is compared with the tensor of the shapes filled with uniform density. Real bodies are not uniform, so
a difference alone is no evidence of a mistake. A mistake is reported only if one small change of the stated numbers
makes the misfit small (`BAD`, `GOOD`, `GAIN`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import permutations

import numpy as np

from twin.core.findings import Finding, warning
from twin.core.quantity import Quantity
from twin.core.spatial import Array

BAD, GOOD, GAIN = 0.35, 0.3, 0.35
"""Limits of the misfit (see `misfit`) between the stated tensor and the tensor of the filled shapes.

If the misfit exceeds BAD, the check searches for an explanation. With the explanation, the misfit must be below GOOD,
and below GAIN times the original misfit. Bodies that are hollow or of mixed materials have a misfit of 0.1 to 0.3.
"""

SIGN = 0.04
"""Relative size of the products of inertia below which their sign cannot be determined."""

CLEAR = 2.0
"""If (misfit of second-best / misfit of best explanation) is smaller than this, the message names both."""

_NAMES = ("xx", "yy", "zz", "xy", "xz", "yz")
_PLACES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


def misfit(tensor: Array, shape: Array) -> float:
    """Return the norm of `tensor` - `shape` divided by the norm of `shape`; both are tensors per mass (3, 3)."""
    return float(np.linalg.norm(tensor - shape) / np.linalg.norm(shape))


def guesses(name: str, source: str, tensor: Array, centre: Array, mass: float, shape: Array | None) -> list[Finding]:
    """Return a warning with the probable mistake in a body's tensor; an empty list if it fits or no mistake is found.

    Args:
        name: name of the body.
        source: name of the source of the tensor.
        tensor: (3, 3) in kg m2 about the mass centre, as stated.
        centre: (3,) in m, mass centre in the frame of the tensor.
        mass: mass in kg.
        shape: (3, 3) in m2, tensor per mass of the shapes about their own centre; None: no shapes to compare.
    """
    if shape is None:
        return []
    now = misfit(tensor / mass, shape)
    tried = sorted(_readings(tensor, centre, mass), key=lambda r: misfit(r[2] / mass, shape))
    signs = [r for r in tried if r[0] == "sign"]
    if now < BAD:
        # Products are small compared with the moments: their sign has little effect on the misfit of the tensor.
        products = np.array([shape[p] for p in _PLACES[3:]])
        stated = np.array([tensor[p] / mass for p in _PLACES[3:]])
        if np.linalg.norm(products) < SIGN * np.abs(shape).max():
            return []
        off = np.linalg.norm(stated - products)
        turned = np.linalg.norm(-stated - products)
        if not (signs and turned < GAIN * off and off > np.linalg.norm(products)):
            return []
        return [_finding("sign", signs[0][1], name, source, float(off), float(turned))]
    kind, words, better = tried[0]
    best = misfit(better / mass, shape)
    if best > GOOD or best > GAIN * now:
        return []
    others = sorted({r[0] for r in tried[1:] if misfit(r[2] / mass, shape) < CLEAR * best and r[0] != kind})
    found = _finding(kind, words, name, source, now, best)
    if others:
        return [replace(found, message=f"{found.message}; {', '.join(others)} would also explain it")]
    return [found]


def _finding(kind: str, words: str, name: str, source: str, now: float, best: float) -> Finding:
    return warning(
        f"inertia.{kind}",
        name,
        f"{name}: {words}: deviation from the tensor of the filled shapes",
        Quantity(100 * now, "%"),
        100 * best,
        when=source,
        word="corrected",
    )


def _readings(tensor: Array, centre: Array, mass: float) -> Iterator[tuple[str, str, Array]]:
    """Yield (kind of mistake, message, corrected tensor about the mass centre) for each possible mistake."""
    flipped = 2 * np.diag(np.diag(tensor)) - tensor
    yield "sign", "the products of inertia seem to have the wrong sign (+integral of x y dm)", flipped
    for order in permutations(range(3)):
        if order != (0, 1, 2):
            axes = "".join("xyz"[i] for i in order)
            yield (
                "axes",
                f"the axes seem to be exchanged (stated as x y z, but meant as {' '.join(axes)})",
                tensor[np.ix_(order, order)],
            )
    for power in (-3, -2, -1, 1, 2, 3):
        words = f"the tensor seems to be {10.0**-power:g} times its correct value (lost decimal mark, or wrong unit)"
        yield "decimal", words, tensor * 10.0**power
    for (i, j), entry in zip(_PLACES, _NAMES, strict=True):
        for power in (-2, -1, 1, 2):
            other = tensor.copy()
            other[i, j] = other[j, i] = tensor[i, j] * 10.0**power
            yield (
                "decimal",
                f"I{entry} seems to have lost its decimal mark ({tensor[i, j]:g} instead of {other[i, j]:g})",
                other,
            )
    far = mass * ((centre @ centre) * np.eye(3) - np.outer(centre, centre))
    if np.abs(far).max() > 0.2 * np.abs(tensor).max():
        yield (
            "origin",
            "the stated tensor seems to be about the mass centre instead of the frame's origin",
            tensor + far,
        )
        yield (
            "origin",
            "the stated tensor seems to be about the frame's origin instead of the mass centre",
            tensor - far,
        )
