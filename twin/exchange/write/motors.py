"""What a format has no place for of actuators: said as findings, in the file and on the terminal."""

from __future__ import annotations

from collections.abc import Iterator

from twin.core.findings import Finding
from twin.model.mechanism import Mechanism


def motors_left_out(mechanism: Mechanism, file: str, *fields: str) -> Iterator[Finding]:
    """Yield a finding for each field of `Actuator` that is known and has no place in the format."""
    for field in fields:
        if names := ", ".join(a.name for a in mechanism.actuators if getattr(a, field) is not None):
            what = f"{field.replace('_', ' ')} of the actuators {names}"
            text = f"{file}: {what} is left out: the format has no place for it"
            yield Finding("export.left_out", "info", text, where=names)
