"""Read XML, with errors that name the file and the element."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NoReturn
from xml.etree import ElementTree

import numpy as np

from twin.core.errors import SourceError, UnsupportedError
from twin.core.foreign.budget import read_bytes
from twin.core.foreign.text import DoctypeError, parse_xml
from twin.core.spatial import Array
from twin.exchange.xacro import sign_of_xacro

_IGNORED_ENDING = " \t\r\n\"',;"
"""Characters that are ignored after the numbers of a text."""


class Xml:
    """An XML file. Errors of its methods name the file, the element (`where`) and the value (`what`).

    Attributes:
        root: the root element.
        repaired: one sentence for each fault of the text that was repaired to read it; `numbers` appends to it.
    """

    def __init__(self, path: Path, root: str, data: bytes | None = None) -> None:
        """Parse the file or, if given, `data`, the XML that was made from it."""
        self.path = path
        self.repaired: list[str] = []
        try:
            try:
                self.root = parse_xml(path, data)
            except ElementTree.ParseError as error:
                repaired, self.repaired = _repaired(read_bytes(path, "XML") if data is None else data)
                if not self.repaired:
                    raise error
                self.root = parse_xml(path, repaired)
        except DoctypeError as error:
            raise SourceError(f"{path}: {error}") from error
        except OSError as error:
            raise SourceError(f"{path}: cannot be read ({error.strerror or error})") from error
        except (ElementTree.ParseError, ValueError, LookupError) as error:
            raise SourceError(f"{path}: the file is not XML: {error}") from error
        if data is None:
            self._refuse_xacro()
        if self.root.tag == "gazebo":  # of SDF; no other format has such a root
            text = "the root element is <gazebo>, as before SDF 1.3, which is not read: convert the file (gz sdf -p)"
            raise UnsupportedError(f"{path}: {text}")
        if self.root.tag != root:
            hint = "Expand a xacro first; a file of another format needs the suffix of its format."
            raise SourceError(f"{path}: the root element is <{self.root.tag}>, expected <{root}>. {hint}")

    def _refuse_xacro(self) -> None:
        """Raise `SourceError` if the file is a xacro: without its macros, parts of the robot would be missing."""
        sign = sign_of_xacro(self.root)
        if sign:
            raise SourceError(
                f"{self.path}: this is a xacro: it has {sign}. Expand it first, for example with "
                f"`xacro {self.path.name} > expanded_{self.path.name}`"
            )

    def fail(self, where: str, message: str) -> NoReturn:
        """Raise `SourceError` with the file and the element in its message."""
        raise SourceError(f"{self.path}: {where}: {message}")

    def refuse(self, where: str, message: str) -> NoReturn:
        """Raise `UnsupportedError` with the file and the element: no mechanism can express this valid file."""
        raise UnsupportedError(f"{self.path}: {where}: {message}")

    def name(self, element: ElementTree.Element, kind: str) -> str:
        """Return the name of an element; raise `SourceError` if the name is missing."""
        name = (element.get("name") or "").strip()
        if not name:
            self.fail(f"<{kind}>", "the name is missing")
        return name

    def named(self, parent: ElementTree.Element, kind: str) -> dict[str, ElementTree.Element]:
        """Return the children of one kind as {name: element}; raise `SourceError` if a name is missing or repeated."""
        elements: dict[str, ElementTree.Element] = {}
        for element in parent.findall(kind):
            name = self.name(element, kind)
            if name in elements:
                self.fail(f"{kind} '{name}'", "the name is used twice")
            elements[name] = element
        return elements

    def numbers(self, where: str, what: str, text: str | None, count: int, default: Sequence[float] | None) -> Array:
        """Return `count` finite numbers parsed from a text; the default if the text is None.

        Quotation marks, commas and semicolons after the numbers are ignored: they are left over from an attribute or a
        program, and other readers of the format ignore them too.
        """
        if text is None:
            if default is None:
                self.fail(where, f"{what} is missing")
            return np.array(default, float)
        shown_text = text[:80]
        stated = text.rstrip(_IGNORED_ENDING)
        try:
            values = np.array(list(map(float, stated.split())))
        except ValueError:
            expected = "a number" if count == 1 else f"{count} numbers"
            self.fail(where, f"{what} = '{shown_text}' is not {expected}")
        if stated != text.rstrip():
            self.repaired.append(f"{where}: {what} = '{shown_text}': the characters after the numbers are ignored.")
        if len(values) != count or not np.all(np.isfinite(values)):
            expected = "a finite number" if count == 1 else f"{count} finite numbers"
            self.fail(where, f"{what} = '{shown_text}' is not {expected}")
        return values

    def number(self, where: str, what: str, text: str | None, default: float | None = None) -> float:
        """Return one finite number parsed from a text; the default if the text is None."""
        if text is None and default is not None:
            return float(default)
        (value,) = self.numbers(where, what, text, 1, None)
        return float(value)

    def axis(self, where: str, what: str, text: str | None, default: Sequence[float]) -> Array:
        """Return a direction (3,) of any length parsed from a text; raise `SourceError` if the length is 0."""
        axis = self.numbers(where, what, text, 3, default)
        # Exporters write rounding errors such as 1e-17 for zero: normalised, they would be an axis in any direction.
        if not np.abs(axis).max() > 1e-9:
            self.fail(where, f"{what}: the axis has length 0")
        return axis

    def tensor(self, where: str, text: Callable[[str], str | None], default: Array | None = None) -> Array:
        """Return the inertia tensor (3, 3).

        `text` is a function that returns the text of an entry `ixx`, `ixy`, ..., or None if the entry is missing. A
        missing entry has the value in `default`.
        """
        tensor = np.zeros((3, 3))
        for row, column in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
            key = f"i{'xyz'[row]}{'xyz'[column]}"
            missing: float | None = None
            if default is not None:
                missing = default[row, column]
            value = self.number(where, key, text(key), missing)
            tensor[row, column] = value
            tensor[column, row] = value
        return tensor


_NAMESPACE_PREFIX = re.compile(rb"[<\s]/?([A-Za-z_][\w.-]*):[A-Za-z_]")
_ROOT_TAG = re.compile(rb"<[A-Za-z_][\w.:-]*")


def _repaired(data: bytes) -> tuple[bytes, list[str]]:
    """Return XML without two common faults, and one sentence for each fault: (data, []) if it has none of them.

    The faults: text before the XML declaration, and prefixes without a declared namespace.
    """
    faults = []
    start = data.find(b"<?xml")
    if start > 0 and not data[:start].lstrip(b"\xef\xbb\xbf").startswith(b"<"):
        data = data[start:]
        faults.append(f"the file has {start} bytes before its XML declaration; they are ignored.")
    # Comments, CDATA and values of attributes may contain colons that are not prefixes.
    markup = re.sub(rb"<!--.*?-->|<!\[CDATA\[.*?\]\]>|\"[^\"]*\"|'[^']*'", b"", data, flags=re.DOTALL)
    tags = b" ".join(re.findall(rb"<[^>]*>", markup))
    undeclared: list[bytes] = []
    for prefix in sorted(set(_NAMESPACE_PREFIX.findall(tags))):
        # Prefixes that begin with "xml" are reserved by XML, and need no declaration.
        if not prefix.startswith(b"xml") and b"xmlns:" + prefix not in data:
            undeclared.append(prefix)
    root = _ROOT_TAG.search(data)
    if undeclared and root:
        declarations = b""
        for prefix in undeclared:
            # A namespace of its own for each prefix: elements of two programs must not become the same.
            declarations += b' xmlns:%s="undeclared:%s"' % (prefix, prefix)
        data = data[: root.end()] + declarations + data[root.end() :]
        names = b", ".join(undeclared).decode()
        faults.append(f"the namespaces of these prefixes are not declared: {names}; elements with them are not read.")
    return data, faults
