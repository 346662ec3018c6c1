"""Draw Lapbot and write it as a STEP assembly.

    python cad/lapbot/model.py [--dimensions FILE] [--out lapbot.step]

The robot is drawn with its instrument pointing straight down through the trocar.  Each rigid body is one sub-assembly;
its parts are named <body>_<part>.  All shapes are written in world coordinates: no instance has a placement.
"""

import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
import drawing as cad
from drawing import row

BODIES = ["base", "lift", "upper_arm", "forearm", "bracket", "yoke", "carrier", "shaft", "wrist", "jaw", "cannula"]


def table(d):
    """Return the pose (4, 4) of frame j in frame j - 1 with joint j at zero, {j: pose}; lengths in mm."""
    return {
        2: row(0, 0, 0, 0),
        3: row(0, d.arm, 0, 0),
        4: row(0, d.arm, 0, 0),
        5: row(90, 0, 90, 0),
        6: row(90, 0, -90, 0),
        7: row(90, 0, 0, 0),
        8: row(0, 0, 0, d.length) @ row(90, 0, 90, 0),
        9: row(90, 0, 90, 0),
        10: row(90, 0, 0, d.tool),
    }


def placements(d):
    """Return the pose (4, 4) in mm of each body in the world, with the shaft pointing straight down in the trocar."""
    x, _, z = d.trocar
    top = z - d.depth + d.length  # height of the outer point
    bend = 2 * np.degrees(np.arccos(x / (2 * d.arm)))  # elbow of two equal links over the distance x
    q = {2: -bend / 2, 3: bend, 4: -bend / 2}
    T, out = row(0, 0, 0, top), {"base": np.eye(4)}
    out["lift"] = T
    for j, body in enumerate(BODIES[2:10], 2):
        T = T @ table(d)[j] @ row(0, 0, q.get(j, 0.0), 0)
        out[body] = T
    out["cannula"] = out["shaft"].copy()
    out["cannula"][:3, 3] = d.trocar
    return out


def assembly(path):
    """Draw the robot with the values of a dimension file; return ({body: [(name, shape, rgb)]}, mass in kg)."""
    from shapes import location

    d, parts = cad.Dimensions(path, {}), cad.parts(HERE)
    at = {j: location(T) for j, T in table(d).items()}
    solids = {}
    for k, body in enumerate(BODIES, 1):
        draw = getattr(parts, body)
        solids[body] = draw(d, at[k]) if 2 <= k <= 9 else draw(d)  # the seat of the next joint
    return cad.build(BODIES, solids, placements(d), parts.MATERIALS)


if __name__ == "__main__":
    cad.command("lapbot", HERE, assembly)
