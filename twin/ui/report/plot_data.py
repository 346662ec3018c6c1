"""Data for the plots of a report: limits, and curves with fewer samples that still have all peaks."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from twin.core.spatial import Array
from twin.validation.result import Report, Residual, RowKind

MAX_CURVE_POINTS = 2000
"""Maximum number of points in a drawn curve."""


def thinned_curve(t: Array, y: Array, points: int = MAX_CURVE_POINTS) -> tuple[Array, Array]:
    """Return at most `points` samples (t, y) of a curve, chosen so that the plot of the curve looks the same.

    The samples are divided into equally long intervals. The result has the minimum, the maximum and the first NaN of
    each interval, and the first and the last sample of the curve. t (k,) are increasing times; y (k,) is NaN where the
    curve has a gap. `points` is at least 16.
    """
    count = len(y)
    if count <= points:
        return t, y
    has_gaps = bool(np.isnan(y).any())
    kept_of_interval = 3 if has_gaps else 2
    # two of the points are the ends of the curve
    intervals = (points - 2) // kept_of_interval
    bounds = np.linspace(0, count, intervals + 1).astype(int)
    starts = bounds[:-1, None]
    ends = bounds[1:, None]
    width = int(np.diff(bounds).max())
    # one row for each interval; intervals shorter than the longest repeat their last sample
    rows = np.minimum(starts + np.arange(width), ends - 1)
    values = y[rows]
    # NaN is never the lowest or the highest; it is kept by itself, see below
    missing = np.isnan(values)
    lowest = np.where(missing, np.inf, values).argmin(axis=1)
    highest = np.where(missing, -np.inf, values).argmax(axis=1)
    interval = np.arange(intervals)
    chosen_rows = [np.array([0, count - 1]), rows[interval, lowest], rows[interval, highest]]
    if has_gaps:
        first_missing = missing.argmax(axis=1)
        chosen_rows.append(rows[interval, first_missing])
    index = np.unique(np.concatenate(chosen_rows))
    return t[index], y[index]


def curve_of(report: Report, key: str, times: str = "t") -> tuple[Array, Array] | None:
    """Return (t, values): the series `times` and the series `key`.

    The result is None if a series is missing or has fewer than two samples, if the lengths of the two series differ, or
    if no value is finite.
    """
    if times not in report.series or key not in report.series:
        return None
    t = np.asarray(report.series[times], float)
    y = np.asarray(report.series[key], float)
    if t.ndim != 1 or len(t) < 2:
        return None
    if y.ndim == 0 or len(y) != len(t):
        return None
    finite = np.isfinite(y)
    if not finite.any():
        return None
    # a curve has a gap at NaN only
    return t, np.where(finite, y, np.nan)


def curves_of_prefix(report: Report, prefix: str, times: str = "t") -> Iterator[tuple[str, Array, Array]]:
    """Yield (name, t, values) of each series `<prefix>.<name>` that can be drawn; see `curve_of`."""
    start = f"{prefix}."
    for key in report.series:
        if not key.startswith(start):
            continue
        curve = curve_of(report, key, times)
        if curve is None:
            continue
        t, y = curve
        if y.ndim == 1:
            yield key.removeprefix(start), t, y


def rows(report: Report, quantity: RowKind, unit: str = "", pairs: str = "") -> list[Residual]:
    """Return the residuals of a quantity, in this unit ("": any) and for this pair of models, as "A-B" ("": any)."""
    selected = []
    for residual in report.residuals:
        same_unit = unit in ("", residual.unit)
        same_pair = pairs in ("", residual.pair)
        if residual.quantity == quantity and same_unit and same_pair:
            selected.append(residual)
    return selected


def tolerance(report: Report, quantity: RowKind, unit: str, pairs: str = "A-B") -> float | None:
    """Return the smallest tolerance of the residuals that `rows` selects; None if none of them has a tolerance."""
    tolerances = [r.tolerance for r in rows(report, quantity, unit, pairs) if r.tolerance]
    return min(tolerances, default=None)


def joint_unit(report: Report, joint: str) -> str:
    """Return the SI unit of a joint, "rad" or "m"."""
    if joint in report.angles:
        return "rad"
    return "m"


def alarms(report: Report) -> dict[str, float]:
    """Return the alarm value of each singularity measure, by name of the measure, as the findings state it."""
    codes = ("singularity.", "margin.singularity")
    values = {}
    for finding in report.findings:
        if finding.code.startswith(codes) and finding.limit:
            values[finding.where] = finding.limit
    return values


def rcm_tolerance(report: Report) -> float | None:
    """Return the maximum RCM error in m that the protocol allows; None if the report does not state it.

    If the report has RCM findings, their limits are used, otherwise the tolerances of RCM residuals. If the RCM is
    enforced, however, the tolerance of an RCM residual is not the protocol's limit, but the tolerance for agreement
    of the models.
    """
    scale = {"m": 1.0, "mm": 1e-3, "um": 1e-6}
    limits = []
    for finding in report.findings:
        if finding.code not in ("rcm.missed", "rcm.kept"):
            continue
        if finding.limit and finding.unit in scale:
            limits.append(finding.limit * scale[finding.unit])
    if limits:
        return min(limits)
    return tolerance(report, "rcm", "m", "")


def duration(report: Report) -> float | None:
    """Return the duration of the protocol in s; None if unknown."""
    if report.phases:
        return report.phases[-1].t1 - report.phases[0].t0
    t = report.series.get("t")
    if t is None or len(t) == 0:
        return None
    return float(t[-1] - t[0])
