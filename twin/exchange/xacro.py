"""Xacro: a URDF with macros and Python expressions, which `expand` evaluates in a process with limits.

Readers for an import and for an audit use it. It runs the package `xacro` (extra `xacro`), which needs no ROS here.
"""

from __future__ import annotations

import json
import re
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

from twin.core.errors import BudgetError, IncompleteError, SourceError
from twin.core.extras import require
from twin.core.foreign.budget import check_size, read_bytes
from twin.core.foreign.consent import require_consent
from twin.core.foreign.guard import run
from twin.core.foreign.text import parse_xml

SUFFIX = ".xacro"

_EXPRESSION = re.compile(r"\$\{|\$\(")
"""Beginnings of expressions that only xacro replaces."""

_NAMED_ROBOT = re.compile(rb"<robot\b[^>]*\sname\s*=")


@dataclass(frozen=True)
class XacroSettings:
    """What the user gives for the expansion of a xacro.

    Attributes:
        arguments: {name: value} of the `<xacro:arg>`, as texts.
        packages: folders with ROS packages, searched after the package of the file, before environment and neighbours.
    """

    arguments: Mapping[str, str] = field(default_factory=dict)
    packages: tuple[Path, ...] = ()

    @property
    def given(self) -> bool:
        """Whether the user gave anything."""
        return bool(self.arguments or self.packages)


def settings(arguments: list[str], packages: list[str]) -> XacroSettings:
    """Return the settings of the options `--arg name:=value` and `--packages DIR`.

    Raises:
        SourceError: an argument has another form, or a folder does not exist.
    """
    named: dict[str, str] = {}
    for argument in arguments:
        name, separator, value = argument.partition(":=")
        if not (name and separator):
            raise SourceError(f"--arg {argument}: expected name:=value, as in --arg prefix:=left_")
        named[name] = value
    folders: list[Path] = []
    for folder in packages:
        if not Path(folder).is_dir():
            raise SourceError(f"--packages {folder}: the folder does not exist")
        folders.append(Path(folder))
    return XacroSettings(named, tuple(folders))


@dataclass(frozen=True)
class Expanded:
    """An expanded xacro.

    Attributes:
        data: the URDF, XML in UTF-8.
        omitted: one sentence for each include and macro that was left out, and for each constant that was assumed,
            because the package that defines it was not found.
        places: {"joint/NAME/origin", ...: (file, line)}: where the elements of joints and links were written.
    """

    data: bytes
    omitted: tuple[str, ...] = ()
    places: Mapping[str, tuple[str, int]] = field(default_factory=dict)


def is_part(path: Path) -> bool:
    """Return whether a .xacro file is only for others to include: its <robot> has no name."""
    if path.suffix.lower() != SUFFIX:
        return False
    try:
        return _NAMED_ROBOT.search(read_bytes(path, "XML")) is None
    except (OSError, BudgetError):  # who reads the file as a robot says so
        return False


def sign_of_xacro(root: ElementTree.Element) -> str:
    """Return what shows that a file is a xacro, such as `<xacro:include>`; "" for a URDF."""
    for element in root.iter():
        namespace, _, tag = str(element.tag).rpartition("}")
        if "xacro" in namespace:
            return f"<xacro:{tag}>"
        for value in element.attrib.values():
            if _EXPRESSION.search(value):
                return f"'{value[:80]}' in <{tag}>"
    return ""


def is_xacro(path: Path) -> bool:
    """Return whether a file, also one named .urdf, needs expansion: it uses macros or expressions of xacro.

    Raises:
        BudgetError: the file is too large or has too many elements.
        OSError: it cannot be read.
    """
    data = read_bytes(path, "XML")
    if b"xacro" not in data and b"${" not in data and b"$(" not in data:
        return False
    try:
        return bool(sign_of_xacro(parse_xml(path, data)))
    except (ElementTree.ParseError, ValueError, LookupError):
        return b"<xacro:" in data  # xacro says what is wrong


def expand(path: Path, xacro_settings: XacroSettings) -> Expanded:
    """Return the URDF that a xacro describes.

    Raises:
        CodeRefusedError: running code of files is forbidden.
        IncompleteError: an argument has no value, or a package was not found.
        SourceError: it cannot be expanded; the message names file, line, value and a way out.
        BudgetError: it takes too much time or memory, as a macro without end does.
        TwinError: the package `xacro` is not installed.
    """
    check_size(path, "xacro")
    require_consent(path)
    require("xacro", f"{path}: this is a xacro; it")
    with tempfile.TemporaryDirectory(prefix="twin-xacro-") as folder:
        request = Path(folder) / "request.json"
        answer = Path(folder) / "answer.json"
        packages = [str(package.resolve()) for package in xacro_settings.packages]
        request.write_text(json.dumps({"arguments": dict(xacro_settings.arguments), "packages": packages}), "utf-8")
        code = run(path, "xacro", str(request), str(answer))
        if not answer.is_file():
            raise SourceError(f"{path}: xacro ended with exit code {code} and no result: the file may be damaged")
        outcome = json.loads(answer.read_text("utf-8"))
    if "error" in outcome:
        if outcome["incomplete"]:
            raise IncompleteError(_located(path, outcome))
        raise SourceError(_located(path, outcome))
    omitted: list[str] = []
    for package, file, line in outcome["missing"]:
        omitted.append(f"{_short(path, file)}:{line}: package '{package}' was not found, its file is not included.")
    for macro, file, line in _first_of_each(outcome["left_out"]):
        omitted.append(f"{_short(path, file)}:{line}: <{macro}> is defined by no file that was found, and is left out.")
    for constant, value in outcome["lent"].items():
        omitted.append(f"'{constant}' is defined by no file that was found, and is {value:.17g}, as its name says.")
    places = {}
    for name, (file, line) in outcome["places"].items():
        places[name] = (file, line)
    return Expanded(outcome["text"].encode(), tuple(omitted), places)


def _located(path: Path, outcome: Mapping[str, object]) -> str:
    file, line = str(outcome["file"]), outcome["line"]
    if not file:
        return f"{path}: {outcome['error']}"
    where = str(path)
    if Path(file).resolve() != path.resolve():  # an included file
        where = f"{path}: {_short(path, file)}"
    if line:
        where += f":{line}"
    return f"{where}: {outcome['error']}."


def _short(path: Path, file: str) -> str:
    """Return a file's path as seen from the folder of the xacro, if it is below it."""
    try:
        return Path(file).resolve().relative_to(path.resolve().parent).as_posix()
    except ValueError:
        return file


def _first_of_each(rows: list[list]) -> list[list]:
    first: dict[str, list] = {}
    for row in rows:
        first.setdefault(row[0], row)
    return list(first.values())
