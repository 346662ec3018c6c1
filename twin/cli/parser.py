"""Define the command line: commands, options, their help and examples."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from functools import cache
from typing import Any, NoReturn

from twin import __version__
from twin.cli.parser_sweeps import add_sweeps
from twin.core.errors import unknown

_EPILOG = """\
examples:
  twin run sils                                   from CAD to report in one command
  twin validate sils                              validate the equations on the default protocol
  twin validate sils --variant eq1=printed        validate equation (1) as the paper prints it
  twin validate sils --all-protocols --json       validate on every protocol; print JSON for scripts
  twin explain sils --variant printed             show the wrong rows, and the edit that fixes them
  twin plan sils lowered_patient --out plan/      timed joint and tool motion as CSV
  twin build my_robot/                            USD stage of your own robot
  twin export sils --to glb,tracks                write and audit files for headsets and engines

exit codes: 0 agree or done, 1 disagree, 2 could not check or wrong usage
"""

NAMES = ("list", "info", "build", "plan", "validate", "explain", "run", "view", "serve")
NAMES += ("operate", "session", "track", "study", "console", "export", "audit", "new", "selftest")
NAMES += ("workspace", "tolerance", "sweep", "machine", "hazards", "doctor")
"""Names of all commands."""


class UsageError(Exception):
    """Invalid arguments of the command line; `usage` shows the correct form."""

    def __init__(self, message: str, usage: str) -> None:
        super().__init__(message)
        self.usage = usage


class _Help(argparse.RawDescriptionHelpFormatter):
    """Help formatter with a column for the longest command name, including the indentation that argparse ignores."""

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        self._action_max_length = 4 + max(map(len, NAMES))


class _Parser(argparse.ArgumentParser):
    """Parser that raises `UsageError` instead of exiting, so that --json also works for wrong usage."""

    def error(self, message: str) -> NoReturn:
        wrong = re.search(r"argument COMMAND: invalid choice: '(.*?)'", message)
        raise UsageError(unknown("command", wrong[1], NAMES) if wrong else message, self.format_usage())


def _port(text: str) -> int:
    """Convert a text to a port number."""
    if not re.fullmatch(r"[0-9]+", text) or int(text) > 65535:
        raise argparse.ArgumentTypeError(f"{text} is not a port: give 0 to 65535; 0 chooses a free port")
    return int(text)


def _packets(text: str) -> tuple[str, int]:
    """Convert [HOST:]PORT to host and port; default 127.0.0.1."""
    host, _, port = text.rpartition(":")
    return host or "127.0.0.1", _port(port)


def _broker(text: str) -> tuple[str, int]:
    """Convert HOST[:PORT] to host and port; default 1883, the port of MQTT."""
    host, _, port = text.partition(":")
    if not host:
        raise argparse.ArgumentTypeError(f"{text} has no host: give HOST or HOST:PORT")
    number = _port(port or "1883")
    if number == 0:
        raise argparse.ArgumentTypeError(f"{text}: port 0 is not the port of a broker; give 1 to 65535")
    return host, number


def _by_hand(sub: argparse.ArgumentParser) -> None:
    """Add the options for a scene whose robots can be operated by hand."""
    sub.add_argument(
        "--fulcrum",
        choices=("compensated", "direct"),
        help="whether the hands lead the tips of instruments in ports, or their outer ends (default: the tips)",
    )
    sub.add_argument("--protocols", action="store_true", help="play the protocols of a scene that has a console")


def _machine(add: Callable[[str, str, str], argparse.ArgumentParser], robot: Callable[..., None]) -> None:
    """Add the command `machine`."""
    sub = add(
        "machine",
        "run a robot as a machine: control software, motors and links at 1 kHz, with packets by UDP, states by TCP",
        "  twin machine raven_left --port 36000 --state-port 36001 --start\n"
        "  twin machine raven_left --mass-error 5 --friction-error 20 --overdrive hard",
    )
    robot(sub)
    sub.add_argument("--port", type=_port, default=0, help="UDP port of the packets (default 0: any free port)")
    sub.add_argument("--state-port", type=_port, default=0, help="TCP port of the states (default 0: any free port)")
    sub.add_argument("--start", action="store_true", help="press the start button at once")
    sub.add_argument("--duration", type=float, metavar="S", help="stop after a time (default: run until Ctrl-C)")
    sub.add_argument("--mode", choices=("advanced", "moderate", "beginner"), help="limits of the DAC")
    sub.add_argument("--overdrive", choices=("none", "soft", "hard"), help="above them: count, clip, or stop")
    sub.add_argument("--master-timeout-ms", type=float, metavar="MS", help="silence after which the pedal is up")
    error = {"type": float, "default": 0.0, "metavar": "PERCENT"}
    sub.add_argument("--mass-error", **error, help="how much heavier the machine is than its software knows")
    sub.add_argument("--friction-error", **error, help="how much more friction it has")
    sub.add_argument("--tilt-deg", type=float, default=0.0, metavar="DEG", help="tilt of its base about x")


def _hazards(add: Callable[[str, str, str], argparse.ArgumentParser], robot: Callable[..., None]) -> None:
    """Add the command `hazards`."""
    sub = add(
        "hazards",
        "run a campaign of faults on the machine of a robot; the same command goes on where it was interrupted",
        "  twin hazards raven_left --campaign table1\n  twin hazards raven_left --sessions 100 --processes 1",
    )
    robot(sub)
    text = "name of a campaign of the robot, or path of a file (default table1)"
    sub.add_argument("--campaign", default="table1", metavar="NAME", help=text)
    sub.add_argument("--sessions", type=int, metavar="N", help="run at most N of the sessions that are left")
    sub.add_argument("--processes", type=int, metavar="N", help="number of processes (default: of processors)")
    sub.add_argument("--out", metavar="FOLDER", help="folder of the log (default ./twin-out/<robot>/<name>-hazards/)")


@cache
def parser() -> argparse.ArgumentParser:
    """Return the parser of the whole command line; it is built once, for programs that run many commands."""
    formatter = _Help
    root = _Parser(
        prog="twin",
        description="Compare the equations of a robot with its CAD, and show where they disagree.",
        epilog=_EPILOG,
        formatter_class=formatter,
    )
    root.add_argument("--version", action="version", version=f"twin {__version__}")
    commands = root.add_subparsers(dest="command", required=True, metavar="COMMAND")

    def add(name: str, text: str, examples: str) -> argparse.ArgumentParser:
        sub = commands.add_parser(
            name,
            help=text,
            description=text[0].upper() + text[1:] + ("" if text.endswith("?") else "."),
            epilog=f"examples:\n{examples}",
            formatter_class=formatter,
        )
        sub.add_argument("--json", action="store_true", help="print JSON instead of text")
        sub.add_argument("--quiet", action="store_true", help="no progress")
        sub.add_argument("--debug", action="store_true", help="show the whole traceback of an error")
        sub.add_argument(
            "--no-code", action="store_true", help="do not run Python code of a robot's folder (formula.py)"
        )
        return sub

    def robot(sub: argparse.ArgumentParser) -> None:
        sub.add_argument("robot", help="a built-in robot (see `twin list`), or the path of a robot folder")

    def tool(sub: argparse.ArgumentParser) -> None:
        sub.add_argument(
            "--tool",
            metavar="NAME",
            help=(
                "frame or body that is the tool of a USD stage (default: the tool that the stage defines, or the end "
                "of its longest chain)"
            ),
        )

    def host(sub: argparse.ArgumentParser) -> None:
        sub.add_argument(
            "--host",
            default="127.0.0.1",
            help=(
                "address to serve on (default 127.0.0.1: only this machine); others open the server to the network, "
                "with a one-time address for each device"
            ),
        )

    def shown(sub: argparse.ArgumentParser, port: int, what: str) -> None:
        sub.add_argument("robot", help="a built-in robot or scene, the path of a robot folder, a scene or a USD stage")
        sub.add_argument("protocol", nargs="?", help="name or path of a protocol (default: the robot's default)")
        text = f"port of the {what} (default {port}; 0: any free port)"
        sub.add_argument("--port", type=_port, default=port, help=text)
        host(sub)
        sub.add_argument("--no-browser", action="store_true", help="do not open a browser")

    def out(sub: argparse.ArgumentParser, default: str) -> None:
        sub.add_argument("--out", metavar="FOLDER", help=f"folder to write to (default {default})")

    def chosen(sub: argparse.ArgumentParser) -> None:
        group = sub.add_mutually_exclusive_group()
        group.add_argument("--protocol", metavar="NAME", help="a protocol of the robot, or the path of a protocol file")
        group.add_argument("--all-protocols", action="store_true", help="every protocol of the robot")

    def variants(sub: argparse.ArgumentParser, bare: str) -> None:
        help_ = (
            "use another variant of an equation, such as eq1=printed; a variant name alone, such as `printed`, applies "
            f"to {bare}"
        )
        sub.add_argument(
            "--variant",
            metavar="EQ=NAME",
            action="append",
            default=[],
            help=help_,
        )

    add("list", "list the built-in robots and scenes", "  twin list\n  twin list --json")

    sub = add(
        "info",
        "show a robot: joints, limits, frames, parameters with provenance; or a scene",
        "  twin info sils\n  twin info vsrs                   a scene\n"
        "  twin info pa10 --inertia        are masses and inertias physically possible?\n"
        "  twin info raven_left --motion   published equations of motion against the mechanism",
    )
    robot(sub)
    tool(sub)
    only = sub.add_mutually_exclusive_group()
    only.add_argument(
        "--motion", action="store_true", help="only compare the published equations of motion with the mechanism"
    )
    only.add_argument(
        "--inertia", action="store_true", help="only check the masses and inertias in CAD, stage and tables"
    )

    sub = add(
        "build",
        "write the USD stage of a robot from its CAD",
        "  twin build sils\n  twin build sils --check      is the committed stage current?\n"
        "  twin build sils --out stage/",
    )
    robot(sub)
    out(sub, "usd/<robot>/ in a checkout, the robot folder's usd/ otherwise")
    chosen(sub)
    sub.add_argument("--check", action="store_true", help="write nothing; exit 1 if the stage is not current")

    sub = add(
        "plan",
        "plan the timed motion of a protocol and check every sample",
        "  twin plan sils\n  twin plan sils lowered_patient --out plan/\n"
        "  twin plan pa10 --avoid vsrs        around the props and the other robots of a scene, outside the patient",
    )
    robot(sub)
    sub.add_argument("protocol", nargs="?", help="name or path of a protocol (default: the robot's default)")
    sub.add_argument(
        "--avoid",
        nargs="?",
        const="",
        metavar="SCENE",
        help="lead phases joints, positioning and home around what is in the way: props and other robots of a scene; "
        "without a scene, the robot's own bodies",
    )
    sub.add_argument(
        "--clearance-mm", type=float, default=5.0, metavar="MM", help="with --avoid: minimum distance (default: 5)"
    )
    sub.add_argument("--seed", type=int, default=0, help="with --avoid: seed of the random search (default: 0)")
    out(sub, "./twin-out/<robot>/<protocol>/")

    sub = add(
        "validate",
        "compare the equations with the mechanism",
        "  twin validate sils\n  twin validate sils --variant eq1=printed\n"
        "  twin validate sils --all-protocols --json\n"
        "  twin validate sher --sweep q5 --compare serial,mimic      over the joint range instead of along a protocol",
    )
    robot(sub)
    out(sub, "./twin-out/<robot>/<protocol>/")
    chosen(sub)
    variants(sub, "every equation that has this variant: one report for each equation, and one for all together")
    sub.add_argument(
        "--tolerance-um",
        type=float,
        metavar="UM",
        help="accuracy of the CAD in micrometres: smaller differences count as agreement (default 0.001)",
    )
    sub.add_argument(
        "--sweep",
        metavar="JOINTS",
        nargs="?",
        const="all",
        help="compare over the whole range (stroke) of these joints (default all) instead of along a protocol",
    )
    sub.add_argument(
        "--compare",
        metavar="NAMES",
        help="with --sweep: also compute the error of simplified loop models (comma-separated list of serial, mimic)",
    )

    sub = add(
        "explain",
        "show which row of which equation disagrees with the mechanism, why, and the edit that fixes it",
        "  twin explain sils                         the default variants, which agree\n"
        "  twin explain sils --variant printed       every equation as the paper prints it\n"
        "  twin explain sils --variant eq1=printed --json\n"
        "  twin explain my_robot/ --seconds 60       search longer for two edits in one row",
    )
    robot(sub)
    variants(sub, "every equation that has this variant")
    sub.add_argument(
        "--tolerance-um",
        type=float,
        metavar="UM",
        help="accuracy of the CAD in micrometres: smaller differences count as agreement (default 0.001)",
    )
    sub.add_argument(
        "--seconds",
        type=float,
        default=8.0,
        metavar="S",
        help="time limit in seconds of the search for two edits in one row (assignment) of an equation (default 8)",
    )

    sub = add(
        "run",
        "build, plan and validate: from CAD to report in one command",
        "  twin run sils\n  twin run sils --protocol lowered_patient --out demo/",
    )
    robot(sub)
    out(sub, "./twin-out/<robot>/")
    chosen(sub)

    sub = add(
        "view",
        "show a robot in the browser: play, drag, measure, redesign",
        "  twin view sils\n  twin view sher phantom            plan and play the protocol `phantom`\n"
        "  twin view vsrs                    a scene of several robots\n"
        "  twin view davinci                 a scene that is controlled from its console\n"
        "  twin view davinci --task pegboard       with rings to grasp\n"
        "  twin view my_robot/ --port 8090 --no-browser\n"
        "  twin view usd/pa10/pa10.usda      a USD stage without a robot folder\n"
        "  twin view sils --html sils.html   a recording that plays without Python",
    )
    shown(sub, 8080, "page")
    tool(sub)
    sub.add_argument("--html", metavar="FILE", help="write a recording of the protocol and exit")
    sub.add_argument("--task", metavar="NAME", help="task at the console of a scene: its rings can be grasped")
    _by_hand(sub)
    sub.add_argument(
        "--watch", type=_port, metavar="PORT", help="only show what a running twin serve of this scene simulates"
    )

    sub = add(
        "serve",
        "serve a robot or a scene to headsets and browsers: place it in the room, play, grab it",
        "  twin serve sils                     for a Quest by USB cable, first: adb reverse tcp:8765 tcp:8765\n"
        "  twin serve sher phantom --no-browser\n"
        "  twin serve my_robot/                your own robot; a USD stage also works\n"
        "  twin serve vsrs                     all robots of a scene, with one clock\n"
        "  twin serve davinci                  instruments and camera, controlled from the page or the headset\n"
        "  twin serve davinci --task pegboard            rings to grasp, with a scoreboard\n"
        "  twin serve davinci --packets 9870 --mqtt 127.0.0.1    also by UDP packets; motion scale by MQTT\n"
        "  twin serve sils --host 0.0.0.0 --cert cert.pem --key key.pem    for every headset in the network\n"
        "  twin serve sils --record session.json        record requests and what clients see\n"
        "  twin serve sils --replay session.json\n"
        "  twin serve davinci --session hands.session    record the hands at a console, for twin session\n"
        "  twin serve davinci --session p7-1.session --participant 7 --run 1    a study: one of two runs has forces",
    )
    shown(sub, 8765, "server")
    sub.add_argument("--record", metavar="FILE", help="record the session: requests, states and frames, as JSON")
    sub.add_argument("--replay", metavar="FILE", help="replay a session recorded by --record, frame by frame")
    sub.add_argument("--task", metavar="NAME", help="task at the console of a scene: its rings can be grasped")
    sub.add_argument(
        "--packets",
        type=_packets,
        metavar="[HOST:]PORT",
        help="UDP port for hand states from other programs, for a scene with a console (docs/console.md, Packets)",
    )
    sub.add_argument(
        "--mqtt",
        type=_broker,
        metavar="HOST[:PORT]",
        help="MQTT broker for the motion scale of a scene with a console (default port 1883)",
    )
    sub.add_argument(
        "--mqtt-topic",
        metavar="TOPIC",
        help="topic of the motion scale; messages to TOPIC/set change the scale (default twin/<scene>/scale)",
    )
    sub.add_argument(
        "--session", metavar="FILE", help="record the motion of the hands at a console; twin session replays the file"
    )
    sub.add_argument("--cert", metavar="FILE", help="certificate (PEM) for https, which headsets require for AR")
    sub.add_argument(
        "--key", metavar="FILE", help="private key (PEM) of the certificate, if it is not in the same file"
    )

    sub.add_argument("--haptics", choices=("on", "off"), help="forces on the hands at the start (default: the scene's)")
    _by_hand(sub)
    sub.add_argument(
        "--participant", type=int, metavar="N", help="number of a participant in a study; chooses the run with forces"
    )
    sub.add_argument("--run", type=int, metavar="1|2", help="number of the participant's run: only one has forces")

    sub = add(
        "operate",
        "simulate an operator (hands, pedals) who performs a protocol or a task, and measure the result",
        "  twin operate sher phantom\n  twin operate sher phantom --trials 5 --seed 10 --json\n"
        "  twin operate sher phantom --clutch printed      the published clutch, with which the tool jumps\n"
        "  twin operate sils lowered_patient --scale 0.5\n"
        "  twin operate davinci --seed 3       a surgeon with two hands, clutch and camera at a scene's console\n"
        "  twin operate davinci --task pegboard      rings from pegs to pegs, held by friction\n"
        "  twin operate vsrs --task cholecystectomy  a gallbladder taken out in five stages",
    )
    sub.add_argument("robot", help="a built-in robot, the path of a robot folder, or a scene with a task")
    sub.add_argument("protocol", nargs="?", help="name or path of a protocol (default: the robot's default)")
    sub.add_argument("--task", metavar="NAME", help="task of a scene (default: its first task)")
    sub.add_argument(
        "--mistake",
        metavar="NAME",
        help="mistake that the surgeon of a procedure makes: clip_missed, wrong_vessel, organ_punctured, cut_outside, "
        "bed_left",
    )
    sub.add_argument(
        "--haptics", choices=("on", "off"), help="compute forces on the hands (the operator does not react)"
    )
    out(sub, "./twin-out/<robot>/<protocol>-operator/")
    sub.add_argument(
        "--seed", type=int, default=0, help="random seed of the simulated hand (default 0); each further trial adds 1"
    )
    sub.add_argument("--trials", type=int, default=1, metavar="N", help="number of trials (default 1)")
    sub.add_argument(
        "--scale",
        type=float,
        metavar="S",
        help=(
            "ratio of tool motion to hand motion (default 0.1, ASSUMED, because the paper states none; at a console "
            "the scene's scale); rotations are not scaled"
        ),
    )
    sub.add_argument(
        "--clutch",
        choices=("corrected", "printed"),
        default="corrected",
        help="clutch of the SHER simulation paper, eq. (7): corrected (default), or as printed",
    )
    sub.add_argument(
        "--solver", choices=("damped", "slsqp"), default="damped", help="solver of the joint steps (default damped)"
    )

    sub = add(
        "session",
        "replay a session recorded at a console, compare it bit by bit, measure it, export it",
        "  twin session hands.session\n  twin session hands.session --json\n"
        "  twin session hands.session --out session/       page, plots, CSV, tracks, GLB, MCAP",
    )
    sub.add_argument("file", help="a file of twin serve --session, or hands.session of twin operate")
    sub.add_argument(
        "--scene", metavar="SCENE", help="path of the session's scene (default: the built-in scene that it names)"
    )
    sub.add_argument("--out", metavar="FOLDER", help="folder to write to (default: nothing is written)")

    sub = add(
        "track",
        "simulate computed-torque control along a protocol, and the tip error caused by model mismatch",
        "  twin track pa10\n  twin track pa10 circle --mismatch 10 --curve\n"
        "  twin track pa10 --inertia cad --plant pinocchio --json",
    )
    robot(sub)
    sub.add_argument("protocol", nargs="?", help="name or path of a protocol (default: the robot's default)")
    out(sub, "./twin-out/<robot>/<protocol>-track/")
    sub.add_argument(
        "--mismatch",
        type=float,
        default=5.0,
        metavar="PERCENT",
        help="error of masses and inertia tensors in the controller's model in percent (default 5)",
    )
    sub.add_argument(
        "--plant", choices=("mujoco", "pinocchio"), default="mujoco", help="simulator of the robot (default mujoco)"
    )
    sub.add_argument(
        "--inertia",
        choices=("cited", "cad"),
        help=(
            "source of masses and inertia tensors: cited in inertia.toml (default if it exists), or computed from the "
            "CAD"
        ),
    )
    sub.add_argument("--curve", action="store_true", help="also compute the tip error for model errors of -20..20 %%")

    sub = add(
        "study",
        "check a paper's tables: do totals and p-values follow from the printed rows?",
        "  twin study sher\n  twin study pa10                 inertia tables: are they physically possible?\n"
        "  twin study davinci              groups of users, and the accuracy of a console\n"
        "  twin study my_study.toml --json\n  twin study users.csv            your own groups, with rank tests\n"
        "  twin study users.csv --out study/           also a page with box plots and learning curves\n"
        "  twin study first=a.session first=b.session last=c.session last=d.session    sessions at a console",
    )
    sub.add_argument(
        "subject",
        nargs="+",
        help="a built-in robot or study, a robot folder, a study file, a CSV of users, or sessions as GROUP=FILE",
    )
    sub.add_argument("--out", metavar="FOLDER", help="write a page, a figure and the data of groups into this folder")

    sub = add(
        "console",
        "check the published equations of a surgeon's console: hands, clutch, camera, forces",
        "  twin console davinci                             the corrected reading of the equations\n"
        "  twin console davinci --variant paper             every equation as printed\n"
        "  twin console davinci --variant conjugate         eq. (2) as a complete change of frame\n"
        "  twin console davinci --variant eq4=paper --json",
    )
    sub.add_argument("console", help="a console: davinci")
    sub.add_argument(
        "--variant",
        metavar="EQ=NAME",
        action="append",
        default=[],
        help=(
            "use another reading of an equation, such as eq4=paper, or of all equations: paper, conjugate or decoupled"
        ),
    )
    out(sub, "./twin-out/<console>/console-<variant>/")

    sub = add(
        "new",
        "create a robot folder from URDF, MJCF, SDF, a USD stage, or the STEP file of an assembly",
        "  twin new leg --from robot.urdf                   loops from robot.yaml in the same folder\n"
        "  twin new gripper --from gripper.xml --out robots/gripper/\n"
        "  twin new arm.step                                an incomplete robot: joints are proposed as comments",
    )
    sub.add_argument("name", help="name of the robot (lower-case letters, digits and _), or the file to read")
    sub.add_argument("--from", dest="source", metavar="FILE", help=".urdf, .xml (MJCF), .sdf, .usd* or .step")
    sub.add_argument(
        "--closures", metavar="FILE", help="closure YAML of a URDF (default: the .yaml file of the same name)"
    )
    sub.add_argument(
        "--root",
        metavar="NAME",
        help="robot to read, if the file has several: prim path (USD), model (SDF) or body (MJCF)",
    )
    sub.add_argument("--force", action="store_true", help="overwrite a robot folder; equations and protocols are kept")
    out(sub, "./<name>/")

    sub = add(
        "export",
        "export a robot with its motions for headsets, game engines and simulators, and check the files",
        "  twin export sils                              every format, every protocol\n"
        "  twin export sils --to glb,tracks --out xr/\n"
        "  twin export sils --protocol lowered_patient --budget-um 20\n"
        "  twin export my_robot/ --json\n"
        "  twin export usd/pa10/pa10_circle.usda         a stage, with its baked motion\n"
        "  twin export vsrs                              a scene: each robot at its place, and all in one stage",
    )
    sub.add_argument("robot", help="a built-in robot or scene, the path of a robot folder, a scene or a USD stage")
    tool(sub)
    out(sub, "./twin-out/<robot>/export/")
    sub.add_argument(
        "--to",
        metavar="FORMATS",
        help="comma-separated list of usd, usdz, glb, unity, tracks, mjcf, urdf (default all)",
    )
    group = sub.add_mutually_exclusive_group()
    group.add_argument(
        "--protocol",
        metavar="NAME",
        action="append",
        help="a protocol of the robot, or the path of a protocol file; may be given more than once",
    )
    group.add_argument("--all-protocols", action="store_true", help="every protocol of the robot (the default)")
    sub.add_argument(
        "--budget-um",
        type=float,
        metavar="UM",
        help="maximum error of link points and joint gaps between keys in micrometres "
        "(default 100; the limit of rotation scales with it, 0.05 degrees at 100); determines the key rate",
    )

    sub = add(
        "audit",
        "check exported files, including those of other tools, with independent readers, and compare the files",
        "  twin audit twin-out/sils/export/\n  twin audit twin-out/sils/export/ --robot sils    against the mechanism\n"
        "  twin audit model.glb              a file from any source\n  twin audit robot.usdz --json",
    )
    sub.add_argument("path", help="a folder, or a .glb, .gltf, USD, .usdz, track, MJCF or URDF file")
    sub.add_argument("--robot", metavar="NAME", help="recompute the poses from this robot's mechanism: name or folder")
    sub.add_argument("--all", action="store_true", help="show notes and all checks, not only the worst of each kind")

    sub = add(
        "selftest",
        "seed faults into a correct robot, and measure how many the validator finds (mutation score)",
        "  twin selftest sils                            equations, CAD, USD, units, timing\n"
        "  twin selftest sils --family formula,cad --count 60 --seed 7\n"
        "  twin selftest my_robot/ --json",
    )
    robot(sub)
    sub.add_argument("--protocol", metavar="NAME", help="the protocol (default: the robot's default protocol)")
    sub.add_argument(
        "--family", metavar="NAMES", help="comma-separated list of formula, cad, usd, units, timing (default all)"
    )
    sub.add_argument("--count", type=int, default=118, metavar="N", help="number of faults (default 118)")
    sub.add_argument("--seed", type=int, default=0, help="random seed (default 0)")
    out(sub, "./twin-out/<robot>/")

    add_sweeps(add, robot, out)

    _machine(add, robot)
    _hazards(add, robot)
    add("doctor", "list the installed packages and programs, and their purposes", "  twin doctor")
    return root
