"""Write tracks/<protocol>.json and .csv: link poses and joint values at keys, as plain numbers."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from twin.core.findings import Finding
from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.exchange.formats.tracks.write.turns import tree_coordinates
from twin.exchange.write.clip import Clip, model_hash, quaternions_xyzw
from twin.exchange.write.order import Order
from twin.model.mechanism import Mechanism
from twin.schema import json_schema

NO_LIMIT = 1e30
"""Value that means no limit, because JSON has no infinity."""

_DIGITS = 7
"""Number of decimals of values in m and rad and of quaternion components (resolution 0.1 um)."""


def write_tracks(
    mechanism: Mechanism, clip: Clip, folder: Path, drawn: Mechanism | None = None, assumed: Sequence[str] = ()
) -> tuple[Path, Path]:
    """Write <clip>.json and <clip>.csv, which contain the same numbers, into `folder`, and return their paths.

    `mechanism` has the trocar positions of the protocol; `drawn` is the mechanism as in the CAD (None: `mechanism`).
    The track states the model hash of `drawn`, and the coordinates of ball joints are zero at the home of `drawn`.
    `assumed` contains a text "name: reason" for each assumed number of the robot; assumed numbers of the protocol are
    in the clip.
    """
    folder.mkdir(parents=True, exist_ok=True)
    data = track(mechanism, clip, drawn, assumed)
    as_json, as_csv = folder / f"{clip.name}.json", folder / f"{clip.name}.csv"
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


def track(mechanism: Mechanism, clip: Clip, drawn: Mechanism | None = None, assumed: Sequence[str] = ()) -> JsonObject:
    """Return a track as plain data for JSON; `twin.schema.track.Track` describes each entry.

    For the arguments see `write_tracks`.
    """
    joints = [j for j in mechanism.joints if j.name in clip.joints]
    turns = tree_coordinates(drawn or mechanism, clip.links)
    limits = [*(j.limits or (-NO_LIMIT, NO_LIMIT) for j in joints), *[(-NO_LIMIT, NO_LIMIT)] * len(turns)]
    tool = mechanism.frame(mechanism.tool)
    trocar = next(iter(mechanism.trocar_places.values()), None)
    rcm = clip.rcm if clip.rcm is not None else trocar
    phase_rcm = clip.phase_rcm or (None,) * len(clip.phases)
    enforced = clip.phase_rcm_enforced or (False,) * len(clip.phases)
    return {
        "schema": "twin-track",
        "version": 1,
        "robot": mechanism.name,
        "protocol": clip.name,
        "title": clip.title,
        "model_hash": model_hash(drawn or mechanism),
        "frame": "z-up right-handed",
        "length_unit": "m",
        "angle_unit": "rad",
        "quaternion_order": "xyzw",
        "rate": clip.rate,
        "frames": len(clip.times),
        "times": _plain(np.round(clip.times, 9)),
        "links": list(clip.links),
        "poses": _flat(np.stack([_seven(Ts) for Ts in clip.links.values()], axis=1)),
        "joints": [*(j.name for j in joints), *(t.name for t in turns)],
        "joint_types": [*(j.type for j in joints), *(t.type for t in turns)],
        "joint_active": [*(int(j.active) for j in joints), *[0] * len(turns)],
        "joint_lower": _flat([low for low, _ in limits]),
        "joint_upper": _flat([high for _, high in limits]),
        "positions": _flat([*(clip.joints[j.name] for j in joints), *(t.values for t in turns)], transpose=True),
        "phases": [name for name, _, _ in clip.phases],
        "phase_start": _plain(np.round([t0 for _, t0, _ in clip.phases], 9)),
        "phase_end": _plain(np.round([t1 for _, _, t1 in clip.phases], 9)),
        "phase_has_rcm": [int(p is not None) for p in phase_rcm],
        "phase_rcm_enforced": [int(p is not None and must) for p, must in zip(phase_rcm, enforced, strict=True)],
        "phase_rcm": _flat([np.zeros(3) if p is None else p for p in phase_rcm]),
        "tool_link": tool.body,
        "tool_frame": _flat(_seven(tool.T_body_frame[None])),
        "moved_frame": clip.frame or mechanism.tool,
        "shaft_axis": _flat(clip.shaft_axis),
        "frame_names": [f.name for f in mechanism.frames],
        "frame_links": [f.body for f in mechanism.frames],
        "frames_local": _flat([_seven(f.T_body_frame[None])[0] for f in mechanism.frames]),
        "rcm": [] if rcm is None else _flat(rcm),
        **clip.between.numbers(),
        "assumed": [*assumed, *clip.assumed],
    }


def _seven(Ts: Array) -> Array:
    """Return poses (k, 4, 4) as (k, 7): x y z in m and a quaternion x y z w."""
    return np.concatenate([Ts[:, :3, 3], quaternions_xyzw(Ts)], axis=1)


def _flat(values: Any, transpose: bool = False) -> list[float]:
    array = np.asarray(values, float)
    return _plain(np.round((array.T if transpose else array).ravel(), _DIGITS))


def _plain(values: Any) -> list[float]:
    """Return numbers for JSON. Whole numbers become integers, which are shorter: poses contain many zeros and ones."""
    return [int(v) if v == int(v) and abs(v) < 1e9 else v for v in (values + 0.0).tolist()]


def _json(data: JsonObject) -> str:
    """Return JSON text with one line for each entry, so that a reader can find the short entries at the start."""
    lines = (
        f"{json.dumps(k)}:{json.dumps(v, separators=(',', ':'), ensure_ascii=False, allow_nan=False)}"
        for k, v in data.items()
    )
    return "{" + ",\n".join(lines) + "}\n"


_COLUMNS = ("times", "poses", "positions")
"""Entries of the track that become columns of the CSV; all other entries are written in the header of the CSV."""


def _csv(data: JsonObject) -> str:
    head = [
        f"# {k}: {v if isinstance(v, str) else json.dumps(v, separators=(',', ':'), ensure_ascii=False)}"
        for k, v in data.items()
        if k not in _COLUMNS
    ]
    kinds = zip(data["joints"], data["joint_types"], strict=True)
    names = ["time_s", *(f"{n}_{'rad' if kind == 'revolute' else 'm'}" for n, kind in kinds)]
    names += [f"{link}_{part}" for link in data["links"] for part in ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")]
    n, m = len(data["joints"]), 7 * len(data["links"])
    rows = (
        ",".join(map(_text, [t, *data["positions"][i * n : (i + 1) * n], *data["poses"][i * m : (i + 1) * m]]))
        for i, t in enumerate(data["times"])
    )
    return "\n".join([*head, ",".join(names), *rows]) + "\n"


def _text(value: float) -> str:
    """Return a number as text without a leading zero, which makes files smaller: most numbers are below one."""
    text = repr(value)
    return text[1:] if text.startswith("0.") else f"-{text[2:]}" if text.startswith("-0.") else text


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
