"""The process that serves a machine to ROS clients, as `twin machine --ros` starts it."""

from __future__ import annotations

from collections.abc import Callable

from twin.cli.server_address import ros_port_and_url
from twin.core.errors import TwinError
from twin.core.processes import WorkerProcess
from twin.simulation.machine.machine_link import Address
from twin.simulation.machine.machine_server import HOST, Server
from twin.ui.access.rules import is_local


class RosProcess:
    """Process with the server for ROS clients; it ends with `close`, or with this program."""

    def __init__(self, robot: str, server: Server, listens: tuple[str, int], tell: Callable[[str], None]) -> None:
        """Start the process, which says its address when it listens (see `relay`).

        Args:
            robot: name or folder of the robot.
            server: the machine with its ports.
            listens: (host, port) for ROS clients; port 0: any free one.
            tell: function that prints a line.

        Raises:
            TwinError: the port is in use, or the host is no address of this computer.
        """
        from twin.ui.headset.ros import machine_bridge

        # in a separate process: clients that send much would delay the ticks of the machine
        host, requested_port = listens
        port, url = ros_port_and_url(host, requested_port, secure=False)
        if not is_local(host):
            tell("rosbridge is open to the network, without TLS: others in the network can read and change messages")
        self._tell = tell
        address = Address(HOST, server.port, server.state_port)
        self._process = WorkerProcess(machine_bridge.run, robot, address, host, port, url)

    def relay(self) -> bool:
        """Print the lines that the process has said so far; return False, because they do not end the machine.

        It is called as `ends` of `Server.run`, 20 times per second, and does not wait.

        Raises:
            TwinError: the process cannot serve the machine, or has ended.
        """
        line = self._process.line
        try:
            while line.poll():
                kind, text = line.recv()
                if kind == "failed":
                    raise TwinError(f"--ros: {text}")
                self._tell(text)
        except (EOFError, OSError) as error:
            raise TwinError("--ros: the process that serves ROS clients has ended") from error
        return False

    def close(self) -> None:
        """End the process."""
        self._process.close()
        self._process.line.close()
