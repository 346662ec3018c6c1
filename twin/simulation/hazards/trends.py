"""The experiments of the second paper (sections 3.1 and 3.2.1) with a plant that differs from its model as ASSUMED.

Without a fault: the deviation of machine and model by motion scale. With one: every 8 s after the pedal, the command of
the first motor is stuck for 300 cycles, four times. The paper's robot, its gains, motion and stuck value are not
published: trends can be compared, numbers cannot.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from twin.core.findings import Finding
from twin.core.result import Part, Result, Table
from twin.core.spatial import Array
from twin.simulation.hazards.attacked import HARM, Trace, trace
from twin.simulation.hazards.fault import Fault
from twin.simulation.hazards.hand import Hand, wander
from twin.simulation.machine.levels import Level
from twin.simulation.machine.machine import Parts
from twin.simulation.machine.plant import TICK

PUBLISHED = (2.43, 1.72)
"""Mean and spread of the paper's fault-free error over its motion scales; the unit, mm, follows from its 3 mm limit."""

SCALES = (0.05, 0.10, 0.15, 0.20)
"""Motion scales of the paper."""

SCALE = 0.10
"""Motion scale of the paper's fault experiment."""

_FREE = 10_000
"""Packets of a fault-free run."""

_EVERY, _CYCLES, _TIMES = 8000, 300, 4
"""Period and duration of the paper's fault in packets, and how often it comes."""

_WATCHED = 1000
"""Packets after a fault in which its jump is looked for."""

_SHARES = (0.0, 0.1, 0.2, 0.25, 0.3, 0.35, 0.4, 1.0)
"""Stuck values, as shares of the motor's limit."""

_MASS, _FRICTION, _SEED = 1.1, 1.3, 1
"""Factors of the machine's masses and friction, and seed of the hand's motion. ASSUMED."""

_MM = 1e3


@dataclass(frozen=True)
class ScaleRow:
    """Deviation of the true tips in mm without a fault, at one motion scale; peak is the largest one."""

    scale: float
    mean: float
    spread: float
    peak: float


@dataclass(frozen=True)
class StuckRow:
    """What a stuck command did.

    Attributes:
        counts: the stuck command.
        peaks: largest deviation in mm during each fault and the second after it, until the arm was stopped.
        jumps: how many of them are more than `HARM`.
        stopped: number of the fault, from 1, in or after which a check stopped the arm; None: none.
        check: which one.
    """

    counts: float
    peaks: list[float]
    jumps: int
    stopped: int | None
    check: str


@dataclass(frozen=True)
class Trends(Result):
    """Both experiments.

    Attributes:
        robot, motor: names of the robot and of its first motor.
        scales, stuck: rows of the tables.
        curves: deviation (k,) in mm in each tick of the run with a stuck command, by its counts.
    """

    kind = "trends"
    judges = False
    robot: str
    motor: str
    scales: Sequence[ScaleRow]
    stuck: Sequence[StuckRow]
    curves: dict[float, Array]

    @property
    def findings(self) -> tuple[Finding, ...]:
        """None: the paper's numbers belong to another plant."""
        return ()

    @property
    def grows(self) -> bool:
        """Whether the mean deviation grows with the motion scale."""
        return bool((np.diff([r.mean for r in self.scales]) > 0).all())

    @property
    def as_published(self) -> list[float]:
        """Stuck values with a jump in each fault and a stop at the last, as in the paper."""
        return [r.counts for r in self.stuck if r.jumps == _TIMES and r.stopped == _TIMES]

    def content(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "robot": self.robot,
            "published_mm": list(PUBLISHED),
            "scales": [asdict(r) for r in self.scales],
            "stuck": [asdict(r) for r in self.stuck],
            "grows_with_scale": self.grows,
            "as_published": self.as_published,
        }

    def text(self) -> Iterator[Part]:
        """Yield the parts of the printed result."""
        yield f"{self.robot} · the paper's experiments with an ASSUMED plant: trends, not numbers"
        yield "\nDeviation without a fault by motion scale"
        rows = [(f"{r.scale:g}", f"{r.mean:.3f}", f"{r.spread:.3f}", f"{r.peak:.3f}") for r in self.scales]
        yield Table(("motion scale", "mean mm", "spread mm", "largest mm"), rows)
        word = "grows" if self.grows else "does not grow"
        yield f"  it {word} with the scale; in the paper it grows, {PUBLISHED[0]} ± {PUBLISHED[1]} mm over these scales"
        yield f"\n{self.motor} stuck for {_CYCLES} cycles every {_EVERY * TICK:g} s, motion scale {SCALE:g}"
        yield Table(
            ("stuck at counts", "peaks mm", f"jumps > {HARM:g} mm", "stopped at fault", "check"),
            [
                (
                    f"{r.counts:.0f}",
                    ", ".join(f"{p:.2f}" for p in r.peaks),
                    str(r.jumps),
                    "-" if r.stopped is None else str(r.stopped),
                    r.check,
                )
                for r in self.stuck
            ],
        )
        same = ", ".join(f"{c:.0f}" for c in self.as_published)
        yield f"  four jumps and a stop at the last, as in the paper: {f'stuck at {same} counts' if same else 'none'}"
        yield f"  ASSUMED masses times {_MASS:g}, friction times {_FRICTION:g}, motion of the hand, stuck values"


def trends(robot: str, parts: Parts, progress: Callable[[str, float], None]) -> Trends:
    """Run both experiments; it takes some 30 s of processor time."""
    settings, steps = parts.settings, len(SCALES) + len(_SHARES)
    physics = parts.plant.physics.changed(_MASS, _FRICTION)

    def hand(scale: float) -> Hand:
        return Hand(settings, scale, wander(_SEED))

    scales = []
    for i, scale in enumerate(SCALES):
        progress(f"motion scale {scale:g}", (i + 1) / (steps + 1))
        apart = _apart(
            parts,
            trace(parts, hand(scale), _FREE, _FREE, physics),
            trace(parts, hand(scale), _FREE, _FREE),
        )
        scales.append(ScaleRow(scale, float(apart.mean()), float(apart.std()), float(apart.max())))
    packets = _EVERY * _TIMES + _CYCLES + _WATCHED
    model = trace(parts, hand(SCALE), packets, packets)
    motor = settings.of_motors(parts.arm.mechanism)[0]
    limit = getattr(motor.dac, settings.mode)
    stuck, curves = [], {}
    for i, share in enumerate(_SHARES):
        counts = share * limit
        progress(f"stuck at {counts:.0f} counts", (len(SCALES) + i + 1) / (steps + 1))
        begins = [_EVERY * (n + 1) for n in range(_TIMES)]
        faults = [Fault("dac", b, b + _CYCLES, "overwrite", counts, 0, counts=True) for b in begins]
        run = trace(parts, hand(SCALE), packets, 1, physics, faults)
        apart = curves[counts] = _apart(parts, run, model)
        stuck.append(_row(counts, apart, run, begins))
    return Trends(robot, motor.name, scales, stuck, curves)


def _apart(parts: Parts, run: Trace, model: Trace) -> Array:
    """Return the distance (k,) of the true tips in mm; after a stop, from where the model was at the stop."""
    k = len(run.q)
    wanted = parts.kin.forward_many(model.q[:k])[:, :3, 3]
    stopped = run.levels == Level.E_STOP
    if stopped.any():
        wanted[stopped] = wanted[int(np.argmax(stopped))]
    return np.linalg.norm(parts.kin.forward_many(run.q)[:, :3, 3] - wanted, axis=1) * _MM


def _row(counts: float, apart: Array, run: Trace, begins: list[int]) -> StuckRow:
    windows = [apart[b - 1 : b - 1 + _CYCLES + _WATCHED] for b in begins]
    peaks = [float(w.max()) for w in windows if len(w)]
    stops = np.flatnonzero(run.levels == Level.E_STOP)
    at = int(sum(b <= stops[0] + 1 for b in begins)) if len(stops) else None
    return StuckRow(counts, peaks, sum(p > HARM for p in peaks), at, run.machine.reason if len(stops) else "")
