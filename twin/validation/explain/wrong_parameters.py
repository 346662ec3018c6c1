"""Find the parameters whose changed values explain the wrong rows, and combinations that no row determines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from twin.core.progress import StepProgress, silent_step
from twin.core.provenance import Parameter
from twin.core.spatial import Array
from twin.validation.explain.deadline import Deadline
from twin.validation.explain.explanation_data import ChangedParameter, FittedParameters
from twin.validation.explain.parameter_fit import BLIND_SINGULAR_RATIO, ParameterFit, ParameterResiduals
from twin.validation.explain.row_deviations import Judge, worst

_USUAL_MISTAKES = (
    (1e3, "metres instead of millimetres"),
    (1e-3, "millimetres instead of metres"),
    (np.pi / 180, "radians instead of degrees"),
    (180 / np.pi, "degrees instead of radians"),
    (-1.0, "a wrong sign"),
)
"""Usual mistakes: fitted value divided by the value in the formula, and what the ratio says."""

_EQUAL_VALUES = 1e-6
"""Relative difference up to which a fitted value is that of a usual mistake, or of another parameter."""

_UNITS_OF_ZERO = {"mm": 1e-3, "deg": np.pi / 180}
"""Units of parameters whose value is zero, in SI; those of other parameters follow from their values."""

_NOISE_LIMIT_IN_SIGMAS = 6.0
"""Residual that noise explains, in standard deviations: among some thousand residuals, none is larger by chance."""

_CHANGE_LIMIT_IN_SIGMAS = 4.0
"""Change of a parameter that is more than noise, in standard deviations."""

_CHANGE_ROUNDING = 1e-9
"""Change of a parameter, relative to its value (at least 1 m or rad), that is more than rounding."""

_LEAST_VARIANCE = 1e-8
"""Minimum variance of residuals, in units of the tolerance: an exact fit is not known better than by rounding."""

_LEAST_COEFFICIENT = 1e-6
"""Coefficient below which a parameter is no part of a combination, relative to the largest coefficient."""

_LEAST_PIVOT = 1e-7
"""Entry of a reduced basis that counts as zero."""


def identify(
    judge: Judge,
    progress: StepProgress = silent_step,
    noise: float = 0.0,
    alone: bool = False,
    deadline: Deadline | None = None,
) -> FittedParameters | None:
    """Return the parameters whose change explains the wrong rows; None if no parameter affects these rows.

    Single parameters are tried first. If several parameters explain the rows, each one alone, they are alternatives. If
    no single parameter explains the rows, all parameters are fitted together.

    Args:
        judge: the judged rows.
        progress: called with the fraction done.
        noise: standard deviation, in units of the tolerance, of noise added to the mechanism's values.
        alone: try single parameters only; return None if no single parameter makes every row agree.
        deadline: time limit; None: none.

    Raises:
        LateError: the time is over.
    """
    residuals = ParameterResiduals(judge, noise, deadline=deadline)
    if alone and not (residuals.complete and judge.failing()):
        return None
    parameters = residuals.influential_parameters()
    if not parameters:
        return None
    before = worst(residuals.residual(residuals.start))
    limit = max(1.0, _NOISE_LIMIT_IN_SIGMAS * noise)
    exact_fits: list[ParameterFit] = []  # fits of one parameter with which every row agrees
    for i, parameter in enumerate(parameters):
        progress(i / len(parameters))
        fit = residuals.fit((parameter.name,))
        if fit.worst <= limit and residuals.complete:
            exact_fits.append(fit)
    if alone and not exact_fits:
        return None
    names = [parameter.name for parameter in parameters]
    fit_of_all = residuals.fit(tuple(names))
    blind = _blind_combinations(fit_of_all, parameters)
    if exact_fits:
        return _alternatives(residuals, parameters, exact_fits, before, blind, noise)
    is_exact = fit_of_all.worst <= limit and residuals.complete
    changes: list[ChangedParameter] = []
    if is_exact:
        changes = _changes(residuals, parameters, fit_of_all, noise)
    return FittedParameters(
        exact=is_exact,
        before=before,
        after=fit_of_all.worst,
        moved=tuple(changes),
        alternatives=False,
        blind=blind,
        names=fit_of_all.names,
        covariance=_as_tuples(_covariance(fit_of_all, noise)),
    )


def _alternatives(
    residuals: ParameterResiduals,
    parameters: Sequence[Parameter],
    fits: Sequence[ParameterFit],
    before: float,
    blind: tuple[str, ...],
    noise: float,
) -> FittedParameters:
    """Return the parameters each of which alone explains the rows; `fits` are those of one parameter each."""
    by_name = {parameter.name: parameter for parameter in parameters}
    changes: list[ChangedParameter] = []
    for fit in fits:
        (name,) = fit.names
        changes.append(_change(by_name[name], residuals, fit, 0, noise))
    first = fits[0]
    return FittedParameters(
        exact=True,
        before=before,
        after=first.worst,
        moved=tuple(changes),
        alternatives=len(changes) > 1,
        blind=blind,
        names=first.names,
        covariance=_as_tuples(_covariance(first, noise)),
    )


def _changes(
    residuals: ParameterResiduals, parameters: Sequence[Parameter], fit: ParameterFit, noise: float
) -> list[ChangedParameter]:
    """Return the parameters whose fitted values differ from those of the formula by more than noise and rounding."""
    sigma = np.sqrt(np.maximum(np.diag(_covariance(fit, noise)), 0))
    changes: list[ChangedParameter] = []
    for i, parameter in enumerate(parameters):
        start = residuals.start[parameter.name]
        limit = max(_CHANGE_LIMIT_IN_SIGMAS * sigma[i], _CHANGE_ROUNDING * max(1, abs(start)))
        if abs(fit.values[i] - start) > limit:
            changes.append(_change(parameter, residuals, fit, i, noise))
    return changes


def _covariance(fit: ParameterFit, noise: float) -> Array:
    """Return the covariance (n, n) of the fitted values in SI, from the variance of the residuals.

    Rows without a derivative are left out: at the limit of the reach, a changed parameter may leave no real solution.
    """
    has_value = np.isfinite(fit.J).all(axis=1) & np.isfinite(fit.residual)
    J = fit.J[has_value]
    residual = fit.residual[has_value]
    m, n = J.shape
    of_residuals = float(residual @ residual) / max(m - n, 1)
    variance = max(of_residuals, _LEAST_VARIANCE, noise**2)
    norm = np.linalg.norm(J, axis=0)
    scale = np.where(norm > 0, norm, 1.0)
    # The columns are scaled, because lengths and angles have derivatives of other sizes.
    inverse = np.linalg.pinv(J / scale, rcond=BLIND_SINGULAR_RATIO)
    return variance * (inverse @ inverse.T) / np.outer(scale, scale)


def _change(
    parameter: Parameter, residuals: ParameterResiduals, fit: ParameterFit, i: int, noise: float
) -> ChangedParameter:
    """Return a parameter with its fitted value, the value `i` of a fit, in the unit of the formula."""
    unit = _UNITS_OF_ZERO.get(parameter.unit, 1.0)
    if parameter.shown:
        unit = parameter.value / parameter.shown
    start = residuals.start[parameter.name]
    value = float(fit.values[i])
    variance = _covariance(fit, noise)[i, i]
    sigma = float(np.sqrt(max(variance, 0)))
    note = _probable_mistake(parameter.name, start, value, residuals.start)
    return ChangedParameter(parameter.name, parameter.unit, start / unit, value / unit, sigma / unit, note)


def _probable_mistake(name: str, start: float, value: float, values: Mapping[str, float]) -> str:
    """Return the probable mistake in a value: another unit, sign or parameter; "" if none is recognised."""
    ratio = float("nan")
    if start:
        ratio = value / start
    for slip, text in _USUAL_MISTAKES:
        if abs(ratio / slip - 1) < _EQUAL_VALUES:
            return f"looks like {text}"
    same_valued: list[str] = []
    for other_name, number in values.items():
        if other_name != name and number and abs(value / number - 1) < _EQUAL_VALUES:
            same_valued.append(other_name)
    if same_valued:
        return f"the value of {' or '.join(same_valued)}"
    return ""


def _blind_combinations(fit: ParameterFit, parameters: Sequence[Parameter]) -> tuple[str, ...]:
    """Return the combinations of parameters that affect no row, from the SVD of the scaled Jacobian."""
    if not np.isfinite(fit.J).all() or not fit.J.any():
        return ()
    scale = np.maximum(np.linalg.norm(fit.J, axis=0), 1e-300)  # a parameter without effect has a column of zeros
    _, singular, Vt = np.linalg.svd(fit.J / scale, full_matrices=True)
    rank = np.count_nonzero(singular > BLIND_SINGULAR_RATIO * singular[0])
    null = Vt[rank:]
    if not len(null):
        return ()
    combinations: list[str] = []
    for direction in _sparse_basis(null):
        change = direction / scale
        change = change / np.abs(change).max()
        terms: list[str] = []
        for coefficient, parameter in zip(change, parameters, strict=True):
            if abs(coefficient) > _LEAST_COEFFICIENT:
                terms.append(f"{coefficient:+.3g} {parameter.name}")
        combinations.append(" ".join(terms).removeprefix("+"))
    return tuple(combinations)


def _sparse_basis(null: Array) -> Array:
    """Return a sparse basis of the row space of `null`: the reduced row echelon form, with the largest pivots first."""
    A = null.copy()
    for row in range(len(A)):
        sizes = np.abs(A[row:])
        offset, pivot = np.unravel_index(int(np.argmax(sizes)), sizes.shape)
        A[[row, row + offset]] = A[[row + offset, row]]
        A[row] /= A[row, pivot]
        for eliminated in range(len(A)):
            if eliminated != row:
                A[eliminated] -= A[eliminated, pivot] * A[row]
    return np.where(np.abs(A) < _LEAST_PIVOT, 0.0, A)


def _as_tuples(a: Array) -> tuple[tuple[float, ...], ...]:
    return tuple(map(tuple, a.tolist()))
