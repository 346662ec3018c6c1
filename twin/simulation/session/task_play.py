"""What the kinds of tasks have in common: simulated surgeon, referee of the page, and outcome in the report."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Protocol, runtime_checkable

from twin.core.errors import TwinError
from twin.core.findings import Finding
from twin.core.json_types import JsonObject
from twin.core.result import Part
from twin.core.spatial import Array
from twin.model.mechanism import Mechanism
from twin.model.scene import Place
from twin.model.task import ConsoleTask
from twin.simulation.devices.surgeon_hands import Seat, SimulatedHands
from twin.simulation.setup import Setup
from twin.simulation.world import Recording


@dataclass(frozen=True)
class ArmPath:
    """A robot of a session: its place, its mechanism, and its motion at the samples of the session.

    Attributes:
        place, mechanism: place of the robot in the scene, and mechanism of the robot.
        q: (k, n) active joints in m or rad.
        links: {link: T_base_link (k, 4, 4)}, from the mechanism with closed loops, not from the robot's equations.
        tip: (k, 3) position of the tip (the frame whose path is measured) in m in the World.
    """

    place: Place
    mechanism: Mechanism
    q: Array
    links: Mapping[str, Array]
    tip: Array


class TaskOutcome(ABC):
    """The measures of a task in a finished session, and their parts of a report.

    Attributes:
        success, failure: what was done, or missed, in words.
    """

    success: str
    failure: str

    @abstractmethod
    def findings(self) -> Iterator[Finding]:
        """Yield findings with the code `task.missed` if the task is not done, `task.errors` if it has many errors."""

    @abstractmethod
    def content(self) -> JsonObject:
        """Return the measures as plain data; the keys of quantities end with the unit."""

    @abstractmethod
    def text(self) -> Iterator[Part]:
        """Yield the measures as text."""


class LiveReferee(Protocol):
    """A `Block` that judges a task while a person performs it; it writes no signal.

    Attributes:
        complete: whether the task is done.
        ending: sentence for the end of an attempt in which the task was completed.
    """

    @property
    def complete(self) -> bool: ...  # noqa: D102
    @property
    def ending(self) -> str: ...  # noqa: D102

    def content(self) -> JsonObject:
        """Return the scoreboard as plain data: rows, rings and events."""
        ...


@runtime_checkable
class MeasuringReferee(Protocol):
    """A `LiveReferee` that measures an attempt for the table of a study."""

    @property
    def complete(self) -> bool: ...  # noqa: D102

    def trial_measures(self) -> dict[str, float | None]:
        """Return {name with unit: value} of the attempt so far; None: no value, because the task is not done."""
        ...


class Play:
    """How a kind of task is performed and judged: `PLAY` in the module `play` of its folder."""

    def surgeon(self, setup: Setup, task: ConsoleTask, seat: Seat, mistake: str) -> SimulatedHands:
        """Return the simulated surgeon, who sits at the console and makes a mistake on request ("": none)."""
        raise TwinError(f"task '{task.name}': no simulated surgeon can perform a task with `{task.kind.name}`")

    def referee(self, setup: Setup, task: ConsoleTask, period: float) -> LiveReferee | None:
        """Return a referee with `period` in s between two samples; None: a page does not judge the task."""
        return None

    def marks(self, setup: Setup, task: ConsoleTask) -> Sequence[tuple[str, Array]]:
        """Return short texts to show in the picture, each with its position (3,) in m in the World."""
        return ()

    def outcome(
        self, setup: Setup, task: ConsoleTask, recording: Recording, arms: Mapping[str, ArmPath]
    ) -> TaskOutcome | None:
        """Return the measures of a session with these signals and motions of the arms; None: there are none."""
        return None

    def start(self, setup: Setup, task: ConsoleTask) -> Mapping[str, Array]:
        """Return {name of a place: joint values (n,)} of the robots that do not begin where the scene places them."""
        return {}

    def identity(self, setup: Setup, task: ConsoleTask) -> list[object]:
        """Return the inputs of the World that only this task has, as plain data for the hash of a session."""
        return []


def play_of(task: ConsoleTask) -> Play:
    """Return how a task is performed and judged, from the package of its kind."""
    kind = task.kind
    try:
        return import_module(f"{kind.package}.play").PLAY
    except (ImportError, AttributeError) as error:
        text = (
            f"task '{task.name}': the kind '{kind.name}' has no PLAY in a module 'play' of the package {kind.package}"
        )
        raise TwinError(f"{text}: {error}") from error
