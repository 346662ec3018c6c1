"""Draw random faults, check them in two processes, and count the results."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from twin.analysis.mutation import cad, formula, trajectory_faults, units, usd
from twin.analysis.mutation.bench import Bench
from twin.analysis.mutation.fault import FAMILIES, Detection, Family, SeededFault
from twin.analysis.mutation.score import Score
from twin.api.robot_loading import load
from twin.core.atomic import Scratch
from twin.core.errors import TwinError
from twin.core.jobs import Call
from twin.core.progress import Progress, silent

SHARES: dict[Family, int] = {"formula": 32, "cad": 24, "usd": 28, "units": 14, "timing": 20}
"""Number of faults of each family if the total is the default; other totals are divided in the same proportion."""


def selftest(
    robot: str | Path,
    *,
    protocol: str | None = None,
    families: Sequence[Family] = FAMILIES,
    count: int = sum(SHARES.values()),
    seed: int = 0,
    progress: Progress = silent,
) -> Score:
    """Return the mutation score of the validator on a robot.

    `robot` is the name or folder of a robot with equations, CAD and a protocol. `protocol` is the name of the protocol;
    None: the default protocol of the robot. `count` is the total number of faults. The same `seed` gives the same
    faults.

    Raises:
        TwinError: the robot has no equations, or its protocol cannot be planned.
    """
    start = time.monotonic()
    # plain values: they go to the second process
    task = (str(robot), protocol, tuple(families), count, seed)
    progress("correct robot", 0.0)
    # first, because the other process then prepares its bench while this one does
    with Call(_share, *task, 1) as second_process:
        with bench_of(str(robot), protocol) as bench:
            alarms = []
            for finding in bench.correct_report.findings:
                if finding.severity in ("disagreement", "error"):
                    alarms.append(finding)
            outcomes = _judged(bench, families, count=count, seed=seed, share=0, progress=progress)
        progress("wait for the other process", 1.0)
        outcomes |= second_process.result()
    # in the order of seeding, as if one process had judged all faults
    in_order = []
    for i in sorted(outcomes):
        in_order.append(outcomes[i])
    return Score(
        bench.robot.name,
        protocol=bench.protocol.name,
        source=bench.robot.mechanism.source,
        seed=seed,
        seconds=time.monotonic() - start,
        outcomes=tuple(in_order),
        false_alarms=tuple(alarms),
    )


@contextlib.contextmanager
def bench_of(robot: str, protocol: str | None) -> Iterator[Bench]:
    """Yield the bench (robot, protocol, stage) for seeding faults, in a temporary folder."""
    robot_loaded = load(robot)
    if robot_loaded.files is None or not robot_loaded.files.formula.is_file():
        raise TwinError(f"{robot_loaded.name} has no equations to check")
    with Scratch() as folder:
        yield Bench(robot_loaded, protocol, Path(folder))


def random_faults(bench: Bench, families: Sequence[Family], count: int, seed: int) -> list[SeededFault]:
    """Return the random faults; each family has its own random stream, independent of the other families."""
    shares: dict[Family, int] = {}
    for family in FAMILIES:
        if family in families:
            shares[family] = SHARES[family]
    faults: list[SeededFault] = []
    for family, family_count in shared_out(count, shares).items():
        # the index in FAMILIES, not among the chosen ones: a family has the same faults in every choice
        rng = np.random.default_rng([seed, FAMILIES.index(family)])
        faults += _faults(family, bench, rng, family_count)
    return faults


def shared_out(count: int, shares: Mapping[Family, int]) -> dict[Family, int]:
    """Return the number of faults of each family: whole numbers in proportion to `shares`, with the sum `count`.

    The numbers with the largest remainders are rounded up. Each family has at least one fault. If `count` is below the
    number of families, families without a fault are omitted.
    """
    share_sum = sum(shares.values())
    least = 1 if count >= len(shares) else 0
    numbers: dict[Family, int] = {}
    remainders: dict[Family, float] = {}
    for family, share in shares.items():
        numbers[family] = max(least, count * share // share_sum)
        remainders[family] = count * share / share_sum - numbers[family]
    total = sum(numbers.values())
    while total != count:
        step = 1 if total < count else -1
        candidates: list[Family] = []
        for family, number in numbers.items():
            if step > 0 or number > least:
                candidates.append(family)
        adjusted = max(candidates, key=lambda family: step * remainders[family])
        numbers[adjusted] += step
        remainders[adjusted] -= step
        total += step
    nonzero_numbers: dict[Family, int] = {}
    for family, number in numbers.items():
        if number:
            nonzero_numbers[family] = number
    return nonzero_numbers


def _faults(family: Family, bench: Bench, rng: np.random.Generator, count: int) -> Iterator[SeededFault]:
    """Yield random faults of one family."""
    if family == "formula":
        return formula.faults(bench.robot, rng, count)
    if family == "cad":
        return cad.faults(bench.robot.mechanism, rng, count)
    if family == "usd":
        return usd.faults(bench.case().written or bench.stage, rng, count)
    if family == "units":
        return units.faults(bench.robot, bench.protocol_file, rng, count)
    return trajectory_faults.faults(bench.trajectory, bench.protocol, bench.planned, rng, count)


def _judged(
    bench: Bench, families: Sequence[Family], count: int, seed: int, share: int, progress: Progress
) -> dict[int, Detection]:
    """Return {index of a fault: its result} for every second fault, beginning with the index `share` (0 or 1)."""
    faults = random_faults(bench, families, count, seed)
    indices = range(share, len(faults), 2)
    outcomes = {}
    for done, i in enumerate(indices):
        fault = faults[i]
        progress(f"{fault.family}: {fault.what}"[:60], (done + 1) / (len(indices) + 1))
        outcomes[i] = bench.outcome(fault)
    return outcomes


def _share(
    robot: str, protocol: str | None, families: tuple[Family, ...], count: int, seed: int, share: int
) -> dict[int, Detection]:
    """Check the faults with indices `share`, `share` + 2, ... (`share`: 0 or 1); called in the second process."""
    with bench_of(robot, protocol) as bench:
        return _judged(bench, families, count=count, seed=seed, share=share, progress=lambda label, fraction: None)
