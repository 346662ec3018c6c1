"""What a campaign showed, by class of faults."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from twin.core.findings import Finding, disagreement, warning
from twin.core.result import Part, Result, Table
from twin.simulation.hazards.attacked import HARM
from twin.simulation.hazards.campaign import FREE


@dataclass(frozen=True)
class ClassRow:
    """Sessions of one class; each number counts sessions, except the peaks (mm) and the delay (ms).

    Attributes:
        kind, outcome: class, and its outcome in the paper's table.
        sessions: sessions done.
        harmed: the tip deviated more than `HARM` before a check had stopped the arm, or without a stop.
        beyond: it deviated more than 3 mm.
        felt: the operator felt the cue.
        stopped: a check stopped the arm.
        peak_p50, peak_max: median and largest peak deviation in mm.
        delay: 95th percentile of the time in ms from 3 mm to the cue; None: no session has both.
    """

    kind: str
    outcome: str
    sessions: int
    harmed: int
    beyond: int
    felt: int
    stopped: int
    peak_p50: float
    peak_max: float
    delay: float | None


@dataclass(frozen=True)
class Hazards(Result):
    """Outcomes of the sessions of a campaign.

    Attributes:
        robot, campaign: names.
        expected: number of sessions of the campaign.
        rows: one mapping per session that was done, as in the log, in the order of its index.
        outcomes: outcome in the paper's table, by class.
        assumed: numbers of the machine that are ASSUMED, with their reasons.
    """

    kind = "hazards"
    robot: str
    campaign: str
    expected: int
    rows: Sequence[Mapping[str, Any]]
    outcomes: Mapping[str, str]
    assumed: Sequence[str]

    @cached_property
    def classes(self) -> list[ClassRow]:
        """One row for each class that has sessions."""
        return [
            _row(k, o, rows) for k, o in self.outcomes.items() if (rows := [r for r in self.rows if r["kind"] == k])
        ]

    @property
    def findings(self) -> tuple[Finding, ...]:
        """False cues, and sessions that were not done."""
        out = []
        false = [r["index"] for r in self.rows if r["kind"] == FREE and r["cue"] is not None]
        if false:
            out.append(disagreement("hazards.false", self.robot, f"a cue without a fault in sessions {false[:5]}"))
        if len(self.rows) < self.expected:
            done = f"{len(self.rows)} of {self.expected} sessions are done"
            out.append(
                warning("hazards.unfinished", self.robot, done, suggestion="run the same command again: it goes on")
            )
        return tuple(out)

    @property
    def word(self) -> str:
        """The verdict as text."""
        return "False cues" if self.verdict == "disagree" else "No cue without a fault"

    def content(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "robot": self.robot,
            "campaign": self.campaign,
            "sessions": len(self.rows),
            "expected": self.expected,
            "classes": [vars(row) for row in self.classes],
            "assumed": list(self.assumed),
        }

    def text(self) -> Iterator[Part]:
        """Yield the parts of the printed result."""
        yield f"{self.robot} · {self.campaign} · {len(self.rows)} of {self.expected} sessions"
        head = (
            "class",
            "sessions",
            f"> {HARM:g} mm",
            "> 3 mm",
            "felt",
            "stopped",
            "peak p50 mm",
            "max mm",
            "cue ms p95",
        )
        yield Table(head, [_cells(row) for row in self.classes])
        yield from self.assumed
        yield f"{self.word}"
        yield from self.findings


def _row(kind: str, outcome: str, rows: Sequence[Mapping[str, Any]]) -> ClassRow:
    peaks = np.array([r["peak"] for r in rows])
    late = [r["cue"] - r["beyond"] for r in rows if r["cue"] is not None and r["beyond"] is not None]
    return ClassRow(
        kind,
        outcome,
        len(rows),
        sum(r["harm"] is not None for r in rows),
        sum(r["beyond"] is not None for r in rows),
        sum(r["cue"] is not None for r in rows),
        sum(r["stop"] is not None for r in rows),
        float(np.median(peaks)),
        float(peaks.max()),
        float(np.percentile(late, 95)) if late else None,
    )


def _cells(r: ClassRow) -> tuple[str, ...]:
    counts = (str(n) for n in (r.sessions, r.harmed, r.beyond, r.felt, r.stopped))
    return r.kind, *counts, f"{r.peak_p50:.2f}", f"{r.peak_max:.2f}", "-" if r.delay is None else f"{r.delay:.0f}"
