"""Read the bounds of a joint of a URDF: limits, soft limits, maximum speed and effort."""

from __future__ import annotations

from typing import NamedTuple
from xml.etree.ElementTree import Element

from twin.exchange.read.imported_robot import Findings, limits
from twin.exchange.read.xml_file import Xml

_UNSTATED = 1e6
"""Effort (N, N m) or speed (rad/s, m/s) from which a value counts as not stated. URDF requires numbers for both."""

_UNLIMITED = 1e3
"""Limit in m or rad that counts as none, because URDF requires both limits: of a slide always, of a hinge if its other
limit is nearer. A hinge without limits would be continuous."""


class JointBounds(NamedTuple):
    """Bounds of a joint in m or rad, of its speed per second, and of its effort in N or N m; None: no bound."""

    limits: tuple[float, float] | None = None
    soft_limits: tuple[float, float] | None = None
    max_speed: float | None = None
    max_effort: float | None = None


def read_bounds(xml: Xml, name: str, joint: Element, findings: Findings) -> JointBounds:
    """Return the bounds of a joint with one coordinate.

    Raises:
        SourceError: a value is not a number, the speed is negative, or limits are in the wrong order.
    """
    where = f"joint '{name}'"
    limit = joint.find("limit")
    hard = _hard_limits(xml, name, str(joint.get("type")), limit, findings)
    max_speed: float | None = None
    max_effort: float | None = None
    if limit is not None:
        speed = _value(xml, where, limit, "velocity")
        effort = _value(xml, where, limit, "effort")
        if speed is not None and speed < 0:
            xml.fail(where, f"velocity {speed:g} is negative")
        if speed and speed < _UNSTATED:  # 0 counts as not stated, too
            max_speed = speed
        if effort and effort < _UNSTATED:
            max_effort = effort
    soft: tuple[float, float] | None = None
    safety = joint.find("safety_controller")
    if safety is not None:
        low = _value(xml, where, safety, "soft_lower_limit")
        high = _value(xml, where, safety, "soft_upper_limit")
        if low is not None and high is not None:
            soft = limits(xml.path, low, high, name, findings)
    if hard is not None and soft is not None:
        soft = _clipped(hard, soft, name, findings)
    return JointBounds(hard, soft, max_speed, max_effort)


def _value(xml: Xml, where: str, element: Element, key: str) -> float | None:
    text = element.get(key)
    if text is None:
        return None
    return xml.number(where, key, text)


def _hard_limits(
    xml: Xml, name: str, kind: str, limit: Element | None, findings: Findings
) -> tuple[float, float] | None:
    """Return (lower, upper) in m or rad, one of them infinite if it is not limited; None for a joint without limits."""
    where = f"joint '{name}'"
    if kind == "continuous":
        if limit is not None and (limit.get("lower") is not None or limit.get("upper") is not None):
            findings.note("limits", f"{where} is continuous: the limits lower and upper are ignored.", name)
        return None
    if limit is None:
        findings.warn("limits", f"{where} has no <limit>: the joint is unlimited.", name)
        return None
    low = _value(xml, where, limit, "lower")
    high = _value(xml, where, limit, "upper")
    if low is None and high is None:
        findings.warn("limits", f"{where}: <limit> has neither lower nor upper: the joint is unlimited.", name)
        return None
    # In URDF a missing limit means zero.
    low = low or 0.0
    high = high or 0.0
    has_low = low > -_UNLIMITED
    has_high = high < _UNLIMITED
    if has_low == has_high and kind != "prismatic":  # of a hinge, both are meant
        return limits(xml.path, low, high, name, findings)
    return limits(xml.path, low if has_low else None, high if has_high else None, name, findings)


def _clipped(
    hard: tuple[float, float], soft: tuple[float, float], name: str, findings: Findings
) -> tuple[float, float] | None:
    """Return the soft limits, clipped to the hard limits; None if the two intervals do not overlap."""
    low, high = hard
    soft_low, soft_high = soft
    if low <= soft_low and soft_high <= high:
        return soft
    clipped: tuple[float, float] | None = (max(low, soft_low), min(high, soft_high))
    outcome = "clipped to the limits"
    if clipped[0] >= clipped[1]:
        clipped = None
        outcome = "left out"
    text = (
        f"joint '{name}': the soft limits {soft_low:g} .. {soft_high:g} exceed the limits {low:g} .. {high:g}; the "
        f"soft limits are {outcome}."
    )
    findings.note("soft_limits", text, name)
    return clipped
