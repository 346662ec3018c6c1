"""A session at a surgeon's console as a result: its measures, findings, tables and files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from twin.core.extras import EXTRAS
from twin.core.findings import Finding, by_severity, disagreement, info, warning
from twin.core.json_types import JsonObject
from twin.core.quantity import Quantity, mm
from twin.core.result import Part, Result, TextTable
from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.mechanism import Mechanism
from twin.model.movable import together
from twin.model.scene import Scene
from twin.model.task import ConsoleTask
from twin.simulation import console_scene
from twin.simulation.console_scene import PEDALS
from twin.simulation.session import measures, movement
from twin.simulation.session.forces import ForceMeasures
from twin.simulation.session.measures import ArmMeasures, ConsoleMeasures
from twin.simulation.session.session_file import NAME as FILE
from twin.simulation.session.session_run import Difference, Ran
from twin.simulation.session.task_play import ArmPath, TaskOutcome
from twin.simulation.session.training import Training
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

_STRIDE = 4
"""Number of samples between two keys of an exported motion: 4 samples of 5 ms (`run.SAMPLE`) give 50 keys per s."""

_PEDAL_SIGNALS = ("clutch", "camera", "scale")
"""Signals of the device of the pedals in the written files: its pedals, and the motion scale."""


@dataclass(frozen=True)
class ConsoleSession(Result):
    """Measures of a session at a console.

    Attributes:
        scene: the scene with the console and its robots.
        source: the replayed file; "" for a new simulation.
        seed: random seed of a simulated surgeon; None: a person.
        task: the task; None: no task.
        ran: what was simulated: the kept signals, ticks and forces, and the difference of a replay from its recording.
        arms: {name of a place: arm} of all robots that the console moves.
        lost: sentence that says what is missing at the end of a truncated file; "" if the file is complete.
        recorded: content of the session file of a simulated surgeon; None for a replayed file.
        outcome: measures of the task; None: no task.
        training: measures of each machine: deviation of the machine from its model, cues (forces on the hands), stops.
    """

    scene: Scene
    source: str
    seed: int | None
    task: ConsoleTask | None
    ran: Ran
    arms: Mapping[str, ArmPath]
    lost: str = ""
    recorded: bytes | None = None
    outcome: TaskOutcome | None = None
    training: Sequence[Training] = ()

    kind = "session"

    @property
    def word(self) -> str:
        """The verdict as text."""
        if self.verdict == "agree":
            if self.source:
                return "The replay gives the same bytes"
            return self._success
        codes = set()
        for finding in self.findings:
            if finding.severity == "disagreement":
                codes.add(finding.code)
        # a missed task says most about a session; of the rest, the first that applies
        if "task.missed" in codes and self.outcome is not None:
            return self.outcome.failure
        if "task.errors" in codes:
            return "More errors than allowed"
        if "session.differs" in codes:
            return "The replay gives different bytes"
        return super().word

    @property
    def _success(self) -> str:
        """What was done in a session without disagreements, in words."""
        if self.training:
            return "The machine followed its model"
        if self.outcome is not None:
            return self.outcome.success
        return "Nothing disagrees"  # a session without a task

    @property
    def t(self) -> Array:
        """Times (k,) in s of the samples."""
        return self.ran.kept.t

    @cached_property
    def hands(self) -> Sequence[ArmMeasures]:
        """Measures of the motion of every arm that a hand moves."""
        return measures.of_arms(self.ran.kept, console_scene.console_of(self.scene), self._tips)

    @cached_property
    def console(self) -> ConsoleMeasures:
        """Measures of pedals and camera."""
        return measures.of_console(self.ran.kept, console_scene.console_of(self.scene), self.camera, self.ran.duration)

    @property
    def forces(self) -> ForceMeasures | None:
        """Measures of the forces on the hands; None for a session without forces."""
        return self.ran.forces

    @property
    def camera(self) -> str:
        """Name of the robot that holds the camera."""
        camera = console_scene.console_of(self.scene).camera
        return self.scene.cameras[camera].robot

    @property
    def _hands(self) -> Sequence[str]:
        """Names of the hands that move robots."""
        return console_scene.console_of(self.scene).hands

    @property
    def _tips(self) -> dict[str, Array]:
        """{name of a place: tip positions (k, 3) in m in the world frame}."""
        return {name: arm.tip for name, arm in self.arms.items()}

    @property
    def findings(self) -> Sequence[Finding]:
        """Findings on the replay, a truncated file, an idle session, the task, the machines, and missing libraries."""
        findings: list[Finding] = []
        difference = self.ran.difference
        if difference is not None:
            findings.append(_replay_finding(difference))
        if self.lost:
            findings.append(warning("session.interrupted", self.source, self.lost))
        if self.console.time == 0:  # all measures of hands are then zero, which looks like a fault of twin
            text = "no arm followed a hand: the condition to start following (docs/console-reference.md) was never met"
            findings.append(warning("session.idle", "", text))
        if self.outcome is not None:
            findings += self.outcome.findings()
        for machine in self.training:
            findings += machine.findings()
        if find_spec("mcap") is None or find_spec("mcap_ros2") is None:
            text = f"session.mcap or session-ros2.mcap is not written: pip install 'twin-robotics[{EXTRAS['mcap']}]'"
            findings.append(info("session.no_mcap", "", text))
        return findings

    def content(self) -> JsonObject:
        """Return the measures; the keys of quantities end with the unit."""
        surgeon = "simulated"
        if self.seed is None:
            surgeon = "person"
        replay = None
        if self.source:
            replay = "same" if self.ran.difference is None else "differs"
        task = None
        if self.task is not None:
            task = self.task.name
        condition = None
        if self.ran.condition is not None:
            condition = self.ran.condition.model_dump()
        forces_on_hands = None
        if self.forces is not None:
            forces_on_hands = {
                "on": self.forces.on,
                "felt_s": dict(self.forces.felt),
                "largest_n": dict(self.forces.largest),
            }
        console = self.console
        content: JsonObject = {
            "scene": self.scene.name,
            "surgeon": surgeon,
            "seed": self.seed,
            "replay": replay,
            "ticks": self.ran.ticks,
            "duration_s": console.duration,
            "time_s": console.time,
            "hands": list(map(_hand_content, self.hands)),
            "clutches": console.clutches,
            "clutched_s": console.clutched,
            "camera_moves": console.camera_moves,
            "camera_s": console.camera_time,
            "silent_s": console.silent,
            "taps": console.taps,
            "scale": list(console.scale),
            "task": task,
            # the outcome of a task replaces the key of its kind: each kind of task has one
            "targets": [],
            "alignment": None,
            "condition": condition,
            "forces": forces_on_hands,
            "guided": None,
            "machines": [machine.content() for machine in self.training],
            "board": None,
        }
        if self.outcome is not None:
            content |= self.outcome.content()
        return content

    def text(self) -> Iterator[Part]:
        """Yield the measures of hands and console, the targets, the result of the replay, and the findings."""
        surgeon = f"a simulated surgeon, seed {self.seed} (its habits are ASSUMED)"
        if self.seed is None:
            surgeon = "a person"
        yield f"{self.scene.name} · session of {surgeon}\n"
        header = ("hand", "arm", "path", "movements", "moving", "idle", "economy", "SPARC", "grasps")
        yield TextTable(header, list(map(_hand_row, self.hands)))
        yield ""
        yield TextTable((), self._console_rows())
        yield from self._task_text()
        for machine in self.training:
            yield f"\n  {machine.robot}: machine compared with its model"
            header = ("phase", "duration", "max distance to the model", "max distance to the rehearsed path", "reason")
            yield TextTable(header, list(machine.rows()))
        if self.source and self.ran.difference is None:
            yield f"\n  replay: the same bytes in all {self.ran.ticks} ticks"
        yield ""
        yield from by_severity(self.findings)

    def _console_rows(self) -> list[tuple[str, str]]:
        """Return the measures of pedals, camera and forces, and the run of a study, as rows of text."""
        console = self.console
        smallest, largest = console.scale
        scale = f"{smallest:g}"
        if smallest != largest:
            scale = f"{smallest:g} to {largest:g}"
        rows = [
            ("time since an arm first followed a hand", f"{console.time:.1f} s of {console.duration:.1f} s"),
            ("clutch presses", f"{console.clutches}, for {console.clutched:.1f} s; quick taps: {console.taps}"),
            ("camera moves", f"{console.camera_moves}, for {console.camera_time:.1f} s"),
            ("device silent", f"{console.silent:.1f} s"),
            ("motion scale", scale),
        ]
        felt = self.forces
        if felt is not None:
            of_hands = []
            for hand in self._hands:
                of_hands.append(f"{hand} {felt.felt[hand]:.1f} s, at most {felt.largest[hand]:.2f} N")
            text = "; ".join(of_hands)
            percent = 100 * felt.on
            rows.append(("forces on the hands", f"on {percent:.0f} % of the time; {text}"))
        condition = self.ran.condition
        if condition is not None and condition.participant is not None:
            rows.append(("study", f"participant {condition.participant}, run {condition.run}"))
        return rows

    def _task_text(self) -> Iterator[Part]:
        """Yield the title of the task and the outcome of each of its parts."""
        if self.task is not None:
            yield f"\n  {self.task.name}: {self.task.title}"
        if self.outcome is not None:
            yield from self.outcome.text()

    def write(self, folder: Path) -> None:
        """Write the files of the session: session.csv, motions, and for MCAP session.mcap and session-ros2.mcap.

        The motion of each robot is written to a folder with the robot's name, as GLB and tracks. The motion of movable
        objects is written to objects/, as GLB, tracks and USD stage. For a simulated surgeon, the session file is
        written as well.
        """
        from twin.exchange.formats.glb.write import write_glb
        from twin.exchange.formats.tracks.write import write_tracks

        if self.recorded is not None:
            (folder / FILE).write_bytes(self.recorded)
        columns = self._columns()
        body = np.column_stack(list(columns.values()))[::_STRIDE]
        np.savetxt(folder / "session.csv", body, "%.9g", ",", header=",".join(columns), comments="")
        for name, arm in self.arms.items():
            clip = self._clip(name, arm.mechanism, arm.links)
            (folder / name).mkdir()
            write_glb(arm.mechanism, [clip], folder / name / f"{arm.mechanism.name}.glb")
            write_tracks(arm.mechanism, clip, folder / name / "tracks")
        if self._moved:
            self._write_objects(folder / "objects")
        if find_spec("mcap") is not None:
            self._write_mcap(folder / "session.mcap")

    def _columns(self) -> dict[str, Array]:
        """Return the columns of the CSV file: {name with unit: values (k,)}."""
        recording = self.ran.kept
        columns = {"t_s": self.t, "mode": recording[CONSOLE_MODE.name][:, 0]}
        for pedal in _PEDAL_SIGNALS:
            columns[pedal] = recording[f"{PEDALS}.{pedal}"][:, 0]
        for hand in self._hands:
            _add_axes(columns, f"{hand}_", _positions(recording[HAND_POSE.of(hand)]), "_m")
            columns[f"{hand}_grip_rad"] = recording[HAND_GRIP.of(hand)][:, 0]
            if self.forces is not None:
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
        for name in self._moved:
            _add_axes(columns, f"{name}_", _positions(recording[OBJECT_POSE.of(name)]), "_m")
            columns[f"{name}_holder"] = recording[OBJECT_HOLDER.of(name)][:, 0]
        return columns

    @property
    def _moved(self) -> list[str]:
        """Names of the movable objects in this session: those of the scene that the World of the task simulates."""
        signals = self.ran.kept.sizes
        names = []
        for movable in self.scene.objects:
            if OBJECT_POSE.of(movable.name) in signals:
                names.append(movable.name)
        return names

    def _write_objects(self, folder: Path) -> None:
        from twin.exchange.formats.glb.write import write_glb
        from twin.exchange.formats.tracks.write import write_tracks
        from twin.exchange.formats.usd.write import write_usd

        moved_names = self._moved
        objects = [movable for movable in self.scene.objects if movable.name in moved_names]
        mechanism = together(objects)
        poses: dict[str, Array] = {}
        for name in moved_names:
            poses[name] = self.ran.kept[OBJECT_POSE.of(name)].reshape(-1, 4, 4)
        # recorded poses are in the world frame, with which the base of the objects coincides
        poses[mechanism.base] = np.broadcast_to(np.eye(4), (len(self.t), 4, 4))
        clip = self._clip("objects", mechanism, poses)
        folder.mkdir()
        write_glb(mechanism, [clip], folder / "objects.glb")
        write_tracks(mechanism, clip, folder / "tracks")
        write_usd(mechanism, [clip], folder / "usd")

    def _clip(self, name: str, mechanism: Mechanism, poses: Mapping[str, Array]) -> Clip:
        from twin.exchange.write.clip import Clip, extreme_points, key_rows, measure_between, rounded
        from twin.exchange.write.stage_clip import coordinates

        keys = key_rows(len(self.t), _STRIDE)
        # the last digits depend on the processor, and the exported files must not
        links = rounded(poses)
        at_keys = {link: Ts[keys] for link, Ts in links.items()}
        reaches = extreme_points(mechanism)
        return Clip(
            "session",
            f"{name} in a session of {self.scene.name}",
            self.t[keys],
            at_keys,
            coordinates(mechanism, at_keys),
            tuple(joint.name for joint in mechanism.active),
            (("session", 0.0, float(self.t[-1])),),
            1 / (_STRIDE * self.ran.kept.dt),
            measure_between(mechanism, self.t, links, keys, reaches),
            frame=mechanism.tool,
            phase_rcm=(None,),
            trocars=mechanism.trocar_places,
        )

    def _write_mcap(self, path: Path) -> None:
        from twin.exchange.formats.mcap.write import write_mcap
        from twin.exchange.formats.mcap.write_ros2 import HandTrack, write_ros2_mcap

        recording = self.ran.kept
        links: dict[str, Array] = {}
        joints: dict[str, Array] = {}
        for name in self._moved:
            links[name] = recording[OBJECT_POSE.of(name)].reshape(-1, 4, 4)[::_STRIDE]
        for name, arm in self.arms.items():
            for link, Ts in arm.links.items():
                links[f"{name}/{link}"] = arm.place.T_world_base @ Ts[::_STRIDE]
            for j, joint in enumerate(arm.mechanism.active):
                joints[f"{name}/{joint.name}"] = arm.q[::_STRIDE, j]
        console = {"mode": recording[CONSOLE_MODE.name][::_STRIDE, 0]}
        for pedal in _PEDAL_SIGNALS:
            console[pedal] = recording[f"{PEDALS}.{pedal}"][::_STRIDE, 0]
        for hand in self._hands:
            console[f"{hand}_grip"] = recording[HAND_GRIP.of(hand)][::_STRIDE, 0]
        t = self.t[::_STRIDE]
        write_mcap(path, t, links, joints, console)
        if find_spec("mcap_ros2") is None:  # a finding says so
            return
        joints_of_robots: dict[str, dict[str, Array]] = {}
        for name, values in joints.items():
            robot, _, joint = name.partition("/")
            joints_of_robots.setdefault(robot, {})[joint] = values
        hands = {}
        for hand in self._hands:
            poses = recording[HAND_POSE.of(hand)].reshape(-1, 4, 4)[::_STRIDE]
            # MTML and MTMR, as the da Vinci Research Kit names its handles in ROS
            hands[f"MTM{hand[0].upper()}"] = HandTrack(poses, console[f"{hand}_grip"])
        pedals = {"clutch": console["clutch"], "camera": console["camera"]}
        ros_path = path.with_name(f"{path.stem}-ros2{path.suffix}")
        write_ros2_mcap(ros_path, t, links, joints_of_robots, hands, pedals, console["scale"])


def _replay_finding(difference: Difference) -> Finding:
    """Return the finding on a replay that differs from its recording."""
    if difference.signal:
        extent = f"the largest difference is {difference.size:.3g} in {difference.signal}"
    else:
        extent = f"at {difference.t1:g} s, all signals are equal again"
    return disagreement(
        "session.differs",
        difference.signal,
        "the replay gives other bytes than the recording, first between "
        f"{difference.t0:g} and {difference.t1:g} s; {extent}",
        suggestion="replay with the twin version and the processor type of the recording",
        when=f"{difference.t0:g} .. {difference.t1:g} s",
    )


def _hand_content(hand: ArmMeasures) -> JsonObject:
    return {
        "hand": hand.hand,
        "robot": hand.robot,
        "path_mm": hand.path / MM,
        "movements": hand.movements,
        "moving_s": hand.moving,
        "idle_s": hand.idle,
        "economy": hand.economy,
        "smoothness_sparc": hand.smoothness,
        "grasps": hand.grasps,
    }


def _hand_row(hand: ArmMeasures) -> tuple[str, ...]:
    return (
        hand.hand,
        hand.robot,
        str(mm(hand.path)),
        str(hand.movements),
        f"{hand.moving:.1f} s",
        f"{hand.idle:.1f} s",
        _number(hand.economy),
        _number(hand.smoothness),
        str(hand.grasps),
    )


def _add_axes(columns: dict[str, Array], prefix: str, vectors: Array, suffix: str) -> None:
    """Add a column for each axis of vectors (k, 3), named prefix, axis, suffix, as in psm1_tip_x_m."""
    for i, axis in enumerate("xyz"):
        columns[f"{prefix}{axis}{suffix}"] = vectors[:, i]


def _positions(poses: Array) -> Array:
    """Return the positions (k, 3) of poses (k, 16)."""
    return poses.reshape(-1, 4, 4)[:, :3, 3]


def _number(value: float) -> str:
    if not np.isfinite(value):  # an arm that never moved has no economy and no smoothness
        return "-"
    return str(Quantity(value))
