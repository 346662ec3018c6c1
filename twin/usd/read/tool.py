"""Choose a tool frame for a mechanism without a named tool: the end of its longest chain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from twin.core.errors import MechanismError, unknown
from twin.model.body import Frame
from twin.model.mechanism import Mechanism

_OWN = "tool"
"""Name of an added tool frame."""


def with_tool(m: Mechanism, name: str | None = None) -> tuple[Mechanism, str]:
    """Return (mechanism with a tool frame, text on the choice or "" if the tool is named).

    The tool is the frame or body `name`; else the tool of the file; else the frame "tool"; else the only frame; else a
    frame that is added to the leaf body with the most joints between this body and the base.

    Raises:
        MechanismError: there is no frame or body of that name.
    """
    frames = [f.name for f in m.frames]
    if name is not None:
        if name in frames:
            return replace(m, tool=name), ""
        if name not in {b.name for b in m.bodies}:
            raise MechanismError(f"{m.name}: {unknown('frame or body', name, [*frames, *(b.name for b in m.bodies)])}")
        return _at(m, name), ""
    if m.tool in frames:
        return m, ""
    if _OWN in frames:
        return replace(m, tool=_OWN), ""
    if len(frames) == 1:
        return replace(m, tool=frames[0]), f"the only named frame, '{frames[0]}', is the tool."
    body, length = _last(m)
    return (
        _at(m, body),
        f"the file names no tool: the tool frame is added to body '{body}', the end of the longest chain ({length} "
        "joints).",
    )


def _at(m: Mechanism, body: str) -> Mechanism:
    made = _OWN
    while made in {f.name for f in m.frames}:
        made += "_1"
    return replace(m, tool=made, frames=(*m.frames, Frame(made, body, np.eye(4))))


def _last(m: Mechanism) -> tuple[str, int]:
    """Return (last body of the longest chain from the base, number of joints in this chain)."""
    depth = {m.base: 0}
    for joint in m.tree:
        depth[joint.child] = depth[joint.parent] + 1
    carrying = {j.parent for j in m.tree} | {b for j in m.loops for b in (j.parent, j.child)} | {m.base}
    ends = [b for b in depth if b not in carrying] or [b for b in depth if b != m.base]
    body = max(ends, key=lambda b: depth[b])  # the first of several longest chains
    return body, depth[body]
