"""How a campaign scales over processes: the same sessions with one process and with all, twice in turns.

    python tests/benchmarks/campaign_scaling.py [sessions]

The scaling is T1 / (n Tn) for n processes; start of Python, loading of the robot and writing of the report count.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time


def main(sessions: int) -> None:
    """Run, and print the times in s, the scaling and the load of the computer."""
    many = len(os.sched_getaffinity(0))
    times: dict[int, list[float]] = {1: [], many: []}
    load = os.getloadavg()
    for _ in range(2):
        for processes, taken in times.items():
            with tempfile.TemporaryDirectory() as folder:
                command = [sys.executable, "-m", "twin", "hazards", "raven_left", "--campaign", "table1", "--quiet"]
                start = time.perf_counter()
                more = ["--sessions", str(sessions), "--processes", str(processes), "--out", folder]
                subprocess.run([*command, *more], check=True, stdout=subprocess.DEVNULL)
                taken.append(round(time.perf_counter() - start, 1))
    scaling = [round(one / (many * all_), 2) for one, all_ in zip(*times.values(), strict=True)]
    print(json.dumps({"sessions": sessions, "seconds": times, "scaling": scaling, "load before": load}))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 300)
