"""Write tracks/<protocol>.json and .csv: link poses and joint values at keys, as plain numbers."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from twin.core.findings import Finding
from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.exchange.formats.tracks.write.joint_coordinates import tree_coordinates
from twin.exchange.write.clip import Clip
from twin.exchange.write.model_hash import model_hash
from twin.exchange.write.order import Order
from twin.exchange.write.player_interpolation import quaternions_xyzw
from twin.model.mechanism import Mechanism
from twin.schema import json_schema

NO_LIMIT = 1e30
"""Value that means no limit, because JSON has no infinity."""

_DIGITS = 7
"""Number of decimals of values in m and rad and of quaternion components (resolution 0.1 um)."""

_TIME_DIGITS = 9
"""Number of decimals of times in s."""

_LARGEST_INTEGER = 1e9
"""Absolute value below which whole numbers become integers; limits of 1e30 would get 31 digits."""


def write_tracks(
    mechanism: Mechanism, clip: Clip, folder: Path, cad_mechanism: Mechanism | None = None, assumed: Sequence[str] = ()
) -> tuple[Path, Path]:
    """Write <clip>.json and <clip>.csv, which contain the same numbers, into `folder`, and return their paths.

    `mechanism` has the trocar positions of the protocol; `cad_mechanism` is the mechanism as in the CAD (None:
    `mechanism`). The track states the model hash of `cad_mechanism`, and the coordinates of ball joints are zero at its
    home.
    `assumed` contains a text "name: reason" for each assumed number of the robot; assumed numbers of the protocol are
    in the clip.
    """
    folder.mkdir(parents=True, exist_ok=True)
    data = track(mechanism, clip, cad_mechanism, assumed)
    as_json = folder / f"{clip.name}.json"
    as_csv = folder / f"{clip.name}.csv"
    as_json.write_text(_json(data), encoding="utf-8")
    as_csv.write_text(_csv(data), encoding="utf-8")
    return as_json, as_csv


def write_schema(folder: Path) -> Path:
    """Write track.schema.json (JSON Schema 2020-12) into `folder` and return its path."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "track.schema.json"
    path.write_text(schema_text(), encoding="utf-8")
    return path


def schema_text() -> str:
    """Return the JSON Schema of a track."""
    from twin.schema.track import Track

    return json.dumps(json_schema(Track), indent=2, ensure_ascii=False) + "\n"


def track(
    mechanism: Mechanism, clip: Clip, cad_mechanism: Mechanism | None = None, assumed: Sequence[str] = ()
) -> JsonObject:
    """Return a track as plain data for JSON; `twin.schema.track.Track` describes each entry.

    For the arguments see `write_tracks`.
    """
    has_rcm, must_pass, places = _phase_rcms(clip)
    tool = mechanism.frame(mechanism.tool)
    rcm = clip.rcm
    if rcm is None:  # a protocol without one has the trocar of the robot
        rcm = next(iter(mechanism.trocar_places.values()), None)
    link_poses = [_seven(T_world_link) for T_world_link in clip.links.values()]
    phase_names: list[str] = []
    phase_starts: list[float] = []
    phase_ends: list[float] = []
    for name, start, end in clip.phases:
        phase_names.append(name)
        phase_starts.append(start)
        phase_ends.append(end)
    return {
        "schema": "twin-track",
        "version": 1,
        "robot": mechanism.name,
        "protocol": clip.name,
        "title": clip.title,
        # Of the mechanism as in the CAD: trocars differ between protocols, and all motions of a robot have one hash.
        "model_hash": model_hash(cad_mechanism or mechanism),
        "frame": "z-up right-handed",
        "length_unit": "m",
        "angle_unit": "rad",
        "quaternion_order": "xyzw",
        "rate": clip.rate,
        "frames": len(clip.times),
        "times": _plain(np.round(clip.times, _TIME_DIGITS)),
        "links": list(clip.links),
        "poses": _flat(np.stack(link_poses, axis=1)),
        **_coordinates(mechanism, clip, cad_mechanism or mechanism),
        "phases": phase_names,
        "phase_start": _plain(np.array(phase_starts, float).round(_TIME_DIGITS)),
        "phase_end": _plain(np.array(phase_ends, float).round(_TIME_DIGITS)),
        "phase_has_rcm": has_rcm,
        "phase_rcm_enforced": must_pass,
        "phase_rcm": _flat(places),
        "tool_link": tool.body,
        "tool_frame": _flat(_seven(tool.T_body_frame[None])),
        "moved_frame": clip.frame or mechanism.tool,
        "shaft_axis": _flat(clip.shaft_axis),
        "frame_names": [frame.name for frame in mechanism.frames],
        "frame_links": [frame.body for frame in mechanism.frames],
        "frames_local": _flat([_seven(frame.T_body_frame[None]) for frame in mechanism.frames]),
        "rcm": [] if rcm is None else _flat(rcm),
        **clip.between.numbers(),
        "assumed": [*assumed, *clip.assumed],
    }


def _coordinates(mechanism: Mechanism, clip: Clip, cad_mechanism: Mechanism) -> JsonObject:
    """Return the entries of a track on its joints: names, kinds, limits, and positions at the keys."""
    coordinates = tree_coordinates(cad_mechanism, clip.links)
    names: list[str] = []
    kinds: list[str] = []
    active: list[int] = []
    lower: list[float] = []
    upper: list[float] = []
    positions: list[Array] = []
    for joint in mechanism.joints:
        if joint.name not in clip.joints:
            continue
        names.append(joint.name)
        kinds.append(joint.type)
        active.append(int(joint.active))
        low, high = joint.limits or (-np.inf, np.inf)
        lower.append(max(low, -NO_LIMIT))
        upper.append(min(high, NO_LIMIT))
        positions.append(clip.joints[joint.name])
    for coordinate in coordinates:
        names.append(coordinate.name)
        kinds.append(coordinate.type)
        active.append(0)  # no motor drives a ball joint
        lower.append(-NO_LIMIT)
        upper.append(NO_LIMIT)
        positions.append(coordinate.values)
    return {
        "joints": names,
        "joint_types": kinds,
        "joint_active": active,
        "joint_lower": _flat(lower),
        "joint_upper": _flat(upper),
        "positions": _flat(np.array(positions, float).T),
    }


def _phase_rcms(clip: Clip) -> tuple[list[int], list[int], list[Array]]:
    """Return lists with a value for each phase: 1 with an RCM, 1 if it is enforced, the RCM (3,) in m."""
    phase_rcm = clip.phase_rcm or (None,) * len(clip.phases)
    enforced = clip.phase_rcm_enforced or (False,) * len(clip.phases)
    has_rcm: list[int] = []
    must_pass: list[int] = []
    places: list[Array] = []
    for point, is_enforced in zip(phase_rcm, enforced, strict=True):
        has_rcm.append(int(point is not None))
        must_pass.append(int(point is not None and is_enforced))
        places.append(np.zeros(3) if point is None else point)
    return has_rcm, must_pass, places


def _seven(Ts: Array) -> Array:
    """Return poses (k, 4, 4) as (k, 7): x y z in m and a quaternion x y z w."""
    return np.concatenate([Ts[:, :3, 3], quaternions_xyzw(Ts)], axis=1)


def _flat(values: ArrayLike) -> list[float]:
    return _plain(np.asarray(values, float).ravel().round(_DIGITS))


def _plain(values: Array) -> list[float]:
    """Return numbers for JSON. Whole numbers become integers, which are shorter: poses contain many zeros and ones."""
    numbers = (values + 0.0).tolist()  # adding 0.0 removes negative zeros
    for index, number in enumerate(numbers):
        if number == int(number) and abs(number) < _LARGEST_INTEGER:
            numbers[index] = int(number)
    return numbers


def _json(data: JsonObject) -> str:
    """Return JSON text with one line for each entry, so that a reader can find the short entries at the start."""
    lines = []
    for name, value in data.items():
        text = json.dumps(value, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
        lines.append(f"{json.dumps(name)}:{text}")
    return "{" + ",\n".join(lines) + "}\n"


_COLUMNS = ("times", "poses", "positions")
"""Entries of the track that become columns of the CSV; all other entries are written in the header of the CSV."""


def _csv(data: JsonObject) -> str:
    lines = []
    for name, value in data.items():
        if name in _COLUMNS:
            continue
        if not isinstance(value, str):
            value = json.dumps(value, separators=(",", ":"), ensure_ascii=False)
        lines.append(f"# {name}: {value}")
    columns = ["time_s"]
    for joint, kind in zip(data["joints"], data["joint_types"], strict=True):
        unit = "rad" if kind == "revolute" else "m"
        columns.append(f"{joint}_{unit}")
    for link in data["links"]:
        for component in ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"):
            columns.append(f"{link}_{component}")
    lines.append(",".join(columns))
    joint_count = len(data["joints"])
    pose_count = 7 * len(data["links"])
    for key, time in enumerate(data["times"]):
        positions = data["positions"][key * joint_count : (key + 1) * joint_count]
        poses = data["poses"][key * pose_count : (key + 1) * pose_count]
        lines.append(",".join(map(_text, [time, *positions, *poses])))
    return "\n".join(lines) + "\n"


def _text(value: float) -> str:
    """Return a number as text without a leading zero, which makes files smaller: most numbers are below one."""
    text = repr(value)
    if text.startswith("0."):
        return text[1:]
    if text.startswith("-0."):
        return f"-{text[2:]}"
    return text


def write(order: Order, folder: Path) -> list[Finding]:
    """Write a JSON and a CSV file for each motion of a robot, and their schema, into `folder`/tracks."""
    for scene in order.scenes:
        write_tracks(scene.mechanism, scene.clip, folder / "tracks", order.mechanism, order.assumed)
    write_schema(folder / "tracks")
    return []


def files(order: Order) -> list[tuple[str, str]]:
    """Return (file, content) for README.txt."""
    rows = [(f"tracks/{clip.name}.json, .csv", "joint values and link poses at keys") for clip in order.clips]
    rows.append(("tracks/track.schema.json", "description of the entries of a track"))
    return rows
