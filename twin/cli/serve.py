"""`twin serve`: the robot in a headset, or in any browser that draws in three dimensions."""

from __future__ import annotations

import argparse
import asyncio
import signal
import socket
import ssl
import sys
import threading
import webbrowser
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

from twin import api, assets
from twin.cli.view import free_port
from twin.errors import TwinError

if TYPE_CHECKING:
    pass


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
    from twin.door.gate import Gate
    from twin.headset import files
    from twin.headset.recording import Recording, Replay
    from twin.headset.server import StreamServer
    from twin.headset.twin import Twin

    # Each send lets go of the interpreter; the thread that solves would keep it for 5 ms each time.
    sys.setswitchinterval(5e-4)
    stopping = asyncio.Event()
    _on_ctrl_c(stopping)
    from twin.exporting.glb import glb_bytes

    twin = Twin(robot, str(args.robot), args.protocol, plans=args.replay is None)
    source, recording = twin, None
    try:
        about = twin.description
        if args.replay is not None:
            source = Replay(Path(args.replay), robot.name, about["model_hash"])
        if args.record is not None:
            recording = Recording(Path(args.record), robot.name, about["model_hash"], twin.links, robot.joints)
        own = files.page_files(Path(str(resources.files("twin.headset"))) / "web" / "dist")
        own |= files.robot_files(glb_bytes(robot.mechanism), about)
        own |= files.patient_files({n: glb_bytes(p.mechanism, (), p.poses) for n, p in twin.patients.items()})
        address = Address(args.host, port, context is not None, robot.name)
        gate = Gate(args.host, port, context is not None, address.say)
        server = StreamServer(source, {"robot": robot.name, "model_hash": about["model_hash"]}, own, gate, recording)
        server.stopping = stopping
        await server.start(args.host, port, context)
        if "/" not in own:
            print("twin: twin/headset/web/dist is missing: there is no page, only the stream", file=sys.stderr)
        if not gate.open:
            address.say("")
            if not args.no_browser:
                threading.Thread(target=webbrowser.open, args=(address.url,), daemon=True).start()
        await server.run()
    finally:
        twin.close()
    print()


class Address:
    """Where the page is, as the terminal shows it.

    Attributes:
        url: for a browser on this machine, or in the network that the server is open to.
    """

    def __init__(self, host: str, port: int, secure: bool, robot: str) -> None:
        self.robot, self.secure = robot, secure
        shown = _reachable() if host in ("0.0.0.0", "::", "") else host
        shown = f"[{shown}]" if ":" in shown else shown
        self.url = f"{'https' if secure else 'http'}://{shown}:{port}/"
        self._first = True

    def say(self, token: str) -> None:
        """Print the address; with a token also as a QR code, for one device."""
        if not token:
            print(f"{self.robot}: {self.url}   (Ctrl-C ends it)", flush=True)
            return
        import segno

        url = f"{self.url}?token={token}"
        if self._first:
            print(f"{self.robot}: open to the network; each address opens once   (Ctrl-C ends it)")
            if not self.secure:
                print("  a headset enters AR only over https (--cert and --key), or over its cable, see --help")
        else:
            print("  a device has come in; for the next one:")
        self._first = False
        segno.make(url, error="m").terminal(compact=True)
        print(f"  {url}", flush=True)


def _reachable() -> str:
    """Return the address of this machine in its network."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        try:
            s.connect(("192.0.2.1", 9))  # an address of documentation: nothing is sent, a route is chosen
            return str(s.getsockname()[0])
        except OSError:
            return socket.gethostname()


def _tls(cert: str | None, key: str | None) -> ssl.SSLContext | None:
    if cert is None and key is None:
        return None
    if cert is None:
        raise TwinError("--key is nothing without --cert")
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
