"""A process beside a machine that serves it to ROS clients: rosbridge on one side, the machine's packets on the other.

The process is the machine's master, as any other program may be; the ticks of the machine do not wait for it.
"""

from __future__ import annotations

import asyncio
import time
from multiprocessing.connection import Connection

from twin.api.machine import machine_parts
from twin.api.robot_loading import load
from twin.core.errors import TwinError
from twin.simulation.machine.machine_link import Address, MachineLink
from twin.simulation.machine.machine_master import MachineMaster
from twin.simulation.machine.motor_plant import TICK
from twin.ui.access.rules import AccessRules
from twin.ui.headset.ros.bridge import RosBridge
from twin.ui.headset.ros.machine_topics import MachineTopics

RATE = 250.0
"""Rounds per second; each sends the packets of its ticks and the newest messages."""


def run(line: Connection, robot: str, address: Address, host: str, port: int, url: str) -> None:
    """Serve a machine until the parent process closes the connection.

    Lines of text for the terminal are sent to the parent as ("said", text): the address of the server, once it listens,
    and the address with a new token for each client if clients need one. ("failed", reason): the server cannot listen.

    Args:
        line: connection to the parent process.
        robot: name or folder of the machine's robot.
        address: where the machine runs.
        host: host name or address on which the server listens.
        port: port on which the server listens.
        url: address of the server for clients.
    """
    try:
        asyncio.run(_serve(line, robot, address, host, port, url))
    except (TwinError, OSError) as error:
        line.send(("failed", str(error)))


async def _serve(line: Connection, robot: str, address: Address, host: str, port: int, url: str) -> None:
    loaded = load(robot)
    parts = machine_parts(loaded)
    link = MachineLink(address, len(parts.home))
    try:
        topics = MachineTopics(loaded.name, MachineMaster(link, parts))

        def announce(token: str) -> None:
            line.send(("said", f"rosbridge for the next ROS client, once: {url}/?token={token}"))

        rules = AccessRules(host, port, False, announce)
        bridge = RosBridge(topics, rules)
        await bridge.start(host, port)
        try:
            if not rules.needs_token:
                line.send(("said", f"rosbridge for ROS clients: {url}"))
            await _rounds(line, topics, bridge)
        finally:
            await bridge.close()
    finally:
        link.close()


async def _rounds(line: Connection, topics: MachineTopics, bridge: RosBridge) -> None:
    """Pass messages between the clients and the machine, until the parent process has closed its end or ended."""
    begun = time.monotonic()
    sent = 0
    while not line.poll():
        await asyncio.sleep(1 / RATE)
        due = int((time.monotonic() - begun) / TICK)
        # After a pause, packets are left out: if they were sent late and faster, so would the tool move.
        topics.advance(min(due - sent, topics.master.link.room))
        sent = due
        bridge.send()
