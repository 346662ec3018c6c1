"""Result of the published experiments: rows of both tables, their text, and the comparison with the paper."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from twin.core.findings import Finding
from twin.core.json_types import JsonObject
from twin.core.result import Part, Result, TextTable
from twin.core.spatial import Array
from twin.simulation.campaigns.attacked_session import HARM
from twin.simulation.campaigns.trends_table import TrendsTable
from twin.simulation.machine.physics import TICK

PUBLISHED = (2.43, 1.72)
"""Mean and spread in mm of the error without faults over all motion scales; the paper's 3 mm limit implies both."""

_NUMBER_WORDS = {2: "two", 3: "three", 4: "four", 5: "five"}


@dataclass(frozen=True)
class ScaleRow:
    """Mean, spread and peak in mm of the distance between the true tips without a fault, at one motion scale.

    `servo` is that of the model, "released" or "paper".
    """

    servo: str
    scale: float
    mean: float
    spread: float
    peak: float


@dataclass(frozen=True)
class StuckRow:
    """Consequences of a stuck command in one run.

    Attributes:
        hand: seed of the motion of the hand.
        counts: the stuck command in counts of the DAC.
        peaks: largest deviation in mm during and shortly after each fault, until the arm was stopped.
        jumps: number of faults that moved the tip by more than `HARM` from where the same machine without a fault is.
        stopped: number of the fault, from 1, in or after which a check stopped the arm; None: no stop.
        check: reason of the stop; "" without a stop.
    """

    hand: int
    counts: float
    peaks: list[float]
    jumps: int
    stopped: int | None
    check: str


@dataclass(frozen=True)
class Trends(Result):
    """Results of both experiments.

    Attributes:
        robot, motor: names of the robot and of its first motor.
        scales, stuck: rows of the tables.
        curves: for each run with a stuck command, the deviation (k,) in mm in each tick; the keys are (seed of the
            hand, stuck command in counts of the DAC).
        table: the file of the experiments.
    """

    kind = "trends"
    judges = False
    robot: str
    motor: str
    scales: Sequence[ScaleRow]
    stuck: Sequence[StuckRow]
    curves: dict[tuple[int, float], Array]
    table: TrendsTable

    @property
    def findings(self) -> tuple[Finding, ...]:
        """No findings, because the paper's numbers belong to another plant."""
        return ()

    @property
    def grows(self) -> bool:
        """Whether the mean deviation grows with the motion scale, with each servo."""
        for rows in self.by_servo.values():
            means = [row.mean for row in rows]
            if not (np.diff(means) > 0).all():
                return False
        return True

    @property
    def within(self) -> bool:
        """Whether the mean deviation at every scale, with each servo, is within the published mean and spread."""
        mean, spread = PUBLISHED
        return all(abs(row.mean - mean) <= spread for row in self.scales)

    @property
    def by_servo(self) -> dict[str, list[ScaleRow]]:
        """Rows of the motion scales for each servo of the model."""
        rows: dict[str, list[ScaleRow]] = {}
        for row in self.scales:
            rows.setdefault(row.servo, []).append(row)  # in the order of the scales, on which `grows` relies
        return rows

    @property
    def as_published(self) -> list[StuckRow]:
        """Runs with a jump in each fault and a stop at the last fault, as in the paper."""
        times = self.table.stuck.times
        rows = []
        for row in self.stuck:
            if row.jumps == times and row.stopped == times:
                rows.append(row)
        return rows

    def content(self) -> JsonObject:
        """Return plain data."""
        return {
            "robot": self.robot,
            "published_mm": list(PUBLISHED),
            "scales": list(map(asdict, self.scales)),
            "stuck": list(map(asdict, self.stuck)),
            "grows_with_scale": self.grows,
            "within_published": self.within,
            "as_published": list(map(asdict, self.as_published)),
        }

    def text(self) -> Iterator[Part]:
        """Yield the parts of the printed result."""
        yield f"{self.robot} · the paper's experiments with an ASSUMED plant: trends, not numbers"
        yield "\nDeviation without a fault by motion scale"
        scale_rows = []
        for row in self.scales:
            sizes = f"{row.mean:.3f}", f"{row.spread:.3f}", f"{row.peak:.3f}"
            scale_rows.append((row.servo, f"{row.scale:g}", *sizes))
        yield TextTable(("servo of the model", "motion scale", "mean mm", "spread mm", "largest mm"), scale_rows)
        word = "grows" if self.grows else "does not grow"
        place = "within" if self.within else "not within"
        paper = f"in the paper it grows, {PUBLISHED[0]} ± {PUBLISHED[1]} mm over these scales"
        yield f"  the deviation {word} with the scale; {paper}; the means above are {place} these limits"
        stuck = self.table.stuck
        period = stuck.every * TICK
        yield f"\n{self.motor} stuck for {stuck.cycles} cycles every {period:g} s, motion scale {stuck.scale:g}"
        stuck_rows = []
        for row in self.stuck:
            peaks = ", ".join(f"{peak:.2f}" for peak in row.peaks)
            stopped = "-" if row.stopped is None else str(row.stopped)
            stuck_rows.append((str(row.hand), f"{row.counts:.0f}", peaks, str(row.jumps), stopped, row.check))
        head = ("hand", "stuck at counts", "peaks mm", f"jumps > {HARM:g} mm", "stopped at fault", "check")
        yield TextTable(head, stuck_rows)
        published = []
        for row in self.as_published:
            published.append(f"hand {row.hand} stuck at {row.counts:.0f} counts")
        published_text = ", ".join(published) or "none"
        count = _NUMBER_WORDS.get(stuck.times, str(stuck.times))
        yield f"  {count} jumps and a stop at the last, as in the paper: {published_text}"
        for name, quantity in (("masses", self.table.mass), ("friction", self.table.friction)):
            yield f"  {quantity.provenance} {name} times {quantity.value:g}: {quantity.note}"
        for cable in self.table.cable:
            values = f"stiffness {cable.stiffness:g}, play ± {cable.play:g}"
            yield f"  {cable.provenance} cable of {cable.joint}, {values}: {cable.note}"
        servo = self.table.paper_servo
        if servo is not None:
            yield f"  {servo.provenance} ki = {servo.ki:g} of {servo.motor} in the servo of the paper: {servo.note}"
        yield "  ASSUMED motions of the hand and stuck values: not published"
