"""Motions along which other programs read and drive the exports."""

from __future__ import annotations

import os

import twin
from twin.cad import description


def motions() -> list[tuple[str, str]]:
    """Return (robot, protocol): each robot's default protocol, and one at another port; `TWIN_ALL_PROTOCOLS=1`: all.

    A second protocol of a robot moves the same file: it costs a minute and finds nothing that the first does not.
    """
    every = [(r, p) for r in twin.names() for p in twin.load(r).files.protocols()]
    if os.environ.get("TWIN_ALL_PROTOCOLS"):
        return every
    default = {r: str(description.load(twin.load(r).files.description).default_protocol) for r in twin.names()}
    return [(r, p) for r, p in every if p == default[r] or (r, p) == ("lapbot", "other_port")]
