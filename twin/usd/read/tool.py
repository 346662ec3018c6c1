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
        bodies = [b.name for b in m.bodies]
        if name not in bodies:
            raise MechanismError(f"{m.name}: {unknown('frame or body', name, [*frames, *bodies])}")
        return _at(m, name), ""
    if m.tool in frames:
        return m, ""
    if _OWN in frames:
        return replace(m, tool=_OWN), ""
    if len(frames) == 1:
        return replace(m, tool=frames[0]), f"the only named frame, '{frames[0]}', is the tool."
    body, length = _last(m)
    text = (
        f"the file names no tool: the tool frame is added to body '{body}', the end of the longest chain ({length} "
        "joints)."
    )
    return _at(m, body), text


def _at(m: Mechanism, body: str) -> Mechanism:
    taken = {f.name for f in m.frames}
    tool = _OWN
    while tool in taken:
        tool += "_1"
    return replace(m, tool=tool, frames=(*m.frames, Frame(tool, body, np.eye(4))))


def _last(m: Mechanism) -> tuple[str, int]:
    """Return (last body of the longest chain from the base, number of joints in this chain)."""
    depth = {m.base: 0}
    carrying = {m.base}
    for joint in m.tree:
        depth[joint.child] = depth[joint.parent] + 1
        carrying.add(joint.parent)
    for joint in m.loops:
        carrying.update((joint.parent, joint.child))
    ends = [body for body in depth if body not in carrying]
    if not ends:  # every chain ends in a loop
        ends = [body for body in depth if body != m.base]
    last = max(ends, key=lambda body: depth[body])  # the first of several longest chains
    return last, depth[last]
