"""Tables of poses: a CSV whose rows are joint values and the pose that was measured, or computed, at them.

    # noise: 0.05 mm, 0.01 deg
    joint_1 [deg], joint_2 [deg], slide [mm], x [mm], y [mm], z [mm], qw, qx, qy, qz

The rotation is a quaternion (qw, qx, qy, qz), a matrix (r11 to r33), or roll, pitch and yaw as in a URDF; without one,
only positions are compared. Poses are those of the tool in the base frame of whoever measured them.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import numpy as np

from twin.core import spatial
from twin.core.errors import SourceError
from twin.core.foreign.text import read_text
from twin.core.spatial import Array
from twin.core.units import DEG, LENGTH, MM

MAX_ROWS = 100_000
"""Maximum number of rows of a table."""

_MIN_ROWS = 4
"""Fewest rows: base and tool frame are fitted, which three poses can always do."""

_SIZE_OF_UNIT = {"mm": MM, "cm": LENGTH["cm"], "m": 1.0, "deg": DEG, "°": DEG, "rad": 1.0}
"""{unit: its size in m or rad}."""

_LENGTHS = ("mm", "cm", "m")
_ANGLES = ("deg", "°", "rad")

_POSITION = ("x", "y", "z")
_QUATERNION = ("qw", "qx", "qy", "qz")
_MATRIX = ("r11", "r12", "r13", "r21", "r22", "r23", "r31", "r32", "r33")
_RPY = ("roll", "pitch", "yaw")

_UNIT_LENGTH_TOL = 0.01
"""Largest difference of a quaternion's length, or of a matrix's columns, from 1: files round to three digits."""

_NOISE_COMMENT = re.compile(r"^\s*#\s*noise\s*[:=]\s*(.*?)\s*$", re.IGNORECASE)
_UNITS_COMMENT = re.compile(r"^\s*#\s*units?\s*[:=]\s*(.*?)\s*$", re.IGNORECASE)
_HEADING_WITH_UNIT = re.compile(r"^(.*?)\s*[\[(]\s*([A-Za-z°]+)\s*[\])]$")


@dataclass(frozen=True)
class ReadPoses:
    """The rows of a table of poses, in SI units.

    Attributes:
        path: the file.
        joints: names of the joints, in the order of their columns.
        angles: whether each joint is an angle.
        q: (k, joints) values in rad or m.
        T: (k, 4, 4) poses; without rotations, their rotation parts are identity.
        rotations: whether the table has rotations.
        lines: line of each row.
        noise: stated standard deviation of a coordinate in m and of a rotation about an axis in rad; None: not stated.
    """

    path: Path
    joints: tuple[str, ...]
    angles: tuple[bool, ...]
    q: Array
    T: Array
    rotations: bool
    lines: tuple[int, ...]
    noise: tuple[float | None, float | None]


def is_pose_table(path: Path) -> bool:
    """Return whether a CSV has the columns x, y and z, as a table of poses has."""
    if path.suffix.lower() != ".csv" or not path.is_file():
        return False
    try:
        lines = _table_rows(path, read_text(path, "text", encoding="utf-8-sig"))
    except (UnicodeDecodeError, OSError, SourceError):
        return False  # the reader of the other kind of table states the fault
    if not lines:
        return False
    _, headings = lines[0]
    names = set()
    for heading in headings:
        name, _ = _name_and_unit(heading)
        names.add(name.lower())
    return set(_POSITION) <= names


def read_poses(path: Path, length: str | None = None, angle: str | None = None) -> ReadPoses:
    """Return a table of poses.

    Args:
        path: a CSV.
        length: unit of lengths without one in their heading, "mm", "cm" or "m".
        angle: unit of such angles, "deg" or "rad".

    Raises:
        SourceError: a column is missing, has no unit, or a cell is not a number; the message names file and line.
    """
    try:
        text = read_text(path, "text", encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise SourceError(f"{path}: the file is not text in UTF-8: {error.reason} at byte {error.start}") from error
    return _TableReader(path, text, length, angle).read()


def _table_rows(path: Path, text: str) -> list[tuple[int, list[str]]]:
    """Return (line, cells) of the lines that are neither empty nor comments."""
    table_rows: list[tuple[int, list[str]]] = []
    separator = ""
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        # From the headings alone: in the rows of a table with semicolons, a comma may be the decimal sign.
        if not separator:
            separator = ","
            for candidate in ("\t", ";"):
                if candidate in line:
                    separator = candidate
        try:
            cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True))
        except csv.Error as error:
            raise SourceError(f"{path}:{number}: the line is not CSV: {error}") from error
        table_rows.append((number, list(map(str.strip, cells))))
        if len(table_rows) > MAX_ROWS + 1:
            raise SourceError(f"{path}: the table has more than {MAX_ROWS} rows")
    return table_rows


def _name_and_unit(heading: str) -> tuple[str, str]:
    """Return (name, unit or "") of a heading such as "x [mm]"."""
    match = _HEADING_WITH_UNIT.match(heading.strip())
    if match is None:
        return heading.strip(), ""
    return match[1].strip(), match[2].lower()


class _TableReader:
    """Reads one file: its comments when it is made, its table by `read`. `fail` raises an error with file and line."""

    def __init__(self, path: Path, text: str, length: str | None, angle: str | None) -> None:
        self.path = path
        self.units = {"length": length, "angle": angle}
        self.noise: list[float | None] = [None, None]
        self.lines = _table_rows(path, text)
        self._read_comments(text)

    def fail(self, line: int, message: str) -> NoReturn:
        raise SourceError(f"{self.path}:{line}: {message}")

    def _read_comments(self, text: str) -> None:
        """Read the comments "# units: mm, deg" and "# noise: 0.05 mm, 0.01 deg"."""
        for number, line in enumerate(text.splitlines(), 1):
            units = _UNITS_COMMENT.match(line)
            if units:
                for unit in re.split(r"[,;\s]+", units[1].lower()):
                    if unit not in _SIZE_OF_UNIT:
                        self.fail(number, f"there is no unit '{unit}'; use two of {', '.join(_SIZE_OF_UNIT)}")
                    kind = "angle"
                    if unit in _LENGTHS:
                        kind = "length"
                    self.units[kind] = unit
            noise = _NOISE_COMMENT.match(line)
            if noise:
                for part in noise[1].split(","):
                    self._add_noise(number, part.strip())

    def _add_noise(self, number: int, part: str) -> None:
        """Keep a standard deviation such as "0.05 mm", of lengths or of angles by its unit."""
        match = re.fullmatch(r"([0-9.eE+-]+)\s*([A-Za-z°]+)", part)
        unit = ""
        value: float | None = None
        if match is not None:
            unit = match[2].lower()
            value = _number(match[1])
        if unit not in _SIZE_OF_UNIT or value is None or not value > 0:
            self.fail(number, f"noise '{part}': write a positive number and a unit, as in # noise: 0.05 mm, 0.01 deg")
        self.noise[unit in _ANGLES] = value * _SIZE_OF_UNIT[unit]

    def read(self) -> ReadPoses:
        """Return the table."""
        if not self.lines:
            raise SourceError(f"{self.path}: the file has no table: a line of headings, then a line for each pose")
        (line, headings), *pose_rows = self.lines
        names, units = self._names_and_units(line, headings)
        lower_names = [name.lower() for name in names]
        rotation_columns = self._rotation_columns(line, lower_names)
        pose = {*_POSITION, *rotation_columns}
        joint_columns = []
        joint_names = []
        for column, name in enumerate(names):
            if name.lower() not in pose:
                joint_columns.append(column)
                joint_names.append(name)
        if not joint_columns:
            self.fail(line, "the table has no column with joint values: add one for each joint, as in joint_1 [deg]")
        for name in _POSITION:
            if name not in lower_names:
                self.fail(line, f"the table has no column '{name}': the position needs x, y and z")
        if len(pose_rows) < _MIN_ROWS:
            self.fail(
                line, f"the table has {len(pose_rows)} rows; at least {_MIN_ROWS} are needed, and more to judge a robot"
            )
        values = self._values(headings, pose_rows)
        angles = []
        for column in joint_columns:
            unit = units[column] or self._unit(line, headings[column], angle=True)
            angles.append(unit in _ANGLES)
            values[:, column] *= _SIZE_OF_UNIT[unit]
        lines = tuple(number for number, _ in pose_rows)
        positions = np.zeros((len(pose_rows), 3))
        for axis, name in enumerate(_POSITION):
            column = lower_names.index(name)
            unit = units[column] or self._unit(line, headings[column], angle=False)
            if unit not in _LENGTHS:
                self.fail(line, f"the heading '{headings[column]}' is in {unit}, but {name} is a length")
            positions[:, axis] = values[:, column] * _SIZE_OF_UNIT[unit]
        rotations = self._rotations(line, lower_names, units, rotation_columns, values, lines)
        return ReadPoses(
            self.path,
            tuple(joint_names),
            tuple(angles),
            values[:, joint_columns],
            spatial.pose(rotations, positions),
            bool(rotation_columns),
            lines,
            (self.noise[0], self.noise[1]),
        )

    def _names_and_units(self, line: int, headings: Sequence[str]) -> tuple[list[str], list[str]]:
        """Return the names of the columns, and their units, "" where a heading states none."""
        names: list[str] = []
        lower_names: list[str] = []
        units: list[str] = []
        for heading in headings:
            name, unit = _name_and_unit(heading)
            if not name:
                self.fail(line, "a heading is empty: name the joint, or remove the column")
            if name.lower() in lower_names:
                self.fail(line, f"the heading '{name}' stands twice: remove one of the columns")
            if unit and unit not in _SIZE_OF_UNIT:
                self.fail(line, f"the heading '{heading}' has no known unit: use one of {', '.join(_SIZE_OF_UNIT)}")
            names.append(name)
            lower_names.append(name.lower())
            units.append(unit)
        return names, units

    def _unit(self, line: int, heading: str, *, angle: bool) -> str:
        """Return the unit of a column without one: that of --units or of the comment."""
        kind = "length"
        example = "mm"
        if angle:
            kind = "angle"
            example = "deg"
        unit = self.units[kind]
        if unit is None:
            self.fail(line, f"the unit of '{heading}' is not stated: write '{heading} [{example}]', or give --units")
        return unit

    def _rotation_columns(self, line: int, lower_names: Sequence[str]) -> tuple[str, ...]:
        """Return the columns of the rotation, () without one."""
        stated_columns: list[tuple[str, ...]] = []
        for columns in (_QUATERNION, _MATRIX, _RPY):
            missing = [name for name in columns if name not in lower_names]
            if not missing:
                stated_columns.append(columns)
            elif len(missing) < len(columns):
                stated = ", ".join(name for name in columns if name in lower_names)
                self.fail(line, f"the rotation has {stated}, but not {', '.join(missing)}: write all of them or none")
        if len(stated_columns) > 1:
            self.fail(
                line,
                f"the rotation is stated twice, by {stated_columns[0][0]}.. and {stated_columns[1][0]}..: remove one",
            )
        if not stated_columns:
            return ()
        return stated_columns[0]

    def _values(self, headings: Sequence[str], rows: Sequence[tuple[int, list[str]]]) -> Array:
        """Return the numbers (k, columns) of the rows."""
        values = np.zeros((len(rows), len(headings)))
        for row_number, (number, cells) in enumerate(rows):
            if len(cells) != len(headings):
                self.fail(number, f"the row has {len(cells)} cells, but there are {len(headings)} headings")
            for column, cell in enumerate(cells):
                value = _number(cell)
                if value is None:
                    self.fail(
                        number,
                        f"{headings[column]} = '{cell[:40]}' is not a number: correct the cell, or remove the row",
                    )
                values[row_number, column] = value
        return values

    def _rotations(
        self,
        line: int,
        lower_names: list[str],
        units: Sequence[str],
        rotation_columns: Sequence[str],
        values: Array,
        lines: Sequence[int],
    ) -> Array:
        """Return the rotations (k, 3, 3); identity for a table without them."""
        if not rotation_columns:
            return np.broadcast_to(np.eye(3), (len(values), 3, 3))
        columns = [lower_names.index(name) for name in rotation_columns]
        numbers = values[:, columns]
        if rotation_columns == _RPY:
            sizes = []
            for column in columns:
                unit = units[column] or self._unit(line, lower_names[column], angle=True)
                if unit not in _ANGLES:
                    self.fail(line, f"the heading '{lower_names[column]}' is in {unit}, but is an angle")
                sizes.append(_SIZE_OF_UNIT[unit])
            roll, pitch, yaw = (numbers * sizes).T
            x, y, z = np.eye(3)
            Rz = spatial.exp_so3(yaw[:, None] * z)
            Ry = spatial.exp_so3(pitch[:, None] * y)
            return Rz @ Ry @ spatial.exp_so3(roll[:, None] * x)
        if rotation_columns == _QUATERNION:
            lengths = np.linalg.norm(numbers, axis=1)
            wrong_rows = np.flatnonzero(np.abs(lengths - 1.0) > _UNIT_LENGTH_TOL)
            if len(wrong_rows):
                row_number = int(wrong_rows[0])
                self.fail(lines[row_number], f"the quaternion has the length {lengths[row_number]:.4g} instead of 1")
            return spatial.matrix_from_quat_wxyz(numbers)
        matrices = numbers.reshape(-1, 3, 3)
        gaps = np.abs(np.swapaxes(matrices, 1, 2) @ matrices - np.eye(3)).max(axis=(1, 2))
        wrong_rows = np.flatnonzero((gaps > 2 * _UNIT_LENGTH_TOL) | (np.linalg.det(matrices) < 0))
        if len(wrong_rows):
            self.fail(
                lines[int(wrong_rows[0])], "r11 to r33 are no rotation: its columns must be unit vectors, right-handed"
            )
        # the nearest rotations, because files round the numbers
        U, _, Vt = np.linalg.svd(matrices)
        return U @ Vt


def _number(text: str) -> float | None:
    """Return a finite number, or None."""
    if not re.fullmatch(r"[+-]?[0-9.]+(?:[eE][+-]?[0-9]+)?", text):
        return None
    try:
        value = float(text)
    except ValueError:
        return None
    if not math.isfinite(value):
        return None
    return value
