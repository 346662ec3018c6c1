"""What the messages of readers say of the place of a fault: the path at their beginning, and the line."""

from __future__ import annotations

import re

from twin.checking.descriptions import DescriptionFile


def without_path(description: DescriptionFile, message: str) -> str:
    """Return a message without the path of the file at its beginning; of `PATH:12: ...`, "line 12: ..." remains."""
    path = str(description.path)
    if message.startswith(f"{path}: "):
        return message[len(path) + 2 :]
    if re.match(r":\d", message.removeprefix(path)):
        return f"line {message[len(path) + 1 :]}"
    return message


def line_in(message: str) -> int:
    """Return the line that a message names; 0 if it names none."""
    line = re.search(r"\bline (\d+)|\.(?:xacro|urdf|sdf|xml):(\d+)", message)
    if line is None:
        return 0
    return int(line[1] or line[2])
