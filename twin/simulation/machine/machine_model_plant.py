"""The model of a machine in a World: it gets the machine's packets, and is compared with the machine's states.

A packet takes some milliseconds to the machine, and the machine's state takes some milliseconds back. Therefore, a
state of the machine is compared with the state that the model had after the same packet. So the delay of the network
does not count as deviation.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from twin.core.spatial import Array, length
from twin.model.trainer import MODEL
from twin.simulation.controllers.cue import Cue
from twin.simulation.controllers.trainer_states import TrainerPhase
from twin.simulation.devices.machine_states import ANSWERS, LEVEL, SEQUENCE, TICK
from twin.simulation.machine.comparison import MachineComparison
from twin.simulation.machine.itp import ahead, number_of, pack
from twin.simulation.machine.levels import Level
from twin.simulation.machine.machine_parts import Parts
from twin.simulation.machine.simulated_machine import Machine
from twin.simulation.world import Block, Signals
from twin.simulation.world.signal_kinds import (
    ROBOT_APART,
    ROBOT_CUE,
    ROBOT_DEVIATION,
    ROBOT_ENCODER,
    ROBOT_GIVEN,
    ROBOT_MEASURED,
    ROBOT_MODEL,
    ROBOT_PHASE,
    ROBOT_Q,
    ROBOT_RUN,
)

_LONGEST_STEP = 1000
"""Largest number of ticks between two states from which the velocities of the tips are computed: one second."""

_KEPT = 4096
"""Number of the latest packets for which the model's joint values after the packet are stored."""


class MachineModelPlant(Block):
    """A plant that steps the model of a machine.

    Reads `<robot>.given`, `<robot>.phase`, `<robot>.measured` and `<robot>.run`. Writes:

    - `<robot>.q` and `<robot>_model.q` (n,): measured joint values of the machine, and joint values of the model;
    - `<robot>.encoder` (n,): joint values of the arm that the hand controls: in a rehearsal the model's,
      otherwise the machine's;
    - `<robot>.model` (3,): run level of the model, speed of its tip in m/s, number of targets out of reach;
    - `<robot>.deviation` (2,): distance in m between the tips of machine and model; speed of the machine's tip in m/s;
    - `<robot>.apart` (n,): joint values of the model minus those of the machine, rad or m;
    - `<robot>.cue` (3,): force of the cue in N in base; 0 except in teleoperation and replay while both machine and
      model are in PEDAL_DN.
    """

    def __init__(self, robot: str, parts: Parts, cue: Cue, q: Array) -> None:
        """Start with the model and the machine at joint values q (n,)."""
        self.robot = robot
        self._comparison = MachineComparison(parts, cue, q)
        self._model = Machine(parts, q=q)
        self._model.stand(q)
        self._forward = parts.kin.forward
        self._arm = parts.settings.arm
        self._version = parts.settings.packet_version
        self._share = parts.arithmetic.share
        self._kept = np.tile(self._model.q, (_KEPT, 1))  # ring: row k % _KEPT has the values after packet k
        self._sent = 0  # packets of this World, sent to the machine or not
        self._given = 0  # packets given to the model
        self._compared_tick = -1.0  # tick of the machine's state that was compared last
        self._tip = self._forward(q)[:3, 3]
        self._speed = np.zeros(3)
        self.outputs = {
            ROBOT_Q.of(robot): q,
            ROBOT_ENCODER.of(robot): q,
            f"{robot}{MODEL}.q": q,
            ROBOT_MODEL.of(robot): [float(Level.PEDAL_UP), 0.0, 0.0],
            ROBOT_DEVIATION.of(robot): np.zeros(2),
            ROBOT_APART.of(robot): np.zeros(len(q)),
            ROBOT_CUE.of(robot): np.zeros(3),
        }

    def step(self, signals: Signals, t: float, dt: float) -> Mapping[str, Array]:
        """Step the model by the packet of this tick, and compare the model with the newest state of the machine."""
        current = signals.now
        name = self.robot
        model = self._model
        packet_values = current[ROBOT_GIVEN.of(name)]
        run = current[ROBOT_RUN.of(name)]
        measured = current[ROBOT_MEASURED.of(name)]
        phase = int(current[ROBOT_PHASE.of(name)][0])
        answers = run[ANSWERS] > 0.5
        model_alone = phase in (TrainerPhase.REHEARSE, TrainerPhase.JUDGED)
        # the machine is stopped or moves to home, which the model does not know
        is_stopped = answers and run[LEVEL] < Level.PEDAL_UP and not model_alone
        if packet_values[9] > 0.5 or is_stopped:
            self._stand(measured)
        if not is_stopped:
            self._given += 1
            packet = pack(number_of(self._given), self._arm, packet_values[:9], self._version)
            model.step(t, [(packet, name)])
        self._sent += 1
        self._kept[self._sent % _KEPT] = model.q
        previous_tip = self._tip
        self._tip = self._forward(model.q)[:3, 3]
        velocity = (self._tip - previous_tip) / dt
        self._speed = self._speed + self._share * (velocity - self._speed)
        if run[TICK] != self._compared_tick:
            self._compare(measured, run, model_alone)
        comparison = self._comparison
        together = model.level == Level.PEDAL_DN and run[LEVEL] == Level.PEDAL_DN
        force = np.zeros(3)
        if phase in (TrainerPhase.TELEOPERATE, TrainerPhase.REPLAY) and together and answers:
            force = comparison.force
        model_speed = length(self._speed)
        machine_speed = length(comparison.speeds[0])
        return {
            ROBOT_Q.of(name): measured,
            ROBOT_ENCODER.of(name): model.q if model_alone else measured,
            f"{name}{MODEL}.q": model.q,
            ROBOT_MODEL.of(name): np.array([model.plc.level, model_speed, model.held]),
            ROBOT_DEVIATION.of(name): np.array([comparison.deviation, machine_speed]),
            ROBOT_APART.of(name): comparison.joints,
            ROBOT_CUE.of(name): force,
        }

    def _stand(self, measured: Array) -> None:
        """Put the model at rest at the joint values of the machine (n,)."""
        model = self._model
        model.stand(measured)
        self._kept[:] = model.q
        self._tip = self._forward(model.q)[:3, 3]
        self._speed = np.zeros(3)
        self._comparison.rest(measured, model.q)

    def _compare(self, measured: Array, run: Array, alone: bool) -> None:
        """Compare a new state of the machine with the state of the model after the same packet.

        If the model moves `alone`, the machine is compared with the present state of the model.
        """
        # After a restart of the machine, or a long pause, the difference is no time between two states.
        ticks = int(np.clip(run[TICK] - self._compared_tick, 1, _LONGEST_STEP))
        self._compared_tick = run[TICK]
        behind = ahead(number_of(self._sent), int(run[SEQUENCE]))
        q = self._model.q
        if not alone and 0 <= behind < _KEPT:
            q = self._kept[(self._sent - behind) % _KEPT]
        self._comparison.step(measured, q, ticks)
