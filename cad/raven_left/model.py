"""Draw the left arm of the Raven-II and write it as a STEP assembly.

    python cad/raven_left/model.py [--dimensions FILE] [--out raven_left.step]

The arm is drawn at home, with roll, wrist and jaws at zero.  Each rigid body is one sub-assembly; its parts are named
<body>_<part>.  All shapes are written in world coordinates with the origin at the RCM: no instance has a placement.
"""

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
import drawing as cad


def assembly(path):
    """Draw the robot with the values of a dimension file; return ({body: [(name, shape, rgb)]}, mass in kg)."""
    import raven  # imported here, because build123d takes seconds

    return raven.assembly(path, "left")


if __name__ == "__main__":
    cad.command("raven_left", HERE, assembly)
