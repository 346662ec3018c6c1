"""The model beside a machine in a World: it moves by the same packets, and is compared with the machine's states.

A packet takes some milliseconds to the machine and back. So a state is compared with the model as it was after the
packet that the state names: only what the arms do differently counts, not the way of the packets.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from twin.core.spatial import Array
from twin.model.trainer import MODEL
from twin.simulation.controllers.cue import Cue
from twin.simulation.controllers.trainer import Phase
from twin.simulation.devices.machine_states import ANSWERS, LEVEL, SEQUENCE, TICK
from twin.simulation.machine.itp import pack
from twin.simulation.machine.levels import Level
from twin.simulation.machine.machine import Machine, Parts
from twin.simulation.machine.plant import TICK as SECONDS
from twin.simulation.world import Block, Signals

_KEPT = 4096
"""Number of packets for which the model's joints are kept."""


class Modelled(Block):
    """Steps the model; a plant.

    Reads `<robot>.given`, `<robot>.phase`, `<robot>.measured` and `<robot>.run`. Writes:

    - `<robot>.q` (n,): joints of the machine as measured, and `<robot>_model.q` (n,): those of the model;
    - `<robot>.encoder` (n,): joints of the arm that the hand leads, which is the model in a rehearsal;
    - `<robot>.model` (3,): run level of the model, speed of its tip in m/s, packets whose target was out of reach;
    - `<robot>.deviation` (2,): distance of both tips in m, and speed of the machine's tip in m/s;
    - `<robot>.apart` (n,): joint values of the model minus those of the machine, rad or m;
    - `<robot>.cue` (3,): force of the cue in base, N; 0 unless both are led and in PEDAL_DN.
    """

    def __init__(self, robot: str, parts: Parts, cue: Cue, q: Array) -> None:
        """Start model and machine at joint values q (n,)."""
        self.robot, self.cue, self._parts = robot, cue, parts
        self._model = Machine(parts, q=q)
        self._model.stand(q)
        self._forward, self._arm = parts.kin.forward, parts.settings.arm
        self._version = parts.settings.packet_version
        self._share = parts.arithmetic.share
        self._kept = np.tile(self._model.q, (_KEPT, 1))
        self._sent = self._given = 0
        self._seen, self._dp, self._dv = -1.0, np.zeros(3), np.zeros(3)
        self._tips = np.tile(self._forward(q)[:3, 3], (2, 1))
        self._speeds = np.zeros((2, 3))  # of the machine's tip, and of the model's
        self._last = self._tips[1].copy()
        self._apart = np.zeros(len(q))
        self.outputs = {
            f"{robot}.q": q,
            f"{robot}.encoder": q,
            f"{robot}{MODEL}.q": q,
            f"{robot}.model": [float(Level.PEDAL_UP), 0.0, 0.0],
            f"{robot}.deviation": np.zeros(2),
            f"{robot}.apart": np.zeros(len(q)),
            f"{robot}.cue": np.zeros(3),
        }

    def step(self, signals: Signals, t: float, dt: float) -> Mapping[str, Array]:
        """Step the model by the packet of this tick, and compare it with the newest state of the machine."""
        now, name, m = signals.now, self.robot, self._model
        given, run, measured = now[f"{name}.given"], now[f"{name}.run"], now[f"{name}.measured"]
        phase = int(now[f"{name}.phase"][0])
        alone = phase in (Phase.REHEARSE, Phase.JUDGED)
        down = run[ANSWERS] > 0.5 and run[LEVEL] < Level.PEDAL_UP and not alone
        if given[9] > 0.5 or down:  # also while the machine is stopped or moves to home
            m.stand(measured)
            self._kept[:] = m.q
            self._last = self._forward(m.q)[:3, 3]
            self._speeds[:], self._dp, self._dv, self._apart = 0.0, np.zeros(3), np.zeros(3), m.q - measured
        if not down:
            self._given += 1
            m.step(t, [(pack(self._given, self._arm, given[:9], self._version), name)])
        self._sent += 1
        self._kept[self._sent % _KEPT] = m.q
        tip = self._forward(m.q)[:3, 3]
        self._speeds[1] += self._share * ((tip - self._last) / dt - self._speeds[1])
        self._last = tip
        if run[TICK] != self._seen:
            self._compare(measured, run, tip if alone else None)
        led = phase in (Phase.TELEOPERATE, Phase.REPLAY) and m.level == Level.PEDAL_DN and run[LEVEL] == Level.PEDAL_DN
        force = self.cue.force(self._dp, self._dv) if led and run[ANSWERS] > 0.5 else np.zeros(3)
        return {
            f"{name}.q": measured,
            f"{name}.encoder": m.q if alone else measured,
            f"{name}{MODEL}.q": m.q,
            f"{name}.model": np.array([m.plc.level, float(np.linalg.norm(self._speeds[1])), m.held]),
            f"{name}.deviation": np.array([float(np.linalg.norm(v)) for v in (self._dp, self._speeds[0])]),
            f"{name}.apart": self._apart,
            f"{name}.cue": force,
        }

    def _compare(self, measured: Array, run: Array, tip: Array | None) -> None:
        """Compare a new state with the model after the same packet; with a tip, with the model as it is now."""
        ticks, self._seen = max(run[TICK] - self._seen, 1.0), run[TICK]
        behind = self._sent - int(run[SEQUENCE])
        q = self._kept[(self._sent - behind) % _KEPT] if tip is None and 0 <= behind < _KEPT else self._model.q
        self._apart = q - measured
        before, own = self._tips, self._forward(measured)[:3, 3]
        self._tips = np.array([own, self._forward(q)[:3, 3]])
        share = 1 - (1 - self._share) ** min(ticks, 1000)
        moved = (self._tips - before) / (min(ticks, 1000) * SECONDS)
        self._speeds[0] += share * (moved[0] - self._speeds[0])
        self._dv = self._dv + share * (moved[1] - moved[0] - self._dv)
        self._dp = self._tips[1] - self._tips[0]
