"""A run of a machine on the packets of a hand, and its trace: joint values and levels after each packet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.core.spatial import Array
from twin.simulation.campaigns.packet_hand import Hand
from twin.simulation.hazards.fault import Fault
from twin.simulation.machine.levels import Level
from twin.simulation.machine.machine_parts import Parts
from twin.simulation.machine.physics import TICK, Physics
from twin.simulation.machine.simulated_machine import Machine

HOMED = 100
"""Tick at which the operator presses the pedal; an arm that starts at home completes homing earlier."""

SETTLED = 100
"""Number of ticks after a stop in which the brakes bring the arm to rest; then the outcome no longer changes."""


@dataclass(frozen=True)
class Trace:
    """Record of a run from the first packet on.

    Attributes:
        q, measured: (k, n) true joint values, and joint values that the encoders measure; row i is after packet i + 1.
        levels, read: (k,) run levels of the PLC, and run levels as the software reads them.
        machine: the machine after the run.
    """

    q: Array
    measured: Array
    levels: Array
    read: Array
    machine: Machine


class TracedRun:
    """A machine that receives the packets of a hand; `extend` continues the run.

    Attributes:
        machine: the machine.
    """

    def __init__(self, parts: Parts, hand: Hand, physics: Physics | None = None, faults: Sequence[Fault] = ()) -> None:
        """Switch the machine on, and let it move to its home posture.

        Args:
            parts: compiled parts of the machine.
            hand: creates the packets.
            physics: parameters of the plant; None: those of the model.
            faults: faults of the machine.
        """
        self.machine = Machine(parts, physics=physics, faults=faults)
        self._hand = hand
        self._ticks_stopped = 0
        self._q: list[Array] = []
        self._measured: list[Array] = []
        self._levels: list[Level] = []
        self._read: list[Level] = []
        self.machine.step(0.0)
        self.machine.start()
        # without packets, until the arm has homed and the operator presses the pedal
        for tick in range(1, HOMED + 1):
            self.machine.step(tick * TICK)

    def extend(self, packets: int, least_packets: int) -> None:
        """Run until `packets` are sent in all; after a stop, until the arm rests and `least_packets` are sent."""
        machine = self.machine
        for number in range(len(self._q) + 1, packets + 1):
            packet = self._hand.packet(number)
            machine.step((HOMED + number) * TICK, [(packet, "operator")])
            self._q.append(machine.plant.q)
            self._measured.append(machine.q)
            self._levels.append(machine.plc.level)
            self._read.append(machine.level)
            if machine.plc.level == Level.E_STOP:
                self._ticks_stopped += 1
            else:
                self._ticks_stopped = 0
            if self._ticks_stopped > SETTLED and number >= least_packets:
                break

    @property
    def trace(self) -> Trace:
        """Record of the run so far."""
        return Trace(
            q=np.array(self._q),
            measured=np.array(self._measured),
            levels=np.array(self._levels),
            read=np.array(self._read),
            machine=self.machine,
        )


def trace(
    parts: Parts,
    hand: Hand,
    packets: int,
    least_packets: int,
    physics: Physics | None = None,
    faults: Sequence[Fault] = (),
) -> Trace:
    """Return the record of a machine that receives packets of a hand; see `TracedRun` and `TracedRun.extend`."""
    run = TracedRun(parts, hand, physics, faults)
    run.extend(packets, least_packets)
    return run.trace


def held_at_stop(model_tips: Array, record: Trace) -> Array:
    """Return tips (k, 3) of the model for comparison with a machine: from its stop on, the model's tip at the stop."""
    tips = model_tips.copy()
    is_stopped = record.levels == Level.E_STOP
    if is_stopped.any():
        first_stopped_row = int(np.argmax(is_stopped))
        tips[is_stopped] = tips[first_stopped_row]
    return tips
