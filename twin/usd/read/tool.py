"""Choose a tool frame for a mechanism without a named tool: the end of its longest chain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from twin.core.errors import MechanismError, unknown
from twin.model.body import Frame
from twin.model.mechanism import Mechanism

_ADDED_TOOL = "tool"
"""Name of an added tool frame."""


def with_tool(mechanism: Mechanism, name: str | None = None) -> tuple[Mechanism, str]:
    """Return (mechanism with a tool frame, text on the choice or "" if the tool is named).

    The tool is the frame or body `name`; else the tool of the file; else the frame "tool"; else the only frame; else a
    frame that is added to the leaf body with the most joints between this body and the base.

    Raises:
        MechanismError: there is no frame or body of that name.
    """
    frames = [frame.name for frame in mechanism.frames]
    if name is not None:
        if name in frames:
            return replace(mechanism, tool=name), ""
        bodies = [body.name for body in mechanism.bodies]
        if name not in bodies:
            raise MechanismError(f"{mechanism.name}: {unknown('frame or body', name, [*frames, *bodies])}")
        return _with_tool_at(mechanism, name), ""
    if mechanism.tool in frames:
        return mechanism, ""
    if _ADDED_TOOL in frames:
        return replace(mechanism, tool=_ADDED_TOOL), ""
    if len(frames) == 1:
        return replace(mechanism, tool=frames[0]), f"the only named frame, '{frames[0]}', is the tool."
    body, length = _end_of_longest_chain(mechanism)
    text = (
        f"the file names no tool: the tool frame is added to body '{body}', the end of the longest chain ({length} "
        "joints)."
    )
    return _with_tool_at(mechanism, body), text


def _with_tool_at(mechanism: Mechanism, body: str) -> Mechanism:
    """Return the mechanism with a tool frame at the origin of a body."""
    used_names = {frame.name for frame in mechanism.frames}
    tool = _ADDED_TOOL
    while tool in used_names:
        tool += "_1"
    frame = Frame(tool, body, np.eye(4))
    return replace(mechanism, tool=tool, frames=(*mechanism.frames, frame))


def _end_of_longest_chain(mechanism: Mechanism) -> tuple[str, int]:
    """Return (last body of the longest chain from the base, number of joints in this chain)."""
    depth = {mechanism.base: 0}
    carrying = {mechanism.base}  # bodies that carry another one
    for joint in mechanism.tree:
        depth[joint.child] = depth[joint.parent] + 1
        carrying.add(joint.parent)
    for joint in mechanism.loops:
        carrying.update((joint.parent, joint.child))
    ends = [body for body in depth if body not in carrying]
    if not ends:  # every chain ends in a loop
        ends = [body for body in depth if body != mechanism.base]
    last = max(ends, key=lambda body: depth[body])  # the first of several longest chains
    return last, depth[last]
