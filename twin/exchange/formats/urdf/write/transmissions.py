"""Transmissions of a URDF, as ros_control reads them."""

from __future__ import annotations

from collections.abc import Mapping
from xml.etree import ElementTree as ET

from twin.model.mechanism import Mechanism

SIMPLE = "transmission_interface/SimpleTransmission"
"""Transmission type of one motor and one joint: motor value = mechanicalReduction * joint value."""

COUPLED = "twin/LinearTransmission"
"""Transmission type of several motors and joints; URDF cannot contain the transmission matrix."""


def add_transmissions(root: ET.Element, mechanism: Mechanism) -> None:
    """Write a transmission for every driven joint; joints without a transmission are passive."""
    for joint in mechanism.active:
        transmission = mechanism.transmission_of(joint.name)
        name = f"{joint.name}_transmission"
        single: tuple[str, float] | None = (joint.name, 1.0)  # a drive at the joint itself is written as a motor, too
        if transmission is not None:
            single = transmission.single(joint.name)
            if len(transmission.joints) == 1:
                name = transmission.name
        if single:
            actuator, ratio = single
            _add_transmission(root, name, SIMPLE, [joint.name], {actuator: 1 / ratio})
    for transmission in mechanism.transmissions:
        joints = []
        coupled_motors = dict.fromkeys(transmission.actuators)  # those without a transmission of their own above
        for name in transmission.joints:
            single = transmission.single(name)
            if single:
                coupled_motors.pop(single[0], None)
            else:
                joints.append(name)
        if joints:
            _add_transmission(root, transmission.name, COUPLED, joints, coupled_motors)


def _add_transmission(
    root: ET.Element, name: str, kind: str, joints: list[str], motors: Mapping[str, float | None]
) -> None:
    """Write a transmission; `motors` is {motor: its reduction, None if the transmission has a matrix instead}."""
    transmission = ET.SubElement(root, "transmission", name=name)
    ET.SubElement(transmission, "type").text = kind
    for joint in joints:
        _interfaced_part(transmission, "joint", joint)
    for motor, reduction in motors.items():
        element = _interfaced_part(transmission, "actuator", motor)
        if reduction is not None:
            ET.SubElement(element, "mechanicalReduction").text = f"{reduction:.12g}"


def _interfaced_part(transmission: ET.Element, tag: str, name: str) -> ET.Element:
    """Add a joint or an actuator with a position interface, which ros_control requires, to a transmission."""
    element = ET.SubElement(transmission, tag, name=name)
    ET.SubElement(element, "hardwareInterface").text = "hardware_interface/PositionJointInterface"
    return element
