"""Read tracks and report their faults: JSON of flat arrays (schema "twin-track"), and CSV.

A track contains these mechanism data: joints with one coordinate and their limits, driven joints, and named frames.
"""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import Any

import numpy as np

from twin.core.foreign.admit import admit
from twin.core.json_types import JsonObject
from twin.exchange.audit import poses
from twin.exchange.audit.context import Context
from twin.exchange.audit.motion import Content, FileClip, check_poses, check_quaternions, check_rate, check_times
from twin.exchange.audit.physics import TOOL, FileDrive, FileFrame, FileJoint, FilePhysics
from twin.exchange.audit.poses import Array
from twin.exchange.audit.report import Ledger, Measured, ReadError
from twin.exchange.formats.tracks.audit.rcm import check_rcm

SCHEMA = "twin-track"

WORDS = {
    "frame": "z-up right-handed",
    "length_unit": "m",
    "angle_unit": "rad",
    "quaternion_order": "xyzw",
}
"""Entries for which version 1 of the schema allows a single value; players require this value."""

LIMIT_TOL = 1e-6
"""Maximum violation of a joint limit, in m or rad, that counts as a rounding error."""

NO_LIMIT = 1e29
"""Value in m or rad from which a limit means "no limit", because JSON has no infinity."""


def is_track(data: Any) -> bool:
    """Return whether parsed JSON is a track."""
    return isinstance(data, dict) and data.get("schema") == SCHEMA


def read_json(path: Path, ledger: Ledger) -> Content:
    """Return the content of a track, and report its faults.

    Raises:
        ReadError: the file is not JSON, or lacks required entries.
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (UnicodeDecodeError, ValueError, RecursionError) as error:
        raise ReadError(f"the file's JSON cannot be read: {str(error)[:120]}") from error
    if not is_track(data):
        raise ReadError(f'the file does not contain "schema": "{SCHEMA}"')
    return _content(data, "tracks", ledger)


def read_csv(path: Path, ledger: Ledger) -> Content:
    """Return the content of a CSV track: lines `# name: value`, a header with units, and one line for each key.

    Raises:
        ReadError: the header or all lines are missing, or a number is invalid.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except UnicodeDecodeError as error:
        raise ReadError("the file is not text") from error
    data: JsonObject = {}
    while lines and lines[0].startswith("#"):
        key, colon, value = lines.pop(0).lstrip("# ").partition(":")
        if colon:
            data[key.strip()] = _parsed(value.strip())
    rows = list(csv.reader(io.StringIO("\n".join(lines))))
    if not is_track(data) or len(rows) < 2:
        raise ReadError(
            f"the file lacks the line '# schema: {SCHEMA}', the line with the column names, or the lines of numbers"
        )
    header, body = rows[0], rows[1:]
    try:
        numbers = np.array(body, float)
    except ValueError as error:
        text = f"a line does not consist of {len(header)} numbers: {str(error)[:80]}"
        raise ReadError(text) from error
    if numbers.shape[1] != len(header) or header[0] != "time_s":
        raise ReadError(
            f"the line of column names has {len(header)} columns, the first '{header[0]}'; the lines of numbers have "
            f"{numbers.shape[1]} columns. The counts must be equal, and the first column must be time_s"
        )
    links, joints, kinds = (_list(data, key) for key in ("links", "joints", "joint_types"))
    units = ["rad" if k == "revolute" else "m" for k in kinds]
    expected = ["time_s", *(f"{j}_{u}" for j, u in zip(joints, units, strict=False))]
    expected += [f"{n}_{c}" for n in links for c in ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")]
    if header != expected:
        odd = next((f"'{a}' instead of '{b}'" for a, b in zip(header, expected, strict=False) if a != b), "")
        found = odd or f"{len(header)} columns instead of {len(expected)}"
        text = f"columns do not match links and joints: found {found}."
        ledger.wrong("tracks.columns", text, odd)
        if len(header) != len(expected):
            raise ReadError(text)
    n = 1 + len(joints)
    data |= {"times": numbers[:, 0], "positions": numbers[:, 1:n].ravel(), "poses": numbers[:, n:].ravel()}
    return _content(data, "csv", ledger)


def _parsed(value: str) -> Any:
    try:
        return json.loads(value)
    except ValueError:
        return value


def _content(data: JsonObject, kind: str, ledger: Ledger) -> Content:
    links, joints = _list(data, "links"), _list(data, "joints")
    name = str(data.get("protocol", ""))
    out = Content(ledger, kind, model_hash=str(data.get("model_hash", "")), declared=tuple(links))
    out.facts = {"units": data.get("length_unit", "?"), "up_axis": "Z", "handedness": "right", "protocol": name}
    out.physics = _physics(data, links, joints)
    out.extra["data"] = {k: v for k, v in data.items() if k not in ("poses", "positions", "times")}
    _check_words(data, ledger)
    moved, known = data.get("moved_frame"), data.get("frame_names")
    if moved and isinstance(known, list) and moved not in known:
        text = f"moved_frame is '{moved}', but no frame has this name (known: {', '.join(map(str, known))})."
        ledger.wrong("tracks.frame", text, "moved_frame")
    for key, names in (("links", links), ("joints", joints)):
        if twice := {n for n in names if names.count(n) > 1}:
            text = f"{key} contains '{min(twice)}' more than once."
            ledger.wrong("tracks.duplicate_name", text, min(twice))
    times = _numbers(data, "times", ledger)
    shapes = {"poses": (len(times), len(links), 7), "positions": (len(times), len(joints))}
    rows = {key: _shaped(data, key, shape, ledger) for key, shape in shapes.items()}
    frames = data.get("frames", len(times))
    if frames != len(times):
        text = f"entry 'frames' is {frames}, but 'times' has {len(times)} entries."
        ledger.wrong("tracks.shape", text, "frames", size=float(len(times)))
    usable = check_times(ledger, times, name, "tracks")
    if usable and isinstance(data.get("rate"), int | float):
        check_rate(ledger, times, float(data["rate"]), name)
    _check_phases(data, times, ledger)
    seven, positions = rows["poses"], rows["positions"]
    if not usable or seven is None:
        ledger.row("arrays and times", 1.0, "found", 0.0)
        return out
    for i, link in enumerate(links):
        check_quaternions(ledger, seven[:, i, 3:], times, link, "tracks")
    T = {link: poses.from_seven(seven[:, i]) for i, link in enumerate(links)}
    q = {} if positions is None else {joint: positions[:, i] for i, joint in enumerate(joints)}
    clip = FileClip(name, times, T, q)
    check_poses(ledger, clip, "tracks")
    out.clips.append(clip)
    _check_limits(data, joints, clip, ledger)
    for key, name in (("lower", "joint_lower"), ("upper", "joint_upper")):
        out.extra[key] = dict(zip(joints, _numbers(data, name, ledger).tolist(), strict=False))
    check_rcm(data, clip, _numbers(data, "frames_local", ledger), ledger)
    return out


def _check_words(data: JsonObject, ledger: Ledger) -> None:
    if data.get("version") != 1:
        ledger.wrong("tracks.version", f"version is {data.get('version')!r}, but must be 1.", "version")
    for key, value in WORDS.items():
        if data.get(key) != value:
            text = f"{key} is {data.get(key)!r}; version 1 of the schema allows only '{value}', which players require."
            ledger.wrong("tracks.convention", text, key, suggestion=f"convert the numbers and write '{value}'")


def _list(data: JsonObject, key: str) -> list[str]:
    value = data.get(key)
    if not isinstance(value, list) or not all(isinstance(v, str) for v in value):
        raise ReadError(f"'{key}' is not a list of strings")
    return value


def _numbers(data: JsonObject, key: str, ledger: Ledger) -> Array:
    value = data.get(key)
    try:
        out = np.array(value if value is not None else [], float)
    except (TypeError, ValueError) as error:
        raise ReadError(f"'{key}' is not a flat list of numbers") from error
    if out.ndim != 1:
        raise ReadError(f"'{key}' is not a flat list: Unity's parser (JsonUtility) reads no nested lists")
    if not np.all(np.isfinite(out)):
        ledger.wrong("tracks.finite", f"{key} contains numbers that are not finite.", key)
    return out


def _shaped(data: JsonObject, key: str, shape: tuple[int, ...], ledger: Ledger) -> Array | None:
    """Return the flat list `data[key]` as an array of the given shape; None, with a finding, if its length is wrong."""
    flat = _numbers(data, key, ledger)
    if flat.size != int(np.prod(shape)):
        text = f"{key} has {flat.size} numbers, not {' x '.join(map(str, shape))} = {int(np.prod(shape))}."
        ledger.wrong(
            "tracks.shape",
            text,
            key,
            size=Measured(flat.size, float(np.prod(shape))),
            suggestion="write all components of the first link or joint at the first time, then of the next link or "
            "joint, then of the next time",
        )
        return None
    return flat.reshape(shape)


def _check_phases(data: JsonObject, times: Array, ledger: Ledger) -> None:
    names = data.get("phases", [])
    start, end = _numbers(data, "phase_start", ledger), _numbers(data, "phase_end", ledger)
    if not (len(names) == len(start) == len(end)):
        text = f"{len(names)} phases have {len(start)} starts and {len(end)} ends."
        ledger.wrong("tracks.shape", text, "phases")
        return
    last = float(times[-1]) if len(times) else 0.0
    slack = 1e-6
    for i, name in enumerate(names):
        wrong = ""
        if not start[i] <= end[i]:
            wrong = f"ends at {end[i]:.6g} s, before it starts at {start[i]:.6g} s"
        elif i and start[i] < end[i - 1] - slack:
            wrong = f"starts at {start[i]:.6g} s, before phase '{names[i - 1]}' ends at {end[i - 1]:.6g} s"
        elif start[i] < -slack or end[i] > last + slack:
            wrong = f"lasts from {start[i]:.6g} to {end[i]:.6g} s, but the motion lasts from 0 to {last:.6g} s"
        if wrong:
            text = f"phase '{name}' {wrong}."
            ledger.wrong("tracks.phases", text, str(name), when=f"t = {start[i]:.4g} s")


def _check_limits(data: JsonObject, joints: list[str], clip: FileClip, ledger: Ledger) -> None:
    low, high = _numbers(data, "joint_lower", ledger), _numbers(data, "joint_upper", ledger)
    kinds = data.get("joint_types", [])
    for key, value in (("joint_types", kinds), ("joint_lower", low), ("joint_upper", high)):
        if len(value) != len(joints):
            text = f"{key} has {len(value)} entries for {len(joints)} joints."
            ledger.wrong("tracks.shape", text, key)
            return
    worst, where, when = 0.0, "", ""
    for i, joint in enumerate(joints):
        q = clip.joints.get(joint)
        if q is None:
            continue
        angle = kinds[i] == "revolute"
        if not low[i] <= high[i]:
            text = f"joint '{joint}': lower limit {low[i]:g} is above upper limit {high[i]:g}."
            ledger.wrong("tracks.limits", text, joint, suggestion="exchange the limits")
            continue
        breach = np.maximum(np.maximum(low[i] - q, q - high[i]), 0)
        k = int(np.argmax(breach))
        if breach[k] > worst:
            worst, where, when = float(breach[k]), joint, f"t = {clip.times[k]:.4g} s"
        if breach[k] > LIMIT_TOL:
            scale, unit = (180 / np.pi, "deg") if angle else (1e3, "mm")
            inside = angle and np.all((np.radians(q) >= low[i]) & (np.radians(q) <= high[i]))
            text = (
                f"joint '{joint}' is at {q[k] * scale:.5g} {unit}, {breach[k] * scale:.4g} {unit} beyond its "
                f"limits{'; as a value in degrees, it would be within the limits' if inside else ''}."
            )
            ledger.wrong(
                "tracks.limits",
                text,
                joint,
                size=Measured(breach[k] * scale, LIMIT_TOL * scale, unit),
                when=f"t = {clip.times[k]:.4g} s",
                suggestion="write angles in radians and lengths in metres",
            )
    ledger.row("joints beyond their limits", worst, "rad or m", LIMIT_TOL, where=where, when=when)


def _physics(data: JsonObject, links: list[str], joints: list[str]) -> FilePhysics:
    """Return the mechanism data of a track; missing entries are skipped, because the reader has reported them."""
    out = FilePhysics(tuple(links))
    kinds, active = data.get("joint_types", []), data.get("joint_active", [])
    low, high = data.get("joint_lower", []), data.get("joint_upper", [])
    for i, name in enumerate(joints):
        limits = None
        if i < min(len(low), len(high)):
            limits = (-np.inf if low[i] < -NO_LIMIT else low[i], np.inf if high[i] > NO_LIMIT else high[i])
        drive = FileDrive(limits, bool(active[i]) if i < len(active) else None)
        kind = str(kinds[i]) if i < len(kinds) else ""
        out.joints.append(FileJoint((name,), "", "", drive=drive, kind_said=kind))
    local = np.array(data.get("frames_local", []), float)
    names, on = data.get("frame_names", []), data.get("frame_links", [])
    if len(names) == len(on) and local.size == 7 * len(names):
        for name, link, row in zip(names, on, local.reshape(-1, 7), strict=True):
            out.frames[str(name)] = FileFrame(str(link), poses.from_seven(row))
        out.marks = frozenset({"frame"} if names else ())
    tool = np.array(data.get("tool_frame", []), float)
    if tool.shape == (7,):
        out.frames[TOOL] = FileFrame(str(data.get("tool_link", "")), poses.from_seven(tool))
    return out


def read(path: Path, ledger: Ledger, context: Context) -> Content | None:
    """Return the content of a track, JSON or CSV, and report its faults."""
    ledger.tool, ledger.version = "twin.exchange.audit tracks", "1"
    admit(path)
    if path.suffix.lower() == ".csv":
        return read_csv(path, ledger)
    return read_json(path, ledger)
