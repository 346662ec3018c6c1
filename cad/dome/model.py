"""Draw the props of the scene dome: a dome with half of its lid cut away, on a floor with a cube ring and two loops.

Shapes are drawn in the dome's own frame (origin in the middle of the floor, z along the axis of the dome, x towards the
open half of the lid) and then placed in the world frame.
"""

import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
import drawing as cad

BODIES = ["floor", "dome", "loops", "ring"]


def placed(d):
    """Return the pose (4, 4) in mm of the dome in the world frame, whose origin is the RCM.

    The axis of the dome is the line from its centre to the RCM, turned by `tilt` towards the vertical.
    """
    centre = np.array(d.centre, float)
    up, tilt = -centre / np.linalg.norm(centre), np.radians(d.tilt)
    side = np.array([0.0, 0.0, 1.0]) - up[2] * up
    side /= np.linalg.norm(side)
    z = np.cos(tilt) * up + np.sin(tilt) * side
    x = np.sin(tilt) * up - np.cos(tilt) * side  # the RCM is above the open half of the lid
    return cad.pose4(centre, x, np.cross(z, x), z)


def assembly(path):
    """Draw the scene with the values of a dimension file; return ({body: [(name, shape, rgb)]}, mass in kg)."""
    d, parts = cad.Dimensions(path, {}), cad.parts(HERE)
    solids = {"floor": parts.floor(d), "dome": parts.dome(d), "loops": parts.loops(d), "ring": parts.ring(d)}
    return cad.build(BODIES, solids, dict.fromkeys(BODIES, placed(d)), parts.MATERIALS)


if __name__ == "__main__":
    cad.command("dome", HERE, assembly)
