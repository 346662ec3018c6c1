"""Motions whose exports other programs read and drive in tests."""

from __future__ import annotations

import os

import twin
from twin.cad import description


def motions() -> list[tuple[str, str]]:
    """Return (robot, protocol) for each robot's default protocol, and for one protocol with another port.

    If the environment variable TWIN_ALL_PROTOCOLS is set, as at night, return all protocols. A second protocol of a
    robot moves the same exported model: it takes a minute and tests nothing new.
    """
    every = [(r, p) for r in twin.names() for p in twin.load(r).files.protocols()]
    if os.environ.get("TWIN_ALL_PROTOCOLS"):
        return every
    default = {r: str(description.load(twin.load(r).files.description).default_protocol) for r in twin.names()}
    return [(r, p) for r, p in every if p == default[r] or (r, p) == ("lapbot", "other_port")]
