"""`twin machine`: run a robot as a separate machine, with packets by UDP and states by TCP."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from twin import api
from twin.cli import show
from twin.core.errors import TwinError
from twin.core.units import DEG

if TYPE_CHECKING:
    from twin.api.machine import Machines
    from twin.api.robot import Robot
    from twin.model.scene import Scene
    from twin.simulation.machine.link import Address


def running(given: Sequence[str] | None) -> dict[str, Address]:
    """Return the addresses of machines from options "ROBOT=HOST:PORT:STATEPORT".

    Raises:
        TwinError: an option has another form, or names a robot twice.
    """
    from twin.simulation.machine.link import Address

    out: dict[str, Address] = {}
    for text in given or ():
        name, equal, where = text.partition("=")
        if not equal or not name:
            form = "ROBOT=HOST:PORT:STATEPORT, such as raven_left=127.0.0.1:36000:36001"
            raise TwinError(f"--machine {text}: give {form}")
        if name in out:
            raise TwinError(f"--machine {text}: {name} is given twice; give each robot once")
        out[name] = Address.parse(where)
    return out


def of_scene(scene: Scene, robots: Mapping[str, Robot], given: Sequence[str] | None) -> Machines | None:
    """Connect to the machines of a scene, and start those that are not in `given`; None for a scene without machines.

    `given` contains the values of the option --machine.

    Raises:
        TwinError: --machine is wrong, or a machine does not answer.
    """
    from twin.api.session import machines_of

    where = running(given)
    if scene.trainer is None:
        if where:
            raise TwinError(f"--machine: scene '{scene.name}' has no machines: add a section [trainer] to its file")
        return None
    started = [n for n in scene.trainer.robots if n not in where]
    if started:
        print(f"twin: starting the machine of {', '.join(started)}", file=sys.stderr, flush=True)
    return machines_of(scene, robots, where)


def machine(args: argparse.Namespace) -> int:
    """Run the machine for --duration or until Ctrl-C; print the delays of its control ticks. The exit code is 0."""
    from twin.api.machine import machine as made
    from twin.api.machine import machine_parts
    from twin.simulation.machine.server import HOST, Server

    robot = api.load(args.robot)
    timeout = None if args.master_timeout_ms is None else args.master_timeout_ms / 1e3
    released = None if args.released is None else args.released.split(",")
    parts = machine_parts(robot, mode=args.mode, overdrive=args.overdrive, master_timeout=timeout, released=released)
    arm = made(
        parts,
        mass=1 + args.mass_error / 100,
        friction=1 + args.friction_error / 100,
        tilt=args.tilt_deg * DEG,
    )
    server = Server(arm, args.port, args.state_port)

    def said(text: str) -> None:
        if not args.json:
            print(text, flush=True)

    said(f"{robot.name}: packets to {HOST}:{server.port} (UDP), states from {HOST}:{server.state_port} (TCP)")
    if not args.quiet:
        for number in parts.settings.parameters():
            if number.provenance == "ASSUMED":
                said(f"  ASSUMED {number.name} = {number.value:g} {number.unit}: {number.note}")
    if args.start:
        arm.start()
    try:
        server.run(float("inf") if args.duration is None else args.duration, said)
    except KeyboardInterrupt:
        said("stopped")
    finally:
        server.close()
    pace, receiver = server.pace.summary(), arm.receiver
    found = {
        "robot": robot.name,
        "level": arm.plc.level.name,
        "reason": arm.reason,
        "accepted": receiver.accepted,
        "refused": receiver.refused,
        "last_refusal": receiver.reason,
        **pace,
    }
    if args.json:
        print(show.as_json(found))
        return 0
    why = f": {receiver.reason}" if receiver.reason else ""
    said(f"packets: {receiver.accepted} accepted, {receiver.refused} refused{why}")
    said(
        f"{pace['ticks']} ticks, {pace['late']} more than 1 ms late; delay p50 {pace['p50_ms']:.2f} ms, "
        f"p99 {pace['p99_ms']:.2f} ms, largest {pace['max_ms']:.2f} ms"
    )
    return 0
