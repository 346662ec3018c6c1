"""Compare groups of sessions at a console: measures of every session, rank tests, learning curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from twin.api.console_runs import replay_session
from twin.api.console_session import INTERRUPTED, ConsoleSession
from twin.core.errors import DescriptionError
from twin.core.findings import warning
from twin.core.foreign.text import load_json
from twin.core.json_types import JsonMapping, JsonObject
from twin.core.progress import Progress, silent
from twin.validation.rank_tests import Ranks, Users, compare_users


def study_sessions(groups: Mapping[str, Sequence[str | Path]], progress: Progress = silent) -> Ranks:
    """Compare groups of sessions of one task, such as first and last sessions, or sessions with and without haptics.

    `groups` is {group: paths in the order of the sessions}. A path is a session file (which is replayed), a
    session.json written by `twin session --out` or `twin operate`, or a folder that contains session.json.

    Raises:
        DescriptionError: there are fewer than two groups, a file is not a session, the replay of a session differed
            from the recording, or the tasks of the sessions differ.
        WorldError: a session is damaged.
    """
    if len(groups) < 2:
        raise DescriptionError(
            f"one group of sessions is given ({', '.join(groups)}); give a second one to compare, as in "
            "first=a.session last=b.session"
        )
    files: list[tuple[str, int, Path]] = []
    for group, paths in groups.items():
        for number, path in enumerate(paths, 1):
            files.append((group, number, Path(path)))
    rows: list[dict[str, float]] = []
    tasks: dict[str, Path] = {}
    interrupted: list[str] = []
    for i, (_, _, path) in enumerate(files):
        progress(path.name, i / len(files))
        content = _content(path)
        try:
            scene = content["scene"]
            name = content["task"] or "none"
            task = f"{scene}, task {name}"
            row = measures(content)
            for finding in content.get("findings", ()):
                if finding["code"] == INTERRUPTED:
                    interrupted.append(str(path))
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise DescriptionError(f"{path}: the session is damaged ({type(error).__name__}: {error})") from error
        tasks.setdefault(task, path)
        if len(tasks) > 1:
            (task_of_first, first_path), (task_of_other, other_path) = tasks.items()
            raise DescriptionError(
                f"{first_path} is a session of {task_of_first}, {other_path} is a session of {task_of_other}: "
                "the tasks must be equal"
            )
        rows.append(row)
    table: dict[str, list[float]] = {}
    for name in rows[0]:
        values = [row[name] for row in rows if name in row]
        if len(values) == len(rows):  # only measures that every session has can be compared
            table[name] = values
    groups_of_files = []
    numbers = []
    for group, number, _ in files:
        groups_of_files.append(group)
        numbers.append(float(number))
    (task,) = tasks
    findings = []
    if interrupted:
        text = "the recording was interrupted, so that times and counts end early; leave such sessions out"
        findings.append(warning("study.interrupted", ", ".join(interrupted), text))
    users = Users(task, groups_of_files, numbers, False, table, findings)
    return compare_users(users)


def measures(content: JsonMapping) -> dict[str, float]:
    """Return {name with unit: value} of the measures to compare between sessions, from one session's plain data."""
    values: dict[str, float | None] = {"time_s": content["time_s"]}
    for hand in content["hands"]:
        robot = hand["robot"]
        values[f"{robot}_path_mm"] = hand["path_mm"]
    for name in ("clutches", "camera_moves"):
        values[name] = content[name]
    board = content.get("board")
    if board:
        # the clock of a task begins with its first motion, that of the console with the first arm that follows
        values["time_s"] = board["time_s"]
        for name in ("rings_transferred", "rings_dropped", "instrument_collisions", "errors"):
            values[name] = board[name]
    guided = content.get("guided")
    if guided:
        for name in ("time_s", "wire_touches", "wire_touching_s", "ring_dropped", "instrument_collisions"):
            values[name] = guided[name]
        step_times = list(guided["steps_s"].values())
        values["steps_done"] = len(step_times) - step_times.count(None)
        values["wire_passed_percent"] = 100 * guided["wire_passed"]
    alignment = content.get("alignment")
    if alignment:
        values["time_s"] = alignment["time_s"]
        values["lens_path_mm"] = alignment["lens_path_mm"]
        angle = alignment["align_err_deg"]
        size = None
        if angle is not None:
            size = abs(angle)
        values["align_err_deg"] = angle
        # errors to both sides would cancel in a mean of signed angles
        values["align_err_size_deg"] = size
    targets = content.get("targets")
    if targets:
        times = [target["t_s"] for target in targets]
        values["targets_touched"] = len(times) - times.count(None)
    if not values["time_s"]:
        values["time_s"] = None  # nothing has begun: a time of 0 s would be the best of all
    numbers: dict[str, float] = {}
    for name, value in values.items():
        numbers[name] = float("nan") if value is None else float(value)
    return numbers


def _content(path: Path) -> JsonObject:
    """Return a session's plain data: from session.json (or its folder), or by replaying a session file."""
    if path.is_dir():
        path /= "session.json"
    if path.suffix != ".json":
        content = replay_session(path).as_dict()
        if content["replay"] == "differs":
            raise DescriptionError(f"{path}: its replay differs from the recording; for details: twin session {path}")
        return content
    try:
        content = load_json(path)
    except (OSError, ValueError, RecursionError) as error:
        reason = getattr(error, "strerror", None) or error
        raise DescriptionError(f"{path}: cannot be read: {reason}") from error
    if not isinstance(content, dict) or content.get("schema") != f"twin/{ConsoleSession.kind}/1":
        raise DescriptionError(
            f"{path}: this is not the session.json of a session; `twin session FILE --out FOLDER` writes one"
        )
    if content.get("replay") == "differs":
        raise DescriptionError(f"{path}: the replay of this session differed from its recording; leave the session out")
    return content
