"""Short formulas for values: terms and factors made of scalars, each known by its values at poses."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np
from numpy.typing import NDArray

from twin.core.spatial import Array

RELATIVE_ROUNDING = 1e-6
"""Relative difference up to which a formula gives the required value; the edit is then tried like any other."""

_MOST_FACTORS = 60
"""Maximum number of values of which products are made."""

_SMALLEST_COMPARED_SIZE = 1e-9
"""Size in m or rad below which values are compared as if they had this size: they are rounding of zero."""

SIGNS = (("+", 1.0), ("-", -1.0))
"""The signs of a term, and their values."""

NUMBERS = {
    1.0: "1",
    2.0: "2",
    3.0: "3",
    4.0: "4",
    0.5: "1 / 2",
    0.25: "1 / 4",
    1 / 3: "1 / 3",
    2 / 3: "2 / 3",
    1.5: "3 / 2",
    np.pi: "pi",
    np.pi / 2: "pi / 2",
    2 * np.pi: "2 * pi",
    np.pi / 3: "pi / 3",
    2 * np.pi / 3: "2 * pi / 3",
    np.sqrt(3): "sqrt(3)",
    np.sqrt(3) / 2: "sqrt(3) / 2",
    np.sqrt(3) / 3: "sqrt(3) / 3",
    np.sqrt(3) / 6: "sqrt(3) / 6",
    np.sqrt(2): "sqrt(2)",
    np.sqrt(2) / 2: "sqrt(2) / 2",
}
"""Numbers that terms and factors may be."""


@dataclass(frozen=True)
class Atom:
    """A value of which terms and factors are made: its text and its values (k,)."""

    text: str
    values: Array


def at_poses(atoms: Sequence[Atom], poses: NDArray[np.bool_]) -> list[Atom]:
    """Return atoms with their values only at the selected poses (k,)."""
    selected: list[Atom] = []
    for atom in atoms:
        selected.append(Atom(atom.text, atom.values[poses]))
    return selected


def _table_of_values(atoms: Sequence[Atom]) -> Array:
    """Return the values (n, k) of n atoms."""
    values = [atom.values for atom in atoms]
    return np.stack(values)


def are_equal(a: Array, b: Array) -> bool:
    """Return whether two arrays of values are equal, except for rounding."""
    return bool(np.abs(a - b).max() <= difference_limit(a))


def difference_limit(values: Array) -> float:
    """Return the largest difference from values that counts as rounding."""
    return RELATIVE_ROUNDING * max(_largest_value(values), _SMALLEST_COMPARED_SIZE)


def _largest_value(values: Array) -> float:
    return float(np.abs(values).max())


def _is_constant(values: Array) -> bool:
    """Return whether values (k,) are the same at all poses; formulas for such values often coincide."""
    return bool(np.ptp(values) <= RELATIVE_ROUNDING * np.abs(values).max())


def terms(required: Array, atoms: Sequence[Atom]) -> Iterator[tuple[str, str]]:
    """Yield (sign, text) of terms with the values `required` (k,)."""
    for value, text in NUMBERS.items():
        for sign, factor in SIGNS:
            if are_equal(required, np.full(len(required), factor * value)):
                yield sign, text
    for coefficient, text in _products(required, atoms):
        sign = "-" if coefficient < 0 else "+"
        number = number_text(abs(coefficient))
        if number == "1":
            yield sign, text
        elif number is not None:
            yield sign, f"{number} * {text}"


def sums(required: Array, patterns: Sequence[Sequence[Atom]]) -> Iterator[str]:
    """Yield the texts, with signs, of sums of several terms with the values `required` (k,).

    Each pattern contains the terms of a sum elsewhere; terms may be left out, or have the other sign.
    """
    limit = difference_limit(required)
    for pattern in patterns:
        A = _table_of_values(pattern).T
        if not np.isfinite(A).all() or np.linalg.matrix_rank(A) < len(pattern):
            continue
        solution, *_ = np.linalg.lstsq(A, required, rcond=None)
        coefficients = np.round(solution)
        if np.abs(coefficients).max() != 1 or np.abs(A @ coefficients - required).max() > limit:
            continue
        signed_terms: list[str] = []
        for atom, coefficient in zip(pattern, coefficients, strict=True):
            if coefficient:
                sign = "+" if coefficient > 0 else "-"
                signed_terms.append(f"{sign} {atom.text}")
        if len(signed_terms) > 1:  # single terms are found by `terms`
            yield " ".join(signed_terms)


def factors(required: Array, atoms: Sequence[Atom]) -> Iterator[str]:
    """Yield the texts of factors with the values `required` (k,)."""
    for value, text in NUMBERS.items():
        if value != 1.0 and are_equal(required, np.full(len(required), value)):
            yield text
    for coefficient, text in _products(required, atoms):
        if _is_number(coefficient, 1.0):
            yield text
        elif _is_number(coefficient, 2.0):
            yield f"2 * {text}"
    yield from _differences(required, atoms)


def roots(required: Array, atoms: Sequence[Atom], root: str) -> Iterator[str]:
    """Yield the texts of square roots with the values `required` (k,): of an atom, or of a sum of two squares.

    `root` is the name of the function. Values that are the same at all poses are no proof, so that none is yielded.
    """
    if not atoms or required.min() < 0 or np.ptp(required) <= RELATIVE_ROUNDING * required.max():
        return
    few = atoms[:_MOST_FACTORS]
    radicand = required**2
    values = _table_of_values(few)
    for i, coefficient in _proportional(radicand, values):
        if _is_number(coefficient, 1.0):
            yield f"{root}({few[i].text})"
    squares = values**2
    limit = RELATIVE_ROUNDING * float(radicand.max())
    is_something = np.abs(squares).max(axis=1) > limit
    for first in np.flatnonzero(is_something).tolist():
        for sign, factor in SIGNS:
            unexplained = radicand - squares[first] - factor * squares
            fits = np.abs(unexplained).max(axis=1) <= limit
            for second in np.flatnonzero(fits & is_something).tolist():
                if sign == "-" or first < second:  # a sum of two squares has no order
                    first_text = as_factor(few[first].text)
                    second_text = as_factor(few[second].text)
                    yield f"{root}({first_text}**2 {sign} {second_text}**2)"


def _differences(required: Array, atoms: Sequence[Atom]) -> Iterator[str]:
    """Yield the texts of differences of two names with the values `required` (k,), which vary from pose to pose."""
    if _is_constant(required):  # lengths often have the same differences
        return
    limit = difference_limit(required)
    for first, second in permutations(_names(atoms), 2):
        if np.abs(first.values - second.values - required).max() <= limit:
            yield f"({first.text} - {second.text})"


def _names(atoms: Sequence[Atom]) -> list[Atom]:
    """Return the atoms of which differences are factors: those that are plain names."""
    return [atom for atom in atoms if atom.text.isidentifier()]


def number_text(size: float) -> str | None:
    """Return the text of a number of `NUMBERS`; None for other numbers."""
    for value, text in NUMBERS.items():
        if abs(size / value - 1) < RELATIVE_ROUNDING:
            return text
    return None


def _is_number(coefficient: float, number: float) -> bool:
    """Return whether a coefficient is a number, except for rounding."""
    return are_equal(np.array([coefficient]), np.array([number]))


def _products(required: Array, atoms: Sequence[Atom]) -> Iterator[tuple[float, str]]:
    """Yield (coefficient, text) of atoms, then of squares and products of two, that are proportional to `required`."""
    if not atoms:
        return
    A = _table_of_values(atoms)
    for i, coefficient in _proportional(required, A):
        yield coefficient, as_factor(atoms[i].text)
    for i, coefficient in _proportional(required, A**2):
        yield coefficient, f"{as_factor(atoms[i].text)}**2"
    if _is_constant(required):  # products of decimal numbers often coincide
        return
    first, second = _two_factors(len(A))
    for n, coefficient in _proportional(required, A[first] * A[second]):
        first_text = as_factor(atoms[first[n]].text)
        second_text = as_factor(atoms[second[n]].text)
        yield coefficient, f"{first_text} * {second_text}"


def _two_factors(count: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the indices of the first and of the second factors of the products of two of `count` atoms."""
    return np.triu_indices(min(count, _MOST_FACTORS), 1)


def _proportional(required: Array, rows: Array) -> Iterator[tuple[int, float]]:
    """Yield (index, coefficient) of the rows (n, k) that are proportional to `required` (k,)."""
    with np.errstate(all="ignore"):
        coefficients = (rows @ required) / np.sum(rows**2, axis=1)
        differences = np.abs(coefficients[:, None] * rows - required).max(axis=1)
    for i in np.flatnonzero(differences <= difference_limit(required)):
        yield int(i), float(coefficients[i])


class Products:
    """The values of all that `terms` and `factors` may be made of, to look up many required values at once.

    Attributes:
        table: values (n, k) of the atoms, of their squares and of products of two.
    """

    def __init__(self, atoms: Sequence[Atom]) -> None:
        """Multiply the values (k,) of atoms; those without a value at a pose are left out."""
        finite = [atom for atom in atoms if np.isfinite(atom.values).all()]
        self.table: Array = np.zeros((0, 1))
        self._units = self.table
        """Unit vectors in the directions of the table's rows, and of the differences of names."""
        if not finite:
            return
        A = _table_of_values(finite)
        first, second = _two_factors(len(A))
        self.table = np.vstack([A, A**2, A[first] * A[second]])
        differences: list[Array] = []
        for minuend, subtrahend in combinations(_names(finite), 2):  # the other order has the reversed direction
            difference = minuend.values - subtrahend.values
            if not _is_constant(difference):  # else it has the direction of a number
                differences.append(difference)
        rows = np.vstack([self.table, *differences])
        sizes = np.linalg.norm(rows, axis=1, keepdims=True)
        self._units = rows / np.where(sizes > 0, sizes, 1.0)

    def likely(self, required: Array) -> NDArray[np.intp]:
        """Return the indices of the rows of `required` (n, k) that are numbers, or proportional to one of the values.

        These rows are looked up by `terms` or `factors`, one by one; these find nothing for the others, except where
        all values are so small that they are rounding of zero.
        """
        k = required.shape[1]
        with np.errstate(all="ignore"):
            rows = required / np.linalg.norm(required, axis=1, keepdims=True)
        rows = np.where(np.isfinite(rows).all(axis=1, keepdims=True), rows, 0.0)
        cosines = np.abs(rows.sum(axis=1)) / np.sqrt(k)  # with a number, the same at all poses
        if len(self._units):
            cosines = np.maximum(cosines, np.abs(rows @ self._units.T).max(axis=1))
        # Entries that differ by EQUAL make an angle whose cosine is smaller than 1 by about its square, for each entry.
        least = 1 - RELATIVE_ROUNDING**2 * k
        return np.flatnonzero(cosines >= least)

    def either(self, first: Array, second: Array) -> Array:
        """Return the products (n, k), or their negatives, that have one of two required values (k,) at each pose."""
        if not len(self.table) or not (np.isfinite(first).all() and np.isfinite(second).all()):
            return np.zeros((0, len(first)))
        limit = max(difference_limit(first), difference_limit(second))
        matches: list[Array] = []
        for sign in (1.0, -1.0):
            signed = sign * self.table
            nearest = np.minimum(np.abs(signed - first), np.abs(signed - second))
            matches.append(signed[nearest.max(axis=1) <= limit])
        return np.vstack(matches)


def as_factor(text: str) -> str:
    """Return the text of a factor of a product, in parentheses where it needs them."""
    expression = ast.parse(text, mode="eval").body
    if isinstance(expression, ast.BinOp | ast.UnaryOp):
        return f"({text})"
    return text
