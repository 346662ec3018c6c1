"""`twin serve`: serve a robot or a scene to headsets and browsers; implemented in twin.cli.headset_server."""

from __future__ import annotations

import argparse
import re

from twin.cli.parser import Command, host_and_port, port_number

EXAMPLES = """\
  twin serve sils                     for a Quest by USB cable, first: adb reverse tcp:8765 tcp:8765
  twin serve sher phantom --no-browser
  twin serve my_robot/                your own robot; a USD stage also works
  twin serve sils --machine sils=127.0.0.1:36000:36001    a machine follows the platform that a hand drags
  twin serve vsrs                     the operation of a scene, by your own hands
  twin serve davinci                  instruments and camera, controlled from the page or the headset
  twin serve davinci --task pegboard            rings to grasp, with a scoreboard
  twin serve raven_dome               a ring to hand over and to guide in a dome
  twin serve davinci --packets 9870 --mqtt 127.0.0.1    also by UDP packets; motion scale by MQTT
  twin serve davinci --ros 9090                 by programs of ROS systems, without ROS on this computer
  twin serve sils --host 0.0.0.0 --cert cert.pem --key key.pem    for every headset in the network
  twin serve sils --record session.json        record requests and what clients see
  twin serve sils --replay session.json
  twin serve davinci --session hands.session    record the hands at a console, for twin session
  twin serve sher_phantom --task phantom        the SHER by one hand: pen, mouse, gamepad or controller
  twin serve sher_phantom --task phantom --trials study.csv --user 3 --after nasatlx
  twin serve davinci --session p7-1.session --participant 7 --run 1    a study: one of two runs has forces
  twin serve davinci --guided study/ --participant 7    the five phases of the study, in the participant's order"""


def arguments(command: Command) -> None:
    """Add the arguments of `twin serve`."""
    command.page(8765, "server")
    command.text("--record", "FILE", "record the session: requests, states and frames, as JSON")
    command.text("--replay", "FILE", "replay a session recorded by --record, frame by frame")
    text = "UDP port for hand states from other programs, for a scene with a console (docs/console-reference.md)"
    command.text("--packets", "[HOST:]PORT", text, type=host_and_port)
    text = "MQTT broker for the motion scale of a scene with a console (default port 1883)"
    command.text("--mqtt", "HOST[:PORT]", text, type=_broker)
    text = "topic of the motion scale; messages to TOPIC/set change the scale (default twin/<scene>/scale)"
    command.text("--mqtt-topic", "TOPIC", text)
    text = "port for programs of ROS systems by the protocol rosbridge, for a scene with a console (docs/ros.md)"
    command.text("--ros", "[HOST:]PORT", text, type=host_and_port)
    command.text("--session", "FILE", "record the motion of the hands at a console; twin session replays the file")
    command.text("--cert", "FILE", "certificate (PEM) for https, which headsets require for AR")
    command.text("--key", "FILE", "private key (PEM) of the certificate, if it is not in the same file")
    command.choice("--haptics", ("on", "off"), "forces on the hands at the start (default: as in the scene file)")
    command.integer("--participant", "number of the participant in a study; determines which run has forces")
    command.integer("--run", "number of the participant's run; one of the two runs has forces", metavar="1|2")
    command.text(
        "--trials", "FILE", "table (CSV) to which each attempt at a task with holes adds a row, for twin study"
    )
    text = "questionnaires on the page before the first attempt, such as ssq; answers go to the table of --trials"
    command.text("--before", "NAMES", text)
    text = "questionnaires after each attempt, separated by commas: ssq, ueq, nasatlx, simtlx, facevalidity"
    command.text("--after", "NAMES", text)
    text = "the study of the console in five phases, with --participant; sessions and answers go to this folder"
    command.text("--guided", "FOLDER", text)
    command.text("--user", "NAME", "name of the user in the table of --trials (default 1)")
    command.text("--group", "NAME", "group of the user in the table of --trials (default simulation)")


def _broker(text: str) -> tuple[str, int]:
    """Convert HOST[:PORT] to host and port; default 1883, the port of MQTT. An address of IPv6 is in brackets."""
    in_brackets = re.fullmatch(r"\[(.*)\](?::(.*))?", text)
    if in_brackets is not None:
        host = in_brackets[1]
        port = in_brackets[2] or ""
    else:
        host, _, port = text.partition(":")
    if ":" in port:
        raise argparse.ArgumentTypeError(f"{text}: give an address of IPv6 in brackets, as [::1] or [::1]:1883")
    if not host:
        raise argparse.ArgumentTypeError(f"{text} has no host: give HOST or HOST:PORT")
    number = port_number(port or "1883")
    if number == 0:
        raise argparse.ArgumentTypeError(f"{text}: port 0 is not the port of a broker; give 1 to 65535")
    return host, number


def run(args: argparse.Namespace) -> int:
    """Serve a robot or a scene until Ctrl-C."""
    from twin.cli.headset_server import serve

    return serve(args)
