"""What the command line understands: commands, options, their help and examples."""

from __future__ import annotations

import argparse
import re
from typing import Any, NoReturn

from twin import __version__
from twin.cli.parser_sweeps import add_sweeps
from twin.core.errors import unknown

_EPILOG = """\
examples:
  twin run sils                                   CAD to report in one go
  twin validate sils                              judge the equations on the default protocol
  twin validate sils --variant eq1=printed        judge equation (1) as the paper prints it
  twin validate sils --all-protocols --json       every protocol, for scripts
  twin explain sils --variant printed             where it is wrong, and the edit that cures it
  twin plan sils lowered_patient --out plan/      timed joint and tool motion as CSV
  twin build my_robot/                            USD stage of a robot of your own
  twin export sils --to glb,tracks                for headsets and engines, read again and proven

exit codes: 0 agree or done, 1 disagree, 2 could not check or wrong usage
"""

NAMES = ("list", "info", "build", "plan", "validate", "explain", "run", "view", "serve")
NAMES += ("operate", "track", "study", "export", "audit", "new", "selftest")
NAMES += ("workspace", "tolerance", "sweep", "doctor")
"""Every command."""


class UsageError(Exception):
    """Arguments that do not make a command; `usage` says how they would."""

    def __init__(self, message: str, usage: str) -> None:
        super().__init__(message)
        self.usage = usage


class _Help(argparse.RawDescriptionHelpFormatter):
    """Leaves room for the longest command: argparse forgets that commands are indented."""

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        self._action_max_length = 4 + max(map(len, NAMES))


class _Parser(argparse.ArgumentParser):
    """Raises instead of leaving the process, so that --json is honoured for wrong usage as well."""

    def error(self, message: str) -> NoReturn:
        wrong = re.search(r"argument COMMAND: invalid choice: '(.*?)'", message)
        raise UsageError(unknown("command", wrong[1], NAMES) if wrong else message, self.format_usage())


def _port(text: str) -> int:
    """Return a port to listen on, or refuse what is none."""
    if not re.fullmatch(r"[0-9]+", text) or int(text) > 65535:
        raise argparse.ArgumentTypeError(f"{text} is no port: give 0 to 65535, where 0 takes any that is free")
    return int(text)


def parser() -> argparse.ArgumentParser:
    """Return the parser of every command."""
    formatter = _Help
    root = _Parser(
        prog="twin",
        description="Bring your CAD and your equations; see where they disagree.",
        epilog=_EPILOG,
        formatter_class=formatter,
    )
    root.add_argument("--version", action="version", version=f"twin {__version__}")
    commands = root.add_subparsers(dest="command", required=True, metavar="COMMAND")

    def add(name: str, text: str, examples: str) -> argparse.ArgumentParser:
        sub = commands.add_parser(
            name,
            help=text,
            description=text[0].upper() + text[1:] + ".",
            epilog=f"examples:\n{examples}",
            formatter_class=formatter,
        )
        sub.add_argument("--json", action="store_true", help="print JSON instead of text")
        sub.add_argument("--quiet", action="store_true", help="no progress")
        sub.add_argument("--debug", action="store_true", help="show the whole traceback of an error")
        sub.add_argument("--no-code", action="store_true", help="run no Python of a robot's folder (its formula.py)")
        return sub

    def robot(sub: argparse.ArgumentParser) -> None:
        sub.add_argument("robot", help="a built-in robot (see `twin list`), or the path of a robot folder")

    def tool(sub: argparse.ArgumentParser) -> None:
        sub.add_argument(
            "--tool",
            metavar="NAME",
            help="frame or body that is the tool of a USD stage (default: its own, or its end)",
        )

    def host(sub: argparse.ArgumentParser) -> None:
        sub.add_argument(
            "--host",
            default="127.0.0.1",
            help="address to serve on (default 127.0.0.1: this machine alone); any other is open to the network, by "
            "addresses that open once, one for each device",
        )

    def out(sub: argparse.ArgumentParser, default: str) -> None:
        sub.add_argument("--out", metavar="FOLDER", help=f"where to write (default {default})")

    def chosen(sub: argparse.ArgumentParser) -> None:
        group = sub.add_mutually_exclusive_group()
        group.add_argument("--protocol", metavar="NAME", help="a protocol of the robot, or the path of a protocol file")
        group.add_argument("--all-protocols", action="store_true", help="every protocol of the robot")

    def variants(sub: argparse.ArgumentParser, bare: str) -> None:
        help_ = f"judge an equation in another variant, as in eq1=printed; a bare name, as in `printed`, judges {bare}"
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
        "  twin info pa10 --inertia        can bodies have the masses that are stated of them?",
    )
    robot(sub)
    tool(sub)
    sub.add_argument("--inertia", action="store_true", help="judge masses and inertias instead: CAD, stage, tables")

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
        "time a protocol and check every sample",
        "  twin plan sils\n  twin plan sils lowered_patient --out plan/",
    )
    robot(sub)
    sub.add_argument("protocol", nargs="?", help="name or path; default the robot's default protocol")
    out(sub, "./twin-out/<robot>/<protocol>/")

    sub = add(
        "validate",
        "judge the equations against the mechanism",
        "  twin validate sils\n  twin validate sils --variant eq1=printed\n"
        "  twin validate sils --all-protocols --json\n"
        "  twin validate sher --sweep q5 --compare serial,mimic      over the stroke instead of a protocol",
    )
    robot(sub)
    out(sub, "./twin-out/<robot>/<protocol>/")
    chosen(sub)
    variants(sub, "each equation that has it alone and then all together")
    sub.add_argument(
        "--tolerance-um",
        type=float,
        metavar="UM",
        help="how well the CAD is known: differences up to this many micrometres agree (default 0.001)",
    )
    sub.add_argument(
        "--sweep",
        metavar="JOINTS",
        nargs="?",
        const="all",
        help="judge over the whole stroke of these joints (default all) instead of along a protocol",
    )
    sub.add_argument(
        "--compare",
        metavar="NAMES",
        help="with a sweep: what stand-ins for the loops would have cost; of serial,mimic",
    )

    sub = add(
        "explain",
        "say which row of which equation disagrees with the mechanism, why, and the edit that cures it",
        "  twin explain sils                         nothing to explain\n"
        "  twin explain sils --variant printed       every equation as the paper prints it\n"
        "  twin explain sils --variant eq1=printed --json\n"
        "  twin explain my_robot/ --seconds 60       search longer for two edits in one row",
    )
    robot(sub)
    variants(sub, "every equation that has it")
    sub.add_argument(
        "--tolerance-um",
        type=float,
        metavar="UM",
        help="how well the CAD is known: differences up to this many micrometres agree (default 0.001)",
    )
    sub.add_argument(
        "--seconds", type=float, default=8.0, metavar="S", help="for the search for two edits in one row (default 8)"
    )

    sub = add(
        "run",
        "build, plan and validate: CAD to report in one go",
        "  twin run sils\n  twin run sils --protocol lowered_patient --out demo/",
    )
    robot(sub)
    out(sub, "./twin-out/<robot>/")
    chosen(sub)

    sub = add(
        "view",
        "show a robot in the browser and take it in hand: play, drag, measure, redesign",
        "  twin view sils\n  twin view sher phantom            plan and play that protocol\n"
        "  twin view vsrs                    a scene of several robots\n"
        "  twin view my_robot/ --port 8090 --no-browser\n  twin view usd/pa10/pa10.usda      a bare USD stage\n"
        "  twin view sils --html sils.html   a recording that plays without Python",
    )
    sub.add_argument("robot", help="a built-in robot or scene, the path of a robot folder, a scene or a USD stage")
    sub.add_argument("protocol", nargs="?", help="name or path; default the robot's default protocol")
    sub.add_argument("--port", type=_port, default=8080, help="where the page is served (default 8080; 0 takes any)")
    host(sub)
    sub.add_argument("--no-browser", action="store_true", help="open no browser")
    tool(sub)
    sub.add_argument("--html", metavar="FILE", help="write a recording of the protocol instead, and end")

    sub = add(
        "serve",
        "serve a robot to headsets and browsers: place it in the room, play, grab it",
        "  twin serve sils                     Quest with its cable: adb reverse tcp:8765 tcp:8765\n"
        "  twin serve sher phantom --no-browser\n  twin serve my_robot/                or a bare USD stage\n"
        "  twin serve sils --host 0.0.0.0 --cert cert.pem --key key.pem    for every headset in the network\n"
        "  twin serve sils --record session.json        what is done, and what is seen of it\n"
        "  twin serve sils --replay session.json",
    )
    sub.add_argument("robot", help="a built-in robot, the path of a robot folder, or a USD stage")
    sub.add_argument("protocol", nargs="?", help="name or path; default the robot's default protocol")
    sub.add_argument("--port", type=_port, default=8765, help="where it is served (default 8765; 0 takes any)")
    host(sub)
    sub.add_argument("--no-browser", action="store_true", help="open no browser")
    sub.add_argument("--record", metavar="FILE", help="record the session: requests, states and frames, as JSON")
    sub.add_argument("--replay", metavar="FILE", help="replay a recorded session instead, frame by frame")
    sub.add_argument("--cert", metavar="FILE", help="certificate (PEM), for https: headsets want it for AR")
    sub.add_argument("--key", metavar="FILE", help="its key (PEM), if it is not in the same file")

    sub = add(
        "operate",
        "let a scripted hand work a protocol by handle and pedal, and measure it",
        "  twin operate sher phantom\n  twin operate sher phantom --trials 5 --seed 10 --json\n"
        "  twin operate sher phantom --clutch printed      the published clutch, which jumps\n"
        "  twin operate sils lowered_patient --scale 0.5",
    )
    robot(sub)
    sub.add_argument("protocol", nargs="?", help="name or path; default the robot's default protocol")
    out(sub, "./twin-out/<robot>/<protocol>-operator/")
    sub.add_argument("--seed", type=int, default=0, help="of the hand's chance (default 0); the next trial adds 1")
    sub.add_argument("--trials", type=int, default=1, metavar="N", help="how many (default 1)")
    sub.add_argument(
        "--scale",
        type=float,
        default=0.1,
        metavar="S",
        help="tool motion for each hand motion (default 0.1, ASSUMED: the paper prints none); turns go one to one",
    )
    sub.add_argument(
        "--clutch", choices=("corrected", "printed"), default="corrected", help="eq. (7) (default corrected)"
    )
    sub.add_argument(
        "--solver", choices=("damped", "slsqp"), default="damped", help="of the joint steps (default damped)"
    )

    sub = add(
        "track",
        "control the arm along a protocol by computed torque; what a wrong model costs at the tip",
        "  twin track pa10\n  twin track pa10 circle --mismatch 10 --curve\n"
        "  twin track pa10 --inertia cad --plant pinocchio --json",
    )
    robot(sub)
    sub.add_argument("protocol", nargs="?", help="name or path; default the robot's default protocol")
    out(sub, "./twin-out/<robot>/<protocol>-track/")
    sub.add_argument(
        "--mismatch",
        type=float,
        default=5.0,
        metavar="PERCENT",
        help="how wrong masses and tensors of the controller's model are (default 5)",
    )
    sub.add_argument(
        "--plant", choices=("mujoco", "pinocchio"), default="mujoco", help="what moves the arm (default mujoco)"
    )
    sub.add_argument(
        "--inertia",
        choices=("cited", "cad"),
        default="cited",
        help="masses and tensors of the arm: the cited ones of inertia.toml (default), or weighed on the drawing",
    )
    sub.add_argument("--curve", action="store_true", help="also over errors of -20..20 %%")

    sub = add(
        "study",
        "recompute published tables from their own rows",
        "  twin study sher\n  twin study pa10                 inertia tables: can bodies have them?\n"
        "  twin study my_study.toml --json",
    )
    sub.add_argument("robot", help="a built-in robot, the path of a robot folder, or of a study file")

    sub = add(
        "new",
        "make a robot folder from URDF, MJCF, SDF, a USD stage, or the STEP of an assembly",
        "  twin new leg --from robot.urdf                   loops from robot.yaml beside it\n"
        "  twin new gripper --from gripper.xml --out robots/gripper/\n"
        "  twin new arm.step                                a skeleton: joints are proposed, you name them",
    )
    sub.add_argument("name", help="of the robot: lower-case letters, digits and _; or the file itself")
    sub.add_argument("--from", dest="source", metavar="FILE", help=".urdf, .xml (MJCF), .sdf, .usd* or .step")
    sub.add_argument("--closures", metavar="FILE", help="closure YAML of a URDF (default: the .yaml beside it)")
    sub.add_argument(
        "--root", metavar="NAME", help="which robot of several: a prim path (USD), model (SDF) or body (MJCF)"
    )
    sub.add_argument("--force", action="store_true", help="write over a robot folder; equations and protocols stay")
    out(sub, "./<name>/")

    sub = add(
        "export",
        "write a robot with its motions for headsets, game engines and simulators, and read it again",
        "  twin export sils                              every format, every protocol\n"
        "  twin export sils --to glb,tracks --out xr/\n"
        "  twin export sils --protocol lowered_patient --budget-um 20\n"
        "  twin export my_robot/ --json\n"
        "  twin export usd/pa10/pa10_circle.usda         a stage, with the motion that is baked in it\n"
        "  twin export vsrs                              a scene: each robot, where it stands, and all in one stage",
    )
    sub.add_argument("robot", help="a built-in robot or scene, the path of a robot folder, a scene or a USD stage")
    tool(sub)
    out(sub, "./twin-out/<robot>/export/")
    sub.add_argument(
        "--to", metavar="FORMATS", help="of usd, usdz, glb, unity, tracks, mjcf, urdf; by commas (default all of them)"
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
        help="how far any point of a link may be off between keys, and a joint open, in micrometres (default 100; "
        "0.05 degrees of rotation scale with it); decides the key rate",
    )

    sub = add(
        "audit",
        "read exported files with readers of its own, check each, and hold all against one another",
        "  twin audit twin-out/sils/export/\n  twin audit twin-out/sils/export/ --robot sils    against the mechanism\n"
        "  twin audit model.glb              a file of anybody\n  twin audit robot.usdz --json",
    )
    sub.add_argument("path", help="a folder, or a .glb, .gltf, USD, .usdz, track, MJCF or URDF file")
    sub.add_argument("--robot", metavar="NAME", help="recompute the poses from this robot's mechanism: name or folder")
    sub.add_argument("--all", action="store_true", help="show notes and every check, not the worst of each kind")

    sub = add(
        "selftest",
        "seed faults into a correct robot and see whether the validator finds them: its mutation score",
        "  twin selftest sils                            equations, CAD, USD, units, timing\n"
        "  twin selftest sils --family formula,cad --count 60 --seed 7\n"
        "  twin selftest my_robot/ --json",
    )
    robot(sub)
    sub.add_argument("--protocol", metavar="NAME", help="along which (default the robot's default protocol)")
    sub.add_argument("--family", metavar="NAMES", help="of formula, cad, usd, units, timing; by commas (default all)")
    sub.add_argument("--count", type=int, default=118, metavar="N", help="how many faults in all (default 118)")
    sub.add_argument("--seed", type=int, default=0, help="of the draw (default 0): the same seed, the same faults")
    out(sub, "./twin-out/<robot>/")

    add_sweeps(add, robot, out)

    add("doctor", "show what can be checked on this machine", "  twin doctor")
    return root
