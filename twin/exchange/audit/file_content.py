"""Common result of the readers: clips of link poses in the world frame, and the conventions of the file.

Poses are T_world_link (k, 4, 4): metres, z up, right-handed, without scale.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from twin.core.json_types import JsonObject
from twin.exchange.audit.colors import Rgba
from twin.exchange.audit.ledger import Ledger
from twin.exchange.audit.mechanism_data import FileMechanism
from twin.exchange.audit.new_names import renamed, with_new_keys
from twin.exchange.audit.poses import Array
from twin.exchange.format import Holds
from twin.exchange.formats import is_leading_kind, kind_holds

SHEET_VOLUME = 1e-7
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
        return SHEET_VOLUME * self.area * self.diagonal


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
