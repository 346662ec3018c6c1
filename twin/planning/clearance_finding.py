"""Finding on the proven clearance of a phase."""

from __future__ import annotations

import numpy as np

from twin.core.findings import Finding
from twin.core.units import MM
from twin.planning.space import PathCertificate


def clearance(certificate: PathCertificate, phase: str, who: str = "", scene: str = "") -> list[Finding]:
    """Return one finding with the proven clearance of a phase; an empty list if no pair of bodies is tested.

    Args:
        certificate: the certificate of the path of the phase.
        phase: name of the phase.
        who: names of the robots, if there are several.
        scene: name of the scene; "" without one.
    """
    if not np.isfinite(certificate.found):
        return []
    exceptions = [
        "bodies connected by a joint",
        "bodies of one robot that in the CAD are nearer than twice the required clearance",
    ]
    bodies = "all bodies"
    if who:
        bodies += f" of {who}"
    others = "each other"
    if scene:
        others += " and from the scene"
        exceptions.append(f"bodies that touch by design (`touching` of scene {scene})")
    excepted = ", ".join(exceptions[:-1]) + " and " + exceptions[-1]
    text = (
        f"{bodies} keep at least {certificate.proven / MM:.2f} mm from {others} at every moment and with any timing "
        f"(proven), except {excepted}; the smallest distance found is {certificate.found / MM:.2f} mm, between "
        f"{' and '.join(certificate.bodies)}"
    )
    return [Finding("clearance.proven", "info", text, phase, size=certificate.proven / MM, unit="mm")]
