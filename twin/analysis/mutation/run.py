"""Draw random faults, check them in two processes, and count the results."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from twin.analysis.mutation import cad, formula, timing, units, usd
from twin.analysis.mutation.bench import Bench
from twin.analysis.mutation.fault import FAMILIES, Family, Fault, Outcome
from twin.analysis.mutation.result import Score
from twin.api.robot import load
from twin.core.atomic import Scratch
from twin.core.errors import TwinError
from twin.core.jobs import Call

SHARES: dict[Family, int] = {"formula": 32, "cad": 24, "usd": 28, "units": 14, "timing": 20}
"""Number of faults of each family if the total is the default; other totals are divided in the same proportion."""

Progress = Callable[[str, float], None]


def selftest(
    robot: str | Path,
    *,
    protocol: str | None = None,
    families: Sequence[Family] = FAMILIES,
    count: int = sum(SHARES.values()),
    seed: int = 0,
    progress: Progress = lambda label, fraction: None,
) -> Score:
    """Return the mutation score of the validator on a robot.

    `robot` is the name or folder of a robot with equations, CAD and a protocol. `protocol` is the name of the protocol;
    None: the default protocol of the robot. `count` is the total number of faults. The same `seed` gives the same
    faults.

    Raises:
        TwinError: the robot has no equations, or its protocol cannot be planned.
    """
    began = time.monotonic()
    task = (str(robot), protocol, tuple(families), count, seed)
    progress("correct robot", 0.0)
    with Call(_share, *task, 1) as beside:
        with bench_of(str(robot), protocol) as bench:
            alarms = tuple(f for f in bench.correct.findings if f.severity in ("disagreement", "error"))
            mine = _judged(bench, families, count, seed, 0, progress)
        progress("wait for the other process", 1.0)
        theirs: dict[int, Outcome] = beside.result()
    outcomes = {**mine, **theirs}
    return Score(
        bench.robot.name,
        bench.chosen.name,
        bench.robot.mechanism.source,
        seed,
        time.monotonic() - began,
        tuple(outcomes[i] for i in sorted(outcomes)),
        alarms,
    )


@contextlib.contextmanager
def bench_of(robot: str, protocol: str | None) -> Iterator[Bench]:
    """Yield the bench (robot, protocol, stage) for seeding faults, in a temporary folder."""
    loaded = load(robot)
    if loaded.files is None or not loaded.files.formula.is_file():
        raise TwinError(f"{loaded.name} has no equations to check")
    with Scratch() as folder:
        yield Bench(loaded, protocol, Path(folder))


def drawn(bench: Bench, families: Sequence[Family], count: int, seed: int) -> list[Fault]:
    """Return the random faults; each family has its own random stream, independent of the other families."""
    out: list[Fault] = []
    asked: dict[Family, int] = {f: SHARES[f] for f in FAMILIES if f in families}
    for family, n in shared_out(count, asked).items():
        rng = np.random.default_rng([seed, FAMILIES.index(family)])
        out += _faults(family, bench, rng, n)
    return out


def shared_out(count: int, shares: Mapping[Family, int]) -> dict[Family, int]:
    """Return the number of faults of each family: whole numbers in proportion to `shares`, with the sum `count`.

    The numbers with the largest remainders are rounded up. Each family has at least one fault. If `count` is below the
    number of families, families without a fault are omitted.
    """
    whole = sum(shares.values())
    least = 1 if count >= len(shares) else 0
    out: dict[Family, int] = {f: max(least, count * s // whole) for f, s in shares.items()}
    left: dict[Family, float] = {f: count * s / whole - out[f] for f, s in shares.items()}
    while sum(out.values()) != count:
        step = 1 if sum(out.values()) < count else -1
        able: list[Family] = [f for f in out if step > 0 or out[f] > least]
        chosen = max(able, key=lambda f: step * left[f])
        out[chosen] += step
        left[chosen] -= step
    none: list[Family] = [f for f, n in out.items() if not n]
    for family in none:
        del out[family]
    return out


def _faults(family: Family, bench: Bench, rng: np.random.Generator, n: int) -> Iterator[Fault]:
    if family == "formula":
        return formula.faults(bench.robot, rng, n)
    if family == "cad":
        return cad.faults(bench.robot.mechanism, rng, n)
    if family == "usd":
        return usd.faults(bench.case().written or bench.stage, rng, n)
    if family == "units":
        return units.faults(bench.robot, bench.file, rng, n)
    return timing.faults(bench.trajectory, bench.chosen, bench.planned, rng, n)


def _judged(
    bench: Bench, families: Sequence[Family], count: int, seed: int, share: int, progress: Progress
) -> dict[int, Outcome]:
    faults = list(enumerate(drawn(bench, families, count, seed)))[share::2]
    out = {}
    for k, (i, fault) in enumerate(faults):
        progress(f"{fault.family}: {fault.what}"[:60], (k + 1) / (len(faults) + 1))
        out[i] = bench.outcome(fault)
    return out


def _share(
    robot: str, protocol: str | None, families: tuple[Family, ...], count: int, seed: int, share: int
) -> dict[int, Outcome]:
    """Check the faults with indices `share`, `share` + 2, ... (`share`: 0 or 1); called in the second process."""
    with bench_of(robot, protocol) as bench:
        return _judged(bench, families, count, seed, share, lambda label, fraction: None)
