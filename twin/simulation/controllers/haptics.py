"""Forces on the hands of a console: surfaces that the instruments touch, limits of the arms, and grasps of objects.

The law is eq. (5) of `console`: F = -k x - c dx/dt along the normal, clipped, never pulling inwards. The paper renders
the pulse of a grasp, walls, and a held ring against pegs. Added here are contacts between two instruments and contacts
of shafts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin.core.spatial import Array
from twin.formula.evaluator import attach
from twin.kinematics import Kinematics
from twin.simulation.controllers.console_equations import console
from twin.simulation.controllers.hand_force import ENERGY, FORCE, LAST_POSITION, STATE_SIZE, ForceParameters, hand_force
from twin.simulation.controllers.passivity import require_passive
from twin.simulation.limits import JointLimits
from twin.simulation.world import Block, Signals
from twin.simulation.world.signal_kinds import (
    CAMERA_VIEW,
    CONSOLE_TAPS,
    DEVICE_HAPTICS,
    DEVICE_SCALE,
    HAND_ENERGY,
    HAND_FORCE,
    HAND_POSE,
    HAPTICS_ON,
    OBJECT_HOLDER,
    ROBOT_ENCODER,
    ROBOT_FOLLOWS,
    ROBOT_GOAL,
)


@dataclass(frozen=True)
class FeltArm:
    """An arm whose contacts cause forces on a hand.

    Attributes:
        robot: name of the robot in the World.
        kin: the robot's equations.
        limits: the robot's joint limits.
        T_world_base: (4, 4) pose of the robot's base.
        index: number of the robot's gripper, as in `<object>.holder`; -1: the robot has no gripper.
    """

    robot: str
    kin: Kinematics
    limits: JointLimits
    T_world_base: Array
    index: int = -1


class HapticSwitch(Block):
    """Writes `haptics.on`: the value of `<device>.haptics`; if there is no such signal, the value `on`."""

    def __init__(self, device: str, on: bool = True) -> None:
        """Connect to a device."""
        self._name = DEVICE_HAPTICS.of(device)
        self._on = float(on)
        self.outputs = {HAPTICS_ON.name: self._on}

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, float]:
        """Read the switch."""
        if self._name in signals:
            return {HAPTICS_ON.name: signals.now[self._name].item()}
        return {HAPTICS_ON.name: self._on}


class HapticHand(Block):
    """Computes the force on one hand; must be placed after all plants that move robots or find contacts.

    Reads `haptics.on`, `console.taps`, `<device>.scale`, `<hand>.pose`, `<camera>.view`; `<robot>.follows`,
    `<robot>.goal`, `<robot>.encoder` and the planes in `<robot>.<source>` of the arm that the hand controls; and
    `<object>.holder`. Writes `<hand>.force` (3,) in N in {H}; the axes of {H} are those of the picture. Also
    writes `<hand>.energy` in J, the energy counted by the observer of the hand (`passivity`); it is never negative.
    """

    def __init__(
        self,
        hand: str,
        device: str,
        camera: str,
        arms: Sequence[FeltArm],
        *,
        sources: Sequence[str] = (),
        objects: Sequence[str] = (),
        surface: ForceParameters | None = None,
        dt: float = 1e-3,
    ) -> None:
        """Compile the force law of each arm.

        Args:
            hand: name of the hand.
            device: name of the device of pedals and scale.
            camera: name of the camera's arm.
            arms: the arms of this hand, in the order in which taps select them.
            sources: names of signals with planes (see `local_plane`), without the robot: "planes" for `<robot>.planes`.
            objects: names of objects whose grasp causes a pulse of the force.
            surface: parameters of the forces; None: the defaults.
            dt: duration of a tick in s.

        Raises:
            WorldError: a parameter of the surface is out of range, or the surface is not passive on the device.
        """
        self.surface = surface or ForceParameters()
        parameters = self.surface
        require_passive(parameters.stiffness, parameters.damping, parameters.largest, parameters.device_damping, dt)
        self._arms = tuple(arms)
        self._objects = tuple(objects)
        self._sources = tuple(sources)
        self._hand = hand
        self._device = device
        self._camera = camera
        law = console()
        self._force_functions = []
        self._tools = []  # T_world_tool of each arm
        for arm in arms:
            moves_tool = ~arm.kin.auxiliary
            self._force_functions.append(hand_force(law, parameters, arm.limits, moves_tool, len(sources), dt, True))
            self._tools.append(np.zeros(16))
        self._state = np.zeros(STATE_SIZE)
        self._pulse = np.zeros(3)
        self._joints_of_tools = [b""] * len(arms)  # joint values of `_tools`
        self._grasps = [GraspPulse() for _ in arms]
        self._force = HAND_FORCE.of(hand)
        self._energy = HAND_ENERGY.of(hand)
        self.outputs = {self._force: np.zeros(3), self._energy: 0.0}

    def attach(self, signals: Signals, memory: Mapping[str, Array]) -> None:
        """Compile the force of each arm; the compiled function reads its signals directly from their memory."""
        now = signals.now
        self._taps = now[CONSOLE_TAPS.name].item
        self._holders = [now[OBJECT_HOLDER.of(name)] for name in self._objects]
        self._pose = now[HAND_POSE.of(self._hand)].reshape(4, 4)
        self._is_first_tick = True
        self._output_memory = (memory[self._force], memory[self._energy])
        on = now[HAPTICS_ON.name]
        scale = now[DEVICE_SCALE.of(self._device)]
        pose = now[HAND_POSE.of(self._hand)]
        view = now[CAMERA_VIEW.of(self._camera)]
        self._encoders = []
        self._compiled = []
        for arm, law, tool in zip(self._arms, self._force_functions, self._tools, strict=True):
            follows = now[ROBOT_FOLLOWS.of(arm.robot)]
            base = np.ascontiguousarray(arm.T_world_base, float).ravel()
            encoder = now[ROBOT_ENCODER.of(arm.robot)]
            self._encoders.append(encoder)
            inputs = [on, follows, scale, pose, view, base, tool, now[ROBOT_GOAL.of(arm.robot)], encoder]
            for source in self._sources:
                inputs.append(now[f"{arm.robot}.{source}"])
            self._compiled.append(attach(law, self._state, self._pulse, *inputs))

    def step(self, signals: Signals, t: float, dt: float) -> None:
        """Compute the force of this tick; the device applies this force until the next tick."""
        if self._is_first_tick:  # before the first tick, the device has written no pose
            self._state[LAST_POSITION] = self._pose[:3, 3]
            self._is_first_tick = False
        i = int(self._taps()) % len(self._arms)
        arm = self._arms[i]
        q = self._encoders[i]
        joints = q.tobytes()
        if joints != self._joints_of_tools[i]:  # the forward kinematics is the slowest step of this block
            self._joints_of_tools[i] = joints
            tool = self._tools[i]
            seed = tool.reshape(4, 4).copy() if tool.any() else None
            T_base_tool = arm.kin.forward(q, seed)
            tool[...] = (arm.T_world_base @ T_base_tool).ravel()
        self._pulse[0] = PULSE * self._is_pulsing(i, t)
        new_state, compute = self._compiled[i]
        compute()
        self._state[...] = new_state
        force, energy = self._output_memory
        force[...] = new_state[FORCE]
        energy[0] = new_state[ENERGY]

    def _is_pulsing(self, controlled: int, t: float) -> bool:
        """Return whether the pulse of a grasp of the controlled arm acts in this tick.

        The other arms are followed as well: taps that leave an arm with an object and return to it are no new grasp.
        """
        is_active = False
        for k, (arm, grasp) in enumerate(zip(self._arms, self._grasps, strict=True)):
            is_holding = arm.index >= 0 and any(holder.item() == arm.index for holder in self._holders)
            is_pulsing = grasp.is_active(is_holding, t)
            if k == controlled:
                is_active = is_pulsing
        return is_active


PULSE = 1.0
"""Force in N along +x of {H} of the pulse when the jaws grasp an object, as printed in the paper."""

PULSE_TIME = 3e-3
"""Duration of this pulse in s, as printed in the paper."""

_SHORTEST_RELEASE = 0.25
"""Shortest time in s between the end of a grasp and the pulse of the next one; ASSUMED, so that a slipping grip
does not cause several pulses."""


class GraspPulse:
    """Follows what the gripper of one arm holds; an object that it holds all the time causes one pulse."""

    def __init__(self) -> None:
        self._was_holding = False  # in the last tick
        self._ended = -np.inf  # end of the last grasp in s
        self._until = -np.inf  # end of the last pulse in s

    def is_active(self, is_holding: bool, t: float) -> bool:
        """Return whether the pulse acts at time t in s; to be called in each tick, with whether the gripper holds."""
        begins = is_holding and not self._was_holding
        if begins and t - self._ended > _SHORTEST_RELEASE:
            self._until = t + PULSE_TIME - 1e-9
        if self._was_holding and not is_holding:
            self._ended = t
        self._was_holding = is_holding
        return t < self._until
