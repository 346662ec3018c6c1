"""What a format has no place for, of joints and of motors: said as findings, in the file and on the terminal."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

from twin.core.findings import Finding
from twin.model.mechanism import Joint, Mechanism

Told = Mapping[str, Callable[[Joint], object]]

SOFT_LIMITS: Told = {"soft limits": lambda j: j.soft_limits}
MAX_SPEEDS: Told = {"maximum speeds": lambda j: j.max_speed}
MAX_ACCELERATIONS: Told = {"maximum accelerations": lambda j: j.max_acceleration}
CONES: Told = {"cones": lambda j: j.cone}


def left_out(mechanism: Mechanism, file: str, told: Told) -> Iterator[Finding]:
    """Yield a finding for each thing that joints have and the format has no place for."""
    for what, of in told.items():
        names = ", ".join(j.name for j in mechanism.joints if of(j) is not None)
        if names:
            text = f"{file}: the {what} of {names} are left out: the format has no place for them"
            yield Finding("export.left_out", "info", text, where=names)


def motors_left_out(mechanism: Mechanism, file: str, *fields: str) -> Iterator[Finding]:
    """Yield a finding for each field of `Actuator` that is known and has no place in the format."""
    for field in fields:
        if names := ", ".join(a.name for a in mechanism.actuators if getattr(a, field) is not None):
            what = f"{field.replace('_', ' ')} of the actuators {names}"
            text = f"{file}: {what} is left out: the format has no place for it"
            yield Finding("export.left_out", "info", text, where=names)
