"""A recorded interactive session: joint values and tool poses over time, stored as JSON."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import FailFast, Field, ValidationError

from twin.core import spatial
from twin.core.assets import atomic_folder
from twin.core.errors import TwinError
from twin.core.foreign.text import read_text
from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.model.mechanism import Mechanism
from twin.schema import Identifier, Table
from twin.schema.lines import spell

MAX_MOMENTS = 20_000
"""Maximum number of moments (recorded states) in a session, enough for five minutes of continuous motion."""

SCHEMA = "twin-posture-session"
"""Name of the format. Files with the name "twin-session", which sessions at a console have as well, are read too."""

_MAX_COMMAS = 64 * MAX_MOMENTS
"""Maximum number of commas, and so of values, in a session file, which is untrusted."""

_MAX_KEYS = 16
"""Maximum number of keys in one JSON object of a session file."""


@dataclass(frozen=True)
class Moment:
    """A recorded state: `time` in s, active joints `q` (n,) in m or rad, `T_base_tool` (4, 4), and a note `label`."""

    time: float
    q: Array
    T_base_tool: Array
    label: str = ""


@dataclass
class RecordedSession:
    """A recorded session of one robot.

    Attributes:
        robot: name of the robot.
        joints: names of the active joints, in the order of q.
        units: unit of each joint, "m" or "rad".
        moments: recorded states in the order of time; `add` appends a state.
    """

    robot: str
    joints: tuple[str, ...]
    units: tuple[str, ...]
    moments: list[Moment] = field(default_factory=list)

    @classmethod
    def of(cls, mechanism: Mechanism) -> RecordedSession:
        """Return an empty session of a robot."""
        names = []
        units = []
        for joint in mechanism.active:
            names.append(joint.name)
            units.append("rad" if joint.is_angle else "m")
        return cls(mechanism.name, tuple(names), tuple(units))

    def add(self, time: float, q: Array, T_base_tool: Array, label: str = "") -> None:
        """Append a state: `time` in s, active joints q (n,) in m or rad, T_base_tool (4, 4).

        Raises:
            TwinError: the session is full (`MAX_MOMENTS`), the time is not after the last state, q does not match the
                joints, or the pose is not rigid.
        """
        q = np.array(q, float)
        T = np.array(T_base_tool, float)
        where = f"session of {self.robot}, moment {len(self.moments)}"
        if len(self.moments) >= MAX_MOMENTS:
            raise TwinError(f"{where}: a session has at most {MAX_MOMENTS} states; save it, and begin another one")
        if not np.isfinite(time) or (self.moments and time <= self.moments[-1].time):
            after = f" after {self.moments[-1].time:g} s" if self.moments else ""
            raise TwinError(f"{where}: time = {time} s must be a finite number{after}")
        if q.shape != (len(self.joints),) or not np.all(np.isfinite(q)):
            raise TwinError(f"{where}: q = {q.tolist()} must be one finite number for each of {', '.join(self.joints)}")
        if not spatial.is_pose(T, 1e-6):
            raise TwinError(f"{where}: T_base_tool is not a rigid pose: {T.tolist()}")
        self.moments.append(Moment(float(time), q, T, label))

    @property
    def duration(self) -> float:
        """Time in s from the first to the last state."""
        if not self.moments:
            return 0.0
        return self.moments[-1].time - self.moments[0].time

    def at(self, t: float) -> Array:
        """Return q (n,) at time t in s, interpolated linearly; before the first and after the last state q is constant.

        Raises:
            TwinError: the session has no states.
        """
        if not self.moments:
            raise TwinError(f"session of {self.robot}: the session is empty; add a moment first")
        times = [moment.time for moment in self.moments]
        values = np.array([moment.q for moment in self.moments])
        q = np.zeros(len(self.joints))
        for k in range(len(q)):
            q[k] = np.interp(t, times, values[:, k])
        return q

    def save(self, path: Path) -> None:
        """Write the session as JSON.

        Raises:
            OutputError: the file cannot be written; an existing file is unchanged.
        """
        joints = []
        for name, unit in zip(self.joints, self.units, strict=True):
            joints.append({"name": name, "unit": unit})
        moments = []
        for moment in self.moments:
            moments.append(
                {
                    "time_s": moment.time,
                    "q": moment.q.tolist(),
                    "T_base_tool": moment.T_base_tool.tolist(),
                    "label": moment.label,
                }
            )
        data = {
            "schema": SCHEMA,
            "version": 1,
            "robot": self.robot,
            "joints": joints,
            "moments": moments,
        }
        path = Path(path)
        # a full disk leaves the earlier session as it was
        with atomic_folder(path.parent) as work:
            (work / path.name).write_text(json.dumps(data, allow_nan=False) + "\n", encoding="utf-8")

    @classmethod
    def load(cls, path: Path, mechanism: Mechanism) -> RecordedSession:
        """Read a session that was recorded with this robot.

        Raises:
            TwinError: the file is missing, malformed or from another robot; the message names the key.
        """
        try:
            text = read_text(Path(path), "JSON")
        except (OSError, UnicodeDecodeError) as error:
            raise TwinError(f"{path}: cannot be read as a session: {error}") from error
        try:
            if text.count(",") > _MAX_COMMAS:
                raise ValueError(
                    f"{text.count(',')} values, more than the maximum of {_MAX_COMMAS}; a session of {MAX_MOMENTS} "
                    "states has fewer"
                )
            # refuses an object with too many keys before pydantic looks at each of them
            json.loads(text, object_pairs_hook=_checked_object)
            table = _SessionTable.model_validate_json(text)
        except (json.JSONDecodeError, RecursionError) as error:
            raise TwinError(
                f"{path}: the file is not JSON: {error}; give a file that the panel Record has saved"
            ) from error
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            where = spell(first["loc"])
            # the input of a missing key is the table that lacks it
            if first["loc"] and first["type"] != "missing":
                where += f" = {repr(first['input'])[:60]}"
            text = f"{path}: {where}: {first['msg']}; give a file that the panel Record has saved"
            raise TwinError(text) from error
        except ValueError as error:
            raise TwinError(f"{path}: {error}; give a file that the panel Record has saved") from error
        session = cls.of(mechanism)
        if table.robot != session.robot:
            raise TwinError(
                f"{path}: robot = '{table.robot}': the session is not of '{session.robot}'; load robot '{table.robot}'"
            )
        recorded = [(joint.name, joint.unit) for joint in table.joints]
        present = list(zip(session.joints, session.units, strict=True))
        if recorded != present:
            raise TwinError(
                f"{path}: joints: recorded with {_joint_list(recorded)}; {session.robot} has {_joint_list(present)}: "
                "record it again"
            )
        for moment in table.moments:
            try:
                session.add(moment.time_s, np.array(moment.q), np.array(moment.T_base_tool), moment.label)
            except TwinError as error:
                raise TwinError(f"{path}: {error}") from error
        return session


def _joint_list(joints: list[tuple[str, str]]) -> str:
    """Return a text with name and unit of each joint."""
    return ", ".join(f"{name} ({unit})" for name, unit in joints)


def _checked_object(pairs: list[tuple[str, object]]) -> JsonObject:
    """Return the JSON object of these keys and values; refuse an object with more keys than a session has."""
    if len(pairs) > _MAX_KEYS:
        raise ValueError(f"an object has {len(pairs)} keys; an object of a session has at most {_MAX_KEYS}")
    return dict(pairs)


_MatrixRow = tuple[float, float, float, float]


class _JointTable(Table):
    name: Identifier
    unit: Literal["m", "rad"]


class _MomentTable(Table):
    time_s: float
    q: Annotated[list[float], FailFast()]
    T_base_tool: tuple[_MatrixRow, _MatrixRow, _MatrixRow, _MatrixRow]
    label: str


class _SessionTable(Table):
    kind: Annotated[Literal["twin-posture-session", "twin-session"], Field(alias="schema")]
    version: Literal[1]
    robot: Identifier
    joints: Annotated[list[_JointTable], FailFast()]
    moments: Annotated[list[_MomentTable], FailFast(), Field(max_length=MAX_MOMENTS)]
