"""The machines of a scene in a World: their trainers (which write packets), models, and cues (forces on the hands).

The model of a machine is a second robot of the World, named `<robot>_model`. A plant steps it with the same packets as
the machine, and it stands where the machine stands.
"""

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
from twin.simulation.controllers.pedals import LONGEST_TAP
from twin.simulation.controllers.tip_comparison import TipComparison
from twin.simulation.controllers.trainer import Trainer
from twin.simulation.controllers.trainer_states import MODE, TrainerLimits, TrainerMode, mode_setting
from twin.simulation.controllers.view_switch import ViewSwitch
from twin.simulation.machine.machine_model_plant import MachineModelPlant
from twin.simulation.machine.machine_parts import Parts
from twin.simulation.world import Block, Placed, Signals
from twin.simulation.world.signal_kinds import CAMERA_VIEW, HAND_FORCE, HAPTICS_ON, ROBOT_CUE

SETTINGS = {MODE: mode_setting(TrainerMode.TELEOPERATE, 0)}
"""Settings of the device of a console with machines, with their values at the start: teleoperation."""


def machines(scene: Scene) -> tuple[str, ...]:
    """Return the names of the robots of a scene that are machines."""
    if scene.trainer is None:
        return ()
    return tuple(scene.trainer.robots)


def trainer_limits(table: TrainerTable) -> TrainerLimits:
    """Return the limits of a trainer in SI."""
    return TrainerLimits(
        speed=table.speed_mm_s * MM,
        turn=table.turn_deg_s * DEG,
        rehearsed=table.rehearsed_mm_s * MM,
        replayed=table.replayed_mm_s * MM,
        start=table.start_mm * MM,
        start_angle=table.start_deg * DEG,
        deviation=table.deviation_mm * MM,
    )


def cue_law(table: TrainerTable) -> Cue:
    """Return the haptic cue of a trainer: the law of the force on a hand if machine and model deviate."""
    cue = table.cue
    return Cue(
        reading=cue.reading,
        tol=cue.tol_mm,
        kp=cue.kp_n_mm,
        kd=cue.kd_ns_mm,
        most=cue.largest_n,
        blend=cue.blend_mm,
    )


class MachineArm(Protocol):
    """What a model needs of its machine: mechanism and function of the link poses, as in `world.Placed`."""

    @property
    def mechanism(self) -> Mechanism: ...  # noqa: D102
    @property
    def links(self) -> Callable[[Array], Mapping[str, Array]] | None: ...  # noqa: D102


class MachineBlocks:
    """Creates the controllers, plants, placed models and cues for the machines of a World.

    Attributes:
        parts: {robot: compiled parts of its machine}; empty: there are no machines.
    """

    def __init__(self, scene: Scene, parts: Mapping[str, Parts]) -> None:
        """Prepare for the machines of a scene."""
        self._scene = scene
        self.parts = parts
        # without parts, the robots of the trainer move like other robots
        self._table = scene.trainer if parts else None

    def controllers(self, device: str, kins: Mapping[str, Kinematics], dt: float) -> list[Block]:
        """Return the block that switches the view, and the trainer of each machine.

        Args:
            device: name of the device of the pedals.
            kins: {robot: equations of its machine}.
            dt: duration of a tick in s.
        """
        if self._table is None:
            return []
        limits = trainer_limits(self._table)
        blocks: list[Block] = [ViewSwitch(device, LONGEST_TAP)]
        for name, parts in self.parts.items():
            angles = np.array([j.is_angle for j in parts.arm.mechanism.active])
            step = parts.settings.number.grasp_step.value
            tips = TipComparison(kins[name], angles)
            blocks.append(Trainer(name, device, limits, step, tips, dt))
        return blocks

    def plants(self, q: Mapping[str, Array]) -> list[Block]:
        """Return the plants that step the models, which start at joint values `q`, {robot: (n,) in m or rad}."""
        if self._table is None:
            return []
        law = cue_law(self._table)
        plants: list[Block] = []
        for name, parts in self.parts.items():
            plants.append(MachineModelPlant(name, parts, law, q[name]))
        return plants

    def placed_models(self, members: Mapping[str, MachineArm]) -> list[Placed]:
        """Return the models as robots of the World; each has the mechanism of its machine in `members`, by robot."""
        if self._table is None:
            return []
        placed = []
        for place in self._scene.models:
            arm = members[place.name.removesuffix(MODEL)]
            placed.append(Placed(place.name, arm.mechanism, place.T_world_base, arm.links))
        return placed

    def cues(self, hands: Sequence[str]) -> list[Block]:
        """Return one block for each hand, which writes the force of the cues on this hand."""
        table = self._scene.console
        if table is None:
            return []
        camera = self._scene.cameras[table.camera].robot
        places = {}
        for place in self._scene.places:
            places[place.name] = place
        blocks: list[Block] = []
        for hand in hands:
            bases = {}
            for name in getattr(table, hand):
                if name in self.parts and name in places:
                    bases[name] = places[name].T_world_base
            blocks.append(CueHand(hand, camera, bases))
        return blocks


class CueHand(Block):
    """Writes `<hand>.force` (3,) in N in {H}: the sum of the cues of the machines that a hand controls.

    Reads `haptics.on` (0: no force), `<robot>.cue` in the base of each machine, and `<camera>.view`, the axes of {H}.
    """

    def __init__(self, hand: str, camera: str, bases: Mapping[str, Array]) -> None:
        """Connect a hand; `bases` are the poses T_world_base (4, 4) of its machines."""
        self._force = HAND_FORCE.of(hand)
        self._view = CAMERA_VIEW.of(camera)
        self._rotations: dict[str, Array] = {}  # by signal of the cue
        for name, T_world_base in bases.items():
            self._rotations[ROBOT_CUE.of(name)] = T_world_base[:3, :3]
        self.outputs = {self._force: np.zeros(3)}

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, Array]:
        """Transform the forces of the cues into the axes of the picture, and add them."""
        force = np.zeros(3)  # in the axes of the World
        if signals.now[HAPTICS_ON.name].item() > 0.5:
            for name, R_world_base in self._rotations.items():
                force = force + R_world_base @ signals.now[name]
        R_world_view = signals.now[self._view].reshape(4, 4)[:3, :3]
        return {self._force: R_world_view.T @ force}
