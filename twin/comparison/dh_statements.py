"""The parameters of a table of Denavit-Hartenberg parameters, with their lines, and what another value would move.

The motions of a row are computed here, without the reader that made the side.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from twin.comparison.side import Axis, DhTableRow, RobotSide
from twin.core import spatial
from twin.core.spatial import Array

_ROW_MOTIONS: dict[str, tuple[str, ...]] = {
    "standard": ("q", "Rz theta", "Tz d", "Tx a", "Rx alpha"),
    "modified": ("Rx alpha", "Tx a", "Rz theta", "Tz d", "q"),
    "khalil": ("Rz gamma", "Tz b", "Rx alpha", "Tx d", "Rz theta", "Tz r", "q"),
    "hayati": ("q", "Rz theta", "Tz d", "Tx a", "Rx alpha", "Ry beta"),
}
"""Motions of a row in their order; "q" is that of its joint, along or about z."""


@dataclass(frozen=True)
class CellStatement:
    """One parameter of one row.

    Attributes:
        file, line: where it stands.
        what: "row 'q1' d".
        values: its value, in the unit of the table.
        row, parameter: where it belongs.
        role: "cell".
    """

    file: str
    line: int
    what: str
    values: tuple[float, ...]
    row: DhTableRow
    parameter: str
    role: Literal["cell"] = "cell"

    @property
    def unit(self) -> float:
        """Unit of the value in m or rad."""
        return self.row.units[self.parameter]

    @property
    def is_angle(self) -> bool:
        """Whether the value is an angle."""
        return self.parameter in ("alpha", "theta", "beta", "gamma")

    def applied(self, side: RobotSide, values: Sequence[float] | Array) -> RobotSide | None:
        """Return the side with another value of this parameter, in the unit of the table; None if it has no such row.

        `values` has this one value. A change of the row moves its joint and all that follows it by a motion in the base
        frame: `W_joint` moves what the part before the joint places, `W_link` what the whole row places.
        """
        entry = side.frames.get(self.row.link)
        if entry is None:
            return None
        _, T_base_link = entry
        changed = {**self.row.values, self.parameter: float(values[0]) * self.unit}
        before, after = self._row_motions(self.row.values)
        new_before, new_after = self._row_motions(changed)
        T_joint = self._joint_motion(side)
        T_base_parent = T_base_link @ spatial.inverse(before @ T_joint @ after)
        W_joint = T_base_parent @ new_before @ spatial.inverse(T_base_parent @ before)
        W_link = T_base_parent @ new_before @ T_joint @ new_after @ spatial.inverse(T_base_link)
        axes = []
        for axis in side.axes:
            if axis.name in self.row.joints_below:
                axis = axis.moved_by(W_link)
            elif axis.name == self.row.joint:
                axis = axis.moved_by(W_joint)
            axes.append(axis)
        frames = {}
        for name, (group, T) in side.frames.items():
            if name in self.row.frames_below:
                T = W_link @ T
            frames[name] = (group, T)
        return replace(side, axes=tuple(axes), frames=frames)

    def moves(self, axis: Axis) -> bool:
        """Return whether another value moves the line of a joint of the side."""
        if axis.name in self.row.joints_below:
            return True
        return axis.name == self.row.joint and self._is_before_joint()

    def _is_before_joint(self) -> bool:
        """Return whether the parameter stands before the motion of the row's joint, and so moves the line of it."""
        motions = _ROW_MOTIONS[self.row.convention]
        parameters_before = [motion.split()[-1] for motion in motions[: motions.index("q")]]
        return self.parameter in parameters_before

    def _joint_motion(self, side: RobotSide) -> Array:
        """Return the motion (4, 4) of the joint of the row at the drawn state."""
        for axis in side.axes:
            if axis.name == self.row.joint:
                if axis.is_angle:
                    return spatial.pose(spatial.exp_so3(np.array([0.0, 0.0, axis.drawn])))
                return spatial.pose(p=np.array([0.0, 0.0, axis.drawn]))
        return np.eye(4)

    def _row_motions(self, values: Mapping[str, float]) -> tuple[Array, Array]:
        """Return the constant motions (4, 4) of the row before and after that of its joint."""
        parts = [np.eye(4), np.eye(4)]
        part = 0  # that before the joint
        for motion in _ROW_MOTIONS[self.row.convention]:
            if motion == "q":
                part = 1
                continue
            kind, parameter = motion.split()
            vector = values.get(parameter, 0.0) * np.eye(3)["xyz".index(kind[1])]
            step = spatial.pose(p=vector)
            if kind[0] == "R":
                step = spatial.pose(spatial.exp_so3(vector))
            parts[part] = parts[part] @ step
        return parts[0], parts[1]


def table_cells(side: RobotSide) -> list[CellStatement]:
    """Return the parameters of the table of a side; [] if it is no table."""
    cells_of_table = []
    for row in side.dh_rows:
        for parameter, value in row.values.items():
            written_value = value / row.units[parameter]
            what = f"row '{row.joint}' {parameter}"
            cells_of_table.append(CellStatement(row.file, row.line, what, (written_value,), row, parameter))
    return cells_of_table
