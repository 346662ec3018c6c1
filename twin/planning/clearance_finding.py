"""Finding on the proven clearance of a phase."""

from __future__ import annotations

import numpy as np

from twin.core.findings import Finding
from twin.core.units import MM
from twin.planning.space import Certificate


def clearance(seen: Certificate, phase: str, who: str = "", scene: str = "") -> list[Finding]:
    """Return one finding with the proven clearance of a phase; an empty list if no pair of bodies is tested.

    Args:
        seen: the certificate of the path of the phase.
        phase: name of the phase.
        who: names of the robots, if there are several.
        scene: name of the scene; "" without one.
    """
    if not np.isfinite(seen.found):
        return []
    left = [
        "bodies connected by a joint",
        "bodies of one robot that in the CAD are nearer than twice the required clearance",
    ]
    left += [f"bodies that touch by design (`touching` of scene {scene})"] if scene else []
    text = (
        f"all bodies{f' of {who}' if who else ''} keep at least {seen.proven / MM:.2f} mm from each other"
        f"{' and from the scene' if scene else ''} at every moment and with any timing (proven), except "
        f"{', '.join(left[:-1])} and {left[-1]}; the smallest distance found is {seen.found / MM:.2f} mm, between "
        f"{' and '.join(seen.bodies)}"
    )
    return [Finding("clearance.proven", "info", text, phase, size=seen.proven / MM, unit="mm")]
