"""Judge by gradients whether an edited row of an implicit equation still determines its unknown.

An implicit equation uses its own outputs: q1 = f(q1, q2), q2 = g(q1, q2). If an edit makes one of its rows a copy of
another one, or q1 = q1, the row agrees at every pose, and the equation no longer determines all its outputs. At such a
row, the gradient of right minus left side with respect to the outputs is a combination of those of the other rows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from twin.core.spatial import Array
from twin.validation.explain.candidate import Candidate, edited_residuals
from twin.validation.explain.equation_steps import RowKey, Step
from twin.validation.explain.function_source import Edit
from twin.validation.explain.row_deviations import Judge

_DERIVATIVE_STEP = 1e-5
"""Step (m, rad) of numeric derivatives with respect to the unknowns of an implicit equation."""

_SMALLEST_SINGULAR_RATIO = 1e-8
"""Relative singular value below which gradients of several rows count as parallel."""

_LEAST_SHARE_OF_POSES = 0.5
"""Part of the poses at which a row must determine its unknown; at single poses, gradients may be parallel."""

_LEAST_OUTSIDE_COMPONENT = 1e-6
"""Minimum size of the component of a row's gradient outside the span of the other rows' gradients.

The gradient is in SI and not scaled: its entry for the left side is -1, if the right side does not depend on it."""

_SHORTEST_GRADIENT = 1e-6
"""Length of a gradient below which it has no direction; it is not made longer."""


class DeterminedUnknowns:
    """Gradients of the rows of implicit equations at the mechanism's poses."""

    def __init__(self, judge: Judge) -> None:
        """Store the judge of the unedited formula."""
        self.judge = judge
        self._stepped: dict[tuple[str, str, int], Judge] = {}
        """Judges with one unknown moved by a step, by equation, symbol and sign of the step."""

    def determines(self, candidate: Candidate, row: RowKey) -> bool:
        """Return whether an edited row still determines its unknown, together with the other rows of the equation.

        Only an equation that uses its own outputs can fail this check. The gradient of the edited row must not be in
        the span of the other gradients, at more than `_LEAST_SHARE_OF_POSES` of the poses.
        """
        step = self.judge.step(row[0])
        unknowns = _own_unknowns(step, candidate.edits)
        if not unknowns:
            return True
        kinds: dict[RowKey, str] = {}
        is_scalar = False
        for place, residual in self.judge.residuals.items():
            if place.equation == row[0]:
                kinds[place.key] = self.judge.reference.kinds[place.symbol]
            if place.key == row:
                is_scalar = residual.shape[1] == 1
        if not is_scalar:
            return True
        gradients = self._gradients(candidate, row[0], unknowns, kinds)
        if gradients is None:
            return False
        own_gradient = gradients.pop(row)
        has_value = np.isfinite(own_gradient).all(axis=1)
        if not has_value.any():
            return False
        outside = own_gradient
        if gradients:
            unit_gradients: list[Array] = []
            for gradient in gradients.values():
                unit_gradients.append(_unit_gradients(gradient))
            A = np.stack(unit_gradients, axis=1)  # (k, rows, unknowns)
            # pinv(A) A is the orthogonal projection on the span of the rows of A, the other gradients.
            span = np.linalg.pinv(A, rcond=_SMALLEST_SINGULAR_RATIO) @ A
            inside = (own_gradient[:, None, :] @ span)[:, 0]
            outside = own_gradient - inside
        is_outside = np.linalg.norm(outside, axis=1) > _LEAST_OUTSIDE_COMPONENT
        share = np.mean(is_outside[has_value])
        return float(share) > _LEAST_SHARE_OF_POSES

    def _gradients(
        self, candidate: Candidate, equation: str, unknowns: Sequence[str], kinds: Mapping[RowKey, str]
    ) -> dict[RowKey, Array] | None:
        """Return {row: gradient (k, unknowns) of right minus left side in SI}; None after an error.

        The gradient is NaN for vectors, and for rows that have no residual after a step.
        """
        tolerance = self.judge.tolerance
        slopes: dict[RowKey, list[Array]] = {}
        for name in unknowns:
            above = self._sides(candidate, equation, name, 1)
            below = self._sides(candidate, equation, name, -1)
            if above is None or below is None:
                return None
            for row, kind in kinds.items():
                unit = tolerance.angle if kind == "angle" else tolerance.length
                column = np.full(self.judge.reference.k, np.nan)
                if row in above and row in below and above[row].shape[1] == 1:
                    # Residuals are in units of the tolerance; the gradient is in SI, as the components are compared.
                    column = (above[row] - below[row])[:, 0] * (unit / (2 * _DERIVATIVE_STEP))
                slopes.setdefault(row, []).append(column)
        gradients: dict[RowKey, Array] = {}
        for row, columns in slopes.items():
            gradients[row] = np.stack(columns, axis=1)
        return gradients

    def _sides(self, candidate: Candidate, equation: str, name: str, sign: int) -> dict[RowKey, Array] | None:
        """Return the residuals of an edited equation with one symbol moved by a step; None after an error."""
        key = (equation, name, sign)
        if key not in self._stepped:
            values = {**self.judge.step(equation).computed, **self.judge.reference.symbols}
            values[name] = values[name] + sign * _DERIVATIVE_STEP
            self._stepped[key] = self.judge.on(self.judge.reference.with_values(values), {equation})
        judge = self._stepped[key]
        unedited = edited_residuals(judge, equation, ()) or {}
        if candidate.step.equation.name != equation:
            return unedited
        changed = edited_residuals(judge, equation, candidate.edits)
        if changed is None:
            return None
        return {**unedited, **changed}


def _own_unknowns(step: Step, edits: Sequence[Edit]) -> list[str]:
    """Return the compared outputs of an equation that it also uses: its arguments, and those that edits add to them."""
    added_arguments: set[str] = set()
    for edit in edits:
        if edit.define and not edit.define[1]:
            added_arguments.add(edit.define[0])
    arguments: list[str] = []
    added: list[str] = []
    for name in step.equation.outputs:
        if name not in step.known_outputs:
            continue
        if name in step.inputs:
            arguments.append(name)
        elif name in added_arguments:
            added.append(name)
    return arguments + added


def _unit_gradients(gradient: Array) -> Array:
    """Return the unit vectors of gradients (k, n); shorter below `_SHORTEST_GRADIENT`, zero where not finite."""
    length = np.linalg.norm(gradient, axis=1, keepdims=True)
    unit = gradient / np.maximum(length, _SHORTEST_GRADIENT)
    return np.where(np.isfinite(unit).all(axis=1, keepdims=True), unit, 0.0)
