"""Common result of the readers: clips of link poses in the world frame, and the conventions of the file.

Poses are T_world_link (k, 4, 4): metres, z up, right-handed, without scale.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from twin.core.json_types import JsonObject
from twin.exchange.audit.colors import Rgba
from twin.exchange.audit.mechanism_data import FileMechanism
from twin.exchange.audit.new_names import renamed, with_new_keys
from twin.exchange.audit.poses import Array, angle
from twin.exchange.audit.report import Ledger, Measured
from twin.exchange.format import Holds
from twin.exchange.formats import is_leading_kind, kind_holds

UNIT_TOL = 1e-4
"""Maximum difference between a quaternion's length and 1 that counts as a rounding error of single precision."""

MAX_STEP = np.radians(120)
"""Maximum rotation in rad between two keys. Players use the shorter rotation; for larger angles, it may be wrong."""

START_TOL = 1e-9
"""Maximum time in s of a clip's first key. If a clip starts later, players first show the rest pose."""

RATE_TOL = 1e-3
"""Largest relative difference between an interval of keys and 1 / rate that counts as rounding."""

FAR = 50.0
"""Distance in m between a link and the origin above which the unit of length is probably wrong."""


FLAT = 1e-7
"""Volume per surface area and diagonal of the bounding box below which a closed mesh is a sheet with two sides."""


@dataclass(frozen=True)
class LinkShape:
    """Shape of all meshes of one link, in the frame of the link.

    Attributes:
        low, high: corners (3,) of the bounding box in m.
        volume: signed volume in m3; valid only if all meshes are closed.
        closed: whether all meshes are closed, or close each other: formats divide a link into meshes differently.
        nearly_closed: the same, if points that rounding may have separated are merged.
        points: vertices (n, 3) of the triangles in m.
        triangles: (m, 3) indices of points.
        area: surface area in m2.
    """

    low: Array
    high: Array
    volume: float
    closed: bool
    nearly_closed: bool
    points: Array
    triangles: Array
    area: float

    @property
    def diagonal(self) -> float:
        """Diagonal of the bounding box in m."""
        return float(np.linalg.norm(self.high - self.low))

    @property
    def rounding(self) -> float:
        """Magnitude in m3 below which the volume is a rounding error, as that of a sheet with two sides."""
        return FLAT * self.area * self.diagonal


@dataclass(frozen=True)
class FileClip:
    """A motion of a robot, as a file states it.

    Attributes:
        times: times (k,) of the keys in s.
        links: {link: T_world_link (k, 4, 4)}.
        joints: {joint: values (k,) in rad or m}, for the joints whose values are known.
        middle: {link: T_world_link (k - 1, 4, 4) halfway between keys}; empty if the format has no interpolation.
    """

    name: str
    times: Array
    links: Mapping[str, Array]
    joints: Mapping[str, Array] = field(default_factory=dict)
    middle: Mapping[str, Array] = field(default_factory=dict)

    def renamed(self, links: Mapping[str, str], joints: Mapping[str, str]) -> FileClip:
        """Return the motion after renaming links and joints by {old: new}."""
        middle = with_new_keys(self.middle, links)
        return replace(
            self, links=with_new_keys(self.links, links), joints=with_new_keys(self.joints, joints), middle=middle
        )

    @property
    def duration(self) -> float:
        """Time of the last key in s."""
        if not len(self.times):
            return 0.0
        return float(self.times[-1])


@dataclass
class Content:
    """The content of a file.

    Attributes:
        ledger: findings of the reader.
        format: "glb", "usd", "usdz", "tracks", "csv", "mjcf", "urdf".
        clips: motions, in the order of the file.
        rest: {link: T_world_link (4, 4) at rest}.
        declared: names of the nodes that the file marks as links (USD: rigid bodies, glTF: extras); None: the file
            marks no links.
        shapes: {link: shape of its meshes}.
        colors: {link: {colour (linear rgba): fraction of the link's area}}.
        finishes: the same for (metallic, roughness, 0, 1); empty if the format has none.
        mechanism: masses, joints and frames in the file; None: the file has no such data.
        model_hash: hash of the source mechanism, as stated in the file; "" if not stated.
        stated: what the file states about itself, such as "robot" or "rate of clip 'a'"; other files must state the
            same.
        facts: conventions of the file, for the report: units, up_axis, handedness, ...
        known: names of the links that at least one file in the folder marks; None if no file marks links.
        extra: other data of the file, each needed by a single check, such as limits or phases.
    """

    ledger: Ledger
    format: str
    clips: list[FileClip] = field(default_factory=list)
    rest: dict[str, Array] = field(default_factory=dict)
    declared: tuple[str, ...] | None = None
    shapes: dict[str, LinkShape] = field(default_factory=dict)
    colors: dict[str, dict[Rgba, float]] = field(default_factory=dict)
    finishes: dict[str, dict[Rgba, float]] = field(default_factory=dict)
    mechanism: FileMechanism | None = None
    model_hash: str = ""
    stated: JsonObject = field(default_factory=dict)
    facts: JsonObject = field(default_factory=dict)
    extra: JsonObject = field(default_factory=dict)
    known: frozenset[str] | None = None

    def rename(self, links: Mapping[str, str], joints: Mapping[str, str]) -> None:
        """Rename links and joints by {old: new}; other names stay, as does what the file states as text."""
        for number, clip in enumerate(self.clips):
            self.clips[number] = clip.renamed(links, joints)
        self.rest = with_new_keys(self.rest, links)
        if self.declared is not None:
            self.declared = renamed(self.declared, links)
        self.shapes = with_new_keys(self.shapes, links)
        self.colors = with_new_keys(self.colors, links)
        self.finishes = with_new_keys(self.finishes, links)
        if self.mechanism is not None:
            self.mechanism.rename(links, joints)

    @property
    def file(self) -> str:
        """Name of the file, as shown in reports."""
        return self.ledger.file

    @property
    def is_track(self) -> bool:
        """Whether the file is a track: one motion, with the values of the joints and the header that states it."""
        return kind_holds(self.format, Holds.COORDINATES) and is_leading_kind(self.format)

    @property
    def repeats_track(self) -> bool:
        """Whether the file repeats the data of a track, as a CSV track does."""
        return kind_holds(self.format, Holds.COORDINATES) and not is_leading_kind(self.format)

    def as_facts(self) -> JsonObject:
        """Return format and conventions of the file as plain data for the report."""
        clips = []
        for clip in self.clips:
            clips.append({"name": clip.name, "keys": len(clip.times), "duration_s": clip.duration})
        link_count: int | None = None
        if self.links is not None:
            link_count = len(self.links)
        return {
            "file": self.file,
            "format": self.format,
            **self.facts,
            "clips": clips,
            "links": link_count,
            "nodes": len(self.rest),
        }

    @property
    def links(self) -> tuple[str, ...] | None:
        """Names of the links that the file marks.

        If the file marks no links, these are the names of its nodes that other files mark as links. If no file marks
        links, the value is None.
        """
        if self.declared is not None:
            return self.declared
        if self.known is None:
            return None
        return tuple(name for name in self.rest if name in self.known)


def check_times(ledger: Ledger, times: Array, clip: str, code: str) -> bool:
    """Report faults of key times (k,) in s; return whether the times can be used."""
    if not len(times):
        ledger.wrong(f"{code}.times", f"clip '{clip}' has no keys.", clip)
        return False
    if not np.all(np.isfinite(times)):
        ledger.wrong(f"{code}.finite", f"clip '{clip}': a key time is not a finite number.", clip)
        return False
    steps = np.diff(times)
    if len(steps) and np.min(steps) <= 0:
        key = int(np.argmin(steps))
        text = (
            f"clip '{clip}': key {key + 1} at {times[key + 1]:.6g} s does not come after key {key} at "
            f"{times[key]:.6g} s."
        )
        ledger.wrong(
            f"{code}.times",
            text,
            clip,
            size=Measured(steps[key], 0.0, "s"),
            when=f"key {key + 1}",
            suggestion="times must increase strictly",
        )
        return False
    if abs(times[0]) > START_TOL:
        text = f"clip '{clip}' starts at {times[0]:.6g} s, not at 0: players wait until this time, or begin there."
        ledger.add(f"{code}.start", "warning", text, clip, size=Measured(times[0], 0.0, "s"))
    return True


def check_rate(ledger: Ledger, times: Array, stated: float, clip: str) -> None:
    """Compare a stated key rate in Hz with key times (k,) in s. Only the last interval may be shorter than 1 / rate."""
    steps = np.diff(times)
    if not len(steps):
        return
    if not (np.isfinite(stated) and stated > 0):
        ledger.wrong("tracks.rate", f"clip '{clip}': rate {stated:g} Hz must be above 0.", clip)
        return
    inner = steps
    # The last key is at the end of the motion, which need not be a multiple of the interval.
    if len(steps) > 1:
        inner = steps[:-1]
    off_rate = np.abs(inner * stated - 1)
    key = int(np.argmax(off_rate))
    worst = float(off_rate[key])
    if len(steps) > 1 and steps[-1] * stated > 1 + RATE_TOL:
        key = len(steps) - 1
        worst = float(steps[-1] * stated - 1)
    if worst > RATE_TOL:
        text = (
            f"clip '{clip}': the stated rate is {stated:g} Hz, but keys {key} and {key + 1} are {steps[key]:.6g} s "
            f"apart ({1 / steps[key]:.6g} Hz)."
        )
        ledger.wrong(
            "tracks.rate",
            text,
            clip,
            size=Measured(1 / steps[key], stated, "Hz"),
            when=f"t = {times[key]:.4g} s",
            suggestion="state the actual rate of the keys",
        )
    ledger.row("stated rate against key times", worst, "1", RATE_TOL, where=clip)


def check_quaternions(
    ledger: Ledger,
    xyzw: Array,
    times: Array | Sequence[float],
    where: str,
    code: str,
    blended: bool = True,
    shorter: bool = False,
) -> None:
    """Report faults of the quaternions (k, 4) of a link: a length that is not 1, sign changes, large rotations.

    Sign changes and rotations by more than `MAX_STEP` between two keys are faults only if players interpolate the
    quaternions (`blended` is True). A sign change is a warning if the format requires the `shorter` rotation, as glTF.
    """
    if not np.all(np.isfinite(xyzw)):
        text = f"{where}: a quaternion is not finite."
        ledger.wrong(f"{code}.finite", text, where)
        return
    size = np.linalg.norm(xyzw, axis=1)
    key = int(np.argmax(np.abs(size - 1)))
    if abs(size[key] - 1) > UNIT_TOL:
        text = (
            f"{where}: a quaternion has length {size[key]:.6g}, not 1: players normalise it, scale the node, or fail."
        )
        ledger.wrong(f"{code}.quaternion", text, where, size=Measured(size[key], 1.0), when=f"t = {times[key]:.4g} s")
        return
    if not blended:
        return
    dots = np.sum(xyzw[1:] * xyzw[:-1], axis=1)
    flips = np.flatnonzero(dots < 0).tolist()
    if flips:
        key = flips[0]
        text = (
            f"{where}: the quaternion changes sign {len(flips)} times, first between {times[key]:.4g} and "
            f"{times[key + 1]:.4g} s"
        )
        severity = "disagreement"
        if shorter:
            severity = "warning"
            text += (
                ": the file is valid and its motion is right, because glTF 2.0 (appendix C.4) requires that players "
                "take the shorter rotation, at which the sign does no harm. Players that interpolate components, as "
                "old versions of glTFast do, rotate the link by up to 180 deg."
            )
        else:
            text += ": players that interpolate components (Unity) rotate the link by up to 180 deg."
        count = Measured(float(len(flips)), 0.0)
        ledger.add(f"{code}.quaternion_sign", severity, text, where, size=count, when=f"t = {times[key]:.4g} s")
    # q and -q are one rotation: the size of the product alone gives its angle
    # The clip is for rounding, which lifts the cosine between equal rotations above 1.
    turn = 2 * np.arccos(np.clip(np.abs(dots) / (size[1:] * size[:-1]), 0, 1))
    if len(turn) and np.max(turn) > MAX_STEP:
        key = int(np.argmax(turn))
        text = (
            f"{where} rotates by {np.degrees(turn[key]):.4g} deg between {times[key]:.4g} and {times[key + 1]:.4g} s; "
            "above 180 deg, players rotate backwards."
        )
        ledger.wrong(
            f"{code}.step",
            text,
            where,
            size=Measured(float(np.degrees(turn[key])), float(np.degrees(MAX_STEP)), "deg"),
            when=f"t = {times[key]:.4g} s",
        )


def check_poses(ledger: Ledger, clip: FileClip, code: str) -> None:
    """Report poses that are not finite, and links so far from the origin that lengths are probably in mm."""
    for name, T in clip.links.items():
        if not np.all(np.isfinite(T)):
            ledger.wrong(f"{code}.finite", f"clip '{clip.name}': the pose of link '{name}' is not finite.", name)
            continue
        distances = np.linalg.norm(T[:, :3, 3], axis=1)
        if len(distances) and np.max(distances) > FAR:
            farthest = float(np.max(distances))
            time = clip.times[int(np.argmax(distances))]
            text = (
                f"clip '{clip.name}': link '{name}' is {farthest:.4g} m from the origin: the numbers look like "
                "millimetres, but the file is in metres."
            )
            ledger.add(
                f"{code}.size",
                "warning",
                text,
                name,
                size=Measured(farthest, FAR, "m"),
                when=f"t = {time:.4g} s",
                suggestion="check the unit",
            )


class Deviation(NamedTuple):
    """Maximum differences between two motions of a link.

    Attributes:
        distance: maximum distance in m.
        distance_key: key of this distance.
        angle: maximum angle in rad.
        angle_key: key of this angle.
    """

    distance: float
    distance_key: int
    angle: float
    angle_key: int


def largest(poses: Array, others: Array) -> Deviation:
    """Return the maximum differences between two motions of a link, which are given as poses (k, 4, 4)."""
    distances = np.linalg.norm(poses[:, :3, 3] - others[:, :3, 3], axis=1)
    angles = angle(poses[:, :3, :3], others[:, :3, :3])
    i = int(np.argmax(distances))
    j = int(np.argmax(angles))
    return Deviation(float(distances[i]), i, float(angles[j]), j)


def check_names(content: Content) -> None:
    """Report unusable names of links and joints: empty, with line breaks, or with spaces at the start or end."""
    joints = []
    if content.mechanism is not None:
        for joint in content.mechanism.joints:
            joints += joint.names
    _check_names_of(content, "link", content.declared or ())
    _check_names_of(content, "joint", joints)


def _check_names_of(content: Content, kind: str, names: Sequence[str]) -> None:
    for name in dict.fromkeys(names):
        if name and name == name.strip() and name.isprintable():
            continue
        trouble = "has a line break, a control character, or a space at its start or end"
        if not name.strip():
            trouble = "is empty"
        text = f"the name {name!r} of a {kind} {trouble}."
        content.ledger.wrong(f"{content.format}.name", text, repr(name))
