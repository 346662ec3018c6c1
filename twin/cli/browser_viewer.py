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
from twin.cli import scenes, show
from twin.cli.server_address import PageAddress, free_port
from twin.core import assets
from twin.core.errors import TwinError
from twin.exchange.formats.step.format import FORMAT as STEP

if TYPE_CHECKING:
    import viser

    from twin.model.scene import Scene
    from twin.ui.viewer.face_page import FacePage
    from twin.ui.viewer.front import Front
    from twin.ui.viewer.loop import ViewerPage
    from twin.ui.viewer.server import Content

    PageOpener = Callable[[viser.ViserServer, dict[str, Any]], Front]
    """Function that loads the robots and opens the page; arguments: server, {name: value} of more of `open_page`."""


_PLANNING_STEP = 0.05
"""Time in s between two steps of a page that plans its motions before it is recorded."""

_ROBOT_ADVICE = "every connected client can move and load robots, but cannot write to disk"
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
    title, opener = _checked_opener(args)
    if args.html is not None:
        assets.require_writable_file(Path(args.html))
        return _record(opener, title, port, args)

    def open_robot_page(server: viser.ViserServer, stopping: threading.Event, local: bool) -> Front:
        from twin.cli.terminal import Terminal

        terminal = None
        if local:
            terminal = Terminal.here()
        front = opener(server, {"stopping": stopping, "local": local, "terminal": terminal})
        front.load_soon()
        return front

    return _show_page(args, title, port, open_robot_page)


def _show_scene(args: argparse.Namespace) -> int:
    """Show a scene in the page of `twin serve`, with the defaults of that command for its other options."""
    from twin.cli.headset_server import serve
    from twin.cli.parser import parser

    _refuse_tool(args)
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
    stated_options = []
    for option, value in options.items():
        if value:
            stated_options.append(option)
    if stated_options:
        raise TwinError(f"{path} is a STEP file, whose faces are picked in the page: omit {', '.join(stated_options)}")
    port = free_port(args.host, args.port)
    from twin.ui.session.drawn_faces import StepDrawing

    with show.progress(args.quiet) as progress:
        progress(f"read {path.name}", 0.0)
        drawing = StepDrawing(path)
    title = path.name

    def open_face_page(server: viser.ViserServer, stopping: threading.Event, local: bool) -> FacePage:
        from twin.ui.viewer.face_page import FacePage

        return FacePage(server, f"twin · {title}", drawing, stopping)

    return _show_page(args, title, port, open_face_page, "faces")


def _show_page(
    args: argparse.Namespace,
    title: str,
    port: int,
    opener: Callable[[viser.ViserServer, threading.Event, bool], ViewerPage],
    content: Content = "robot",
) -> int:
    """Show a page of viser until Ctrl-C.

    Args:
        args: `robot` as given, for the command that the page names, and the options `host` and `no_browser`.
        title: name of the shown robot or scene.
        port: the port.
        opener: function that opens the page; its arguments are the server, the event that ends the page, and whether
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
        advice = _ROBOT_ADVICE if content == "robot" else _FACES_ADVICE
        address = PageAddress(args.host, port, False, title, advice)
        rules = AccessRules(args.host, port, False, address.announce)
        command = shlex.join(("twin", "view", str(args.robot)))
        server = serve(f"twin · {title}", args.host, port, rules, command, content)
        if not rules.needs_token:
            address.announce("")
            if not args.no_browser:  # the browser starts while the CAD is read
                threading.Thread(target=webbrowser.open, args=(address.url,), daemon=True).start()
        front = opener(server, stopping, not rules.needs_token)
        front.run()
    finally:
        if before is None:  # the handler before was not set by Python
            before = signal.default_int_handler
        signal.signal(signal.SIGINT, before)
        # a page stops its server; without one, the opener has failed and the server would go on
        if front is not None:
            front.close()
        elif server is not None:
            stop(server)
    print()
    return 0


def _record(opener: PageOpener, title: str, port: int, args: argparse.Namespace) -> int:
    """Open the page on a server that nobody sees, and write its recording to the file of --html."""
    from twin.ui.access.rules import AccessRules
    from twin.ui.viewer.server import serve, stop

    rules = AccessRules(args.host, port, False, lambda token: None)
    server = serve(f"twin · {title}", args.host, port, rules)
    front = None
    try:
        front = opener(server, {})
        return _write_html(front, Path(args.html), args.quiet)
    finally:
        if front is not None:
            front.close()
        else:
            stop(server)


def _refuse_options(args: argparse.Namespace, file: Path | None) -> None:
    """Refuse the options that the page of a robot, or the recording of a scene, does not have.

    `file` is the file of the scene; None: a robot is shown.

    Raises:
        TwinError: such an option is given; the message names it.
    """
    if file is None and args.machine is not None:
        raise TwinError(f"--machine: this page drives no machine of a robot; use `twin serve {args.robot} --machine …`")
    for option, value in (("--task", args.task), ("--fulcrum", args.fulcrum), ("--machine", args.machine)):
        if value is not None:
            raise TwinError(f"{option} is for the live console of a scene; {_way_to_console(args, file)}")
    if args.protocols:
        reason = "a recording always plays the protocols"
        if file is None:
            reason = f"it applies to a scene with a console, and {args.robot} is a robot, which plays its protocol"
        raise TwinError(f"omit --protocols: {reason}")
    if args.watch and (file is not None or args.html is not None):
        raise TwinError("--watch rebuilds a robot in the live page: name a robot, not a scene, and omit --html")
    if file is not None:
        _refuse_tool(args)
        if args.protocol is not None:
            raise TwinError(f"{args.robot} is a scene: its file defines the protocol of each robot; omit the protocol")


def _way_to_console(args: argparse.Namespace, file: Path | None) -> str:
    """Return what to change in the command so that it opens a live console; `file` as in `_refuse_options`."""
    changes: list[str] = []
    if args.html is not None:
        changes.append("omit --html")
    if args.watch:
        changes.append("omit --watch")
    if file is None:
        changes.append("name a scene with a console")
    return " and ".join(changes)


def _refuse_tool(args: argparse.Namespace) -> None:
    """Refuse --tool for a scene.

    Raises:
        TwinError: the option is given.
    """
    if args.tool is not None:
        raise TwinError(f"{args.robot} is a scene: its robots define their tools; omit --tool")


def _checked_opener(args: argparse.Namespace) -> tuple[str, PageOpener]:
    """Return (title, function that loads the robots and opens the page).

    Raises:
        TwinError: a name or option is invalid; raised before a port opens.
    """
    file = assets.scene_file(args.robot)
    _refuse_options(args, file)
    if file is not None:
        from twin.model.scene import load_scene

        scene = load_scene(file)
        scene.require_protocols()
        return scene.name, _scene_page_opener(scene)
    return _robot_page_opener(args)


def _robot_page_opener(args: argparse.Namespace) -> tuple[str, PageOpener]:
    """Return title and function, as `_checked_opener`, of a robot; with --watch, the page follows its files."""
    from twin.ui.session.timeline import protocols_of

    robot = api.load(args.robot, tool=args.tool)
    show.tool_note(robot, args.quiet)
    protocols_of(robot, args.protocol)
    watch = None
    if args.watch:
        from twin.ui.session.file_watch import RobotFileWatch

        watch = RobotFileWatch(robot, str(args.robot), args.tool)

    def of_robot(server: viser.ViserServer, more: dict[str, Any]) -> Front:
        from twin.ui.session.movable_robot import MovableRobot
        from twin.ui.viewer.front import ShownRobot
        from twin.ui.viewer.page import open_page

        actor = ShownRobot(robot.name, str(args.robot), MovableRobot(robot), protocol=args.protocol)
        front = open_page(f"twin · {robot.name}", [actor], None, server, **more)
        if watch is not None:
            front.follow_files(watch)
        return front

    return robot.name, of_robot


def _scene_page_opener(scene: Scene) -> PageOpener:
    """Return the function that opens the page of a scene of which a recording is written."""

    def of_scene(server: viser.ViserServer, more: dict[str, Any]) -> Front:
        from twin.ui.session.movable_robot import MovableRobot
        from twin.ui.viewer.front import ShownRobot
        from twin.ui.viewer.page import open_page

        loaded = scenes.with_organs(scenes.load(scene))
        actors = []
        for place in scene.places:
            movable = MovableRobot(loaded.robots[place.name])
            actors.append(ShownRobot(place.name, place.robot, movable, place.T_world_base, place.protocol))
        return open_page(f"twin · {scene.name}", actors, loaded.props, server, feed=loaded.feed, **more)

    return of_scene


def _write_html(front: Front, path: Path, quiet: bool) -> int:
    """Plan the protocols of all robots of a page, and write what is then played as one HTML file.

    Raises:
        TwinError: a robot has no motion to record, or the file cannot be written.
    """
    from twin.ui.viewer import view_export

    with show.progress(quiet) as progress:
        progress("plan", 0.0)
        for actor in front.robots:
            front.load(actor, actor.protocol)
        while front.planning:
            front.step()
            time.sleep(_PLANNING_STEP)
        robots_without_motion = [actor.name for actor in front.robots if actor.playback is None]
        if robots_without_motion:
            names = ", ".join(robots_without_motion)
            raise TwinError(f"{names}: no recording is possible: {front.panels.why}")
        html = view_export.page(front, lambda part: progress("record", part))
    with assets.atomic_folder(path.parent) as work:
        (work / path.name).write_text(html, encoding="utf-8")
    megabytes = len(html) / 1e6
    print(f"{path}: {megabytes:.1f} MB, {front.clock.duration:.1f} s; any browser plays it")
    return 0
