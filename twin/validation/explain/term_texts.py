"""Short formulas for values: terms and factors made of symbols and expressions, each known by its values at poses."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from twin.core.spatial import Array

EQUAL = 1e-6
"""Relative difference up to which a formula gives the required value; the edit is then tried like any other."""

_MOST_FACTORS = 60
"""Maximum number of values of which products are made."""
NUMBERS = {
    **{
        1.0: "1",
        2.0: "2",
        3.0: "3",
        4.0: "4",
        0.5: "1 / 2",
        0.25: "1 / 4",
        1 / 3: "1 / 3",
        2 / 3: "2 / 3",
        1.5: "3 / 2",
    },
    **{np.pi: "pi", np.pi / 2: "pi / 2", 2 * np.pi: "2 * pi", np.pi / 3: "pi / 3", 2 * np.pi / 3: "2 * pi / 3"},
    **{np.sqrt(3): "sqrt(3)", np.sqrt(3) / 2: "sqrt(3) / 2", np.sqrt(3) / 3: "sqrt(3) / 3"},
    **{np.sqrt(3) / 6: "sqrt(3) / 6", np.sqrt(2): "sqrt(2)", np.sqrt(2) / 2: "sqrt(2) / 2"},
}
"""Numbers that terms and factors may be."""


@dataclass(frozen=True)
class Atom:
    """A value of which terms and factors are made: its text and its values (k,)."""

    text: str
    values: Array


def equal(a: Array, b: Array) -> bool:
    """Return whether two arrays of values are equal, except for rounding."""
    return bool(np.abs(a - b).max() <= EQUAL * max(float(np.abs(a).max()), 1e-9))


def terms(wanted: Array, atoms: Sequence[Atom]) -> Iterator[tuple[str, str]]:
    """Yield (sign, text) of terms with the values `wanted` (k,)."""
    for value, text in NUMBERS.items():
        for sign, factor in (("+", 1.0), ("-", -1.0)):
            if equal(wanted, np.full(len(wanted), factor * value)):
                yield sign, text
    for coefficient, text in _products(wanted, atoms):
        sign = "-" if coefficient < 0 else "+"
        size = abs(coefficient)
        number = number_text(size)
        if number is not None:
            yield sign, text if number == "1" else f"{number} * {text}"


def sums(wanted: Array, patterns: Sequence[Sequence[Atom]]) -> Iterator[str]:
    """Yield the texts, with signs, of sums of several terms with the values `wanted` (k,).

    Each pattern contains the terms of a sum elsewhere; terms may be left out, or have the other sign.
    """
    limit = EQUAL * max(float(np.abs(wanted).max()), 1e-9)
    for pattern in patterns:
        A = np.stack([a.values for a in pattern], axis=1)
        if not np.isfinite(A).all() or np.linalg.matrix_rank(A) < len(pattern):
            continue
        coefficients = np.round(np.linalg.lstsq(A, wanted, rcond=None)[0])
        if np.abs(coefficients).max() != 1 or np.abs(A @ coefficients - wanted).max() > limit:
            continue
        signs = {1.0: "+", -1.0: "-"}
        parts = [f"{signs[c]} {a.text}" for a, c in zip(pattern, coefficients, strict=True) if c]
        if len(parts) > 1:  # single terms are found by `terms`
            yield " ".join(parts)


def factors(wanted: Array, atoms: Sequence[Atom]) -> Iterator[str]:
    """Yield the texts of factors with the values `wanted` (k,)."""
    for value, text in NUMBERS.items():
        if value != 1.0 and equal(wanted, np.full(len(wanted), value)):
            yield text
    for coefficient, text in _products(wanted, atoms):
        if equal(np.array([coefficient]), np.ones(1)):
            yield text
    yield from _differences(wanted, atoms)


def _differences(wanted: Array, atoms: Sequence[Atom]) -> Iterator[str]:
    """Yield the texts of differences of two names with the values `wanted` (k,), which vary from pose to pose."""
    if np.ptp(wanted) <= EQUAL * np.abs(wanted).max():  # lengths often have the same differences
        return
    names = [a for a in atoms if a.text.isidentifier()]
    limit = EQUAL * max(float(np.abs(wanted).max()), 1e-9)
    for first in names:
        for second in names:
            if np.abs(first.values - second.values - wanted).max() <= limit:
                yield f"({first.text} - {second.text})"


def number_text(size: float) -> str | None:
    """Return the text of a number of `NUMBERS`; None for other numbers."""
    return next((text for value, text in NUMBERS.items() if abs(size / value - 1) < EQUAL), None)


def _products(wanted: Array, atoms: Sequence[Atom]) -> Iterator[tuple[float, str]]:
    """Yield (coefficient, text) of atoms, then of squares and products of two, that are proportional to `wanted`."""
    if not atoms:
        return
    A = np.stack([a.values for a in atoms])
    texts = [in_product(a.text) for a in atoms]
    for i, coefficient in _proportional(wanted, A):
        yield coefficient, texts[i]
    if np.ptp(wanted) <= EQUAL * np.abs(wanted).max():  # products of decimal numbers often coincide
        for i, coefficient in _proportional(wanted, A**2):
            yield coefficient, f"{texts[i]}**2"
        return
    A = A[:_MOST_FACTORS]
    first, second = np.triu_indices(len(A))
    for n, coefficient in _proportional(wanted, A[first] * A[second]):
        i, j = first[n], second[n]
        yield coefficient, f"{texts[i]}**2" if i == j else f"{texts[i]} * {texts[j]}"


def _proportional(wanted: Array, rows: Array) -> Iterator[tuple[int, float]]:
    """Yield (index, coefficient) of the rows (n, k) that are proportional to `wanted` (k,)."""
    with np.errstate(all="ignore"):
        coefficients = (rows @ wanted) / np.sum(rows**2, axis=1)
        off = np.abs(coefficients[:, None] * rows - wanted).max(axis=1)
    limit = EQUAL * max(float(np.abs(wanted).max()), 1e-9)
    for i in np.flatnonzero(off <= limit):
        yield int(i), float(coefficients[i])


def in_product(text: str) -> str:
    """Return the text of a factor of a product, in parentheses where it needs them."""
    return f"({text})" if isinstance(ast.parse(text, mode="eval").body, ast.BinOp | ast.UnaryOp) else text
