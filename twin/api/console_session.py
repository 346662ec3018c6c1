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
from twin.core.result import Part, Result, Table
from twin.core.spatial import Array
from twin.core.spoken import spoken
from twin.core.units import DEG, MM
from twin.model.mechanism import Mechanism
from twin.model.movable import together
from twin.model.scene import Place, Scene
from twin.model.task import Task
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
from twin.simulation.session.run import Ran
from twin.simulation.session.touch import Touched, touched
from twin.simulation.session.training import Training

if TYPE_CHECKING:
    from twin.exchange.write.clip import Clip

_STRIDE = 4
"""Number of samples between two keys of an exported motion: 4 samples of 5 ms (`run.SAMPLE`) give 50 keys per s."""


@dataclass(frozen=True)
class Arm:
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
    task: Task | None
    ran: Ran
    arms: Mapping[str, Arm]
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
            done = "All targets were touched" if self.board is None else "All rings are on their pegs"
            done = done if self.aligned is None else "The endoscope is aligned"
            done = done if self.guided is None else "The ring was guided along the wire"
            done = "The machine followed its model" if self.training else done
            return "The replay gives the same bytes" if self.source else done
        codes = {f.code for f in self.findings if f.severity == "disagreement"}
        if "task.missed" in codes:
            missed = "Not all targets were touched" if self.board is None else "Not all rings are on their pegs"
            missed = missed if self.guided is None else "Not all steps of the task are done"
            return missed if self.aligned is None else "The endoscope is not aligned"
        if "task.errors" in codes:
            return "More errors than allowed"
        return "The replay gives different bytes" if "session.differs" in codes else super().word

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
        tips = {hand: self.arms[getattr(table, hand)[0]].tip for hand in HANDS}
        return touched(self.task, self.t, tips)

    @cached_property
    def board(self) -> BoardMeasures | None:
        """Measures of a task with rings; None for another task."""
        if self.task is None or not self.task.transfers:
            return None
        robots = [*console_scene.hands_of(self.scene)]
        return rings.measure(self.ran.kept, self.task, self.scene.objects, self.pegs, robots)

    @cached_property
    def forces(self) -> ForceMeasures | None:
        """Measures of the forces on the hands; None for a session without forces."""
        return forces.measure(self.ran.kept, HANDS)

    @property
    def camera(self) -> str:
        """Name of the robot that holds the camera."""
        return self.scene.cameras[console_scene.console_of(self.scene).camera].robot

    @property
    def _tips(self) -> dict[str, Array]:
        return {name: arm.tip for name, arm in self.arms.items()}

    @property
    def findings(self) -> Sequence[Finding]:
        """Findings: the replay differs from the recording, the file is truncated, or a target was not touched."""
        out: list[Finding] = []
        if (d := self.ran.difference) is not None:
            size = (
                f"; the largest difference is {d.size:.3g} in {d.signal}"
                if d.signal
                else f"; at {d.t1:g} s, all signals are equal again"
            )
            out.append(
                disagreement(
                    "session.differs",
                    d.signal,
                    f"the replay gives other bytes than the recording, first between {d.t0:g} and {d.t1:g} s{size}",
                    suggestion="replay with the twin version and the processor type of the recording",
                    when=f"{d.t0:g} .. {d.t1:g} s",
                )
            )
        if self.lost:
            out.append(warning("session.interrupted", self.source, self.lost))
        if self.console.time == 0:
            text = "no arm followed a hand: the condition to start following (docs/console.md) was never met"
            out.append(warning("session.idle", "", text))
        if self.task is not None:
            out += [
                disagreement(
                    "task.missed",
                    target.name,
                    "the target was not touched; minimum distance between the target and the tips",
                    mm(target.nearest),
                    mm(self.task.tolerance),
                    word="required",
                )
                for target in self.touched
                if target.t is None
            ]
        if self.board is not None:
            out += [
                disagreement("task.missed", r.ring, f"at the end, the ring is not around its peg, {spoken(r.peg)}")
                for r in self.board.rings
                if r.t is None
            ]
        out += self._unguided()
        out += self._unaligned()
        out += [finding for machine in self.training for finding in machine.findings()]
        if find_spec("mcap") is None:
            text = f"session.mcap is not written: pip install 'twin-robotics[{EXTRAS['mcap']}]'"
            out.append(info("session.no_mcap", "", text))
        return out

    def _unguided(self) -> Iterator[Finding]:
        """Yield findings on steps that are not done, and on errors that exceed their limits."""
        if (g := self.guided) is None:
            return
        for step in g.missed:
            yield disagreement(
                "task.missed", step, f"the step is not done; the ring passed along {g.passed:.0%} of the wire"
            )
        for what, value, most, unit in g.exceeded:
            text = f"more {what} than allowed"
            yield disagreement("task.errors", what, text, Quantity(value, unit), most, word="allowed")

    def _unaligned(self) -> Iterator[Finding]:
        """Yield findings on the alignment.

        The camera is not aligned, AlignErr cannot be measured in the picture, or AlignErr in the picture differs from
        AlignErr by projection.
        """
        if (a := self.aligned) is None or self.task is None or self.task.alignment is None:
            return
        wanted = self.task.alignment
        if np.isnan(a.angle):
            yield disagreement("task.missed", self.task.name, "at the end, the rectangle is behind the lens")
        elif not a.done(wanted):
            yield disagreement(
                "task.missed",
                self.task.name,
                f"the upper side of the rectangle is not aligned: its ends are up to {a.off:.0%} of the line's length "
                f"from the line's ends (allowed: {wanted.off:.0%}); AlignErr",
                Quantity(abs(a.angle) / DEG, "deg"),
                wanted.tolerance / DEG,
                word="allowed",
            )
        if a.seen is None:
            yield warning("task.unseen", self.task.name, f"AlignErr cannot be measured in the picture: {a.refused}")
        elif abs(a.seen - a.angle) > camera_task.AGREE:
            yield disagreement(
                "task.angles",
                self.task.name,
                f"AlignErr is {a.seen / DEG:.3f} deg in the picture and {a.angle / DEG:.3f} deg by projection; "
                "difference",
                Quantity(abs(a.seen - a.angle) / DEG, "deg"),
                camera_task.AGREE / DEG,
            )

    def content(self) -> JsonObject:
        """Return the measures; the keys of quantities end with the unit."""
        c = self.console
        return {
            "scene": self.scene.name,
            "surgeon": "person" if self.seed is None else "simulated",
            "seed": self.seed,
            "replay": None if not self.source else "same" if self.ran.difference is None else "differs",
            "ticks": self.ran.ticks,
            "duration_s": c.duration,
            "time_s": c.time,
            "hands": [
                {
                    "hand": h.hand,
                    "robot": h.robot,
                    "path_mm": h.path / MM,
                    "movements": h.movements,
                    "moving_s": h.moving,
                    "idle_s": h.idle,
                    "economy": h.economy,
                    "smoothness_sparc": h.smoothness,
                    "grasps": h.grasps,
                }
                for h in self.hands
            ],
            "clutches": c.clutches,
            "clutched_s": c.clutched,
            "camera_moves": c.camera_moves,
            "camera_s": c.camera_time,
            "silent_s": c.silent,
            "taps": c.taps,
            "scale": list(c.scale),
            "task": None if self.task is None else self.task.name,
            "targets": [{"name": x.name, "t_s": x.t, "nearest_mm": x.nearest / MM} for x in self.touched],
            "alignment": None
            if (a := self.aligned) is None
            else {
                "time_s": a.time,
                "align_err_deg": a.angle / DEG if np.isfinite(a.angle) else None,
                "align_err_in_picture_deg": None if a.seen is None else a.seen / DEG,
                "not_in_picture": a.refused or None,
                "off_line": a.off if np.isfinite(a.off) else None,
                "lens_path_mm": a.path / MM,
                "hand_paths_mm": {hand: p / MM for hand, p in a.hands.items()},
            },
            "condition": None if (condition := self.ran.condition) is None else condition.model_dump(),
            "forces": None
            if (f := self.forces) is None
            else {"on": f.on, "felt_s": dict(f.felt), "largest_n": dict(f.largest)},
            "guided": None if self.guided is None else self.guided.content(),
            "machines": [machine.content() for machine in self.training],
            "board": None
            if (board := self.board) is None
            else {
                "time_s": board.time,
                "rings_transferred": board.transferred,
                "rings_dropped": board.dropped,
                "instrument_collisions": board.collisions,
                "errors": board.errors,
                "rings": [{"ring": r.ring, "peg": r.peg, "t_s": r.t, "drops": r.drops} for r in board.rings],
            },
        }

    def text(self) -> Iterator[Part]:
        """Yield the measures of hands and console, the targets, the result of the replay, and the findings."""
        c = self.console
        who = "a person" if self.seed is None else f"a simulated surgeon, seed {self.seed} (its habits are ASSUMED)"
        yield f"{self.scene.name} · session of {who}\n"
        rows = [
            (
                h.hand,
                h.robot,
                str(mm(h.path)),
                str(h.movements),
                f"{h.moving:.1f} s",
                f"{h.idle:.1f} s",
                _number(h.economy),
                _number(h.smoothness),
                str(h.grasps),
            )
            for h in self.hands
        ]
        header = ("hand", "arm", "path", "movements", "moving", "idle", "economy", "SPARC", "grasps")
        yield Table(header, rows)
        yield ""
        scale = f"{c.scale[0]:g}" if c.scale[0] == c.scale[1] else f"{c.scale[0]:g} to {c.scale[1]:g}"
        console = [
            ("time since an arm first followed a hand", f"{c.time:.1f} s of {c.duration:.1f} s"),
            ("clutch presses", f"{c.clutches}, for {c.clutched:.1f} s; quick taps: {c.taps}"),
            ("camera moves", f"{c.camera_moves}, for {c.camera_time:.1f} s"),
            ("device silent", f"{c.silent:.1f} s"),
            ("motion scale", scale),
        ]
        if (f := self.forces) is not None:
            hands = "; ".join(f"{hand} {f.felt[hand]:.1f} s, at most {f.largest[hand]:.2f} N" for hand in HANDS)
            console.append(("forces on the hands", f"on {100 * f.on:.0f} % of the time; {hands}"))
        if (condition := self.ran.condition) is not None and condition.participant is not None:
            console.append(("study", f"participant {condition.participant}, run {condition.run}"))
        yield Table((), console)
        if self.task is not None:
            yield f"\n  {self.task.name}: {self.task.title}"
        if self.board is not None:
            b = self.board
            outcome = [
                (spoken(r.ring), spoken(r.peg), "-" if r.t is None else f"{r.t:.1f} s", str(r.drops)) for r in b.rings
            ]
            yield Table(("ring", "peg", "transferred at", "dropped"), outcome)
            yield ""
            yield Table((), b.rows())
        elif self.guided is not None:
            outcome = [(name, "-" if t is None else f"{t:.1f} s") for name, t in self.guided.steps.items()]
            yield Table(("step", "done at"), outcome)
            yield ""
            yield Table((), self.guided.rows())
        elif self.aligned is not None:
            yield Table((), _aligned_rows(self.aligned))
        elif self.task is not None:
            targets = [
                (x.name, "not touched" if x.t is None else f"{x.t:.1f} s", str(mm(x.nearest))) for x in self.touched
            ]
            yield Table(("target", "touched at", "smallest distance"), targets)
        for machine in self.training:
            yield f"\n  {machine.robot}: machine compared with its model"
            header = ("phase", "duration", "max distance to the model", "max distance to the rehearsed path", "reason")
            yield Table(header, list(machine.rows()))
        if self.source and self.ran.difference is None:
            yield f"\n  replay: the same bytes in all {self.ran.ticks} ticks"
        yield ""
        yield from by_severity(self.findings)

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
        body = np.column_stack([v[::_STRIDE] for v in columns.values()])
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
        out = {"t_s": self.t, "mode": kept["console.mode"][:, 0]}
        out |= {n: kept[f"{PEDALS}.{n}"][:, 0] for n in ("clutch", "camera", "scale")}
        for hand in HANDS:
            p = kept[f"{hand}.pose"].reshape(-1, 4, 4)[:, :3, 3]
            out |= {f"{hand}_{axis}_m": p[:, i] for i, axis in enumerate("xyz")}
            out[f"{hand}_grip_rad"] = kept[f"{hand}.grip"][:, 0]
            if self.forces is not None:
                out |= {f"{hand}_force_{axis}_n": kept[f"{hand}.force"][:, i] for i, axis in enumerate("xyz")}
        for name, arm in self.arms.items():
            if f"{name}.deviation" in kept.sizes:
                out[f"{name}_deviation_m"] = kept[f"{name}.deviation"][:, 0]
            if name != self.camera:
                out[f"{name}_follows"] = kept[f"{name}.follows"][:, 0]
                out |= {f"{name}_tip_{axis}_m": arm.tip[:, i] for i, axis in enumerate("xyz")}
                out[f"{name}_speed_m_per_s"] = movement.speed(arm.tip, kept.dt)
            for j, joint in enumerate(arm.mechanism.active):
                out[f"{name}_{joint.name}_{'rad' if joint.is_angle else 'm'}"] = arm.q[:, j]
        for name in self._moved:
            p = kept[f"{name}.pose"].reshape(-1, 4, 4)[:, :3, 3]
            out |= {f"{name}_{axis}_m": p[:, i] for i, axis in enumerate("xyz")}
            out[f"{name}_holder"] = kept[f"{name}.holder"][:, 0]
        return out

    @property
    def _moved(self) -> list[str]:
        """Names of the movable objects in this session."""
        return [o.name for o in self.scene.objects if f"{o.name}.pose" in self.ran.kept.sizes]

    def _write_objects(self, folder: Path) -> None:
        from twin.exchange.formats.glb.write import write_glb
        from twin.exchange.formats.tracks.write import write_tracks
        from twin.exchange.formats.usd.write import write_usd

        mechanism = together([o for o in self.scene.objects if o.name in self._moved])
        poses = {name: self.ran.kept[f"{name}.pose"].reshape(-1, 4, 4) for name in self._moved}
        poses[mechanism.base] = np.broadcast_to(np.eye(4), (len(self.t), 4, 4))
        clip = self._clip("objects", mechanism, poses)
        folder.mkdir()
        write_glb(mechanism, [clip], folder / "objects.glb")
        write_tracks(mechanism, clip, folder / "tracks")
        write_usd(mechanism, [clip], folder / "usd")

    def _clip(self, name: str, mechanism: Mechanism, poses: Mapping[str, Array]) -> Clip:
        from twin.exchange.write.clip import Clip, extremes, key_rows, measure_between
        from twin.exchange.write.sampled import coordinates

        keys = key_rows(len(self.t), _STRIDE)
        links = {n: np.round(T, 13) + 0.0 for n, T in poses.items()}
        reaches = {b.name: extremes(mechanism, b) for b in mechanism.bodies}
        at_keys = {n: T[keys] for n, T in links.items()}
        return Clip(
            "session",
            f"{name} in a session of {self.scene.name}",
            self.t[keys],
            at_keys,
            coordinates(mechanism, at_keys),
            tuple(j.name for j in mechanism.active),
            (("session", 0.0, float(self.t[-1])),),
            1 / (_STRIDE * self.ran.kept.dt),
            measure_between(mechanism, self.t, links, keys, reaches),
            frame=mechanism.tool,
            phase_rcm=(None,),
            trocars=mechanism.trocar_places,
        )

    def _write_mcap(self, path: Path) -> None:
        from twin.exchange.formats.mcap.write import write_mcap

        links, joints, kept = {}, {}, self.ran.kept
        for name in self._moved:
            links[name] = kept[f"{name}.pose"].reshape(-1, 4, 4)[::_STRIDE]
        for name, arm in self.arms.items():
            for link, Ts in arm.links.items():
                links[f"{name}/{link}"] = arm.place.T_world_base @ Ts[::_STRIDE]
            for j, joint in enumerate(arm.mechanism.active):
                joints[f"{name}/{joint.name}"] = arm.q[::_STRIDE, j]
        console = {"mode": kept["console.mode"][::_STRIDE, 0]}
        console |= {n: kept[f"{PEDALS}.{n}"][::_STRIDE, 0] for n in ("clutch", "camera", "scale")}
        console |= {f"{hand}_grip": kept[f"{hand}.grip"][::_STRIDE, 0] for hand in HANDS}
        write_mcap(path, self.t[::_STRIDE], links, joints, console)


def _aligned_rows(a: AlignMeasures) -> list[tuple[str, str]]:
    angle = "-" if np.isnan(a.angle) else f"{a.angle / DEG:+.3f} deg"
    return [
        ("AlignErr by projection", angle),
        ("AlignErr in the picture", "-" if a.seen is None else f"{a.seen / DEG:+.3f} deg"),
        (
            "distance between the ends of the rectangle's upper side and of the line",
            "-" if np.isnan(a.off) else f"{a.off:.1%} of its length",
        ),
        ("time from the first press of the camera pedal to the last motion", f"{a.time:.1f} s"),
        ("path of the lens", str(mm(a.path))),
        *((f"path of the {hand} hand while it moved the camera", str(mm(p))) for hand, p in a.hands.items()),
    ]


def _number(value: float) -> str:
    return str(Quantity(value)) if np.isfinite(value) else "-"
