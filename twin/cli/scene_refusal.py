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
    if name not in assets.scenes() and name.casefold() in assets.scenes() and not Path(name).exists():
        raise TwinError(unknown("robot or scene", name, [*assets.names(), *assets.scenes()]))
    if args.command in SCENE_COMMANDS or (file := assets.scene_file(name)) is None:
        return
    scene = load_scene(file)
    if args.command in scene_commands(scene):
        return
    robots = sorted({p.robot for p in scene.places})
    raise TwinError(
        f"'{name}' is a scene, not a robot. Commands for scenes: "
        f"{', '.join(f'twin {c} {name}' for c in scene_commands(scene))}; "
        f"`twin {args.command}` accepts one of its robots: {', '.join(robots)}."
    )
