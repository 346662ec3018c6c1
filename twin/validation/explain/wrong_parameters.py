"""Fit the parameters of the equations to the mechanism, and find combinations that cannot be identified."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from twin.core.provenance import Parameter
from twin.core.spatial import Array
from twin.validation.explain.deadline import Deadline
from twin.validation.explain.equation_steps import RowPlace
from twin.validation.explain.explanation_data import ChangedParameter, FittedParameters
from twin.validation.explain.row_deviations import Judge, worst

_BLIND = 1e-7
"""A combination of parameters counts as without effect on the rows if its relative singular value is smaller."""

_STEPS = 30
"""Maximum number of steps of a fit."""

_GAIN = 1e-3
"""A fit ends if two successive steps reduce the sum of squares by less than this fraction."""

_DONE = 1e-13
"""A fit ends if a step changes each parameter by less than this fraction of its scale."""

_SHORTEST = 1e-3
"""A step is halved until the sum of squares does not increase, but not below this fraction of it."""

_DIFFERENCE = 1e-6
"""Change of a parameter, relative to its scale, for derivatives by differences."""

_SMALLEST_SCALE = 0.01
"""Smallest scale of a parameter in m or rad; that of a larger one is its absolute value."""

_PROBE = 1e-4
"""Change of a parameter, relative to its scale, that shows whether a row depends on it."""

_FELT = 1e-3
"""Smallest change of a residual, in units of the tolerance, by which a row depends on a parameter."""

_SLIPS = ((1e3, "metres instead of millimetres"), (1e-3, "millimetres instead of metres"),
          (np.pi / 180, "radians instead of degrees"), (180 / np.pi, "degrees instead of radians"),
          (-1.0, "a wrong sign"))  # fmt: skip


@dataclass(frozen=True)
class Fit:
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
        self.start = {p.name: float(np.asarray(judge.reference.symbols[p.name])) for p in judge.formula.parameters}
        failing = judge.failing()
        # Helpers often only repeat the error of a printed row: helper rows are used only if all printed rows agree.
        printed_fails = any(self._printed(p.equation) for p in failing)
        self.rows: list[RowPlace] = []
        self.complete = True
        size = 0  # number of residuals of all used rows
        for place, residual in judge.residuals.items():
            if printed_fails and not self._printed(place.equation):
                continue
            if np.isfinite(residual).all():
                self.rows.append(place)
                size += residual.size
            elif place in failing:
                self.complete = False
        self.noise = np.zeros(size)
        if noise:
            self.noise = noise * np.random.default_rng(seed).standard_normal(size)

    def _printed(self, equation: str) -> bool:
        return self.judge.step(equation).stage != "helper"

    def residual(self, values: dict[str, float]) -> Array:
        """Return the residuals (m,) of all rows for parameter values in SI; all are NaN if a row has none there.

        Raises:
            LateError: the time is over.
        """
        self.deadline.check()
        other = self.judge.on(self.judge.reference.with_parameters(values))
        lost = np.full(self.noise.shape, np.nan)
        of_rows: list[Array] = [np.zeros(0)]  # there may be no rows
        for place in self.rows:
            if place not in other.residuals:
                return lost
            of_rows.append(other.residuals[place].ravel())
        flat = np.concatenate(of_rows)
        if flat.shape != self.noise.shape:
            return lost
        return flat + self.noise

    def used(self) -> list[Parameter]:
        """Return the parameters on which at least one row depends."""
        base = self.residual(self.start)
        used: list[Parameter] = []
        for p in self.judge.formula.parameters:
            start = self.start[p.name]
            scale = max(abs(start), _SMALLEST_SCALE)
            moved = self.residual({**self.start, p.name: start + _PROBE * scale})
            if np.nanmax(np.abs(moved - base), initial=0.0) > _FELT:
                used.append(p)
        return used

    def fit(self, names: tuple[str, ...]) -> Fit:
        """Fit the named parameters by least squares (Gauss-Newton, step halving; minimum norm if not identifiable)."""
        x: Array = np.array([self.start[n] for n in names], float)
        scale = np.maximum(np.abs(x), _SMALLEST_SCALE)

        def at(values: Array) -> Array:
            named_values = dict(zip(names, values.tolist(), strict=True))
            return self.residual({**self.start, **named_values})

        r = at(x)
        J = np.zeros((len(r), len(names)))  # derivatives by values in units of `scale`
        slow = 0  # number of successive steps with little gain
        for _ in range(_STEPS):
            for i in range(len(names)):
                h = np.zeros(len(names))
                h[i] = _DIFFERENCE * scale[i]
                J[:, i] = (at(x + h) - at(x - h)) / (2 * _DIFFERENCE)
            if not np.isfinite(J).all():
                break
            step = np.asarray(np.linalg.lstsq(J, -r, rcond=_BLIND)[0], np.float64) * scale
            factor = 1.0
            new = at(x + step)
            while not _smaller(new, r) and factor > _SHORTEST:
                factor /= 2
                new = at(x + factor * step)
            if not _smaller(new, r):
                break
            gain = 1 - float(new @ new) / max(float(r @ r), 1e-300)
            change = float(np.abs(factor * step / scale).max())
            x = x + factor * step
            r = new
            slow = slow + 1 if gain < _GAIN else 0
            if change < _DONE or slow == 2:
                break
        return Fit(names, x, r, J / scale)


def _smaller(new: Array, old: Array) -> bool:
    """Return whether new residuals are finite and their sum of squares is not larger than that of the old ones."""
    return bool(np.isfinite(new).all()) and bool(new @ new <= old @ old)


def identify(
    judge: Judge,
    progress: Callable[[float], None] = lambda f: None,
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
    parameters = residuals.used()
    if not parameters:
        return None
    before = worst(residuals.residual(residuals.start))
    limit = max(1.0, 6 * noise)
    single: list[Fit] = []  # fits of one parameter with which every row agrees
    for i, p in enumerate(parameters):
        progress(i / len(parameters))
        fit = residuals.fit((p.name,))
        if fit.worst <= limit and residuals.complete:
            single.append(fit)
    if alone and not single:
        return None
    everything = residuals.fit(tuple(p.name for p in parameters))
    blind = _blind(everything, parameters)
    by_name = {p.name: p for p in parameters}
    moved: list[ChangedParameter] = []
    if single:
        for fit in single:
            moved.append(_moved(by_name[fit.names[0]], residuals, fit, 0, noise))
        fit = single[0]
        covariance = _plain(_covariance(fit, noise))
        return FittedParameters(
            exact=True,
            before=before,
            after=fit.worst,
            moved=tuple(moved),
            alternatives=len(moved) > 1,
            blind=blind,
            names=fit.names,
            covariance=covariance,
        )
    covariance = _covariance(everything, noise)
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0))
    exact = everything.worst <= limit and residuals.complete
    if exact:
        for i, p in enumerate(parameters):
            start = residuals.start[p.name]
            # Changes below four standard deviations are noise.
            if abs(everything.values[i] - start) > max(4 * sigma[i], 1e-9 * max(1, abs(start))):
                moved.append(_moved(p, residuals, everything, i, noise))
    return FittedParameters(
        exact=exact,
        before=before,
        after=everything.worst,
        moved=tuple(moved),
        alternatives=False,
        blind=blind,
        names=everything.names,
        covariance=_plain(covariance),
    )


def _covariance(fit: Fit, noise: float) -> Array:
    """Return the covariance of the fitted values in SI, from the variance of the residuals, which has a lower bound.

    Rows without a derivative are left out: at the limit of the reach, a changed parameter may leave no real solution.
    """
    known = np.isfinite(fit.J).all(axis=1) & np.isfinite(fit.residual)
    J = fit.J[known]
    residual = fit.residual[known]
    m, n = J.shape
    variance = max(float(residual @ residual) / max(m - n, 1), 1e-8, noise**2)
    norm = np.linalg.norm(J, axis=0)
    scale = np.where(norm > 0, norm, 1.0)
    inverse = np.linalg.pinv(J / scale, rcond=_BLIND)
    return variance * (inverse @ inverse.T) / np.outer(scale, scale)


def _moved(p: Parameter, residuals: ParameterResiduals, fit: Fit, i: int, noise: float) -> ChangedParameter:
    if p.shown:
        unit = p.value / p.shown
    else:
        unit = {"mm": 1e-3, "deg": np.pi / 180}.get(p.unit, 1.0)
    start = residuals.start[p.name]
    value = float(fit.values[i])
    sigma = float(np.sqrt(max(_covariance(fit, noise)[i, i], 0)))
    note = _slip(p.name, start, value, residuals.start)
    return ChangedParameter(p.name, p.unit, start / unit, value / unit, sigma / unit, note)


def _slip(name: str, start: float, value: float, values: dict[str, float]) -> str:
    """Return the probable mistake in a value: another unit, sign or parameter; "" if none is recognised."""
    ratio = value / start if start else float("nan")
    for slip, text in _SLIPS:
        if abs(ratio / slip - 1) < 1e-6:
            return f"looks like {text}"
    same: list[str] = []
    for other, number in values.items():
        if other != name and number and abs(value / number - 1) < 1e-6:
            same.append(other)
    if same:
        return f"the value of {' or '.join(same)}"
    return ""


def _blind(fit: Fit, parameters: list[Parameter]) -> tuple[str, ...]:
    """Return the combinations of parameters that affect no row, from the SVD of the scaled Jacobian."""
    if not np.isfinite(fit.J).all() or not fit.J.any():
        return ()
    scale = np.maximum(np.linalg.norm(fit.J, axis=0), 1e-300)
    _, s, Vt = np.linalg.svd(fit.J / scale, full_matrices=True)
    null = Vt[np.count_nonzero(s > _BLIND * s[0]) :]
    if not len(null):
        return ()
    combinations: list[str] = []
    for v in _sparse(null):
        change = v / scale
        change = change / np.abs(change).max()
        parts: list[str] = []
        for coefficient, p in zip(change, parameters, strict=True):
            if abs(coefficient) > 1e-6:
                parts.append(f"{coefficient:+.3g} {p.name}")
        combinations.append(" ".join(parts).removeprefix("+"))
    return tuple(combinations)


def _sparse(null: Array) -> Array:
    """Return a sparse basis of the row space of `null`: the reduced row echelon form, with the largest pivots first."""
    A = null.copy()
    for row in range(len(A)):
        rest = np.abs(A[row:])
        i, j = np.unravel_index(int(np.argmax(rest)), rest.shape)
        A[[row, row + i]] = A[[row + i, row]]
        A[row] /= A[row, j]
        for k in range(len(A)):
            if k != row:
                A[k] -= A[k, j] * A[row]
    return np.where(np.abs(A) < 1e-7, 0.0, A)


def _plain(a: Array) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(row) for row in a.tolist())
