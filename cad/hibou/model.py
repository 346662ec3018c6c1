"""Draw Hibou with its endoscope pointing straight down through the trocar."""

import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
import drawing as cad
from drawing import row

BODIES = ["base", "turret", "upper_arm", "forearm", "bracket", "yoke", "scope", "camera", "cannula"]


def table(d):
    """Return the pose (4, 4) of frame j in frame j - 1 with joint j at zero, {j: pose}; lengths in mm."""
    return {
        1: row(0, 0, 0, d.h),
        2: row(-90, 0, 0, 0),
        3: row(0, d.arm, 0, 0),
        4: row(0, d.arm, 0, 0),
        5: row(90, 0, 90, 0),
        6: row(90, 0, 0, 0),
        7: row(0, 0, 0, d.length) @ row(-90, 0, 0, 0),
        8: row(90, 0, 0, d.tip),
    }


def placements(d):
    """Return the pose (4, 4) in mm of each body in the world, with the scope pointing straight down in the trocar."""
    x, _, z = d.trocar
    rise = z - d.depth + d.length - d.h  # height of the outer point above the shoulder
    reach = np.hypot(x, rise)
    bend = 2 * np.degrees(np.arccos(reach / (2 * d.arm)))  # elbow of two equal links
    lean = -np.degrees(np.arctan2(rise, x)) - bend / 2  # elbow up
    q = {2: lean, 3: bend, 4: 90 - lean - bend}
    T, out = np.eye(4), {"base": np.eye(4)}
    for j, body in enumerate(BODIES[1:8], 1):
        T = T @ table(d)[j] @ row(0, 0, q.get(j, 0.0), 0)
        out[body] = T
    out["cannula"] = out["scope"].copy()
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
        solids[body] = draw(d, at[k]) if k <= 7 else draw(d)
    return cad.build(BODIES, solids, placements(d), parts.MATERIALS)


if __name__ == "__main__":
    cad.command("hibou", HERE, assembly)
