"""Read the mechanism data of a track: joints with one coordinate, limits, driven joints, named frames."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from twin.exchange.audit import poses
from twin.exchange.audit.physics import Drive, Frame, Joint, Physics

TOOL = "(tool)"
"""Name of the frame that the protocol moves, if the track does not state its name."""

NO_LIMIT = 1e29
"""Value in m or rad from which a limit means "no limit", because JSON has no infinity."""


def track_physics(data: dict[str, Any], links: Sequence[str], joints: Sequence[str]) -> Physics:
    """Return the mechanism data of a track; missing entries are skipped, because the reader has reported them."""
    out = Physics(tuple(links))
    kinds, active = data.get("joint_types", []), data.get("joint_active", [])
    low, high = data.get("joint_lower", []), data.get("joint_upper", [])
    for i, name in enumerate(joints):
        limits = None
        if i < min(len(low), len(high)):
            limits = (-np.inf if low[i] < -NO_LIMIT else low[i], np.inf if high[i] > NO_LIMIT else high[i])
        drive = Drive(limits, bool(active[i]) if i < len(active) else None)
        kind = str(kinds[i]) if i < len(kinds) else ""
        out.joints.append(Joint((name,), "", "", drive=drive, kind_said=kind))
    local = np.array(data.get("frames_local", []), float)
    names, on = data.get("frame_names", []), data.get("frame_links", [])
    if len(names) == len(on) and local.size == 7 * len(names):
        for name, link, row in zip(names, on, local.reshape(-1, 7), strict=True):
            out.frames[str(name)] = Frame(str(link), poses.from_seven(row))
    tool = np.array(data.get("tool_frame", []), float)
    if tool.shape == (7,):
        out.frames[TOOL] = Frame(str(data.get("tool_link", "")), poses.from_seven(tool))
    return out
