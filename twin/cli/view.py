"""`twin view`: the interactive twin in a browser."""

from __future__ import annotations

import argparse
import socket
import sys
import webbrowser
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from twin import api, assets
from twin.cli import scene as scenes
from twin.errors import TwinError

if TYPE_CHECKING:
    from twin.mechanism import Mechanism
    from twin.viewer.front import Actor


def view(args: argparse.Namespace) -> int:
    """Show a robot, a scene or a stage until Ctrl-C; with --html write a recording and end."""
    port = free_port(args.host, args.port)
    title, actors, props = _actors(args)
    from twin.viewer.front import Front

    front = Front(f"twin · {title}", actors, props, args.host, port)
    try:
        if args.html is not None:
            return _page(front, Path(args.html), args.quiet)
        url = f"http://{'127.0.0.1' if args.host in ('0.0.0.0', '') else args.host}:{port}"
        print(f"{title}: {url}   (Ctrl-C ends it)", flush=True)
        if args.host not in ("127.0.0.1", "localhost"):
            print(f"  open to the network on {args.host}: whoever reaches it can move what is shown", flush=True)
        if not args.no_browser:
            webbrowser.open(url)
        for a in actors:
            if a.desk.robot.files is not None and (a.protocol or a.desk.robot.files.protocols()):
                front.ask(f"load {a.name}", _loader(front, a))
        front.run()
    except KeyboardInterrupt:
        print()
    finally:
        front.close()
    return 0


def free_port(host: str, port: int) -> int:
    """Return the port if it is free; 0 takes any.

    Raises:
        TwinError: something listens there, or the host is not this machine's; with what would do.
    """
    with socket.socket() as s:
        s.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            s.bind((host, port))
        except OSError as error:
            if error.errno in (98, 48, 10048):  # in use, on Linux, macOS, Windows
                with socket.socket() as other:
                    other.bind((host, 0))
                    free = other.getsockname()[1]
                raise TwinError(
                    f"port {port} is taken, perhaps by another twin view: end that, or use --port {free}, which is free"
                ) from error
            raise TwinError(f"cannot listen on {host}:{port}: {error.strerror or error}") from error
        return int(s.getsockname()[1])


def _loader(front, a: Actor) -> Callable[[], None]:
    return lambda: front.load(a, a.protocol)


def _actors(args: argparse.Namespace) -> tuple[str, list[Actor], Mechanism | None]:
    from twin.viewer.desk import Desk
    from twin.viewer.front import Actor

    file = scenes.find(args.robot)
    if file is None:
        robot = api.load(args.robot)
        if args.protocol is not None:
            robot.protocol(args.protocol)  # a wrong name is told before anything is shown
        return robot.name, [Actor(robot.name, str(args.robot), Desk(robot), protocol=args.protocol)], None
    from twin.cad.build import read_mechanism
    from twin.scene.load import load_scene

    if args.protocol is not None:
        raise TwinError(f"{args.robot} is a scene: its file says what each robot plays; leave --protocol out")
    scene = load_scene(file)
    actors = []
    for place in scene.places:
        robot = api.load(place.name)
        actors.append(Actor(place.name, place.name, Desk(robot), place.T_world_base, place.protocol))
    props = None if scene.props is None else read_mechanism(scene.props, with_mass=False).mechanism
    return scene.name, actors, props


def _page(front, path: Path, quiet: bool) -> int:
    import time

    from twin.cli import show
    from twin.viewer import recording

    assets.require_writable(path.parent)
    with show.progress(quiet) as progress:
        progress("plan", 0.0)
        for a in front.actors:
            front.load(a, a.protocol)
        while front.planning:
            front.step()
            time.sleep(0.05)
        failed = [a.name for a in front.actors if a.playback is None]
        if failed:
            raise TwinError(f"{', '.join(failed)}: nothing to record: {front.panels.why}")
        html = recording.page(front, lambda part: progress("record", part))
    with assets.atomic_folder(path.parent) as work:
        (work / path.name).write_text(html, encoding="utf-8")
    print(f"{path}: {len(html) / 1e6:.1f} MB, {front.clock.duration:.1f} s; any browser plays it", file=sys.stdout)
    return 0
