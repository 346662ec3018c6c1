"""`twin serve`: the robot in a headset, or in any browser that draws in three dimensions."""

from __future__ import annotations

import argparse
import asyncio
import signal
import ssl
import sys
import threading
import webbrowser
from importlib import resources
from pathlib import Path

from twin import api
from twin.cli.address import Address, free_port
from twin.core import assets
from twin.core.errors import TwinError

_ADVICE = "a headset enters AR only over https (--cert and --key), or over its cable, see --help"


def serve(args: argparse.Namespace) -> int:
    """Serve a robot until Ctrl-C."""
    port = free_port(args.host, args.port)
    context = _tls(args.cert, args.key)
    if args.record is not None:
        if args.replay is not None:
            raise TwinError("--record and --replay exclude each other: what is replayed is recorded already")
        assets.require_writable(Path(args.record).parent)
    robot = api.load(args.robot)
    if args.protocol is not None:
        robot.protocol(args.protocol)
    asyncio.run(_run(args, robot, port, context))
    return 0


async def _run(args: argparse.Namespace, robot: api.Robot, port: int, context: ssl.SSLContext | None) -> None:
    from twin.ui.door.gate import Gate
    from twin.ui.headset import files
    from twin.ui.headset.recording import Recording, Replay
    from twin.ui.headset.server import StreamServer
    from twin.ui.headset.twin import Twin

    # Each send lets go of the interpreter; the thread that solves would keep it for 5 ms each time.
    sys.setswitchinterval(5e-4)
    stopping = asyncio.Event()
    _on_ctrl_c(stopping)
    from twin.exchange.write.glb import glb_bytes

    twin = Twin(robot, str(args.robot), args.protocol, plans=args.replay is None)
    source, recording = twin, None
    try:
        about = twin.description
        if args.replay is not None:
            source = Replay(Path(args.replay), robot.name, about["model_hash"])
        if args.record is not None:
            recording = Recording(Path(args.record), robot.name, about["model_hash"], twin.links, robot.joints)
        own = files.page_files(Path(str(resources.files("twin.ui.headset"))) / "web" / "dist")
        own |= files.robot_files(glb_bytes(robot.mechanism), about)
        own |= files.patient_files({n: glb_bytes(p.mechanism, (), p.poses) for n, p in twin.patients.items()})
        advice = "" if context is not None else _ADVICE
        address = Address(args.host, port, context is not None, robot.name, advice)
        gate = Gate(args.host, port, context is not None, address.say)
        server = StreamServer(source, {"robot": robot.name, "model_hash": about["model_hash"]}, own, gate, recording)
        server.stopping = stopping
        await server.start(args.host, port, context)
        if "/" not in own:
            print("twin: twin/ui/headset/web/dist is missing: there is no page, only the stream", file=sys.stderr)
        if not gate.open:
            address.say("")
            if not args.no_browser:
                threading.Thread(target=webbrowser.open, args=(address.url,), daemon=True).start()
        await server.run()
    finally:
        twin.close()
    print()


def _tls(cert: str | None, key: str | None) -> ssl.SSLContext | None:
    if cert is None and key is None:
        return None
    if cert is None:
        raise TwinError("--key requires --cert")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        context.load_cert_chain(cert, key, password="")
    except (OSError, ssl.SSLError) as error:
        raise TwinError(f"--cert {cert}, --key {key or 'in the same file'}: {error.strerror or error}") from error
    return context


def _on_ctrl_c(stopping: asyncio.Event) -> None:
    """Let Ctrl-C ask for the end; the second time it ends whatever there is."""
    loop = asyncio.get_running_loop()

    def end() -> None:
        stopping.set()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.remove_signal_handler(number)
        signal.signal(signal.SIGINT, signal.default_int_handler)

    try:
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, end)
    except NotImplementedError:  # Windows: Ctrl-C is an exception there
        return
