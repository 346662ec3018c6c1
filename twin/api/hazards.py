"""Run a campaign of fault injections on the simulated machine of a robot, in several processes; runs can be resumed."""

from __future__ import annotations

import contextlib
import hashlib
import math
import time
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

from twin.api.machine import machine_parts
from twin.api.name_or_path import name_or_path
from twin.api.robot import Robot
from twin.api.robot_loading import load
from twin.core.errors import OutputError, TwinError
from twin.core.jobs import usable_processors
from twin.core.json_types import JsonObject
from twin.core.progress import Progress, silent
from twin.core.provenance import Parameter

if TYPE_CHECKING:
    from twin.simulation.campaigns.attacked_session import SessionRunner
    from twin.simulation.campaigns.campaign import Campaign
    from twin.simulation.campaigns.campaign_log import Log
    from twin.simulation.campaigns.summary import Hazards
    from twin.simulation.campaigns.trends_result import Trends
    from twin.simulation.machine.machine_parts import Parts
    from twin.simulation.machine.settings import Mode, Policy

FILE = "hazards.jsonl"
"""Name of the log in the folder of a campaign."""

TRENDS = "trends"
"""Name, without suffix, of the file in the robot's folder `campaigns` with the settings of `trends`."""

_POLL_INTERVAL = 0.05
"""Time in s between two checks of the processes."""


@dataclass(frozen=True)
class Software:
    """Settings of the machine's software for a campaign, see `machine_parts`; None: as in machine.toml."""

    mode: Mode | None = None
    overdrive: Policy | None = None
    released: tuple[str, ...] | None = None

    def parts(self, robot: Robot) -> Parts:
        """Return the compiled parts of a robot's machines with these settings."""
        return machine_parts(robot, mode=self.mode, overdrive=self.overdrive, released=self.released)


@dataclass(frozen=True)
class Share:
    """The sessions that one process runs: robot (name or folder), campaign file, session indices, software settings."""

    robot: str
    campaign: str
    indices: tuple[int, ...]
    software: Software = Software()


_AS_FILED = Software()
"""Settings of machine.toml, the default of all functions here."""


def hazards(
    robot: Robot,
    campaign: str | Path,
    folder: Path,
    *,
    source: str | None = None,
    sessions: int | None = None,
    processes: int | None = None,
    software: Software = _AS_FILED,
    progress: Progress = silent,
) -> Hazards:
    """Run the sessions of a campaign that are not yet in its log, and return the outcomes of all logged sessions.

    Args:
        robot: a robot with machine.toml.
        campaign: name of a file in the folder `campaigns` of the robot, or a path.
        folder: folder of the log; it is created.
        source: name or path by which other processes load the robot; None: that of the robot's files.
        sessions: maximum number of sessions that this call runs; None: all that are not in the log.
        processes: number of processes; None: one for each processor.
        software: settings of the machine's software.
        progress: see `Progress`.

    Raises:
        TwinError: a file is missing or malformed, a fault has an unknown target, the log belongs to another campaign,
            or the robot is not as its files describe it: the processes of the campaign load the files.
    """
    from twin.simulation.campaigns.campaign import load as load_campaign
    from twin.simulation.campaigns.summary import Hazards

    filed_source = name_or_path(robot)
    parts = software.parts(robot)
    path = campaign_file(robot, campaign)
    plan = load_campaign(path, parts.places)
    log = _log(folder, robot, path, plan, parts)
    share = Share(source or filed_source, str(path.resolve()), (), software)
    try:
        _run_sessions(share, _remaining(plan, log, sessions), processes or usable_processors(), log, progress)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(_resume_advice(log)) from None
    finally:
        log.close()
    # processes finish in any order: the result must not depend on it
    rows = [log.rows[index] for index in sorted(log.rows)]
    assumed = _assumed([*parts.settings.parameters(), *plan.parameters()])
    return Hazards(robot.name, plan.table, len(plan), rows, assumed)


def _run_sessions(share: Share, remaining: list[int], processes: int, log: Log, progress: Progress) -> None:
    """Run the sessions with the indices `remaining` in at most `processes` processes, and log their outcomes.

    `share` says what all processes run; its indices are replaced.

    Raises:
        TwinError: a process failed.
    """
    from twin.core.jobs import Stream

    to_run = len(remaining)
    count = 0
    if remaining:
        count = max(1, min(processes, to_run))
    streams: list[Stream[JsonObject]] = []
    for _ in range(count):
        streams.append(Stream(outcomes))

    def send_next(stream: Stream[JsonObject]) -> None:
        """Send the next sessions to a process: fewer in each call, so that all processes end at about the same time."""
        # half of this process's share of what remains: slow sessions do not leave one process alone at the end
        size = math.ceil(len(remaining) / (2 * count))
        indices = tuple(remaining[:size])
        del remaining[:size]
        stream.start(replace(share, indices=indices))

    try:
        for stream in streams:
            send_next(stream)
        running = list(streams)
        finished = 0
        while running:
            for stream in list(running):
                rows, state = stream.poll()
                for row in rows:
                    log.add(row)
                    finished += 1
                    progress(f"session {row['index']}", finished / to_run)
                if state is None:  # this process still runs
                    continue
                if state:
                    raise TwinError(f"a process of the campaign failed: {state}; {_resume_advice(log)}")
                if remaining:
                    send_next(stream)
                else:
                    running.remove(stream)
            time.sleep(_POLL_INTERVAL)
    finally:
        for stream in streams:
            stream.close()


def _remaining(plan: Campaign, log: Log, sessions: int | None) -> list[int]:
    """Return the indices of the sessions that are not in the log; of these, only the first `sessions`."""
    indices = [index for index in range(len(plan)) if index not in log.rows]
    if sessions is None:
        return indices
    return indices[:sessions]


def _assumed(parameters: Sequence[Parameter]) -> list[str]:
    """Return a line of text for each assumed number."""
    lines: list[str] = []
    for parameter in parameters:
        if parameter.provenance != "ASSUMED":
            continue
        value = f"{parameter.shown:g}"
        if parameter.unit != "1":
            value += f" {parameter.unit}"
        lines.append(f"  ASSUMED {parameter.name} = {value}: {parameter.note}")
    return lines


def _resume_advice(log: Log) -> str:
    """Return the advice after an interruption: how many sessions are logged, and how to resume."""
    return f"{len(log.rows)} sessions are in {log.path}; run the same command again to go on"


def _log(folder: Path, robot: Robot, file: Path, plan: Campaign, parts: Parts) -> Log:
    """Open or create a campaign's log in a folder; raise `TwinError` if the log has sessions of another campaign."""
    from twin.simulation.campaigns.campaign_log import Log

    settings = parts.settings
    head = {
        "log": "twin-hazards",
        "version": 2,
        "robot": robot.name,
        "campaign": hashlib.sha256(file.read_bytes()).hexdigest(),
        "mode": settings.mode,
        "overdrive": settings.overdrive,
        "released": settings.released.model_dump(),
    }
    log = Log(folder / FILE, head)
    try:
        _require_same_campaign(plan, log)
    except TwinError:
        log.close()
        raise
    return log


def _require_same_campaign(plan: Campaign, log: Log) -> None:
    """Raise an error if a line of the log is not the outcome of a session of the campaign.

    Raises:
        OutputError: a session in the log has an index or a fault that the campaign does not have, or lacks a value.
    """
    from twin.simulation.campaigns.attacked_session import Outcome

    required = {"response"}
    for field in fields(Outcome):
        required.add(field.name)
    for index, row in log.rows.items():
        if 0 <= index < len(plan):
            expected_values = asdict(plan.draw(index))
        else:
            last = len(plan) - 1
            expected_values = {"index": f"0 to {last}"}
        wrong_keys = []
        for key, value in expected_values.items():
            if row.get(key) != value:
                wrong_keys.append(key)
        wrong_keys += sorted(required - row.keys())
        if not wrong_keys:
            continue
        key = wrong_keys[0]
        fault = f"{key} is missing"
        if key in row:
            fault = f"{key} is {row[key]!r}"
        if key in expected_values:
            fault += f"; expected {expected_values[key]!r}"
        raise OutputError(
            f"{log.path}: session {index}: {fault}. Delete the line of this session to run the session "
            "again, or give another --out"
        )


def outcomes(share: Share) -> Iterator[JsonObject]:
    """Run the sessions of `share` in a child process; yield the log line of each session as {key: value}."""
    from twin.simulation.campaigns.attacked_session import AttackedSession

    plan, runner = _session_runner(share.robot, share.campaign, share.software)
    for index in share.indices:
        attack = plan.draw(index)
        session = AttackedSession(
            partial(plan.faults, attack), attack.start, attack.length, attack.mass, attack.friction, attack.scale
        )
        outcome = runner.run(session)
        response = None
        if outcome.noticeable and index < plan.table.trained:
            response = runner.respond(session, plan.reaction(index))
        response_data = None
        if response is not None:
            response_data = asdict(response)
        yield {**asdict(attack), **asdict(outcome), "response": response_data}


@lru_cache(maxsize=1)
def _session_runner(robot: str, campaign: str, software: Software) -> tuple[Campaign, SessionRunner]:
    """Return the campaign, and the runner of its sessions; each process creates both only once."""
    from twin.simulation.campaigns.attacked_session import SessionRunner
    from twin.simulation.campaigns.campaign import load as load_campaign

    parts = software.parts(load(robot))
    plan = load_campaign(Path(campaign), parts.places)
    return plan, SessionRunner(parts, plan.adaptive_limit)


def trends(robot: Robot, *, software: Software = _AS_FILED, progress: Progress = silent) -> Trends:
    """Measure, in two experiments, how far the model in the control software deviates from the machine.

    The first experiment varies the motion scale; in the second, a motor command is stuck every 8 s. The experiments
    repeat sections 3.1 and 3.2.1 of the paper that `twin.simulation.campaigns.trends` names.

    Args:
        robot: a robot with machine.toml.
        software: settings of the machine's software.
        progress: see `Progress`.

    Raises:
        TwinError: see `machine_parts`; or the robot's file `campaigns/trends.toml` is missing or malformed.
    """
    from twin.simulation.campaigns.trends import trends
    from twin.simulation.campaigns.trends_table import load as load_trends

    table = load_trends(campaign_file(robot, TRENDS))
    return trends(robot.name, software.parts(robot), table, progress)


def campaign_file(robot: Robot, campaign: str | Path) -> Path:
    """Return the path of a campaign file; a name without suffix means a file in the robot's folder `campaigns`.

    If `same_as` is the only key of this file, return the path of the file that `same_as` names.
    """
    if Path(campaign).suffix or robot.files is None:
        return Path(campaign)
    path = robot.files.cad / "campaigns" / f"{campaign}.toml"
    table: JsonObject = {}
    with contextlib.suppress(OSError, ValueError, RecursionError):  # the reader of the campaign reports the error
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    # two robots of one type share their campaigns, so that a correction reaches both
    target = table.get("same_as")
    if len(table) == 1 and isinstance(target, str):
        return (path.parent / target).resolve()
    return path
