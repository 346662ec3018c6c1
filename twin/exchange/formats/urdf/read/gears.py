"""Read the gears of a URDF: transmissions with a ratio other than 1 become motors of one joint each."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple
from xml.etree.ElementTree import Element

from twin.core.errors import SourceError
from twin.exchange.read.imported_robot import Findings
from twin.exchange.read.xml_file import Xml

MOVING = ("revolute", "continuous", "prismatic")
"""Joint types of URDF with one coordinate, which a motor can drive."""


class Gear(NamedTuple):
    """A motor that moves one joint. One turn of the joint is `ratio` turns of the motor."""

    transmission: str
    motor: str
    ratio: float


def read_gears(
    xml: Xml, joints: Mapping[str, Element], retyped: Collection[str], driven: Collection[str], findings: Findings
) -> dict[str, Gear]:
    """Return {joint: its gear} for ratios other than 1; report what a transmission states beside that.

    `joints` are the joints of the file by name, `retyped` those whose type a closure YAML replaces, and `driven` the
    joints, or parts of joints, that motors drive.
    """
    gears: dict[str, Gear] = {}
    for transmission in xml.root.findall("transmission"):
        label = str(transmission.get("name"))
        where = f"transmission '{label}'"
        names = [str(element.get("name")) for element in transmission.findall("joint")]
        actuators = transmission.findall("actuator")
        ratios = _ratios(xml, where, transmission, findings)
        if _has_offset(xml, where, transmission):
            text = f"{where}: the offset is not imported; motor and joint get the same zero position."
            findings.warn("gear", text, label)
        is_simple = len(names) == len(actuators) == len(ratios) == 1 and ratios[0] != 0
        if is_simple and names[0] in driven and names[0] not in gears and names[0] not in retyped:
            # The name can be that of a part of a universal joint, which is no element of the file.
            element = joints.get(names[0])
            if ratios[0] != 1 and element is not None and element.get("type") in MOVING:
                gears[names[0]] = Gear(label, str(actuators[0].get("name")), ratios[0])
        elif names and not _any_moves(names, joints, retyped):
            continue  # the reader of driven joints has warned
        elif len(names) > 1 or ratios.count(1) < len(ratios):
            content = "the assignment of motors to joints"
            if ratios:
                content = "mechanicalReduction " + ", ".join(map("{:g}".format, ratios))
            text = f"{where}: {content} is not imported: the joints are driven directly."
            findings.warn("gear", text, label)
    return gears


def _ratios(xml: Xml, where: str, transmission: Element, findings: Findings) -> list[float]:
    """Return each mechanicalReduction; a text that is not a number counts as 1, with a warning."""
    ratios = []
    for element in transmission.iter("mechanicalReduction"):
        try:
            ratio = xml.number(where, element.tag, element.text, 1.0)
        except SourceError:
            excerpt = " ".join(str(element.text).split())[:80]
            text = f"{where}: mechanicalReduction '{excerpt}' is not a number; 1 is used."
            findings.warn("gear", text, where)
            ratio = 1.0
        ratios.append(ratio)
    return ratios


def _has_offset(xml: Xml, where: str, transmission: Element) -> bool:
    has_offset = False
    for element in transmission.iter("offset"):  # all of them: each must be a number
        if xml.number(where, element.tag, element.text, 0.0):
            has_offset = True
    return has_offset


def _any_moves(names: Sequence[str], joints: Mapping[str, Element], retyped: Collection[str]) -> bool:
    """Return whether a motor can drive one of the joints with these names; names of no joint do not count."""
    for name in names:
        joint = joints.get(name)
        if name in retyped or (joint is not None and joint.get("type") in MOVING):
            return True
    return False
