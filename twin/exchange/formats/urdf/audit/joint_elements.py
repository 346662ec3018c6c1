"""Read the elements <joint> of a URDF: where each joint is, how it moves, and its limits."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from xml.etree import ElementTree as ET

import numpy as np

from twin.exchange.audit.chain_poses import ChainStep
from twin.exchange.audit.file_content import FileClip
from twin.exchange.audit.file_drives import FileDrive, JointDynamics
from twin.exchange.audit.file_joints import FileJoint
from twin.exchange.audit.ledger import Ledger, Measured, ReadError
from twin.exchange.audit.motion_lines import JointLine, motion_lines, unit
from twin.exchange.audit.poses import Array
from twin.exchange.formats.urdf.audit.attributes import attribute, number, numbers, origin_pose, stated_number

MOTION_KINDS = {"revolute": "turn", "continuous": "turn", "prismatic": "slide", "fixed": "fixed", "floating": "free"}
"""{type of a joint of URDF: kind of its motion}; a planar joint is not supported."""

NO_LIMIT = 1000.0
"""Limit in m or rad that counts as none, because URDF requires both limits: of a slide always, of a hinge if its other
limit is nearer. A hinge without limits would be continuous."""

UNKNOWN_BOUND = 1e6
"""Effort (N, N m) or speed (m/s, rad/s) from which a value counts as unknown. URDF requires a number for both."""

_AXIS_ROUNDING = 1e-6
"""Difference from 1 of the length of an axis that is only rounding."""


@dataclass(frozen=True)
class UrdfJoint:
    """A joint of a URDF.

    Attributes:
        parent, child: names of the two links.
        step: pose of the joint in the parent's frame, kind of motion, and axis.
        limits: (lower, upper) in rad or m; None if not stated.
        effort: maximum effort in N or N m; None if not stated.
        speed: maximum speed in m/s or rad/s; None if not stated.
        damping, friction: of <dynamics>, in N s/m or N m s/rad, and N or N m; 0 if not stated.
        mimic: (leader, multiplier, offset) if the joint follows the joint `leader`, else None.
        soft: (lower, upper) of <safety_controller> in rad or m, within the limits; None without one.
    """

    name: str
    parent: str
    child: str
    step: ChainStep
    limits: tuple[float, float] | None
    effort: float | None
    speed: float | None
    mimic: tuple[str, float, float] | None
    damping: float = 0.0
    friction: float = 0.0
    soft: tuple[float, float] | None = None

    def values(self, clip: FileClip) -> Array | None:
        """Return the values (k,) in rad or m of the joint in a track; None if the track lacks the values.

        Values of a joint with `mimic` are computed from the leader's values.
        """
        # A leader that the track lacks gives nothing to compute from; the track may state the joint itself.
        if self.mimic is None or self.mimic[0] not in clip.joints:
            return clip.joints.get(self.name)
        leader, multiplier, offset = self.mimic
        return multiplier * clip.joints[leader] + offset

    def as_file_joint(self, driven: Collection[str]) -> FileJoint:
        """Return the joint in the form of all formats; `driven` is empty if the file does not state what is driven."""
        T_parent_joint = self.step.fixed
        motions: tuple[JointLine, ...] = ()
        if self.step.kind == "free":
            motions = motion_lines("free", T_parent_joint)
        elif self.step.kind != "fixed" and self.step.axis is not None:
            direction = unit(T_parent_joint[:3, :3] @ self.step.axis)
            motions = (JointLine(self.step.kind, T_parent_joint[:3, 3], direction),)
        drive = FileDrive()
        if len(motions) == 1:
            drive = self._drive(self.name in driven if driven else None)
        return FileJoint((self.name,), self.parent, self.child, T_parent_joint, motions, drive)

    def _drive(self, is_driven: bool | None) -> FileDrive:
        """Return limits and drive of a joint with one coordinate; `is_driven` is None if the file does not state it."""
        low, high = self.limits or (-np.inf, np.inf)
        has_low = low > -NO_LIMIT
        has_high = high < NO_LIMIT
        if self.step.kind == "slide" or has_low != has_high:
            low = low if has_low else -np.inf
            high = high if has_high else np.inf
        limits = (low, high)
        return FileDrive(
            limits=limits,
            driven=is_driven,
            effort=_known_bound(self.effort),
            speed=_known_bound(self.speed),
            joint_dynamics=JointDynamics(damping=self.damping, friction=self.friction),
            soft=self.soft,
            control=limits if is_driven else None,
        )


def read_joints(root: ET.Element, links: Collection[str], ledger: Ledger) -> Iterator[UrdfJoint]:
    """Yield the joints of a URDF in file order, without those of unsupported types; report faults of each.

    Raises:
        ReadError: a joint names a link that is not among `links`, or an attribute is not a number.
    """
    for element in root.findall("joint"):
        joint = _joint(element, links, ledger)
        if joint is not None:
            yield joint


def _joint(element: ET.Element, links: Collection[str], ledger: Ledger) -> UrdfJoint | None:
    name = element.get("name", "")
    kind = element.get("type", "")
    ends: list[str] = []
    for tag in ("parent", "child"):
        link = attribute(element.find(tag), "link") or ""
        if link not in links:
            raise ReadError(f"joint '{name}' names link '{link}', which does not exist")
        ends.append(link)
    if kind not in MOTION_KINDS:  # a planar joint, for example, moves along two axes
        ledger.add("urdf.joint", "warning", f"joint '{name}' of type '{kind}' is not supported.", name)
        return None
    T_parent_joint = origin_pose(element.find("origin"))
    axis = numbers(attribute(element.find("axis"), "xyz"), 3, (1, 0, 0))
    length = float(np.linalg.norm(axis))
    if abs(length - 1) > _AXIS_ROUNDING and MOTION_KINDS[kind] not in ("fixed", "free"):
        text = f"the axis of joint '{name}' has length {length:.6g}, not 1."
        ledger.wrong("urdf.axis", text, name, size=Measured(length, 1.0))
    limit = element.find("limit")
    effort = stated_number(limit, "effort")
    speed = stated_number(limit, "velocity")
    limits = None
    if limit is not None and kind in ("revolute", "prismatic"):
        limits = _limits(limit, name, ledger)
    mimic = None
    mimic_element = element.find("mimic")
    if mimic_element is not None:
        multiplier = number(mimic_element, "multiplier", 1.0)
        offset = number(mimic_element, "offset", 0.0)
        mimic = (mimic_element.get("joint", ""), multiplier, offset)
    dynamics = element.find("dynamics")
    return UrdfJoint(
        name=name,
        parent=ends[0],
        child=ends[1],
        step=ChainStep(T_parent_joint, MOTION_KINDS[kind], axis, name),
        limits=limits,
        effort=effort,
        speed=speed,
        mimic=mimic,
        damping=number(dynamics, "damping", 0.0),
        friction=number(dynamics, "friction", 0.0),
        soft=_soft_limits(element.find("safety_controller"), limits, name, ledger),
    )


def _limits(limit: ET.Element, name: str, ledger: Ledger) -> tuple[float, float]:
    """Return (lower, upper) in rad or m of an element <limit> of the joint `name`; report limits that are exchanged."""
    # Readers such as urdfdom take 0 for a limit that is not stated.
    low = float(limit.get("lower", "0"))
    high = float(limit.get("upper", "0"))
    if not low <= high:
        text = f"joint '{name}': lower limit {low:g} is above upper limit {high:g}."
        ledger.wrong("urdf.limits", text, name, suggestion="exchange the limits")
    return low, high


def _soft_limits(
    safety: ET.Element | None, limits: tuple[float, float] | None, name: str, ledger: Ledger
) -> tuple[float, float] | None:
    """Return the soft limits of the joint `name`, cut at its limits; None if it has none, or none within its limits."""
    low = stated_number(safety, "soft_lower_limit")
    high = stated_number(safety, "soft_upper_limit")
    if low is None or high is None:
        return None
    if limits is not None:
        low = max(low, limits[0])
        high = min(high, limits[1])
    if low >= high:
        text = f"joint '{name}': its soft limits and its limits have no range in common."
        ledger.wrong("urdf.limits", text, name, suggestion="write soft limits within the limits")
        return None
    return low, high


def _known_bound(bound: float | None) -> float | None:
    """Return an effort or a speed; None for a number that URDF requires but that means "unknown"."""
    return None if bound is None or bound >= UNKNOWN_BOUND else bound
