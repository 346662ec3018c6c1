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
from twin.simulation.setup import Setup
from twin.simulation.world import Block, Recording, Signals

_SHUT = 1 - 1e-9
"""A clip closes a vessel if at least this fraction of the vessel's width is between the legs of the clip."""


@dataclass(frozen=True)
class Check:
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
        time: time in s until the last stage was passed; if a stage was not passed, duration of the session.
        paths: {robot: length in m of the path of its tip}.
        clips: number of clips used.
        energy: total energy in J that cautery applied to the cells of the bed.
        largest_pull: largest force of a grasper in N.
        slipped: largest distance in m by which something slipped in the jaws.
    """

    checks: Sequence[Check]
    time: float
    paths: Mapping[str, float]
    clips: int
    energy: float
    largest_pull: float
    slipped: float

    @property
    def done(self) -> bool:
        """Whether all checks are passed."""
        return all(c.done for c in self.checks)


@dataclass(frozen=True)
class Closed:
    """A closed clip.

    Attributes:
        t: time in s at which the clip was closed.
        on: index of the vessel; -1: the clip is on no vessel.
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
        return self.cover >= _SHUT


class ProcedureReferee(Block):
    """Checks a procedure while it is performed; writes no signal.

    It reads the signals that `twin.simulation.plants.tissue.Operating` writes.

    Attributes:
        t: time in s of the last sample.
        closed: the clips that were closed so far, in order of time.
        lift: height in m by which the held point of the organ is above its rest position in the last sample; 0: the
            organ is not held.
        seen: fraction of the vessel that the camera sees in the last sample.
        freed: (n,) whether each cell of the bed is free.
        out: distance in m of the middle of the organ from the nearest port.
    """

    outputs: Mapping[str, ArrayLike] = {}

    def __init__(self, setup: Setup, clips: Sequence[str], period: float) -> None:
        """Begin with no sample.

        Args:
            setup: a scene with organs, and a task with a procedure; the vessels are in the order of their numbers in
                `clip_<k>.on`.
            clips: names of the signals `clip_<k>.on`.
            period: time in s between two samples.

        Raises:
            TwinError: the task is not a procedure, or its organ is missing.
        """
        scene, organ = setup.scene, operating_scene.organ_of(setup)
        self.procedure, self.period = (p := operating_scene.procedure_of(scene, setup.task)), period
        self.robots = [*p.start]
        self._organ, self._vessels = organ, scene.vessels
        self._ports = np.array([operating_scene.port_of(x) for x in operating_scene.robots_of(setup)])
        self._middle = organ.weights.mean(axis=0)
        self._number = next(k for k, v in enumerate(scene.vessels) if v.name == p.vessel)
        self._clips = [n.removesuffix(".on") for n in clips]
        self.closed, self.t, self._samples = list[Closed](), 0.0, 0
        self.lift = self.seen = 0.0
        self._last_lift = 0.0  # lift in the last sample before the first clip is closed
        self._high: float | None = None
        self._run = self._best = 0
        self._shown: float | None = None
        self._t_cut = np.inf
        self._cuts = [np.zeros(v.segments) for v in scene.vessels]
        self.freed, self.energy = np.zeros(len(organ.held), bool), np.zeros(len(organ.held))
        self.out = np.inf
        self._removed: tuple[float, bool] | None = None  # (time in s of first removal, whether it is out now)
        self._depths = dict.fromkeys(p.spare, 0.0)
        self._paths, self._tips = dict.fromkeys(self.robots, 0.0), dict[str, Array]()
        self._pull = self._slipped = 0.0

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
        p = self.procedure
        self.t, self._samples = t, self._samples + 1
        for name in [n for n in self._clips if now[f"{n}.on"][0] > -1.5]:
            self._clips.remove(name)
            on, at, cover = (float(now[f"{name}.{what}"][0]) for what in ("on", "at", "cover"))
            self.closed.append(Closed(t, round(on), at, cover))
        self.lift = max((float(now[f"{n}.lifted"][2]) for n in self.robots if now[f"{n}.holds"][0] == 0), default=0.0)
        self.lift, self.seen = max(self.lift, 0.0), float(now[f"{p.vessel}.seen"][0])
        if not self.closed:
            self._before_clips(t)
        for k, v in enumerate(self._vessels):
            self._cuts[k] = now[f"{v.name}.cut"].copy()
        if self._t_cut == np.inf and self._cuts[self._number].any():
            self._t_cut = t
        self._see_organ(now, t)
        for name in p.spare:
            self._depths[name] = max(self._depths[name], float(now[f"{name}.depth"][0]))
        for n in self.robots:
            tip = now[f"{n}.tip"].copy()
            self._paths[n] += float(np.linalg.norm(tip - self._tips.get(n, tip)))
            self._tips[n] = tip
            self._pull = max(self._pull, float(np.linalg.norm(now[f"{n}.pull"])))
            self._slipped = max(self._slipped, float(now[f"{n}.slipped"][0]))

    def _before_clips(self, t: float) -> None:
        p = self.procedure
        self._last_lift = self.lift
        if self._high is None and self.lift >= p.lift_mm * MM:
            self._high = t
        self._run = self._run + 1 if self.seen >= p.seen else 0
        self._best = max(self._best, self._run)
        if self._shown is None and self._run * self.period >= p.seen_s:
            self._shown = t

    def _see_organ(self, now: Mapping[str, Array], t: float) -> None:
        p, organ = self.procedure, self._organ
        self.freed, self.energy = now[f"{organ.name}.freed"] > 0.5, now[f"{organ.name}.energy"].copy()
        middle = self._middle @ now[f"{organ.name}.nodes"].reshape(-1, 3)
        self.out = float(np.linalg.norm(middle - self._ports, axis=1).min())
        done = bool(self.freed.all() and self.energy.min() >= p.bed_j and self.out <= p.out_mm * MM)
        if done and self._removed is None:
            self._removed = t, True
        elif self._removed is not None:
            self._removed = self._removed[0], done

    # -- checks ----------------------------------------------------------------------------------------------

    @property
    def on_vessel(self) -> int:
        """Number of clips that close the vessel of the procedure."""
        return sum(c.on == self._number and c.closes for c in self.closed)

    @property
    def cut(self) -> bool:
        """Whether the vessel of the procedure is cut."""
        return self._t_cut < np.inf

    @property
    def removed(self) -> bool:
        """Whether the organ is free and has been taken out."""
        return self._removed is not None and self._removed[1]

    def checks(self) -> list[Check]:
        """Return the five stages in order, then the checks of the whole session."""
        stages = [self._expose(), self._show(), self._clip(), self._cut(), self._remove()]
        return [*stages, self._spared(), self._other_vessels()]

    def measures(self) -> ProcedureMeasures:
        """Return the checks and measures of all samples so far."""
        checks = self.checks()
        times = [c.t for c in checks[:5] if c.t is not None]
        time = max(times) if len(times) == 5 else self.t
        energy = float(self.energy.sum())
        return ProcedureMeasures(checks, time, dict(self._paths), len(self.closed), energy, self._pull, self._slipped)

    def _expose(self) -> Check:
        p = self.procedure
        done = self._last_lift >= p.lift_mm * MM
        when = "when the first clip was placed" if self.closed else "at the end"
        text = (
            f"the held point of the {spoken(p.organ)} was {self._last_lift / MM:.1f} mm above its place {when} "
            f"(required: {p.lift_mm:g} mm)"
        )
        return Check("expose", done, self._high if done else None, text, bool(self.closed) and not done)

    def _show(self) -> Check:
        p = self.procedure
        text = (
            f"{p.camera} saw at least {p.seen:.0%} of the {spoken(p.vessel)} for {self._best * self.period:.1f} s"
            f"{' before the first clip' if self.closed else ''} (required: {p.seen_s:g} s)"
        )
        done = self._shown is not None
        return Check("show", done, self._shown, text, bool(self.closed) and not done)

    def _clip(self) -> Check:
        p = self.procedure
        wanted = p.clips_kept + p.clips_taken
        shut = sorted(c.t for c in self._shut() if c.t <= self._t_cut)
        part = sum(c.on == self._number and not c.closes for c in self.closed)
        beside = sum(c.on == -1 for c in self.closed)
        more = "".join(
            f"; {n} {what}" for n, what in ((part, "closed on a part of its width"), (beside, "closed beside it")) if n
        )
        text = f"{len(shut)} clips closed the {spoken(p.vessel)} before it was cut (required: {wanted}){more}"
        done = len(shut) >= wanted
        lost = not done and (self.cut or len(shut) + len(self._clips) < wanted)
        return Check("clip", done, shut[wanted - 1] if done else None, text, lost)

    def _shut(self) -> list[Closed]:
        return [c for c in self.closed if c.on == self._number and c.closes]

    def _cut(self) -> Check:
        v, gone = self._vessels[self._number], np.flatnonzero(self._cuts[self._number])
        if not len(gone):
            return Check("cut", False, None, f"the {spoken(v.name)} is not cut")
        low, high = v.arc[gone[0]], v.arc[gone[-1] + 1]
        taken, kept = (sum(c.at < low for c in self._shut()), sum(c.at > high for c in self._shut()))
        open_ends = [side for side, n in (("the organ's side", taken), ("the other side", kept)) if n == 0]
        text = f"cut {low / MM:.1f} mm from the organ, clips: {taken} on the organ's side, {kept} on the other side"
        if open_ends:
            text += f"; the end on {' and '.join(open_ends)} is open: bile leaks"
        return Check("cut", not open_ends, None if open_ends else self._t_cut, text, bool(open_ends))

    def _remove(self) -> Check:
        p = self.procedure
        text = (
            f"{int(self.freed.sum())} of {len(self.freed)} cells of the bed are free (at least {p.bed_j:g} J each); "
            f"the middle of the {spoken(p.organ)} is {self.out / MM:.0f} mm from the nearest port "
            f"(allowed: {p.out_mm:g} mm)"
        )
        return Check("remove", self.removed, self._removed[0] if self._removed and self.removed else None, text)

    def _spared(self) -> Check:
        p, depths = self.procedure, self._depths
        worst = max(depths, key=lambda n: depths[n])
        deep = f"{depths[worst] / MM:.1f} mm below the rest surface of the {spoken(worst)}"
        text = f"deepest tip {deep} (allowed: {p.depth_mm:g} mm)"
        done = depths[worst] <= p.depth_mm * MM
        return Check("organs", done, None, text, not done)

    def _other_vessels(self) -> Check:
        wrong = [
            f"{sum(c.on == k for c in self.closed)} clips on and {int(self._cuts[k].sum())} cuts "
            f"of the {spoken(v.name)}"
            for k, v in enumerate(self._vessels)
            if k != self._number and (any(c.on == k for c in self.closed) or self._cuts[k].any())
        ]
        text = "; ".join(wrong) or "no other vessel was clipped or cut"
        return Check("vessels", not wrong, None, text, bool(wrong))


def measure(kept: Recording, setup: Setup) -> ProcedureMeasures:
    """Return the measures of a session; `kept`: the signals that the referee reads. See `ProcedureReferee`."""
    clips = [n for n in sorted(kept.sizes) if n.startswith("clip_") and n.endswith(".on")]
    referee = ProcedureReferee(setup, clips, kept.dt)
    for t, now in zip(kept.t.tolist(), kept.samples(kept.sizes), strict=True):
        referee.see(now, t)
    return referee.measures()
