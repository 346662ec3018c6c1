"""Read what a URDF says to single programs: calibrations and safety controllers for drivers, extensions for Gazebo."""

from __future__ import annotations

from xml.etree import ElementTree as ET

_GAZEBO_DYNAMICS = frozenset(
    {"gravity", "turnGravityOff", "static", "kinematic", "selfCollide", "self_collide", "dampingFactor"}
    | {"implicitSpringDamper", "springStiffness", "springReference"}
)
"""Elements of <gazebo> that change how a robot moves; others say how it looks, touches or is controlled."""


def program_settings(root: ET.Element) -> dict[str, dict[str, str]]:
    """Return {object: {element: its numbers or text}} of the settings for single programs.

    A safety controller with soft limits is left out: it is compared by these.
    """
    settings: dict[str, dict[str, str]] = {}
    for joint in root.findall("joint"):
        joint_settings: dict[str, str] = {}
        calibration = joint.find("calibration")
        if calibration is not None:
            joint_settings["calibration"] = _attributes(calibration)
        safety = joint.find("safety_controller")
        if safety is not None and "soft_lower_limit" not in safety.attrib and "soft_upper_limit" not in safety.attrib:
            joint_settings["safety_controller"] = _attributes(safety)
        if joint_settings:
            settings[f"joint '{joint.get('name')}'"] = joint_settings
    for extension in root.findall("gazebo"):
        name = extension.get("reference")  # a link or joint; an extension without one is of the whole robot
        subject = f"'{name}' in Gazebo" if name else "the robot in Gazebo"
        for element in extension:
            if element.tag in _GAZEBO_DYNAMICS:
                settings.setdefault(subject, {})[str(element.tag)] = (element.text or "").strip()
    return settings


def _attributes(element: ET.Element) -> str:
    return ", ".join(f"{key} {value}" for key, value in element.attrib.items())
