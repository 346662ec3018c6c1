"""Time of a tick of the SHER's console: a hand that moves all the time, with forces, referee and session tape.

Run: python -m tests.benchmarks.sher_console [SECONDS]. The ticks of 1 ms are timed one by one; the first second is not
counted. The hand moves on a circle of 40 mm with its pen rolling, the pedal is up for a tenth of each second.
"""

from __future__ import annotations

import sys
import time

import numpy as np

from twin import api
from twin.api.scene_parts import members_of, props_of, robots_at
from twin.core import spatial
from twin.simulation import console_scene
from twin.simulation.condition import Condition
from twin.simulation.devices.received_hands import HandState, ReceivedHands
from twin.simulation.session.session_run import SAMPLE
from twin.simulation.session.tape import Tape
from twin.simulation.session.task_play import play_of
from twin.simulation.setup import Setup


def times(seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the time and the processor time in s of each tick of 1 ms of a session of `seconds`."""
    scene = api.load_scene("sher_phantom")
    task = scene.tasks["phantom"]
    members = members_of(robots_at(console_scene.led_by(scene)))
    setup = Setup(scene, members, task, props_of(scene), Condition(haptics=True))
    device = ReceivedHands(console_scene.PEDALS, console_scene.HANDS, scale=0.1, moving=(0,))
    referee = play_of(task).referee(setup, task, SAMPLE)
    tape = Tape()
    world = console_scene.world(setup, device, records=False, watch=[referee, tape])
    spent = np.zeros(round(seconds * 1000))
    busy = np.zeros(len(spent))
    for k in range(len(spent)):
        t = k * 1e-3
        p = 0.02 * np.array([np.cos(2 * t) - 1, np.sin(2 * t), 0.3 * np.sin(3 * t)])
        T = spatial.pose(spatial.exp_so3(np.array([0.1 * np.sin(t), 0.1 * np.sin(1.3 * t), 0.0])), p)
        device.give(HandState(0, t % 1.0 > 0.1, False, k, T, 0.0))
        start = time.perf_counter()
        start_busy = time.thread_time()
        world.step()
        busy[k] = time.thread_time() - start_busy
        spent[k] = time.perf_counter() - start
        if k % 5 == 4:
            tape.take()
    return spent[1000:], busy[1000:]


def main() -> None:
    """Print medians, 99th percentiles and maxima; on a busy machine, the time contains that of other programs."""
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 20.0
    for name, values in zip(("time", "processor time"), times(seconds), strict=True):
        median, p99, p999 = np.percentile(1e3 * values, [50, 99, 99.9])
        print(f"{name} of a tick of 1 ms: median {median:.3f} ms, p99 {p99:.3f} ms, p99.9 {p999:.3f} ms")


if __name__ == "__main__":
    main()
