"""Define the command line: commands, options, their help and examples."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from functools import cache
from typing import Any, NoReturn

from twin import __version__
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
NAMES += ("workspace", "tolerance", "sweep", "machine", "follow", "hazards", "doctor")
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


class _Command(_Parser):
    """Parser of one command, with the arguments that several commands have."""

    def flag(self, name: str, text: str) -> None:
        """Add an option without a value."""
        self.add_argument(name, action="store_true", help=text)

    def text(self, name: str, metavar: str, text: str, **more: Any) -> None:
        """Add an option with a value, by default a text; `more` are arguments of `add_argument`."""
        self.add_argument(name, metavar=metavar, help=text, **more)

    def number(
        self, name: str, metavar: str, text: str, default: float | None = None, kind: Callable[[str], float] = float
    ) -> None:
        """Add an option with a number; the help states the default, if there is one."""
        shown = "" if default is None else f" (default {default:.12g})"
        self.add_argument(name, type=kind, default=default, metavar=metavar, help=text + shown)

    def integer(self, name: str, text: str, default: int | None = None, metavar: str = "N") -> None:
        """Add an option with a whole number, as `number` does."""
        self.number(name, metavar, text, default, int)

    def choice(self, name: str, choices: tuple[str, ...], text: str, default: str | None = None) -> None:
        """Add an option with a few possible values."""
        self.add_argument(name, choices=choices, default=default, help=text)

    def robot(self, text: str = "a built-in robot (see `twin list`), or the path of a robot folder") -> None:
        """Add the robot as the first argument."""
        self.add_argument("robot", help=text)

    def protocol(self) -> None:
        """Add a protocol as the second argument."""
        text = "name or path of a protocol (default: the robot's default)"
        self.add_argument("protocol", nargs="?", help=text)

    def protocols(self) -> None:
        """Add the options --protocol and --all-protocols, which exclude each other."""
        group = self.add_mutually_exclusive_group()
        group.add_argument("--protocol", metavar="NAME", help="a protocol of the robot, or the path of a protocol file")
        group.add_argument("--all-protocols", action="store_true", help="every protocol of the robot")

    def variants(self, text: str) -> None:
        """Add the option --variant."""
        self.text("--variant", "EQ=NAME", text, action="append", default=[])

    def out(self, default: str) -> None:
        """Add the option --out."""
        self.text("--out", "FOLDER", f"folder to write to (default {default})")

    def software(self) -> None:
        """Add the options of a machine's control software."""
        self.choice("--mode", ("advanced", "moderate", "beginner"), "set of DAC limits in machine.toml")
        text = "action for DAC commands above the limits: count (none), clip (soft), or stop after too many (hard)"
        self.choice("--overdrive", ("none", "soft", "hard"), text)
        text = "comma-separated list of the faults of the released software to reproduce: shared_counter, "
        text += "rates_without_coupling, whole_counts; or none (default: as in machine.toml)"
        self.text("--released", "NAMES", text)

    def tool(self) -> None:
        """Add the option --tool."""
        text = "frame or body that is the tool of a USD stage (default: the tool that the stage defines, or the end of "
        self.text("--tool", "NAME", text + "its longest chain)")

    def page(self, port: int, what: str) -> None:
        """Add the arguments of a page in a browser."""
        self.robot(_SHOWN)
        self.protocol()
        self.address(port, what)
        self.text("--task", "NAME", "task at the console of a scene, such as pegboard with rings to grasp")
        text = "end of an instrument that the hand moves: the tip (compensated, default), or the end outside the port, "
        text += "so that the port inverts the motion of the tip (direct)"
        self.choice("--fulcrum", ("compensated", "direct"), text)
        self.flag("--protocols", "play the protocols of a scene that has a console")
        self.machines()

    def address(self, port: int, what: str) -> None:
        """Add the address of a page in a browser."""
        text = f"port of the {what} (default {port}; 0: any free port)"
        self.add_argument("--port", type=_port, default=port, help=text)
        text = (
            "address to serve on (default 127.0.0.1: reachable only from this computer); any other address opens the "
            "server to the network, with a one-time link for each device"
        )
        self.add_argument("--host", default="127.0.0.1", help=text)
        self.flag("--no-browser", "do not open a browser")

    def machines(self) -> None:
        """Add the option for machines that run already."""
        text = (
            "robot of the scene whose `twin machine` is already running, with its host, UDP port of packets and TCP "
            "port of states; this command starts the other machines"
        )
        self.text("--machine", "ROBOT=HOST:PORT:STATEPORT", text, action="append")

    def accuracy(self) -> None:
        """Add the option --tolerance-um."""
        text = "accuracy of the CAD in micrometres: smaller differences count as agreement (default 0.001)"
        self.number("--tolerance-um", "UM", text)

    def scheduler(self) -> None:
        """Add the option --scheduler."""
        text = "address of a Dask scheduler, as in tcp://10.0.0.1:8786, or `local` for Dask worker processes on this "
        self.text("--scheduler", "ADDRESS", text + "machine")


_SHOWN = "a built-in robot or scene, the path of a robot folder, a scene or a USD stage"
_TROCAR = "protocol with the position of the trocar (if any)"


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


def _count(text: str) -> int:
    """Convert a text, such as 1000 or 1e7, to a whole number."""
    value = float(text)
    if value != round(value):
        raise ValueError
    return int(value)


@cache
def parser() -> argparse.ArgumentParser:
    """Return the parser of the whole command line; it is built once, for programs that run many commands."""
    root = _Parser(
        prog="twin",
        description="Compare the equations of a robot with its CAD, and show where they disagree.",
        epilog=_EPILOG,
        formatter_class=_Help,
    )
    root.add_argument("--version", action="version", version=f"twin {__version__}")
    commands = root.add_subparsers(dest="command", required=True, metavar="COMMAND", parser_class=_Command)

    def add(name: str, text: str, examples: str) -> _Command:
        sub = commands.add_parser(
            name,
            help=text,
            description=text[0].upper() + text[1:] + ("" if text.endswith("?") else "."),
            epilog=f"examples:\n{examples}",
            formatter_class=_Help,
        )
        sub.flag("--json", "print JSON instead of text")
        sub.flag("--quiet", "no progress")
        sub.flag("--debug", "show the whole traceback of an error")
        sub.flag("--no-code", "do not run Python code of a robot's folder (formula.py)")
        return sub

    add("list", "list the built-in robots and scenes", "  twin list\n  twin list --json")
    for commands_of in (_models, _checks, _pages, _trials, _files, _analyses):
        commands_of(add)
    add("doctor", "list the installed packages and programs, and their purposes", "  twin doctor")
    return root


Add = Callable[[str, str, str], _Command]
"""Function that creates a command from its name, its help and its examples."""


def _models(add: Add) -> None:
    """Add the commands that show a robot, build its stage and plan its motion."""
    sub = add(
        "info",
        "show a robot: joints, limits, frames, parameters with provenance; or a scene",
        "  twin info sils\n  twin info vsrs                   a scene\n"
        "  twin info pa10 --inertia        are masses and inertias physically possible?\n"
        "  twin info raven_left --motion   published equations of motion against the mechanism",
    )
    sub.robot()
    sub.tool()
    only = sub.add_mutually_exclusive_group()
    for name, text in (
        ("--motion", "only compare the published equations of motion with the mechanism"),
        ("--inertia", "only check the masses and inertias in CAD, stage and tables"),
    ):
        only.add_argument(name, action="store_true", help=text)

    sub = add(
        "build",
        "write the USD stage of a robot from its CAD",
        "  twin build sils\n  twin build sils --check      is the committed stage current?\n"
        "  twin build sils --out stage/",
    )
    sub.robot()
    sub.out("usd/<robot>/ in a checkout, the robot folder's usd/ otherwise")
    sub.protocols()
    sub.flag("--check", "write nothing; exit 1 if the stage is not current")

    sub = add(
        "plan",
        "plan the timed motion of a protocol and check every sample",
        "  twin plan sils\n  twin plan sils lowered_patient --out plan/\n"
        "  twin plan pa10 --avoid vsrs        around the props and the other robots of a scene, outside the patient\n"
        "  twin plan raven_left left.toml --avoid raven --with raven_right=right.toml        two arms at once",
    )
    sub.robot()
    sub.protocol()
    text = (
        "plan phases of the types joints, positioning and home around obstacles: props and other robots of a scene; "
        "without a scene, the robot's own bodies"
    )
    sub.text("--avoid", "SCENE", text, nargs="?", const="")
    sub.text(
        "--with",
        "ROBOT=PROTOCOL",
        "with --avoid SCENE: also plan these robots of the scene, separated by commas. The first phases of all "
        "protocols begin and end together, then the second ones. A robot avoids those before it; they may wait for it",
        dest="beside",
    )
    sub.number("--clearance-mm", "MM", "with --avoid: required minimum distance between bodies", 5.0)
    sub.integer("--seed", "with --avoid: seed of the random search", 0)
    sub.out("./twin-out/<robot>/<protocol>/")


def _checks(add: Add) -> None:
    """Add the commands that compare equations with the mechanism."""
    variant = (
        "use another variant of an equation, such as eq1=printed; a variant name alone, such as `printed`, applies to "
        "every equation that has this variant"
    )
    sub = add(
        "validate",
        "compare the equations with the mechanism",
        "  twin validate sils\n  twin validate sils --variant eq1=printed\n"
        "  twin validate sils --all-protocols --json\n"
        "  twin validate sher --sweep q5 --compare serial,mimic      over the joint range instead of along a protocol",
    )
    sub.robot()
    sub.out("./twin-out/<robot>/<protocol>/")
    sub.protocols()
    sub.variants(f"{variant}: one report for each equation, and one for all together")
    sub.accuracy()
    text = "compare over the whole range (stroke) of these joints (default all) instead of along a protocol"
    sub.text("--sweep", "JOINTS", text, nargs="?", const="all")
    text = "with --sweep: also compute the error of simplified loop models (comma-separated list of serial, mimic)"
    sub.text("--compare", "NAMES", text)

    sub = add(
        "explain",
        "show which row of which equation disagrees with the mechanism, why, and the edit that fixes it",
        "  twin explain sils                         the default variants, which agree\n"
        "  twin explain sils --variant printed       every equation as the paper prints it\n"
        "  twin explain sils --variant eq1=printed --json\n"
        "  twin explain my_robot/ --seconds 60       search longer for two edits in one row",
    )
    sub.robot()
    sub.variants(variant)
    sub.accuracy()
    text = "time limit in seconds of the search for two edits in one row (assignment) of an equation"
    sub.number("--seconds", "S", text, 8.0)

    sub = add(
        "run",
        "build, plan and validate: from CAD to report in one command",
        "  twin run sils\n  twin run sils --protocol lowered_patient --out demo/",
    )
    sub.robot()
    sub.out("./twin-out/<robot>/")
    sub.protocols()

    sub = add(
        "selftest",
        "seed faults into a correct robot, and measure how many the validator finds (mutation score)",
        "  twin selftest sils                            equations, CAD, USD, units, timing\n"
        "  twin selftest sils --family formula,cad --count 60 --seed 7\n"
        "  twin selftest my_robot/ --json",
    )
    sub.robot()
    sub.text("--protocol", "NAME", "the protocol (default: the robot's default protocol)")
    sub.text("--family", "NAMES", "comma-separated list of formula, cad, usd, units, timing (default all)")
    sub.integer("--count", "number of faults", 118)
    sub.integer("--seed", "random seed", 0)
    sub.out("./twin-out/<robot>/")


def _pages(add: Add) -> None:
    """Add the commands that show a robot in a browser or a headset."""
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
    sub.page(8080, "page")
    sub.tool()
    sub.text("--html", "FILE", "write a recording of the protocol and exit")
    sub.text("--watch", "PORT", "only show the simulation of a running twin serve of this scene", type=_port)

    sub = add(
        "serve",
        "serve a robot or a scene to headsets and browsers: place it in the room, play, grab it",
        "  twin serve sils                     for a Quest by USB cable, first: adb reverse tcp:8765 tcp:8765\n"
        "  twin serve sher phantom --no-browser\n"
        "  twin serve my_robot/                your own robot; a USD stage also works\n"
        "  twin serve vsrs                     all robots of a scene, with one clock\n"
        "  twin serve davinci                  instruments and camera, controlled from the page or the headset\n"
        "  twin serve davinci --task pegboard            rings to grasp, with a scoreboard\n"
        "  twin serve raven_dome --task ring             a ring to hand over and to guide in a dome\n"
        "  twin serve davinci --packets 9870 --mqtt 127.0.0.1    also by UDP packets; motion scale by MQTT\n"
        "  twin serve sils --host 0.0.0.0 --cert cert.pem --key key.pem    for every headset in the network\n"
        "  twin serve sils --record session.json        record requests and what clients see\n"
        "  twin serve sils --replay session.json\n"
        "  twin serve davinci --session hands.session    record the hands at a console, for twin session\n"
        "  twin serve davinci --session p7-1.session --participant 7 --run 1    a study: one of two runs has forces",
    )
    sub.page(8765, "server")
    sub.text("--record", "FILE", "record the session: requests, states and frames, as JSON")
    sub.text("--replay", "FILE", "replay a session recorded by --record, frame by frame")
    text = "UDP port for hand states from other programs, for a scene with a console (docs/console.md, Packets)"
    sub.text("--packets", "[HOST:]PORT", text, type=_packets)
    text = "MQTT broker for the motion scale of a scene with a console (default port 1883)"
    sub.text("--mqtt", "HOST[:PORT]", text, type=_broker)
    text = "topic of the motion scale; messages to TOPIC/set change the scale (default twin/<scene>/scale)"
    sub.text("--mqtt-topic", "TOPIC", text)
    sub.text("--session", "FILE", "record the motion of the hands at a console; twin session replays the file")
    sub.text("--cert", "FILE", "certificate (PEM) for https, which headsets require for AR")
    sub.text("--key", "FILE", "private key (PEM) of the certificate, if it is not in the same file")
    sub.choice("--haptics", ("on", "off"), "forces on the hands at the start (default: as in the scene file)")
    sub.integer("--participant", "number of the participant in a study; determines which run has forces")
    sub.integer("--run", "number of the participant's run; one of the two runs has forces", metavar="1|2")


def _trials(add: Add) -> None:
    """Add the commands that simulate operators, controllers and machines, and evaluate sessions and studies."""
    sub = add(
        "operate",
        "simulate an operator (hands, pedals) who performs a protocol or a task, and measure the result",
        "  twin operate sher phantom\n  twin operate sher phantom --trials 5 --seed 10 --json\n"
        "  twin operate sher phantom --clutch printed      the published clutch, with which the tool jumps\n"
        "  twin operate sils lowered_patient --scale 0.5\n"
        "  twin operate davinci --seed 3       a surgeon with two hands, clutch and camera at a scene's console\n"
        "  twin operate davinci --task pegboard      rings from pegs to pegs, held by friction\n"
        "  twin operate raven_dome                   a ring handed over and guided along a wire\n"
        "  twin operate vsrs --task cholecystectomy  a gallbladder taken out in five stages\n"
        "  twin operate raven --trials 3       machines by teleoperation, then a motion rehearsed in their models",
    )
    sub.robot("a built-in robot, the path of a robot folder, or a scene with a task")
    sub.protocol()
    sub.text("--task", "NAME", "task of a scene (default: its first task)")
    mistakes = "clip_missed, wrong_vessel, organ_punctured, cut_outside, bed_left"
    guided = "dropped, not_handed_over, stopped_short, wire_touched, wall_hit, left_inside"
    text = f"mistake that the surgeon makes. In a procedure: {mistakes}; with a ring to guide: {guided}"
    sub.text("--mistake", "NAME", text)
    sub.choice("--haptics", ("on", "off"), "compute forces on the hands (the operator does not react)")
    sub.out("./twin-out/<robot>/<protocol>-operator/")
    sub.integer("--seed", "random seed of the simulated hand; each further trial adds 1", 0)
    sub.integer("--trials", "number of trials, or of motions of a machine", 1)
    sub.machines()
    text = (
        "ratio of tool motion to hand motion (default 0.1, ASSUMED, because the paper states none; at a console the "
        "scene's scale); rotations are not scaled"
    )
    sub.number("--scale", "S", text)
    text = "clutch of the SHER simulation paper, eq. (7): corrected (default), or as printed"
    sub.choice("--clutch", ("corrected", "printed"), text, "corrected")
    sub.choice("--solver", ("damped", "slsqp"), "solver of the joint steps (default damped)", "damped")

    sub = add(
        "session",
        "replay a session recorded at a console, compare it bit by bit, measure it, export it",
        "  twin session hands.session\n  twin session hands.session --json\n"
        "  twin session hands.session --out session/       page, plots, CSV, tracks, GLB, MCAP",
    )
    sub.add_argument("file", help="a file of twin serve --session, or hands.session of twin operate")
    sub.text("--scene", "SCENE", "path of the session's scene (default: the built-in scene named in the file)")
    sub.text("--out", "FOLDER", "folder to write to (default: nothing is written)")

    sub = add(
        "track",
        "simulate computed-torque control along a protocol, and the tip error caused by model mismatch",
        "  twin track pa10\n  twin track pa10 circle --mismatch 10 --curve\n"
        "  twin track pa10 --inertia cad --plant pinocchio --json",
    )
    sub.robot()
    sub.protocol()
    sub.out("./twin-out/<robot>/<protocol>-track/")
    text = "error of masses and inertia tensors in the controller's model in percent"
    sub.number("--mismatch", "PERCENT", text, 5.0)
    sub.choice("--plant", ("mujoco", "pinocchio"), "simulator of the robot (default mujoco)", "mujoco")
    text = (
        "source of masses and inertia tensors: cited in inertia.toml (default if it exists), or computed from the CAD"
    )
    sub.choice("--inertia", ("cited", "cad"), text)
    sub.flag("--curve", "also compute the tip error for model errors of -20..20 %%")

    sub = add(
        "machine",
        "simulate a robot as a machine (control software, motors and links at 1 kHz): commands by UDP, states by TCP",
        "  twin machine raven_left --port 36000 --state-port 36001 --start\n"
        "  twin machine raven_left --mass-error 5 --friction-error 20 --overdrive hard",
    )
    sub.robot()
    for name, text in (("--port", "UDP port of the packets"), ("--state-port", "TCP port of the states")):
        sub.add_argument(name, type=_port, default=0, help=f"{text} (default 0: any free port)")
    sub.flag("--start", "press the start button at once")
    sub.number("--duration", "S", "running time in seconds (default: run until Ctrl-C)")
    sub.software()
    sub.number("--master-timeout-ms", "MS", "time without packets after which the pedal counts as up")
    text = "difference of the machine's masses from the masses in its software, in percent"
    sub.number("--mass-error", "PERCENT", text, 0.0)
    text = "difference of the machine's friction from the friction in its software, in percent"
    sub.number("--friction-error", "PERCENT", text, 0.0)
    sub.number("--tilt-deg", "DEG", "rotation of the machine's base about its x axis, unknown to its software", 0.0)

    sub = add(
        "follow",
        "show a machine live: its measured pose, its desired pose as a ghost, and a plot of their deviation",
        "  twin follow raven_left --states 127.0.0.1:36001      a machine that `twin machine` runs\n"
        "  twin follow pa10 --packets 36002                     joint values by UDP (docs/raven.md, Follow)\n"
        "  twin follow raven_left --states 36001 --view         in the page of twin view",
    )
    sub.robot()
    sub.text("--states", "[HOST:]PORT", "TCP port of the states of a `twin machine`")
    sub.text("--packets", "PORT", "UDP port for joint packets (0: any free port)", type=_port)
    sub.flag("--view", "show the page of twin view instead of that of twin serve")
    sub.address(8766, "page")
    sub.set_defaults(record=None, replay=None, session=None)

    sub = add(
        "hazards",
        "run a fault-injection campaign on the machine of a robot; the same command resumes an interrupted campaign",
        "  twin hazards raven_left --campaign table1\n"
        "  twin hazards pa10 --sessions 100 --processes 1\n"
        "  twin hazards raven_left --overdrive hard --released none --out hard\n"
        "  twin hazards raven_left --trends",
    )
    sub.robot()
    sub.software()
    text = "instead of a campaign, run the two experiments of the paper: deviation at each motion scale, and deviation "
    text += "with the command of the first motor stuck every 8 s"
    sub.flag("--trends", text)
    text = "name of a campaign of the robot, or path of a file (default table1)"
    sub.text("--campaign", "NAME", text, default="table1")
    sub.integer("--sessions", "maximum number of sessions to run now (default: all that are not yet in the log)")
    sub.integer("--processes", "number of processes (default: number of processors)")
    sub.out("./twin-out/<robot>/<name>-hazards/")

    sub = add(
        "study",
        "check a paper's tables: do totals and p-values follow from the printed rows?",
        "  twin study sher\n  twin study pa10                 inertia tables: are they physically possible?\n"
        "  twin study davinci              groups of users, and the accuracy of a console\n"
        "  twin study my_study.toml --json\n  twin study users.csv            your own groups, with rank tests\n"
        "  twin study users.csv --out study/           also a page with box plots and learning curves\n"
        "  twin study first=a.session first=b.session last=c.session last=d.session    sessions at a console",
    )
    text = "a built-in robot or study, a robot folder, a study file, a CSV of users, or sessions as GROUP=FILE"
    sub.add_argument("subject", nargs="+", help=text)
    sub.text("--out", "FOLDER", "write a page, a figure and the data of groups into this folder")

    sub = add(
        "console",
        "check the published equations of a surgeon's console: hands, clutch, camera, forces",
        "  twin console davinci                             the corrected reading of the equations\n"
        "  twin console davinci --variant paper             every equation as printed\n"
        "  twin console davinci --variant conjugate         eq. (2) as a complete change of frame\n"
        "  twin console davinci --variant eq4=paper --json",
    )
    sub.add_argument("console", help="a console: davinci")
    text = "use another reading of an equation, such as eq4=paper, or of all equations: paper, conjugate or decoupled"
    sub.variants(text)
    sub.out("./twin-out/<console>/console-<variant>/")


def _files(add: Add) -> None:
    """Add the commands that read, write and check files of other programs."""
    sub = add(
        "new",
        "create a robot folder from URDF, MJCF, SDF, a USD stage, or the STEP file of an assembly",
        "  twin new leg --from robot.urdf                   loops from robot.yaml in the same folder\n"
        "  twin new gripper --from gripper.xml --out robots/gripper/\n"
        "  twin new arm.step                                an incomplete robot: joints are proposed as comments",
    )
    sub.add_argument("name", help="name of the robot (lower-case letters, digits and _), or the file to read")
    sub.text("--from", "FILE", ".urdf, .xml (MJCF), .sdf, .usd* or .step", dest="source")
    sub.text("--closures", "FILE", "closure YAML of a URDF (default: the .yaml file of the same name)")
    text = "robot to read, if the file has several: prim path (USD), model (SDF) or body (MJCF)"
    sub.text("--root", "NAME", text)
    sub.flag("--force", "overwrite a robot folder; equations and protocols are kept")
    sub.out("./<name>/")

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
    sub.robot(_SHOWN)
    sub.tool()
    sub.out("./twin-out/<robot>/export/")
    sub.text("--to", "FORMATS", "comma-separated list of usd, usdz, glb, unity, tracks, mjcf, urdf (default all)")
    group = sub.add_mutually_exclusive_group()
    text = "a protocol of the robot, or the path of a protocol file; may be given more than once"
    group.add_argument("--protocol", metavar="NAME", action="append", help=text)
    group.add_argument("--all-protocols", action="store_true", help="every protocol of the robot (the default)")
    text = (
        "maximum position error between keys in micrometres, of link points and joint gaps (default 100); determines "
        "the key rate. The limit of the rotation error is proportional: 0.05 degrees at 100 micrometres"
    )
    sub.number("--budget-um", "UM", text)

    sub = add(
        "audit",
        "check exported files, also from other tools, with independent readers, and compare the files",
        "  twin audit twin-out/sils/export/\n  twin audit twin-out/sils/export/ --robot sils    against the mechanism\n"
        "  twin audit model.glb              a file from any source\n  twin audit robot.usdz --json",
    )
    sub.add_argument("path", help="a folder, or a .glb, .gltf, USD, .usdz, track, MJCF or URDF file")
    sub.text("--robot", "NAME", "recompute the poses from this robot's mechanism: name or folder")
    sub.flag("--all", "show notes and all checks, not only the worst of each kind")


def _analyses(add: Add) -> None:
    """Add the commands that evaluate the design of a robot."""
    sub = add(
        "workspace",
        "compute the workspace: volume, conditioning, margins to limits and singularities",
        "  twin workspace sils                              a million positions in the home orientation\n"
        "  twin workspace sils --count 1e7 --tilt-deg 20 --turns 50\n"
        "  twin workspace pa10 --joints                     by sampling the joint ranges instead\n"
        "  twin workspace my_robot/ --step-mm 2 --scheduler tcp://10.0.0.1:8786",
    )
    sub.robot()
    sub.text("--protocol", "NAME", _TROCAR)
    sub.number("--count", "N", "total number of poses", 1_000_000, _count)
    sub.number("--step-mm", "MM", "distance between positions, instead of --count")
    sub.number("--tilt-deg", "DEG", "maximum rotation of the tool about each axis", 0.0)
    sub.integer("--turns", "number of orientations at each position", 30)
    text = "sample joint values instead of poses (always done for equations without a closed-form inverse)"
    sub.flag("--joints", text)
    sub.scheduler()
    sub.out("./twin-out/<robot>/workspace/")

    sub = add(
        "tolerance",
        "compute the tool error caused by part and encoder errors, and compare it with a requirement",
        "  twin tolerance sher                              in every posture, with the robot's requirement\n"
        "  twin tolerance sher --sigma-um 2 --encoder-um 0.5 --require-um 30\n"
        "  twin tolerance sils --protocol table2 --samples 100000 --json",
    )
    sub.robot()
    sub.text("--protocol", "NAME", "evaluate along this protocol instead of in the robot's postures")
    sub.number("--sigma-um", "UM", "standard deviation of a joint frame's position", 10.0)
    sub.number("--sigma-deg", "DEG", "standard deviation of a joint frame's rotation about each of its axes", 0.001)
    sub.number("--encoder-um", "UM", "standard deviation of a slide's encoder", 1.0)
    sub.number("--encoder-deg", "DEG", "standard deviation of a rotary joint's encoder", 0.001)
    text = "required 95th-percentile position error (default: the requirement of the robot)"
    sub.number("--require-um", "UM", text)
    sub.number("--samples", "N", "number of Monte Carlo samples, at least 1000, or 0 for none", 20_000, _count)
    sub.integer("--seed", "random seed", 0)
    sub.out("./twin-out/<robot>/tolerance/")

    sub = add(
        "sweep",
        "evaluate other designs: parameters or distances on a grid or Latin hypercube",
        "  twin sweep sils --vary l_p=120..150mm --vary l_2=180..260mm --samples 200\n"
        "  twin sweep sher --vary l4:e_a-e_d=70..77mm --grid 9     a distance in the mechanism, evaluated by "
        "tolerance\n"
        "  twin sweep sils --vary l_p=120..150mm --grid 50 --scheduler tcp://10.0.0.1:8786 --parquet",
    )
    sub.robot()
    text = "parameter of the equations, or distance body:joint-joint, with its range; may be given more than once"
    sub.text("--vary", "NAME=LOW..HIGH", text, action="append", default=[])
    sub.number("--samples", "N", "number of samples of the Latin hypercube", 64, _count)
    sub.integer("--grid", "number of values of each varied quantity: evaluate the full grid instead of samples")
    sub.text("--objective", "NAMES", "comma-separated list of volume, conditioning, margin, tolerance")
    sub.text("--protocol", "NAME", _TROCAR)
    sub.integer("--seed", "random seed of the Latin hypercube", 0)
    sub.scheduler()
    sub.integer("--workers", "number of worker processes (default: one for each processor)")
    sub.flag("--parquet", "also write sweep.parquet")
    sub.flag("--fresh", "evaluate all designs again instead of reusing results")
    sub.out("./twin-out/<robot>/sweep-<key>/, one for each sweep")
