"""URDF in lists of formats."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from twin.core.foreign.budget import BUDGETS
from twin.exchange.format import Format, FormatVariant, Holds, Places
from twin.exchange.xacro import is_part


def robots(files: Sequence[Path]) -> list[Path]:
    """Return the files that are robots: not the .xacro files that others include."""
    if len(files) == 1:  # a file that is audited alone is meant, even if others could include it
        return list(files)
    return [file for file in files if not is_part(file)]


FORMAT = Format(
    name="urdf",
    title="URDF",
    places=Places(export=70, use=70, audit=60, new=10),
    variants=(
        FormatVariant("urdf", ".urdf", "XML", BUDGETS["XML"], trust=40),
        FormatVariant("urdf.xacro", ".xacro", "XML", BUDGETS["XML"], trust=41),
    ),
    outermost=robots,
    holds=Holds.MASSES | Holds.JOINT_TREE | Holds.TRANSMISSIONS,
    code="urdf",
    sources=(".urdf", ".xacro"),
    takes=("closures", "xacro"),
    use="- URDF tools: load <robot>.urdf; it has no loops, which <robot>.yaml states. To play a track, set every joint "
    "to the value in the column of its name; a ball joint has three columns, <ball>_x, <ball>_y and <ball>_z.",
)
