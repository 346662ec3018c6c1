"""Motors, gains, checks and network of a machine, read from `machine.toml` in the robot's CAD folder."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from twin.core.errors import DescriptionError, unknown
from twin.core.provenance import Parameter
from twin.core.spatial import Array
from twin.model.mechanism import Mechanism
from twin.schema import Identifier, NotNegative, Positive, Sourced, Table, Vector, error_at, load_toml

NAME = "machine.toml"
"""Name of the machine file in a robot's CAD folder."""

_Unit = Literal["1", "count", "s", "Hz", "rad", "rad/s", "m/s"]

Mode = Literal["advanced", "moderate", "beginner"]
Policy = Literal["none", "soft", "hard"]


class Number(Sourced):
    """A number with its unit and provenance."""

    value: Positive
    unit: _Unit


_UNITS: dict[str, _Unit] = {
    "counts_per_turn": "1",
    "stop_dac": "count",
    "violations": "1",
    "equal_cycles": "1",
    "master_timeout": "s",
    "largest_speed": "rad/s",
    "largest_travel_speed": "m/s",
    "tool_speed": "m/s",
    "tool_turn": "rad/s",
    "plc_timeout": "s",
    "velocity_cutoff": "Hz",
    "homing_speed": "1",
    "grasp_step": "rad",
}
"""Unit of each number in `SoftwareParameters`."""


class SoftwareParameters(Table):
    """Parameters of the control software; the file's notes explain them.

    `largest_travel_speed` is the limit for prismatic joints with a brake, `largest_speed` that for revolute ones;
    without it, the speed of prismatic joints is not checked. `tool_speed` and `tool_turn` limit the increments that a
    master of this program sends (`twin serve ROBOT --machine`, `twin machine --ros`).
    """

    counts_per_turn: Number
    stop_dac: Number
    violations: Number
    equal_cycles: Number
    master_timeout: Number
    largest_speed: Number
    plc_timeout: Number
    velocity_cutoff: Number
    homing_speed: Number
    grasp_step: Number
    largest_travel_speed: Number | None = None
    tool_speed: Number | None = None
    tool_turn: Number | None = None


class DacLimits(Table):
    """Largest counts of the DAC for each mode (skill of the operator)."""

    advanced: Positive
    moderate: Positive
    beginner: Positive


class Released(Table):
    """Faults of the released software (uw-biorobotics/raven2). True: reproduce the fault; false: corrected.

    Attributes:
        shared_counter: one counter for all motors counts the commands above the limit; if ten motors exceed the limit
            in one tick, the counter increases by ten.
        rates_without_coupling: the rate of a joint is computed from the joint's own motor only, although joint values
            include the coupling by the cables; for a robot without coupling, there is no difference.
        whole_counts: encoder counts per rad are rounded down (1303 instead of 1303.8 in the released software), so that
            angles are measured too large.
    """

    shared_counter: bool = True
    rates_without_coupling: bool = False
    whole_counts: bool = False


class Motor(Sourced):
    """A motor: torque constant in N m/A at the rotor, DAC counts per A, gear ratio, gains at the output of the gear."""

    name: Identifier
    torque_per_amp: Positive
    counts_per_amp: Positive
    dac: DacLimits
    gear: Positive
    kp: NotNegative
    kd: NotNegative
    ki: NotNegative


class JointFriction(Sourced):
    """Coulomb friction of a joint, and the maximum effort of its brake; 0: no brake."""

    name: Identifier
    coulomb: NotNegative
    brake: NotNegative
    unit: Literal["N m", "N"]


class PointMass(Sourced):
    """A point mass of the gravity compensation: mass in kg; position in m in a frame of the body that `joint` moves."""

    joint: Identifier
    frame: Identifier
    mass: NotNegative
    centre: Vector


class Settings(Table):
    """The machine file; it lists motors and joints in any order.

    Without `compensation`, the gravity compensation uses the masses of inertia.toml.
    """

    title: str
    source: str
    arm: Annotated[int, Field(ge=0, le=1)]
    packet_version: Annotated[int, Field(ge=0, lt=2**32)]
    mode: Mode
    overdrive: Policy
    number: SoftwareParameters
    released: Released = Field(default_factory=Released)
    motor: list[Motor] = Field(min_length=1)
    joint: list[JointFriction] = Field(min_length=1)
    compensation: list[PointMass] = Field(default_factory=list)

    def of_motors(self, mechanism: Mechanism) -> list[Motor]:
        """Return the motors in the order of `mechanism.motor_names`."""
        by_name = {motor.name: motor for motor in self.motor}
        motors = []
        for name in mechanism.motor_names:
            motors.append(by_name[name])
        return motors

    def of_joints(self, mechanism: Mechanism) -> list[JointFriction]:
        """Return the friction of each joint, in the order of q."""
        by_name = {friction.name: friction for friction in self.joint}
        frictions = []
        for joint in mechanism.active:
            frictions.append(by_name[joint.name])
        return frictions

    def coulomb(self, mechanism: Mechanism) -> Array:
        """Return the Coulomb friction (n,) in N m or N."""
        coulomb = np.zeros(len(mechanism.active))
        for i, friction in enumerate(self.of_joints(mechanism)):
            coulomb[i] = friction.coulomb
        return coulomb

    def parameters(self) -> list[Parameter]:
        """Return the numbers of the control software and the joints' friction with their provenance."""
        parameters = []
        for name in SoftwareParameters.model_fields:
            number: Number | None = getattr(self.number, name)
            if number is None:
                continue
            parameters.append(Parameter(name, number.value, number.unit, number.value, number.provenance, number.note))
        for joint in self.joint:
            name = f"{joint.name}.coulomb"
            parameters.append(Parameter(name, joint.coulomb, joint.unit, joint.coulomb, joint.provenance, joint.note))
        return parameters


def load(path: Path, mechanism: Mechanism) -> Settings:
    """Read a machine file.

    Raises:
        DescriptionError: the file does not exist, is invalid, has a number in a wrong unit, or does not name every
            motor and every joint of the mechanism once; the message has file, line, key and value.
    """
    if not path.is_file():
        raise DescriptionError(
            f"{path}: the file does not exist: a machine needs motors, gains and limits, as in cad/raven_left/{NAME}"
        )
    table = load_toml(path, Settings)
    for name, unit in _UNITS.items():
        number = getattr(table.number, name)
        if number is not None and number.unit != unit:
            raise error_at(path, ("number", name, "unit"), f"{name} is in {unit}")
    if table.released.whole_counts and table.number.counts_per_turn.value < 2 * np.pi:
        text = "with released.whole_counts, a turn needs at least 6.28 counts: fewer are rounded down to 0 per rad"
        raise error_at(path, ("number", "counts_per_turn", "value"), text)
    joint_names = [joint.name for joint in mechanism.active]
    stated_motors = [motor.name for motor in table.motor]
    stated_joints = [friction.name for friction in table.joint]
    compensated_joints = [point.joint for point in table.compensation]
    _check_names(path, "motor", stated_motors, mechanism.motor_names)
    _check_names(path, "joint", stated_joints, joint_names)
    # a joint without a point mass needs no compensation
    _check_names(path, "compensation", compensated_joints, joint_names, complete=False)
    for i, entry in enumerate(table.joint):
        joint = mechanism.joint(entry.name)
        unit = "N m" if joint.is_angle else "N"
        if entry.unit != unit:
            text = f"{joint.name} is {joint.type}, but its friction is in {entry.unit}"
            raise error_at(path, ("joint", i, "unit"), text)
    return table


def _check_names(path: Path, key: str, names: Sequence[str], known: Sequence[str], *, complete: bool = True) -> None:
    """Check that the entries [[key]] of a file have known names, each once, and, if `complete`, all of them."""
    for i, name in enumerate(names):
        if name not in known:
            raise error_at(path, (key, i), unknown(key, name, known))
        if name in names[:i]:
            raise error_at(path, (key, i), f"'{name}' is defined twice")
    missing = []
    for name in known:
        if name not in names:
            missing.append(name)
    if complete and missing:
        raise DescriptionError(f"{path}: no [[{key}]] for {', '.join(missing)}")
