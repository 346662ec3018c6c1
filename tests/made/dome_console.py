"""A scene with a console for the dome: both Raven arms, without machines; the left arm starts below the lid."""

from __future__ import annotations

import shutil

from twin.core import assets
from twin.model.scene import load_scene

SCENE = """
name = "dome_console"
title = "Both arms of the Raven-II at a dome, under a console"
source = "arrangement ASSUMED, for tests"
props = "props.toml"
clearance_mm = 2.0

[port.left]
position_mm = [0, 0, 0]
provenance = "ASSUMED"
note = "RCM"

[port.right]
position_mm = [250, 0, 0]
provenance = "ASSUMED"
note = "RCM"

[port.camera]
position_mm = [60, -60, 80]
provenance = "ASSUMED"
note = "between the arms"

[[robot]]
name = "raven_left"
port = "left"
position_mm = [0, 0, 0]
yaw_deg = 0
start = { shoulder = 50, elbow = 114, insertion = 378, roll = 0, wrist = -52, yaw = 0 }
provenance = "ASSUMED"
note = "below the lid"

[[robot]]
name = "raven_right"
port = "right"
position_mm = [250, 0, 0]
yaw_deg = 0
provenance = "ASSUMED"
note = "beside the dome"

[[robot]]
name = "ecm"
robot = "davinci_ecm"
port = "camera"
position_mm = [60, -60, 80]
yaw_deg = 0
start = { q1 = -15, q2 = -40, q3 = 45, q4 = 0 }
provenance = "ASSUMED"
note = "it looks at the dome"

[camera.endoscope]
robot = "ecm"
frame = "tool"
roll_deg = -90
view_deg = 70
provenance = "ASSUMED"
note = "as in the scene raven"

[console]
right = ["raven_right"]
left = ["raven_left"]
camera = "endoscope"
scale = 1.0
provenance = "ASSUMED"
note = "for tests"
"""

ABOVE = (81, 91, 432, 0, 0, 0)
"""Shoulder, elbow, insertion, roll, wrist and yaw (insertion in mm, others in deg) above the lid, without collision."""


def dome_console(folder):
    """Write the scene to a folder; return the loaded scene."""
    for name in ("props.toml", "dome.step", "dimensions.toml"):
        shutil.copy(assets.data_folder() / "cad" / "dome" / name, folder)
    file = folder / "scene.toml"
    file.write_text(SCENE)
    return load_scene(file)
