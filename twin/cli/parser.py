"""The parser of the command line, and the arguments that several commands share."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from functools import cache
from importlib import import_module
from typing import Any, NoReturn

from twin.cli.commands import GROUPS, HELP
from twin.core.compute_device import CHOICES, DEVICE
from twin.core.errors import unknown
from twin.core.version import __version__

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

exit codes: 0 agree or done, 1 disagree, 2 could not check or wrong usage, 130 stopped by Ctrl-C
"""


class UsageError(Exception):
    """Invalid arguments of the command line; `usage` shows the correct form."""

    def __init__(self, message: str, usage: str) -> None:
        super().__init__(message)
        self.usage = usage


class _Help(argparse.RawDescriptionHelpFormatter):
    """Help formatter whose first column fits every indented command name; argparse ignores the indentation."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self._action_max_length = 4 + max(map(len, HELP))


class _Parser(argparse.ArgumentParser):
    """Parser that raises `UsageError` instead of exiting, so that --json also works for wrong usage."""

    def error(self, message: str) -> NoReturn:
        wrong = re.search(r"argument COMMAND: invalid choice: '(.*?)'", message)
        raise UsageError(unknown("command", wrong[1], HELP) if wrong else message, self.format_usage())


SHOWN_OBJECTS = "a built-in robot or scene, the path of a robot folder, a scene or a USD stage"
"""Help text of the robot argument, for commands that show or export a robot or a scene."""

VARIANT = (
    "use another variant of an equation, such as eq1=printed; a variant name alone, such as `printed`, applies to "
    "every equation that has this variant"
)
"""Help text of the option --variant, for the equations of a robot."""


class Command(_Parser):
    """Parser of one command; its methods add arguments that several commands have."""

    _filled = False

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Import the file of the command and add its arguments, then parse."""
        # argparse parses the arguments of the chosen command only: the files of all others are not imported
        if not self._filled:
            self._filled = True
            self.flag("--json", "print JSON instead of text")
            self.flag("--quiet", "no progress")
            self.flag("--debug", "show the whole traceback of an error")
            self.flag("--no-code", "do not run Python code of a robot's folder (formula.py)")
            file = import_module(f"twin.cli.commands.{self.prog.split()[-1]}")
            self.epilog = f"examples:\n{file.EXAMPLES}"
            file.arguments(self)
        return super().parse_known_args(args, namespace)

    def flag(self, name: str, text: str) -> None:
        """Add an option without a value."""
        self.add_argument(name, action="store_true", help=text)

    def text(self, name: str, metavar: str, text: str, **options: Any) -> None:
        """Add an option with a value, by default a text; `options` are arguments of `add_argument`."""
        self.add_argument(name, metavar=metavar, help=text, **options)

    def number(
        self, name: str, metavar: str, text: str, default: float | None = None, kind: Callable[[str], float] = float
    ) -> None:
        """Add an option with a number; the help states the default, if there is one."""
        default_text = "" if default is None else f" (default {default:.12g})"
        self.add_argument(name, type=kind, default=default, metavar=metavar, help=text + default_text)

    def integer(
        self, name: str, text: str, default: int | None = None, metavar: str = "N", least: int | None = None
    ) -> None:
        """Add an option with a whole number; numbers below `least` are rejected."""
        self.number(name, metavar, text, default, int if least is None else _at_least(least))

    def seed(self, text: str) -> None:
        """Add --seed."""
        self.integer("--seed", text, 0, least=0)

    def choice(self, name: str, choices: tuple[str, ...], text: str, default: str | None = None) -> None:
        """Add an option whose value must be one of `choices`."""
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

    def timing(self) -> None:
        """Add the option --timing."""
        text = "solver of the timing: our own passes or the package toppra (default: as in the protocol, else passes)"
        self.choice("--timing", ("passes", "toppra"), text)

    def variants(self, text: str) -> None:
        """Add the option --variant."""
        self.text("--variant", "EQ=NAME", text, action="append", default=[])

    def xacro(self) -> None:
        """Add the options --arg and --packages, for a xacro."""
        text = "value of an argument of a xacro; may be repeated"
        self.text("--arg", "NAME:=VALUE", text, action="append", default=[])
        text = "folders with ROS packages that a xacro names, in which they are searched first"
        self.text("--packages", "DIR", text, nargs="+", action="extend", default=[])

    def table(self) -> None:
        """Add the options --dh and --units, for a table of Denavit-Hartenberg parameters."""
        text = "convention of a table of Denavit-Hartenberg parameters (default: as its headings or its key state it)"
        self.choice("--dh", ("standard", "modified", "khalil", "hayati"), text)
        self.text("--units", "LENGTH,ANGLE", "units of such a table: mm, cm or m, and deg or rad, as in mm,deg")

    def out(self, default: str) -> None:
        """Add the option --out."""
        self.text("--out", "FOLDER", f"folder to write to (default {default})")

    def software(self) -> None:
        """Add the options of a machine's control software."""
        self.choice("--mode", ("advanced", "moderate", "beginner"), "set of DAC limits in machine.toml")
        text = "action for DAC commands above the limits: count (none), clip (soft), or stop after too many (hard)"
        self.choice("--overdrive", ("none", "soft", "hard"), text)
        text = (
            "comma-separated list of the faults of the released software to reproduce: shared_counter, "
            "rates_without_coupling, whole_counts; or none (default: as in machine.toml)"
        )
        self.text("--released", "NAMES", text)

    def tool(self) -> None:
        """Add the option --tool."""
        text = (
            "frame or body that is the tool of a USD stage (default: the tool that the stage defines, or the end of "
            "the longest chain of the stage)"
        )
        self.text("--tool", "NAME", text)

    def page(self, port: int, what: str) -> None:
        """Add the arguments of a command that shows a page in a browser."""
        self.robot(SHOWN_OBJECTS)
        self.protocol()
        self.address(port, what)
        text = "task at the console of a scene, such as pegboard (default: the only one of the scene; none: free hands)"
        self.text("--task", "NAME", text)
        text = (
            "end of an instrument that the hand moves: the tip (compensated, default), or the end outside the port, "
            "so that the port inverts the motion of the tip (direct)"
        )
        self.choice("--fulcrum", ("compensated", "direct"), text)
        self.flag("--protocols", "play the protocols of a scene that has a console")
        self.machines()

    def address(self, port: int, what: str) -> None:
        """Add the options for the address of a page in a browser: port, host, and whether a browser is opened."""
        text = f"port of the {what} (default {port}; 0: any free port)"
        self.add_argument("--port", type=port_number, default=port, help=text)
        text = (
            "address to serve on (default 127.0.0.1: reachable only from this computer); any other address opens the "
            "server to the network, with a one-time link for each device"
        )
        self.add_argument("--host", default="127.0.0.1", help=text)
        self.flag("--no-browser", "do not open a browser")

    def machines(self) -> None:
        """Add the option for machines that are already running."""
        text = (
            "robot whose `twin machine` is already running, with its host, UDP port of packets and TCP port of states; "
            "in a scene, this command starts the other machines"
        )
        self.text("--machine", "ROBOT=HOST:PORT:STATEPORT", text, action="append")

    def trocar(self) -> None:
        """Add the option --protocol of a command that needs only the trocar of the protocol."""
        self.text("--protocol", "NAME", "protocol with the position of the trocar (if any)")

    def accuracy(self) -> None:
        """Add the option --tolerance-um."""
        text = "accuracy of the CAD in micrometres: smaller differences count as agreement (default 0.001)"
        self.number("--tolerance-um", "UM", text)

    def device(self, when: str = "") -> None:
        """Add the option --device, see `cli.option_values.device`; `when` names the option that it needs."""
        text = (
            "what computes: the processor (cpu), an NVIDIA graphics processor (gpu), or such a one where it is "
            "expected to be faster, copies included (auto)"
        )
        if when:
            text = f"with {when}: {text}"
        text += f" (default: that of the environment variable {DEVICE}, else auto)"
        self.add_argument("--device", choices=CHOICES, default=None, help=text)

    def scheduler(self) -> None:
        """Add the option --scheduler."""
        text = (
            "address of a Dask scheduler, as in tcp://10.0.0.1:8786, or `local` for Dask worker processes on this "
            "machine"
        )
        self.text("--scheduler", "ADDRESS", text)


def _at_least(least: int) -> Callable[[str], int]:
    """Return a function that converts a text to a whole number, and rejects numbers below `least`."""

    def convert(text: str) -> int:
        if (value := int(text)) < least:
            raise argparse.ArgumentTypeError(f"{text} is too small: give a whole number, at least {least}")
        return value

    convert.__name__ = int.__name__  # argparse names it in its message about a text that is not a number
    return convert


_LARGEST_PORT = 65535


def port_number(text: str) -> int:
    """Convert a text to a port number."""
    # a pattern, because `int` also accepts signs, blanks, underscores and digits of other scripts
    if not re.fullmatch(r"[0-9]{1,9}", text) or int(text) > _LARGEST_PORT:
        raise argparse.ArgumentTypeError(f"{text[:80]} is not a port: give 0 to {_LARGEST_PORT}; 0 chooses a free port")
    return int(text)


def host_and_port(text: str) -> tuple[str, int]:
    """Convert [HOST:]PORT to host and port; default 127.0.0.1. An address of IPv6 is in brackets, as [::1]:9090."""
    host, _, port = text.rpartition(":")
    if host.startswith("[") and host.endswith("]"):
        host = host[1:-1]
    return host or "127.0.0.1", port_number(port)


def count(text: str) -> int:
    """Convert a text, such as 1000 or 1e7, to a whole number."""
    value = float(text)
    if not value.is_integer():
        raise argparse.ArgumentTypeError(f"{text} is not a whole number; give a number such as 1000 or 1e7")
    return int(value)


@cache
def parser() -> argparse.ArgumentParser:
    """Return the parser of the whole command line; later calls in the same process return the same parser."""
    root = _Parser(
        prog="twin",
        usage="twin [-h] [--version] COMMAND ...",
        description="Compare the equations of a robot with its CAD, and show where they disagree.",
        epilog=f"{_by_job()}\n{_EPILOG}",
        formatter_class=_Help,
    )
    root.add_argument("--version", action="version", version=f"twin {__version__}")
    commands = root.add_subparsers(
        dest="command",
        required=True,
        metavar="COMMAND",
        prog="twin",
        parser_class=Command,
        help=argparse.SUPPRESS,
    )
    for name, text in HELP.items():
        description = text[0].upper() + text[1:] + ("" if text.endswith("?") else ".")
        commands.add_parser(name, description=description, formatter_class=_Help)
    return root


_RIGHT_MARGIN = 2
"""Number of columns of a terminal that argparse, too, leaves free at the right."""

_LEAST_COLUMNS = 40
"""Smallest width of the list of commands in characters."""

_MOST_COLUMNS = 110
"""Largest width of the list of commands: longer lines are hard to read on a wide terminal."""


def _by_job() -> str:
    """Return the commands by job, as text for the help."""
    import shutil
    import textwrap

    size = max(map(len, HELP))
    columns = shutil.get_terminal_size().columns - _RIGHT_MARGIN
    columns = max(_LEAST_COLUMNS, min(columns, _MOST_COLUMNS))
    lines: list[str] = []
    for job, names in GROUPS.items():
        lines.append(f"{job}:")
        for name in names:
            start = f"  {name.ljust(size)}  "
            lines += textwrap.wrap(HELP[name], columns, initial_indent=start, subsequent_indent=" " * len(start))
        lines.append("")
    return "\n".join(lines)
