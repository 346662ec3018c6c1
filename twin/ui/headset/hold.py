"""What a client holds of the robot, and where a drag leads it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from twin.core.errors import unknown
from twin.ui.headset import protocol as wire
from twin.ui.headset.protocol import RefusedError
from twin.ui.session.desk import Desk, Moved


@dataclass(frozen=True)
class Hold:
    """Who holds what: `joint` is its index; `body` and `point` (3,) in its frame are of a link."""

    client: str
    target: str
    joint: int = -1
    body: str = ""
    point: tuple[float, ...] = ()


def hold_of(client: str, message: wire.Grab, desk: Desk) -> Hold:
    """Return what a client takes hold of.

    Raises:
        RefusedError: there is no such joint or link, or it cannot be moved.
    """
    joint, name = -1, message.name or ""
    if message.target == "joint":
        names = [j.name for j in desk.joints]
        if name not in names:
            raise RefusedError("unknown", unknown("active joint", name, names))
        joint = names.index(name)
    elif message.target == "link":
        links = [b.name for b in desk.mechanism.bodies]
        if name not in links:
            raise RefusedError("unknown", unknown("link", name, links))
        if name == desk.mechanism.base:
            raise RefusedError("refused", f"{name} is the base: it stands fast")
    return Hold(client, message.target, joint, name, message.point or ())


def lead(hold: Hold, message: wire.Drag, desk: Desk) -> Callable[[], Moved]:
    """Return the move of the desk that a drag asks for.

    Raises:
        RefusedError: the drag does not fit what is held.
    """
    if hold.target == "tool" and message.pose is not None:
        T = wire.pose_of(message.pose)
        return lambda: desk.move_tool(T)
    if hold.target == "joint" and message.value is not None:
        value = message.value
        return lambda: desk.move_joint(hold.joint, value)
    if hold.target == "link" and message.point is not None:
        p, target = np.array(hold.point), np.array(message.point)
        return lambda: desk.move_point(hold.body, p, target)
    wanted = {"tool": "pose", "joint": "value", "link": "point"}[hold.target]
    raise RefusedError("not_held", f"the {hold.target} is held: drag its {wanted}")
