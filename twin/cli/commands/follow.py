"""`twin follow`: show a machine live, in the page of `twin serve`."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from twin.cli.parser import Command, port_number
from twin.core.errors import TwinError

if TYPE_CHECKING:
    from twin.api import Robot
    from twin.ui.session.mirror import Mirror


EXAMPLES = """\
  twin follow raven_left --states 127.0.0.1:36001      a machine that `twin machine` runs
  twin follow pa10 --packets 36002                     joint values by UDP (docs/raven-reference.md)"""


def arguments(command: Command) -> None:
    """Add the arguments of `twin follow`."""
    command.robot()
    command.text("--states", "[HOST:]PORT", "TCP port of the states of a `twin machine`")
    command.text("--packets", "PORT", "UDP port for joint packets (0: any free port)", type=port_number)
    command.address(8766, "page")
    # options of `twin serve` that `serve_until_stopped` reads, and that a mirror does not have
    command.set_defaults(record=None, replay=None, session=None, ros=None)


def run(args: argparse.Namespace) -> int:
    """Show the motion of a machine in a page until Ctrl-C."""
    from twin import api
    from twin.cli.server_address import free_port

    if (args.states is None) == (args.packets is None):
        raise TwinError(
            "give either --states HOST:PORT (TCP port of a `twin machine`) or --packets PORT (joint values of any "
            "machine by UDP)"
        )
    port = free_port(args.host, args.port)
    robot = api.load(args.robot)
    mirror = _mirror(robot, args)
    try:
        import asyncio

        from twin.cli.headset_server import serve_until_stopped
        from twin.ui.headset import served_content

        asyncio.run(serve_until_stopped(args, robot.name, lambda: served_content.of_mirror(mirror), port, None))
    finally:
        mirror.close()
    return 0


def _mirror(robot: Robot, args: argparse.Namespace) -> Mirror:
    """Return a mirror of the robot, connected to the machine whose states it shows.

    Raises:
        TwinError: nothing answers at --states, or the port of --packets is in use.
    """
    from twin.simulation.devices.joint_packets import JointPackets
    from twin.simulation.machine.machine_link import StateReader
    from twin.ui.session.mirror import Mirror

    joint_count = len(robot.mechanism.active)
    if args.packets is not None:
        source = JointPackets(args.packets, joint_count)
        print(f"{robot.name}: joint packets to 127.0.0.1:{source.port} (UDP)", flush=True)
        return Mirror(robot, source)
    host, _, port = args.states.rpartition(":")
    try:
        number = port_number(port)
    except argparse.ArgumentTypeError:
        number = 0
    if number == 0:
        raise TwinError(f"--states {args.states[:80]}: give HOST:PORT or PORT, such as 127.0.0.1:36001")
    return Mirror(robot, StateReader(host or "127.0.0.1", number, joint_count))
