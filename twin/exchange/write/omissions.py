"""Report data of joints and motors that a format cannot hold. Findings appear in the file and on the terminal."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from twin.core.findings import Finding, info
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.model.transmission import Actuator

_FIELD_WORDS = {
    "max_speed": "maximum speeds",
    "max_acceleration": "maximum accelerations",
    "max_jerk": "maximum jerks",
    "soft_limits": "soft limits",
    "cone": "cones",
}
"""Text for each field of `Joint` in findings."""


def left_out(mechanism: Mechanism, file: str, *fields: str) -> Iterator[Finding]:
    """Yield a finding for each of the given fields that is set in at least one joint.

    `fields` are names of fields of `Joint` that the format cannot hold. `file` is the name of the file in the findings.
    """
    for field in fields:
        names = _having(mechanism.joints, field)
        if names:
            yield info("export.left_out", names, f"{file}: the format cannot hold the {_FIELD_WORDS[field]} of {names}")


def limits_left_out(mechanism: Mechanism, file: str) -> Iterator[Finding]:
    """Yield a finding on the joints with limits and several coordinates: limits do not say which of them they limit."""
    names = []
    for joint in mechanism.joints:
        if joint.limits is not None and len(joint.free_axes) > 1:
            names.append(joint.name)
    if names:
        listed = ", ".join(names)
        text = f"{file}: the limits of {listed} are left out, because these joints have several coordinates"
        yield info("export.left_out", listed, text)


def motors_left_out(mechanism: Mechanism, file: str, *fields: str) -> Iterator[Finding]:
    """Yield a finding for each of the given fields that is set in at least one actuator.

    `fields` are names of fields of `Actuator` that the format cannot hold. `file` is the name of the file in the
    findings.
    """
    for field in fields:
        names = _having(mechanism.actuators, field)
        if names:
            what = f"{field.replace('_', ' ')} of the actuators {names}"
            yield info("export.left_out", names, f"{file}: the format cannot hold the {what}")


def _having(parts: Iterable[Joint] | Iterable[Actuator], field: str) -> str:
    """Return the names of the joints or actuators in which a field is set."""
    names = []
    for part in parts:
        if getattr(part, field) is not None:
            names.append(part.name)
    return ", ".join(names)
