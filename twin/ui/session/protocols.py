"""The protocols of a robot from which a user chooses."""

from __future__ import annotations

from pathlib import Path

from twin.api import Robot
from twin.core.errors import TwinError


def protocols_of(robot: Robot, given: str | None) -> dict[str, str]:
    """Return the argument of `Robot.protocol` for each protocol of the robot and for `given`, by protocol name.

    Args:
        robot: the robot.
        given: name, FOLDER/NAME or path of a further protocol; None: no further protocol.

    Raises:
        TwinError: the given protocol does not exist, is invalid, or has the name of another protocol of the robot.
    """
    files = {} if robot.files is None else robot.files.protocols()
    own = {name: name for name in files}
    if given is None:
        return own
    name = robot.protocol(given).name
    if name in own and given != name and Path(given).resolve() != files[name].resolve():
        raise TwinError(f"{given}: the robot already has a protocol named '{name}': rename the protocol in this file")
    return {**own, name: given}
