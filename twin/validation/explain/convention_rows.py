"""Rows that are wrong under one convention and agree under another: what all searches for conventions compare."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from twin.validation.explain.equation_steps import RowKey, RowPlace
from twin.validation.explain.explanation_data import Convention
from twin.validation.explain.row_deviations import Judge, worst


@dataclass(frozen=True)
class FixedRows:
    """Wrong rows that agree under another convention.

    Attributes:
        places: the rows.
        residual: their largest residual under this convention, in units of the tolerance.
    """

    places: list[RowPlace]
    residual: float

    def convention(self, kind: str, message: str) -> Convention:
        """Return the convention as a result."""
        return Convention(kind, message, row_names(self.places), self.residual)


def rows_fixed_by(judge: Judge, other_judge: Judge) -> FixedRows | None:
    """Return the rows that are wrong in `judge` and agree in `other_judge`, which has another convention.

    Return None if there is no such row, or if a row that agrees in `judge` is wrong in `other_judge`.
    """
    failing = judge.failing()
    other_residuals: dict[RowKey, float] = {}
    for place, residual in other_judge.residuals.items():
        other_residuals[place.key] = worst(residual)
    for place in judge.residuals:
        # Helpers have no printed rows of their own: a convention may change what they pass on.
        if place in failing or judge.step(place.equation).stage == "helper":
            continue
        if other_residuals.get(place.key, np.inf) > 1:
            return None
    fixed: list[RowPlace] = []
    largest = 0.0
    for place in failing:
        residual = other_residuals.get(place.key, np.inf)
        if residual <= 1:
            fixed.append(place)
            largest = max(largest, residual)
    if not fixed:
        return None
    return FixedRows(fixed, largest)


def any_row_agrees(judge: Judge, places: Sequence[RowPlace]) -> bool:
    """Return whether at least one of some rows agrees in a judge."""
    rows = {place.key for place in places}
    for place, residual in judge.residuals.items():
        if place.key not in rows:
            continue
        if worst(residual) <= 1:
            return True
    return False


def row_names(places: Iterable[RowPlace]) -> tuple[str, ...]:
    """Return the names of rows, equation and symbol."""
    return tuple(place.name for place in places)
