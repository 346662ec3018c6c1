"""What the phases of a protocol file look up in the rest of this file, and in files beside it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from twin.core.errors import DescriptionError, unknown
from twin.core.foreign.once import Read
from twin.core.foreign.text import read_text
from twin.core.json_types import JsonMapping
from twin.schema import Key, Keys, error_at

WaypointKey = Literal["position_mm", "depth_mm", "joints"]
"""Keys of which each waypoint in the file has one."""


@dataclass(frozen=True)
class ProtocolFile:
    """A protocol file, and the table in it to which errors point: first the whole file, then one phase after another.

    Attributes:
        path: the file, for messages.
        waypoints: {name: table of the waypoint}.
        trocars: names in [trocars_mm].
        home: name of the waypoint of `home` phases.
        folder: folder of the files that phases name.
        reader: returns the bytes of a file.
        table: keys of the table to which errors point, ("phases", index); () for the whole file.
    """

    path: str | Path
    waypoints: JsonMapping
    trocars: tuple[str, ...]
    home: str
    folder: Path
    reader: Read
    table: Keys = ()

    def at_phase(self, index: int) -> ProtocolFile:
        """Return the same file; its errors point to the phase at `index` (from 0)."""
        return replace(self, table=("phases", index))

    def error(self, keys: Key | Keys, message: str) -> DescriptionError:
        """Return an error that points to a key of the table, or to one in the tables within it."""
        if not isinstance(keys, tuple):
            keys = (keys,)
        return error_at(self.path, (*self.table, *keys), message)

    def read_text(self, name: str, kind: str) -> str:
        """Return the text of a file beside the protocol; its size has the limit of this `kind` (core.foreign.budget).

        Raises:
            OSError, UnicodeDecodeError: the file cannot be read.
            BudgetError: the file is too large.
        """
        return read_text(self.folder / name, kind, read=self.reader)

    def require_waypoint(self, name: str, key: Key, purpose: str, *alternatives: WaypointKey) -> None:
        """Check the waypoint that a key names; `purpose` says for the message what needs it.

        Raises:
            DescriptionError: there is no such waypoint, or it has none of the keys in `alternatives`, if there are any.
        """
        if name not in self.waypoints:
            raise self.error(key, unknown("waypoint", name, self.waypoints))
        values = [getattr(self.waypoints[name], alternative) for alternative in alternatives]
        if values and values.count(None) == len(values):
            raise self.error(key, f"waypoint '{name}' has no {' or '.join(alternatives)}, which {purpose} requires")

    def require_distinct_joints(self, joint_keys: Iterable[str], keys: Key | Keys) -> None:
        """Check keys NAME_deg or NAME_mm of a table; errors point to `keys`, the place of this table.

        Raises:
            DescriptionError: two of them name the same joint.
        """
        joints = [joint_key.rsplit("_", 1)[0] for joint_key in joint_keys]
        for joint in joints:
            if joints.count(joint) > 1:
                raise self.error(keys, f"joint '{joint}' is given twice, in deg and in mm")
