"""The numbers of a text with their places: those of XML, of a USD stage in text form, and of a table.

Elements and attributes are known by what their names say, so that a number is found whatever the format is.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from xml.parsers import expat

from twin.comparison.side import RobotSide, plain_name
from twin.core.foreign.budget import DRAWING_SUFFIXES, STAGE_SUFFIXES

_NUMBER = re.compile(rb"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?![\w.])")
"""A number that is no part of a word: "joint2" has none."""

_MAX_TITLES = 3
"""Number of elements around a number whose names tell where it is."""

_MAX_NAMES = 2
"""Number of named elements around a number that it belongs to: in an MJCF, all bodies of an arm are nested."""

_USDA = b"#usda"
"""Beginning of a USD stage in text form."""

_BYTE_ORDER_MARK = b"\xef\xbb\xbf"
"""Bytes that some editors write before a text in UTF-8."""

_OTHER_THAN_PLACES = re.compile(
    r"inerti|mass|limit|lower|upper|range|velocity|effort|force|geom|mesh|visual|collision|color|rgba|damping|friction"
    r"|mimic|polycoef|extent|points|density|stiffness|solref|solimp",
    re.IGNORECASE,
)
"""Elements and attributes that place no joint and no link."""

_PROPERTY_TERMS = {
    "limits": re.compile(r"limit|lower|upper|range", re.IGNORECASE),
    "speeds": re.compile(r"velocity", re.IGNORECASE),
    "efforts": re.compile(r"effort|force|range", re.IGNORECASE),
    "masses": re.compile(r"mass|density", re.IGNORECASE),
    "centres of mass": re.compile(r"(inertial(?!.* mass)|pose|centerOfMass)", re.IGNORECASE),
    "inertias": re.compile(r"(inerti(?!.* mass)|pose|principalAxes)", re.IGNORECASE),
    "couplings": re.compile(r"mimic|polycoef|gear|multiplier|offset", re.IGNORECASE),
}
"""{kind of properties: the elements and attributes that state it in any format}."""


@dataclass(frozen=True)
class FileNumber:
    """A number of a text.

    Attributes:
        start, end: its bytes.
        line: its line, from 1.
        file: the file of this line, if it is another one.
        what: where it is, in the terms of the format.
        names: plain names of the elements or prims around it; () for a table.
    """

    start: int
    end: int
    line: int
    what: str
    names: tuple[str, ...] = ()
    file: str = ""


def numbers(side: RobotSide, names: Collection[str], kind: str) -> list[FileNumber]:
    """Return the numbers of the text of a side inside elements or prims with these names (as `plain_name`).

    `kind` is a kind of properties, or "" for what places joints and links. Of a table, all numbers are returned.
    """
    data = text_of(side)
    if data is None:
        return []
    if _is_xml(data):
        numbers_of_text = _xml_numbers(data, side.xacro_places)
    elif data.startswith(_USDA):
        numbers_of_text = _usda_numbers(data)
    else:
        return list(_table_numbers(data))
    chosen = []
    for number in numbers_of_text:
        if _may_state(number, kind) and not set(number.names).isdisjoint(names):
            chosen.append(number)
    return chosen


def _may_state(number: FileNumber, kind: str) -> bool:
    """Return whether the place of a number says that it may state a kind of property or, for "", a place."""
    if not kind:
        return _OTHER_THAN_PLACES.search(number.what) is None
    return _PROPERTY_TERMS[kind].search(number.what) is not None


def why_not_edited(side: RobotSide) -> str:
    """Return why no number of a side can be named as an edit, and the way out; "" if its numbers can be read again."""
    if text_of(side) is not None:
        return ""
    suffix = ""
    if side.path is not None:
        suffix = side.path.suffix.lower()
    if suffix in DRAWING_SUFFIXES:
        return "its numbers are the shapes of a drawing. Change the place in the CAD program, and export it again"
    if side.has_loops:
        return "each number would need its loops to be closed again. Change the place that is named, and compare again"
    if suffix in STAGE_SUFFIXES:
        return "it is a USD stage in binary form. Write it as text (.usda, by usdcat), and compare that"
    if side.path is None:
        return "it was not read from one file. Change the place that is named, in its CAD or its formula"
    return "its file has no numbers as text. Compare the file from which it was made"


def text_of(side: RobotSide) -> bytes | None:
    """Return the text that was read; None if the side has none that can be read again."""
    if side.reread is None or side.path is None:
        return None
    data = side.text
    if data is None:
        try:
            data = side.path.read_bytes()
        except OSError:
            return None
    if not has_numbers(data, table=bool(side.dh_rows)):
        return None
    return data


def has_numbers(data: bytes, *, table: bool) -> bool:
    """Return whether the numbers of a file are found here: those of XML, of a USD stage in text form, of a table.

    The numbers of other texts, such as STEP, are mostly those of their entities.
    """
    if b"\0" in data:
        return False
    return table or _is_xml(data) or data.startswith(_USDA)


def _is_xml(data: bytes) -> bool:
    """Return whether a text begins as XML does."""
    return data.removeprefix(_BYTE_ORDER_MARK).lstrip().startswith(b"<")


@dataclass(frozen=True)
class _OpenElement:
    """An element of an XML file whose end is not reached: its tag, its name or "", and the joint that it refers to."""

    tag: str
    name: str
    refers: str

    @property
    def title(self) -> str:
        """The element as it is told."""
        return f"{self.tag} '{self.name}'" if self.name else self.tag


class _XmlNumbers:
    """The numbers of the attributes and texts of an XML file, collected while it is parsed.

    Attributes:
        numbers: those that were collected.
    """

    def __init__(self, data: bytes, places: Mapping[str, tuple[str, int]]) -> None:
        """Take the text, and the places of its elements in other files, as in `side.RobotSide.xacro_places`."""
        self.numbers: list[FileNumber] = []
        self._data = data
        self._places = places
        self._open: list[_OpenElement] = []
        self._parser = expat.ParserCreate()
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end

    def parse(self) -> None:
        """Collect the numbers.

        Raises:
            expat.ExpatError: the text is no XML.
        """
        self._parser.Parse(self._data, True)

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        """Collect the numbers of the attributes of an element, and of the text behind its beginning."""
        refers = attributes.get("joint", attributes.get("joint1", ""))
        self._open.append(_OpenElement(tag, attributes.get("name", ""), refers))
        data = self._data
        begin = self._parser.CurrentByteIndex
        end = data.find(b">", begin)
        for attribute in attributes:
            value = re.compile(rb"\s" + re.escape(attribute.encode()) + rb"\s*=\s*([\"'])").search(data, begin, end)
            if value is None or attribute == "name":
                continue
            quote = value.group(1)
            self._add(value.end(), data.find(quote, value.end()), attribute)
        if end > 0 and data[end - 1 : end] != b"/":  # an element without a body has no text
            self._add(end + 1, data.find(b"<", end), "")

    def _end(self, _tag: str) -> None:
        self._open.pop()

    def _add(self, start: int, end: int, title: str) -> None:
        """Add the numbers between two bytes, the value of an attribute or a text, which has no title."""
        file, line_of_place = self._places.get(self._path(), ("", 0))
        for k, match in enumerate(_NUMBER.finditer(self._data, start, end)):
            line = line_of_place
            if not file:
                line = self._data.count(b"\n", 0, match.start()) + 1
            what = f"{' '.join([*self._titles(), title])}[{k}]".strip()
            self.numbers.append(FileNumber(match.start(), match.end(), line, what, self._names(), file))

    def _titles(self) -> list[str]:
        """Return the elements around a number as they are told, without the root."""
        inside_root = self._open[1:]
        nearest = inside_root[-_MAX_TITLES:]
        return [element.title for element in nearest]

    def _names(self) -> tuple[str, ...]:
        """Return the plain names of the nearest elements, or of the joints that they refer to."""
        names = []
        for element in self._open:
            name = element.name or element.refers
            if name:
                names.append(plain_name(name))
        return tuple(names[-_MAX_NAMES:])

    def _path(self) -> str:
        """Return the path of an element below the robot of a URDF: joint, its name, origin."""
        inside_root = self._open[1:]
        parts = [element.tag for element in inside_root]
        if parts:
            parts.insert(1, inside_root[0].name)
        return "/".join(parts)


def _xml_numbers(data: bytes, places: Mapping[str, tuple[str, int]]) -> list[FileNumber]:
    """Return the numbers of the attributes and texts of an XML file; [] if it is no XML."""
    collected = _XmlNumbers(data, places)
    try:
        collected.parse()
    except expat.ExpatError:
        return []
    return collected.numbers


_PRIM_BEGINNING = re.compile(rb"\s*(?:def|over)\s+(?:\w+\s+)?\"([^\"]+)\"")
"""Beginning of a prim of a USD stage, with its name."""

_USD_VALUE_BEGINNING = re.compile(rb"\s*(?:uniform\s+|custom\s+)*[\w\[\]]+\s+([\w:]+)\s*=")
"""Beginning of a value of a prim, with the name of its attribute."""


class _OpenPrims:
    """The names of the prims of a USD stage around the present line, outermost first."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self._depths: list[int] = []  # depth of braces at which each prim began
        self._depth = 0
        self._next = ""  # name of a prim whose brace has not come yet

    def begin(self, content: bytes) -> None:
        """Take the name of a prim that begins in a line."""
        prim = _PRIM_BEGINNING.match(content)
        if prim is not None:
            self._next = prim.group(1).decode()

    def count_braces(self, content: bytes) -> None:
        """Open and close prims at the braces of a line, but not at those in texts."""
        without_texts = re.sub(rb"\"[^\"]*\"", b"", content)
        for brace in re.findall(rb"[{}]", without_texts):
            if brace == b"{":
                self._depth += 1
                if self._next:
                    self.names.append(self._next)
                    self._depths.append(self._depth)
                    self._next = ""
                continue
            if self._depths and self._depths[-1] == self._depth:
                self.names.pop()
                self._depths.pop()
            self._depth -= 1


def _usda_numbers(data: bytes) -> list[FileNumber]:
    """Return the numbers of a USD stage in text form, each with the path of its prim and its attribute."""
    file_numbers: list[FileNumber] = []
    prims = _OpenPrims()
    start = 0
    for line, content in enumerate(data.split(b"\n"), 1):
        prims.begin(content)
        value = _USD_VALUE_BEGINNING.match(content)
        if value is not None and prims.names:
            attribute = value.group(1).decode()
            names = tuple(map(plain_name, prims.names))
            for k, match in enumerate(_NUMBER.finditer(data, start + value.end(), start + len(content))):
                what = f"</{'/'.join(prims.names)}>.{attribute}[{k}]"
                file_numbers.append(FileNumber(match.start(), match.end(), line, what, names))
        prims.count_braces(content)
        start += len(content) + 1  # with the end of the line
    return file_numbers


def _table_numbers(data: bytes) -> Iterator[FileNumber]:
    """Yield the numbers of a table or TOML, each with its place in its line."""
    start = 0
    for line, content in enumerate(data.split(b"\n"), 1):
        if not content.lstrip().startswith(b"#"):
            for k, match in enumerate(_NUMBER.finditer(data, start, start + len(content)), 1):
                yield FileNumber(match.start(), match.end(), line, f"number {k} of the line")
        start += len(content) + 1
