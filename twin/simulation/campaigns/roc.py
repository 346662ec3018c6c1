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
from typing import NamedTuple

import numpy as np

from twin.core.json_types import JsonMapping
from twin.core.spatial import Array
from twin.simulation.campaigns.campaign_table import FREE


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


class _Detector(NamedTuple):
    """A limit of the measured distance: its name, unit and value, and the keys of a session's scores in the log.

    `before_fault` is the score until the fault begins, `during_fault` from then until harm or stop.
    """

    name: str
    unit: str
    limit: float
    before_fault: str
    during_fault: str


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
    is_stopped_in_time = np.array(list(map(in_time, dangerous_rows)))
    fixed = _Detector("fixed limit", "mm", cue, "residual", "seen")
    adaptive = _Detector("adaptive limit", "1", 1.0, "ratio", "seen_ratio")
    roc_curves = []
    for with_checks in (False, True):
        for detector in (fixed, adaptive):
            name = detector.name
            scores = np.array([row[detector.during_fault] for row in dangerous_rows], float)
            if with_checks:
                name += " or checks"
                scores[is_stopped_in_time] = np.inf  # above every limit
            quiet_scores = _scores_without_fault(rows, detector)
            finite = np.concatenate([scores[np.isfinite(scores)], quiet_scores])
            # from a limit that nothing exceeds to one that everything exceeds
            limits = np.concatenate([[np.finfo(float).max], np.unique(finite)[::-1], [-1.0]])
            detected = (scores[None, :] > limits[:, None]).mean(axis=1)
            false = (quiet_scores[None, :] > limits[:, None]).mean(axis=1)
            area = float(np.trapezoid(detected, false))
            roc_curves.append(Roc(name, detector.unit, limits, detected, false, area, detector.limit))
    return roc_curves


def _scores_without_fault(rows: Sequence[JsonMapping], detector: _Detector) -> Array:
    """Return the scores (k,) of all sessions before the fault, or in the whole session if there is no fault."""
    scores = []
    for row in rows:
        score = row[detector.before_fault]
        if row["kind"] == FREE:
            score = max(score, row[detector.during_fault])
        scores.append(score)
    return np.array(scores)
