"""Report data of joints and motors that a format cannot hold; the findings appear in the file and on the terminal."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

from twin.core.findings import Finding, info
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism

Told = Mapping[str, Callable[[Joint], object]]
"""Kinds of joint data: by name of the data, a function that returns a joint's value, or None if it has no value."""

SOFT_LIMITS: Told = {"soft limits": lambda j: j.soft_limits}
MAX_SPEEDS: Told = {"maximum speeds": lambda j: j.max_speed}
MAX_ACCELERATIONS: Told = {"maximum accelerations": lambda j: j.max_acceleration}
MAX_JERKS: Told = {"maximum jerks": lambda j: j.max_jerk}
CONES: Told = {"cones": lambda j: j.cone}


def left_out(mechanism: Mechanism, file: str, told: Told) -> Iterator[Finding]:
    """Yield a finding for each kind of joint data in `told` that at least one joint has.

    `told` has the kinds of joint data that the format cannot hold; `file` is the file's name in the findings.
    """
    for what, of in told.items():
        names = ", ".join(j.name for j in mechanism.joints if of(j) is not None)
        if names:
            yield info("export.left_out", names, f"{file}: the format cannot hold the {what} of {names}")


def motors_left_out(mechanism: Mechanism, file: str, *fields: str) -> Iterator[Finding]:
    """Yield a finding for each of the given fields of `Actuator` that has a value in at least one actuator.

    The format cannot hold these fields; `file` is the file's name in the findings.
    """
    for field in fields:
        if names := ", ".join(a.name for a in mechanism.actuators if getattr(a, field) is not None):
            what = f"{field.replace('_', ' ')} of the actuators {names}"
            yield info("export.left_out", names, f"{file}: the format cannot hold the {what}")
