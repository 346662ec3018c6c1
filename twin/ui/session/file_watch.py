"""Watch the files of a robot, and load the robot again after a change."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from twin import api
from twin.api import Robot
from twin.core.errors import TwinError
from twin.core.program_end import ending
from twin.ui.session.movable_robot import MovableRobot

POLL_PERIOD = 0.1
"""Time in s between two looks at the files. A change is used when two looks see the same files: it is complete then."""

Stamps = dict[Path, tuple[int, int]]
"""{file: (time of the last change in ns, size in bytes)}."""


@dataclass(frozen=True)
class Reloaded:
    """Result of loading a robot again.

    Attributes:
        movable: the new robot at its start; None if it could not be loaded.
        error: why it could not be loaded; "" if it was.
        files: names of the changed files.
        seconds: time from the complete change of the files to this result in s.
    """

    movable: MovableRobot | None
    error: str
    files: tuple[str, ...]
    seconds: float


class RobotFileWatch:
    """Loads a robot in a thread whenever its description, STEP, formula or protocols change; see `poll`."""

    def __init__(self, robot: Robot, source: str, tool: str | None = None) -> None:
        """Begin with the files as they are.

        Args:
            robot: the robot as it is shown.
            source: first argument of `twin.load` for the same robot.
            tool: argument `tool` of `twin.load`.

        Raises:
            TwinError: the robot has no folder with such files.
        """
        if robot.files is None:
            raise TwinError(f"{robot.name} was loaded from one file: --watch needs a robot folder or a built-in robot")
        self._files = robot.files
        self._source = source
        self._tool = tool
        self._loaded_stamps = self._stamps()
        self._last_stamps = self._loaded_stamps
        self._look_time = -POLL_PERIOD
        self._thread: threading.Thread | None = None
        self._reloaded: Reloaded | None = None

    def poll(self, now: float) -> Reloaded | None:
        """Look at the files, at most every `POLL_PERIOD` s; return a new result once. `now`: time in s of any clock."""
        if self._thread is not None:
            if self._thread.is_alive():
                return None
            self._thread = None
            result = self._reloaded
            self._reloaded = None
            return result
        if now - self._look_time < POLL_PERIOD:
            return None
        self._look_time = now
        stamps = self._stamps()
        complete = stamps == self._last_stamps
        self._last_stamps = stamps
        if not complete or stamps == self._loaded_stamps:
            return None
        names = tuple(sorted({path.name for path in _different(self._loaded_stamps, stamps)}))
        self._loaded_stamps = stamps
        self._reloaded = None
        self._thread = threading.Thread(target=self._load, args=(names,), daemon=True, name="load the changed robot")
        self._thread.start()
        return None

    def close(self) -> None:
        """Wait for a robot that is being loaded."""
        if self._thread is not None:
            self._thread.join(10.0)

    def _load(self, names: tuple[str, ...]) -> None:
        begin = time.perf_counter()
        movable = None
        error = ""
        try:
            movable = MovableRobot(api.load(self._source, tool=self._tool))
        except TwinError as reason:
            error = str(reason)
        except Exception as reason:  # the formula is code of a user, which can raise anything
            error = f"{type(reason).__name__}: {reason}"
        # SystemExit or KeyboardInterrupt of that code: Ctrl-C itself raises nothing in this thread
        except BaseException as reason:
            error = str(ending(reason))
        self._reloaded = Reloaded(movable, error, names, time.perf_counter() - begin)

    def _stamps(self) -> Stamps:
        stamps: Stamps = {}
        for path in self._paths():
            try:
                about = path.stat()
            except OSError:  # an editor replaces a file by another one
                continue
            stamps[path] = (about.st_mtime_ns, about.st_size)
        return stamps

    def _paths(self) -> Iterator[Path]:
        yield self._files.description
        yield self._files.formula
        yield from self._files.cad.glob("*.step")
        yield from self._files.trajectories.glob("*.toml")


def _different(before: Stamps, after: Stamps) -> set[Path]:
    """Return the files that are in one of the two only, or have changed."""
    changed = set(before.keys() ^ after.keys())
    for path in before.keys() & after.keys():
        if before[path] != after[path]:
            changed.add(path)
    return changed
