"""Convert grabs and drags of a client to moves of a robot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from twin.core.errors import unknown
from twin.ui.headset import stream_frames as wire
from twin.ui.headset.client_messages import DragMessage, GrabMessage, RefusedError
from twin.ui.session.movable_robot import MovableRobot, MoveResult


@dataclass(frozen=True)
class ClientHold:
    """The part of a robot that a client has grabbed.

    Attributes:
        client: identifier of the client.
        target: "tool", "joint" or "link".
        joint: index of the grabbed joint in the active joints; -1 if the target is not a joint.
        body: name of the grabbed link or joint, as in the message; "" for the tool.
        point: grabbed point (3,) in m in the frame of the link; () if the target is not a link.
    """

    client: str
    target: str
    joint: int = -1
    body: str = ""
    point: tuple[float, ...] = ()


def hold_of(client: str, message: GrabMessage, movable: MovableRobot) -> ClientHold:
    """Return the `ClientHold` that a client's message requests.

    Raises:
        RefusedError: the joint or link does not exist, or cannot be moved.
    """
    joint = -1
    name = message.name or ""
    if message.target == "joint":
        names = [active.name for active in movable.joints]
        if name not in names:
            raise RefusedError("unknown", unknown("active joint", name, names))
        joint = names.index(name)
    elif message.target == "link":
        links = [body.name for body in movable.mechanism.bodies]
        if name not in links:
            raise RefusedError("unknown", unknown("link", name, links))
        if name == movable.mechanism.base:
            raise RefusedError("refused", f"{name} is the base and cannot move")
    # of a joint and of the tool, the message has no point
    return ClientHold(client, message.target, joint, name, message.point or ())


def move_of(hold: ClientHold, message: DragMessage, movable: MovableRobot) -> Callable[[], MoveResult]:
    """Return a function that moves the robot to the target of a drag message.

    Raises:
        RefusedError: the drag does not match the grab.
    """
    if hold.target == "tool" and message.pose is not None:
        T = wire.pose_of(message.pose)
        return lambda: movable.drag_tool(T)
    if hold.target == "joint" and message.value is not None:
        value = message.value
        return lambda: movable.move_joint(hold.joint, value)
    if hold.target == "link" and message.point is not None:
        p_body = np.array(hold.point)
        target = np.array(message.point)
        return lambda: movable.move_point(hold.body, p_body, target)
    fields = {"tool": "pose", "joint": "value", "link": "point"}
    raise RefusedError("not_held", f"the {hold.target} is grabbed; a drag of it must contain `{fields[hold.target]}`")
