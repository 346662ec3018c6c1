"""Draw the instrument arm of the da Vinci Classic and write it as a STEP assembly.

    python cad/davinci_psm/model.py [--dimensions FILE] [--out davinci_psm.step]

Yaw, pitch, roll and wrist are drawn at zero, the instrument inserted by `insertion`, the jaws closed.  Each rigid body
is one sub-assembly; its parts are named <body>_<part>.  All shapes are written in world coordinates, whose origin is
the RCM: no instance carries a placement.
"""

import importlib.util
import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
import drawing as cad

LINKAGE = ["yaw", "crank1", "crank2", "coupler1", "coupler2", "rail"]
BODIES = ["base", "setup1", "setup2", "mount", *LINKAGE, "stage", "shaft", "wrist", "hand", "jaw_left", "jaw_right"]
ERRORS = {  # which manufacturing errors each body knows
    "yaw": {"pivot1_offset_mm", "pivot2_offset_mm"},
    **{body: {"length_mm"} for body in ("crank1", "crank2", "coupler1", "coupler2")},
    "rail": {"pin_c_offset_mm"},
}


def drawing():
    """Load parts.py beside this file; late, because build123d takes seconds."""
    if "davinci_psm_parts" not in sys.modules:
        spec = importlib.util.spec_from_file_location("davinci_psm_parts", HERE / "parts.py")
        sys.modules["davinci_psm_parts"] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules["davinci_psm_parts"])
    return sys.modules["davinci_psm_parts"]


def placements(d):
    """World placement (4x4, mm) of every body."""
    from davinci import places

    high = d.origin - d.insertion
    at = places(d)
    at |= dict.fromkeys(("stage", "shaft"), (0, 0, high))
    at["wrist"] = (0, 0, high - d.shaft_long)
    at |= dict.fromkeys(("hand", "jaw_left", "jaw_right"), (0, 0, high - d.shaft_long - d.wrist))
    return {body: cad.pose4(p, *np.eye(3)) for body, p in at.items()}


def assembly(path):
    """Return the drawn robot of a dimension file: ({body: [(name, shape, rgb)]}, mass in kg)."""
    d, parts = cad.Dimensions(path, ERRORS), drawing()
    solids = {
        body: getattr(parts, body)(d, d.error(body)) if body in LINKAGE else getattr(parts, body)(d) for body in BODIES
    }
    return cad.build(BODIES, solids, placements(d), parts.MATERIALS)


if __name__ == "__main__":
    cad.command("davinci_psm", HERE, assembly)
