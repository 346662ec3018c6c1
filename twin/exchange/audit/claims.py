"""Check data of files that are not poses: stated interpolation errors, header entries, assumptions, README.txt."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from twin.core.json_types import JsonMapping
from twin.exchange.audit.between import halved
from twin.exchange.audit.motion import Content, Shape
from twin.exchange.audit.physics import Joint, Physics
from twin.exchange.audit.report import Ledger, Measured, quantity

TOO_GOOD = 3.0
"""Maximum ratio of the estimated error to the stated error; at higher ratios, the stated error is too small."""

TOO_BAD = 20.0
"""Maximum ratio of the stated error to the estimated error; at higher ratios, the stated error is too large.

The ratio 4 is normal for a stage, whose stated error is measured with every second sample removed.
"""

_FLOOR = (1e-6, 1e-6, 1e-6)
"""Errors that rounded numbers can cause in an estimate: position in m, rotation in rad, joint gap in m."""

_STATED = (
    ("between_position", "any point of a link between keys", "m"),
    ("between_rotation", "rotation of a link between keys", "rad"),
    ("joint_gap", "gap of a joint between keys", "m"),
)


def check_claims(contents: Sequence[Content]) -> None:
    """Report statements of a file that contradict other data of the same file."""
    tracks = [c for c in contents if c.format in ("tracks", "csv") and "data" in c.extra]
    shapes = next((c.shapes for c in contents if c.shapes and c.declared), {})
    physics = next((c.physics for c in contents if c.physics is not None and _places(c.physics)), Physics())
    held = physics.held or frozenset()
    # Joints on the world, such as trocars, may have a different position in each motion.
    joints = [
        j for j in physics.joints if not physics.trocars & set(j.names) and not (j.tied and held & {j.parent, j.child})
    ]
    tables = {str(c.extra["data"].get("protocol")): c for c in tracks if c.format == "tracks"}
    for content in tracks:
        _check_between(content, shapes, joints)
        other = tables.get(str(content.extra["data"].get("protocol")))
        if content.format == "csv" and other is not None:
            _check_heads(content, other)
    _check_assumed(contents, tracks)
    _check_same_robot(tracks)


def _places(physics: Physics) -> bool:
    """Return whether a file states all joints, and where they are."""
    return physics.complete and any(j.T is not None or j.tied for j in physics.joints)


def _check_between(content: Content, shapes: Mapping[str, Shape], joints: Sequence[Joint]) -> None:
    data = content.extra["data"]
    if not content.clips or (loss := halved(content.clips[0], shapes, joints)) is None:
        return
    for (key, text, unit), cost, floor in zip(_STATED, loss, _FLOOR, strict=True):
        said, estimate = data.get(key), cost / 4
        if not isinstance(said, int | float) or (key == "joint_gap" and not joints):
            continue
        low = said < estimate / TOO_GOOD and estimate > floor
        high = said > TOO_BAD * max(estimate, floor) and (shapes or key != "between_position")
        message = f"{key}: stated error compared with an estimate from every second key"
        content.ledger.row(message, abs(estimate - said), unit, fits=not low)
        if low or high:
            message = (
                f"{key} states an error of {quantity(said, unit)} for {text}, but the estimate is "
                f"{quantity(estimate, unit)}: a quarter of the error with every second key left out, "
                f"{quantity(cost, unit)}."
            )
            content.ledger.wrong(f"claims.{key}", message, key, size=Measured(said, estimate, unit))


def _check_heads(table: Content, other: Content) -> None:
    mine, its = table.extra["data"], other.extra["data"]
    for key in dict.fromkeys((*its, *mine)):
        if key not in mine or key not in its:
            here, there = (other.file, table.file) if key in its else (table.file, other.file)
            text = f"the entry '{key}' is in {here}, but not in {there}."
        elif not _equal(mine[key], its[key]):
            text = f"'{key}' is {_short(mine[key])}; in {other.file} it is {_short(its[key])}."
        else:
            continue
        table.ledger.wrong("claims.head", text, key, suggestion="write both files from one source")


def _equal(a: Any, b: Any) -> bool:
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
            a, b = (c.extra["data"].get(key) for c in (content, first))
            if not _equal(a, b):
                text = f"'{key}' is {_short(a)}; in {first.file} it is {_short(b)}."
                content.ledger.wrong("claims.robot", text, key)


def _check_assumed(contents: Sequence[Content], tracks: Sequence[Content]) -> None:
    """Report numbers that a stage marks as ASSUMED, but that a track does not list as assumed."""
    known = next((c for c in contents if c.extra.get("assumed")), None)
    names: Mapping[str, str] = {} if known is None else known.extra["assumed"]
    for content in tracks:
        lines = content.extra["data"].get("assumed")
        if not isinstance(lines, list):
            continue
        listed = {head(line) for line in map(str, lines)}
        lacking = [n for n in names if n not in listed and not n.startswith("drawing.")]
        if known is not None and lacking:
            more = f" and {len(lacking) - 1} more" if len(lacking) > 1 else ""
            text = (
                f"the file's list of assumed numbers lacks '{lacking[0]}'{more}, which {known.file} lists as assumed."
            )
            content.ledger.wrong("claims.assumed", text, "assumed", size=float(len(lacking)))


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


def check_readme(contents: Sequence[Content], path: Path, ledger: Ledger) -> None:
    """Report statements in a README.txt that are false for the files in the same folder."""
    try:
        raw = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        ledger.wrong("readme.unreadable", f"README.txt cannot be read: {error}.")
        return
    text = re.sub(r"[ \t]*\n[ \t]+", " ", raw)  # join wrapped lines
    for topic, pattern, expected in STATEMENTS:
        found = re.search(pattern, text)
        if found and tuple(g.lower() for g in found.groups()) != expected:
            said = " / ".join(found.groups())
            message = f"README.txt states '{said}' for {topic}; the files have '{' / '.join(expected)}'."
            ledger.wrong("readme.convention", message, topic)
    _check_listed(path.parent, raw, contents, ledger)
    _check_motions(text, contents, ledger)
    _check_list(text, contents, ledger)
    wrong = [f for f in ledger.found if f.severity != "info"]
    ledger.row("README.txt against the files", float(len(wrong)), "found", 0.0, against="the files")


def _check_listed(folder: Path, raw: str, contents: Sequence[Content], ledger: Ledger) -> None:
    rows = re.findall(r"^(\S+?)(?:, (\.\w+))?  +(.*)$", _section(raw, "What is where"), re.MULTILINE)
    # A stage does not state the name of its motion; the clip has the name of the file.
    clips = {clip.name for c in contents if c.format in ("glb", "tracks") for clip in c.clips}
    for name, also, what in rows:
        for file in (name, *([str(Path(name).with_suffix(also))] if also else [])):
            if file != "proof.json" and not (folder / file).exists():
                ledger.wrong("readme.file", f"README.txt lists '{file}', which does not exist.", file)
        playing = re.search(r"playing (\w+)", what)
        if playing and clips and playing[1] not in clips and not any(c.endswith(f"_{playing[1]}") for c in clips):
            message = f"README.txt states that '{name}' plays '{playing[1]}', but the files have no such motion."
            ledger.wrong("readme.file", message, name)


def _check_motions(text: str, contents: Sequence[Content], ledger: Ledger) -> None:
    tables = {str(c.extra["data"].get("protocol")): c for c in contents if c.format == "tracks" and c.clips}
    said = {m["name"]: m for m in _MOTION.finditer(text)}
    for name in tables.keys() - said.keys() if said else ():
        ledger.wrong("readme.motion", f"motion '{name}' is missing from the list of motions in README.txt.", name)
    for name, m in said.items():
        if (track := tables.get(name)) is None:
            if tables:
                ledger.wrong("readme.motion", f"motion '{name}' has no track.", name)
            continue
        data, clip = track.extra["data"], track.clips[0]
        for what, value, real in (
            ("the duration in s", m["duration"], clip.duration),
            ("the number of keys", m["keys"], len(clip.times)),
            ("the key rate in Hz", m["rate"], data.get("rate")),
            ("the error between keys in um", m["position"], _times(data.get("between_position"), 1e6)),
            ("the error between keys in degrees", m["rotation"], _times(data.get("between_rotation"), 57.29577951)),
            ("the gap of joints in um", m["gap"], _times(data.get("joint_gap"), 1e6)),
        ):
            digits = len(value.partition(".")[2])
            if isinstance(real, int | float) and abs(float(value) - real) > 0.51 * 10.0**-digits:
                message = f"motion '{name}': {what} is {value}; in {track.file} it is {real:.{max(digits, 1)}f}."
                ledger.wrong("readme.motion", message, name)
        if str(data.get("title", m["title"])) != m["title"]:
            message = f"motion '{name}' has the title '{m['title']}'; in {track.file} it is '{data.get('title')}'."
            ledger.wrong("readme.motion", message, name)


def _times(value: Any, factor: float) -> Any:
    return value * factor if isinstance(value, int | float) else None


def _check_list(text: str, contents: Sequence[Content], ledger: Ledger) -> None:
    tables = [c for c in contents if c.format == "tracks" and isinstance(c.extra["data"].get("assumed"), list)]
    if not tables or "\nAssumed" not in text:
        return
    lines = [" ".join(x[2:].split()) for x in _section(text, "Assumed").splitlines() if x.startswith("- ")]
    names = {str(c.extra["data"].get("protocol")) for c in tables}
    bare = set()
    for line in lines:
        front, colon, rest = line.partition(": ")
        of_protocols = colon and all(n in names for n in front.split(", "))
        bare.add(rest if of_protocols else line)
    bare.discard("none")
    listed = {" ".join(str(a).split()) for c in tables for a in c.extra["data"]["assumed"]}
    for lacking, who in ((sorted(listed - bare), "README.txt"), (sorted(bare - listed), "the tracks")):
        if lacking:
            more = f" and {len(lacking) - 1} more" if len(lacking) > 1 else ""
            text = f"the assumption '{_clipped(lacking[0])}'{more} is not in {who}."
            ledger.wrong("readme.assumed", text, "Assumed", size=float(len(lacking)))


def _clipped(line: str) -> str:
    return line if len(line) < 60 else f"{line[:57]}…"


def _section(text: str, title: str) -> str:
    """Return the lines below an underlined title, up to the next title."""
    found = re.search(rf"^{title}[^\n]*\n-+\n(.*?)(?=^[^\n]+\n-{{3,}}\n|\Z)", text, re.MULTILINE | re.DOTALL)
    return found[1] if found else ""


def check_proof_clips(proof: JsonMapping, contents: Iterable[Content], ledger: Ledger) -> None:
    """Compare the list of motions in a proof.json with the tracks; `proof` is the content of the proof.json."""
    rows = proof.get("clips")
    tables = {str(c.extra["data"].get("protocol")): c for c in contents if c.format == "tracks" and c.clips}
    for row in rows if isinstance(rows, list) else ():
        track = tables.get(str(row.get("protocol"))) if isinstance(row, dict) else None
        if track is None:
            continue
        own, clip = track.extra["data"], track.clips[0]
        for key, real in (
            ("rate", own.get("rate")),
            ("keys", len(clip.times)),
            ("duration_s", clip.duration),
            ("between_position_m", own.get("between_position")),
            ("between_rotation_rad", own.get("between_rotation")),
            ("joint_gap_m", own.get("joint_gap")),
        ):
            said = row.get(key)
            if isinstance(real, int | float) and isinstance(said, int | float) and abs(said - real) > 1e-5 * abs(real):
                text = f"clip '{row['protocol']}': {key} is {said:g}; in {track.file} it is {real:g}."
                ledger.wrong("proof.clip", text, key)
