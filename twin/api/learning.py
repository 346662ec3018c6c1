"""Compare groups of sessions at a console: measures of every session, rank tests, learning curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from twin.api.console_session import ConsoleSession
from twin.api.robot import Progress, silent
from twin.api.session import replay_session
from twin.core.errors import DescriptionError
from twin.core.foreign.text import load_json
from twin.core.json_types import JsonMapping, JsonObject
from twin.validation.ranks import Ranks, Users, compare_users


def study_sessions(groups: Mapping[str, Sequence[str | Path]], progress: Progress = silent) -> Ranks:
    """Compare groups of sessions of one task, such as first and last sessions, or sessions with and without haptics.

    `groups` is {group: paths in the order of the sessions}. A path is a session file (which is replayed), a
    session.json written by `twin session --out` or `twin operate`, or a folder that contains session.json.

    Raises:
        DescriptionError: there are fewer than two groups, a file is not a session, the replay of a session differs from
            the recording, or the tasks of the sessions differ.
        WorldError: a session is damaged.
    """
    if len(groups) < 2:
        raise DescriptionError(
            f"one group of sessions is given ({', '.join(groups)}); give a second one to compare, as in "
            "first=a.session last=b.session"
        )
    rows: list[tuple[str, float, dict[str, float]]] = []
    tasks: dict[str, Path] = {}
    files = [(group, k, Path(f)) for group, of in groups.items() for k, f in enumerate(of, 1)]
    for i, (group, number, path) in enumerate(files):
        progress(path.name, i / len(files))
        found = _content(path)
        try:
            task, row = f"{found['scene']}, task {found['task'] or 'none'}", measures(found)
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise DescriptionError(f"{path}: the session is damaged ({type(error).__name__}: {error})") from error
        tasks.setdefault(task, path)
        if len(tasks) > 1:
            (a, first), (b, other) = tasks.items()
            raise DescriptionError(f"{first} is a session of {a}, {other} is a session of {b}: the tasks must be equal")
        rows.append((group, float(number), row))
    names = [n for n in rows[0][2] if all(n in row for _, _, row in rows)]
    table = {n: [row[n] for _, _, row in rows] for n in names}
    users = Users(next(iter(tasks)), [g for g, _, _ in rows], [k for _, k, _ in rows], False, table)
    return compare_users(users)


def measures(content: JsonMapping) -> dict[str, float]:
    """Return {name with unit: value} of the measures to compare between sessions, from one session's plain data."""
    out = {"time_s": content["time_s"]}
    out |= {f"{name}_path_mm": hand["path_mm"] for hand in content["hands"] for name in [hand["robot"]]}
    out |= {n: content[n] for n in ("clutches", "camera_moves")}
    if board := content.get("board"):
        out["time_s"] = board["time_s"]
        out |= {n: board[n] for n in ("rings_transferred", "rings_dropped", "instrument_collisions", "errors")}
    if guided := content.get("guided"):
        names = ("time_s", "wire_touches", "wire_touching_s", "ring_dropped", "instrument_collisions")
        out |= {n: guided[n] for n in names}
        out["steps_done"] = sum(t is not None for t in guided["steps_s"].values())
        out["wire_passed_percent"] = 100 * guided["wire_passed"]
    if align := content.get("alignment"):
        out["time_s"] = align["time_s"]
        out["lens_path_mm"] = align["lens_path_mm"]
        angle = align["align_err_deg"]
        out |= {"align_err_deg": angle, "align_err_size_deg": None if angle is None else abs(angle)}
    if targets := content.get("targets"):
        out["targets_touched"] = sum(t["t_s"] is not None for t in targets)
    return {n: float("nan") if v is None else float(v) for n, v in out.items()}


def _content(path: Path) -> JsonObject:
    """Return a session's plain data: from session.json (or its folder), or by replaying a session file."""
    if path.is_dir():
        path /= "session.json"
    if path.suffix != ".json":
        found = replay_session(path)
        if found.ran.difference is not None:
            raise DescriptionError(f"{path}: its replay differs from the recording; for details: twin session {path}")
        return found.as_dict()
    try:
        found = load_json(path)
    except (OSError, ValueError, RecursionError) as error:
        raise DescriptionError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from error
    if not isinstance(found, dict) or found.get("schema") != f"twin/{ConsoleSession.kind}/1":
        raise DescriptionError(
            f"{path}: this is not the session.json of a session; `twin session FILE --out FOLDER` writes one"
        )
    return found
