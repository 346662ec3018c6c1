"""How much faster than real time the machines of two arms run, in processor time: the plant alone, and the whole tick.

    python tests/benchmarks/machine_speed.py [ticks]

The whole tick has network, PLC, control software, encoders, motors and links, with one packet in each tick. The fastest
of many runs of 200 ticks counts, because neighbours on the computer take caches and memory.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable

import numpy as np

import twin
from twin.api.machine import machine_parts
from twin.simulation.campaigns.packet_hand import Hand, wander
from twin.simulation.machine.levels import Level
from twin.simulation.machine.physics import TICK
from twin.simulation.machine.simulated_machine import Machine

ARMS, RUN, HOMED = ("raven_left", "raven_right"), 200, 100


def fastest(tick: Callable[[int], None], ticks: int) -> float:
    """Return how many times faster than real time the ticks are in the fastest run."""
    best = float("inf")
    for first in range(0, ticks, RUN):
        start = time.process_time()
        for k in range(first, first + RUN):
            tick(k)
        best = min(best, time.process_time() - start)
    return RUN * TICK / best


def main(ticks: int) -> None:
    """Run both, and print the figures and the load of the computer."""
    parts = [machine_parts(twin.load(name)) for name in ARMS]
    machines = [Machine(p) for p in parts]
    hands = [Hand(p.settings, 0.1, wander(1)) for p in parts]
    packets = [[hand.packet(k + 1) for k in range(ticks)] for hand in hands]
    for machine in machines:
        machine.step(0.0)
        machine.start()
        for k in range(1, HOMED):
            machine.step(k * TICK)

    def tick(k: int) -> None:
        for machine, sent in zip(machines, packets, strict=True):
            machine.step((HOMED + k) * TICK, [(sent[k], "master")])

    torques, plants = np.full(7, 1e-3), [p.plant.another() for p in parts]
    for plant, p in zip(plants, parts, strict=True):
        plant.reset(p.home)

    def move(k: int) -> None:
        for plant in plants:
            plant.advance(torques)

    found = {"plant": fastest(move, ticks), "whole tick": fastest(tick, ticks)}
    if any(machine.level != Level.PEDAL_DN for machine in machines):
        raise SystemExit(f"a machine has stopped: {[machine.reason for machine in machines]}")
    print(json.dumps({n: round(x, 1) for n, x in found.items()} | {"load": os.getloadavg()}))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 10_000)
