"""The machines of a scene in a World: their trainers (which write packets), models, and cues (forces on the hands)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

import numpy as np

from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.kinematics import Kinematics
from twin.model.mechanism import Mechanism
from twin.model.scene import Scene
from twin.model.trainer import MODEL, TrainerTable
from twin.simulation.controllers.cue import Cue
from twin.simulation.controllers.pedals import TAP
from twin.simulation.controllers.trainer import MODE, Bounds, Tips, Trainer, ViewSwitch
from twin.simulation.machine.machine import Parts
from twin.simulation.machine.modelled import Modelled
from twin.simulation.world import Block, Placed, Signals

SETTINGS = {MODE: 0.0}
"""Settings of the device of a console with machines."""


def machines(scene: Scene) -> tuple[str, ...]:
    """Return the names of the robots of a scene that are machines."""
    return () if scene.trainer is None else tuple(scene.trainer.robots)


def bounds(table: TrainerTable) -> Bounds:
    """Return the limits of a trainer in SI."""
    return Bounds(
        table.speed_mm_s * MM,
        table.turn_deg_s * DEG,
        table.rehearsed_mm_s * MM,
        table.replayed_mm_s * MM,
        table.start_mm * MM,
        table.start_deg * DEG,
        table.deviation_mm * MM,
    )


def cue(table: TrainerTable) -> Cue:
    """Return the haptic cue of a trainer: the law of the force on a hand if machine and model deviate."""
    c = table.cue
    return Cue(c.reading, c.tol_mm, c.kp_n_mm, c.kd_ns_mm, c.largest_n, c.blend_mm)


class Arm(Protocol):
    """What a model needs of its machine: mechanism and function of the link poses, as in `world.Placed`."""

    @property
    def mechanism(self) -> Mechanism: ...  # noqa: D102
    @property
    def links(self) -> Callable[[Array], Mapping[str, Array]] | None: ...  # noqa: D102


class Machined:
    """Creates the controllers, models and cues for the machines of a World.

    Attributes:
        parts: {robot: compiled parts of its machine}; empty: there are no machines.
    """

    def __init__(self, scene: Scene, parts: Mapping[str, Parts]) -> None:
        """Prepare for the machines of a scene."""
        self._scene, self.parts = scene, parts
        self._table = scene.trainer if parts else None

    def controllers(self, device: str, kins: Mapping[str, Kinematics], dt: float) -> list[Block]:
        """Return the block that switches the view, and the trainer of each machine."""
        if (table := self._table) is None:
            return []
        out: list[Block] = [ViewSwitch(device, TAP)]
        for name, parts in self.parts.items():
            angles = np.array([j.is_angle for j in parts.arm.mechanism.active])
            step = parts.settings.number.grasp_step.value
            out.append(Trainer(name, device, bounds(table), step, Tips(kins[name], angles), dt))
        return out

    def plants(self, q: Mapping[str, Array]) -> list[Block]:
        """Return the models of the machines, which start at joint values q (n,)."""
        if (table := self._table) is None:
            return []
        return [Modelled(name, parts, cue(table), q[name]) for name, parts in self.parts.items()]

    def models(self, members: Mapping[str, Arm]) -> list[Placed]:
        """Return the models as robots of the World; each model has the mechanism of its machine."""
        models = [] if self._table is None else self._scene.models
        arms = [(p, members[p.name.removesuffix(MODEL)]) for p in models]
        return [Placed(p.name, arm.mechanism, p.T_world_base, arm.links) for p, arm in arms]

    def cues(self, hands: Sequence[str]) -> list[Block]:
        """Return one block for each hand, which writes the force of the cues on this hand."""
        if (table := self._scene.console) is None:
            return []
        eye = self._scene.cameras[table.camera].robot
        bases = {p.name: p.T_world_base for p in self._scene.places if p.name in self.parts}
        return [CueHand(h, eye, {n: bases[n] for n in getattr(table, h) if n in bases}) for h in hands]


class CueHand(Block):
    """Writes `<hand>.force` (3,) in N in {H}: the sum of the cues of the machines that a hand controls.

    Reads `haptics.on` (0: no force), `<robot>.cue` in the base of each machine, and `<camera>.view`, the axes of {H}.
    """

    def __init__(self, hand: str, camera: str, bases: Mapping[str, Array]) -> None:
        """Connect a hand; `bases` are the poses T_world_base (4, 4) of its machines."""
        self._force, self._view = f"{hand}.force", f"{camera}.view"
        self._bases = {f"{name}.cue": T[:3, :3] for name, T in bases.items()}
        self.outputs = {self._force: np.zeros(3)}

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, Array]:
        """Transform the forces of the cues into the axes of the picture, and add them."""
        force = np.zeros(3)
        if signals.now["haptics.on"].item() > 0.5:
            for name, R in self._bases.items():
                force = force + R @ signals.now[name]
        return {self._force: signals.now[self._view].reshape(4, 4)[:3, :3].T @ force}
