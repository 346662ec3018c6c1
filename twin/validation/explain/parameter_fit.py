"""Fit parameters of the equations to the mechanism: Gauss-Newton on the residuals of the judged rows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.core.provenance import Parameter
from twin.core.spatial import Array
from twin.validation.explain.deadline import Deadline
from twin.validation.explain.equation_steps import RowPlace
from twin.validation.explain.row_deviations import Judge, worst

BLIND_SINGULAR_RATIO = 1e-7
"""A combination of parameters counts as without effect on the rows if its relative singular value is smaller."""

_MOST_STEPS = 30
"""Maximum number of steps of a fit."""

_SLOW_GAIN = 1e-3
"""A step is slow if it reduces the sum of squares by less than this fraction."""

_MOST_SLOW_STEPS = 2
"""A fit ends after so many successive slow steps."""

_CONVERGED_STEP = 1e-13
"""A fit ends if a step changes each parameter by less than this fraction of its scale."""

_SHORTEST_STEP_PART = 1e-3
"""A step is halved until the sum of squares does not increase, but not below this fraction of it."""

_DERIVATIVE_STEP = 1e-6
"""Change of a parameter, relative to its scale, for derivatives by differences."""

_SMALLEST_SCALE = 0.01
"""Smallest scale of a parameter in m or rad; that of a larger one is its absolute value."""

_EFFECT_PROBE = 1e-4
"""Change of a parameter, relative to its scale, that shows whether a row depends on it."""

_LEAST_EFFECT = 1e-3
"""Smallest change of a residual, in units of the tolerance, by which a row depends on a parameter."""

_LEAST_DIVISOR = 1e-300
"""Minimum divisor where a sum of squares may be zero."""


@dataclass(frozen=True)
class ParameterFit:
    """Result of a Gauss-Newton fit.

    Attributes:
        names: names (n) of the fitted parameters.
        values: (n,) in SI.
        residual: (m,) in units of the tolerance.
        J: (m, n) derivatives of `residual` by `values`, in units of the tolerance per SI unit.
    """

    names: tuple[str, ...]
    values: Array
    residual: Array
    J: Array

    @property
    def worst(self) -> float:
        """Worst residual, in units of the tolerance."""
        return worst(self.residual)


class ParameterResiduals:
    """Residuals of the used rows as functions of the parameters.

    Helper rows are used only if all printed rows agree. Rows with a residual that is not finite are not used.

    Attributes:
        complete: whether all wrong rows have finite residuals.
    """

    def __init__(self, judge: Judge, noise: float = 0.0, seed: int = 0, deadline: Deadline | None = None) -> None:
        """Store the rows; `noise`: standard deviation, in units of the tolerance, added to the mechanism's values."""
        self.judge = judge
        self.deadline = deadline or Deadline()
        self.start: dict[str, float] = {}
        """Values of the parameters in SI with which the formula was judged."""
        for parameter in judge.formula.parameters:
            self.start[parameter.name] = float(np.asarray(judge.reference.symbols[parameter.name]))
        failing = judge.failing()
        # Helpers often only repeat the error of a printed row: helper rows are used only if all printed rows agree.
        printed_row_fails = False
        for place in failing:
            printed_row_fails |= self._is_printed(place.equation)
        self.rows: list[RowPlace] = []
        self.complete = True
        size = 0  # number of residuals of all used rows
        for place, residual in judge.residuals.items():
            if printed_row_fails and not self._is_printed(place.equation):
                continue
            if np.isfinite(residual).all():
                self.rows.append(place)
                size += residual.size
            elif place in failing:
                self.complete = False
        self.noise = np.zeros(size)
        if noise:
            self.noise = noise * np.random.default_rng(seed).standard_normal(size)

    def _is_printed(self, equation: str) -> bool:
        return self.judge.step(equation).stage != "helper"

    def residual(self, values: dict[str, float]) -> Array:
        """Return the residuals (m,) of all rows for parameter values in SI; all are NaN if a row has none there.

        Raises:
            LateError: the time is over.
        """
        self.deadline.check()
        judge = self.judge.on(self.judge.reference.with_values(values))
        without_value = np.full(self.noise.shape, np.nan)
        of_rows: list[Array] = [np.zeros(0)]  # there may be no rows
        for place in self.rows:
            if place not in judge.residuals:
                return without_value
            of_rows.append(judge.residuals[place].ravel())
        flat = np.concatenate(of_rows)
        if flat.shape != self.noise.shape:
            return without_value
        return flat + self.noise

    def influential_parameters(self) -> list[Parameter]:
        """Return the parameters on which at least one row depends."""
        residual = self.residual(self.start)
        influential: list[Parameter] = []
        for parameter in self.judge.formula.parameters:
            start = self.start[parameter.name]
            scale = max(abs(start), _SMALLEST_SCALE)
            changed_residual = self.residual({**self.start, parameter.name: start + _EFFECT_PROBE * scale})
            if np.nanmax(np.abs(changed_residual - residual), initial=0.0) > _LEAST_EFFECT:
                influential.append(parameter)
        return influential

    def fit(self, names: tuple[str, ...]) -> ParameterFit:
        """Fit the named parameters by least squares (Gauss-Newton, step halving; minimum norm if not identifiable)."""
        start = [self.start[name] for name in names]
        x: Array = np.array(start, float)
        scale = np.maximum(np.abs(x), _SMALLEST_SCALE)

        def residual(values: Array) -> Array:
            named_values = dict(zip(names, values.tolist(), strict=True))
            return self.residual({**self.start, **named_values})

        r = residual(x)
        # The derivatives are by values in units of `scale`, so that lengths and angles count alike in the cut-off.
        J = np.zeros((len(r), len(names)))
        slow_steps = 0
        for _ in range(_MOST_STEPS):
            for i in range(len(names)):
                h = np.zeros(len(names))
                h[i] = _DERIVATIVE_STEP * scale[i]
                J[:, i] = (residual(x + h) - residual(x - h)) / (2 * _DERIVATIVE_STEP)
            if not np.isfinite(J).all():
                break
            # With singular values below `BLIND_SINGULAR_RATIO` cut off, what no row depends on has no step.
            solution, *_ = np.linalg.lstsq(J, -r, rcond=BLIND_SINGULAR_RATIO)
            step = np.asarray(solution, np.float64) * scale
            factor = 1.0
            shorter = residual(x + step)
            while not _is_not_larger(shorter, r) and factor > _SHORTEST_STEP_PART:
                factor /= 2
                shorter = residual(x + factor * step)
            if not _is_not_larger(shorter, r):
                break
            gain = 1 - float(shorter @ shorter) / max(float(r @ r), _LEAST_DIVISOR)
            change = float(np.abs(factor * step / scale).max())
            x = x + factor * step
            r = shorter
            if gain < _SLOW_GAIN:
                slow_steps += 1
            else:
                slow_steps = 0
            if change < _CONVERGED_STEP or slow_steps == _MOST_SLOW_STEPS:
                break
        return ParameterFit(names, x, r, J / scale)


def _is_not_larger(new: Array, old: Array) -> bool:
    """Return whether new residuals are finite and their sum of squares is not larger than that of the old ones."""
    if not np.isfinite(new).all():
        return False
    return bool(new @ new <= old @ old)
