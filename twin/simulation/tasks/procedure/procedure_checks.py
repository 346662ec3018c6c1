"""Check a procedure from the signals of its World: five stages, and errors that must not occur in any stage.

Clips, cuts, the bed, depths and positions are taken from the World, never from signals of the surgeon. A page shows the
checks of a running `ProcedureReferee`; a report computes them again from the recorded signals.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from twin.core.spatial import Array
from twin.core.spoken import spoken
from twin.core.units import MM
from twin.simulation import operating_scene
from twin.simulation.plants.tissue.operating import ClipPlace, Grasped
from twin.simulation.setup import Setup
from twin.simulation.world import Block, Recording, Signals
from twin.simulation.world.signal_kinds import (
    CLIP_AT,
    CLIP_COVER,
    CLIP_ON,
    ORGAN_DEPTH,
    ORGAN_ENERGY,
    ORGAN_FREED,
    ORGAN_NODES,
    ROBOT_FOLLOWS,
    ROBOT_HOLDS,
    ROBOT_LIFTED,
    ROBOT_PULL,
    ROBOT_SLIPPED,
    ROBOT_TIP,
    VESSEL_CUT,
    VESSEL_SEEN,
)

_CLOSED_COVER = 1 - 1e-9
"""A clip closes a vessel if at least this fraction of the vessel's width is between the legs of the clip."""


@dataclass(frozen=True)
class ProcedureCheck:
    """Result of a check.

    Attributes:
        name: "expose", "show", "clip", "cut", "remove"; "organs" and "vessels" for tissue that must be spared.
        done: whether the check is passed.
        t: time in s at which the check was passed; None: not passed, or a check that applies to the whole session.
        text: measured value and limit, as a sentence.
        lost: whether the check can no longer be passed.
    """

    name: str
    done: bool
    t: float | None
    text: str
    lost: bool = False


@dataclass(frozen=True)
class ProcedureMeasures:
    """Measures of a procedure.

    Attributes:
        checks: the five stages in order, then the checks of the whole session.
        time: time in s from the start of the clock (`ProcedureReferee.begun`) until the last stage was passed; if a
            stage was not passed, until the end of the session; 0: the clock did not start.
        paths: {robot: length in m of the path of its tip}.
        clips: number of clips used.
        energy: total energy in J that cautery applied to the cells of the bed.
        largest_pull: largest force of a grasper in N.
        slipped: largest distance in m by which something slipped in the jaws.
    """

    checks: Sequence[ProcedureCheck]
    time: float
    paths: Mapping[str, float]
    clips: int
    energy: float
    largest_pull: float
    slipped: float

    @property
    def done(self) -> bool:
        """Whether all checks are passed."""
        return all(check.done for check in self.checks)


@dataclass(frozen=True)
class ClosedClip:
    """A closed clip.

    Attributes:
        t: time in s at which the clip was closed.
        on: index of the vessel, or `ClipPlace.ON_NOTHING`.
        at: position of the clip along the vessel in m.
        cover: fraction of the vessel's width that is between the legs of the clip, 0 to 1.
    """

    t: float
    on: int
    at: float
    cover: float

    @property
    def closes(self) -> bool:
        """Whether the clip closes the whole width of the vessel."""
        return self.cover >= _CLOSED_COVER


class ProcedureReferee(Block):
    """Checks a procedure while it is performed; writes no signal.

    It reads the signals that `twin.simulation.plants.tissue.Operating` writes.

    Attributes:
        begun: time in s at which the clock starts; None: nothing has followed a hand yet.
        t: time in s of the last sample.
        closed: the clips that were closed so far, in order of time.
        lift: height in m by which the held point of the organ is above its rest position in the last sample; 0: the
            organ is not held.
        seen: fraction of the vessel that the camera sees in the last sample.
        freed: (n,) whether each cell of the bed is free.
        out: distance in m of the middle of the organ from the nearest port.
        removed: whether the organ is free and has been taken out.
    """

    outputs: Mapping[str, ArrayLike] = {}

    def __init__(self, setup: Setup, clips: Sequence[str], period: float, by_hand: bool = False) -> None:
        """Begin with no sample.

        Args:
            setup: a scene with organs, and a task with a procedure; the vessels are in the order of their numbers in
                `clip_<k>.on`.
            clips: names of the signals `clip_<k>.on`.
            period: time in s between two samples.
            by_hand: whether hands at a console move the robots (signals `<robot>.follows`): clock and checks then
                start with the first moment in which a robot follows its hand.

        Raises:
            TwinError: the task is not a procedure, or its organ is missing.
        """
        scene = setup.scene
        organ = operating_scene.organ_of(setup)
        self.procedure = operating_scene.procedure_of(scene, setup.task)
        self.period = period
        self.robots = list(self.procedure.start)
        self._organ = organ
        self._vessels = scene.vessels
        self._ports = np.array([operating_scene.port_of(place) for place in operating_scene.robots_of(setup)])
        self._middle = organ.weights.mean(axis=0)
        self._vessel_number = [vessel.name for vessel in scene.vessels].index(self.procedure.vessel)
        self._clips = [name.removesuffix(".on") for name in clips]  # in their appliers
        self.closed: list[ClosedClip] = []
        self.begun: float | None = None if by_hand else 0.0
        self.t = 0.0
        self.lift = 0.0
        self.seen = 0.0
        self._last_lift = 0.0  # lift in the last sample before the first clip is closed
        self._t_lifted: float | None = None
        self._shown_samples = 0  # number of successive samples in which the camera sees enough of the vessel
        self._most_shown_samples = 0
        self._t_shown: float | None = None
        self._t_cut = np.inf
        self._cuts = [np.zeros(vessel.segments) for vessel in scene.vessels]
        self.freed = np.zeros(len(organ.pinned_nodes), bool)
        self.energy = np.zeros(len(organ.pinned_nodes))
        self.out = np.inf
        self.removed = False
        self._t_removed: float | None = None  # the first time; the organ may have been put back since
        self._depths = dict.fromkeys(self.procedure.spare, 0.0)
        self._paths = dict.fromkeys(self.robots, 0.0)
        self._tips: dict[str, Array] = {}
        self._pull = 0.0
        self._slipped = 0.0

    @property
    def clips(self) -> int:
        """Number of clips that all appliers had at the start."""
        return len(self._clips) + len(self.closed)

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, Array]:
        """Judge the signals at the end of this tick."""
        self.see(signals.now, t)
        return {}

    def see(self, now: Mapping[str, Array], t: float) -> None:
        """Judge a sample at a time t in s, `period` after the sample before."""
        self.t = t
        if self.begun is None and any(now[ROBOT_FOLLOWS.of(robot)][0] > 0.5 for robot in self.robots):
            self.begun = t
        self._see_clips(now)
        self.lift = self._lift(now)
        self.seen = float(now[VESSEL_SEEN.of(self.procedure.vessel)][0])
        if not self.closed:
            self._before_clips()
        for k, vessel in enumerate(self._vessels):
            # copied, because the World writes the next values into the same memory
            self._cuts[k] = now[VESSEL_CUT.of(vessel.name)].copy()
        if not self.cut and self._cuts[self._vessel_number].any():
            self._t_cut = t
        self._see_organ(now)
        for name in self.procedure.spare:
            self._depths[name] = max(self._depths[name], float(now[ORGAN_DEPTH.of(name)][0]))
        for robot in self.robots:
            tip = now[ROBOT_TIP.of(robot)].copy()
            previous = self._tips.get(robot, tip)  # in the first sample, the path has no length
            self._paths[robot] += float(np.linalg.norm(tip - previous))
            self._tips[robot] = tip
            self._pull = max(self._pull, float(np.linalg.norm(now[ROBOT_PULL.of(robot)])))
            self._slipped = max(self._slipped, float(now[ROBOT_SLIPPED.of(robot)][0]))

    def _see_clips(self, now: Mapping[str, Array]) -> None:
        """Move the clips that have left their appliers to the closed ones."""
        for name in list(self._clips):
            on = round(float(now[CLIP_ON.of(name)][0]))
            if on == ClipPlace.UNUSED:
                continue
            self._clips.remove(name)
            at = float(now[CLIP_AT.of(name)][0])
            cover = float(now[CLIP_COVER.of(name)][0])
            self.closed.append(ClosedClip(self.t, on, at, cover))

    def _lift(self, now: Mapping[str, Array]) -> float:
        """Return the largest height in m by which a robot has lifted the organ; 0: no robot holds it."""
        lift = 0.0
        for robot in self.robots:
            if now[ROBOT_HOLDS.of(robot)][0] == Grasped.ORGAN:
                lift = max(lift, float(now[ROBOT_LIFTED.of(robot)][2]))
        return lift

    def _before_clips(self) -> None:
        procedure = self.procedure
        self._last_lift = self.lift
        if self._t_lifted is None and self.lift >= procedure.lift_mm * MM:
            self._t_lifted = self.t
        if self.seen >= procedure.seen and self.begun is not None:
            self._shown_samples += 1
        else:
            self._shown_samples = 0
        self._most_shown_samples = max(self._most_shown_samples, self._shown_samples)
        if self._t_shown is None and self._shown_samples * self.period >= procedure.seen_s:
            self._t_shown = self.t

    def _see_organ(self, now: Mapping[str, Array]) -> None:
        procedure = self.procedure
        organ = self._organ.name
        self.freed = now[ORGAN_FREED.of(organ)] > 0.5
        self.energy = now[ORGAN_ENERGY.of(organ)].copy()
        middle = self._middle @ now[ORGAN_NODES.of(organ)].reshape(-1, 3)
        self.out = float(np.linalg.norm(middle - self._ports, axis=1).min())
        is_free = bool(self.freed.all()) and bool(self.energy.min() >= procedure.bed_j)
        self.removed = is_free and self.out <= procedure.out_mm * MM
        if self.removed and self._t_removed is None:
            self._t_removed = self.t

    # -- checks ----------------------------------------------------------------------------------------------

    @property
    def on_vessel(self) -> int:
        """Number of clips that close the vessel of the procedure."""
        return len(self._closing_clips())

    @property
    def cut(self) -> bool:
        """Whether the vessel of the procedure is cut."""
        return self._t_cut < np.inf

    def checks(self) -> list[ProcedureCheck]:
        """Return the five stages in order, then the checks of the whole session."""
        stages = [self._expose(), self._show(), self._clip(), self._cut(), self._remove()]
        return [*stages, self._spared(), self._other_vessels()]

    def measures(self) -> ProcedureMeasures:
        """Return the checks and measures of all samples so far."""
        checks = self.checks()
        time = 0.0
        for stage in checks[:5]:
            if stage.t is None:
                time = self.t
                break
            time = max(time, stage.t)
        time = 0.0 if self.begun is None else time - self.begun
        energy = float(self.energy.sum())
        return ProcedureMeasures(checks, time, dict(self._paths), len(self.closed), energy, self._pull, self._slipped)

    def _expose(self) -> ProcedureCheck:
        procedure = self.procedure
        exposed = self._last_lift >= procedure.lift_mm * MM
        when = "when the first clip was placed" if self.closed else "at the end"
        text = (
            f"the held point of the {spoken(procedure.organ)} was {self._last_lift / MM:.1f} mm above its place {when} "
            f"(required: {procedure.lift_mm:g} mm)"
        )
        if exposed:
            return ProcedureCheck("expose", True, self._t_lifted, text)
        return ProcedureCheck("expose", False, None, text, lost=bool(self.closed))

    def _show(self) -> ProcedureCheck:
        procedure = self.procedure
        longest = self._most_shown_samples * self.period
        when = " before the first clip" if self.closed else ""
        text = (
            f"{procedure.camera} saw at least {procedure.seen:.0%} of the {spoken(procedure.vessel)} for "
            f"{longest:.1f} s{when} (required: {procedure.seen_s:g} s)"
        )
        is_shown = self._t_shown is not None
        is_lost = bool(self.closed) and not is_shown
        return ProcedureCheck("show", is_shown, self._t_shown, text, is_lost)

    def _clip(self) -> ProcedureCheck:
        procedure = self.procedure
        required = procedure.clips_kept + procedure.clips_taken
        times = sorted(clip.t for clip in self._clips_before_cut())
        partial = 0
        beside = 0
        for clip in self.closed:
            if clip.on == ClipPlace.ON_NOTHING:
                beside += 1
            elif clip.on == self._vessel_number and not clip.closes:
                partial += 1
        text = f"{len(times)} clips closed the {spoken(procedure.vessel)} before it was cut (required: {required})"
        if partial:
            text += f"; {partial} closed on a part of its width"
        if beside:
            text += f"; {beside} closed beside it"
        if len(times) >= required:
            return ProcedureCheck("clip", True, times[required - 1], text)
        too_few = len(times) + len(self._clips) < required
        return ProcedureCheck("clip", False, None, text, lost=self.cut or too_few)

    def _closing_clips(self) -> list[ClosedClip]:
        """Return the clips that close the vessel of the procedure."""
        clips = []
        for clip in self.closed:
            if clip.on == self._vessel_number and clip.closes:
                clips.append(clip)
        return clips

    def _clips_before_cut(self) -> list[ClosedClip]:
        """Return the clips that closed the vessel of the procedure before it was cut."""
        clips = []
        for clip in self._closing_clips():
            if clip.t <= self._t_cut:
                clips.append(clip)
        return clips

    def _cut(self) -> ProcedureCheck:
        procedure = self.procedure
        vessel = self._vessels[self._vessel_number]
        cut_segments = np.flatnonzero(self._cuts[self._vessel_number])
        if not len(cut_segments):
            return ProcedureCheck("cut", False, None, f"the {spoken(vessel.name)} is not cut")
        low = vessel.arc[cut_segments[0]]
        high = vessel.arc[cut_segments[-1] + 1]
        on_organ_side = 0
        on_other_side = 0
        clips_before_cut = self._clips_before_cut()
        for clip in clips_before_cut:
            on_organ_side += bool(clip.at < low)
            on_other_side += bool(clip.at > high)
        open_ends = []
        if on_organ_side == 0:
            open_ends.append("the organ's side")
        if on_other_side == 0:
            open_ends.append("the other side")
        clips = f"{on_organ_side} on the organ's side, {on_other_side} on the other side"
        text = f"cut {low / MM:.1f} mm from the organ, clips: {clips}"
        if open_ends:
            text += f"; the end on {' and '.join(open_ends)} is open: bile leaks"
            return ProcedureCheck("cut", False, None, text, lost=True)
        # too few clips are the finding of `_clip`; here, enough clips are on the wrong sides of the cut
        are_enough = len(clips_before_cut) >= procedure.clips_kept + procedure.clips_taken
        is_too_few_on_a_side = on_organ_side < procedure.clips_taken or on_other_side < procedure.clips_kept
        if are_enough and is_too_few_on_a_side:
            text += f" (required: {procedure.clips_taken} and {procedure.clips_kept})"
            return ProcedureCheck("cut", False, None, text, lost=True)
        return ProcedureCheck("cut", True, self._t_cut, text)

    def _remove(self) -> ProcedureCheck:
        procedure = self.procedure
        free = int(self.freed.sum())
        text = (
            f"{free} of {len(self.freed)} cells of the bed are free (at least {procedure.bed_j:g} J each); "
            f"the middle of the {spoken(procedure.organ)} is {self.out / MM:.0f} mm from the nearest port "
            f"(allowed: {procedure.out_mm:g} mm)"
        )
        return ProcedureCheck("remove", self.removed, self._t_removed if self.removed else None, text)

    def _spared(self) -> ProcedureCheck:
        procedure = self.procedure
        worst = max(self._depths, key=self._depths.__getitem__)
        depth = self._depths[worst]
        text = (
            f"deepest tip {depth / MM:.1f} mm below the rest surface of the {spoken(worst)} "
            f"(allowed: {procedure.depth_mm:g} mm)"
        )
        spared = depth <= procedure.depth_mm * MM
        return ProcedureCheck("organs", spared, None, text, not spared)

    def _other_vessels(self) -> ProcedureCheck:
        wrong = []
        for k, vessel in enumerate(self._vessels):
            if k == self._vessel_number:
                continue
            clips = 0
            for clip in self.closed:
                clips += clip.on == k
            cuts = int(self._cuts[k].sum())
            if clips or self._cuts[k].any():
                wrong.append(f"{clips} clips on and {cuts} cuts of the {spoken(vessel.name)}")
        text = "; ".join(wrong) or "no other vessel was clipped or cut"
        return ProcedureCheck("vessels", not wrong, None, text, bool(wrong))


def measure(recording: Recording, setup: Setup) -> ProcedureMeasures:
    """Return the measures of a session; `recording`: the signals that the referee reads. See `ProcedureReferee`."""
    clips = []
    for name in sorted(recording.sizes):
        clip = CLIP_ON.owner_of(name)
        if clip is not None and clip.startswith("clip_"):
            clips.append(name)
    robots = operating_scene.procedure_of(setup.scene, setup.task).start
    by_hand = all(ROBOT_FOLLOWS.of(robot) in recording.sizes for robot in robots)
    referee = ProcedureReferee(setup, clips, recording.dt, by_hand)
    for t, now in zip(recording.t.tolist(), recording.samples(recording.sizes), strict=True):
        referee.see(now, t)
    return referee.measures()
