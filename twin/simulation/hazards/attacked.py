"""One session of a campaign: an operator moves the tool in a circle, a fault acts, machine and model are compared."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.core.spatial import Array
from twin.simulation.controllers.cue import Cue
from twin.simulation.hazards.fault import Fault
from twin.simulation.machine.itp import pack
from twin.simulation.machine.levels import Level
from twin.simulation.machine.machine import Machine, Parts
from twin.simulation.machine.plant import TICK, Physics

_HOMED = 100
"""Tick at which the operator presses the pedal; homing from home takes fewer."""

_AFTER = 300
"""Packets after a fault, in which its consequences are watched."""

_MOTION = (6.0, 0.2)
"""Speed of the operator's hand in um per packet, and time in s for one radian of the circle. ASSUMED."""

_MM = 1e3

HARM = 1.0
"""Deviation of the true tip in mm that counts as harm if no check has stopped the arm before."""


@dataclass(frozen=True)
class Outcome:
    """What a session showed; times are in ms from the start of the fault, None: never.

    Attributes:
        peak: largest distance in mm of the machine's true tip from the model's, which is at rest once a check has
            stopped the machine.
        harm: time at which this distance exceeds `HARM`.
        beyond: time at which it exceeds the limit of the cue.
        cue: time of the first force on the operator's hand.
        stop, check: time at which a check has stopped the arm, and which one ("" if none).
        held, refused: packets with a target out of reach, and packets refused.
    """

    peak: float
    harm: int | None
    beyond: int | None
    cue: int | None
    stop: int | None
    check: str
    held: int
    refused: int


@dataclass(frozen=True)
class _Trace:
    """Joint values (k, n), true and as measured, from the first packet on; run levels, and the reason of a stop."""

    q: Array
    measured: Array
    levels: Array
    machine: Machine


class Arena:
    """Runs sessions of one robot; the model, which no fault reaches, runs only once.

    Attributes:
        cue: the equation of the force on the operator's hand.
    """

    def __init__(self, parts: Parts) -> None:
        """Take what machine and model are made of."""
        self._parts, self.cue = parts, Cue()
        self._model: _Trace | None = None

    def run(self, faults: list[Fault], start: int, length: int, mass: float, friction: float) -> Outcome:
        """Return the outcome of a session.

        Args:
            faults: faults of the machine.
            start: packet with which the fault begins.
            length: duration of the fault in packets.
            mass: factor of all masses of the machine.
            friction: factor of all friction.
        """
        packets = start + length + _AFTER
        if self._model is None or len(self._model.q) < packets:
            self._model = self._trace([], self._parts.plant.physics, packets)
        physics = self._parts.plant.physics.changed(mass, friction)
        seen, model = self._trace(faults, physics, packets), self._model
        forward = self._parts.kin.forward_many
        stopped = seen.levels == Level.E_STOP
        wanted = forward(model.q[:packets])[:, :3, 3]
        if stopped.any():  # from then on the machine has to stand where the model was
            wanted[stopped] = wanted[int(np.argmax(stopped))]
        true = np.linalg.norm(forward(seen.q)[:, :3, 3] - wanted, axis=1) * _MM
        dp = forward(model.measured[:packets])[:, :3, 3] - forward(seen.measured)[:, :3, 3]
        both = (seen.levels == Level.PEDAL_DN) & (model.levels[:packets] == Level.PEDAL_DN)
        found = seen.machine
        return Outcome(
            float(true.max()),
            _first(true > HARM, start),
            _first(true > self.cue.tol, start),
            _first(self._felt(dp) & both, start),
            _first(stopped, start),
            found.reason if stopped.any() else "",
            found.held,
            found.receiver.refused,
        )

    def _felt(self, dp: Array) -> np.ndarray:
        """Return (k,) whether the operator feels a force; dp (k, 3) is the measured deviation in m."""
        return np.array([bool(self.cue.force(row, np.zeros(3)).any()) for row in dp])

    def _trace(self, faults: list[Fault], physics: Physics, packets: int) -> _Trace:
        machine = Machine(self._parts, physics=physics, faults=faults)
        speed, radian = _MOTION
        q, measured, levels = [], [], []
        machine.step(0.0)
        machine.start()
        for k in range(1, _HOMED + packets + 1):
            sent, number = [], k - _HOMED
            if number > 0:
                a = number * TICK / radian
                step = np.array([round(speed * np.cos(a)), round(speed * np.sin(a)), 0, 1, 0, 0, 0, 0, 1.0])
                sent = [(pack(number, self._parts.settings.arm, step, self._parts.settings.packet_version), "operator")]
            machine.step(k * TICK, sent)
            if number > 0:
                q.append(machine.plant.q)
                measured.append(machine.q)
                levels.append(machine.plc.level)
        return _Trace(np.array(q), np.array(measured), np.array(levels), machine)


def _first(condition: np.ndarray, start: int) -> int | None:
    """Return the number of packets from `start` to the first true condition; packet numbers begin at 1."""
    places = np.flatnonzero(condition)
    return int(places[0]) + 1 - start if len(places) else None
