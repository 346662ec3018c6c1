"""The command line: `twin <command> ...`.

Exit codes: 0 agree or done, 1 disagree, 2 could not check or wrong usage.
"""

from __future__ import annotations

import argparse
import json
import logging
import os
import sys
from collections.abc import Sequence

from twin import __version__
from twin.errors import TwinError

_EPILOG = """\
examples:
  twin run sils                                   CAD to report in one go
  twin validate sils                              judge the equations on the default protocol
  twin validate sils --variant eq1=printed        judge equation (1) as the paper prints it
  twin validate sils --all-protocols --json       every protocol, for scripts
  twin plan sils lowered_patient --out plan/      timed joint and tool motion as CSV
  twin build my_robot/                            USD stage of a robot of your own

exit codes: 0 agree or done, 1 disagree, 2 could not check or wrong usage
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code."""
    args = _parser().parse_args(argv)
    # All matrices here are small: threads of the linear algebra library only get in each other's way.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s: %(message)s")
    try:
        from twin.cli import commands

        return int(commands.COMMANDS[args.command](args))
    except TwinError as error:
        if args.debug:
            raise
        if args.json:
            print(json.dumps({"verdict": "unchecked", "error": type(error).__name__, "message": str(error)}))
        print(f"twin: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("twin: interrupted", file=sys.stderr)
        return 130


def _parser() -> argparse.ArgumentParser:
    formatter = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(
        prog="twin",
        description="Bring your CAD and your equations; see where they disagree.",
        epilog=_EPILOG,
        formatter_class=formatter,
    )
    parser.add_argument("--version", action="version", version=f"twin {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

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
        return sub

    def robot(sub: argparse.ArgumentParser) -> None:
        sub.add_argument("robot", help="a built-in robot (see `twin list`), or the path of a robot folder")

    def out(sub: argparse.ArgumentParser, default: str) -> None:
        sub.add_argument("--out", metavar="FOLDER", help=f"where to write (default {default})")

    def chosen(sub: argparse.ArgumentParser) -> None:
        group = sub.add_mutually_exclusive_group()
        group.add_argument("--protocol", metavar="NAME", help="a protocol of the robot, or the path of a protocol file")
        group.add_argument("--all-protocols", action="store_true", help="every protocol of the robot")

    def variants(sub: argparse.ArgumentParser) -> None:
        sub.add_argument(
            "--variant",
            metavar="EQ=NAME",
            action="append",
            default=[],
            help="judge an equation in another variant, as in eq1=printed; a bare name, as in `printed`, judges "
            "each equation that has it alone and then all together",
        )

    add("list", "list the built-in robots", "  twin list\n  twin list --json")

    sub = add("info", "show a robot: joints, limits, frames, parameters with provenance", "  twin info sils")
    robot(sub)

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
        "  twin validate sils\n  twin validate sils --variant eq1=printed\n  twin validate sils --all-protocols --json",
    )
    robot(sub)
    out(sub, "./twin-out/<robot>/<protocol>/")
    chosen(sub)
    variants(sub)
    sub.add_argument(
        "--tolerance-um",
        type=float,
        metavar="UM",
        help="how well the CAD is known: differences up to this many micrometres agree (default 0.001)",
    )

    sub = add(
        "run",
        "build, plan and validate: CAD to report in one go",
        "  twin run sils\n  twin run sils --protocol lowered_patient --out demo/",
    )
    robot(sub)
    out(sub, "./twin-out/<robot>/")
    chosen(sub)

    add("doctor", "show what can be checked on this machine", "  twin doctor")
    return parser
