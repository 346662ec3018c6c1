"""Does the reachable set, found in the background, slow the hand? Drag steps of SILS alone and beside it, in turns.

    python tests/benchmarks/viewer_workspace.py

A drag step is what the viewer does 60 times a second: inverse, then the independent model from the last assembly.
Required: 95 % of the steps below 5 ms alone and below 16 ms beside the cloud. Not a test.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import time

import numpy as np

import twin
from twin.core.units import MM
from twin.ui.session.workspace_cloud import Cloud, WorkspaceJob

ROUNDS, ALONE, RATE = 4, 4.0, 60.0


def main() -> None:
    """Print the times of drag steps and the speed of the cloud."""
    robot = twin.load("sils")
    kin, model = robot.kinematics(), robot.reference()
    assembly = model.home()
    home = assembly.T_base_tool.copy()
    limits = np.array([j.limits for j in robot.mechanism.active])
    job = WorkspaceJob("sils", None, {}, limits, home, reach=0.3)
    cloud, steps, q = Cloud(), 0, kin.inverse(home)
    times: dict[str, list[float]] = {"alone": [], "beside the cloud": []}
    totals: list[float] = []

    def drag(kind: str) -> tuple[int, int]:
        """Take one step and wait for the next; return how many poses were told of, and how many reachable."""
        nonlocal assembly, steps, q
        start = time.perf_counter()
        T = home.copy()
        T[:3, 3] += 10 * MM * np.sin(steps / RATE * np.array([2.0, 3.0, 5.0]))
        q = kin.inverse(T, q)
        assembly = model.solve(q, assembly)
        chunk = cloud.poll()
        spent = time.perf_counter() - start
        times[kind].append(spent)
        steps += 1
        time.sleep(max(0.0, 1 / RATE - spent))
        if chunk is not None and chunk.error:
            raise SystemExit(chunk.error)
        return (chunk.evaluated, len(chunk.points)) if chunk else (0, 0)

    first = reached = 0.0
    for turn in range(ROUNDS):
        for _ in range(int(ALONE * RATE)):
            drag("alone")
        start = time.perf_counter()
        cloud.start(job)
        started = time.perf_counter() - start
        evaluated, reached, first = 0, 0, 0.0
        while evaluated < job.count:
            told, found = drag("beside the cloud")
            evaluated, reached = max(told, evaluated), reached + found
            first = first or (time.perf_counter() - start if told else 0.0)
        totals.append(time.perf_counter() - start)
        print(f"job {turn + 1}: {totals[-1]:.2f} s, {job.count / totals[-1]:.0f} poses/s, {reached} reachable; "
              f"start() took {started / 1e-3:.1f} ms, first points after {first:.2f} s")  # fmt: skip
    cloud.close()
    for kind, values in times.items():
        p50, p95, most = np.percentile(values, [50, 95, 100]) / 1e-3
        print(f"drag step {kind:17s} p50 {p50:6.2f}  p95 {p95:6.2f}  max {most:6.2f} ms   ({len(values)} steps)")


if __name__ == "__main__":
    main()
