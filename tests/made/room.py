"""Serve a robot or a scene with a hanging cloth, like `twin serve`: python -m made.room.

The cloth is a deformable object for tests of the page.
"""

from __future__ import annotations

import argparse
import asyncio
from dataclasses import replace
from pathlib import Path

import numpy as np

import twin
import twin.ui.headset
from made.cloth import Cloth
from twin.cli import scenes
from twin.model.scene import load_scene
from twin.ui.access.rules import AccessRules
from twin.ui.headset import served_content, server_files
from twin.ui.headset.server import StreamServer
from twin.ui.session.movable_robot import MovableRobot
from twin.ui.viewer.front import ShownRobot
from twin.ui.viewer.page import open_page
from twin.ui.viewer.server import serve as viser_server

CLOTH = {"corner": (-0.9, -0.9, 1.7), "edge": 0.7}
"""Corner and edge length of the cloth in m: beside the robots of a scene, and large enough to be visible."""


def room(robot, cloth):
    """Return the data that a server needs for a robot or a scene with a cloth; call this in an event loop."""
    file = scenes.find(robot)
    if file is None:
        return served_content.of_robot(twin.load(robot), robot, None, True, cloth)
    return served_content.of_scene(replace(scenes.load(load_scene(file)), feed=cloth))


def viewed(robot, cloth, port):
    """Return the viewer's front with a scene and a cloth; `run` of the result starts it."""
    loaded = scenes.load(load_scene(scenes.find(robot)))
    scene, movables = loaded.scene, {n: MovableRobot(r) for n, r in loaded.robots.items()}
    actors = [ShownRobot(p.name, p.name, movables[p.name], p.T_world_base, p.protocol) for p in scene.places]
    return open_page(scene.name, actors, loaded.props, viser_server(scene.name, "127.0.0.1", port), feed=cloth)


async def serve(robot, port, cloth):
    """Serve until the process ends."""
    shown = room(robot, cloth)
    own = server_files.page_files(Path(twin.ui.headset.__file__).parent / "web/dist", shown.preload) | shown.files
    server = StreamServer(shown.live, shown.hello, own, AccessRules("127.0.0.1", port, False, lambda token: None))
    await server.start("127.0.0.1", port)
    await server.run()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robot")
    parser.add_argument("--port", type=int, default=8765)
    parser.add_argument("--corner", type=float, nargs=3, default=CLOTH["corner"])
    parser.add_argument("--edge", type=float, default=CLOTH["edge"])
    parser.add_argument("--viewer", action="store_true")
    args = parser.parse_args()
    bends = Cloth(np.array(args.corner), args.edge)
    if args.viewer:
        front = viewed(args.robot, bends, args.port)
        front.load_soon()
        front.run()
    else:
        asyncio.run(serve(args.robot, args.port, bends))
