"""Draw the props of the scene raven_dome: a dome with half of its lid cut away, a tower for a ring, and a wire.

Shapes are drawn with the middle of the floor as origin, and then placed in the world frame.
"""

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
import drawing as cad

BODIES = ["floor", "dome", "tower", "wire"]


def assembly(path):
    """Draw the scene with the values of a dimension file; return ({body: [(name, shape, rgb)]}, mass in kg)."""
    d, parts = cad.Dimensions(path, {}), cad.parts(HERE)
    solids = {"floor": parts.floor(d), "dome": parts.dome(d), "tower": parts.tower(d), "wire": parts.wire(d)}
    T = cad.pose4(d.centre, (1, 0, 0), (0, 1, 0), (0, 0, 1))
    return cad.build(BODIES, solids, dict.fromkeys(BODIES, T), parts.MATERIALS)


if __name__ == "__main__":
    cad.command("raven_dome", HERE, assembly)
