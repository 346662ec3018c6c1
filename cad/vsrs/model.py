"""Draw the props around the three robots of the virtual surgery paper and write them as a STEP assembly.

    python cad/vsrs/model.py [--dimensions FILE] [--out vsrs.step]

Each body is one sub-assembly; its parts are named <body>_<part>.  All shapes are written in world coordinates.
"""

import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
import drawing as cad

BODIES = ["table", "patient", "stand_left", "stand_right", "stand_camera"]


def assembly(path):
    """Draw the theatre with the values of a dimension file; return ({body: [(name, shape, rgb)]}, mass in kg)."""
    d, parts = cad.Dimensions(path, {}), cad.parts(HERE)
    solids = {
        "table": parts.table(d),
        "patient": parts.patient(d),
        "stand_left": parts.pedestal(d, d.left_base),
        "stand_right": parts.pedestal(d, d.right_base),
        "stand_camera": parts.pedestal(d, d.camera_base),
    }
    return cad.build(BODIES, solids, dict.fromkeys(BODIES, np.eye(4)), parts.MATERIALS)


if __name__ == "__main__":
    cad.command("vsrs", HERE, assembly)
