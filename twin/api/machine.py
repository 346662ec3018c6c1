"""Make the machine of a robot: its motors, control software and PLC, to run in real time or tick by tick."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

from twin.api.robot import Robot
from twin.core.errors import TwinError, unknown

if TYPE_CHECKING:
    from twin.simulation.hazards.fault import Fault
    from twin.simulation.machine.machine import Machine, Parts
    from twin.simulation.machine.settings import Mode, Policy


def machine_parts(
    robot: Robot,
    *,
    mode: Mode | None = None,
    overdrive: Policy | None = None,
    master_timeout: float | None = None,
    released: Collection[str] | None = None,
) -> Parts:
    """Return the compiled parts of a robot's machines; several machines can share them.

    Args:
        robot: a robot with inertia.toml and machine.toml in its folder, and with a closed inverse.
        mode: limits of the DAC; None: as in machine.toml.
        overdrive: policy above these limits; None: as in machine.toml.
        master_timeout: time in s without a packet after which the pedal counts as up; None: as in machine.toml.
        released: findings of the released software that this one has, names of `settings.Released`, the others being
            corrected; "none" stands for no name; None: as in machine.toml.

    Raises:
        TwinError: a file is missing or malformed, the mechanism has loops, the gains make it oscillate, a finding is
            unknown, or the time-out is not above 0.
    """
    from twin.simulation.dynamics import inertia
    from twin.simulation.dynamics.arm import arm
    from twin.simulation.machine import settings
    from twin.simulation.machine.machine import Parts

    if robot.files is None:
        raise TwinError(f"{robot.name} is a stage; a machine needs a robot folder with {settings.NAME}")
    model = arm(robot.mechanism, inertia.of_robot(robot.files.cad))
    table = settings.load(robot.files.cad / settings.NAME, model.mechanism)
    table = table.model_copy(update={"mode": mode or table.mode, "overdrive": overdrive or table.overdrive})
    if released is not None:
        known = list(settings.Released.model_fields)
        for name in set(released) - {"none"}:
            if name not in known:
                raise TwinError(unknown("finding of the released software", name, known))
        table = table.model_copy(update={"released": settings.Released(**{n: n in released for n in known})})
    if master_timeout is not None:
        if not master_timeout > 0:
            raise TwinError(f"the time-out of the master is {master_timeout:g} s; it must be above 0")
        kept = table.number.master_timeout.model_copy(update={"value": master_timeout})
        table = table.model_copy(update={"number": table.number.model_copy(update={"master_timeout": kept})})
    return Parts.of(model, robot.kinematics(), table)


def machine(
    parts: Parts, *, mass: float = 1.0, friction: float = 1.0, tilt: float = 0.0, faults: Sequence[Fault] = ()
) -> Machine:
    """Return a machine at home, in E_STOP; the control software has no information on the changes below.

    `mass` and `friction` are factors of all masses and of all friction; `tilt` in rad turns the base about its x axis.
    Faults change signals of `twin.simulation.machine.machine.LOCATIONS`.

    Raises:
        TwinError: a mass is not above 0, a friction is negative, or a fault has an unknown signal.
    """
    from twin.simulation.machine.machine import Machine

    physics = parts.plant.physics.changed(mass, friction, tilt)
    return Machine(parts, physics=physics, faults=faults)
