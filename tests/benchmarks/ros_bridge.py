"""How long a pose of a hand takes from a ROS client through `twin serve --ros` to the answer, both hands at 500 Hz.

    python tests/benchmarks/ros_bridge.py [--seconds 60]

`twin serve davinci` runs as a user starts it; a client of the protocol rosbridge sends the poses of both hands. The
right hand moves on by a known way with each message, so that a message of /PSM1/setpoint_cp shows which pose it has
used. Its time is counted from the sending of the newest pose that it shows. Exit code 1 if the 95th percentile is 5 ms
or more, or if a pose was refused or the last one did not arrive. Not a test.
"""

from __future__ import annotations

import argparse
import asyncio
import re
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(HERE / "tests"))

from made.ros_client import HANDS, RosPens, connected, placed
from twin.core import spatial

RATE = 500
"""Poses of each hand per second."""

SPEED = 0.01
"""Speed of the right hand in m/s; it goes to and fro, so that the instrument stays within its limits."""

TURN = 2.0
"""Time in s between two changes of direction."""

BAR_MS = 5.0


async def measure(port: int, seconds: float) -> tuple[np.ndarray, list, int]:
    """Return (delays in s, status messages, number of poses of each hand)."""
    async with connected(port) as client:
        await client.send("subscribe", topic="/PSM1/setpoint_cp")
        await client.send("subscribe", topic="/PSM1/operating_state")
        pens = RosPens(client)
        while not (client.heard.get("/PSM1/setpoint_cp") and client.heard.get("/PSM1/operating_state")):
            await pens.send()
            await asyncio.sleep(0.002)
        for _ in range(RATE // 5):
            await pens.send()
            await asyncio.sleep(0.002)
        pens.roll()
        while not client.heard["/PSM1/operating_state"][-1]["is_busy"]:
            await pens.send()
            await asyncio.sleep(0.002)
        for _ in range(RATE // 5):
            await pens.send()
            await asyncio.sleep(0.002)
        origin = placed(client.heard["/PSM1/setpoint_cp"][-1])[:3, 3]
        arrivals: list[tuple[float, float]] = []
        take = client._take

        def noted(data):
            before = len(client.heard["/PSM1/setpoint_cp"])
            take(data)
            if len(client.heard["/PSM1/setpoint_cp"]) > before:
                way = placed(client.heard["/PSM1/setpoint_cp"].pop())[:3, 3] - origin
                arrivals.append((time.perf_counter(), float(np.linalg.norm(way))))

        client._take = noted
        sent: list[tuple[float, float]] = []
        begin = time.perf_counter()
        start = pens.p["right"].copy()
        k = 0
        while (now := time.perf_counter() - begin) < seconds:
            # A triangle wave of the way: 0 to SPEED * TURN and back.
            phase = (now / TURN) % 2
            way = SPEED * TURN * (phase if phase < 1 else 2 - phase)
            pens.p["right"] = start + np.array((way, 0, 0))
            for side, name in HANDS.items():
                await client.pose(f"/{name}/measured_cp", spatial.pose(pens.R[side], pens.p[side]))
            sent.append((time.perf_counter(), 0.5 * way))
            k += 1
            await asyncio.sleep(max(0.0, begin + k / RATE - time.perf_counter()))
        await asyncio.sleep(0.2)
        return _delays(np.array(sent), np.array(arrivals)), client.statuses, k


def _delays(sent: np.ndarray, arrivals: np.ndarray) -> np.ndarray:
    """Return the time from the sending of the pose that an answer shows to its arrival, for each answer."""
    delays = []
    for at, way in arrivals:
        last = int(np.searchsorted(sent[:, 0], at)) - 1
        for k in range(last, max(last - 200, -1), -1):
            if abs(sent[k, 1] - way) < 1e-8:
                delays.append(at - sent[k, 0])
                break
    return np.array(delays)


def main() -> int:
    """Measure and print; see the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    options = parser.parse_args()
    command = [sys.executable, "-m", "twin", "serve", "davinci", "--port", "0", "--ros", "0", "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            port = next(
                int(f[1]) for line in process.stdout if (f := re.search(r"clients: ws://127\.0\.0\.1:(\d+)", line))
            )
            delays, statuses, count = asyncio.run(measure(port, options.seconds))
        finally:
            process.terminate()
    low, median, high, worst = 1000 * np.percentile(delays, (5, 50, 95, 100))
    print(f"{count} poses of each hand in {options.seconds:g} s, {len(delays)} answers, {len(statuses)} refusals")
    print(f"from the pose to the answer: 5 % {low:.2f}, median {median:.2f}, 95 % {high:.2f}, most {worst:.2f} ms")
    for level, text in statuses[:5]:
        print(f"  {level}: {text}")
    return 1 if high >= BAR_MS or statuses else 0


if __name__ == "__main__":
    sys.exit(main())
