"""Read the closure YAML beside a URDF, and check that its loops close: at its home, and along the motions of tracks.

The audit reads the file by itself, as it shares no code with the importer (`twin.exchange.formats.urdf.read.closures`).
"""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from os.path import commonprefix
from pathlib import Path
from typing import NamedTuple

import numpy as np

from twin.core.foreign.text import read_text
from twin.core.json_types import JsonObject
from twin.exchange.audit import poses
from twin.exchange.audit.file_joints import FileJoint
from twin.exchange.audit.ledger import Ledger, Measured
from twin.exchange.audit.motion_lines import motion_lines
from twin.exchange.audit.poses import Array
from twin.exchange.audit.value_text import quantity

HOME_GAP_LIMIT = 1e-6
"""Maximum gap in m of a closed loop at home."""

TRACK_GAP_LIMIT = 1e-5
"""Maximum gap in m of a closed loop with the joint values of a track, which are rounded."""

_WELD_ANGLE_PER_GAP = 100.0
"""Maximum angle of a closed weld in rad, for each m of the maximum gap."""

_KIND_OF_CLOSURE = {"6d": "fixed", "3d": "spherical"}
"""{type of a closure in the YAML: kind of the joint that closes the loop}."""


class ClosurePair(NamedTuple):
    """Two links that coincide if a loop is closed: wholly (`kind` "fixed"), or only in their origins ("spherical")."""

    first: str
    second: str
    kind: str


@dataclass(frozen=True)
class FileClosures:
    """Content of a closure YAML.

    Attributes:
        pairs: the links that coincide, for each loop.
        driven: names of the driven joints, in the order of the file.
        home: {joint: value in m or rad} at which the loops are closed.
        couplings: {name: ({joint: ratio}, sum)}, as in `Physics`; None if the file states none.
    """

    pairs: tuple[ClosurePair, ...] = ()
    driven: tuple[str, ...] = ()
    home: Mapping[str, float] = field(default_factory=dict)
    couplings: Mapping[str, tuple[Mapping[str, float], float]] | None = None

    def joints(self) -> list[FileJoint]:
        """Return the loop closures as joints between their two links."""
        joints = []
        for pair in self.pairs:
            name = _closure_name(pair.first, pair.second)
            motions = motion_lines(pair.kind, np.eye(4))
            joints.append(FileJoint((name,), pair.first, pair.second, np.eye(4), motions))
        return joints


def read_closures(path: Path, links: Collection[str], joints: Collection[str], ledger: Ledger) -> FileClosures | None:
    """Return the content of a closure YAML; None if it cannot be read. Faults are added to the ledger.

    Only files in which each line is a key with its value in JSON are read, as twin writes them. `links` and `joints`
    are the names in the URDF.
    """
    data: JsonObject = {}
    for line in read_text(path, "YAML").splitlines():
        if not line.strip() or line.startswith("#"):
            continue
        key, _, value = line.partition(":")
        try:
            data[key] = json.loads(value)
        except (ValueError, RecursionError):
            ledger.wrong("urdf.closures", f"{path.name}: the value of '{key[:40]}' is not JSON, so no loop is checked.")
            return None
    pairs = data.get("closed_loop")
    types = data.get("type")
    driven = data.get("name_mot")
    home = data.get("home", {})
    text = f"{path.name}: 'closed_loop', 'type' and 'name_mot' must be lists, one type for each pair; 'home' a table."
    if not isinstance(pairs, list) or not isinstance(types, list) or not isinstance(driven, list):
        ledger.wrong("urdf.closures", text)
        return None
    if not isinstance(home, dict) or len(pairs) != len(types):
        ledger.wrong("urdf.closures", text)
        return None
    checked_pairs = []
    for pair, kind in zip(pairs, types, strict=True):
        if not _are_links(pair, links) or kind not in _KIND_OF_CLOSURE:
            text = (
                f"{path.name}: {str(pair)[:80]} of type {str(kind)[:20]} is not a pair of links with the type 6d or 3d."
            )
            ledger.wrong("urdf.closures", text, str(pair)[:80])
            continue
        checked_pairs.append(ClosurePair(pair[0], pair[1], _KIND_OF_CLOSURE[kind]))
    for name in (*driven, *home):
        if name not in joints:
            text = f"{path.name}: joint '{str(name)[:40]}' is not in the URDF."
            ledger.wrong("urdf.closures", text, str(name)[:40])
    home_values: dict[str, float] = {}
    for name, value in home.items():
        if isinstance(value, int | float) and math.isfinite(value):
            home_values[name] = float(value)
    couplings = None
    if "coupling" in data:
        couplings = _couplings(path, data["coupling"], joints, ledger)
    return FileClosures(tuple(checked_pairs), tuple(map(str, driven)), home_values, couplings)


def _are_links(pair: object, links: Collection[str]) -> bool:
    """Return whether a value is a list of two names of links."""
    if not isinstance(pair, list) or len(pair) != 2:
        return False
    first, second = pair
    if not isinstance(first, str) or not isinstance(second, str):  # other values may not even be hashable
        return False
    return first in links and second in links


def _couplings(
    path: Path, stated: object, joints: Collection[str], ledger: Ledger
) -> dict[str, tuple[dict[str, float], float]]:
    """Return {name: ({joint: ratio}, sum)} of the value of `coupling`; faults are added to the ledger."""
    entries: JsonObject = {
        "coupling": stated
    }  # another value than a table is reported below as an entry without joints
    if isinstance(stated, dict):
        entries = stated
    couplings = {}
    for name, entry in entries.items():
        try:
            ratios: dict[str, float] = {}
            for joint, ratio in zip(entry["joints"], entry["ratios"], strict=True):
                ratios[str(joint)] = float(ratio)
            couplings[name] = ratios, float(entry["sum"])
        except (TypeError, KeyError, ValueError):
            text = f"{path.name}: coupling '{str(name)[:40]}' has no joints with one ratio each, and a sum."
            ledger.wrong("urdf.closures", text, str(name)[:40])
            continue
        unknown = sorted(set(ratios) - set(joints))
        if unknown:
            text = f"{path.name}: joint '{unknown[0][:40]}' of coupling '{name[:40]}' is not in the URDF."
            ledger.wrong("urdf.closures", text, unknown[0][:40])
    return couplings


def check_gap(pair: ClosurePair, T_a: Array, T_b: Array, where: str, limit: float, ledger: Ledger) -> None:
    """Report a loop whose two links, with poses (k, 4, 4), do not coincide within `limit` in m.

    For a weld, the angle between the links must also be small.
    """
    first, second, kind = pair
    name = _closure_name(first, second)
    gap = float(np.linalg.norm(T_a[..., :3, 3] - T_b[..., :3, 3], axis=-1).max())
    angle = 0.0
    if kind == "fixed":
        angle = float(np.max(poses.angle(T_a[..., :3, :3], T_b[..., :3, :3])))
    ledger.row(f"{where}: gap of the loops", gap, "m", limit, where=name)
    if not (gap <= limit and angle <= _WELD_ANGLE_PER_GAP * limit):
        text = (
            f"{where}: the loop that joins '{first}' and '{second}' is open by {quantity(gap, 'm')} and "
            f"{np.degrees(angle):.4g} deg."
        )
        size = Measured(gap * 1e6, limit * 1e6, "um")
        ledger.wrong("urdf.loop", text, name, size=size)


def _closure_name(first: str, second: str) -> str:
    """Return the name of the joint that closes a loop: what the names of its two links have in common."""
    common = commonprefix((first, second))  # noqa: RUF071 - of characters, not of folders
    return common.rstrip("_-") or first
