"""Read the state of a console, as plain data, from the signals of its World; log new problems in the state."""

from __future__ import annotations

import logging
from collections.abc import Mapping

import numpy as np

from twin.core.json_types import JsonMapping, JsonObject
from twin.core.units import MM
from twin.simulation import console_scene, operating_scene
from twin.simulation.console_scene import HANDS, PEDALS
from twin.simulation.controllers.pedals import CAMERA, FREE, TOOLS
from twin.simulation.controllers.pivot import FULCRUMS
from twin.simulation.setup import Setup
from twin.simulation.world import World
from twin.ui.session import walls

_STUCK = 30.0
"""Time in s after which a pedal that is still pressed is reported, because it may be stuck (ASSUMED)."""


class ConsoleState:
    """Reader of the state of pedals, hands and camera in a World with a console."""

    def __init__(self, setup: Setup, world: World) -> None:
        """Set the World whose state `read` returns; the World must not have been stepped yet."""
        self._scene, self._members, self._procedure = setup.scene, setup.members, setup.procedure
        self._table = console_scene.console_of(setup.scene)
        self._world, self._pressed = world, 0.0

    def read(self, arms: Mapping[str, str]) -> JsonObject:
        """Return the present state; `arms` maps each hand to the name of the robot that this hand controls."""
        signals, t = self._world.signals, self._world.t
        mode, silent = float(signals["console.mode"][0]), bool(signals[f"{PEDALS}.silent"][0])
        if mode == TOOLS or silent:
            self._pressed = t
        at = signals[f"{self._scene.cameras[self._table.camera].robot}.at"]
        return {
            "silent": silent,
            "mode": "nothing" if mode == FREE else "camera" if mode == CAMERA else "instruments",
            "scale": float(signals[f"{PEDALS}.scale"][0]),
            "haptics": bool(signals["haptics.on"][0]),
            "fulcrum": FULCRUMS[int(signals[console_scene.FULCRUM][0])] if self._table.instrument_mm else None,
            "hands": {hand: self._hand(hand, arms[hand]) for hand in HANDS},
            "camera": walls.of_camera(at, console_scene.drag(self._table)) if mode == CAMERA else None,
            "pedal": None if mode == TOOLS or silent or t - self._pressed < _STUCK else _stuck(mode),
        }

    def _hand(self, hand: str, arm: str) -> JsonObject:
        signals, wall = self._world.signals, None
        if signals[f"{arm}.follows"][0]:
            wall = walls.of_arm(self._members[arm], signals[f"{arm}.q"], signals[f"{arm}.goal"].reshape(4, 4))
        follows = bool(signals[f"{arm}.follows"][0] or signals[f"{arm}.target"][0])
        jumps = int(sum(signals[f"{a}.jumps"][0] for a in getattr(self._table, hand)))
        tools = self._tools(arm) if self._scene.tools else {}
        return {"robot": arm, "follows": follows, "wall": wall, "jumps": jumps, **tools}

    def _tools(self, arm: str) -> JsonObject:
        """Return an arm's chosen tool; in a procedure also the mounted tool, and why the two tools still differ."""
        signals, names = self._world.signals, [*self._scene.tools]
        tool = names[int(signals[f"{arm}.tool"][0])]
        if f"{arm}.carries" not in signals or self._procedure is None:
            return {"tool": tool}
        carries, waits = names[int(signals[f"{arm}.carries"][0])], None
        if carries != tool:
            port = operating_scene.port_of(next(p for p in self._scene.places if p.name == arm))
            far = float(np.linalg.norm(signals[f"{arm}.tip"] - port)) / MM
            change = f"at most {self._procedure.change_mm:g} mm from its port, now {far:.0f} mm"
            holds = signals[f"{arm}.holds"][0] >= 0
            do = "first release the held object" if holds else f"draw the tip back to {change}"
            waits = f"{self._scene.tools[tool].title} is not taken yet: {do}"
        active = bool(signals[f"{arm}.pedal"][0] > 0.5) and self._scene.tools[carries].kind == "cautery"
        opened = bool(signals[f"{arm}.opening"][0] > 0.5)
        return {"tool": tool, "carries": carries, "waits": waits, "open": opened, "active": active}


def log_changes(old: JsonMapping, new: JsonMapping, patience: float) -> list[str]:
    """Log silence, a stuck pedal, jumps and limits that are in the state `new` but not yet in the state `old`.

    Return the messages about jumps, because the pages do not show jumps otherwise. `patience` is the time in s after
    which hands whose states are no longer received count as silent.
    """
    log, said = logging.getLogger(__name__), []
    if new["silent"] and not old["silent"] and new["owner"] is not None:  # not after a release
        log.warning("no state of the hands was received for %g s: nothing moves", patience)
    if new["pedal"] and not old["pedal"]:
        log.warning("%s", new["pedal"])
    for hand, now in new["hands"].items():
        before = old["hands"][hand]
        if now["jumps"] > before["jumps"]:
            said.append(f"the {hand} hand jumped: {now['robot']} ignores the jump and follows from the new pose")
            log.warning("%s", said[-1])
        if now["wall"] and now["wall"] != before["wall"]:
            log.warning("%s: %s", now["robot"], now["wall"])
    return said


def _stuck(mode: float) -> str:
    which = "camera" if mode == CAMERA else "clutch"
    return f"the {which} pedal has been pressed for {_STUCK:g} s: release it if it is stuck"
