"""Draw random faults, check them in two processes, and count the results."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from twin.analysis.mutation import cad, formula, trajectory_faults, units, usd
from twin.analysis.mutation.bench import Bench
from twin.analysis.mutation.fault import FAMILIES, Detection, Family, SeededFault
from twin.analysis.mutation.score import Score
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
            alarms = [f for f in bench.correct.findings if f.severity in ("disagreement", "error")]
            outcomes = _judged(bench, families, count=count, seed=seed, share=0, progress=progress)
        progress("wait for the other process", 1.0)
        outcomes |= beside.result()
    in_order = [outcomes[i] for i in sorted(outcomes)]
    return Score(
        bench.robot.name,
        protocol=bench.chosen.name,
        source=bench.robot.mechanism.source,
        seed=seed,
        seconds=time.monotonic() - began,
        outcomes=tuple(in_order),
        false_alarms=tuple(alarms),
    )


@contextlib.contextmanager
def bench_of(robot: str, protocol: str | None) -> Iterator[Bench]:
    """Yield the bench (robot, protocol, stage) for seeding faults, in a temporary folder."""
    loaded = load(robot)
    if loaded.files is None or not loaded.files.formula.is_file():
        raise TwinError(f"{loaded.name} has no equations to check")
    with Scratch() as folder:
        yield Bench(loaded, protocol, Path(folder))


def drawn(bench: Bench, families: Sequence[Family], count: int, seed: int) -> list[SeededFault]:
    """Return the random faults; each family has its own random stream, independent of the other families."""
    shares: dict[Family, int] = {family: SHARES[family] for family in FAMILIES if family in families}
    faults: list[SeededFault] = []
    for family, n in shared_out(count, shares).items():
        rng = np.random.default_rng([seed, FAMILIES.index(family)])
        faults += _faults(family, bench, rng, n)
    return faults


def shared_out(count: int, shares: Mapping[Family, int]) -> dict[Family, int]:
    """Return the number of faults of each family: whole numbers in proportion to `shares`, with the sum `count`.

    The numbers with the largest remainders are rounded up. Each family has at least one fault. If `count` is below the
    number of families, families without a fault are omitted.
    """
    whole = sum(shares.values())
    least = 1 if count >= len(shares) else 0
    numbers: dict[Family, int] = {}
    remainders: dict[Family, float] = {}
    for family, share in shares.items():
        numbers[family] = max(least, count * share // whole)
        remainders[family] = count * share / whole - numbers[family]
    total = sum(numbers.values())
    while total != count:
        step = 1 if total < count else -1
        candidates: list[Family] = [family for family in numbers if step > 0 or numbers[family] > least]
        chosen = max(candidates, key=lambda family: step * remainders[family])
        numbers[chosen] += step
        remainders[chosen] -= step
        total += step
    return {family: number for family, number in numbers.items() if number}


def _faults(family: Family, bench: Bench, rng: np.random.Generator, n: int) -> Iterator[SeededFault]:
    if family == "formula":
        return formula.faults(bench.robot, rng, n)
    if family == "cad":
        return cad.faults(bench.robot.mechanism, rng, n)
    if family == "usd":
        return usd.faults(bench.case().written or bench.stage, rng, n)
    if family == "units":
        return units.faults(bench.robot, bench.file, rng, n)
    return trajectory_faults.faults(bench.trajectory, bench.chosen, bench.planned, rng, n)


def _judged(
    bench: Bench, families: Sequence[Family], count: int, seed: int, share: int, progress: Progress
) -> dict[int, Detection]:
    faults = drawn(bench, families, count, seed)
    indices = range(share, len(faults), 2)
    outcomes = {}
    for k, i in enumerate(indices):
        fault = faults[i]
        progress(f"{fault.family}: {fault.what}"[:60], (k + 1) / (len(indices) + 1))
        outcomes[i] = bench.outcome(fault)
    return outcomes


def _share(
    robot: str, protocol: str | None, families: tuple[Family, ...], count: int, seed: int, share: int
) -> dict[int, Detection]:
    """Check the faults with indices `share`, `share` + 2, ... (`share`: 0 or 1); called in the second process."""
    with bench_of(robot, protocol) as bench:
        return _judged(bench, families, count=count, seed=seed, share=share, progress=lambda label, fraction: None)
