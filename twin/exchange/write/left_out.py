"""What a format has no place for: said as findings, in the file and on the terminal."""

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
