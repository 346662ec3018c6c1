"""Scenes on the command line: read their parts, refuse them for commands on robots, and play them (`twin run`)."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin import api
from twin.api.about import scene_commands
from twin.api.act import anatomy_of, props_of, robots_at
from twin.cli import show
from twin.core import assets
from twin.core.errors import TwinError, unknown

if TYPE_CHECKING:
    from twin.model.mechanism import Mechanism
    from twin.model.scene import Scene
    from twin.model.task import Task
    from twin.model.tissue import Tissue
    from twin.ui.session.organs import OrganFeed

names, find = assets.scenes, assets.scene_file


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
    if args.command in api.SCENE_COMMANDS or (file := assets.scene_file(name)) is None:
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


def content(scene: Scene) -> tuple[dict[str, api.Robot], Mechanism | None]:
    """Return (robots by name in the scene, props or None) of a scene; each robot folder is read once."""
    return robots_at(scene.places), props_of(scene)


def tissues(scene: Scene) -> tuple[Tissue, ...]:
    """Return the soft organs of a scene; the result is empty if the scene has none."""
    if (drawn := anatomy_of(scene)) is None:
        return ()
    from twin.simulation import tissue_scene

    return tissue_scene.tissues(scene, drawn)


def organs(scene: Scene, robots: Mapping[str, api.Robot]) -> OrganFeed | None:
    """Return the soft organs of a scene for a page whose World does not simulate them; None: there are no organs."""
    if not (found := tissues(scene)):
        return None
    from twin.simulation import tissue_scene
    from twin.ui.session.organs import OrganFeed

    links = {
        name: [robots[name].mechanism.body(b) for b in bodies] for name, bodies in tissue_scene.touching(scene).items()
    }
    return OrganFeed(found, links)


def bending(scene: Scene, robots: Mapping[str, api.Robot], task: Task | None) -> dict[str, Any]:
    """Return the arguments of a page with a console: the World simulates `organs` in a procedure, else `feed` does."""
    if task is not None and task.procedure is not None:
        return {"feed": None, "organs": tissues(scene)}
    return {"feed": organs(scene, robots), "organs": ()}


def run(file: Path, args: argparse.Namespace) -> int:
    """Plan and play the protocols of all robots together; write stage, table and picture.

    The exit code is 1 if bodies are nearer than the required clearance, or a trocar is not at its port.
    """
    scene = api.load_scene(file)
    root = show.folder(args, scene.name)
    with show.progress(args.quiet or args.json) as progress:
        played = api.play(scene, progress)
    return show.store(played, args, root, [f"usd/{scene.name}/{scene.name}.usda"])
