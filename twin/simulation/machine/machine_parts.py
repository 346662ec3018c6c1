"""Compiled parts of a machine, which machine and model share: equations, plant, arithmetic, gravity compensation."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from twin.core.errors import WorldError
from twin.core.spatial import Array
from twin.kinematics import Kinematics
from twin.simulation.dynamics.arm import Arm
from twin.simulation.machine.arithmetic import Arithmetic
from twin.simulation.machine.gravity_compensation import GravityEfforts, compensation
from twin.simulation.machine.itp import FIELDS
from twin.simulation.machine.loop_plant import LoopPlant
from twin.simulation.machine.motor_plant import MotorPlant
from twin.simulation.machine.physics import Physics
from twin.simulation.machine.settings import Settings
from twin.simulation.machine.stability import require_stable
from twin.simulation.machine.wire import WIRE_NUMBERS


@dataclass(frozen=True)
class Parts:
    """Compiled parts of a machine, which machine and model share.

    Attributes:
        arm: the mechanism with masses.
        kin: the robot's equations, with a closed-form inverse.
        settings: motors, gains and limits.
        plant: a plant with the parameters of the robot's files.
        arithmetic: the control software's arithmetic with the gains of the settings.
        gravity: function from joint values (n,) to the joint efforts (n,) of the gravity compensation.
        home: (n,) joint values of the posture `home`.
        gaps: (lower joint, upper joint, minimum distance in m) of carriages on one rail.
    """

    arm: Arm
    kin: Kinematics
    settings: Settings
    plant: MotorPlant
    arithmetic: Arithmetic
    gravity: GravityEfforts
    home: Array
    gaps: tuple[tuple[str, str, float], ...] = ()

    @property
    def places(self) -> dict[str, tuple[str, ...]]:
        """For each signal of `machine_faults.LOCATIONS`, the names of its numbers."""
        mechanism = self.arm.mechanism
        motors = tuple(mechanism.motor_names)
        joints = tuple(joint.name for joint in mechanism.active)
        return {
            "wire": WIRE_NUMBERS,
            "packet": FIELDS,
            "usb": ("bytes",),
            "encoder": motors,
            "level": ("level",),
            "tool": ("x", "y", "z"),
            "joints": joints,
            "dac": motors,
        }

    @classmethod
    def of(cls, arm: Arm, kin: Kinematics, settings: Settings, gaps: Iterable[tuple[str, str, float]] = ()) -> Parts:
        """Compile the equations and the plant of a robot; `gaps`: see `Parts.gaps`.

        Raises:
            MechanismError: the mechanism lacks a frame of the settings; or the gains make a joint oscillate; or its
                passive joints cannot be simulated.
            WorldError: the mechanism has no posture `home`.
        """
        mechanism = arm.mechanism
        if mechanism.home is None:
            raise WorldError(f"{mechanism.name} has no posture 'home', to which a machine moves at its start")
        home = mechanism.posture("home")
        require_stable(arm, settings, home)
        gaps = tuple(gaps)
        physics = Physics.of(arm, settings.coulomb(mechanism))
        plant = LoopPlant(arm, physics, gaps) if mechanism.loops else MotorPlant(arm, physics)
        # A machine evaluates one pose per tick; compiled now, the first tick takes no longer than the others.
        if kin.closed_forward:
            kin.program.forward.compile_one()
        kin.program.inverse.compile_one()
        arithmetic = Arithmetic.of(settings, mechanism)
        gravity = compensation(settings, mechanism)
        return cls(arm, kin, settings, plant, arithmetic, gravity, home, gaps)
