"""Check what tracks state beside poses: interpolation errors, header entries, assumed numbers, moved frames."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from twin.core.json_types import JsonMapping
from twin.exchange.audit.file_content import Content, LinkShape
from twin.exchange.audit.file_joints import FileJoint
from twin.exchange.audit.file_statements import ROBOT
from twin.exchange.audit.interpolation_error import errors_at_every_second_key
from twin.exchange.audit.ledger import Ledger, Measured
from twin.exchange.audit.mechanism_data import FileMechanism
from twin.exchange.audit.proof_form import is_number
from twin.exchange.audit.value_text import quantity
from twin.exchange.format import Holds
from twin.exchange.formats import kind_holds

MAX_UNDERSTATEMENT = 3.0
"""Maximum ratio of the estimated error to the stated error; at higher ratios, the stated error is too small."""

MAX_OVERSTATEMENT = 20.0
"""Maximum ratio of the stated error to the estimated error; at higher ratios, the stated error is too large.

The ratio 4 is normal for a stage, whose stated error is measured with every second sample removed.
"""

_ROUNDING_ERRORS = (1e-6, 1e-6, 1e-6)
"""Errors that rounded numbers can cause in an estimate: position in m, rotation in rad, joint gap in m."""

_MAX_QUOTE_LENGTH = 60
"""Number of characters from which a quoted value is cut."""

_SAME_NUMBER_TOL = 1e-5
"""Relative difference of a number in proof.json and the same number in a track: both have at least six digits."""

_STATED_ERRORS = (
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
        _check_interpolation_errors(content, shapes, joints)
        track = by_protocol.get(_protocol(content))
        if content.repeats_track and track is not None:
            _check_headers(content, track)
    _check_moved_frames(contents, tracks)
    _check_assumed(contents, tracks)
    _check_same_robot(tracks)
    _check_file_names(tracks)


def _protocol(track: Content) -> str:
    return str(track.extra["data"].get("protocol"))


def _tracks_by_protocol(contents: Iterable[Content]) -> dict[str, Content]:
    """Return {protocol: track} of the tracks whose motion could be read."""
    tracks = {}
    for content in contents:
        if content.is_track and content.clips:
            tracks[_protocol(content)] = content
    return tracks


def _placed_joints(contents: Sequence[Content]) -> list[FileJoint]:
    """Return the joints of the first file that states where all are, without those that move with the protocol."""
    for content in contents:
        mechanism = content.mechanism
        if mechanism is None or not _states_all_places(mechanism):
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


def _states_all_places(mechanism: FileMechanism) -> bool:
    """Return whether a file states all joints, and where they are."""
    if not mechanism.complete:
        return False
    return any(joint.T is not None or joint.tied for joint in mechanism.joints)


def _check_interpolation_errors(content: Content, shapes: Mapping[str, LinkShape], joints: Sequence[FileJoint]) -> None:
    """Compare the stated errors between keys with estimates from the keys."""
    if not content.clips:
        return
    halved_errors = errors_at_every_second_key(content.clips[0], shapes, joints)
    if halved_errors is None:
        return
    for (key, text, unit), halved_error, rounding_error in zip(
        _STATED_ERRORS, halved_errors, _ROUNDING_ERRORS, strict=True
    ):
        stated = content.extra["data"].get(key)
        if not isinstance(stated, int | float) or (key == "joint_gap" and not joints):
            continue
        # Linear interpolation errs with the square of the time between keys: half the time, a quarter of the error.
        estimate = halved_error / 4
        is_understated = stated < estimate / MAX_UNDERSTATEMENT and estimate > rounding_error
        is_overstated = stated > MAX_OVERSTATEMENT * max(estimate, rounding_error)
        if key == "between_position" and not shapes:
            is_overstated = False  # the estimate at the origins of links is too small
        check = f"{key}: stated error compared with an estimate from every second key"
        content.ledger.row(check, abs(estimate - stated), unit, fits=not is_understated)
        if is_understated or is_overstated:
            message = (
                f"{key} states an error of {quantity(stated, unit)} for {text}, but the estimate is "
                f"{quantity(estimate, unit)}: a quarter of the error with every second key left out, "
                f"{quantity(halved_error, unit)}."
            )
            content.ledger.wrong(f"claims.{key}", message, key, size=Measured(stated, estimate, unit))


def _check_headers(table: Content, track: Content) -> None:
    """Report differences of the headers of a CSV and a JSON track."""
    table_header = table.extra["data"]
    track_header = track.extra["data"]
    for key in dict.fromkeys((*track_header, *table_header)):
        if key not in table_header:
            text = f"the entry '{key}' is in {track.file}, but not in {table.file}."
        elif key not in track_header:
            text = f"the entry '{key}' is in {table.file}, but not in {track.file}."
        elif not _is_same_entry(table_header[key], track_header[key]):
            text = f"'{key}' is {_quote(table_header[key])}; in {track.file} it is {_quote(track_header[key])}."
        else:
            continue
        table.ledger.wrong("claims.head", text, key, suggestion="write both files from one source")


def _is_same_entry(a: object, b: object) -> bool:
    """Return whether two values of headers are equal: numbers but for rounding, lists by entry, others as text."""
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(map(_is_same_entry, a, b))
    if isinstance(a, int | float) and isinstance(b, int | float):
        return abs(a - b) <= 1e-9 * max(1.0, abs(a), abs(b))
    return str(a) == str(b)


def _quote(value: object) -> str:
    """Return a value as JSON, of which a message quotes only the beginning."""
    text = json.dumps(value, ensure_ascii=False)
    if len(text) < _MAX_QUOTE_LENGTH:
        return text
    return f"{text[: _MAX_QUOTE_LENGTH - 3]}…"


def _check_same_robot(tracks: Sequence[Content]) -> None:
    """Report names of frames, names and types of joints, and tools that are not the same in all tracks."""
    if not tracks:
        return
    first = tracks[0]
    for content in tracks[1:]:
        for key in ("robot", "tool_link", "tool_frame", "frame_names", "frame_links", "joints", "joint_types"):
            value = content.extra["data"].get(key)
            expected = first.extra["data"].get(key)
            if not _is_same_entry(value, expected):
                text = f"'{key}' is {_quote(value)}; in {first.file} it is {_quote(expected)}."
                content.ledger.wrong("claims.robot", text, key)


def _check_file_names(tracks: Sequence[Content]) -> None:
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
            listed.add(_name_in_line(str(line)))
        lacking = []
        for name in stage.extra["assumed"]:
            # Tracks have one line for all dimensions of the drawing, which affect only the appearance of parts.
            if name not in listed and not name.startswith("drawing."):
                lacking.append(name)
        if lacking:
            text = (
                f"the file's list of assumed numbers lacks '{lacking[0]}'{_and_more_text(lacking)}, which {stage.file} "
                "lists as assumed."
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


def _and_more_text(names: Sequence[str]) -> str:
    """Return " and n more" for the names behind the first, "" if there are none."""
    if len(names) < 2:
        return ""
    return f" and {len(names) - 1} more"


def _name_in_line(line: str) -> str:
    """Return the name in a text "name = value unit: reason"."""
    return line.split("=", 1)[0].strip()


def check_proof_clips(proof: JsonMapping, contents: Iterable[Content], ledger: Ledger) -> None:
    """Compare the list of motions in a proof.json with the tracks; `proof` is the content of the proof.json."""
    rows = proof.get("clips")
    if not isinstance(rows, list):
        return
    tracks = _tracks_by_protocol(contents)
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
        if abs(stated - real) > _SAME_NUMBER_TOL * abs(real):
            text = f"clip '{row['protocol']}': {key} is {stated:g}; in {track.file} it is {real:g}."
            ledger.wrong("proof.clip", text, key)
