"""The machines of a console: their packets and states, requests to the trainer, deviations from the models."""

from __future__ import annotations

import numpy as np

from twin.api.machine import Machines
from twin.core.json_types import JsonObject
from twin.model.scene import Scene
from twin.simulation import machine_scene
from twin.simulation.controllers.trainer_states import (
    MODE,
    TrainerMode,
    TrainerPhase,
    TrainerReason,
    mode_of,
    mode_setting,
    reason_text,
)
from twin.simulation.controllers.view_switch import VIEW
from twin.simulation.devices.machine_states import ANSWERS, LEVEL, MachineStates
from twin.simulation.devices.received_hands import ReceivedHands
from twin.simulation.machine.levels import Level
from twin.simulation.machine.outbox import Outbox
from twin.simulation.machine.packet_exchange import Exchange
from twin.simulation.world import World
from twin.simulation.world.signal_kinds import ROBOT_APART, ROBOT_CUE, ROBOT_DEVIATION, ROBOT_PHASE, ROBOT_RUN


class LiveMachines:
    """Connections to the machines of a scene; the connections remain open when a new attempt begins in a new World.

    Attributes:
        parts: parts of each machine, by robot; see `Machines`.
        exchange: connection of the present World with the machines.
    """

    exchange: Exchange

    def __init__(self, scene: Scene, machines: Machines, device: ReceivedHands) -> None:
        """Use the connections `machines` until `close` ends them; `device` passes clients' requests to the trainer."""
        self._trainer = scene.trainer
        self._machines = machines
        self._device = device
        self.parts = machines.parts
        self._requests = 0

    def connect(self) -> tuple[list[MachineStates], Outbox]:
        """Connect a new World to the machines; return (devices, block), which must be added to this World.

        The devices receive the states of the machines; the block sends packets to the machines.
        """
        states = {name: MachineStates(name, part.home) for name, part in self.parts.items()}
        outbox = Outbox(self.parts)
        self.exchange = Exchange(self._machines.links, states, outbox)
        return [*states.values()], outbox

    def close(self) -> None:
        """End the connections."""
        self._machines.close()

    def ask(self, mode: TrainerMode) -> None:
        """Request a mode of the trainer: teleoperation, rehearsal, check of the rehearsed motion, or replay."""
        self._requests += 1  # the number tells the trainer a repeated request from a lasting one
        self._device.set(MODE, mode_setting(mode, self._requests))

    def press(self, button: str) -> None:
        """Press the button "start" or "stop" of all machines."""
        for link in self._machines.links.values():
            link.reader.press(button)

    def state(self, world: World) -> JsonObject | None:
        """Return the state of the trainer and of each machine as plain data; None without a trainer.

        "view" is "real" if the machines are drawn solid, "virtual" if the models are; "mode" is the requested mode.
        The state of a machine consists of its run level, its phase, the trainer's reason for this phase, and the
        problem of its connection.
        """
        if self._trainer is None:
            return None
        signals = world.signals
        limits = machine_scene.trainer_limits(self._trainer)
        robots = {}
        for name, link in self._machines.links.items():
            phase, reason, value = signals[ROBOT_PHASE.of(name)]
            run = signals[ROBOT_RUN.of(name)]
            level = None
            if run[ANSWERS] > 0.5:
                level = Level(int(run[LEVEL])).name
            robots[name] = {
                "level": level,
                "phase": TrainerPhase(int(phase)).name.lower(),
                "why": reason_text(TrainerReason(int(reason)), float(value), limits, name) or None,
                "problem": link.problem or None,
            }
        view = "virtual" if signals[VIEW][0] > 0.5 else "real"
        return {"view": view, "mode": mode_of(signals[MODE][0]).name.lower(), "robots": robots}

    def deviations(self, world: World) -> dict[str, JsonObject]:
        """Return, for each machine, its deviation from its model.

        "tip" is the distance in m between the tips of machine and model, "joints" the joint differences (n,) in rad or
        m, "cue" the force in N that reports the deviation to the hand.
        """
        deviations = {}
        for name in self._machines.links:
            deviations[name] = {
                "tip": float(world.signals[ROBOT_DEVIATION.of(name)][0]),
                "joints": world.signals[ROBOT_APART.of(name)],
                "cue": float(np.linalg.norm(world.signals[ROBOT_CUE.of(name)])),
            }
        return deviations
