"""Reject scenes for commands on robots."""

from __future__ import annotations

import argparse
from pathlib import Path

from twin.api.facts import SCENE_COMMANDS, scene_commands
from twin.core import assets
from twin.core.errors import TwinError, unknown


def refuse(args: argparse.Namespace) -> None:
    """Check that no scene is given to a command that accepts only a robot.

    Raises:
        TwinError: a scene is given; the message lists the commands for scenes, and the scene's robots.
    """
    from twin.model.scene import load_scene

    name = getattr(args, "robot", None)
    if not isinstance(name, str):
        return
    # a scene in capitals: the error of a robot that does not exist would name only robots
    if name not in assets.scenes() and name.casefold() in assets.scenes() and not Path(name).exists():
        raise TwinError(unknown("robot or scene", name, [*assets.names(), *assets.scenes()]))
    # these commands handle scenes by themselves, also with errors of their own
    if args.command in SCENE_COMMANDS:
        return
    file = assets.scene_file(name)
    if file is None:
        return
    scene = load_scene(file)
    allowed_commands = scene_commands(scene)
    if args.command in allowed_commands:
        return
    robots = {place.robot for place in scene.places}
    command_lines = [f"twin {command} {name}" for command in allowed_commands]
    raise TwinError(
        f"'{name}' is a scene, not a robot. Commands for scenes: {', '.join(command_lines)}; "
        f"`twin {args.command}` accepts one of its robots: {', '.join(sorted(robots))}."
    )
