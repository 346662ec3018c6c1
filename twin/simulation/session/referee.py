"""Common parts of the referees of tasks with movable objects: events, intervals of contact, collisions."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from numpy.typing import ArrayLike

from twin.core.spatial import Array
from twin.simulation.world import Block, Recording, Signals
from twin.simulation.world.signal_kinds import ROBOT_FOLLOWS, ROBOT_MEETS, ROBOT_TOUCHES

Tone = Literal["good", "plain", "bad"]

BEGIN = "Drag an instrument to begin: the clock starts with its first motion."
"""Instruction of a page before the first motion."""

SHORT = 0.25
"""Minimum duration in s of an interruption that ends a grasp or a collision; ASSUMED."""


@dataclass(frozen=True)
class Event:
    """An event that a page reports immediately.

    Attributes:
        t: time in s since the first moment in which an arm follows its hand; before it, 0.
        tone: "good": a step is done; "bad": an error; "plain": neutral.
        text: the sentence.
    """

    t: float
    tone: Tone
    text: str


@dataclass
class Runs:
    """Counts intervals of samples with contact; intervals at most `few` samples apart count as one."""

    few: int
    count: int = 0
    last: int | None = None

    def see(self, k: int, on: bool) -> bool:
        """Add sample k (`on`: with contact); return whether an interval of contact begins at this sample."""
        if not on:
            return False
        begins = self.last is None or k - self.last > self.few
        self.count += begins
        self.last = k
        return begins


class InstrumentReferee(Block):
    """Counts collisions of the instruments while a task is performed; writes no signal. A subclass checks the task.

    Signals: `<robot>.touches`, `<robot>.meets`, `<robot>.follows`.

    Attributes:
        period: time in s between two samples.
        events: all events so far, in order of time.
        ending: sentence for the end of an attempt in which the task was completed.
        called: what texts call each robot.
    """

    outputs: Mapping[str, ArrayLike] = {}
    ending = ""
    _touched = "the board"

    def __init__(self, robots: Sequence[str], period: float, called: Mapping[str, str] | None = None) -> None:
        """Begin with no sample.

        Args:
            robots: the instruments, in the order of the numbers in `<object>.holder`.
            period: time in s between two samples.
            called: what texts call each robot; None: its name.
        """
        self.called = dict(zip(robots, robots, strict=True)) if called is None else dict(called)
        self.period = period
        self.events: list[Event] = []
        self._names = tuple(robots)
        self._few = round(SHORT / period)
        self._hits: list[Runs] = []
        for _ in robots:
            self._hits.append(Runs(self._few))
        self._meetings = Runs(self._few)
        self._samples = 0
        self._begun = -1

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, Array]:
        """Judge the signals at the end of this tick."""
        self.see(signals.now)
        return {}

    @property
    def signals(self) -> list[str]:
        """Names of the signals that the referee reads."""
        names = []
        for robot in self._names:
            names += [ROBOT_TOUCHES.of(robot), ROBOT_MEETS.of(robot), ROBOT_FOLLOWS.of(robot)]
        return names

    def see_all(self, recording: Recording) -> None:
        """Judge all samples of a recording; the referee must have no samples yet, and the period of the recording."""
        for sample in recording.samples(self.signals):
            self.see(sample)

    def see(self, sample: Mapping[str, Array]) -> None:
        """Judge one sample, `period` after the sample before."""
        k = self._samples
        self._samples += 1
        if self._begun < 0:
            for name in self._names:
                if sample[ROBOT_FOLLOWS.of(name)][0] > 0.5:
                    self._begun = k
        # before the collisions: an event of the task is reported before a touch in the same sample
        self._see_task(k, sample)
        has_met = False
        for name, hits in zip(self._names, self._hits, strict=True):
            has_met |= bool(sample[ROBOT_MEETS.of(name)][0] > 0.5)
            if hits.see(k, bool(sample[ROBOT_TOUCHES.of(name)][0] > 0.5)):
                self._tell(k, "bad", f"{self.called[name]} touched {self._touched}")
        if self._meetings.see(k, has_met):
            names_of_both = " and ".join([self.called[name] for name in self._names])
            self._tell(k, "bad", f"{names_of_both} touched each other")

    @abstractmethod
    def _see_task(self, k: int, now: Mapping[str, Array]) -> None:
        """Check the requirements of the task at sample k."""

    @property
    def collisions(self) -> int:
        """Number of collisions of an instrument with a fixed part, or with the other instrument."""
        count = self._meetings.count
        for hits in self._hits:
            count += hits.count
        return count

    def _duration(self, end: float | None) -> float:
        """Return the time in s from the first moment in which an arm follows its hand to `end` (None: until now)."""
        if self._begun < 0:
            return 0.0
        if end is None:
            end = self._samples * self.period
        return end - self._begun * self.period

    def _tell(self, k: int, tone: Tone, text: str) -> None:
        """Add an event at sample k."""
        samples = 0
        if self._begun >= 0:  # the clock of the page starts with the first motion
            samples = k - self._begun
        self.events.append(Event(samples * self.period, tone, text))

    def _told(self, last: int) -> list[list]:
        """Return the newest events, at most `last`, as plain data."""
        rows: list[list] = []
        for event in self.events[-last:]:
            rows.append([round(event.t, 1), event.tone, event.text])
        return rows
