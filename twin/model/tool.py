"""Tools of the instruments of a scene: which of them a hand holds is chosen in the window of tools."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from twin.schema import Origin, Table

ToolKind = Literal["grasper", "scissors", "clip", "scalpel", "cautery"]

DOES: dict[ToolKind, str] = {
    "grasper": "holds tissue and pulls it aside",
    "scissors": "cuts tissue between its two blades",
    "clip": "closes a duct or a vessel with a clip",
    "scalpel": "cuts along the path of its blade",
    "cautery": "separates tissue by heat and stops bleeding",
}
"""What the tools of each kind do."""


class ToolTable(Table):
    """A tool that an instrument can hold; the signal `<robot>.tool` is its number in the order of the scene file."""

    title: str = Field(min_length=1)
    kind: ToolKind
    provenance: Origin
    note: str = Field(min_length=1)
