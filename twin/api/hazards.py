"""Run a campaign of faults on the machine of a robot, in several processes; an interrupted campaign can continue."""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin.api.machine import machine_parts
from twin.api.robot import Progress, Robot, load, silent
from twin.core.errors import TwinError

if TYPE_CHECKING:
    from twin.simulation.hazards.campaign import Campaign
    from twin.simulation.hazards.summary import Hazards
    from twin.simulation.machine.machine import Parts

FILE = "hazards.jsonl"
"""Name of the log in the folder of a campaign."""

_POLL = 0.05
"""Time in s between two checks of the processes."""


@dataclass(frozen=True)
class Share:
    """Sessions for one process: the robot's folder or name, the campaign file, and the sessions' indices."""

    robot: str
    campaign: str
    indices: tuple[int, ...]


def hazards(
    robot: Robot,
    campaign: str | Path,
    folder: Path,
    *,
    source: str | None = None,
    sessions: int | None = None,
    processes: int | None = None,
    progress: Progress = silent,
) -> Hazards:
    """Run the sessions of a campaign that are not yet in its log, and return the outcome of all.

    Args:
        robot: a robot with machine.toml.
        campaign: name of a file in the folder `campaigns` of the robot, or a path.
        folder: folder of the log; it is created.
        source: name or path by which other processes load the robot; None: its name.
        sessions: number of sessions to run now at most; None: all.
        processes: number of processes; None: one for each processor.
        progress: see `Progress`.

    Raises:
        TwinError: a file is missing or malformed, a target is unknown, or the log belongs to another campaign.
    """
    from twin.core.jobs import Stream
    from twin.simulation.hazards.campaign import FREE
    from twin.simulation.hazards.log import Log
    from twin.simulation.hazards.summary import Hazards

    parts = machine_parts(robot)
    path = campaign_file(robot, campaign)
    plan = _campaign(parts, path)
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    log = Log(folder / FILE, {"log": "twin-hazards", "version": 1, "robot": robot.name, "campaign": digest})
    left = [i for i in range(len(plan)) if i not in log.rows][: len(plan) if sessions is None else sessions]
    count = max(1, min(processes or os.cpu_count() or 1, len(left)))
    streams: list[Stream[dict[str, Any]]] = []
    try:
        for k in range(count if left else 0):
            stream: Stream[dict[str, Any]] = Stream(outcomes)
            streams.append(stream)
            stream.start(Share(source or robot.name, str(path.resolve()), tuple(left[k::count])))
        running, done = set(range(len(streams))), 0
        while running:
            for k in sorted(running):
                rows, state = streams[k].poll()
                for row in rows:
                    log.add(row)
                    done += 1
                    progress(f"session {row['index']}", done / len(left))
                if state:
                    raise TwinError(f"a process of the campaign failed: {state}")
                if state == "":
                    running.discard(k)
            time.sleep(_POLL)
    finally:
        for stream in streams:
            stream.close()
        log.close()
    outcomes_of = {c.name: c.outcome for c in plan.table.class_} | {FREE: "no fault"}
    assumed = [
        f"  ASSUMED {p.name} = {p.value:g} {p.unit}: {p.note}"
        for p in parts.settings.parameters()
        if p.provenance == "ASSUMED"
    ]
    rows = [log.rows[i] for i in sorted(log.rows)]
    return Hazards(robot.name, plan.table.title, len(plan), rows, outcomes_of, assumed)


def outcomes(share: Share) -> Iterator[dict[str, Any]]:
    """Yield the line of each session of a share; this runs in a separate process."""
    from twin.simulation.hazards.attacked import Arena

    parts = machine_parts(load(share.robot))
    plan, arena = _campaign(parts, Path(share.campaign)), Arena(parts)
    for index in share.indices:
        drawn = plan.draw(index)
        found = arena.run(plan.faults(drawn), drawn.start, drawn.length, drawn.mass, drawn.friction)
        yield asdict(drawn) | asdict(found)


def campaign_file(robot: Robot, campaign: str | Path) -> Path:
    """Return the path of a campaign; a name without suffix is a file in the robot's folder `campaigns`."""
    if Path(campaign).suffix or robot.files is None:
        return Path(campaign)
    return robot.files.cad / "campaigns" / f"{campaign}.toml"


def _campaign(parts: Parts, path: Path) -> Campaign:
    from twin.simulation.hazards import campaign
    from twin.simulation.machine.itp import FIELDS

    motors = tuple(parts.arm.mechanism.motor_names)
    return campaign.load(path, {"packet": FIELDS, "encoder": motors, "dac": motors})
