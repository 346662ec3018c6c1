"""Tools that an instrument can carry: grasper, clip applier, scissors, scalpel, cautery."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

from pydantic import Field, model_validator

from twin.core.provenance import Parameter
from twin.schema import Identifier, Sourced, at

Kind = Literal["grasper", "clip_applier", "scissors", "scalpel", "cautery"]

_NEEDS: dict[str, tuple[str, ...]] = {
    "grasper": ("open_mm", "pinch_n", "friction"),
    "clip_applier": ("open_mm", "clips"),
    "scissors": ("open_mm",),
    "scalpel": ("open_mm",),
    "cautery": ("power_w",),
}
"""{kind of a tool: the keys that it needs}; it takes none of the other optional ones."""

TOOL_TEXTS: dict[Kind, str] = {
    "grasper": "holds tissue and pulls it aside",
    "clip_applier": "closes a duct or a vessel with a clip",
    "scissors": "cuts tissue between its two blades",
    "scalpel": "cuts along the path of its blade",
    "cautery": "separates tissue by heat and stops bleeding",
}
"""What a tool of each kind does, as text for pages."""


class ToolTable(Sourced):
    """A tool, and the robots of the scene that can carry it.

    The signal `<robot>.tool` of a console is the index of the chosen tool, from 0, in the order of the scene file.

    The jaws, clip legs or blades of a tool are `jaw_mm` long, parallel to the shaft, and end at the tip of the
    instrument. `open_mm` is the gap between the open jaws, or the width of a scalpel's cut. A grasper pinches with the
    force `pinch_n`; grasped tissue slips if it pulls with more than 2 * `friction` * `pinch_n`. Cautery heats the
    tissue within `jaw_mm` of the tip with the power `power_w`.
    """

    title: str = Field(min_length=1)
    kind: Kind
    robots: list[Identifier] = Field(min_length=1)
    jaw_mm: float = Field(gt=0, le=50)
    open_mm: float | None = Field(None, gt=0, le=50)
    pinch_n: float | None = Field(None, gt=0, le=100)
    friction: float | None = Field(None, gt=0, le=2)
    clips: int | None = Field(None, ge=1, le=12)
    power_w: float | None = Field(None, gt=0, le=200)

    @model_validator(mode="after")
    def _whole(self) -> ToolTable:
        needs = _NEEDS[self.kind]
        for key in ("open_mm", "pinch_n", "friction", "clips", "power_w"):
            has_key = getattr(self, key) is not None
            if key in needs and not has_key:
                raise at("kind", f"a {self.kind} needs `{key}`")
            # A number without an effect would let its author believe that the simulation uses it.
            if has_key and key not in needs:
                raise at(key, f"a {self.kind} takes no `{key}`")
        return self

    @property
    def slips_at(self) -> float:
        """Force in N at which grasped tissue slips: friction at both jaws."""
        return 2.0 * (self.friction or 0.0) * (self.pinch_n or 0.0)


def listed(name: str, tool: ToolTable) -> Iterator[Parameter]:
    """Yield the numbers of a tool as parameters with provenance."""
    rows = (
        ("jaw", tool.jaw_mm, "mm"),
        ("open", tool.open_mm, "mm"),
        ("pinch", tool.pinch_n, "N"),
        ("friction", tool.friction, "1"),
        ("clips", tool.clips, "1"),
        ("power", tool.power_w, "W"),
    )
    return tool.parameters(f"tool {name}", rows)
