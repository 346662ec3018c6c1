"""Read and check the elements <transmission> of a URDF, which say what drives its joints.

Reading serves the comparison with other files: which joints are driven, by which motors, with which reductions. Two
kinds of checks report what one file shows by itself: `check_transmission_elements` what ros_control rejects, or what is
built in another way than most transmissions; `check_transmission_names` joints and actuators that do not match.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator
from xml.etree import ElementTree as ET

import numpy as np

from twin.exchange.audit.file_drives import FileMotor
from twin.exchange.audit.ledger import Ledger
from twin.exchange.formats.urdf.audit.attributes import numbers, repeated

_TRANSMISSION_TYPES = ("SimpleTransmission", "DifferentialTransmission", "FourBarLinkageTransmission")
"""Transmissions of the package transmission_interface."""

_HARDWARE_INTERFACES = (
    *("PositionJointInterface", "VelocityJointInterface", "EffortJointInterface", "PosVelJointInterface"),
    *("PosVelAccJointInterface", "JointStateInterface", "ActuatorStateInterface", "JointCommandInterface"),
    *("PositionActuatorInterface", "VelocityActuatorInterface", "EffortActuatorInterface"),
)
"""Interfaces of the package hardware_interface."""

_FEWEST_TRANSMISSIONS = 3
"""Transmissions from which the common form counts: two that differ say nothing about which of them is meant."""

_COMMON_FORM = 0.7
"""Share of the transmissions from which their form is the form of the file."""


def driven_joints(root: ET.Element) -> frozenset[str]:
    """Return the names of the joints in transmissions, or with a command interface of ros2_control: the driven joints.

    If no joint is named, the file does not state which joints are driven.
    """
    names: set[str] = set()
    for transmission in root.findall("transmission"):
        names.update(_names(transmission, "joint"))
    for control in root.findall("ros2_control"):
        for joint in control.findall("joint"):
            if joint.find("command_interface") is not None:
                names.add(str(joint.get("name")))
    return frozenset(names)


def driven_in_order(root: ET.Element) -> list[str]:
    """Return the joints of the transmissions with one joint, in the order of the file, each once."""
    names: dict[str, None] = {}
    for transmission in root.findall("transmission"):
        joints = _names(transmission, "joint")
        if len(joints) == 1:
            names[joints[0]] = None
    return list(names)


def _names(parent: ET.Element, tag: str) -> list[str]:
    """Return the names of the child elements with a tag."""
    return [str(element.get("name")) for element in parent.findall(tag)]


def read_reductions(root: ET.Element, driven: Collection[str]) -> dict[str, float] | None:
    """Return {joint: reduction} of the transmissions with one joint; None if the file states no driven joint.

    Raises:
        ReadError: a reduction is not a finite number.
    """
    if not driven:
        return None
    reductions: dict[str, float] = {}
    for transmission in root.findall("transmission"):
        joints = _names(transmission, "joint")
        if len(joints) == 1:
            reductions[joints[0]] = float(np.prod(_stated_reductions(transmission)))  # without one, it is 1
    return reductions


def _stated_reductions(transmission: ET.Element) -> list[float]:
    reductions = []
    for element in transmission.iter("mechanicalReduction"):
        text = (element.text or "").strip()
        if text:  # an empty one is reported by `check_transmission_elements`
            reductions.append(float(numbers(text, 1, ())[0]))
    return reductions


def read_motors(root: ET.Element) -> dict[str, FileMotor]:
    """Return {name: motor} of the <transmission> elements with one joint, one actuator and one reduction.

    A motor with the same name as its joint is omitted, because it represents the joint's drive.

    Raises:
        ReadError: a reduction is not a finite number.
    """
    motors: dict[str, FileMotor] = {}
    for transmission in root.findall("transmission"):
        joints = _names(transmission, "joint")
        actuators = _names(transmission, "actuator")
        reductions = _stated_reductions(transmission)
        if len(joints) == len(actuators) == len(reductions) == 1 and actuators != joints:
            motors[actuators[0]] = FileMotor({joints[0]: reductions[0]})
    return motors


def check_transmission_names(root: ET.Element, names: Collection[str], ledger: Ledger) -> None:
    """Report transmissions of one joint whose joint is not among `names`, or whose actuator is named as another one."""
    for transmission in root.findall("transmission"):
        joints = _names(transmission, "joint")
        actuators = _names(transmission, "actuator")
        label = str(transmission.get("name"))
        if len(joints) != 1 or len(actuators) != 1:
            continue
        if joints[0] not in names:
            text = f"transmission '{label}' names joint '{joints[0]}', which does not exist."
            ledger.wrong("urdf.transmission", text, label)
        elif actuators[0] != joints[0] and actuators[0] in names:
            text = f"transmission '{label}': actuator '{actuators[0]}' drives '{joints[0]}', not the joint of its name."
            advice = "let the actuator drive the joint of its name, or rename it"
            ledger.wrong("urdf.transmission", text, joints[0], suggestion=advice)


def check_transmission_elements(root: ET.Element, ledger: Ledger) -> None:
    """Report transmissions that ros_control rejects, or that are built in another way than most of a file."""
    transmissions = root.findall("transmission")
    labels = [str(transmission.get("name")) for transmission in transmissions]
    for name in repeated(labels):
        text = f"two transmissions are named '{name}'."
        ledger.wrong("urdf.duplicate_name", text, name, suggestion="give each transmission its own name")
    simple: list[ET.Element] = []
    for transmission in transmissions:
        name = _transmission_name(transmission)
        if not transmission.get("name"):
            text = f"the transmission of {name} has no name: ros_control rejects it."
            ledger.wrong("urdf.transmission", text, name, suggestion="name the transmission")
        for fault in _transmission_faults(transmission):
            text = f"transmission '{name}' {fault}: ros_control rejects it."
            ledger.wrong("urdf.transmission", text, name, suggestion="write it as the others are")
        if len(transmission.findall("joint")) == len(transmission.findall("actuator")) == 1:
            simple.append(transmission)
    _check_common_form(simple, ledger)


def _check_common_form(transmissions: list[ET.Element], ledger: Ledger) -> None:
    """Report transmissions of one joint and one actuator that are built in another way than most."""
    if len(transmissions) < _FEWEST_TRANSMISSIONS:
        return
    forms = [_built_form(transmission) for transmission in transmissions]
    common, count = Counter(forms).most_common(1)[0]
    if count < _COMMON_FORM * len(forms):
        return
    for transmission, form in zip(transmissions, forms, strict=True):
        if form != common:
            differing = ", ".join(sorted({*form} ^ {*common}))
            name = _transmission_name(transmission)
            text = f"transmission '{name}' is built in another way than {count} others: {differing}."
            ledger.add("urdf.transmission", "warning", text, name, suggestion="write it as the others are")


def _transmission_name(transmission: ET.Element) -> str:
    """Return the name of a transmission; without one, the names of its joints."""
    name = transmission.get("name")
    if name:
        return str(name)
    return ", ".join(str(joint.get("name")) for joint in transmission.findall("joint"))


def _transmission_faults(transmission: ET.Element) -> Iterator[str]:
    """Yield what is wrong in a transmission, for a sentence that begins with its name."""
    types = transmission.findall("type")
    kind = "" if not types else (types[0].text or "").strip()
    if len(types) > 1:
        yield f"has {len(types)} types"
    package, _, plain = kind.rpartition("/")
    if not kind and transmission.get("type") is None:
        yield "has no type"
    elif package in ("", "transmission_interface") and kind and plain not in _TRANSMISSION_TYPES:
        yield f"has the type '{kind}', which does not exist"
    for tag in ("joint", "actuator"):
        parts = transmission.findall(tag)
        names = [str(part.get("name") or "") for part in parts]
        if not all(names):
            article = "an" if tag == "actuator" else "a"
            yield f"has {article} {tag} without a name"
        for name in repeated(names):
            yield f"has the {tag} '{name}' {names.count(name)} times"
        if not parts and (tag == "joint" or plain == "SimpleTransmission"):
            yield f"has no {tag}"
        of_actuators = transmission.findall("actuator/hardwareInterface")
        for part in parts:
            yield from _part_transmission_faults(part)
            # Since ROS Indigo, the interface is that of the joint; earlier files have neither.
            if tag == "joint" and part.find("hardwareInterface") is None and of_actuators:
                yield f"has no hardwareInterface of joint '{part.get('name')}', but one of its actuator"


def _part_transmission_faults(part: ET.Element) -> Iterator[str]:
    """Yield what is wrong in a joint or actuator of a transmission."""
    interfaces: list[str] = []
    for element in part.findall("hardwareInterface"):
        interfaces.append((element.text or "").strip())
    for interface in interfaces:
        package, _, plain = interface.rpartition("/")
        if not plain:
            yield f"has an empty hardwareInterface of {part.tag} '{part.get('name')}'"
        elif package in ("", "hardware_interface") and plain not in _HARDWARE_INTERFACES:
            yield f"has the hardwareInterface '{interface}', which does not exist"
    for interface in repeated(interfaces):
        yield f"has the hardwareInterface '{interface}' twice"
    reductions = part.findall("mechanicalReduction")
    if len(reductions) > 1:
        yield f"has {len(reductions)} elements mechanicalReduction of {part.tag} '{part.get('name')}'"
    for reduction in reductions:
        if not (reduction.text or "").strip():
            yield f"has an empty mechanicalReduction of {part.tag} '{part.get('name')}'"


def _built_form(transmission: ET.Element) -> tuple[str, ...]:
    """Return how a transmission is built: its elements with their words, without names and numbers."""
    parts = []
    for element in transmission.iter():
        word = ""
        if element.tag in ("type", "hardwareInterface"):
            word = f" {(element.text or '').strip()}"
        parts.append(f"<{element.tag}>{word}")
    return tuple(parts)
