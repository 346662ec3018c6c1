"""How long after a fault the operator feels the cue, beyond physics: both machine processes, and a World beside them.

    python tests/benchmarks/machine_cue.py [faults]

Each fault holds the left shoulder's DAC at 2500 counts for 200 ms. The time is from the tick of the machine in which
its tip is first more than 3 mm from the model's, to the tick of the World in which the force on the hand is above 0.
The clock of the machine is set against that of this computer by the fastest of all its states.
"""

from __future__ import annotations

import json
import os
import sys
import time

import numpy as np

from twin.api.machine import ChildMachine, Machines
from twin.api.scene_loading import load_scene
from twin.api.scene_parts import members_of, robots_at
from twin.core import spatial
from twin.simulation import console_scene
from twin.simulation.condition import Condition
from twin.simulation.devices.combined_devices import CombinedDevices
from twin.simulation.devices.machine_states import MachineStates
from twin.simulation.hazards.fault import Fault
from twin.simulation.machine.levels import Level
from twin.simulation.machine.outbox import Outbox
from twin.simulation.machine.packet_exchange import Exchange
from twin.simulation.session.machine_run import ready
from twin.simulation.setup import Setup
from twin.simulation.world import Block

NAME, BESIDE, FIRST, EVERY, LIMIT = "raven_left", "raven_right", 6.0, 5.0, 3e-3


class Circles(Block):
    """Both hands roll once, and then move in slow circles."""

    def __init__(self):
        self.outputs = self._said(0.0)

    def _said(self, t):
        s = max(t - 1.0, 0.0)
        R = spatial.rotation_z(0.1 * min(t / 0.5, 1.0))
        out = {}
        for hand, side in (("right", 1), ("left", -1)):
            p = [0.08 * side + 0.04 * np.sin(s), 0.03 * (1 - np.cos(s)), 0.0]
            out |= {f"{hand}.pose": spatial.pose(R, p).ravel(), f"{hand}.grip": 0.0}
        return out | {"pedals.clutch": 0.0, "pedals.camera": 0.0, "pedals.scale": 0.2, "pedals.training": 0.0}

    def step(self, signals, t, dt):
        """Move the hands."""
        return self._said(t)


def main(faults):
    """Run, and print the times from the limit to the cue."""
    scene = load_scene("raven")
    robots = robots_at(console_scene.led_by(scene))
    setup = Setup(scene, members_of(robots), condition=Condition(haptics=True))
    times = [FIRST + EVERY * k for k in range(faults)]
    stuck = [Fault("dac", t, t + 0.2, "overwrite", 2500.0, target=0) for t in times]
    start = lambda robot: ChildMachine(robot, faults=stuck if robot == NAME else ())  # noqa: E731
    arrived, sent, felt = [], [], []
    names = (NAME, BESIDE)
    with Machines({n: robots[n] for n in names}, {n: n for n in names}, start=start) as machines:
        link, parts = machines.links[NAME], machines.parts
        link.reader.heard = lambda s: arrived.append((time.monotonic(), s))
        for n in names:
            ready(n, machines.links[n])
        states, outbox = {n: MachineStates(n, parts[n].home) for n in names}, Outbox(parts)
        device = CombinedDevices([Circles(), *states.values()])
        world = console_scene.world(setup, device, records=False, watch=[outbox], parts=parts)
        exchange, begin, pressed = Exchange(machines.links, states, outbox), time.monotonic(), -1.0
        begun = link.state.t
        while link.state is not None and link.state.t < times[-1] + EVERY:
            wait = begin + world.t - time.monotonic()
            if wait > 0:
                time.sleep(wait)
            elif wait < -0.1:
                begin -= wait
            exchange.receive()
            world.step()
            exchange.send()
            s = world.signals
            sent.append(s[f"{NAME}_model.q"])
            if np.linalg.norm(s["left.force"]) > 0:
                felt.append(time.monotonic())
            state = link.state
            if state is not None and state.level == Level.E_STOP and world.t - pressed > 1.0:
                link.reader.press("start")
                pressed = world.t
    forward = parts[NAME].kin.forward
    offset = min(at - s.t for at, s in arrived)
    delays, felt = [], np.array(felt)
    for t in times:
        for _, s in arrived:
            if not (t <= s.t < t + 1.0) or not 0 < s.sequence <= len(sent):
                continue
            if np.linalg.norm(forward(s.q)[:3, 3] - forward(sent[s.sequence - 1])[:3, 3]) > LIMIT:
                after = felt[felt >= offset + s.t]
                if len(after) and after[0] - offset - s.t < 1.0:
                    delays.append(1e3 * (after[0] - offset - s.t))
                break
    found = {"faults": faults, "felt": len(delays), "begun at": round(begun, 2), "load": os.getloadavg()}
    if delays:
        found |= {f"p{p}_ms": round(float(np.percentile(delays, p)), 2) for p in (50, 95)}
        found["max_ms"] = round(max(delays), 2)
    print(json.dumps(found))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 20)
