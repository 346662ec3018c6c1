"""How well limits of the measured distance tell dangerous sessions from others: ROC curves over a campaign.

A session is dangerous if its fault led to harm, or a check of the software stopped the arm before. Each session has a
score, the largest distance (or its quotient with the adaptive limit) from the start of the fault until harm or stop.
If it is above the limit, the fault is detected in time; "or checks" counts the stops before harm too. False alarms are
counted over all sessions before their fault, and over the sessions without one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from twin.core.spatial import Array
from twin.simulation.hazards.campaign import FREE


@dataclass(frozen=True)
class Roc:
    """The curve of one detector.

    Attributes:
        name: detector.
        unit: unit of its limit.
        limits: (k,) limits, falling.
        detected: (k,) share of the dangerous sessions that is detected in time.
        false: (k,) share of false alarms.
        area: area below the curve.
        limit: the limit that is used.
    """

    name: str
    unit: str
    limits: Array
    detected: Array
    false: Array
    area: float
    limit: float

    def at(self, limit: float) -> tuple[float, float]:
        """Return the shares (detected, false) for a limit."""
        k = int(np.argmax(self.limits <= limit))  # scores above a limit are those above the next score below it
        return float(self.detected[k]), float(self.false[k])


def dangerous(row: Mapping[str, Any]) -> bool:
    """Return whether the fault of a session caused harm, or a stop."""
    return row["kind"] != FREE and (row["harm"] is not None or row["stop"] is not None)


def in_time(row: Mapping[str, Any]) -> bool:
    """Return whether the software's own check stopped the arm of a dangerous session before harm."""
    return row["stop"] is not None and (row["harm"] is None or row["stop"] < row["harm"])


def curves(rows: Sequence[Mapping[str, Any]], cue: float) -> list[Roc]:
    """Return the curves of the fixed limit, used at `cue` in mm, and of the adaptive one, without and with the checks.

    Without a dangerous session there is no curve.
    """
    danger = [r for r in rows if dangerous(r)]
    if not danger:
        return []
    out = []
    early = np.array([in_time(r) for r in danger])
    for name, unit, before, during, limit, checked in (
        ("fixed limit", "mm", "residual", "seen", cue, False),
        ("adaptive limit", "1", "ratio", "seen_ratio", 1.0, False),
        ("fixed limit or checks", "mm", "residual", "seen", cue, True),
        ("adaptive limit or checks", "1", "ratio", "seen_ratio", 1.0, True),
    ):
        bad = np.where(early & checked, np.inf, [r[during] for r in danger])
        good = np.array([max(r[before], r[during]) if r["kind"] == FREE else r[before] for r in rows])
        finite = np.concatenate([bad[np.isfinite(bad)], good])
        limits = np.concatenate([[np.finfo(float).max], np.unique(finite)[::-1], [-1.0]])
        detected = (bad[None, :] > limits[:, None]).mean(axis=1)
        false = (good[None, :] > limits[:, None]).mean(axis=1)
        area = float(np.trapezoid(detected, false))
        out.append(Roc(name, unit, limits, detected, false, area, limit))
    return out
