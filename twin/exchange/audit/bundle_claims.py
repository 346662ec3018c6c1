"""Check data of files that are not poses: stated interpolation errors, header entries, assumptions, README.txt."""

from __future__ import annotations

import codecs
import json
import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from twin.core.json_types import JsonMapping
from twin.core.version import __version__
from twin.exchange.audit.file_content import Content, LinkShape
from twin.exchange.audit.file_joints import FileJoint
from twin.exchange.audit.file_statements import ROBOT
from twin.exchange.audit.interpolation_error import errors_at_every_second_key
from twin.exchange.audit.mechanism_data import FileMechanism
from twin.exchange.audit.named_parts import has_all_names, named_parts
from twin.exchange.audit.parameter_claims import compare_assumed
from twin.exchange.audit.proof_form import is_number
from twin.exchange.audit.readme_numbers import check_numbers
from twin.exchange.audit.report import Ledger, Measured, quantity
from twin.exchange.conventions import CONVENTIONS, UNTRIED
from twin.exchange.format import Holds
from twin.exchange.formats import audit_formats, formats_with_use, kind_holds

PROOF = "proof.json"

TOO_GOOD = 3.0
"""Maximum ratio of the estimated error to the stated error; at higher ratios, the stated error is too small."""

TOO_BAD = 20.0
"""Maximum ratio of the stated error to the estimated error; at higher ratios, the stated error is too large.

The ratio 4 is normal for a stage, whose stated error is measured with every second sample removed.
"""

_FLOOR = (1e-6, 1e-6, 1e-6)
"""Errors that rounded numbers can cause in an estimate: position in m, rotation in rad, joint gap in m."""

_LONGEST_QUOTE = 60
"""Number of characters from which a quoted line is cut."""

_STATED_DIGITS = 1e-5
"""Relative difference of a number in proof.json and the same number in a track: both have at least six digits."""

_STATED = (
    ("between_position", "any point of a link between keys", "m"),
    ("between_rotation", "rotation of a link between keys", "rad"),
    ("joint_gap", "gap of a joint between keys", "m"),
)


def check_claims(contents: Sequence[Content]) -> None:
    """Report statements of a file that contradict other data of the same file."""
    tracks = []  # JSON and CSV
    for content in contents:
        if (content.is_track or content.repeats_track) and "data" in content.extra:
            tracks.append(content)
    shapes: Mapping[str, LinkShape] = {}
    for content in contents:
        if content.shapes and content.declared:
            shapes = content.shapes
            break
    joints = _placed_joints(contents)
    by_protocol: dict[str, Content] = {}
    for content in tracks:
        if content.is_track:
            by_protocol[_protocol(content)] = content
    for content in tracks:
        _check_between(content, shapes, joints)
        track = by_protocol.get(_protocol(content))
        if content.repeats_track and track is not None:
            _check_heads(content, track)
    _check_moved_frames(contents, tracks)
    _check_assumed(contents, tracks)
    _check_same_robot(tracks)
    _check_stems(tracks)


def _protocol(track: Content) -> str:
    return str(track.extra["data"].get("protocol"))


def _playing(contents: Iterable[Content]) -> dict[str, Content]:
    """Return {protocol: track} of the tracks whose motion could be read."""
    playing = {}
    for content in contents:
        if content.is_track and content.clips:
            playing[_protocol(content)] = content
    return playing


def _placed_joints(contents: Sequence[Content]) -> list[FileJoint]:
    """Return the joints of the first file that states where all are, without those that move with the protocol."""
    for content in contents:
        mechanism = content.mechanism
        if mechanism is None or not _places(mechanism):
            continue
        world_links = mechanism.fixed_to_world or frozenset()
        joints = []
        for joint in mechanism.joints:
            # Joints on the world, such as trocars, may have a different position in each motion.
            on_world = joint.tied and world_links & {joint.parent, joint.child}
            if not on_world and not mechanism.trocars & set(joint.names):
                joints.append(joint)
        return joints
    return []


def _places(mechanism: FileMechanism) -> bool:
    """Return whether a file states all joints, and where they are."""
    if not mechanism.complete:
        return False
    return any(joint.T is not None or joint.tied for joint in mechanism.joints)


def _check_between(content: Content, shapes: Mapping[str, LinkShape], joints: Sequence[FileJoint]) -> None:
    """Compare the stated errors between keys with estimates from the keys."""
    if not content.clips:
        return
    halved_errors = errors_at_every_second_key(content.clips[0], shapes, joints)
    if halved_errors is None:
        return
    for (key, text, unit), halved_error, floor in zip(_STATED, halved_errors, _FLOOR, strict=True):
        stated = content.extra["data"].get(key)
        if not isinstance(stated, int | float) or (key == "joint_gap" and not joints):
            continue
        # Linear interpolation errs with the square of the time between keys: half the time, a quarter of the error.
        estimate = halved_error / 4
        low = stated < estimate / TOO_GOOD and estimate > floor
        high = stated > TOO_BAD * max(estimate, floor)
        if key == "between_position" and not shapes:
            high = False  # the estimate at the origins of links is too small
        check = f"{key}: stated error compared with an estimate from every second key"
        content.ledger.row(check, abs(estimate - stated), unit, fits=not low)
        if low or high:
            message = (
                f"{key} states an error of {quantity(stated, unit)} for {text}, but the estimate is "
                f"{quantity(estimate, unit)}: a quarter of the error with every second key left out, "
                f"{quantity(halved_error, unit)}."
            )
            content.ledger.wrong(f"claims.{key}", message, key, size=Measured(stated, estimate, unit))


def _check_heads(table: Content, track: Content) -> None:
    """Report differences of the headers of a CSV and a JSON track."""
    table_head = table.extra["data"]
    track_head = track.extra["data"]
    for key in dict.fromkeys((*track_head, *table_head)):
        if key not in table_head:
            text = f"the entry '{key}' is in {track.file}, but not in {table.file}."
        elif key not in track_head:
            text = f"the entry '{key}' is in {table.file}, but not in {track.file}."
        elif not _equal(table_head[key], track_head[key]):
            text = f"'{key}' is {_short(table_head[key])}; in {track.file} it is {_short(track_head[key])}."
        else:
            continue
        table.ledger.wrong("claims.head", text, key, suggestion="write both files from one source")


def _equal(a: Any, b: Any) -> bool:
    """Return whether two values of headers are equal: numbers but for rounding, lists by entry, others as text."""
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(map(_equal, a, b))
    if isinstance(a, int | float) and isinstance(b, int | float):
        return abs(a - b) <= 1e-9 * max(1.0, abs(a), abs(b))
    return str(a) == str(b)


def _short(value: Any) -> str:
    return _clipped(json.dumps(value, ensure_ascii=False))


def _check_same_robot(tracks: Sequence[Content]) -> None:
    """Report names of frames, names and types of joints, and tools that are not the same in all tracks."""
    if not tracks:
        return
    first = tracks[0]
    for content in tracks[1:]:
        for key in ("robot", "tool_link", "tool_frame", "frame_names", "frame_links", "joints", "joint_types"):
            value = content.extra["data"].get(key)
            expected = first.extra["data"].get(key)
            if not _equal(value, expected):
                text = f"'{key}' is {_short(value)}; in {first.file} it is {_short(expected)}."
                content.ledger.wrong("claims.robot", text, key)


def _check_stems(tracks: Sequence[Content]) -> None:
    """Report a track whose file has the name of the protocol of another track in its folder.

    A name that is no protocol says nothing: files may be renamed in any other way.
    """
    protocols: dict[Path, set[str]] = {}
    for track in tracks:
        protocols.setdefault(Path(track.file).parent, set()).add(_protocol(track))
    for track in tracks:
        path = Path(track.file)
        protocol = _protocol(track)
        if path.stem != protocol and path.stem in protocols[path.parent]:
            text = (
                f"protocol is '{protocol}', but the file is named for protocol '{path.stem}', which another file has."
            )
            advice = f"name the file {protocol}{path.suffix}"
            track.ledger.wrong("claims.protocol", text, "protocol", suggestion=advice)


def _check_assumed(contents: Sequence[Content], tracks: Sequence[Content]) -> None:
    """Report numbers that a stage marks as ASSUMED, but that a track does not list as assumed."""
    stages = []
    for content in contents:
        if content.extra.get("assumed"):
            stages.append(content)
    if not stages:
        return
    stage = stages[0]
    for content in tracks:
        lines = content.extra["data"].get("assumed")
        if not isinstance(lines, list):
            continue
        listed = set()
        for line in lines:
            listed.add(head(str(line)))
        lacking = []
        for name in stage.extra["assumed"]:
            # Tracks have one line for all dimensions of the drawing, which affect only the appearance of parts.
            if name not in listed and not name.startswith("drawing."):
                lacking.append(name)
        if lacking:
            text = (
                f"the file's list of assumed numbers lacks '{lacking[0]}'{_more(lacking)}, which {stage.file} lists as "
                "assumed."
            )
            content.ledger.wrong("claims.assumed", text, "assumed", size=float(len(lacking)))


def _check_moved_frames(contents: Sequence[Content], tracks: Sequence[Content]) -> None:
    """Report files with all motions that lack the frame that one of the tracks moves.

    Files that do not state their robot are not judged, nor those without any frame: other programs keep neither robot
    nor frames when they save, or remove all nodes without a mesh.
    """
    for content in contents:
        if not (kind_holds(content.format, Holds.ALL_MOTIONS) and ROBOT in content.stated and content.mechanism):
            continue
        if not content.mechanism.frames:
            continue
        for track in tracks:
            frame = track.extra["data"].get("moved_frame")
            if track.is_track and isinstance(frame, str) and frame and frame not in content.mechanism.frames:
                text = f"the file has no frame '{frame}', which the motion of {track.file} moves."
                content.ledger.wrong("claims.moved_frame", text, frame, suggestion="export the file again")
                break


def _more(names: Sequence[str]) -> str:
    """Return " and n more" for the names behind the first, "" if there are none."""
    if len(names) < 2:
        return ""
    return f" and {len(names) - 1} more"


def head(line: str) -> str:
    """Return the name in a text "name = value unit: reason"."""
    return line.split("=", 1)[0].strip()


# ------------------------------------------------------------------------------------------------ README.txt

STATEMENTS: tuple[tuple[str, str, tuple[str, ...]], ...] = (
    (
        "units",
        r"- (\w+), (\w+), (\w+), (\w+)\. UsdPhysics angles are (\w+)",
        ("metres", "kilograms", "seconds", "radians", "degrees"),
    ),
    ("the robot's world", r"own world is (\S+) up, (\w+)-handed", ("z", "right")),
    ("up axis of GLB and USDZ", r"GLB and USDZ are (\S+) up", ("y",)),
    ("rotation of the root", r"(\S+) degrees about (\w)", ("-90", "x")),
    ("order of quaternions", r"Quaternions are (\w \w \w \w) \(USD: (\w \w \w \w)\)", ("x y z w", "w x y z")),
    ("handedness of Unity", r"Unity is (\w+)-handed", ("left",)),
    (
        "pose conversion of a glTF importer",
        r"\(x, y, z\) becomes (\([^)]*\)), the quaternion (\([^)]*\))",
        ("(-x, y, z)", "(x, -y, -z, w)"),
    ),
    (
        "pose conversion of ROS importers",
        r"ROS importers use (\([^)]*\)) and (\([^)]*\))",
        ("(-y, z, x)", "(-y, z, x, -w)"),
    ),
)
"""Checked statements of README.txt: (topic, regular expression, expected texts)."""

_MOTION = re.compile(
    r"- (?P<name>\w+): (?P<title>.*?); (?P<duration>[\d.]+) s, (?P<keys>\d+) keys at (?P<rate>[\d.]+) Hz\..*?at most "
    r"(?P<position>[\d.]+) um off.*?and (?P<rotation>[\d.]+) degrees; joints open by at most (?P<gap>[\d.]+) um"
)


def check_readme(contents: Sequence[Content], read: Collection[str], path: Path, ledger: Ledger) -> None:
    """Report statements in a README.txt that are false for the files in the same folder.

    `read` are the files that the audit has read or tried to read, as reports show them.
    """
    try:
        raw = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        ledger.wrong("readme.unreadable", f"README.txt cannot be read: {error}.")
        return
    if not raw.strip():
        ledger.wrong("readme.unreadable", "README.txt is empty.")
        return
    text = re.sub(r"[ \t]*\n[ \t]+", " ", raw)  # join wrapped lines
    for topic, pattern, expected in STATEMENTS:
        sentence_match = re.search(pattern, text)
        if sentence_match is None:
            continue
        stated = sentence_match.groups()
        lower_case = tuple(map(str.lower, stated))
        if lower_case != expected:
            message = f"README.txt states '{' / '.join(stated)}' for {topic}; the files have '{' / '.join(expected)}'."
            ledger.wrong("readme.convention", message, topic)
    _check_listed(path.parent, raw, contents, read, ledger)
    _check_motions(text, contents, ledger)
    _check_list(text, contents, ledger)
    check_numbers(text, contents, ledger)
    # The sentences change from version to version: those of another version are not judged by the present ones.
    if f"Written by twin {__version__} " in text:
        _check_sentences(text, contents, ledger)
        _check_title(text, contents, ledger)
        _check_export_findings(text, path.parent, contents, ledger)
    wrong = 0
    for finding in ledger.found:
        if finding.severity != "info":
            wrong += 1
    ledger.row("README.txt against the files", float(wrong), "found", 0.0, against="the files")


def _check_title(text: str, contents: Sequence[Content], ledger: Ledger) -> None:
    """Compare the robot in the first line with the one that the files state."""
    robot = text.split("\n", 1)[0].split(":", 1)[0]
    for content in contents:
        if ROBOT in content.stated and content.stated[ROBOT] != robot:
            message = f"README.txt is of the robot '{robot}', {content.file} of '{content.stated[ROBOT]}'."
            ledger.wrong("readme.robot", message, "title")
            return


_LEFT_OUT = re.compile(
    r"\S+: (?:the format|URDF) cannot hold the (?:[\w ]+ of|frames and points) (?:the actuators )?"
    r"(?P<names>\w+(?:, \w+)*)"
)
"""What a file cannot hold of which joints, motors, frames or points."""


_COMMENT = re.compile(r"<!-- (?P<finding>\S+: .*?)\.? -->")


def _begins_as_xml(file: Path) -> bool:
    """Return whether a file begins with an XML tag; tracks and binary files have no such comments."""
    with file.open("rb") as stream:
        begin = stream.read(100)
    # an editor may have written a byte order mark or blank lines before the first tag
    return begin.removeprefix(codecs.BOM_UTF8).lstrip().startswith(b"<")


def _left_out_in_comments(folder: Path, contents: Sequence[Content]) -> list[str]:
    """Return the findings in comments of the files that say which values of which names a file cannot hold."""
    findings: dict[str, None] = {}  # a dict, for the order
    for content in contents:
        file = folder / Path(content.file).name
        if not file.is_file() or not _begins_as_xml(file):
            continue
        for comment in _COMMENT.finditer(file.read_text("utf-8", errors="replace")):
            if _LEFT_OUT.fullmatch(comment["finding"]):
                findings[comment["finding"]] = None
    return list(findings)


def _check_export_findings(text: str, folder: Path, contents: Sequence[Content], ledger: Ledger) -> None:
    """Report findings of the export in README.txt about files or names that are not there, and missing findings."""
    names = named_parts(contents)
    lines: set[str] = set()
    for entry in re.split(r"^- ", _section(text, "Findings of the export"), flags=re.MULTILINE)[1:]:
        line = _plain(entry)
        lines.add(line.removesuffix("."))
        file = line.split(": ", 1)[0]
        if " cannot " in line and not (folder / file).is_file():
            message = f"a finding of the export in README.txt names no file of the folder: '{_clipped(line)}'."
            ledger.wrong("readme.finding", message, "Findings of the export")
        left_out = _LEFT_OUT.fullmatch(line)
        if left_out is None:
            continue
        unknown_names = []
        for name in left_out["names"].split(", "):
            if name not in names:
                unknown_names.append(name)
        if unknown_names and has_all_names(contents):
            message = f"a finding of the export names '{unknown_names[0]}', which no file has: '{_clipped(line)}'."
            ledger.wrong("readme.finding", message, "Findings of the export")
    for finding in _left_out_in_comments(folder, contents):
        if finding not in lines:
            message = f"README.txt lacks a finding of the export that a comment of the file states: '{finding}'."
            ledger.wrong("readme.finding", message, "Findings of the export")


def _check_sentences(text: str, contents: Sequence[Content], ledger: Ledger) -> None:
    """Report lines that differ from those that this version of twin writes in every README.txt, and missing ones."""
    formats = {content.format for content in contents}
    for format in formats_with_use():
        use = _plain(format.use.removeprefix("- "))
        if format.name in formats and use not in _plain(_section(text, "How to use it")):
            message = f"'How to use it' lacks the line of the {format.title}: '{_clipped(use)}'."
            ledger.wrong("readme.sentence", message, "How to use it")
    uses = [format.use for format in formats_with_use()]
    for title, entries, all_needed in (
        ("Conventions", CONVENTIONS, True),
        ("How to use it", uses, False),  # each export has only some of the formats
        ("What has not been tested", UNTRIED, True),
    ):
        expected_lines = _entry_lines(entries)
        stated = _entry_lines(_section(text, title).splitlines())
        unknown_lines = []
        for line in stated:
            if line not in expected_lines:
                unknown_lines.append(line)
        if unknown_lines:
            first = _clipped(unknown_lines[0])
            message = f"'{title}' has the line '{first}'{_more(unknown_lines)}, which twin does not write."
            ledger.wrong("readme.sentence", message, title)
        missing = []
        for line in expected_lines:
            if line not in stated:
                missing.append(line)
        if missing and (all_needed or not stated):
            message = f"'{title}' lacks the line '{_clipped(missing[0])}'{_more(missing)}."
            ledger.wrong("readme.sentence", message, title)


def _entry_lines(lines: Iterable[str]) -> list[str]:
    """Return the lines of a list that are not blank, without the dash before them and with single spaces."""
    entries = []
    for line in lines:
        if line.strip():
            entries.append(_plain(line.removeprefix("- ")))
    return entries


def _check_listed(folder: Path, raw: str, contents: Sequence[Content], read: Collection[str], ledger: Ledger) -> None:
    """Report listed files that do not exist or are of no format, and motions that the listed files should play."""
    folder_prefix = ledger.file.removesuffix("README.txt")  # of the folder with the listed files, in the audited folder
    rows = re.findall(r"^(\S+?)(?:, (\.\w+))?  +(.*)$", _section(raw, "What is where"), re.MULTILINE)
    for line in _section(raw, "What is where").splitlines():
        if line.startswith(" "):
            message = f"a line of 'What is where' in README.txt names no file: '{_clipped(line.strip())}'."
            ledger.wrong("readme.file", message, "What is where")
    listed: set[str] = set()
    motions = _named_motions(contents)
    for name, second_suffix, description in rows:
        files = [name]
        if second_suffix:
            files.append(str(Path(name).with_suffix(second_suffix)))
        for file in files:
            listed.add(f"{folder_prefix}{file}")
            # The README.txt is written before the proof.json, which has its hash.
            if file != PROOF and not (folder / file).exists():
                ledger.wrong("readme.file", f"README.txt lists '{file}', which does not exist.", file)
            elif _is_audited(file) and f"{folder_prefix}{file}" not in read:
                message = f"README.txt lists '{file}', which no reader of the audit recognises."
                ledger.wrong("readme.file", message, file)
        with_trocars = re.search(r"the same with the trocars of (\w+)", description)
        if with_trocars is not None and not Path(name).stem.endswith(f"_{with_trocars[1]}"):
            message = (
                f"README.txt states that '{name}' has the trocars of '{with_trocars[1]}', but the file is named for "
                "another motion."
            )
            ledger.wrong("readme.file", message, name)
        playing = re.search(r"playing (\w+)", description)
        if playing is None or not motions:
            continue
        motion = playing[1]
        if motion not in motions and not _ends_with_motion(motions, motion):
            message = f"README.txt states that '{name}' plays '{motion}', but the files have no such motion."
            ledger.wrong("readme.file", message, name)
    listed_folders = tuple(name for name in listed if name.endswith("/"))
    for content in contents:
        is_listed = content.file in listed or f"{content.file}/" in listed or content.file.startswith(listed_folders)
        if rows and not is_listed:
            ledger.wrong("readme.file", f"README.txt does not list '{content.file}'.", content.file)


def _ends_with_motion(names: Collection[str], motion: str) -> bool:
    """Return whether one of the names is <robot>_<motion>, as other programs may name the motion of a stage."""
    return any(name.endswith(f"_{motion}") for name in names)


def _is_audited(file: str) -> bool:
    """Return whether a file has a suffix of a format with which the audit reads each file by itself."""
    path = Path(file)
    if path.name == PROOF or path.name.endswith(".schema.json"):
        return False
    return any(format.variant(path) is not None for format in audit_formats())


def _named_motions(contents: Sequence[Content]) -> set[str]:
    """Return the motions of the files that state the names of their motions; those of stages have the file's name."""
    names = set()
    for content in contents:
        if content.is_track or kind_holds(content.format, Holds.ALL_MOTIONS):
            names.update(clip.name for clip in content.clips)
    return names


def _check_motions(text: str, contents: Sequence[Content], ledger: Ledger) -> None:
    """Compare the list of motions in README.txt with the tracks."""
    tracks = _playing(contents)
    rows: dict[str, re.Match[str]] = {}
    for row in _MOTION.finditer(text):
        rows[row["name"]] = row
    if rows or "\nMotions\n---" in text:
        for name in sorted(tracks.keys() - rows.keys()):
            message = (
                f"motion '{name}' is not in the list of motions in README.txt, or its line there has another form."
            )
            ledger.wrong("readme.motion", message, name)
    for name, row in rows.items():
        if name in tracks:
            _check_motion(row, tracks[name], ledger)
        elif tracks:
            ledger.wrong("readme.motion", f"motion '{name}' has no track.", name)


def _check_motion(row: re.Match[str], track: Content, ledger: Ledger) -> None:
    name = row["name"]
    data = track.extra["data"]
    clip = track.clips[0]
    for description, value, real in (
        ("the duration in s", row["duration"], clip.duration),
        ("the number of keys", row["keys"], len(clip.times)),
        ("the key rate in Hz", row["rate"], data.get("rate")),
        ("the error between keys in um", row["position"], _times(data.get("between_position"), 1e6)),
        ("the error between keys in degrees", row["rotation"], _times(data.get("between_rotation"), math.degrees(1.0))),
        ("the gap of joints in um", row["gap"], _times(data.get("joint_gap"), 1e6)),
    ):
        if not isinstance(real, int | float):
            continue
        digits = len(value.partition(".")[2])
        rounding = 0.51 * 10.0**-digits  # half of the last digit, and a little for numbers that are rounded twice
        if abs(float(value) - real) > rounding:
            message = f"motion '{name}': {description} is {value}; in {track.file} it is {real:.{max(digits, 1)}f}."
            ledger.wrong("readme.motion", message, name)
    title = str(data.get("title", row["title"]))
    if title != row["title"]:
        message = f"motion '{name}' has the title '{row['title']}'; in {track.file} it is '{title}'."
        ledger.wrong("readme.motion", message, name)


def _times(value: Any, factor: float) -> float | None:
    """Return the product of a stated number and a factor; None if the file states no number."""
    if not isinstance(value, int | float):
        return None
    return value * factor


def _check_list(text: str, contents: Sequence[Content], ledger: Ledger) -> None:
    """Compare the assumptions in README.txt with those in the tracks; without tracks, with the parameters of stages."""
    protocols = set()
    listed = set()
    for content in contents:
        if not content.is_track:
            continue
        lines = content.extra["data"].get("assumed")
        if isinstance(lines, list):
            protocols.add(_protocol(content))
            for line in lines:
                listed.add(_plain(str(line)))
    if "\nAssumed" not in text:
        return
    stated = set()
    for line in _section(text, "Assumed").splitlines():
        if line.startswith("- "):
            stated.add(_without_protocols(_plain(line[2:]), protocols))
    if not protocols:
        compare_assumed(sorted(stated), ledger.file, contents)
        return
    # "- none" stands there where nothing is assumed.
    stated.discard("none")
    for lacking, source in ((sorted(listed - stated), "README.txt"), (sorted(stated - listed), "the tracks")):
        if lacking:
            text = f"the assumption '{_clipped(lacking[0])}'{_more(lacking)} is not in {source}."
            ledger.wrong("readme.assumed", text, "Assumed", size=float(len(lacking)))


def _plain(text: str) -> str:
    """Return a text with single spaces: README.txt wraps lines."""
    return " ".join(text.split())


def _without_protocols(line: str, protocols: Collection[str]) -> str:
    """Return a line "protocol, protocol: assumption" without its protocols; other lines are unchanged."""
    front, colon, assumption = line.partition(": ")
    if colon and set(front.split(", ")) <= set(protocols):
        return assumption
    return line


def _clipped(line: str) -> str:
    """Return at most the first 57 characters of a line: a message should show which line it is, not repeat it."""
    if len(line) < _LONGEST_QUOTE:
        return line
    return f"{line[: _LONGEST_QUOTE - 3]}…"


def _section(text: str, title: str) -> str:
    """Return the lines below an underlined title, up to the next title."""
    section_match = re.search(rf"^{title}[^\n]*\n-+\n(.*?)(?=^[^\n]+\n-{{3,}}\n|\Z)", text, re.MULTILINE | re.DOTALL)
    if section_match is None:
        return ""
    return section_match[1]


def check_proof_clips(proof: JsonMapping, contents: Iterable[Content], ledger: Ledger) -> None:
    """Compare the list of motions in a proof.json with the tracks; `proof` is the content of the proof.json."""
    rows = proof.get("clips")
    if not isinstance(rows, list):
        return
    tracks = _playing(contents)
    for row in rows:
        if isinstance(row, dict) and str(row.get("protocol")) in tracks:
            _check_proof_clip(row, tracks[str(row.get("protocol"))], ledger)


def _check_proof_clip(row: JsonMapping, track: Content, ledger: Ledger) -> None:
    data = track.extra["data"]
    clip = track.clips[0]
    for key, real in (
        ("rate", data.get("rate")),
        ("keys", len(clip.times)),
        ("duration_s", clip.duration),
        ("between_position_m", data.get("between_position")),
        ("between_rotation_rad", data.get("between_rotation")),
        ("joint_gap_m", data.get("joint_gap")),
    ):
        stated = row.get(key)
        if not isinstance(real, int | float) or not is_number(stated):  # `check_statements` reports other values
            continue
        if abs(stated - real) > _STATED_DIGITS * abs(real):
            text = f"clip '{row['protocol']}': {key} is {stated:g}; in {track.file} it is {real:g}."
            ledger.wrong("proof.clip", text, key)
