"""Draw the SILS parallel robot with its two instruments, whose three joints each move them about their own RCM.

Mechanism, laparoscope and all their sizes are those of `cad/sils`; the instruments replace the rigid ones drawn there.
"""

import importlib.util
import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
SILS = HERE.parent / "sils"
sys.path.insert(0, str(HERE.parent))
import drawing as cad

NUMBERS = (1, 2)
MOVING = ("cradle", "guide", "instrument")


def _sils():
    """Load the model of the robot without instruments."""
    name = "sils_model"
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, SILS / "model.py")
        sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[name])
    return sys.modules[name]


def dimensions(path):
    """Read a dimension file of the instruments; return it with the values of the parallel mechanism."""
    d = cad.Dimensions(path, {})
    mechanism = _sils().dimensions(SILS / "dimensions.toml")
    for name, value in vars(mechanism).items():
        vars(d).setdefault(name, value)
    return d


def instrument_frame(d, n):
    """Return the pose (4, 4) of the frame of instrument n in the axes of the platform, in mm."""
    azimuth = np.radians(d.instrument_azimuth if n == 1 else -d.instrument_azimuth)
    tilt = np.radians(d.instrument_tilt)
    out = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    side = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    up = np.sin(tilt) * out + np.cos(tilt) * np.array([0.0, 0.0, 1.0])
    rcm = d.instrument_offset * side - np.array([0.0, 0.0, d.instrument_rcm])
    return cad.pose4(rcm, np.cross(side, up), side, up)


def assembly(path):
    """Draw the robot with the values of a dimension file; return ({body: [(name, shape, rgb)]}, mass in kg)."""
    d = dimensions(path)
    sils = _sils()
    where = sils.placements(d, d.pose_position, d.pose_angles)
    if where is None:
        raise ValueError("the posture in the CAD cannot be reached with these lengths")
    parts = cad.parts(HERE)
    solids = sils.draw(d)
    frames = {n: instrument_frame(d, n) for n in NUMBERS}
    solids["platform"] = parts.platform(d, frames)
    bodies = list(sils.BODIES)
    for n, frame in frames.items():
        for kind in MOVING:
            body = f"{kind}{n}"
            bodies.append(body)
            solids[body] = getattr(parts, kind)(d)
            where[body] = where["platform"] @ frame
    return cad.build(bodies, solids, where, parts.MATERIALS)


if __name__ == "__main__":
    cad.command("sils_instruments", HERE, assembly)
