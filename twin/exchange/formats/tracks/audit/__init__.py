"""Read tracks and report their faults: JSON of flat arrays (schema "twin-track"), and CSV.

A track contains these mechanism data: joints with one coordinate and their limits, driven joints, and named frames.
"""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from pathlib import Path

import numpy as np

from twin.core.foreign.admit import admit
from twin.core.json_types import JsonObject
from twin.exchange.audit import poses
from twin.exchange.audit.clip_checks import check_poses, check_quaternions, check_rate, check_times
from twin.exchange.audit.file_content import Content, FileClip
from twin.exchange.audit.file_drives import FileDrive
from twin.exchange.audit.file_joints import FileJoint
from twin.exchange.audit.file_statements import ROBOT
from twin.exchange.audit.ledger import Ledger, Measured, ReadError
from twin.exchange.audit.mechanism_data import TOOL, FileFrame, FileMechanism
from twin.exchange.audit.poses import Array
from twin.exchange.audit.reader_context import Context
from twin.exchange.formats.tracks.audit.csv_table import SCHEMA, csv_data, is_track, names_in
from twin.exchange.formats.tracks.audit.joint_limits import check_joint_limits
from twin.exchange.formats.tracks.audit.number_lists import entry_numbers, flat_numbers, report_not_finite
from twin.exchange.formats.tracks.audit.rcm import check_rcm
from twin.exchange.formats.tracks.audit.schema_file import check_schema

_CONVENTIONS = {
    "frame": "z-up right-handed",
    "length_unit": "m",
    "angle_unit": "rad",
    "quaternion_order": "xyzw",
}
"""Entries for which version 1 of the schema allows a single value; players require this value."""

_FRAME = re.compile(r"(?P<axis>[xyz])-up (?P<hand>left|right)-handed")

_TIME_ROUNDING = 1e-6
"""Difference in s of times of phases and keys that is only rounding: they may be rounded differently."""

NO_LIMIT = 1e29
"""Value in m or rad from which a limit means "no limit", because JSON has no infinity."""


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
    """Return the content of a CSV track, and report its faults.

    Raises:
        ReadError: the header or all lines are missing, or a number is invalid.
    """
    return _content(csv_data(path, ledger), "csv", ledger)


def _content(data: JsonObject, kind: str, ledger: Ledger) -> Content:
    links = names_in(data, "links")
    joints = names_in(data, "joints")
    name = str(data.get("protocol", ""))
    content = Content(ledger, kind, model_hash=str(data.get("model_hash", "")), declared=tuple(links))
    units = data.get("length_unit", "?")
    content.facts = {"units": units, **_frame_facts(data), "protocol": name}
    _state_facts(content, data, name)
    content.mechanism = _mechanism(data, links, joints, ledger)
    short_entries = dict(data)
    # The clip has the long lists; left here, they would be compared as entries of the header.
    for key in ("poses", "positions", "times"):
        short_entries.pop(key, None)
    content.extra["data"] = short_entries
    _check_conventions(data, ledger)
    _check_moved_frame(data, ledger)
    _check_duplicates("links", links, ledger)
    _check_duplicates("joints", joints, ledger)
    times = _numbers(data, "times", ledger)
    seven = _shaped_numbers(data, "poses", (len(times), len(links), 7), ledger)
    positions = _shaped_numbers(data, "positions", (len(times), len(joints)), ledger)
    frames = data.get("frames", len(times))
    if frames != len(times):
        text = f"entry 'frames' is {frames}, but 'times' has {len(times)} entries."
        ledger.wrong("tracks.shape", text, "frames", size=float(len(times)))
    usable = check_times(ledger, times, name, "tracks")
    if usable and isinstance(data.get("rate"), int | float):
        check_rate(ledger, times, float(data["rate"]), name)
    _check_phases(data, times, ledger)
    if not usable or seven is None:  # without times and poses there is no motion to check
        ledger.row("arrays and times", 1.0, "found", 0.0)
        return content
    T_world_link: dict[str, Array] = {}
    for number, link in enumerate(links):
        check_quaternions(ledger, seven[:, number, 3:], times, link, "tracks")
        T_world_link[link] = poses.from_seven(seven[:, number])
    joint_values: dict[str, Array] = {}
    if positions is not None:
        joint_values = dict(zip(joints, positions.T, strict=True))
    clip = FileClip(name, times, T_world_link, joint_values)
    check_poses(ledger, clip, "tracks")
    content.clips.append(clip)
    lower = _numbers(data, "joint_lower", ledger)
    upper = _numbers(data, "joint_upper", ledger)
    check_joint_limits(data, joints, lower, upper, clip, ledger)
    content.extra["lower"] = dict(zip(joints, lower.tolist(), strict=False))
    content.extra["upper"] = dict(zip(joints, upper.tolist(), strict=False))
    check_rcm(data, clip, _numbers(data, "frames_local", ledger), ledger)
    return content


def _frame_facts(data: JsonObject) -> dict[str, str]:
    """Return the up axis and the handedness that the entry `frame` states, as "z-up right-handed"; "?" for others."""
    match = _FRAME.fullmatch(str(data.get("frame", "")).lower())
    if match is None:
        return {"up_axis": "?", "handedness": "?"}
    return {"up_axis": match["axis"].upper(), "handedness": match["hand"]}


def _state_facts(content: Content, data: JsonObject, clip: str) -> None:
    """Store what other formats state as well: the name of the robot, and the numbers of the clip."""
    if "robot" in data:
        content.stated[ROBOT] = data["robot"]
    for key in ("title", "rate", "between_position", "between_rotation", "joint_gap"):
        if key in data:
            content.stated[f"{key} of clip '{clip}'"] = data[key]


def _check_moved_frame(data: JsonObject, ledger: Ledger) -> None:
    moved_frame = data.get("moved_frame")
    frame_names = data.get("frame_names")
    if moved_frame and isinstance(frame_names, list) and moved_frame not in frame_names:
        text = (
            f"moved_frame is '{moved_frame}', but no frame has this name (known: {', '.join(map(str, frame_names))})."
        )
        ledger.wrong("tracks.frame", text, "moved_frame")


def _check_duplicates(key: str, names: list[str], ledger: Ledger) -> None:
    """Report the alphabetically first name that is more than once in a list."""
    repeated = [name for name, count in Counter(names).items() if count > 1]
    if repeated:
        first = min(repeated)
        ledger.wrong("tracks.duplicate_name", f"{key} contains '{first}' more than once.", first)


def _check_conventions(data: JsonObject, ledger: Ledger) -> None:
    if data.get("version") != 1:
        ledger.wrong("tracks.version", f"version is {data.get('version')!r}, but must be 1.", "version")
    for key, value in _CONVENTIONS.items():
        if data.get(key) != value:
            text = f"{key} is {data.get(key)!r}; version 1 of the schema allows only '{value}', which players require."
            ledger.wrong("tracks.convention", text, key, suggestion=f"convert the numbers and write '{value}'")


def _numbers(data: JsonObject, key: str, ledger: Ledger) -> Array:
    """Return a flat list (k,) of numbers; report numbers that are not finite."""
    numbers = flat_numbers(data, key)
    report_not_finite(numbers, key, ledger)
    return numbers


def _shaped_numbers(data: JsonObject, key: str, shape: tuple[int, ...], ledger: Ledger) -> Array | None:
    """Return the flat list `data[key]` as an array of the given shape; None, with a finding, if its length is wrong."""
    flat = _numbers(data, key, ledger)
    count = math.prod(shape)
    if flat.size == count:
        return flat.reshape(shape)
    text = f"{key} has {flat.size} numbers, not {' x '.join(map(str, shape))} = {count}."
    advice = (
        "write all components of the first link or joint at the first time, then of the next link or joint, then of "
        "the next time"
    )
    ledger.wrong("tracks.shape", text, key, size=Measured(flat.size, float(count)), suggestion=advice)
    return None


def _check_phases(data: JsonObject, times: Array, ledger: Ledger) -> None:
    names = data.get("phases", [])
    start = _numbers(data, "phase_start", ledger)
    end = _numbers(data, "phase_end", ledger)
    if not (len(names) == len(start) == len(end)):
        text = f"{len(names)} phases have {len(start)} starts and {len(end)} ends."
        ledger.wrong("tracks.shape", text, "phases")
        return
    last = float(times[-1]) if len(times) else 0.0
    for number, name in enumerate(names):
        fault = ""
        if not start[number] <= end[number]:
            fault = f"ends at {end[number]:.6g} s, before it starts at {start[number]:.6g} s"
        elif number and start[number] < end[number - 1] - _TIME_ROUNDING:
            fault = (
                f"starts at {start[number]:.6g} s, before phase '{names[number - 1]}' ends at {end[number - 1]:.6g} s"
            )
        elif start[number] < -_TIME_ROUNDING or end[number] > last + _TIME_ROUNDING:
            fault = (
                f"lasts from {start[number]:.6g} to {end[number]:.6g} s, but the motion lasts from 0 to {last:.6g} s"
            )
        if fault:
            ledger.wrong("tracks.phases", f"phase '{name}' {fault}.", str(name), when=f"t = {start[number]:.4g} s")


def _mechanism(data: JsonObject, links: list[str], joints: list[str], ledger: Ledger) -> FileMechanism:
    """Return the mechanism data of a track; entries that are missing or too short are skipped.

    A pose of the tool that is not finite is reported, because it is read only here.

    Raises:
        ReadError: limits or poses of frames are no flat lists of numbers.
    """
    mechanism = FileMechanism(tuple(links))
    kinds = data.get("joint_types", [])
    active = data.get("joint_active", [])
    lower = flat_numbers(data, "joint_lower").tolist()
    upper = flat_numbers(data, "joint_upper").tolist()
    for number, name in enumerate(joints):
        limits = None
        if number < min(len(lower), len(upper)):
            low = -np.inf if lower[number] < -NO_LIMIT else lower[number]
            high = np.inf if upper[number] > NO_LIMIT else upper[number]
            limits = (low, high)
        driven = bool(active[number]) if number < len(active) else None
        kind = str(kinds[number]) if number < len(kinds) else ""
        mechanism.joints.append(FileJoint((name,), "", "", drive=FileDrive(limits, driven), stated_kind=kind))
    names = data.get("frame_names", [])
    owners = data.get("frame_links", [])
    sevens = entry_numbers(data, "frames_local")
    if len(names) == len(owners) and sevens.size == 7 * len(names):
        for name, link, seven in zip(names, owners, sevens.reshape(-1, 7), strict=True):
            mechanism.frames[str(name)] = FileFrame(str(link), poses.from_seven(seven))
        if names:
            mechanism.fully_listed = frozenset({"frame"})
    tool = entry_numbers(data, "tool_frame")
    report_not_finite(tool, "tool_frame", ledger)
    if tool.shape == (7,):
        mechanism.frames[TOOL] = FileFrame(str(data.get("tool_link", "")), poses.from_seven(tool))
    return mechanism


def read(path: Path, ledger: Ledger, context: Context) -> Content | None:
    """Return the content of a track, JSON or CSV, and report its faults."""
    ledger.tool = "twin.exchange.audit tracks"
    ledger.version = "1"
    admit(path)
    if path.suffix.lower() == ".csv":
        return read_csv(path, ledger)
    if not context.tracks:  # once, with the first track
        check_schema(path.parent, ledger)
    return read_json(path, ledger)
