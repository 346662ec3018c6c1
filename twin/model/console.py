"""The tables of a surgeon's console in a scene file: robots of both hands, cameras, and forces on the hands."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from twin.core import spatial
from twin.core.errors import unknown
from twin.core.provenance import Parameter
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.schema import Identifier, Row, Sourced, Table, Vector, at, error_at


class StereoTable(Table):
    """Two lenses side by side, `baseline_mm` apart; their lines of sight cross `converge_mm` in front of the lenses."""

    baseline_mm: float = Field(gt=0, le=200)
    converge_mm: float = Field(gt=0, le=10_000)


class CameraTable(Sourced):
    """A camera on a frame of a robot: it looks along z of the frame, and -y is up; `roll_deg` rotates it about z.

    `position_mm` and `tilt_deg` place a camera that is beside its frame: it is moved to the position in the frame, and
    rotated about the x axis of the frame, before the roll; a tilt of 180 degrees looks against z. `view_deg` is the
    angle of view. With `stereo`, the camera has two lenses, each at half the baseline from the camera's origin.
    """

    robot: Identifier
    frame: Identifier
    position_mm: Vector = (0.0, 0.0, 0.0)
    tilt_deg: float = 0.0
    roll_deg: float = 0.0
    view_deg: float = Field(gt=1, lt=170)
    stereo: StereoTable | None = None

    @property
    def in_frame(self) -> Array:
        """Pose (4, 4) of the camera in the frame `frame` of the robot: position, tilt about x, and roll about z."""
        roll = spatial.pose(spatial.rotation_z(self.roll_deg * DEG))
        if self.tilt_deg == 0 and not any(self.position_mm):
            return roll
        tilt = spatial.exp_so3(np.array([self.tilt_deg * DEG, 0.0, 0.0]))
        return spatial.pose(tilt, np.array(self.position_mm) * MM) @ roll


class CameraRangeTable(Table):
    """Permitted motion of a console's camera about its port: (minimum, maximum) for each angle and for the depth."""

    pan_deg: tuple[float, float]
    tilt_deg: tuple[float, float]
    depth_mm: tuple[float, float]
    roll_deg: tuple[float, float]

    @model_validator(mode="after")
    def _in_order(self) -> CameraRangeTable:
        for key in ("pan_deg", "tilt_deg", "depth_mm", "roll_deg"):
            low, high = getattr(self, key)
            if not low < high:
                raise at(key, f"the lowest value, {low:g}, must be below the highest, {high:g}")
        return self


class TeleoperationTable(Sourced):
    """Teleoperation by the tool rates of a PID law, as in the SHER simulation paper, eqs (5) to (7).

    The robot moves only while the pedal is pressed. `clutch` is the reading of eq. (7): "corrected" keeps the offset of
    the handle until the next press of the pedal, "printed" applies it in one tick only. The gains are those of eq. (5).
    """

    clutch: Literal["corrected", "printed"] = "corrected"
    kp_per_s: float = Field(gt=0, le=100)
    ki_per_s2: float = Field(0.0, ge=0, le=1000)
    kd: float = Field(0.0, ge=0, le=1)


class ConsoleTable(Sourced):
    """A surgeon's console: the robots that each hand can control, and the camera of the picture.

    A tap on the clutch selects the next robot in `right` or `left`. `scale` is the tool displacement divided by the
    hand displacement. `tip` is the name of a frame that each of these robots has; default: the tool frame. The origin
    of this frame must touch the targets, and its path length is measured. `instrument_mm` is the length of a robot's
    instrument from the tip to the outer end; if it is given, the hand can control either end. `through` names the
    robots without a mechanical RCM: the controller guides the shaft of such a robot (the z axis of the tool) through
    the robot's port. `camera_range` replaces the range of the da Vinci's endoscope.

    With `teleoperation`, the console has one hand and one robot: the right hand moves it by rates while the pedal is
    pressed, and the camera does not move.
    """

    right: list[Identifier] = Field(min_length=1)
    left: list[Identifier] = Field(default_factory=list)
    camera: Identifier
    tip: Identifier | None = None
    scale: float = Field(ge=0.05, le=1)
    through: list[Identifier] = Field(default_factory=list)
    instrument_mm: dict[Identifier, Annotated[float, Field(ge=50, le=1000)]] = Field(default_factory=dict)
    camera_range: CameraRangeTable | None = None
    teleoperation: TeleoperationTable | None = None

    @property
    def hands(self) -> tuple[str, ...]:
        """The hands that move robots: "right", and "left" unless the console has one hand only."""
        if self.left:
            return ("right", "left")
        return ("right",)

    @model_validator(mode="after")
    def _hands(self) -> ConsoleTable:
        if self.teleoperation is None:
            if not self.left:
                raise at("left", "name a robot of the left hand; only a console with `teleoperation` has one hand")
            return self
        if self.left or len(self.right) != 1:
            raise at("right", "a console with `teleoperation` has one hand: one robot in `right`, and none in `left`")
        for key in ("through", "instrument_mm", "camera_range"):
            if getattr(self, key):
                raise at(key, "a console with `teleoperation` does not have this key: remove it")
        return self

    @model_validator(mode="after")
    def _lengths(self) -> ConsoleTable:
        for name in self.through:
            if name not in self.instrument_mm:
                raise at("through", f"'{name}' needs the length of its instrument in `instrument_mm`")
        return self


class HapticsTable(Sourced):
    """Forces on the hands: stiffness and damping of all surfaces, and the maximum force `largest_n`.

    `device_damping_ns_m` is the damping of the haptic device together with the fingers that hold it. The force of a
    surface is computed at sample times only; with too little damping, the surface would therefore add energy to the
    hand (no passivity). `on`: whether the forces are switched on at the start.
    """

    stiffness_n_m: float = Field(gt=0, le=10_000)
    damping_ns_m: float = Field(ge=0, le=1000)
    largest_n: float = Field(gt=0, le=50)
    device_damping_ns_m: float = Field(gt=0, le=1000)
    on: bool = True


def check(path: Path, console: ConsoleTable, cameras: Mapping[str, CameraTable], robots: Sequence[str]) -> None:
    """Raise an error if the console names a camera or robot that the scene does not have, or names a robot twice.

    Raises:
        DescriptionError: the message gives the file, the line, the key and the wrong name.
    """
    if console.camera not in cameras:
        raise error_at(path, ("console", "camera"), unknown("camera", console.camera, cameras))
    moved_names = []
    if console.teleoperation is None:  # otherwise the camera does not move, and may be on the robot's base
        moved_names.append(cameras[console.camera].robot)
    for hand in console.hands:
        for name in getattr(console, hand):
            if name not in robots:
                raise error_at(path, ("console", hand), unknown("robot", name, robots))
            if name in moved_names:
                raise error_at(
                    path, ("console", hand), f"a hand or the camera already moves '{name}'; name each robot once"
                )
            moved_names.append(name)
    for name in console.instrument_mm:
        if name not in (*console.right, *console.left):
            raise error_at(
                path,
                ("console", "instrument_mm", name),
                unknown("robot of a hand", name, [*console.right, *console.left]),
            )


def listed(console: ConsoleTable | None, haptics: HapticsTable | None) -> Iterator[Parameter]:
    """Yield the numbers of a console, and of the forces on the hands, as parameters with provenance."""
    if console is not None:
        rows: list[Row] = [("scale", console.scale, "1")]
        for robot, length_mm in console.instrument_mm.items():
            rows.append((f"instrument {robot}", length_mm, "mm"))
        yield from console.parameters("console", rows)
        law = console.teleoperation
        if law is not None:
            gains = (("kp", law.kp_per_s, "1/s"), ("ki", law.ki_per_s2, "1/s²"), ("kd", law.kd, "1"))
            yield from law.parameters("teleoperation", gains)
    if haptics is not None:
        forces = (
            ("stiffness", haptics.stiffness_n_m, "N/m"),
            ("damping", haptics.damping_ns_m, "N s/m"),
            ("largest force", haptics.largest_n, "N"),
            ("device damping", haptics.device_damping_ns_m, "N s/m"),
        )
        yield from haptics.parameters("haptics", forces)
