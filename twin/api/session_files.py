"""The motions of a session at a console as files for other programs: CSV, GLB, tracks, USD and MCAP."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from twin.core.spatial import Array
from twin.model.mechanism import Mechanism
from twin.model.movable import objects_as_mechanism
from twin.model.scene import Scene
from twin.simulation import console_scene
from twin.simulation.console_scene import PEDALS
from twin.simulation.session import movement
from twin.simulation.session.task_play import ArmPath
from twin.simulation.world.recording import Recording
from twin.simulation.world.signal_kinds import (
    CONSOLE_MODE,
    HAND_FORCE,
    HAND_GRIP,
    HAND_POSE,
    OBJECT_HOLDER,
    OBJECT_POSE,
    ROBOT_DEVIATION,
    ROBOT_FOLLOWS,
)

if TYPE_CHECKING:
    from twin.exchange.write.clip import Clip

_SAMPLES_PER_ROW = 4
"""Number of samples from one written row or key to the next: 4 samples of 5 ms (`session_run.SAMPLE`), 50 per s."""

_PEDAL_SIGNALS = ("clutch", "camera", "scale")
"""Signals of the device of the pedals in the written files: its pedals, and the motion scale."""


@dataclass(frozen=True)
class SessionFiles:
    """What the files of a session are written from.

    Attributes:
        scene: the scene with the console and its robots.
        recording: the kept signals, k samples.
        arms: {name of a place: arm} of all robots that the console moves.
        has_forces: whether the recording has forces on the hands.
    """

    scene: Scene
    recording: Recording
    arms: Mapping[str, ArmPath]
    has_forces: bool

    def write(self, folder: Path) -> None:
        """Write session.csv, the motions, and, where their packages are installed, session.mcap and session-ros2.mcap.

        The motion of each robot is written to a folder with the robot's name, as GLB and tracks. The motion of movable
        objects is written to objects/, as GLB, tracks and USD stage.
        """
        self._write_csv(folder / "session.csv")
        for name, arm in self.arms.items():
            self._write_arm(name, arm, folder / name)
        if self._moved_objects:
            self._write_objects(folder / "objects")
        if find_spec("mcap") is not None:
            self._write_mcap(folder / "session.mcap")

    # ------------------------------------------------------------------------------------------------ samples as CSV

    def _write_csv(self, path: Path) -> None:
        columns = self._columns()
        rows = np.column_stack(list(columns.values()))[::_SAMPLES_PER_ROW]
        np.savetxt(path, rows, "%.9g", ",", header=",".join(columns), comments="")

    def _columns(self) -> dict[str, Array]:
        """Return the columns of the CSV file: {name with unit: values (k,)}."""
        recording = self.recording
        columns = {"t_s": recording.t, "mode": recording[CONSOLE_MODE.name][:, 0]}
        for pedal in _PEDAL_SIGNALS:
            columns[pedal] = recording[f"{PEDALS}.{pedal}"][:, 0]
        for hand in self._hand_names:
            _add_axes(columns, f"{hand}_", _positions(recording[HAND_POSE.of(hand)]), "_m")
            columns[f"{hand}_grip_rad"] = recording[HAND_GRIP.of(hand)][:, 0]
            if self.has_forces:
                _add_axes(columns, f"{hand}_force_", recording[HAND_FORCE.of(hand)], "_n")
        for name, arm in self.arms.items():
            if ROBOT_DEVIATION.of(name) in recording.sizes:
                columns[f"{name}_deviation_m"] = recording[ROBOT_DEVIATION.of(name)][:, 0]
            if name in console_scene.hands_of(self.scene):
                columns[f"{name}_follows"] = recording[ROBOT_FOLLOWS.of(name)][:, 0]
                _add_axes(columns, f"{name}_tip_", arm.tip, "_m")
                columns[f"{name}_speed_m_per_s"] = movement.speed(arm.tip, recording.dt)
            for j, joint in enumerate(arm.mechanism.active):
                unit = "rad" if joint.is_angle else "m"
                columns[f"{name}_{joint.name}_{unit}"] = arm.q[:, j]
        for name in self._moved_objects:
            _add_axes(columns, f"{name}_", _positions(recording[OBJECT_POSE.of(name)]), "_m")
            columns[f"{name}_holder"] = recording[OBJECT_HOLDER.of(name)][:, 0]
        return columns

    @property
    def _hand_names(self) -> tuple[str, ...]:
        """Names of the hands that move robots."""
        return console_scene.console_of(self.scene).hands

    @property
    def _moved_objects(self) -> list[str]:
        """Names of the movable objects in this session: those of the scene that the World of the task simulates."""
        names = []
        for movable in self.scene.objects:
            if OBJECT_POSE.of(movable.name) in self.recording.sizes:
                names.append(movable.name)
        return names

    # ------------------------------------------------------------------------------------- motions as GLB, tracks, USD

    def _write_arm(self, name: str, arm: ArmPath, folder: Path) -> None:
        from twin.exchange.formats.glb.write import write_glb
        from twin.exchange.formats.tracks.write import write_tracks

        clip = self._clip(name, arm.mechanism, arm.links)
        folder.mkdir()
        write_glb(arm.mechanism, [clip], folder / f"{arm.mechanism.name}.glb")
        write_tracks(arm.mechanism, clip, folder / "tracks")

    def _write_objects(self, folder: Path) -> None:
        from twin.exchange.formats.glb.write import write_glb
        from twin.exchange.formats.tracks.write import write_tracks
        from twin.exchange.formats.usd.write import write_usd

        moved_names = self._moved_objects
        objects = [movable for movable in self.scene.objects if movable.name in moved_names]
        mechanism = objects_as_mechanism(objects)
        poses: dict[str, Array] = {}
        for name in moved_names:
            poses[name] = self.recording[OBJECT_POSE.of(name)].reshape(-1, 4, 4)
        # recorded poses are in the world frame, with which the base of the objects coincides
        poses[mechanism.base] = np.broadcast_to(np.eye(4), (len(self.recording.t), 4, 4))
        clip = self._clip("objects", mechanism, poses)
        folder.mkdir()
        write_glb(mechanism, [clip], folder / "objects.glb")
        write_tracks(mechanism, clip, folder / "tracks")
        write_usd(mechanism, [clip], folder / "usd")

    def _clip(self, name: str, mechanism: Mechanism, poses: Mapping[str, Array]) -> Clip:
        """Return the motion of a mechanism as a clip with a key at every `_SAMPLES_PER_ROW`-th sample.

        Args:
            name: name of the robot's place, or "objects".
            mechanism: the mechanism that moves.
            poses: {link: T_base_link (k, 4, 4)}.
        """
        from twin.exchange.write.clip import Clip, rounded
        from twin.exchange.write.player_interpolation import extreme_points, interpolation_errors, key_rows
        from twin.exchange.write.stage_clip import coordinates

        t = self.recording.t
        keys = key_rows(len(t), _SAMPLES_PER_ROW)
        # the last digits depend on the processor, and the exported files must not
        links = rounded(poses)
        at_keys = {link: Ts[keys] for link, Ts in links.items()}
        reaches = extreme_points(mechanism)
        return Clip(
            "session",
            f"{name} in a session of {self.scene.name}",
            t[keys],
            at_keys,
            coordinates(mechanism, at_keys),
            tuple(joint.name for joint in mechanism.active),
            (("session", 0.0, float(t[-1])),),
            1 / (_SAMPLES_PER_ROW * self.recording.dt),
            interpolation_errors(mechanism, t, links, keys, reaches),
            frame=mechanism.tool,
            phase_rcm=(None,),
            trocars=mechanism.trocar_places,
        )

    # ------------------------------------------------------------------------------------------- everything as MCAP

    def _write_mcap(self, path: Path) -> None:
        """Write an MCAP file with messages in JSON, and beside it one with messages of ROS 2."""
        from twin.exchange.formats.mcap.write import write_mcap

        t = self.recording.t[::_SAMPLES_PER_ROW]
        link_poses = self._world_poses()
        joint_values: dict[str, Array] = {}
        for name, arm in self.arms.items():
            for j, joint in enumerate(arm.mechanism.active):
                joint_values[f"{name}/{joint.name}"] = arm.q[::_SAMPLES_PER_ROW, j]
        console_values = self._console_values()
        write_mcap(path, t, link_poses, joint_values, console_values)
        if find_spec("mcap_ros2") is not None:  # without it, a finding of the session says so
            ros_path = path.with_name(f"{path.stem}-ros2{path.suffix}")
            self._write_ros2_mcap(ros_path, t, link_poses, console_values)

    def _write_ros2_mcap(
        self, path: Path, t: Array, link_poses: Mapping[str, Array], console_values: Mapping[str, Array]
    ) -> None:
        from twin.exchange.formats.mcap.write_ros2 import HandTrack, write_ros2_mcap

        joints_of_robots: dict[str, dict[str, Array]] = {}
        for name, arm in self.arms.items():
            joints_of_robots[name] = {}
            for j, joint in enumerate(arm.mechanism.active):
                joints_of_robots[name][joint.name] = arm.q[::_SAMPLES_PER_ROW, j]
        hand_tracks = {}
        for hand in self._hand_names:
            poses = self.recording[HAND_POSE.of(hand)].reshape(-1, 4, 4)[::_SAMPLES_PER_ROW]
            # MTML and MTMR, as the da Vinci Research Kit names its handles in ROS
            hand_tracks[f"MTM{hand[0].upper()}"] = HandTrack(poses, console_values[f"{hand}_grip"])
        pedals = {"clutch": console_values["clutch"], "camera": console_values["camera"]}
        write_ros2_mcap(path, t, link_poses, joints_of_robots, hand_tracks, pedals, console_values["scale"])

    def _world_poses(self) -> dict[str, Array]:
        """Return {object, or place/link: T_world_body} of every `_SAMPLES_PER_ROW`-th sample."""
        poses: dict[str, Array] = {}
        for name in self._moved_objects:
            poses[name] = self.recording[OBJECT_POSE.of(name)].reshape(-1, 4, 4)[::_SAMPLES_PER_ROW]
        for name, arm in self.arms.items():
            for link, Ts in arm.links.items():
                poses[f"{name}/{link}"] = arm.place.T_world_base @ Ts[::_SAMPLES_PER_ROW]
        return poses

    def _console_values(self) -> dict[str, Array]:
        """Return the mode, the pedals, the motion scale and the grips (rad) of every `_SAMPLES_PER_ROW`-th sample."""
        recording = self.recording
        values = {"mode": recording[CONSOLE_MODE.name][::_SAMPLES_PER_ROW, 0]}
        for pedal in _PEDAL_SIGNALS:
            values[pedal] = recording[f"{PEDALS}.{pedal}"][::_SAMPLES_PER_ROW, 0]
        for hand in self._hand_names:
            values[f"{hand}_grip"] = recording[HAND_GRIP.of(hand)][::_SAMPLES_PER_ROW, 0]
        return values


def _add_axes(columns: dict[str, Array], prefix: str, vectors: Array, suffix: str) -> None:
    """Add a column for each axis of vectors (k, 3), named prefix, axis, suffix, as in psm1_tip_x_m."""
    for i, axis in enumerate("xyz"):
        columns[f"{prefix}{axis}{suffix}"] = vectors[:, i]


def _positions(poses: Array) -> Array:
    """Return the positions (k, 3) of poses (k, 16)."""
    return poses.reshape(-1, 4, 4)[:, :3, 3]
