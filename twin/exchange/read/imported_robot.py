"""The common result of all readers, and how they make it: names as identifiers, findings, limits, a tool frame."""

from __future__ import annotations

import math
from collections.abc import Collection, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from twin.core import spatial
from twin.core.errors import MechanismError, NoMechanismError, SourceError
from twin.core.findings import Finding, finding
from twin.core.identifiers import identifier, unique
from twin.core.spatial import Array
from twin.exchange.xacro import XacroSettings
from twin.model.body import Body, Frame
from twin.model.inertia import Inertia
from twin.model.joint import Joint
from twin.model.mechanism import EARTH, Coupling, Mechanism
from twin.usd.read.tool import with_tool

Key = TypeVar("Key", bound=Hashable)

IS_MISSING = "is missing"
"""What a finding "import.mesh" of an MJCF says of a lost file, before ":" or ";": `twin check` looks for this."""

ITS_MESH_IS_MISSING = "because its mesh is missing"
"""What a finding "import.inertia" says of a body whose mass such a mesh would give; as above."""


class Findings(list[Finding]):
    """Findings of an import, in the order in which they were added."""

    def note(self, code: str, message: str, where: str) -> None:
        """Add a finding of severity info: data were changed or omitted, but the mechanism is not affected."""
        self.append(note(code, message, where))

    def warn(self, code: str, message: str, where: str) -> None:
        """Add a finding of severity warning: the mechanism lacks data of the file, or data had to be assumed."""
        self.append(warning(code, message, where))


@dataclass(frozen=True)
class DhOptions:
    """What the user states about a table of Denavit-Hartenberg parameters; None: as its headings or keys state it.

    Attributes:
        convention: "standard", "modified", "khalil" or "hayati".
        length: unit of lengths, "mm", "cm" or "m".
        angle: unit of angles, "deg" or "rad".
    """

    convention: str | None = None
    length: str | None = None
    angle: str | None = None


def dh_options(convention: str | None, units: str | None) -> DhOptions:
    """Return the options `--dh` and `--units LENGTH,ANGLE` of a table of Denavit-Hartenberg parameters.

    Raises:
        SourceError: there is no such unit.
    """
    length: str | None = None
    angle: str | None = None
    for unit in (units or "").replace(" ", "").split(","):
        if unit in ("mm", "cm", "m"):
            length = unit
        elif unit in ("deg", "rad"):
            angle = unit
        elif unit:
            raise SourceError(f"--units {units}: there is no unit '{unit}'; use mm, cm or m, and deg or rad")
    return DhOptions(convention, length, angle)


@dataclass(frozen=True)
class Options:
    """Options of a reader; each format uses those that apply to it.

    Attributes:
        closures: path of the closure YAML of a URDF; None: the YAML file of the same name, if it exists.
        root: selects one of several robots in the file; None: the only robot.
        guarded: first parse the file in a separate process.
        xacro: how a xacro is expanded.
        dh: convention and units of a table of Denavit-Hartenberg parameters.
    """

    closures: Path | None = None
    root: str | None = None
    guarded: bool = True
    xacro: XacroSettings = field(default_factory=XacroSettings)
    dh: DhOptions = field(default_factory=DhOptions)


@dataclass
class Imported:
    """A mechanism in SI units, with findings on renamed, guessed, missing and omitted data.

    Attributes:
        mechanism: bodies, joints and loops.
        findings: findings on renamed, guessed, missing and omitted data.
        efforts: maximum effort in N or N m of each joint for which the file states an effort, but no gains.
        assumed: joints and actuators whose drives are ASSUMED.
        formula: equations that the file states, as the text of a formula.py; "" if it states none.
        places: {"joint/NAME/origin", ...: (file, line)}: where a xacro states the elements of joints and links.
        posed: whether the file states rest poses; a URDF does not.
        keys: {key frame: {joint: value in m or rad}} for the active and passive joints of the tree.
        unlimited: joints of which the file states that they have no limits; not those for which it states nothing.
    """

    mechanism: Mechanism
    findings: list[Finding] = field(default_factory=list)
    efforts: dict[str, float] = field(default_factory=dict)
    assumed: frozenset[str] = frozenset()
    posed: bool = True
    keys: dict[str, dict[str, float]] = field(default_factory=dict)
    formula: str = ""
    places: dict[str, tuple[str, int]] = field(default_factory=dict)
    unlimited: frozenset[str] = frozenset()


class Names:
    """Identifiers for all names of one kind (such as joints) in a file. A finding reports each changed name.

    No name gets one of the identifiers `reserved`.
    """

    def __init__(self, kind: str, names: Iterable[str], findings: Findings, reserved: Iterable[str] = ()) -> None:
        names = list(names)
        self._known = unique(zip(names, names, strict=True), reserved)
        for old, new in self._known.items():
            if old != new:
                findings.note("renamed", f"{kind} '{old}' is renamed to '{new}'.", old)

    def __getitem__(self, name: str) -> str:
        return self._known[name]

    def __contains__(self, name: str) -> bool:
        return name in self._known

    def values(self) -> Iterable[str]:
        """Return the identifiers."""
        return self._known.values()

    def known(self) -> Iterable[str]:
        """Return the names in the file."""
        return self._known


def unique_identifiers(
    kind: str, names_in_file: Iterable[tuple[Key, str]], used_names: Collection[str], findings: Findings
) -> dict[Key, str]:
    """Return for each key a unique identifier that is not in use; add a finding for each changed name.

    `names_in_file` contains (key, name in the file) of each object, `used_names` the identifiers already in use. `kind`
    is the noun for the objects in the findings, such as "joint".
    """
    identifiers: dict[Key, str] = {}
    for key, name in names_in_file:
        plain_name = identifier(name)
        free = plain_name
        # With its kind, as "arm_joint", which tells readers more than a number.
        if free in used_names:
            free = f"{plain_name}_{kind}"
        number = 1
        while free in used_names or free in identifiers.values():
            number += 1
            free = f"{plain_name}_{number}"
        if free != name:
            findings.note("renamed", f"{kind} '{name}' is renamed to '{free}'.", name)
        identifiers[key] = free
    return identifiers


def note(code: str, message: str, where: str) -> Finding:
    """Return a finding of severity info, as `Findings.note` adds it."""
    return finding("info", f"import.{code}", where, message)


def warning(code: str, message: str, where: str) -> Finding:
    """Return a finding of severity warning, as `Findings.warn` adds it."""
    return finding("warning", f"import.{code}", where, message)


def rpy(angles: Array) -> Array:
    """Return R = Rz(yaw) Ry(pitch) Rx(roll), (3, 3), for angles (roll, pitch, yaw) in rad."""
    ex, ey, ez = np.eye(3)
    # The order of URDF and SDF: roll, pitch and yaw about the fixed axes x, y, z, one after the other.
    return spatial.exp_so3(angles[2] * ez) @ spatial.exp_so3(angles[1] * ey) @ spatial.exp_so3(angles[0] * ex)


def pose_along(axis: Array) -> Array:
    """Return a pose (4, 4) at the origin whose z axis has the direction of the nonzero vector `axis` (3,).

    If `axis` has the direction of z, the pose is the identity.
    """
    z = axis / np.abs(axis).max()  # scaled first, because squares of huge or tiny numbers overflow or underflow
    z = z / np.linalg.norm(z)
    if np.array_equal(z, [0.0, 0.0, 1.0]):
        return np.eye(4)
    R = spatial.frame_from_axes(z, spatial.unit_across(z))
    return spatial.pose(R)


def possible_inertia(inertia: Inertia, link: str, findings: Findings) -> Inertia | None:
    """Return the inertia; if it is physically impossible, add a warning and return None."""
    if np.all(np.isfinite(inertia.I_com)):
        violations = inertia.violations()
    else:
        violations = ["the inertia has numbers that are not finite"]
    if not violations:
        return inertia
    reasons = "; ".join(violations)
    findings.warn("inertia", f"link '{link}': {reasons}: mass and inertia of the link are left out.", link)
    return None


def stated_gravity(gravity: Array, findings: Findings) -> tuple[float, float, float]:
    """Return a gravitational acceleration (3,) in m/s2, world z up; a note states one that is not the earth's."""
    x, y, z = (gravity + 0.0).tolist()  # turns -0.0 into 0.0
    if (x, y, z) != EARTH:
        text = f"gravity is ({x:g}, {y:g}, {z:g}) m/s2."
        if (x, y) != (0.0, 0.0) or z > 0.0:
            text += " It does not point down, along -z of the world."
        findings.note("gravity", text, "gravity")
    return x, y, z


def limits(
    path: Path, lower: float | None, upper: float | None, joint: str, findings: Findings
) -> tuple[float, float] | None:
    """Return (lower, upper) limits in m or rad; None if the joint has no limits.

    Raises:
        SourceError: the lower limit is not below the upper limit.
    """
    if lower is None and upper is None:
        return None
    low = -math.inf if lower is None else lower
    high = math.inf if upper is None else upper
    if low == high == 0.0:  # a template that was not filled in: a joint that cannot move would be fixed
        findings.warn("limits", f"joint '{joint}': limits 0 .. 0 are read as missing: the joint is unlimited.", joint)
        return None
    if low >= high:
        raise SourceError(f"{path}: joint '{joint}': the lower limit {low:g} is not below the upper limit {high:g}")
    if low == -math.inf and high == math.inf:
        return None
    return low, high


def assemble(
    path: Path,
    name: str,
    base: str,
    bodies: Sequence[Body],
    joints: Sequence[Joint],
    frames: Sequence[Frame],
    couplings: Sequence[Coupling],
    findings: Findings,
    efforts: dict[str, float] | None = None,
    start: Mapping[str, float] | None = None,
) -> Imported:
    """Return the mechanism that consists of the given parts and a tool.

    The rest pose has the joint values of `start`, {joint: value in m or rad}; the other values are zero.

    The tool is the frame named `tool`. If no frame has this name, the tool is the only frame, else a new frame at the
    end of the longest chain; in both cases, a finding states the choice.

    Raises:
        SourceError: the parts do not form a mechanism.
    """
    if not joints:
        raise NoMechanismError(f"{path}: the file has no joints, so there is no mechanism")
    try:
        # First without rest poses, which are computed along the tree of the mechanism.
        bare = Mechanism(identifier(name), base, tuple(bodies), tuple(joints), tuple(frames), source=path.name)
        mechanism = replace(bare, rest=rest_poses(bare, start), couplings=tuple(couplings))
        mechanism = with_tool_frame(mechanism, findings)
    except MechanismError as error:
        raise SourceError(f"{path}: {error}") from error
    return Imported(mechanism, findings, efforts or {})


def rest_poses(mechanism: Mechanism, values: Mapping[str, float] | None = None) -> dict[str, Array]:
    """Return {body: T_base_body (4, 4)} at the given values {joint of the tree: value in m or rad}; others are zero."""
    rest = {mechanism.base: np.eye(4)}
    for joint in mechanism.tree:
        q = (values or {}).get(joint.name, 0.0)
        T_joint_child = spatial.inverse(joint.T_child_joint)
        rest[joint.child] = rest[joint.parent] @ joint.T_parent_joint @ motion(joint, q) @ T_joint_child
    return rest


def motion(joint: Joint, q: float) -> Array:
    """Return the pose (4, 4) of the joint's frame on the child in that on the parent, at q in rad or m."""
    if joint.is_angle:
        return spatial.pose(spatial.rotation_z(q))
    return spatial.pose(p=[0, 0, q])


def with_tool_frame(mechanism: Mechanism, findings: Findings) -> Mechanism:
    """Return the mechanism with a tool frame. If a frame had to be added, a warning is added to `findings`."""
    with_frame, text = with_tool(mechanism)
    if with_frame.frames != mechanism.frames:
        findings.warn(
            "tool", f"{text} Edit [frame.tool] to move this frame to the tool.", with_frame.frame(with_frame.tool).body
        )
    elif text:
        findings.note("tool", text, with_frame.tool)
    return with_frame
