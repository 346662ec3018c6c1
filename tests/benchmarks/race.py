"""Contenders in turns, so that a busy moment of the machine meets them all; ratios of what each took in a round."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

_busy = False


def by_processor_time() -> None:
    """Measure the processor time of all threads instead of the time by the clock: for a machine that others use."""
    global _busy
    _busy = True


def clock() -> float:
    """Return the time in s by which contenders are compared."""
    return time.process_time() if _busy else time.perf_counter()


def measures() -> str:
    """Return what the times are, for the published page."""
    return "processor times of all threads, because the machine was busy" if _busy else "times by the clock"


@dataclass(frozen=True)
class Effort:
    """How much is run: `short` for every commit, else what is published."""

    short: bool = False

    def of(self, full: int, short: int) -> int:
        """Return a size of the two."""
        return short if self.short else full

    @property
    def rounds(self) -> int:
        """Rounds of all contenders."""
        return self.of(11, 5)

    @property
    def turn(self) -> float:
        """Seconds that a contender runs in one round, at least."""
        return 0.015 if self.short else 0.1


@dataclass
class Contender:
    """One way to do the work of a table; the first of a table is ours.

    Attributes:
        name: shown, and recorded.
        run: does it, for `items`. If it returns an int and `counted`, that many were done: time is per success.
        items: in one run.
        error: its worst error, by the judge of the table, in the table's unit.
        good: how many it answered rightly, of how many.
        bar: its time is at least so many times that of the first.
        watched: whether a fall of its ratio is a fault; not where memory or a second processor decide.
    """

    name: str
    run: Callable[[], object]
    items: int = 1
    error: float | None = None
    good: str = ""
    bar: float | None = None
    counted: bool = False
    watched: bool = True


@dataclass
class Row:
    """A contender when it has run.

    Attributes:
        us: median time of an item in µs; spread: interquartile range of it, relative.
        ratio: median over rounds of its time by that of the first; low, high: quartiles.
        best: ratio of the shortest times of both: what is left of it when others keep the machine busy.
    """

    name: str
    us: float
    spread: float
    ratio: float
    low: float
    high: float
    error: float | None
    good: str
    bar: float | None
    watched: bool = True
    best: float = 1.0

    @property
    def met(self) -> bool:
        """Whether the bar, if there is one, is reached."""
        return self.bar is None or self.ratio >= self.bar


@dataclass
class Fact:
    """A number beside the ratios: an exponent, a difference; `bar` is the most (or, `least`, the least) allowed."""

    name: str
    value: float
    unit: str = ""
    bar: float | None = None
    least: bool = False

    @property
    def met(self) -> bool:
        """Whether the bar, if there is one, is kept."""
        return self.bar is None or (self.value >= self.bar if self.least else self.value <= self.bar)


@dataclass
class Table:
    """What one race found.

    Attributes:
        name: identifier; title: what is done; judge: what the errors are, by whom, in which unit.
        limit: largest error allowed of the first.
        notes: what a reader must know; missing: contenders that are not installed.
        sizes: whether its rows are one contender at several sizes.
    """

    name: str
    title: str
    rows: list[Row] = field(default_factory=list)
    facts: list[Fact] = field(default_factory=list)
    judge: str = ""
    limit: float | None = None
    notes: list[str] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)
    sizes: bool = False

    @property
    def exact(self) -> bool:
        """Whether our own error is within its limit."""
        error = self.rows[0].error if self.rows else None
        return self.limit is None or (error is not None and error <= self.limit)


def installed(table: Table, module: str, name: str) -> bool:
    """Return whether a contender's package is there; say loudly if it is not."""
    if importlib.util.find_spec(module) is not None:
        return True
    print(f"  !! {name} LEFT OUT: {module} is not installed (uv sync --group peers)")
    table.missing.append(name)
    return False


def race(table: Table, contenders: Sequence[Contender], effort: Effort) -> Table:
    """Run the contenders in turns, fill the rows of the table, and print it.

    Each turn repeats a contender until it has run for `effort.turn`; a first turn, not counted, warms it up.
    """
    repeats, times = {}, {c.name: [] for c in contenders}
    for c in contenders:
        start = clock()
        c.run()
        once = clock() - start
        if once < effort.turn:
            start = clock()
            c.run()
            once = clock() - start
        repeats[c.name] = max(1, int(effort.turn / max(once, 1e-7)))
    for _ in range(effort.rounds):
        for c in contenders:
            done = 0
            start = clock()
            for _ in range(repeats[c.name]):
                answer = c.run()
                done += max(answer, 1) if c.counted and isinstance(answer, int) else c.items
            times[c.name].append((clock() - start) / done * 1e6)
    first = np.array(times[contenders[0].name])
    for c in contenders:
        mine = np.array(times[c.name])
        low, median, high = np.percentile(mine, (25, 50, 75))
        ratios = np.percentile(mine / first, (25, 50, 75))
        spread, watched = (high - low) / median, c.watched and not c.name.startswith("twin:")
        row = Row(c.name, median, spread, ratios[1], ratios[0], ratios[2], c.error, c.good, c.bar, watched)
        row.best = mine.min() / first.min()
        table.rows.append(row)
    show(table)
    return table


def show(table: Table) -> None:
    """Print a table."""
    print(f"\n{table.title}")
    for r in table.rows:
        error = "" if r.error is None else f"   off {r.error:.1e}"
        bar = "" if r.bar is None else f"   bar {r.bar:g}{'' if r.met else ' NOT MET'}"
        print(f"  {r.name:46s} {r.us:12.4g} µs   x {r.ratio:8.3g}{error}{'   ' + r.good if r.good else ''}{bar}")
    for f in table.facts:
        bar = "" if f.bar is None else f"   bar {f.bar:g}{'' if f.met else ' NOT MET'}"
        print(f"  {f.name:46s} {f.value:12.4g} {f.unit}{bar}")
    if not table.exact:
        print(f"  OUR ERROR IS ABOVE {table.limit:g}")
