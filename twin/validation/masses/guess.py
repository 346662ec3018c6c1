"""Which slip of the pen explains a tensor that its shapes do not have: sign, decimal mark, axes, point of reference.

The shapes, filled evenly, have a tensor of their own. No real body is filled evenly: a difference proves nothing. But
where one small change of the stated numbers turns a bad match into a good one, and no other change does, it is named.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import permutations

import numpy as np

from twin.core.findings import Finding
from twin.core.spatial import Array

BAD, GOOD, GAIN = 0.35, 0.3, 0.35
"""Relative misfit that asks for an explanation; the one that explains; and how much better it must be than what is
stated. Hollow and mixed bodies differ from filled shapes by 0.1 to 0.3."""

SIGN = 0.04
"""Size of the products over the largest moment below which their sign cannot be told."""

CLEAR = 2.0
"""Factor by which the best explanation must be better than another kind of explanation."""

_NAMES = ("xx", "yy", "zz", "xy", "xz", "yz")
_PLACES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


def misfit(tensor: Array, shape: Array) -> float:
    """Return how far two tensors per mass (3, 3) are apart, relative to the second."""
    return float(np.linalg.norm(tensor - shape) / np.linalg.norm(shape))


def guesses(name: str, source: str, tensor: Array, centre: Array, mass: float, shape: Array | None) -> list[Finding]:
    """Return what a body's tensor seems to suffer from; nothing if it fits, or if nothing explains it.

    Args:
        name: of the body.
        source: where it is stated.
        tensor: (3, 3) kg m2 about the mass centre, as stated.
        centre: (3,) m, mass centre in the frame of the tensor.
        mass: kg.
        shape: (3, 3) m2, tensor per mass of the shapes about their own centre; None: there is nothing to compare with.
    """
    if shape is None:
        return []
    now = misfit(tensor / mass, shape)
    tried = sorted(_readings(tensor, centre, mass), key=lambda r: misfit(r[2] / mass, shape))
    signs = [r for r in tried if r[0] == "sign"]
    if now < BAD:
        # products are small beside the moments: their signs have a measure of their own
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
        return [Finding(found.code, "warning", f"{found.message}; {', '.join(others)} would explain it as well",
                        found.where, found.when, found.size, found.unit, found.limit)]  # fmt: skip
    return [found]


def _finding(kind: str, words: str, name: str, source: str, now: float, best: float) -> Finding:
    text = f"{name}: {words}: the tensor is {100 * now:.0f} % off that of its filled shapes, so read {100 * best:.0f} %"
    return Finding(f"inertia.{kind}", "warning", text, name, source, 100 * now, "%", 100 * best)


def _readings(tensor: Array, centre: Array, mass: float) -> Iterator[tuple[str, str, Array]]:
    """Yield (kind, words, tensor about the mass centre) of every other reading of the stated numbers."""
    flipped = 2 * np.diag(np.diag(tensor)) - tensor
    yield "sign", "the products of inertia seem to have the other sign (+integral of x y dm)", flipped
    for order in permutations(range(3)):
        if order != (0, 1, 2):
            axes = "".join("xyz"[i] for i in order)
            yield (
                "axes",
                f"the axes seem to be exchanged (x y z stated for {' '.join(axes)})",
                tensor[np.ix_(order, order)],
            )
    for power in (-3, -2, -1, 1, 2, 3):
        words = f"the whole tensor seems to be {10.0**-power:g} times what it is (a lost decimal mark, or its unit)"
        yield "decimal", words, tensor * 10.0**power
    for (i, j), entry in zip(_PLACES, _NAMES, strict=True):
        for power in (-2, -1, 1, 2):
            other = tensor.copy()
            other[i, j] = other[j, i] = tensor[i, j] * 10.0**power
            yield (
                "decimal",
                f"I{entry} seems to have lost its decimal mark ({tensor[i, j]:g} for {other[i, j]:g})",
                other,
            )
    far = mass * ((centre @ centre) * np.eye(3) - np.outer(centre, centre))
    if np.abs(far).max() > 0.2 * np.abs(tensor).max():
        yield (
            "origin",
            "the tensor seems to be about the mass centre already, where the frame's origin is said",
            tensor + far,
        )
        yield "origin", "the tensor seems to be about the frame's origin, where the mass centre is said", tensor - far
