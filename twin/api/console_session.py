"""A session at a surgeon's console as a result: its measures, findings, tables and files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
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
from twin.core.spoken import spoken
from twin.core.units import DEG, MM
from twin.model.mechanism import Mechanism
from twin.model.movable import together
from twin.model.scene import Place, Scene
from twin.model.task import ConsoleTask
from twin.simulation import console_scene
from twin.simulation.console_scene import HANDS, PEDALS
from twin.simulation.contact_scene import Peg
from twin.simulation.session import camera_task, forces, measures, movement, rings
from twin.simulation.session.camera_task import AlignMeasures
from twin.simulation.session.file import NAME as FILE
from twin.simulation.session.forces import ForceMeasures
from twin.simulation.session.guiding import GuideMeasures
from twin.simulation.session.measures import ArmMeasures, ConsoleMeasures
from twin.simulation.session.rings import BoardMeasures
from twin.simulation.session.run import Difference, Ran
from twin.simulation.session.touch import Touched, touched
from twin.simulation.session.training import Training

if TYPE_CHECKING:
    from twin.exchange.write.clip import Clip

_STRIDE = 4
"""Number of samples between two keys of an exported motion: 4 samples of 5 ms (`run.SAMPLE`) give 50 keys per s."""

_PEDAL_SIGNALS = ("clutch", "camera", "scale")
"""Signals of the pedals in the written files."""


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


@dataclass(frozen=True)
class ConsoleSession(Result):
    """Measures of a session at a console.

    Attributes:
        source: the replayed file; "" for a new simulation.
        seed: random seed of a simulated surgeon; None: a person.
        task: the task; None: no task.
        arms: {name of a place: arm} of all robots that the console moves.
        lost: sentence that says what is missing at the end of a truncated file; "" if the file is complete.
        recorded: content of the session file of a simulated surgeon; None for a replayed file.
        pegs: {name: peg} of a task with rings; empty for another task.
        aligned: measures of a task with an alignment; None for another task.
        guided: measures of a task with a ring to guide; None for another task.
        wire: (k, 3) centre line of the wire of a task with a ring to guide, in m in the World; empty for another task.
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
    pegs: Mapping[str, Peg] = field(default_factory=dict)
    aligned: AlignMeasures | None = None
    guided: GuideMeasures | None = None
    wire: Array = field(default_factory=lambda: np.zeros((0, 3)))
    training: Sequence[Training] = ()

    kind = "session"

    @property
    def word(self) -> str:
        """The verdict as text."""
        if self.verdict == "agree":
            if self.source:
                return "The replay gives the same bytes"
            return self._success
        codes = {finding.code for finding in self.findings if finding.severity == "disagreement"}
        if "task.missed" in codes:
            return self._failure
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
        if self.guided is not None:
            return "The ring was guided along the wire"
        if self.aligned is not None:
            return "The endoscope is aligned"
        if self.board is not None:
            return "All rings are on their pegs"
        return "All targets were touched"

    @property
    def _failure(self) -> str:
        """What was missed in a session, in words."""
        if self.aligned is not None:
            return "The endoscope is not aligned"
        if self.guided is not None:
            return "Not all steps of the task are done"
        if self.board is not None:
            return "Not all rings are on their pegs"
        return "Not all targets were touched"

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

    @cached_property
    def touched(self) -> Sequence[Touched]:
        """For every target of the task, when it was touched and how near the tips came; empty without a task."""
        if self.task is None:
            return ()
        table = console_scene.console_of(self.scene)
        tips: dict[str, Array] = {}
        for hand in HANDS:
            first_robot = getattr(table, hand)[0]
            tips[hand] = self.arms[first_robot].tip
        return touched(self.task, self.t, tips)

    @cached_property
    def board(self) -> BoardMeasures | None:
        """Measures of a task with rings; None for another task."""
        if self.task is None or not self.task.transfers:
            return None
        robots = list(console_scene.hands_of(self.scene))
        return rings.measure(self.ran.kept, self.task, self.scene.objects, self.pegs, robots)

    @cached_property
    def forces(self) -> ForceMeasures | None:
        """Measures of the forces on the hands; None for a session without forces."""
        return forces.measure(self.ran.kept, HANDS)

    @property
    def camera(self) -> str:
        """Name of the robot that holds the camera."""
        camera = console_scene.console_of(self.scene).camera
        return self.scene.cameras[camera].robot

    @property
    def _tips(self) -> dict[str, Array]:
        return {name: arm.tip for name, arm in self.arms.items()}

    @property
    def findings(self) -> Sequence[Finding]:
        """Findings: the replay differs from the recording, the file is truncated, or a target was not touched."""
        findings: list[Finding] = []
        difference = self.ran.difference
        if difference is not None:
            findings.append(_differs(difference))
        if self.lost:
            findings.append(warning("session.interrupted", self.source, self.lost))
        if self.console.time == 0:
            text = "no arm followed a hand: the condition to start following (docs/console.md) was never met"
            findings.append(warning("session.idle", "", text))
        findings += self._untouched()
        if self.board is not None:
            for ring in self.board.rings:
                if ring.t is None:
                    text = f"at the end, the ring is not around its peg, {spoken(ring.peg)}"
                    findings.append(disagreement("task.missed", ring.ring, text))
        findings += self._unguided()
        findings += self._unaligned()
        for machine in self.training:
            findings += machine.findings()
        if find_spec("mcap") is None:
            text = f"session.mcap is not written: pip install 'twin-robotics[{EXTRAS['mcap']}]'"
            findings.append(info("session.no_mcap", "", text))
        return findings

    def _untouched(self) -> Iterator[Finding]:
        """Yield a finding on every target of the task that no tip touched."""
        if self.task is None:
            return
        for target in self.touched:
            if target.t is not None:
                continue
            yield disagreement(
                "task.missed",
                target.name,
                "the target was not touched; minimum distance between the target and the tips",
                mm(target.nearest),
                mm(self.task.tolerance),
                word="required",
            )

    def _unguided(self) -> Iterator[Finding]:
        """Yield findings on steps that are not done, and on errors that exceed their limits."""
        if self.guided is None:
            return
        for step in self.guided.missed:
            text = f"the step is not done; the ring passed along {self.guided.passed:.0%} of the wire"
            yield disagreement("task.missed", step, text)
        for what, value, most, unit in self.guided.exceeded:
            text = f"more {what} than allowed"
            yield disagreement("task.errors", what, text, Quantity(value, unit), most, word="allowed")

    def _unaligned(self) -> Iterator[Finding]:
        """Yield findings on the alignment.

        The camera is not aligned, AlignErr cannot be measured in the picture, or AlignErr in the picture differs from
        AlignErr by projection.
        """
        aligned = self.aligned
        if aligned is None or self.task is None or self.task.alignment is None:
            return
        required = self.task.alignment
        if np.isnan(aligned.angle):
            yield disagreement("task.missed", self.task.name, "at the end, the rectangle is behind the lens")
        elif not aligned.done(required):
            yield disagreement(
                "task.missed",
                self.task.name,
                f"the upper side of the rectangle is not aligned: its ends are up to {aligned.off:.0%} of the line's "
                f"length from the line's ends (allowed: {required.off:.0%}); AlignErr",
                Quantity(abs(aligned.angle) / DEG, "deg"),
                required.tolerance / DEG,
                word="allowed",
            )
        if aligned.seen is None:
            text = f"AlignErr cannot be measured in the picture: {aligned.refused}"
            yield warning("task.unseen", self.task.name, text)
            return
        # NaN, if the rectangle is behind the lens, is reported above and is no difference
        difference = abs(aligned.seen - aligned.angle)
        if difference > camera_task.AGREE:
            seen_deg = aligned.seen / DEG
            projected_deg = aligned.angle / DEG
            yield disagreement(
                "task.angles",
                self.task.name,
                f"AlignErr is {seen_deg:.3f} deg in the picture and {projected_deg:.3f} deg by projection; difference",
                Quantity(difference / DEG, "deg"),
                camera_task.AGREE / DEG,
            )

    def content(self) -> JsonObject:
        """Return the measures; the keys of quantities end with the unit."""
        surgeon = "simulated"
        if self.seed is None:
            surgeon = "person"
        replay = None
        if self.source:
            replay = "same" if self.ran.difference is None else "differs"
        hands = [_hand_content(hand) for hand in self.hands]
        targets = []
        for target in self.touched:
            targets.append({"name": target.name, "t_s": target.t, "nearest_mm": target.nearest / MM})
        task = None
        if self.task is not None:
            task = self.task.name
        alignment = None
        if self.aligned is not None:
            alignment = _alignment_content(self.aligned)
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
        guided = None
        if self.guided is not None:
            guided = self.guided.content()
        board = None
        if self.board is not None:
            board = _board_content(self.board)
        console = self.console
        return {
            "scene": self.scene.name,
            "surgeon": surgeon,
            "seed": self.seed,
            "replay": replay,
            "ticks": self.ran.ticks,
            "duration_s": console.duration,
            "time_s": console.time,
            "hands": hands,
            "clutches": console.clutches,
            "clutched_s": console.clutched,
            "camera_moves": console.camera_moves,
            "camera_s": console.camera_time,
            "silent_s": console.silent,
            "taps": console.taps,
            "scale": list(console.scale),
            "task": task,
            "targets": targets,
            "alignment": alignment,
            "condition": condition,
            "forces": forces_on_hands,
            "guided": guided,
            "machines": [machine.content() for machine in self.training],
            "board": board,
        }

    def text(self) -> Iterator[Part]:
        """Yield the measures of hands and console, the targets, the result of the replay, and the findings."""
        surgeon = f"a simulated surgeon, seed {self.seed} (its habits are ASSUMED)"
        if self.seed is None:
            surgeon = "a person"
        yield f"{self.scene.name} · session of {surgeon}\n"
        header = ("hand", "arm", "path", "movements", "moving", "idle", "economy", "SPARC", "grasps")
        yield TextTable(header, [_hand_row(hand) for hand in self.hands])
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
            for hand in HANDS:
                of_hands.append(f"{hand} {felt.felt[hand]:.1f} s, at most {felt.largest[hand]:.2f} N")
            text = "; ".join(of_hands)
            percent = 100 * felt.on
            rows.append(("forces on the hands", f"on {percent:.0f} % of the time; {text}"))
        condition = self.ran.condition
        if condition is not None and condition.participant is not None:
            rows.append(("study", f"participant {condition.participant}, run {condition.run}"))
        return rows

    def _task_text(self) -> Iterator[Part]:
        """Yield the title of the task and the outcome of each of its targets, rings or steps."""
        if self.task is not None:
            yield f"\n  {self.task.name}: {self.task.title}"
        rows: list[tuple[str, ...]] = []
        if self.board is not None:
            for ring in self.board.rings:
                rows.append((spoken(ring.ring), spoken(ring.peg), _time(ring.t), str(ring.drops)))
            yield TextTable(("ring", "peg", "transferred at", "dropped"), rows)
            yield ""
            yield TextTable((), self.board.rows())
        elif self.guided is not None:
            for name, t in self.guided.steps.items():
                rows.append((name, _time(t)))
            yield TextTable(("step", "done at"), rows)
            yield ""
            yield TextTable((), self.guided.rows())
        elif self.aligned is not None:
            yield TextTable((), _aligned_rows(self.aligned))
        elif self.task is not None:
            for target in self.touched:
                rows.append((target.name, _time(target.t, "not touched"), str(mm(target.nearest))))
            yield TextTable(("target", "touched at", "smallest distance"), rows)

    def write(self, folder: Path) -> None:
        """Write the files of the session: session.csv, session.mcap (if mcap is installed), and motions.

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
        kept = self.ran.kept
        columns = {"t_s": self.t, "mode": kept["console.mode"][:, 0]}
        for pedal in _PEDAL_SIGNALS:
            columns[pedal] = kept[f"{PEDALS}.{pedal}"][:, 0]
        for hand in HANDS:
            _add_axes(columns, f"{hand}_", _positions(kept[f"{hand}.pose"]), "_m")
            columns[f"{hand}_grip_rad"] = kept[f"{hand}.grip"][:, 0]
            if self.forces is not None:
                _add_axes(columns, f"{hand}_force_", kept[f"{hand}.force"], "_n")
        for name, arm in self.arms.items():
            if f"{name}.deviation" in kept.sizes:
                columns[f"{name}_deviation_m"] = kept[f"{name}.deviation"][:, 0]
            if name != self.camera:
                columns[f"{name}_follows"] = kept[f"{name}.follows"][:, 0]
                _add_axes(columns, f"{name}_tip_", arm.tip, "_m")
                columns[f"{name}_speed_m_per_s"] = movement.speed(arm.tip, kept.dt)
            for j, joint in enumerate(arm.mechanism.active):
                unit = "rad" if joint.is_angle else "m"
                columns[f"{name}_{joint.name}_{unit}"] = arm.q[:, j]
        for name in self._moved:
            _add_axes(columns, f"{name}_", _positions(kept[f"{name}.pose"]), "_m")
            columns[f"{name}_holder"] = kept[f"{name}.holder"][:, 0]
        return columns

    @property
    def _moved(self) -> list[str]:
        """Names of the movable objects in this session."""
        signals = self.ran.kept.sizes
        return [movable.name for movable in self.scene.objects if f"{movable.name}.pose" in signals]

    def _write_objects(self, folder: Path) -> None:
        from twin.exchange.formats.glb.write import write_glb
        from twin.exchange.formats.tracks.write import write_tracks
        from twin.exchange.formats.usd.write import write_usd

        moved = self._moved
        mechanism = together([movable for movable in self.scene.objects if movable.name in moved])
        poses: dict[str, Array] = {}
        for name in moved:
            poses[name] = self.ran.kept[f"{name}.pose"].reshape(-1, 4, 4)
        poses[mechanism.base] = np.broadcast_to(np.eye(4), (len(self.t), 4, 4))
        clip = self._clip("objects", mechanism, poses)
        folder.mkdir()
        write_glb(mechanism, [clip], folder / "objects.glb")
        write_tracks(mechanism, clip, folder / "tracks")
        write_usd(mechanism, [clip], folder / "usd")

    def _clip(self, name: str, mechanism: Mechanism, poses: Mapping[str, Array]) -> Clip:
        from twin.exchange.write.clip import Clip, extremes, key_rows, measure_between, rounded
        from twin.exchange.write.sampled import coordinates

        keys = key_rows(len(self.t), _STRIDE)
        links = rounded(poses)
        at_keys = {link: Ts[keys] for link, Ts in links.items()}
        reaches = {body.name: extremes(mechanism, body) for body in mechanism.bodies}
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

        kept = self.ran.kept
        links: dict[str, Array] = {}
        joints: dict[str, Array] = {}
        for name in self._moved:
            links[name] = kept[f"{name}.pose"].reshape(-1, 4, 4)[::_STRIDE]
        for name, arm in self.arms.items():
            for link, Ts in arm.links.items():
                links[f"{name}/{link}"] = arm.place.T_world_base @ Ts[::_STRIDE]
            for j, joint in enumerate(arm.mechanism.active):
                joints[f"{name}/{joint.name}"] = arm.q[::_STRIDE, j]
        console = {"mode": kept["console.mode"][::_STRIDE, 0]}
        for pedal in _PEDAL_SIGNALS:
            console[pedal] = kept[f"{PEDALS}.{pedal}"][::_STRIDE, 0]
        for hand in HANDS:
            console[f"{hand}_grip"] = kept[f"{hand}.grip"][::_STRIDE, 0]
        write_mcap(path, self.t[::_STRIDE], links, joints, console)


def _differs(difference: Difference) -> Finding:
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


def _alignment_content(aligned: AlignMeasures) -> JsonObject:
    # JSON has no NaN, which the measures have if the rectangle is behind the lens
    angle = None
    if np.isfinite(aligned.angle):
        angle = aligned.angle / DEG
    angle_in_picture = None
    if aligned.seen is not None:
        angle_in_picture = aligned.seen / DEG
    off_line = None
    if np.isfinite(aligned.off):
        off_line = aligned.off
    return {
        "time_s": aligned.time,
        "align_err_deg": angle,
        "align_err_in_picture_deg": angle_in_picture,
        "not_in_picture": aligned.refused or None,
        "off_line": off_line,
        "lens_path_mm": aligned.path / MM,
        "hand_paths_mm": {hand: path / MM for hand, path in aligned.hands.items()},
    }


def _board_content(board: BoardMeasures) -> JsonObject:
    of_rings = []
    for ring in board.rings:
        of_rings.append({"ring": ring.ring, "peg": ring.peg, "t_s": ring.t, "drops": ring.drops})
    return {
        "time_s": board.time,
        "rings_transferred": board.transferred,
        "rings_dropped": board.dropped,
        "instrument_collisions": board.collisions,
        "errors": board.errors,
        "rings": of_rings,
    }


def _aligned_rows(aligned: AlignMeasures) -> list[tuple[str, str]]:
    projected = "-"
    if not np.isnan(aligned.angle):
        projected = f"{aligned.angle / DEG:+.3f} deg"
    in_picture = "-"
    if aligned.seen is not None:
        in_picture = f"{aligned.seen / DEG:+.3f} deg"
    off_line = "-"
    if not np.isnan(aligned.off):
        off_line = f"{aligned.off:.1%} of its length"
    rows = [
        ("AlignErr by projection", projected),
        ("AlignErr in the picture", in_picture),
        ("distance between the ends of the rectangle's upper side and of the line", off_line),
        ("time from the first press of the camera pedal to the last motion", f"{aligned.time:.1f} s"),
        ("path of the lens", str(mm(aligned.path))),
    ]
    for hand, path in aligned.hands.items():
        rows.append((f"path of the {hand} hand while it moved the camera", str(mm(path))))
    return rows


def _add_axes(columns: dict[str, Array], prefix: str, vectors: Array, suffix: str) -> None:
    """Add a column for each axis of vectors (k, 3)."""
    for i, axis in enumerate("xyz"):
        columns[f"{prefix}{axis}{suffix}"] = vectors[:, i]


def _positions(poses: Array) -> Array:
    """Return the positions (k, 3) of poses (k, 16)."""
    return poses.reshape(-1, 4, 4)[:, :3, 3]


def _time(t: float | None, never: str = "-") -> str:
    if t is None:
        return never
    return f"{t:.1f} s"


def _number(value: float) -> str:
    if not np.isfinite(value):
        return "-"
    return str(Quantity(value))
