"""Data for the plots of a report: limits, and curves with fewer samples that still have all peaks."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from twin.core.spatial import Array
from twin.validation.result import Report, Residual, RowKind

POINTS = 2000
"""Maximum number of points in a drawn curve."""


def thin(t: Array, y: Array, points: int = POINTS) -> tuple[Array, Array]:
    """Return at most `points` samples (t, y) of a curve, chosen so that the plot of the curve looks the same.

    The samples are divided into equally long intervals. The result has the minimum, the maximum and the first NaN of
    each interval, and the first and the last sample of the curve. t (k,) are increasing times; y (k,) is NaN where the
    curve has a gap. `points` is at least 16.
    """
    k = len(y)
    if k <= points:
        return t, y
    gaps = np.isnan(y)
    each = 3 if gaps.any() else 2
    intervals = (points - 2) // each
    starts = np.linspace(0, k, intervals + 1).astype(int)
    width = int(np.diff(starts).max())
    rows = np.minimum(starts[:-1, None] + np.arange(width), starts[1:, None] - 1)  # short intervals repeat the last
    values = y[rows]
    low, high = np.where(np.isnan(values), np.inf, values), np.where(np.isnan(values), -np.inf, values)
    first = np.arange(intervals)
    keep = [rows[first, low.argmin(axis=1)], rows[first, high.argmax(axis=1)], np.array([0, k - 1])]
    if each == 3:
        keep.append(rows[first, np.isnan(values).argmax(axis=1)])  # the first NaN of each interval
    index = np.unique(np.concatenate(keep))
    return t[index], y[index]


def pair(report: Report, key: str, times: str = "t") -> tuple[Array, Array] | None:
    """Return (t, values): the series `times` and the series `key`.

    The result is None if a series is missing or has fewer than two samples, if the lengths of the two series differ, or
    if no value is finite.
    """
    t, y = report.series.get(times), report.series.get(key)
    if t is None or y is None:
        return None
    t, y = np.asarray(t, float), np.asarray(y, float)
    if t.ndim != 1 or len(t) < 2 or y.ndim == 0 or len(y) != len(t) or not np.isfinite(y).any():
        return None
    return t, np.where(np.isfinite(y), y, np.nan)


def named(report: Report, prefix: str, times: str = "t") -> Iterator[tuple[str, Array, Array]]:
    """Yield (name, t, values) of each series `<prefix>.<name>` that can be drawn; see `pair`."""
    for key in report.series:
        if key.startswith(f"{prefix}."):
            found = pair(report, key, times)
            if found is not None and found[1].ndim == 1:
                yield key[len(prefix) + 1 :], *found


def rows(report: Report, quantity: RowKind, unit: str = "", pairs: str = "") -> list[Residual]:
    """Return the residuals of a quantity, in this unit ("": any) and for this pair of models, as "A-B" ("": any)."""
    return [r for r in report.residuals if r.quantity == quantity and unit in ("", r.unit) and pairs in ("", r.pair)]


def tolerance(report: Report, quantity: RowKind, unit: str, pairs: str = "A-B") -> float | None:
    """Return the smallest tolerance of the residuals that `rows` selects; None if none of them has a tolerance."""
    return min((r.tolerance for r in rows(report, quantity, unit, pairs) if r.tolerance), default=None)


def joint_unit(report: Report, joint: str) -> str:
    """Return the SI unit of a joint, "rad" or "m"."""
    return "rad" if joint in report.angles else "m"


def alarms(report: Report) -> dict[str, float]:
    """Return the alarm value of each singularity measure, by name of the measure, as the findings state it."""
    codes = ("singularity.", "margin.singularity")
    return {f.where: f.limit for f in report.findings if f.code.startswith(codes) and f.limit}


def rcm_tolerance(report: Report) -> float | None:
    """Return the maximum RCM error in m that the protocol allows; None if the report does not state it.

    If the report has RCM findings, their limits are used, otherwise the tolerances of RCM residuals. If the RCM is
    enforced, however, the tolerance of an RCM residual is not the protocol's limit, but the tolerance for agreement
    of the models.
    """
    scale = {"m": 1.0, "mm": 1e-3, "um": 1e-6}
    limits = [
        f.limit * scale[f.unit]
        for f in report.findings
        if f.code in ("rcm.missed", "rcm.kept") and f.limit and f.unit in scale
    ]
    return min(limits) if limits else tolerance(report, "rcm", "m", "")


def duration(report: Report) -> float | None:
    """Return the duration of the protocol in s; None if unknown."""
    if report.phases:
        return report.phases[-1].t1 - report.phases[0].t0
    t = report.series.get("t")
    return None if t is None or len(t) == 0 else float(t[-1] - t[0])
