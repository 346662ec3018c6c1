"""Sentences of README.txt that are the same in every export. The writer writes them; the audit compares them."""

from __future__ import annotations

CONVENTIONS = (
    "- Metres, kilograms, seconds, radians. UsdPhysics angles are degrees, as the format requires.",
    "- The robot's own world is z up, right-handed; it is the frame of the base. Link poses in every file and in the "
    "stream of `twin serve` are poses in that world.",
    "- GLB and USDZ are y up: their root node rotates the robot by -90 degrees about x. Links below the root keep "
    "their z-up poses, so that a pose of the tracks can be assigned to a node unchanged.",
    "- Quaternions are x y z w (USD: w x y z); their signs do not change from key to key.",
    "- Unity is left-handed. A glTF importer mirrors x: (x, y, z) becomes (-x, y, z), the quaternion (x, -y, -z, w). "
    "ROS importers use (-y, z, x) and (-y, z, x, -w). The player of the Unity package supports both conventions.",
    "- Names of links, joints and frames are the same in every file.",
)
"""Lines on units, frames and orders of numbers."""

UNTRIED = (
    "- These files have not been shown on a physical headset, an iPhone or a graphics card.",
    "- The Unity editor has not run the Unity package: its C# was compiled and tested against a stub of UnityEngine. "
    "The package has a self-test to be run in the editor.",
)
"""Lines on what has not been tested."""
