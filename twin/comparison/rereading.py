"""Edits that are found by reading a changed text again: for formats without statements, and for properties.

Each number of the text that belongs to the joint or link in question is changed a little, and the text is read again:
this shows what the number does, whatever the format is. The text of an edit was therefore read, and it agrees.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from xml.parsers import expat

import numpy as np

from twin.comparison.items import NumberEdit
from twin.comparison.side import RobotSide, plain
from twin.comparison.xacro_lines import obstacle
from twin.core.errors import TwinError
from twin.core.foreign.budget import DRAWING_SUFFIXES, STAGE_SUFFIXES
from twin.core.spatial import Array

_NUMBER = re.compile(rb"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?![\w.])")

_USDA = b"#usda"
"""Beginning of a USD stage in text form."""

_BYTE_ORDER_MARK = b"\xef\xbb\xbf"

_MOST_READ = 150
"""Maximum number of numbers of one text that are tried for one item."""

_MOST_ATTRIBUTES = 12
"""Maximum number of attributes of one text that are tried where each reading closes loops."""

_REMEMBERED = 2000
"""Maximum number of changed texts of one file whose sides are kept."""

_STEP = 1e-3
"""Relative change of a number that shows what it does; files in single precision round finer ones away."""

_ROUNDS = 8
"""Maximum number of steps to the value."""

_LEFT = 0.5
"""Part of the difference that a number must be able to remove at the first step."""


_NO_PLACE = re.compile(
    r"inerti|mass|limit|lower|upper|range|velocity|effort|force|geom|mesh|visual|collision|color|rgba|damping|friction"
    r"|mimic|polycoef|extent|points|density|stiffness|solref|solimp",
    re.IGNORECASE,
)
"""Elements and attributes that place no joint and no link."""

_AXIS = re.compile(r"axis")
"""A direction, whose numbers are mostly 0, 1 and -1."""

_STATES = {
    "": re.compile(""),
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


@dataclass(frozen=True)
class EditGoal:
    """What an edit must achieve.

    Attributes:
        residual: a function of a side that returns what differs; zero is agreement.
        agrees: a function of a side that returns whether the two sides agree there, and nowhere less than before.
        moved: a function of a side that returns how many further frames differ; fewer make an edit likelier.
        inaccuracy: size of a residual that is only inaccuracy.
    """

    residual: Callable[[RobotSide], Array]
    agrees: Callable[[RobotSide], bool]
    moved: Callable[[RobotSide], int]
    inaccuracy: float


def remembering(side: RobotSide) -> RobotSide:
    """Return the side with a `reread` that reads each text once: the edits of many items try the same ones."""
    reread = side.reread
    if reread is None:
        return side
    known: dict[bytes, RobotSide | TwinError] = {}

    def read_once(text: bytes) -> RobotSide:
        key = hashlib.sha256(text).digest()
        side_read_before = known.get(key)
        if side_read_before is None:
            try:
                side_read_before = reread(text)
            except TwinError as error:
                side_read_before = error
            if len(known) < _REMEMBERED:
                known[key] = side_read_before
        if isinstance(side_read_before, TwinError):
            raise side_read_before
        return side_read_before

    return replace(side, reread=read_once)


def numbers(side: RobotSide, names: Collection[str], kind: str) -> list[FileNumber]:
    """Return the numbers of the text of a side inside elements or prims with these names (as in `plain`).

    `kind` is a kind of properties, or "" for what places joints and links. Of a table, all numbers are returned.
    """
    data = text_of(side)
    if data is None:
        return []
    if _is_xml(data):
        numbers_of_text = _of_xml(data, side.places)
    elif data.startswith(_USDA):
        numbers_of_text = _of_usda(data)
    else:
        return list(_of_table(data))
    chosen = []
    for number in numbers_of_text:
        states_it = bool(_STATES[kind].search(number.what))
        if not kind:
            states_it = _NO_PLACE.search(number.what) is None
        if states_it and not set(number.names).isdisjoint(names):
            chosen.append(number)
    return chosen


def why_not_edited(side: RobotSide) -> str:
    """Return why no number of a side can be named as an edit, and the way out; "" if its numbers can be read again."""
    if text_of(side) is not None:
        return ""
    suffix = ""
    if side.path is not None:
        suffix = side.path.suffix.lower()
    if suffix in DRAWING_SUFFIXES:
        return "its numbers are the shapes of a drawing. Change the place in the CAD program, and export it again"
    if side.looped:
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
    if not has_numbers(data, table=bool(side.rows)):
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
    return data.removeprefix(_BYTE_ORDER_MARK).lstrip().startswith(b"<")


def _never(_number: FileNumber, _value: float) -> bool:
    return False


def edits(
    side: RobotSide,
    names: Collection[str],
    kind: str,
    goal: EditGoal,
    file: Callable[[str], str],
    tried: Callable[[FileNumber, float], bool] = _never,
) -> list[NumberEdit]:
    """Return the edits of one number that reach a goal, the likeliest first.

    Numbers for which `tried` (of the number and its value) is true are left out: no value of them reaches the goal.
    """
    return [edit for edit, _ in edited_sides(side, names, kind, goal, file, tried)]


def edited_sides(
    side: RobotSide,
    names: Collection[str],
    kind: str,
    goal: EditGoal,
    file: Callable[[str], str],
    tried: Callable[[FileNumber, float], bool] = _never,
) -> list[tuple[NumberEdit, RobotSide]]:
    """Return the same edits, each with the side that was read with it."""
    data = text_of(side)
    if data is None:
        return []
    ranked: list[tuple[int, int, NumberEdit, RobotSide]] = []
    before = goal.residual(side)
    for number in numbers(side, names, kind)[:_MOST_READ]:
        text = data[number.start : number.end].decode()
        if tried(number, float(text)):
            continue
        solved = _solved(side, data, number, goal, before)
        if solved is None:
            continue
        value, edited = solved
        new = _text(value)
        if float(new) == float(text):
            continue
        place = file(number.file or str(side.path))
        edit = NumberEdit(side.label, place, number.line, number.what, text, new, confirmed=True)
        edit = hindered(side, edit, number.file)
        ranked.append((goal.moved(edited), len(new), edit, edited))
    ranked.sort(key=lambda entry: entry[:2])
    return [(edit, edited) for _, _, edit, edited in ranked]


def edits_together(
    side: RobotSide, names: Collection[str], kind: str, goal: EditGoal, file: Callable[[str], str]
) -> list[NumberEdit]:
    """Return edits of several numbers that reach a goal only together; [] if there are none."""
    data = text_of(side)
    if data is None:
        return []
    r = goal.residual(side)
    known: list[FileNumber] = []
    slopes: list[Array] = []
    for number in numbers(side, names, kind)[:_MOST_READ]:
        value = float(data[number.start : number.end])
        step = _STEP * max(abs(value), 1e-3)
        changed = _read(side, data, number, value + step)
        if changed is None:
            continue
        slope = (goal.residual(changed) - r) / step
        if np.abs(slope).max(initial=0.0) > 1e-9:
            known.append(number)
            slopes.append(slope)
    if len(known) < 2:
        return []
    J = np.array(slopes).T
    changes = -np.linalg.pinv(J, rcond=1e-9) @ r
    needed = np.abs(changes) * np.abs(J).max(axis=0) > 0.05 * goal.inaccuracy
    values = []
    for number, change in zip(known, changes, strict=True):
        values.append(float(data[number.start : number.end]) + float(change))
    chosen = []
    for k in np.flatnonzero(needed):
        slope = float(np.abs(J[:, k]).max())
        chosen.append((known[k], _fewest_digits(values[k], 0.05 * goal.inaccuracy / slope)))
    assert side.reread is not None
    changed_text = data
    for number, value in sorted(chosen, key=lambda entry: -entry[0].start):
        changed_text = changed_text[: number.start] + _text(value).encode() + changed_text[number.end :]
    try:
        edited = side.reread(changed_text)
    except TwinError:
        return []
    if not goal.agrees(edited):
        return []
    edits_found = []
    for number, value in chosen:
        text = data[number.start : number.end].decode()
        place = file(number.file or str(side.path))
        edit = NumberEdit(side.label, place, number.line, number.what, text, _text(value), confirmed=True)
        edits_found.append(hindered(side, edit, number.file))
    return edits_found


def attribute_edits(
    side: RobotSide, names: Collection[str], goal: EditGoal, file: Callable[[str], str]
) -> list[NumberEdit]:
    """Return the edits of all numbers of one attribute that reach a goal, for attributes that place a joint."""
    data = text_of(side)
    if data is None:
        return []
    attributes: dict[tuple[int, str], list[FileNumber]] = {}
    for number in numbers(side, names, ""):
        attributes.setdefault((number.line, number.what.rpartition("[")[0]), []).append(number)
    edits_found: list[NumberEdit] = []
    before = goal.residual(side)
    for (line, what), numbers_of_attribute in list(attributes.items())[:_MOST_ATTRIBUTES]:
        values = _attribute_values(side, data, numbers_of_attribute, goal, before)
        if values is None:
            continue
        old = " ".join(data[number.start : number.end].decode() for number in numbers_of_attribute)
        new = " ".join(_text(value) for value in values)
        place = file(numbers_of_attribute[0].file or str(side.path))
        edits_found.append(
            hindered(
                side, NumberEdit(side.label, place, line, what, old, new, confirmed=True), numbers_of_attribute[0].file
            )
        )
    return edits_found


def _attribute_values(
    side: RobotSide, data: bytes, own: Sequence[FileNumber], goal: EditGoal, before: Array
) -> list[float] | None:
    """Return the values of the numbers of an attribute with which a goal is reached; None if there are none."""
    values = np.array([float(data[number.start : number.end]) for number in own])
    slopes = []
    for k in range(len(own)):
        step = _STEP * max(abs(float(values[k])), 0.1)
        changed = _reread_with(side, data, own, values + step * (np.arange(len(own)) == k))
        moved = None if changed is None else goal.residual(changed)
        if moved is None or moved.shape != before.shape:
            return None
        slopes.append((moved - before) / step)
    J = np.array(slopes).T
    r = before
    for _ in range(_ROUNDS):
        change = -np.linalg.pinv(J, rcond=1e-6) @ r
        if np.linalg.norm(r + J @ change) > _LEFT * np.linalg.norm(r):
            return None
        values = values + change
        edited = _reread_with(side, data, own, values)
        if edited is None:
            return None
        if goal.agrees(edited):
            return _fewest_decimals(side, data, own, goal, values)
        r = goal.residual(edited)
        if r.shape != before.shape or not np.linalg.norm(r) < np.linalg.norm(before):
            return None
    return None


def _fewest_decimals(
    side: RobotSide, data: bytes, own: Sequence[FileNumber], goal: EditGoal, values: Array
) -> list[float]:
    """Return the values with as few decimals as are needed, within a twentieth of the inaccuracy."""
    rounded = [_fewest_digits(float(value), 0.05 * goal.inaccuracy) for value in values]
    edited = _reread_with(side, data, own, np.array(rounded))
    if edited is not None and goal.agrees(edited):
        return rounded
    return values.tolist()


def _reread_with(side: RobotSide, data: bytes, own: Sequence[FileNumber], values: Array) -> RobotSide | None:
    """Return the side with other values of some numbers; None if the text can then not be read."""
    assert side.reread is not None
    changed = data
    for number, value in sorted(zip(own, values.tolist(), strict=True), key=lambda entry: -entry[0].start):
        changed = changed[: number.start] + _text(value).encode() + changed[number.end :]
    try:
        return side.reread(changed)
    except TwinError:
        return None


def hindered(side: RobotSide, edit: NumberEdit, file: str) -> NumberEdit:
    """Return an edit of an expanded xacro without its new number if its line in `file` does not state the number."""
    if side.text is None:
        return edit
    reason = obstacle(side.places, file, edit.line, edit.what, edit.old)
    if not reason:
        return edit
    return replace(edit, new="", confirmed=False, obstacle=reason)


def _fewest_digits(value: float, inaccuracy: float) -> float:
    """Return a value with as few decimals as an inaccuracy allows."""
    for digits in range(13):
        rounded = round(value, digits) + 0.0
        if abs(rounded - value) <= inaccuracy:
            return rounded
    return value


def _text(value: float) -> str:
    return f"{value:.12g}"


def _read(side: RobotSide, data: bytes, number: FileNumber, value: float) -> RobotSide | None:
    """Return the side with another value of a number; None if the text can then not be read."""
    assert side.reread is not None
    changed = data[: number.start] + _text(value).encode() + data[number.end :]
    try:
        return side.reread(changed)
    except TwinError:
        return None


def _solved(
    side: RobotSide, data: bytes, number: FileNumber, goal: EditGoal, before: Array
) -> tuple[float, RobotSide] | None:
    """Return (value of a number with which a goal is reached, the side with it); None if there is none."""
    value = float(data[number.start : number.end])
    step = _STEP * max(abs(value), 0.1)
    r = before
    slope: Array | None = None
    edited: RobotSide | None = None
    for _ in range(_ROUNDS):
        changed = _read(side, data, number, value + step)
        if changed is None:
            return None
        moved = goal.residual(changed)
        if moved.shape != r.shape:
            return None
        slope = (moved - r) / step
        strength = float(slope @ slope)
        if strength < 1e-18:
            return None if edited is not None else _elsewhere(side, data, number, goal)
        change = -float(slope @ r) / strength
        if edited is None and np.linalg.norm(r + slope * change) > _LEFT * np.linalg.norm(r):
            return _elsewhere(side, data, number, goal)
        if not abs(change) < 1e6:
            return None
        value += change
        edited = _read(side, data, number, value)
        if edited is None:
            return None
        r = goal.residual(edited)
        if abs(change) * np.sqrt(strength) < 0.01 * goal.inaccuracy:
            break
        step = _STEP * max(min(abs(change), abs(value)), 1e-3)
    if edited is None or slope is None or not goal.agrees(edited):
        return _elsewhere(side, data, number, goal)
    steepest = float(np.abs(slope).max())
    return _rounded(side, data, number, goal, value, steepest) or (value, edited)


def _elsewhere(side: RobotSide, data: bytes, number: FileNumber, goal: EditGoal) -> tuple[float, RobotSide] | None:
    """Return the number with a lost sign, a quarter turn or zero if that reaches the goal: too far for small steps."""
    value = float(data[number.start : number.end])
    candidates = [-value]
    for quarter in (90.0, 0.5 * np.pi):
        for turns in (-2, -1, 1, 2):
            # only from one multiple of a quarter turn to another, or all numbers would be tried
            if abs(value / quarter - round(value / quarter)) < 1e-4 and (value or turns):
                candidates.append(value + turns * quarter)
    if _AXIS.search(number.what):
        candidates = [-value, 0.0, 1.0, -1.0]
    for candidate in candidates:
        if abs(candidate - value) < 1e-12:
            continue
        edited = _read(side, data, number, candidate)
        if edited is not None and goal.agrees(edited):
            return _fewest_digits(candidate, 1e-6), edited
    return None


def _rounded(
    side: RobotSide, data: bytes, number: FileNumber, goal: EditGoal, value: float, slope: float
) -> tuple[float, RobotSide] | None:
    """Return the value with as few decimals as are needed."""
    for digits in range(13):
        rounded = round(value, digits) + 0.0
        # half of the tolerance would be a coincidence: one more digit must not matter
        if abs(rounded - value) * slope > 0.05 * goal.inaccuracy:
            continue
        edited = _read(side, data, number, rounded)
        if edited is not None and goal.agrees(edited):
            return rounded, edited
    return None


# -- the numbers of a text ----------------------------------------------------------------------------


def _of_xml(data: bytes, places: Mapping[str, tuple[str, int]]) -> list[FileNumber]:
    """Return the numbers of the attributes and texts of an XML file."""
    file_numbers: list[FileNumber] = []
    tags: list[str] = []
    names: list[str] = []
    titles: list[str] = []
    parser = expat.ParserCreate()

    def add(start: int, end: int, title: str) -> None:
        for k, match in enumerate(_NUMBER.finditer(data, start, end)):
            line = data.count(b"\n", 0, match.start()) + 1
            around = [part for part in titles[-3:] if part]
            label = f"{' '.join([*around, title])}[{k}]".strip()
            place = places.get("/".join(tags_and_name()))
            file = ""
            if place is not None:
                file, line = place
            # in an MJCF, all bodies of an arm are nested
            nearest = tuple(plain(name) for name in names if name)[-2:]
            file_numbers.append(FileNumber(match.start(), match.end(), line, label, nearest, file))

    def tags_and_name() -> list[str]:
        """Return the parts of the path of an element below the robot of a URDF: joint, its name, origin."""
        parts = list(tags[1:2])
        if len(names) > 1:
            parts.append(names_raw[1])
        return [*parts, *tags[2:]]

    names_raw: list[str] = []

    def start(tag: str, attributes: dict[str, str]) -> None:
        tags.append(tag)
        name = attributes.get("name", "")
        refers = attributes.get("joint", attributes.get("joint1", ""))
        names.append(name or refers)
        names_raw.append(name)
        titles.append(f"{tag} '{name}'" if name else tag)
        if len(titles) == 1:
            titles[0] = ""
        begin = parser.CurrentByteIndex
        end = data.find(b">", begin)
        for attribute in attributes:
            match = re.compile(rb"\s" + re.escape(attribute.encode()) + rb"\s*=\s*([\"'])").search(data, begin, end)
            if match is None or attribute == "name":
                continue
            add(match.end(), data.find(match.group(1), match.end()), attribute)
        if end > 0 and data[end - 1 : end] != b"/":
            add(end + 1, data.find(b"<", end), "")

    def stop(_: str) -> None:
        tags.pop()
        names.pop()
        names_raw.pop()
        titles.pop()

    parser.StartElementHandler = start
    parser.EndElementHandler = stop
    try:
        parser.Parse(data, True)
    except expat.ExpatError:
        return []
    return file_numbers


_PRIM = re.compile(rb"\s*(?:def|over)\s+(?:\w+\s+)?\"([^\"]+)\"")
_USD_VALUE = re.compile(rb"\s*(?:uniform\s+|custom\s+)*[\w\[\]]+\s+([\w:]+)\s*=")


def _of_usda(data: bytes) -> list[FileNumber]:
    """Return the numbers of a USD stage in text form, each with the path of its prim and its attribute."""
    file_numbers: list[FileNumber] = []
    prims: list[str] = []
    opened: list[int] = []  # depth of braces at which each prim began
    depth = 0
    waiting = ""
    start = 0
    for line, content in enumerate(data.split(b"\n"), 1):
        prim = _PRIM.match(content)
        if prim is not None:
            waiting = prim.group(1).decode()
        value = _USD_VALUE.match(content)
        if value is not None and prims:
            attribute = value.group(1).decode()
            for k, match in enumerate(_NUMBER.finditer(data, start + value.end(), start + len(content))):
                what = f"</{'/'.join(prims)}>.{attribute}[{k}]"
                around = tuple(plain(name) for name in prims)
                file_numbers.append(FileNumber(match.start(), match.end(), line, what, around))
        for letter in re.findall(rb"[{}]", re.sub(rb"\"[^\"]*\"", b"", content)):
            if letter == b"{":
                depth += 1
                if waiting:
                    prims.append(waiting)
                    opened.append(depth)
                    waiting = ""
            else:
                if opened and opened[-1] == depth:
                    prims.pop()
                    opened.pop()
                depth -= 1
        start += len(content) + 1
    return file_numbers


def _of_table(data: bytes) -> Iterator[FileNumber]:
    """Yield the numbers of a table or TOML, each with its place in its line."""
    start = 0
    for line, content in enumerate(data.split(b"\n"), 1):
        if not content.lstrip().startswith(b"#"):
            for k, match in enumerate(_NUMBER.finditer(data, start, start + len(content)), 1):
                yield FileNumber(match.start(), match.end(), line, f"number {k} of the line")
        start += len(content) + 1
