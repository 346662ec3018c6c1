"""`twin serve`: show a robot or a scene in a headset, or in a browser with WebGL."""

from __future__ import annotations

import argparse
import asyncio
import signal
import ssl
import sys
import threading
import webbrowser
from collections import ChainMap
from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

from twin import api
from twin.cli import guided_study, machines, scenes
from twin.cli.server_address import PageAddress, free_port, ros_port_and_url
from twin.core import assets
from twin.core.errors import TwinError

if TYPE_CHECKING:
    from twin.model.scene import Scene
    from twin.ui.access.rules import AccessRules
    from twin.ui.headset.console_stream import ConsoleStream
    from twin.ui.headset.ros.bridge import RosBridge
    from twin.ui.headset.served_content import ServedContent
    from twin.ui.session.loaded_scene import LoadedScene
    from twin.ui.session.task_choice import TaskChoice

Access = tuple[PageAddress, "AccessRules"]
"""Address of a page, and the rules that decide which clients receive it."""

_ADVICE = "a headset allows AR only over https (--cert and --key) or by a USB cable; see twin serve --help"


def serve(args: argparse.Namespace) -> int:
    """Serve a robot or a scene until Ctrl-C."""
    port = free_port(args.host, args.port)
    context = _tls(args.cert, args.key)
    _require_compatible(args)
    for file in (args.record, args.session):
        if file is not None:
            assets.require_writable_file(Path(file))
    if args.guided is not None:
        guided_study.guide(args, _part_server(args, port, context))
        return 0
    name, make, choice = _what(args)
    if choice is None:
        asyncio.run(serve_until_stopped(args, name, make, port, context))
        return 0
    _serve_tasks(args, name, make, choice, port, context)
    return 0


def _serve_tasks(
    args: argparse.Namespace,
    name: str,
    make: Callable[[], ServedContent],
    choice: TaskChoice,
    port: int,
    context: ssl.SSLContext | None,
) -> None:
    """Serve the tasks of a scene that pages start, one after the other, at one address and with one set of rules."""

    def make_chosen() -> ServedContent:
        try:
            return make()
        except TwinError as error:
            if not choice.refuse(str(error)):
                raise
            print(f"twin: {error}", file=sys.stderr)
            return make()

    access = _access(args, name, port, context)
    while True:
        ended = asyncio.run(serve_until_stopped(args, name, make_chosen, port, context, choice.begin, access))
        if ended or not choice.asked:
            return
        args.no_browser = True  # the open page reloads itself
        task = choice.task
        print("  a page has asked for: " + ("no task" if task is None else task.title), flush=True)


def _access(args: argparse.Namespace, name: str, port: int, context: ssl.SSLContext | None) -> Access:
    """Return the address of a page, and access rules that print it for each new token."""
    from twin.ui.access.rules import AccessRules

    is_https = context is not None
    address = PageAddress(args.host, port, is_https, name, "" if is_https else _ADVICE)
    return address, AccessRules(args.host, port, is_https, address.announce)


def _part_server(args: argparse.Namespace, port: int, context: ssl.SSLContext | None) -> guided_study.ServePart:
    """Return the function that serves a part of a guided run at a port.

    All parts have the same access rules: a client that one part has admitted keeps its session in the next one.
    """
    accesses: list[Access] = []

    def serve_part(name: str, make: Callable[[], ServedContent], examiner: guided_study.Examiner) -> None:
        if not accesses:  # the first part
            accesses.append(_access(args, name, port, context))
        if asyncio.run(serve_until_stopped(args, name, make, port, context, examiner.begin, accesses[0])):
            examiner.continued = False  # Ctrl-C came after Enter, while this part was ending
        args.no_browser = True  # the page of the first part reloads itself

    return serve_part


def _what(args: argparse.Namespace) -> tuple[str, Callable[[], ServedContent], TaskChoice | None]:
    """Return (title, function to create the served object in the event loop, tasks that a page can start).

    Raises:
        TwinError: an argument is wrong.
    """
    from twin.ui.headset import served_content
    from twin.ui.session.timeline import protocols_of

    plans = args.replay is None
    file = scenes.find(args.robot)
    if file is None:
        text = f"{_OPTION_NAME} requires a scene with a console, such as davinci; {args.robot} is a robot"
        _refuse(args, [option for option in _CONSOLE_OPTIONS if option != "machine"], text)
        if args.protocols:
            raise TwinError(f"--protocols applies to a scene with a console; {args.robot} is a robot: omit --protocols")
        robot = api.load(args.robot)
        protocols_of(robot, args.protocol)
        machine = machines.driven(robot, args.machine)
        return (
            robot.name,
            lambda: served_content.of_robot(robot, str(args.robot), args.protocol, plans, machine=machine),
            None,
        )
    if args.protocol is not None:
        raise TwinError(f"{args.robot} is a scene: its file defines the protocol of each robot; omit the protocol")
    from twin.model.scene import load_scene

    scene = load_scene(file)
    loaded = scenes.load(scene)
    if scene.console is not None and not args.protocols:
        choice = _choice(args, scene)
        return scene.name, _at_console(args, loaded, choice), choice
    scene.require_protocols()
    if args.protocols:
        text = f"{_OPTION_NAME} and --protocols cannot be combined: robots that play protocols have no console"
        _refuse(args, _CONSOLE_OPTIONS, text)
    text = (
        f"{_OPTION_NAME} requires a console, which scene '{scene.name}' lacks: add a section [console] to {file.name}"
    )
    _refuse(args, _CONSOLE_OPTIONS, text)
    return scene.name, lambda: served_content.of_scene(scenes.with_organs(loaded), plans), None


def _choice(args: argparse.Namespace, scene: Scene) -> TaskChoice | None:
    """Return the tasks that a page of this scene can start; None if the options determine what is shown.

    Raises:
        TwinError: the scene has no task of the name in --task.
    """
    from twin.simulation.session.session_run import task_of
    from twin.ui.session.task_choice import EXERCISE_OPTIONS, TaskChoice, judged

    tasks = judged(scene.tasks)
    present = _first_task(args, scene)
    if present is not None:
        tasks = {present: task_of(scene, present), **tasks}
    for option in EXERCISE_OPTIONS:  # options that belong to one task, as the file of its session
        if getattr(args, option) is not None:
            return None
    if not tasks or scene.trainer is not None:
        return None
    return TaskChoice(tasks, present)


def _first_task(args: argparse.Namespace, scene: Scene) -> str | None:
    """Return the name of the task that is shown first: that of --task, else the only one of the scene; None: no task.

    The name in --task may be unknown.
    """
    if args.task == NO_TASK:
        return None
    if args.task is None and len(scene.tasks) == 1:
        return next(iter(scene.tasks))
    return args.task


def _at_console(
    args: argparse.Namespace, loaded: LoadedScene, choice: TaskChoice | None
) -> Callable[[], ServedContent]:
    """Return the function that starts the console of a scene, with the present task of `choice` if there is one.

    Raises:
        TwinError: an argument is wrong.
    """
    from twin.cli.commands.session import report
    from twin.simulation.condition import Condition, randomised
    from twin.simulation.console_scene import console_of
    from twin.simulation.session.session_run import task_of
    from twin.simulation.session.trial_table import TrialTable
    from twin.ui.headset import served_content
    from twin.ui.session.exercise import Exercise
    from twin.ui.session.forms import QuestionnaireForms

    scene = loaded.scene
    task = None
    name = _first_task(args, scene)
    if name is not None:
        task = task_of(scene, name)
    elif args.trials is not None:
        raise TwinError("--trials requires --task NAME: a row of the table is an attempt at a task")
    session = None
    if args.session is not None:
        session = Path(args.session)
    condition = None
    if args.haptics is not None:
        condition = Condition(haptics=args.haptics == "on")
    if args.participant is not None:
        condition = randomised(args.participant, args.run)
    if args.fulcrum is not None and not console_of(scene).instrument_mm:
        raise TwinError(
            f"--fulcrum: the instruments of scene '{scene.name}' have no length: add the key instrument_mm to the "
            f"section [console] of {scene.file.name}"
        )
    trials = None
    if args.trials is not None:
        assets.require_writable_file(Path(args.trials))
        trials = TrialTable(Path(args.trials), args.user or "1", args.group or "simulation")
    forms = None
    if trials is not None and (args.before or args.after):
        forms = QuestionnaireForms(trials, _names(args.before), _names(args.after))
    exercise = Exercise(task, session, report, condition, args.fulcrum or "compensated", trials, forms)
    machines.running(args.machine)
    connections = (args.packets, args.mqtt, args.mqtt_topic)
    if choice is None:
        scene_with_organs = scenes.with_organs(loaded, task)

        def of_task() -> ServedContent:
            # connected when the page is made: a machine that starts takes seconds, and may be refused
            at_machines = machines.connected(scene_with_organs, args.machine)
            return served_content.of_console(at_machines, exercise, *connections)

        return of_task

    def of_choice() -> ServedContent:
        chosen = replace(exercise, task=choice.task, choice=choice)
        return served_content.of_console(scenes.with_organs(loaded, choice.task), chosen, *connections)

    return of_choice


def _names(text: str | None) -> list[str]:
    """Return the names in a text, which are separated by commas; none without a text."""
    if not text:
        return []
    return list(map(str.strip, text.split(",")))


_CONNECTIONS = ("packets", "mqtt", "mqtt_topic", "ros")
"""Options for programs that move the hands of a console."""

_CONSOLE_OPTIONS = (*_CONNECTIONS, "session", "task", "haptics", "participant", "fulcrum", "trials", "machine")
"""Options for the console of a scene."""

NO_TASK = "none"
"""Value of --task with which the hands only move the robots."""

_OPTIONS_OF_A_RUN = ("task", "session", "run", "haptics", "trials", "fulcrum", "record", "replay")
"""Options that a guided run determines, or that it cannot have."""

_OPTION_NAME = "{option}"
"""Placeholder for the option's name in the message of `_refuse`."""


def _refuse(args: argparse.Namespace, options: Sequence[str], message: str) -> None:
    """Raise `TwinError` if one of the options is given; the option's name replaces `_OPTION_NAME` in it."""
    for name in options:
        if getattr(args, name) is not None:
            option = "--" + name.replace("_", "-")
            text = message.replace(_OPTION_NAME, option)
            if name == "session":
                text += "; --record records what clients see"
            raise TwinError(text)


def _require_compatible(args: argparse.Namespace) -> None:
    """Raise `TwinError` for options that cannot be combined, and for options that require others."""
    if args.replay is not None:
        text = "--record and --replay cannot be combined: the replayed session is already in a file"
        _refuse(args, ("record",), text)
        _refuse(args, ("session",), "--session and --replay cannot be combined: a replay has no hands to record")
        unsteered = (*_CONNECTIONS, "haptics", "participant", "trials", "machine")
        _refuse(
            args,
            unsteered,
            f"{_OPTION_NAME} and --replay cannot be combined: a recorded session cannot be controlled",
        )
    if args.mqtt is None:
        _refuse(args, ("mqtt_topic",), "--mqtt-topic requires --mqtt HOST")
    if args.trials is None:
        named = ("user", "before", "after") if args.guided is not None else ("user", "group", "before", "after")
        _refuse(args, named, f"{_OPTION_NAME} requires --trials FILE")
    for option, value in (("user", args.user), ("group", args.group), ("before", args.before), ("after", args.after)):
        if value is not None and not value.strip():
            raise TwinError(f"--{option} is empty: give a name, or omit --{option}")
    if args.guided is not None:
        if args.protocols:
            raise TwinError("--protocols and --guided cannot be combined: a guided run is at the console")
        _refuse(
            args,
            _OPTIONS_OF_A_RUN,
            f"{_OPTION_NAME} and --guided cannot be combined: the guided run determines it",
        )
        if args.machine:
            raise TwinError("--machine and --guided cannot be combined: the study of the console has no machines")
        if args.protocol is not None:
            raise TwinError(f"--guided plays no protocol: omit '{args.protocol}'")
        return
    if (args.participant is None) != (args.run is None):
        raise TwinError("--participant and --run must be given together, such as --participant 7 --run 1")
    if args.participant is not None and args.haptics is not None:
        raise TwinError("--haptics and --participant cannot be combined: --participant determines which run has forces")
    if args.participant is not None and args.session is None:
        raise TwinError("--participant requires --session FILE: the file records the condition of the participant")


async def serve_until_stopped(
    args: argparse.Namespace,
    name: str,
    make: Callable[[], ServedContent],
    port: int,
    context: ssl.SSLContext | None,
    begun: Callable[[asyncio.Event], object] | None = None,
    access: Access | None = None,
) -> bool:
    """Serve the object that `make` returns, until Ctrl-C or until `begun` has set the event that it receives.

    Return whether Ctrl-C was pressed, also if that was after the event.

    `make` and `begun` are called in the event loop. `access`: that of an earlier server; None: a new one.
    """
    from twin.ui.headset import server_files
    from twin.ui.headset.recording import StreamRecording
    from twin.ui.headset.replay import Replay
    from twin.ui.headset.server import StreamServer

    # each send releases the interpreter's lock; by default, the solver thread would then hold the lock for 5 ms
    sys.setswitchinterval(5e-4)
    stopping = asyncio.Event()
    interrupted = asyncio.Event()
    _on_ctrl_c(stopping, interrupted)
    if begun is not None:
        begun(stopping)
    content = make()
    live = content.live
    source = live
    recording = None
    bridge: RosBridge | None = None
    try:
        if args.replay is not None:  # `live` answers nothing then, but has the links and joints of the page
            source = Replay(Path(args.replay), name, content.model_hash)
        if args.record is not None:
            recording = StreamRecording(
                Path(args.record), name, content.model_hash, live.links, live.joints, live.version
            )
        web = Path(str(resources.files("twin.ui.headset"))) / "web" / "dist"
        page_files = ChainMap(server_files.page_files(web, content.preload) | content.files, content.late)
        address, rules = access or _access(args, name, port, context)
        server = StreamServer(source, content.hello, page_files, rules, recording)
        server.stopping = stopping
        await server.start(args.host, port, context)
        if args.ros is not None:
            from twin.ui.headset.console_stream import ConsoleStream

            assert isinstance(live, ConsoleStream)  # `_refuse` has refused the option for everything else
            ros_host, ros_port = args.ros
            bridge = await _bridge(live, ros_host, ros_port, context)
            bridge.hurry = server.respond_soon
        if "/" not in page_files:
            print(
                "twin: twin/ui/headset/web/dist is missing: only the stream is served, without the page",
                file=sys.stderr,
            )
        if not rules.needs_token:
            address.announce("")
            if not args.no_browser:
                # in a thread: some browsers return only when they are closed
                threading.Thread(target=webbrowser.open, args=(address.url,), daemon=True).start()
        await server.run()
    finally:
        if bridge is not None:
            await bridge.close()
        live.close()
    print(_next_command(args))
    return interrupted.is_set()


def _next_command(args: argparse.Namespace) -> str:
    """Return the command that replays the recorded session, in a line of its own; "" without a session."""
    if args.session is not None and Path(args.session).is_file():
        return f"\n  twin session {args.session}"
    return ""


async def _bridge(stream: ConsoleStream, host: str, port: int, context: ssl.SSLContext | None) -> RosBridge:
    """Start the server for ROS clients, with TLS if the page has it, and print its address.

    Raises:
        TwinError: the port is in use.
    """
    from twin.ui.access.rules import AccessRules

    is_https = context is not None
    port, url = ros_port_and_url(host, port, is_https)

    def announce(token: str) -> None:
        print(f"  rosbridge for the next ROS client, once: {url}/?token={token}", flush=True)

    rules = AccessRules(host, port, is_https, announce)
    bridge = stream.bridge(rules)
    try:
        await bridge.start(host, port, context)
    except OSError as error:
        reason = error.strerror or error
        raise TwinError(f"--ros: cannot listen on {host}:{port}: {reason}; choose another port") from error
    if not rules.needs_token:
        print(f"  rosbridge for ROS clients: {url}", flush=True)
    return bridge


def _tls(cert: str | None, key: str | None) -> ssl.SSLContext | None:
    """Return the settings of https; None: without a certificate, pages are served by http.

    Raises:
        TwinError: there is a key without a certificate, or a file cannot be read.
    """
    if cert is None and key is None:
        return None
    if cert is None:
        raise TwinError("--key requires --cert")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        # without a password, OpenSSL would ask for that of an encrypted key on the terminal
        context.load_cert_chain(cert, key, password="")
    except (OSError, ssl.SSLError) as error:
        raise TwinError(f"--cert {cert}, --key {key or 'in the same file'}: {error.strerror or error}") from error
    return context


def _on_ctrl_c(stopping: asyncio.Event, interrupted: asyncio.Event) -> None:
    """Let the first Ctrl-C set both events, of which `stopping` stops the server, and a second one end the process."""
    loop = asyncio.get_running_loop()

    def end() -> None:
        interrupted.set()
        stopping.set()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.remove_signal_handler(number)
        signal.signal(signal.SIGINT, signal.default_int_handler)

    try:
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, end)
    except NotImplementedError:  # on Windows, Ctrl-C raises an exception instead
        return
