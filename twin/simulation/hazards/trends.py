"""The experiments of the second paper (sections 3.1 and 3.2.1), with ASSUMED differences between plant and model.

First experiment, without a fault: the deviation between machine and model at each motion scale. Second experiment:
the command of the first motor is stuck four times, for 300 cycles each, at intervals of 8 s. The paper does not publish
gains, motion and stuck value of its robot; therefore trends can be compared, but not numbers. The experiments are
defined in cad/raven_left/campaigns/trends.toml.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from twin.core.errors import DescriptionError
from twin.core.findings import Finding
from twin.core.json_types import JsonObject
from twin.core.result import Part, Result, TextTable
from twin.core.spatial import Array
from twin.schema import Table, error_at, load_toml
from twin.simulation.hazards.attacked import HARM, Trace, trace
from twin.simulation.hazards.campaign import SpreadQuantity
from twin.simulation.hazards.fault import Fault
from twin.simulation.hazards.hand import Hand, wander
from twin.simulation.machine.levels import Level
from twin.simulation.machine.motor_plant import TICK
from twin.simulation.machine.simulated_machine import Parts

PUBLISHED = (2.43, 1.72)
"""Mean and spread in mm of the error without faults over all motion scales; the paper's 3 mm limit implies both."""

_NUMBERS = {2: "two", 3: "three", 4: "four", 5: "five"}

_MM = 1e3

_Share = Annotated[float, Field(ge=-1, le=1)]
_Count = Annotated[int, Field(gt=0)]
_Scale = Annotated[float, Field(gt=0, le=1)]


class HandTable(Table):
    """Runs with one motion of the hand: seed of the motion, and stuck values as fractions of the motor's limit."""

    seed: Annotated[int, Field(ge=0)]
    shares: list[_Share] = Field(min_length=1)


class StuckTable(Table):
    """The stuck command: `times` faults of `cycles` packets each, at intervals of `every` packets."""

    scale: _Scale
    every: _Count
    cycles: _Count
    times: _Count
    watched: _Count
    hand: list[HandTable] = Field(min_length=1)


class TrendsTable(Table):
    """File of the experiments, such as cad/raven_left/campaigns/trends.toml."""

    title: str
    source: str
    scales: list[_Scale] = Field(min_length=1)
    free: _Count
    free_hand: Annotated[int, Field(ge=0)]
    mass: SpreadQuantity
    friction: SpreadQuantity
    stuck: StuckTable


def load(path: Path) -> TrendsTable:
    """Read the file of the experiments.

    Raises:
        DescriptionError: the file does not exist or is invalid, or a fault is not shorter than its period; the message
            has file, line, key and value.
    """
    if not path.is_file():
        raise DescriptionError(f"{path}: the file does not exist; cad/raven_left/campaigns/trends.toml is an example")
    table = load_toml(path, TrendsTable)
    if table.stuck.cycles >= table.stuck.every:
        text = f"cycles = {table.stuck.cycles} must be below the period, every = {table.stuck.every} packets"
        raise error_at(path, ("stuck", "cycles"), text)
    return table


@dataclass(frozen=True)
class ScaleRow:
    """Mean, spread and peak in mm of the distance between the true tips without a fault, at one motion scale."""

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
        jumps: number of peaks above `HARM`.
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
        """Whether the mean deviation grows with the motion scale."""
        return bool((np.diff([r.mean for r in self.scales]) > 0).all())

    @property
    def as_published(self) -> list[StuckRow]:
        """Runs with a jump in each fault and a stop at the last fault, as in the paper."""
        times = self.table.stuck.times
        return [r for r in self.stuck if r.jumps == times and r.stopped == times]

    def content(self) -> JsonObject:
        """Return plain data."""
        return {
            "robot": self.robot,
            "published_mm": list(PUBLISHED),
            "scales": [asdict(r) for r in self.scales],
            "stuck": [asdict(r) for r in self.stuck],
            "grows_with_scale": self.grows,
            "as_published": [asdict(r) for r in self.as_published],
        }

    def text(self) -> Iterator[Part]:
        """Yield the parts of the printed result."""
        yield f"{self.robot} · the paper's experiments with an ASSUMED plant: trends, not numbers"
        yield "\nDeviation without a fault by motion scale"
        rows = [(f"{r.scale:g}", f"{r.mean:.3f}", f"{r.spread:.3f}", f"{r.peak:.3f}") for r in self.scales]
        yield TextTable(("motion scale", "mean mm", "spread mm", "largest mm"), rows)
        word = "grows" if self.grows else "does not grow"
        paper = f"in the paper it grows, {PUBLISHED[0]} ± {PUBLISHED[1]} mm over these scales"
        yield f"  the deviation {word} with the scale; {paper}"
        t = self.table.stuck
        yield f"\n{self.motor} stuck for {t.cycles} cycles every {t.every * TICK:g} s, motion scale {t.scale:g}"
        yield TextTable(
            ("hand", "stuck at counts", "peaks mm", f"jumps > {HARM:g} mm", "stopped at fault", "check"),
            [
                (
                    str(r.hand),
                    f"{r.counts:.0f}",
                    ", ".join(f"{p:.2f}" for p in r.peaks),
                    str(r.jumps),
                    "-" if r.stopped is None else str(r.stopped),
                    r.check,
                )
                for r in self.stuck
            ],
        )
        same = ", ".join(f"hand {r.hand} stuck at {r.counts:.0f} counts" for r in self.as_published)
        count = _NUMBERS.get(t.times, str(t.times))
        yield f"  {count} jumps and a stop at the last, as in the paper: {same or 'none'}"
        for name, q in (("masses", self.table.mass), ("friction", self.table.friction)):
            yield f"  {q.provenance} {name} times {q.value:g}: {q.note}"
        yield "  ASSUMED motions of the hand and stuck values: not published"


def trends(robot: str, parts: Parts, table: TrendsTable, progress: Callable[[str, float], None]) -> Trends:
    """Run both experiments, which takes about 30 s of processor time."""
    settings, t = parts.settings, table.stuck
    steps = len(table.scales) + sum(len(hand.shares) for hand in t.hand)
    physics = parts.plant.physics.changed(table.mass.value, table.friction.value)

    def hand(scale: float, seed: int) -> Hand:
        return Hand(settings, scale, wander(seed))

    scales = []
    for i, scale in enumerate(table.scales):
        progress(f"motion scale {scale:g}", (i + 1) / (steps + 1))
        both = (trace(parts, hand(scale, table.free_hand), table.free, table.free, p) for p in (physics, None))
        apart = _apart(parts, *both)
        scales.append(ScaleRow(scale, float(apart.mean()), float(apart.std()), float(apart.max())))
    packets = t.every * t.times + t.cycles + t.watched
    motor = settings.of_motors(parts.arm.mechanism)[0]
    limit = getattr(motor.dac, settings.mode)
    begins = [t.every * (n + 1) for n in range(t.times)]
    stuck, curves = [], {}
    for one in t.hand:
        model = trace(parts, hand(t.scale, one.seed), packets, packets)
        for share in one.shares:
            counts = share * limit
            progress(f"stuck at {counts:.0f} counts", (len(scales) + len(stuck) + 1) / (steps + 1))
            faults = [Fault("dac", b, b + t.cycles, "overwrite", counts, 0, counts=True) for b in begins]
            run = trace(parts, hand(t.scale, one.seed), packets, 1, physics, faults)
            apart = curves[one.seed, counts] = _apart(parts, run, model)
            stuck.append(_row(one.seed, counts, apart, run, begins, t.cycles + t.watched))
    return Trends(robot, motor.name, scales, stuck, curves, table)


def _apart(parts: Parts, run: Trace, model: Trace) -> Array:
    """Return the distance (k,) in mm between the true tips; after a stop, the model's tip at the stop is used."""
    k = len(run.q)
    wanted = parts.kin.forward_many(model.q[:k])[:, :3, 3]
    stopped = run.levels == Level.E_STOP
    if stopped.any():
        wanted[stopped] = wanted[int(np.argmax(stopped))]
    return np.linalg.norm(parts.kin.forward_many(run.q)[:, :3, 3] - wanted, axis=1) * _MM


def _row(hand: int, counts: float, apart: Array, run: Trace, begins: list[int], watched: int) -> StuckRow:
    windows = [apart[b - 1 : b - 1 + watched] for b in begins]
    peaks = [float(w.max()) for w in windows if len(w)]
    stops = np.flatnonzero(run.levels == Level.E_STOP)
    at = int(sum(b <= stops[0] + 1 for b in begins)) if len(stops) else None
    return StuckRow(hand, counts, peaks, sum(p > HARM for p in peaks), at, run.machine.reason if len(stops) else "")
