"""Workspaces: what making grids and keeping results costs beside the kernel, and how much memory a large one takes."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile

import numpy as np
from race import Contender, Effort, Fact, Table, race, show

import twin
from twin.analysis import grid_workspace as reach
from twin.analysis.pose_grid import PoseGrid
from twin.core import jobs, spatial

_PEAK = """
import pathlib, re, sys
from twin.cli import main
main(["workspace", "sils", "--count", sys.argv[1], "--out", sys.argv[2], "--quiet"])
print(re.search(r"VmHWM:\\s+(\\d+)", pathlib.Path("/proc/self/status").read_text())[1])  # in kB
"""


def topic(effort: Effort) -> list[Table]:
    """Measure throughput and memory."""
    if effort.short:
        return [_on_one_processor(effort)]
    return [throughput(effort), memory()]


def _on_one_processor(effort: Effort) -> Table:
    """Return the throughput on one processor, for the form that is held to a record.

    Numpy takes one processor. Where another program keeps the second one busy, a ratio of two to one falls, although
    twin is no slower.
    """
    before = os.environ.get(jobs.PROCESSORS)
    os.environ[jobs.PROCESSORS] = "1"
    jobs.usable_processors.cache_clear()
    try:
        return throughput(effort)
    finally:
        del os.environ[jobs.PROCESSORS]
        if before is not None:
            os.environ[jobs.PROCESSORS] = before
        jobs.usable_processors.cache_clear()


def throughput(effort: Effort) -> Table:
    """SILS in one orientation, conditioning included: the whole sweep, its kernel alone, and numpy's way."""
    robot = twin.load("sils")
    kin, T = robot.kinematics(), reach.centre(robot)
    low, high = reach.box(robot, T)
    count = effort.of(10_000_000, 400_000)
    step = float((np.prod(high - low) / count) ** (1 / 3))
    nx, ny, nz = (int(n) for n in np.floor((high - low) / step) + 1)
    grid = PoseGrid(low, step, (nx, ny, nz), T[:3, :3])
    kernel = reach.judge(robot, grid)
    parts = [np.arange(a, b, dtype=np.float64)[None] for a, b in reach.chunks(grid)]
    some = spatial.pose(T[:3, :3], grid.position(np.linspace(0, grid.positions - 1, 5000).astype(int)))

    def whole() -> None:
        reach.over_grid(robot, grid)

    def alone() -> None:
        for numbers in parts:
            kernel(numbers)

    def numpy_way() -> None:
        with np.errstate(all="ignore"):
            q = kin.inverse_many(some)
            kin.condition_many(some, q)

    found = reach.over_grid(robot, grid)
    at = np.flatnonzero(found.reached)[:: max(1, int(found.reached.sum()) // 500)]
    Ts = spatial.pose(T[:3, :3], grid.position(at))
    error = float(np.abs(1 / kin.condition_many(Ts) - found.values[at, 1]).max())
    table = Table(
        "throughput",
        f"Workspace of SILS with conditioning, {grid.poses:.2g} poses",
        judge="inverse condition numbers against numpy's singular values (kept in single precision)",
        limit=1e-7,
    )
    contenders = [
        Contender("twin workspace", whole, grid.poses, error),
        Contender("its kernel alone", alone, grid.poses, bar=0.5),
        Contender("equations by CasADi, eigenvalues by numpy", numpy_way, len(some)),
    ]
    return race(table, contenders, effort)


def memory() -> Table:
    """Peak memory of the whole command, for ten times as many poses."""
    table = Table("memory", "Memory of twin workspace sils")
    peaks = []
    for count in ("1e6", "1e7"):
        with tempfile.TemporaryDirectory() as folder:
            done = subprocess.run(
                [sys.executable, "-c", _PEAK, count, folder], capture_output=True, text=True, check=True
            )
        peaks.append(float(done.stdout.splitlines()[-1]) / 1024)
        table.facts.append(Fact(f"peak at {count} poses", peaks[-1], "MB"))
    table.facts.append(Fact("more for ten times the poses", peaks[1] - peaks[0], "MB", bar=500.0))
    show(table)
    return table
