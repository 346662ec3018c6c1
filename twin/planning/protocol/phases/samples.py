"""samples: move the driven joints as in a table of samples over time, such as one that `twin plan` has written."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from twin.core.errors import TwinError
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.planning.protocol.phase import Phase, PhaseEnd, PhaseStart
from twin.planning.protocol.phase_table import PhaseTable
from twin.planning.protocol.protocol_file import ProtocolFile
from twin.planning.protocol.protocol_state import ProtocolState
from twin.schema import Identifier, NotNegative

_TIME = "t_s"
_ROUNDING = 1e-9
"""Time in s by which a sample may be outside the span of the phase."""


class SamplesTable(PhaseTable):
    """Move the driven joints as in a table of samples over time, with the timing of this table."""

    type: Literal["samples"]
    file: Annotated[
        str,
        Field(
            pattern=r"^[^/\\]+\.csv$",
            description="CSV file in the folder of the protocol: a column t_s, and one for each moved driven joint, "
            "NAME_deg or NAME_mm",
        ),
    ]
    to: Annotated[Identifier | None, Field(description="the waypoint with joint values at the end of the phase")] = None
    from_s: Annotated[NotNegative | None, Field(description="first used time in the file; default: the first one")] = (
        None
    )
    to_s: Annotated[float | None, Field(gt=0, description="last used time in the file; default: the last one")] = None

    rank: ClassVar[int] = 9

    def advance(self, state: ProtocolState) -> None:
        """Check that no RCM is registered; if `to` is given, end the phase there and check that it has joint values."""
        state.require_no_rcm(self.type)
        if self.to is not None:
            state.end_at(self.to, "a motion by samples", "joints")

    def phase(self, protocol_file: ProtocolFile) -> Samples:
        """Return the phase that this table describes, in SI units."""
        try:
            names, rows = _table(protocol_file.read_text(self.file, "CSV"))
        except (OSError, ValueError, csv.Error) as error:
            raise protocol_file.error("file", f"{self.file} is no table of samples: {error}") from error
        except TwinError as error:  # the file is too large
            raise protocol_file.error("file", str(error)) from error
        t = rows[:, 0]
        begin = t[0]
        if self.from_s is not None:
            begin = self.from_s
        end = t[-1]
        if self.to_s is not None:
            end = self.to_s
        is_used = (t >= begin - _ROUNDING) & (t <= end + _ROUNDING)
        span = f"{self.file} has samples from {t[0]:g} to {t[-1]:g} s"
        for key, bound in (("from_s", begin), ("to_s", end)):
            if not t[0] - _ROUNDING <= bound <= t[-1] + _ROUNDING:
                raise protocol_file.error(key, f"{span}, none at {bound:g} s")
            distances = np.abs(t - bound)
            if distances.min() > _ROUNDING:
                first, second = t[np.sort(np.argsort(distances)[:2])]
                raise protocol_file.error(
                    key,
                    f"{self.file} has no sample at {bound:g} s; the nearest ones: {first:g}, {second:g} s",
                )
        if is_used.sum() < 2:
            raise protocol_file.error("from_s", f"{span}, but fewer than two of them are from {begin:g} to {end:g} s")
        used_rows = rows[is_used]
        joints = []
        angles = []
        factors = []
        for name in names:
            joint, unit = name.rsplit("_", 1)
            joints.append(joint)
            if unit == "deg":
                angles.append(joint)
                factors.append(DEG)
            else:
                factors.append(MM)
        times = used_rows[:, 0] - used_rows[0, 0]
        q = used_rows[:, 1:] * np.array(factors)
        return Samples(self.name, times, q, tuple(joints), frozenset(angles), self.to or "")


def _table(text: str) -> tuple[list[str], Array]:
    """Return (names (n,) of the joint columns, numbers (k, 1 + n) with the time in column 0) of a CSV text.

    Raises:
        ValueError: the text is no table of samples.
    """
    lines = text.splitlines()
    if not lines:
        lines = [""]
    head = [name.strip() for name in lines[0].split(",")]
    names = head[1:]
    if head[0] != _TIME or not names:
        raise ValueError(f"the first line must be {_TIME},NAME_deg,... with a unit (deg or mm) after each joint's name")
    joints = []
    for name in names:
        joint, _, unit = name.rpartition("_")
        if not joint or unit not in ("deg", "mm"):
            raise ValueError(f"column '{name}' is no joint with its unit: write NAME_deg or NAME_mm")
        joints.append(joint)
    for joint in joints:
        if joints.count(joint) > 1:
            raise ValueError(f"joint '{joint}' has two columns")
    rows = []
    for line in csv.reader(lines[1:]):
        if line:
            rows.append(list(map(float, line)))
    for k, row in enumerate(rows):
        if len(row) != len(head) or not np.isfinite(row).all():
            raise ValueError(f"row {k + 1} must have {len(head)} finite numbers")
    numbers = np.array(rows).reshape(-1, len(head))
    if len(numbers) < 2 or (np.diff(numbers[:, 0]) <= 0).any():
        raise ValueError(f"{_TIME} must increase from row to row, over at least two rows")
    return names, numbers


@dataclass(frozen=True)
class Samples(Phase):
    """Move the driven joints as in a table of samples.

    Attributes:
        t: (k,) times in s, from 0.
        q: (k, n) joint values in m or rad.
        joints: names (n,) of the joints.
        angle_joints: names of the joints whose values are given in degrees.
        to: name of the waypoint at the end; "" if there is none.
    """

    t: Array
    q: Array
    joints: tuple[str, ...]
    angle_joints: frozenset[str]
    to: str = ""
    type: ClassVar[str] = "samples"
    by_joints: ClassVar[bool] = True
    has_length: ClassVar[bool] = False

    def end_after(self, start: PhaseStart) -> PhaseEnd:
        """Return the state at the end: the waypoint, if there is one; the pose follows from the mechanism."""
        if not self.to:
            return PhaseEnd(start.angles, start.tip, start.rcm)
        angles, tip = start.pose_at(self.to)
        return PhaseEnd(angles, tip, start.rcm, self.to)
