"""`twin view`: show a robot or scene in a browser, where it can be moved."""

from __future__ import annotations

import argparse
import shlex
import signal
import threading
import time
import webbrowser
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin import api
from twin.cli import scene as scenes
from twin.cli import show
from twin.cli.address import PageAddress, free_port
from twin.core import assets
from twin.core.errors import TwinError
from twin.exchange.formats.step.format import FORMAT as STEP

if TYPE_CHECKING:
    import viser

    from twin.ui.viewer.face_page import FacePage
    from twin.ui.viewer.front import Front
    from twin.ui.viewer.loop import ViewerPage
    from twin.ui.viewer.server import Content


_ADVICE = "every connected client can move and load robots, but cannot write to disk"
_FACES_ADVICE = "every connected client sees the STEP file and can pick faces, but cannot write to disk"


def view(args: argparse.Namespace) -> int:
    """Show a robot, a scene or a stage until Ctrl-C; with --html write a recording and exit.

    A robot has the page of viser, in which it is taken apart; a scene has the page of `twin serve`. A STEP file has a
    page of viser in which faces are picked.
    """
    if Path(args.robot).suffix.lower() in STEP.sources:
        return _show_faces(args)
    if args.html is None and not args.watch and assets.scene_file(args.robot) is not None:
        return _show_scene(args)
    port = args.port
    if args.html is not None:
        port = 0  # a recording needs no certain port
    port = free_port(args.host, port)
    title, load = _what(args)
    if args.html is not None:
        assets.require_writable_file(Path(args.html))
        return _write(load, title, port, args)

    def open_page(server: viser.ViserServer, stopping: threading.Event, local: bool) -> Front:
        from twin.cli.terminal import Terminal

        terminal = None
        if local:
            terminal = Terminal.here()
        front = load(server, {"stopping": stopping, "local": local, "terminal": terminal})
        front.load_soon()
        return front

    return _show_page(args, title, port, open_page)


def _show_scene(args: argparse.Namespace) -> int:
    """Show a scene in the page of `twin serve`, with the defaults of that command for its other options."""
    from twin.cli.parser import parser
    from twin.cli.serving import serve

    if args.tool is not None:
        raise TwinError(f"{args.robot} is a scene: its robots define their tools; omit --tool")
    defaults = parser().parse_args(["serve", args.robot])
    return serve(argparse.Namespace(**(vars(defaults) | vars(args))))


def _show_faces(args: argparse.Namespace) -> int:
    """Show a STEP file until Ctrl-C; faces are picked in its page."""
    path = Path(args.robot)
    options = {
        "the protocol": args.protocol,
        "--html": args.html,
        "--watch": args.watch,
        "--tool": args.tool,
        "--task": args.task,
        "--fulcrum": args.fulcrum,
        "--protocols": args.protocols,
        "--machine": args.machine,
    }
    given = [option for option, value in options.items() if value]
    if given:
        raise TwinError(f"{path} is a STEP file, whose faces are picked in the page: omit {', '.join(given)}")
    port = free_port(args.host, args.port)
    from twin.ui.session.drawn_faces import StepDrawing

    with show.progress(args.quiet) as progress:
        progress(f"read {path.name}", 0.0)
        drawing = StepDrawing(path)
    title = path.name

    def open_page(server: viser.ViserServer, stopping: threading.Event, local: bool) -> FacePage:
        from twin.ui.viewer.face_page import FacePage

        return FacePage(server, f"twin · {title}", drawing, stopping)

    return _show_page(args, title, port, open_page, "faces")


def _show_page(
    args: argparse.Namespace,
    title: str,
    port: int,
    open_page: Callable[[viser.ViserServer, threading.Event, bool], ViewerPage],
    content: Content = "robot",
) -> int:
    """Show a page of viser until Ctrl-C.

    Args:
        args: options `host` and `no_browser`.
        title: name of the shown robot or scene.
        port: the port.
        open_page: function that opens the page; its arguments are the server, the event that ends the page, and whether
            only this computer can connect.
        content: what the page shows.
    """
    from twin.ui.access.rules import AccessRules
    from twin.ui.viewer.server import serve, stop

    front = None
    server = None
    stopping = threading.Event()

    def end(*_: object) -> None:
        """End the loop without an exception; a second Ctrl-C raises KeyboardInterrupt."""
        stopping.set()
        signal.signal(signal.SIGINT, signal.default_int_handler)

    before = signal.signal(signal.SIGINT, end)
    try:
        advice = _ADVICE if content == "robot" else _FACES_ADVICE
        address = PageAddress(args.host, port, False, title, advice)
        rules = AccessRules(args.host, port, False, address.say)
        command = shlex.join(("twin", "view", str(args.robot)))
        server = serve(f"twin · {title}", args.host, port, rules, command, content)
        if not rules.needs_token:
            address.say("")
            if not args.no_browser:  # the browser starts while the CAD is read
                threading.Thread(target=webbrowser.open, args=(address.url,), daemon=True).start()
        front = open_page(server, stopping, not rules.needs_token)
        front.run()
    finally:
        if before is None:  # the handler before was not set by Python
            before = signal.default_int_handler
        signal.signal(signal.SIGINT, before)
        if front is not None:
            front.close()
        elif server is not None:
            stop(server)
    print()
    return 0


def _write(
    load: Callable[[viser.ViserServer, dict[str, Any]], Front], title: str, port: int, args: argparse.Namespace
) -> int:
    from twin.ui.access.rules import AccessRules
    from twin.ui.viewer.server import serve, stop

    rules = AccessRules(args.host, port, False, lambda token: None)
    server = serve(f"twin · {title}", args.host, port, rules)
    front = None
    try:
        front = load(server, {})
        return _page(front, Path(args.html), args.quiet)
    finally:
        if front is not None:
            front.close()
        else:
            stop(server)


def _what(args: argparse.Namespace) -> tuple[str, Callable[[viser.ViserServer, dict[str, Any]], Front]]:
    """Return (title, function that loads the robots and opens the page).

    The arguments of the function are a server and {name: value} of further arguments of `Front`.

    Raises:
        TwinError: a name or option is invalid; raised before a port opens.
    """
    if args.machine is not None and assets.scene_file(args.robot) is None:
        raise TwinError(f"--machine: this page drives no machine of a robot; use `twin serve {args.robot} --machine …`")
    for option, value in (("--task", args.task), ("--fulcrum", args.fulcrum), ("--machine", args.machine)):
        if value is not None:
            raise TwinError(f"{option} is for the live console of a scene; omit --html and name a scene with a console")
    file = assets.scene_file(args.robot)
    if args.protocols:
        reason = "a recording always plays the protocols"
        if file is None:
            reason = f"it applies to a scene with a console, and {args.robot} is a robot, which plays its protocol"
        raise TwinError(f"omit --protocols: {reason}")
    if args.watch and (file is not None or args.html is not None):
        raise TwinError("--watch rebuilds a robot in the live page: name a robot, not a scene, and omit --html")
    if file is not None:
        return _scene(args, file)
    from twin.ui.session.timeline import protocols_of

    robot = api.load(args.robot, tool=args.tool)
    show.tool_note(robot, args.quiet)
    protocols_of(robot, args.protocol)
    watch = None
    if args.watch:
        from twin.ui.session.file_watch import RobotFileWatch

        watch = RobotFileWatch(robot, str(args.robot), args.tool)

    def of_robot(server: viser.ViserServer, more: dict[str, Any]) -> Front:
        from twin.ui.session.desk import Desk
        from twin.ui.viewer.front import ShownRobot
        from twin.ui.viewer.page import open_page

        actor = ShownRobot(robot.name, str(args.robot), Desk(robot), protocol=args.protocol)
        front = open_page(f"twin · {robot.name}", [actor], None, server, **more)
        if watch is not None:
            front.follow_files(watch)
        return front

    return robot.name, of_robot


def _scene(args: argparse.Namespace, file: Path) -> tuple[str, Callable[[viser.ViserServer, dict[str, Any]], Front]]:
    """Return title and function, as `_what`, of a scene of which a recording is written."""
    from twin.model.scene import load_scene

    if args.tool is not None:
        raise TwinError(f"{args.robot} is a scene: its robots define their tools; omit --tool")
    if args.protocol is not None:
        raise TwinError(f"{args.robot} is a scene: its file defines the protocol of each robot; omit the protocol")
    scene = load_scene(file)
    scene.require_protocols()

    def of_scene(server: viser.ViserServer, more: dict[str, Any]) -> Front:
        from twin.ui.session.desk import Desk
        from twin.ui.viewer.front import ShownRobot
        from twin.ui.viewer.page import open_page

        loaded = scenes.with_organs(scenes.load(scene))
        actors = []
        for place in scene.places:
            desk = Desk(loaded.robots[place.name])
            actors.append(ShownRobot(place.name, place.robot, desk, place.T_world_base, place.protocol))
        return open_page(f"twin · {scene.name}", actors, loaded.props, server, feed=loaded.feed, **more)

    return scene.name, of_scene


def _page(front: Front, path: Path, quiet: bool) -> int:
    from twin.ui.viewer import view_export

    with show.progress(quiet) as progress:
        progress("plan", 0.0)
        for actor in front.actors:
            front.load(actor, actor.protocol)
        while front.planning:
            front.step()
            time.sleep(0.05)
        failed = [actor.name for actor in front.actors if actor.playback is None]
        if failed:
            names = ", ".join(failed)
            raise TwinError(f"{names}: no recording is possible: {front.panels.why}")
        html = view_export.page(front, lambda part: progress("record", part))
    with assets.atomic_folder(path.parent) as work:
        (work / path.name).write_text(html, encoding="utf-8")
    megabytes = len(html) / 1e6
    print(f"{path}: {megabytes:.1f} MB, {front.clock.duration:.1f} s; any browser plays it")
    return 0
