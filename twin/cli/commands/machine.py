"""`twin machine`: run a robot as a separate machine, with packets by UDP, states by TCP, and topics for ROS clients."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING

from twin.cli.parser import Command, host_and_port, port_number
from twin.core.errors import TwinError
from twin.core.units import DEG

if TYPE_CHECKING:
    from twin.api.robot import Robot
    from twin.simulation.machine.machine_parts import Parts
    from twin.simulation.machine.machine_server import Server
    from twin.simulation.machine.simulated_machine import Machine

EXAMPLES = """\
  twin machine raven_left --port 36000 --state-port 36001 --start
  twin machine sils --start                     six carriages that keep the loops of a parallel robot closed
  twin machine sils --start --ros 9090          also for programs of ROS systems, without ROS (docs/ros.md)
  twin machine raven_left --mass-error 5 --friction-error 20 --overdrive hard"""


def arguments(command: Command) -> None:
    """Add the arguments of `twin machine`."""
    command.robot()
    for name, text in (("--port", "UDP port of the packets"), ("--state-port", "TCP port of the states")):
        command.add_argument(name, type=port_number, default=0, help=f"{text} (default 0: any free port)")
    text = "port for programs of ROS systems by the protocol rosbridge, without TLS (docs/ros.md)"
    command.text("--ros", "[HOST:]PORT", text, type=host_and_port)
    command.flag("--start", "press the start button of the machine as soon as it runs")
    command.number("--duration", "S", "running time in seconds (default: run until Ctrl-C)")
    command.software()
    command.number("--master-timeout-ms", "MS", "time without packets after which the pedal counts as up")
    text = "difference of the machine's masses from the masses in its software, in percent"
    command.number("--mass-error", "PERCENT", text, 0.0)
    text = "difference of the machine's friction from the friction in its software, in percent"
    command.number("--friction-error", "PERCENT", text, 0.0)
    command.number("--tilt-deg", "DEG", "rotation of the machine's base about its x axis, unknown to its software", 0.0)


def run(args: argparse.Namespace) -> int:
    """Run the machine for --duration or until Ctrl-C; print the delays of its control ticks. The exit code is 0."""
    from twin import api
    from twin.api.machine import machine
    from twin.simulation.machine.machine_server import HOST, Server

    if args.duration is not None and not args.duration > 0:
        raise TwinError(f"--duration {args.duration:g}: give a number of seconds above 0")
    if not math.isfinite(args.tilt_deg):
        raise TwinError(f"--tilt-deg {args.tilt_deg:g}: give a finite number of degrees")
    robot = api.load(args.robot)
    parts = _parts(robot, args)
    arm = machine(
        parts,
        mass=1 + args.mass_error / 100,
        friction=1 + args.friction_error / 100,
        tilt=args.tilt_deg * DEG,
    )
    server = Server(arm, args.port, args.state_port)

    # With --json, the result alone goes to stdout; ports and tokens are needed while the machine runs.
    stream = sys.stderr if args.json else sys.stdout

    def tell(text: str) -> None:
        print(text, file=stream, flush=True)

    def never_ends() -> bool:
        return False

    tell(f"{robot.name}: packets to {HOST}:{server.port} (UDP), states from {HOST}:{server.state_port} (TCP)")
    if not args.quiet:
        for number in parts.settings.parameters():
            if number.provenance == "ASSUMED":
                tell(f"  ASSUMED {number.name} = {number.value:g} {number.unit}: {number.note}")
    duration = float("inf")
    if args.duration is not None:
        duration = args.duration
    if args.start:
        arm.start()
    ros_process = None
    try:
        ends = never_ends
        if args.ros is not None:
            from twin.cli.machine_ros import RosProcess

            ros_process = RosProcess(args.robot, server, args.ros, tell)
            ends = ros_process.relay
        server.run(duration, tell, ends)
    except KeyboardInterrupt:
        tell("stopped")
    finally:
        if ros_process is not None:
            ros_process.close()
        server.close()
    _print_summary(args, robot.name, arm, server, tell)
    return 0


def _print_summary(
    args: argparse.Namespace, name: str, arm: Machine, server: Server, tell: Callable[[str], None]
) -> None:
    """Print the packets and the delays of the ticks of a machine that has run, or the same as JSON."""
    from twin.cli import show

    pace = server.pace.summary()
    receiver = arm.receiver
    content = {
        "robot": name,
        "level": arm.plc.level.name,
        "reason": arm.reason,
        "accepted": receiver.accepted,
        "refused": receiver.refused,
        "last_refusal": receiver.reason,
        "jams": arm.plant.jams,
        **pace,
    }
    if args.json:
        print(show.as_json(show.record("machine", content)))
        return
    packets = f"packets: {receiver.accepted} accepted, {receiver.refused} refused"
    if receiver.reason:
        packets += f": {receiver.reason}"
    tell(packets)
    if arm.plant.jams:
        tell(f"the linkage jammed in {arm.plant.jams} ticks: near a singularity its simulation stops the joints")
    tell(
        f"{pace['ticks']} ticks, {pace['late']} more than 1 ms late; delay p50 {pace['p50_ms']:.2f} ms, "
        f"p99 {pace['p99_ms']:.2f} ms, largest {pace['max_ms']:.2f} ms"
    )


def _parts(robot: Robot, args: argparse.Namespace) -> Parts:
    """Return the compiled parts of the machine, with the software that the options state."""
    from twin.api.machine import machine_parts

    timeout = None
    if args.master_timeout_ms is not None:
        timeout = args.master_timeout_ms / 1e3
    released = None
    if args.released is not None:
        released = args.released.split(",")
    return machine_parts(robot, mode=args.mode, overdrive=args.overdrive, master_timeout=timeout, released=released)
