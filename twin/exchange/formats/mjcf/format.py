"""MJCF in lists of formats."""

from __future__ import annotations

from pathlib import Path

from twin.core.foreign.budget import BUDGETS, MJCF_SUFFIXES
from twin.exchange.format import Format, FormatVariant, Holds, Places

_HEAD = 4096
"""Number of bytes at the start of a file in which the root element is searched."""


def is_mjcf(file: Path) -> bool:
    """Return whether the start of an XML file contains the root element of MJCF."""
    try:
        with file.open("rb") as xml:
            return b"<mujoco" in xml.read(_HEAD)
    except OSError:
        return False


FORMAT = Format(
    name="mjcf",
    title="MJCF",
    places=Places(export=60, use=60, audit=50, new=20),
    variants=(FormatVariant("mjcf", ".xml", "MJCF", BUDGETS["MJCF"], trust=20),),
    recognise=is_mjcf,
    holds=Holds.MASSES | Holds.JOINT_TREE | Holds.UNNAMED_FIXED_JOINTS,
    code="mjcf",
    sources=MJCF_SUFFIXES,
    takes=("root",),
    use="- MuJoCo 3.13 or newer: load <robot>.xml and step, 1 ms at a time. It starts at home with closed loops, which "
    "equality constraints hold; a control is the displacement of a drive from home (ctrl = coordinate - ref), so that "
    "zero holds the robot at home. Newton (add_mjcf) and Drake keep its loops closed as well; Drake leaves out its "
    "actuators and tendons.",
)
