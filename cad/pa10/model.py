"""Draw the PA-10 with an instrument, all joints at zero: the arm points straight up, with frame 0 at its shoulder."""

import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
import drawing as cad

BODIES = ["base", *(f"link{j}" for j in range(1, 8)), "instrument"]
ERRORS = {  # the manufacturing errors that can be set for each body
    "base": {"bore1_offset_mm"},
    **{f"link{j}": {f"journal{j}_offset_mm", f"bore{j + 1}_offset_mm"} for j in range(1, 7)},
    "link7": {"journal7_offset_mm"},
    "instrument": {"tip_mm"},
}


def assembly(path):
    """Draw the robot with the values of a dimension file; return ({body: [(name, shape, rgb)]}, mass in kg)."""
    d, parts = cad.Dimensions(path, ERRORS), cad.parts(HERE)
    d.elbow, d.wrist = d.upper_arm, d.upper_arm + d.forearm
    d.flange_high = d.wrist + d.wrist_flange
    solids = {body: getattr(parts, body)(d, d.error(body)) for body in BODIES}
    return cad.build(BODIES, solids, dict.fromkeys(BODIES, np.eye(4)), parts.MATERIALS)


if __name__ == "__main__":
    cad.command("pa10", HERE, assembly)
