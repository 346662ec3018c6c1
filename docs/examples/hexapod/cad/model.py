"""Draw the hexapod and write it as a STEP assembly.

    python docs/examples/hexapod/cad/model.py [--dimensions FILE] [--out hexapod.step]

The platform is horizontal.  Each rigid body is one sub-assembly (base, cross1..6, cylinder1..6, rod1..6, platform);
its parts are named <body>_<part>.  All shapes are written in world coordinates: no instance has a placement.
"""

import importlib.util
import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[3] / "cad"))
import drawing as cad
from drawing import pose4, unit

LEGS = range(1, 7)
BODIES = ["base", *(f"{kind}{n}" for n in LEGS for kind in ("cross", "cylinder", "rod")), "platform"]


def on_circle(radius, angle, z):
    """Return the point of a horizontal circle at an angle in degrees."""
    return np.array([radius * np.cos(np.radians(angle)), radius * np.sin(np.radians(angle)), z])


def ends(d, n):
    """Return the centres of leg n: universal joint in the base frame, ball joint in the platform frame."""
    middle, side = 120.0 * ((n - 1) // 2), 1 if n % 2 == 0 else -1
    return on_circle(d.r_a, middle + side * d.alpha, d.h_a), on_circle(d.r_b, middle + side * d.beta, -d.h_b)


def placements(d):
    """Return the pose (4, 4) in mm of each body in the world, with a horizontal platform.

    In a leg's frame, z points from the universal joint to the ball, x is along the horizontal pin in the base, and y
    is along the other pin.
    """
    out = {"base": np.eye(4), "platform": np.eye(4)}
    out["platform"][2, 3] = d.height
    for n in LEGS:
        a, b = ends(d, n)
        b[2] += d.height
        z = unit(b - a)
        x = unit(np.cross([0, 0, 1.0], z))
        out[f"cross{n}"] = out[f"cylinder{n}"] = pose4(a, x, np.cross(z, x), z)
        out[f"rod{n}"] = pose4(b, x, np.cross(z, x), z)
    return out


def drawing():
    """Load parts.py next to this file; called only when drawing, because importing build123d takes seconds."""
    if "hexapod_parts" not in sys.modules:
        spec = importlib.util.spec_from_file_location("hexapod_parts", HERE / "parts.py")
        sys.modules["hexapod_parts"] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules["hexapod_parts"])
    return sys.modules["hexapod_parts"]


def assembly(path):
    """Draw the robot with the values of a dimension file; return ({body: [(name, shape, rgb)]}, mass in kg)."""
    d, parts = cad.Dimensions(path, {}), drawing()
    where = placements(d)
    legs = [where[f"cross{n}"] for n in LEGS]
    solids = {"base": parts.base(d, legs), "platform": parts.platform(d, [ends(d, n)[1] for n in LEGS], legs)}
    for n in LEGS:
        solids |= {f"cross{n}": parts.cross(d), f"cylinder{n}": parts.cylinder(d), f"rod{n}": parts.rod(d)}
    return cad.build(BODIES, solids, where, parts.MATERIALS)


if __name__ == "__main__":
    cad.command("hexapod", HERE, assembly)
