"""Find the probable mistake in a tensor that does not fit its shapes: sign, decimal mark, axes, point of reference.

The stated tensor is compared with the tensor of the shapes filled with uniform density. Real bodies are not uniform, so
a difference alone is no evidence of a mistake. A mistake is reported only if one small change of the stated numbers
makes the misfit small (`UNEXPLAINED_MISFIT`, `FITTING_MISFIT`, `LARGEST_REMAINING_PART`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import permutations

import numpy as np

from twin.core.findings import Finding, warning
from twin.core.quantity import Quantity
from twin.core.spatial import Array

UNEXPLAINED_MISFIT = 0.35
"""Misfit (see `misfit`) from which an explanation is searched: that of hollow or mixed bodies is 0.1 to 0.3."""

FITTING_MISFIT = 0.3
"""Largest misfit with the explanation."""

LARGEST_REMAINING_PART = 0.35
"""Largest misfit with the explanation, as a part of the misfit without it."""

SMALLEST_PRODUCTS = 0.04
"""Relative size of the products of inertia below which their sign cannot be determined."""

CLEAR_MISFIT_RATIO = 2.0
"""If (misfit of second-best / misfit of best explanation) is smaller than this, the message names both."""

_WRONG_SIGN = "the products of inertia seem to have the wrong sign (+integral of x y dm)"
_FAR_FROM_CENTRE = 0.2
"""Parallel-axis term, relative to the tensor, from which a tensor about another point is recognised."""

_ENTRY_NAMES = ("xx", "yy", "zz", "xy", "xz", "yz")
_ENTRY_PLACES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""Names and places of the entries of a tensor, the moments first, then the products."""


def misfit(tensor: Array, shape: Array) -> float:
    """Return the norm of `tensor` - `shape` divided by the norm of `shape`; both are tensors per mass (3, 3)."""
    return float(np.linalg.norm(tensor - shape) / np.linalg.norm(shape))


def probable_mistakes(
    name: str, source: str, tensor: Array, centre: Array, mass: float, shape: Array | None
) -> list[Finding]:
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
    stated_misfit = misfit(tensor / mass, shape)
    if stated_misfit < UNEXPLAINED_MISFIT:
        return _sign_of_products(name, source, tensor, mass, shape)
    readings: list[tuple[float, str, str]] = []
    for kind, words, corrected in _possible_mistakes(tensor, centre, mass):
        readings.append((misfit(corrected / mass, shape), kind, words))
    best, kind, words = min(readings, key=lambda reading: reading[0])
    # among so many readings, one fits a little better by chance: it must fit well, and much better
    if best > FITTING_MISFIT or best > LARGEST_REMAINING_PART * stated_misfit:
        return []
    others: set[str] = set()
    for other_misfit, other_kind, _ in readings:
        if other_kind != kind and other_misfit < CLEAR_MISFIT_RATIO * best:
            others.add(other_kind)
    probable = _finding(kind, words, name=name, source=source, stated_deviation=stated_misfit, best=best)
    if others:
        listed = ", ".join(sorted(others))
        return [replace(probable, message=f"{probable.message}; {listed} would also explain it")]
    return [probable]


def _sign_of_products(name: str, source: str, tensor: Array, mass: float, shape: Array) -> list[Finding]:
    """Return a warning if the products of inertia fit the shapes only with the opposite sign.

    Products are small compared with the moments: their sign has little effect on the misfit of the tensor.
    """
    places_of_products = _ENTRY_PLACES[3:]
    rows, columns = zip(*places_of_products, strict=True)
    products = shape[rows, columns]
    stated = tensor[rows, columns] / mass
    size = np.linalg.norm(products)
    if size < SMALLEST_PRODUCTS * np.abs(shape).max():
        return []
    difference = np.linalg.norm(stated - products)
    difference_negated = np.linalg.norm(-stated - products)
    # products with the right sign differ from those of the shapes by less than their size
    if not (difference_negated < LARGEST_REMAINING_PART * difference and difference > size):
        return []
    return [
        _finding(
            "sign",
            _WRONG_SIGN,
            name=name,
            source=source,
            stated_deviation=float(difference),
            best=float(difference_negated),
        )
    ]


def _finding(kind: str, words: str, name: str, source: str, stated_deviation: float, best: float) -> Finding:
    """Return the warning on a mistake; `best` is the misfit after its correction, see `misfit`."""
    return warning(
        f"inertia.{kind}",
        name,
        f"{name}: {words}: deviation from the tensor of the filled shapes",
        size=Quantity(100 * stated_deviation, "%"),
        limit=100 * best,
        when=source,
        word="corrected",
    )


def _possible_mistakes(tensor: Array, centre: Array, mass: float) -> Iterator[tuple[str, str, Array]]:
    """Yield (kind of mistake, message, corrected tensor about the mass centre) for each possible mistake."""
    flipped = 2 * np.diag(np.diag(tensor)) - tensor
    yield "sign", _WRONG_SIGN, flipped
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
    for (i, j), entry in zip(_ENTRY_PLACES, _ENTRY_NAMES, strict=True):
        for power in (-2, -1, 1, 2):
            corrected = tensor.copy()
            corrected[i, j] = tensor[i, j] * 10.0**power
            corrected[j, i] = corrected[i, j]
            yield (
                "decimal",
                f"I{entry} seems to have lost its decimal mark ({tensor[i, j]:g} instead of {corrected[i, j]:g})",
                corrected,
            )
    parallel_axis_term = mass * ((centre @ centre) * np.eye(3) - np.outer(centre, centre))
    if np.abs(parallel_axis_term).max() > _FAR_FROM_CENTRE * np.abs(tensor).max():
        yield (
            "origin",
            "the stated tensor seems to be about the mass centre instead of the frame's origin",
            tensor + parallel_axis_term,
        )
        yield (
            "origin",
            "the stated tensor seems to be about the frame's origin instead of the mass centre",
            tensor - parallel_axis_term,
        )
