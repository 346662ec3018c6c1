"""Scenes on the command line: load scenes, and play scenes (`twin run`)."""

from __future__ import annotations

import argparse
import shlex
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from twin import api
from twin.api.facts import scene_commands
from twin.api.scene_parts import anatomy_of, props_of, robots_at
from twin.cli import show
from twin.core import assets
from twin.core.errors import TwinError
from twin.ui.session.loaded_scene import LoadedScene

if TYPE_CHECKING:
    from twin.model.scene import Scene
    from twin.model.task import ConsoleTask
    from twin.model.tissue import Tissue

names = assets.scenes
find = assets.scene_file


def load(scene: Scene) -> LoadedScene:
    """Return a scene with its robots and props; the files of each robot folder are read only once."""
    return LoadedScene(scene, robots_at(scene.places), props_of(scene))


def tissues(scene: Scene) -> tuple[Tissue, ...]:
    """Return the soft organs of a scene; the result is empty if the scene has none."""
    anatomy = anatomy_of(scene)
    if anatomy is None:
        return ()
    from twin.simulation import tissue_scene

    return tissue_scene.tissues(scene, anatomy)


def with_organs(loaded: LoadedScene, task: ConsoleTask | None = None) -> LoadedScene:
    """Return a scene with its soft organs. The World simulates them in a procedure; otherwise, the `feed` does."""
    organs = tissues(loaded.scene)
    if task is not None and not task.kind.console:
        return replace(loaded, organs=organs)
    if not organs:
        return loaded
    from twin.simulation import tissue_scene
    from twin.ui.session.organ_feeds import OrganFeed

    links = {}
    for name, bodies in tissue_scene.touching(loaded.scene).items():
        links[name] = list(map(loaded.robots[name].mechanism.body, bodies))
    return replace(loaded, feed=OrganFeed(organs, links))


def run(file: Path, args: argparse.Namespace) -> int:
    """Plan and play the protocols of all robots of a scene together; write a USD stage, a table and a picture.

    The exit code is 1 if bodies are nearer than the required clearance, or a trocar is not at its port.
    """
    scene = api.load_scene(file)
    if "run" not in scene_commands(scene) and scene.has_protocols:
        word = shlex.quote(args.robot)
        raise TwinError(
            f"scene '{scene.name}' plays protocol files; `twin run` requires protocols with a built stage: use "
            f"`twin view {word}`, `twin serve {word}` or `twin export {word}`"
        )
    root = show.folder(args, scene.name)
    with show.progress(args.quiet or args.json) as progress:
        played = api.play(scene, progress)
    return show.store(played, args, root, [f"usd/{scene.name}/{scene.name}.usda"])
