"""How fast the World of the da Vinci's console is: two instrument arms and the endoscope arm under two moving hands.

    python tests/benchmarks/teleoperation.py            20 s of a session: real-time factor, duration of a tick
    python tests/benchmarks/teleoperation.py --haptics  the same with forces on the hands, which push into the board

One process on one processor, without display or network. The hands never rest: both move, turn and grip all the time;
each second has a clutch (50 ms) and a motion of the camera (100 ms). With forces, an instrument touches the board in
half of the ticks.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import sys
import time
from dataclasses import replace

import numpy as np

import twin
from twin.api.scene_parts import members_of, props_of, robots_at
from twin.core import spatial
from twin.core.units import DEG, MM
from twin.simulation import console_scene
from twin.simulation.condition import Condition
from twin.simulation.console_scene import HANDS, PEDALS
from twin.simulation.devices.recorded import Recorded
from twin.simulation.setup import Setup
from twin.simulation.world import Recording, World

DT = 1e-3
SECONDS = 20
LOWER, DOWN = 40 * MM, (0.0, -0.493, -0.870)
"""With forces: way of the hands in m to the board, and its direction in the picture."""
BAR, BAR_WITH_FORCES, SLOWEST = 20.0, 2.0, 1e-3
"""Required real-time factors without and with forces; largest 99th percentile of the duration of a tick in s."""


def hands(ticks: int, lower: float = 0.0) -> Recording:
    """Return a recording of both hands and the pedals; in the second second, the hands go down by `lower` in m."""
    t = np.arange(ticks) * DT
    signals: dict[str, np.ndarray] = {}
    for hand, side in zip(HANDS, (1.0, -1.0), strict=True):
        p = 6 * MM * np.stack([np.sin(5 * t), side * np.sin(7 * t), np.cos(4 * t) - 1], 1)
        p += np.outer(np.clip(t - 1, 0, 1) * lower, DOWN)
        R = spatial.exp_so3(np.outer(20 * DEG * np.sin(3 * t), [0.2, side, 0.4]))
        signals[f"{hand}.pose"] = spatial.pose(R, p).reshape(ticks, 16)
        signals[f"{hand}.grip"] = 25 * DEG * (1 - np.cos(2 * np.pi * t))
    part = t % 1
    signals[f"{PEDALS}.clutch"] = (part > 0.90) & (part < 0.95)
    signals[f"{PEDALS}.camera"] = (part > 0.75) & (part < 0.85)
    signals[f"{PEDALS}.scale"] = np.full(ticks, 0.5)
    rows = {name: np.asarray(v, float).reshape(ticks, -1) for name, v in signals.items()}
    return Recording(DT, {name: v.shape[1] for name, v in rows.items()}, np.hstack([*rows.values()]))


def world(ticks: int, haptics: bool = False) -> World:
    """Return the World of the scene `davinci` under these hands."""
    scene = twin.load_scene("davinci")
    setup = Setup(scene, members_of(robots_at(scene.places)))
    if haptics:
        setup = replace(setup, props=props_of(scene), condition=Condition(haptics=True))
    device = Recorded(hands(ticks, LOWER if haptics else 0.0), *HANDS, PEDALS)
    return console_scene.world(setup, device)


def durations(ticks: int, haptics: bool = False) -> np.ndarray:
    """Return the duration (ticks,) of each tick in s, after 100 ticks that compile and import."""
    run = world(ticks + 100, haptics)
    run.step(100)
    stamps = np.zeros(ticks + 1)
    stamps[0] = time.perf_counter()
    for k in range(ticks):
        run.step()
        stamps[k + 1] = time.perf_counter()
    if haptics:
        felt = [np.linalg.norm(run.recording()[f"{hand}.force"], axis=1) for hand in HANDS]
        print(f"forces in {100 * np.mean(felt[0] + felt[1] > 0):.0f} % of the ticks, up to {np.max(felt):.1f} N")
    return np.diff(stamps)


def main() -> int:
    """Measure and print; return 1 if a figure is not reached."""
    haptics = "--haptics" in sys.argv[1:]
    took, bar = durations(round(SECONDS / DT), haptics), BAR_WITH_FORCES if haptics else BAR
    factor, p99 = DT * len(took) / took.sum(), float(np.percentile(took, 99))
    print(f"{factor:.1f} x real time (required: {bar:g}) over {SECONDS} s of a session")
    print(f"tick: median {1e6 * np.median(took):.0f} µs, p99 {1e6 * p99:.0f} µs (required: {1e6 * SLOWEST:.0f})")
    return int(factor < bar or p99 > SLOWEST)


if __name__ == "__main__":
    sys.exit(main())
