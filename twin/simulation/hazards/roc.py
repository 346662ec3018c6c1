"""ROC curves of a campaign: how well limits of the measured distance detect dangerous sessions.

A session is dangerous if its fault caused harm, or if a check of the software stopped the arm. The score of a session
is the largest distance from the start of the fault until harm or stop; for the adaptive limit, it is the largest ratio
of the distance to that limit. If the score exceeds the limit, the fault is detected in time. Detectors named "... or
checks" also detect sessions in which a check stopped the arm before harm. False alarms are counted in all sessions:
before the fault, or during the whole session if there is no fault.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.core.json_types import JsonMapping
from twin.core.spatial import Array
from twin.simulation.hazards.campaign import FREE


@dataclass(frozen=True)
class Roc:
    """ROC curve of one detector.

    Attributes:
        name: detector.
        unit: unit of the detector's limit.
        limits: (k,) limits in descending order.
        detected: (k,) fraction of the dangerous sessions that is detected in time, for each limit.
        false: (k,) fraction of all sessions that have a false alarm, for each limit.
        area: area below the curve.
        limit: the limit that the detector uses.
    """

    name: str
    unit: str
    limits: Array
    detected: Array
    false: Array
    area: float
    limit: float

    @property
    def used(self) -> str:
        """The limit that the detector uses, with its unit."""
        if self.unit == "mm":
            return f"{self.limit:g} mm"
        return f"factor {self.limit:g}"

    def at(self, limit: float) -> tuple[float, float]:
        """Return the fractions (detected, false) for a limit."""
        # the same scores are above `limit` as above the largest listed limit that is at most `limit`
        k = int(np.argmax(self.limits <= limit))
        return float(self.detected[k]), float(self.false[k])


def dangerous(row: JsonMapping) -> bool:
    """Return whether a session had a fault that caused harm or a stop."""
    return row["kind"] != FREE and (row["harm"] is not None or row["stop"] is not None)


def in_time(row: JsonMapping) -> bool:
    """Return whether the software's own check stopped the arm of a dangerous session before harm."""
    return row["stop"] is not None and (row["harm"] is None or row["stop"] < row["harm"])


def curves(rows: Sequence[JsonMapping], cue: float) -> list[Roc]:
    """Return four ROC curves: fixed limit (`cue` in mm) and adaptive limit, without and with the software's checks.

    The list is empty if no session is dangerous.
    """
    dangerous_rows = list(filter(dangerous, rows))
    if not dangerous_rows:
        return []
    stopped_in_time = np.array(list(map(in_time, dangerous_rows)))
    results = []
    for name, unit, before, during, limit, with_checks in (
        ("fixed limit", "mm", "residual", "seen", cue, False),
        ("adaptive limit", "1", "ratio", "seen_ratio", 1.0, False),
        ("fixed limit or checks", "mm", "residual", "seen", cue, True),
        ("adaptive limit or checks", "1", "ratio", "seen_ratio", 1.0, True),
    ):
        # A session that a check stopped in time is above every limit.
        scores = np.array([row[during] for row in dangerous_rows], float)
        if with_checks:
            scores[stopped_in_time] = np.inf
        quiet_scores = _scores_without_fault(rows, before, during)
        finite = np.concatenate([scores[np.isfinite(scores)], quiet_scores])
        # from a limit that nothing exceeds to one that everything exceeds
        limits = np.concatenate([[np.finfo(float).max], np.unique(finite)[::-1], [-1.0]])
        detected = (scores[None, :] > limits[:, None]).mean(axis=1)
        false = (quiet_scores[None, :] > limits[:, None]).mean(axis=1)
        area = float(np.trapezoid(detected, false))
        results.append(Roc(name, unit, limits, detected, false, area, limit))
    return results


def _scores_without_fault(rows: Sequence[JsonMapping], before: str, during: str) -> Array:
    """Return the scores (k,) of all sessions before the fault, or in the whole session if there is no fault."""
    scores = []
    for row in rows:
        score = row[before]
        if row["kind"] == FREE:
            score = max(score, row[during])
        scores.append(score)
    return np.array(scores)
