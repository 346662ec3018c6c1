"""URDF in lists of formats."""

from __future__ import annotations

from twin.core.foreign.budget import BUDGETS
from twin.exchange.format import Format, FormatVariant, Holds, Places

FORMAT = Format(
    name="urdf",
    title="URDF",
    places=Places(export=70, use=70, audit=60, new=10),
    variants=(FormatVariant("urdf", ".urdf", "XML", BUDGETS["XML"], trust=40),),
    holds=Holds.MASSES | Holds.JOINT_TREE | Holds.TRANSMISSIONS,
    code="urdf",
    sources=(".urdf",),
    takes=("closures",),
    use="- URDF tools: load <robot>.urdf; it has no loops, which <robot>.yaml states. To play a track, set every joint "
    "to the value in the column of its name; a ball joint has three columns, <ball>_x, <ball>_y and <ball>_z.",
)
