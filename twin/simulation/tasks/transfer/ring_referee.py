"""Evaluate a task with rings sample by sample: transferred and dropped rings, collisions of instruments, time, events.

A page shows the results of a `RingsReferee` during the task; for a report, a second one judges the recorded signals.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.core.spoken import spoken
from twin.core.units import MM, hex_digits
from twin.model.movable import Movable
from twin.simulation.contact_scene import Peg
from twin.simulation.session.referee import BEGIN, InstrumentReferee, Tone
from twin.simulation.tasks.transfer.task import Transfers
from twin.simulation.world import Recording
from twin.simulation.world.signal_kinds import OBJECT_HOLDER, OBJECT_POSE

_FALL = 10 * MM
"""Minimum fall in m of a ring that is not held, to count as a drop; ASSUMED."""


@dataclass(frozen=True)
class RingResult:
    """Result of one ring.

    Attributes:
        ring, peg: names of ring and peg.
        t: time in s from which the ring stays around its peg, not held, until the end; None: at the end, the ring is
            held or not around its peg.
        drops: number of times that the ring has been dropped.
    """

    ring: str
    peg: str
    t: float | None
    drops: int


@dataclass(frozen=True)
class BoardMeasures:
    """Measures of the peg board, named as in the paper.

    Attributes:
        rings: result of each ring.
        collisions: number of collisions of an instrument with a fixed part, or with the other instrument.
        time: t_PB, time in s from the first moment in which an arm follows its hand until the last ring is transferred;
            until the end of the session if a ring is not transferred.
    """

    rings: Sequence[RingResult]
    collisions: int
    time: float

    @property
    def transferred(self) -> int:
        """Number of rings that, at the end, are around their pegs and not held (n_RTC in the paper)."""
        count = 0
        for ring in self.rings:
            count += ring.t is not None
        return count

    @property
    def dropped(self) -> int:
        """Number of drops of all rings (n_RD in the paper)."""
        drops = 0
        for ring in self.rings:
            drops += ring.drops
        return drops

    @property
    def errors(self) -> int:
        """Number of drops and collisions together (n_Err in the paper)."""
        return self.dropped + self.collisions

    def rows(self) -> list[tuple[str, str]]:
        """Return the measures as names and values, in the order in which pages and reports show them."""
        return [
            ("Time", f"{self.time:.1f} s"),
            ("Rings transferred", f"{self.transferred} of {len(self.rings)}"),
            ("Rings dropped", str(self.dropped)),
            ("Instrument collisions", str(self.collisions)),
            ("Errors", str(self.errors)),
        ]


class RingsReferee(InstrumentReferee):
    """Judges a task with rings while it is performed.

    Signals: those of `InstrumentReferee`, `<ring>.pose` and `<ring>.holder`.
    """

    ending = "All rings are on their pegs."

    def __init__(
        self,
        goal: Transfers,
        objects: Sequence[Movable],
        pegs: Mapping[str, Peg],
        robots: Sequence[str],
        period: float,
        called: Mapping[str, str] | None = None,
    ) -> None:
        """Begin with no sample.

        Args:
            goal: the rings with their pegs.
            objects: the objects of the scene.
            pegs: {name: peg}.
            robots: the instruments, in the order of the numbers in `<ring>.holder`.
            period: time in s between two samples.
            called: what texts call each robot; None: its name.
        """
        super().__init__(robots, period, called)
        by_name = {item.name: item for item in objects}
        self._rings: list[_Ring] = []
        for transfer in goal.transfers:
            self._rings.append(_Ring(by_name[transfer.ring], pegs[transfer.peg], self._few))

    def _see_task(self, k: int, now: Mapping[str, Array]) -> None:
        for ring in self._rings:
            holder = int(now[OBJECT_HOLDER.of(ring.name)][0])
            news = ring.see(k, now[OBJECT_POSE.of(ring.name)], holder)
            if news is None:
                continue
            tone, text = news
            if tone == "good":
                settled = sum(each.settled for each in self._rings)
                text += f": {settled} of {len(self._rings)}"
            self._tell(k, tone, text)

    @property
    def signals(self) -> list[str]:
        """Names of the signals that the referee reads."""
        names = super().signals
        for ring in self._rings:
            names += [OBJECT_POSE.of(ring.name), OBJECT_HOLDER.of(ring.name)]
        return names

    @property
    def complete(self) -> bool:
        """Whether all rings are around their pegs, and no hand has held a ring for some time."""
        return all(ring.settled for ring in self._rings)

    def measures(self) -> BoardMeasures:
        """Return the measures of all samples so far."""
        results = []
        times = []
        for ring in self._rings:
            result = ring.result(self.period)
            results.append(result)
            if result.t is not None:
                times.append(result.t)
        end = None
        if times and len(times) == len(results):
            end = max(times)
        return BoardMeasures(results, self.collisions, self._duration(end))

    def content(self, last: int = 5) -> JsonObject:
        """Return the scoreboard as plain data: measures, state of each ring, next step, the `last` events."""
        rows = list(map(list, self.measures().rows()))
        called = [self.called[name] for name in self._names]
        rings = []
        for ring in self._rings:
            rings.append([ring.name, ring.state(called), ring.color])
        return {"rows": rows, "rings": rings, "next": self._next(), "events": self._told(last)}

    def _next(self) -> str:
        """Return an instruction for the next step; "" if all rings are on their pegs."""
        if self._begun < 0:
            return BEGIN
        for ring in self._rings:
            if ring.holder >= 0:
                who = self.called[self._names[ring.holder]]
                return f"Bring {spoken(ring.name)} over the {spoken(ring.peg.name)} with {who}; open the jaws there"
        for ring in self._rings:
            if not ring.settled:
                return f"Bring open jaws around {spoken(ring.name)}, and close them"
        return ""


def measure(
    recording: Recording, goal: Transfers, objects: Sequence[Movable], pegs: Mapping[str, Peg], robots: Sequence[str]
) -> BoardMeasures:
    """Return the measures of a task with transfers from recorded signals; other arguments: see `RingsReferee`."""
    referee = RingsReferee(goal, objects, pegs, robots, recording.dt)
    referee.see_all(recording)
    return referee.measures()


def around(T: Array, radius: float, peg: Peg) -> bool:
    """Return whether a ring at a pose T (16,), row by row, in the World has the peg in its hole.

    The peg is in the hole if the axis of the peg intersects the plane of the ring at less than `radius` in m from the
    ring's centre.
    """
    return crossing(T, radius, peg.foot, peg.end) is not None


def crossing(T: Array, radius: float, start: Array, end: Array) -> float | None:
    """Return where a line from `start` (3,) to `end` (3,) crosses a ring: 0 (at `start`) to 1 (at `end`), or None.

    The ring has the pose T (16,), row by row. None: the line does not intersect the plane of the ring at less than
    `radius` in m from the ring's centre.
    """
    # plain numbers: a referee calls this for every ring in every sample, and arrays of 3 numbers take longer
    _, _, nx, x, _, _, ny, y, _, _, nz, z, *_ = T.tolist()
    fx, fy, fz = start.tolist()
    ex, ey, ez = end.tolist()
    wx = ex - fx
    wy = ey - fy
    wz = ez - fz
    slope = nx * wx + ny * wy + nz * wz
    if abs(slope) < 1e-12:  # the line is parallel to the plane of the ring
        return None
    s = (nx * (x - fx) + ny * (y - fy) + nz * (z - fz)) / slope
    if not 0 <= s <= 1:
        return None
    distance = math.hypot(fx + s * wx - x, fy + s * wy - y, fz + s * wz - z)
    return s if distance < radius else None


@dataclass
class _Ring:
    """A ring and its peg: when a hand last held the ring, and since when the ring is around the peg."""

    item: Movable
    peg: Peg
    short_gap: int
    drops: int = 0
    sample: int = -1
    last_held: int | None = None
    """Index of the last sample in which a hand held the ring; None: the ring was never held."""
    holder: int = -1
    release_height: float | None = None
    """Height in m at which a hand last released the ring; None: the ring is held, or was never held."""
    height: float = 0.0
    placed: int | None = None
    told_state: str = field(default="")

    @property
    def name(self) -> str:
        return self.item.name

    @property
    def color(self) -> str:
        """Colour for a page, "#rrggbb", from linear components."""
        return "#" + hex_digits(self.item.color_rgba)

    @property
    def fell(self) -> bool:
        """Whether the ring has fallen by more than `_FALL` since its last release, and is not around its peg."""
        return self.release_height is not None and self.placed is None and self.release_height - self.height > _FALL

    @property
    def is_released(self) -> bool:
        """Whether no hand has held the ring for some time."""
        return self.holder < 0 and (self.last_held is None or self.sample - self.last_held > self.short_gap)

    @property
    def settled(self) -> bool:
        """Whether the ring is around its peg, and no hand has held it for some time."""
        return self.placed is not None and self.is_released

    def see(self, k: int, T: Array, holder: int) -> tuple[Tone, str] | None:
        """Judge sample k; return tone and text of an event, or None."""
        before = self.holder
        self.sample = k
        self.holder = holder
        if holder >= 0:
            # after a short gap, it is still the same grasp
            if self.last_held is None or k - self.last_held > self.short_gap:
                self.drops += self.fell
            self.last_held = k
            self.release_height = None
            self.placed = None
        else:
            self.height = float(T[11])
            if before >= 0:
                self.release_height = self.height
            if not around(T, self.item.size[0], self.peg):
                self.placed = None
            elif self.placed is None:
                self.placed = k
        return self._news()

    def _news(self) -> tuple[Tone, str] | None:
        if self.holder < 0 and not self.is_released:  # a short gap within a grasp is no news
            return None
        before = self.told_state
        self.told_state = self._state_to_tell()
        if self.told_state == before:
            return None
        if self.told_state == "placed":
            return "good", f"{spoken(self.name)} is on its peg"
        if self.told_state == "dropped":
            return "bad", f"{spoken(self.name)} was dropped"
        if before == "placed":
            return "plain", f"{spoken(self.name)} has left its peg"
        return None

    def _state_to_tell(self) -> str:
        """Return "taken" from its peg, "placed", "dropped" or ""."""
        if self.holder >= 0 and self.told_state == "placed":
            return "taken"
        if self.holder >= 0:
            return ""
        if self.placed is not None:
            return "placed"
        if self.fell:
            return "dropped"
        return ""

    def state(self, robots: Sequence[str]) -> str:
        """Return the state of the ring as text: held, on its peg, dropped or not on its peg."""
        if self.holder >= 0:
            return f"held by {robots[self.holder]}"
        if self.settled:
            return "on its peg"
        if self.fell and self.is_released:
            return "dropped"
        return "not on its peg"

    def result(self, dt: float) -> RingResult:
        """Return the result of all samples so far, which are dt in s apart."""
        t = None if self.placed is None else self.placed * dt
        return RingResult(self.name, self.peg.name, t, self.drops + self.fell)
