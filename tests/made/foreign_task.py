"""A kind of task and a device in packages outside of twin, which entry points name."""

from __future__ import annotations

from pathlib import Path

TASK = """
from pydantic import Field

from twin.model.task import TaskKind
from twin.schema import Table


class WaitTable(Table):
    rest_s: float = Field(gt=0, le=10)


KIND = TaskKind(
    name="wait",
    title="hands to keep still",
    order=200,
    field=(WaitTable | None, None),
    rows=lambda table: [("rest", table.rest_s, "s")],
    judged=True,
    package=__package__,
)
"""

PLAY = """
from twin.core.findings import disagreement
from twin.model.task import required_goal
from twin.simulation.devices.surgeon_hands import Habits, SurgeonHands
from twin.simulation.session.task_play import Play, TaskOutcome
from twin.simulation.world import Block
from wait_task.task import WaitTable


class Patient(SurgeonHands):
    def __init__(self, seat, rest):
        self.rest = rest
        super().__init__(seat, Habits())

    def _output_signals(self, k):
        return super()._output_signals(k) | {"surgeon.target": 0.0}

    def _work(self):
        yield from self._rest(self.rest)


class Clock(Block):
    outputs = {}
    ending = "The hands were still."

    def __init__(self, rest, period):
        self.rest, self.period, self.t = rest, period, 0.0

    @property
    def complete(self):
        return self.t >= self.rest

    def step(self, signals, t, dt):
        self.t = t
        return {}

    def content(self):
        return {"rows": [["Time", f"{self.t:.1f} s"]], "rings": [], "events": []}


class Waited(TaskOutcome):
    success = "The hands were still"
    failure = "The hands were not still"

    def __init__(self, beats, duration, rest):
        self.beats, self.duration, self.rest = beats, duration, rest

    def findings(self):
        if self.duration < self.rest:
            yield disagreement("task.missed", "wait", "the session is shorter than the rest")

    def content(self):
        return {"waited_s": self.duration, "beats": self.beats}

    def text(self):
        yield f"  waited {self.duration:.1f} s"


class Waiting(Play):
    def surgeon(self, setup, task, seat, mistake):
        return Patient(seat, required_goal(task, WaitTable).rest_s)

    def referee(self, setup, task, period):
        return Clock(required_goal(task, WaitTable).rest_s, period)

    def outcome(self, setup, task, kept, arms):
        beats = kept["pulse.phase"] if "pulse.phase" in kept.sizes else []
        return Waited(len({float(x[0]) for x in beats}), kept.t[-1], required_goal(task, WaitTable).rest_s - 0.01)

    def identity(self, setup, task):
        return [required_goal(task, WaitTable).model_dump()]


PLAY = Waiting()
"""

DEVICE = """
import numpy as np

from twin.simulation.world import Block


class Pulse(Block):
    def __init__(self, name, every):
        self.signal, self.every = f"{name}.phase", every
        self.outputs = {self.signal: np.zeros(1)}

    def step(self, signals, t, dt):
        return {self.signal: float(int(t / self.every))}


def from_scene(name, settings, setup):
    return Pulse(name, settings["every_s"])
"""


def installed(folder: Path) -> Path:
    """Write both packages with their metadata into a folder, as `pip install` does; return it, for `sys.path`."""
    package = folder / "wait_task"
    package.mkdir(parents=True)
    for name, text in {"__init__.py": "", "task.py": TASK, "play.py": PLAY}.items():
        (package / name).write_text(text, encoding="utf-8")
    (folder / "pulse_device.py").write_text(DEVICE, encoding="utf-8")
    entries = {
        "wait_task": "[twin.tasks]\nwait = wait_task.task:KIND\n",
        "pulse_device": "[twin.devices]\npulse = pulse_device:from_scene\n",
    }
    for name, text in entries.items():
        metadata = folder / f"{name}-1.0.dist-info"
        metadata.mkdir()
        (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n", encoding="utf-8")
        (metadata / "entry_points.txt").write_text(text, encoding="utf-8")
    return folder
