"""Draw the organs of the scene vsrs and write them as a STEP assembly.

    python cad/organs/model.py [--dimensions FILE] [--out organs.step]

Each body is one sub-assembly with one part, <body>_tissue.  All shapes are written in world coordinates.
"""

import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
import drawing as cad

ORGANS = ["liver", "gallbladder", "stomach"]
BODIES = [*ORGANS, "wall"]


def assembly(path):
    """Return the drawn organs of a dimension file: ({body: [(name, shape, rgb)]}, mass in kg)."""
    d, parts = cad.Dimensions(path, {}), cad.parts(HERE)
    solids = {name: parts.organ(getattr(d, name), name) for name in ORGANS}
    solids["wall"] = parts.wall(d)
    return cad.build(BODIES, solids, dict.fromkeys(BODIES, np.eye(4)), parts.MATERIALS)


if __name__ == "__main__":
    cad.command("organs", HERE, assembly)
