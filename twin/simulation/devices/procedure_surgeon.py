"""A simulated surgeon who removes an organ in five stages, with assistants who hold the grasper and the endoscope.

The hands move along straight lines with minimum jerk, aim with an error, and tremble. The surgeon sees the organ, its
bed and the vessels at the start of each movement, and repeats failed attempts. All habits are ASSUMED.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from twin.core.errors import WorldError, unknown
from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.scene import Place
from twin.model.tool import Kind
from twin.simulation import operating_scene
from twin.simulation.console_scene import start
from twin.simulation.devices.hand import Hand, Tremor, minimum_jerk
from twin.simulation.procedure_scene import TICK
from twin.simulation.setup import Member, Setup
from twin.simulation.world import Block, Signals

Mistake = Literal["", "clip_missed", "wrong_vessel", "organ_punctured", "cut_outside", "bed_left"]
"""Mistakes on request: a clip beside the vessel; a clip on another vessel; a tip pushed into an organ that must be
spared; a cut outside the clips; a cell of the bed that is not freed."""

_TRIES = 3
"""Number of attempts at a grasp, a clip, a cut or a cell of the bed before the surgeon goes on."""


@dataclass(frozen=True)
class Manner:
    """Habits of the surgeon, SI; all ASSUMED.

    Attributes:
        hand: parameters of a hand's tremor; the tremor moves the tip without being multiplied by a motion scale.
        aim: standard deviation in m of the error of aim, along each axis.
        quick, slow: mean speeds in m/s far from and near to tissue.
        before: distance in m from the target at which the slow approach to the target begins.
        lift: (3,) displacement in m by which the organ is lifted before clipping.
        peel: (3,) displacement in m by which the organ is lifted further for each freed cell of its bed.
        view: distance of the endoscope from the vessel in m.
        press: time in s for which jaws stay closed.
        taken: position of the first clip on the organ's side of the cut, as a fraction of the vessel's length from the
            organ; further clips are nearer to the organ.
        cut: position of the cut, as a fraction like `taken`.
        kept: position of the first clip on the other side of the cut, as a fraction like `taken`; further clips are
            farther from the organ.
        apart: distance in m between neighbouring clips.
    """

    hand: Hand = field(default_factory=lambda: Hand(tremor=0.1e-3))
    aim: float = 0.4e-3
    quick: float = 0.085
    slow: float = 0.04
    before: float = 20e-3
    lift: tuple[float, float, float] = (-0.010, -0.006, 0.022)
    peel: tuple[float, float, float] = (-0.004, -0.001, 0.006)
    view: float = 0.09
    press: float = 0.2
    taken: float = 0.3
    cut: float = 0.46
    kept: float = 0.62
    apart: float = 4e-3


@dataclass(frozen=True)
class Arm:
    """A robot that the surgeon moves: its name; its port (3,) and the tip (3,) at the start, in m in the World."""

    robot: str
    port: Array
    tip: Array


def _arm(place: Place, member: Member) -> Arm:
    T = place.T_world_base @ member.kin.forward(start(place, member.mechanism))
    return Arm(place.name, operating_scene.port_of(place), T[:3, 3])


class ProcedureSurgeon(Block):
    """Writes `<robot>.target` of all robots, `.opening`, `.tool` and `.pedal` of robots with tools, `surgeon.stage`.

    Attributes:
        missed: names of the steps that the surgeon gave up.
    """

    def __init__(self, setup: Setup, seed: int = 0, mistake: Mistake = "", manner: Manner | None = None) -> None:
        """Prepare the surgeon's work.

        Args:
            setup: a scene with organs, vessels and tools, its robots, and a task with a procedure.
            seed: seed of tremor and aim.
            mistake: a mistake to make, "": none.
            manner: habits; None: the defaults.

        Raises:
            TwinError: the task is not a procedure, or its organ is missing.
            WorldError: there is no such mistake, or no robot can carry a tool that is needed.
        """
        if mistake not in get_args(Mistake):
            raise WorldError(unknown("mistake", mistake, [m for m in get_args(Mistake) if m]))
        scene, procedure = setup.scene, operating_scene.procedure_of(setup.scene, setup.task)
        self.procedure, self.manner, self.mistake = procedure, manner or Manner(), mistake
        self._rng = np.random.default_rng(seed)
        *arms, camera = (_arm(place, setup.members[place.name]) for place in operating_scene.robots_of(setup))
        self._arms, self._camera, self._tools = {a.robot: a for a in arms}, camera, dict(scene.tools)
        self._organ = operating_scene.organ_of(setup)
        self._spared = next(o for o in setup.organs if o.name == procedure.spare[0])
        self._vessels = {v.name: v for v in scene.vessels}
        self._holder = self._carrier("grasper", [*self._arms])
        others = [n for n in self._arms if n != self._holder]
        self._worker = self._carrier("clip_applier", others)
        for kind in ("scissors", "cautery"):
            if self._carrier(kind, others) != self._worker:
                raise WorldError(f"{self._worker} cannot carry {kind}; add {self._worker} to `robots` of such a tool")
        everyone = [*self._arms.values(), camera]
        self._at = {a.robot: a.tip.copy() for a in everyone}
        self._shake = {a.robot: Tremor(self._rng, self.manner.hand, TICK) for a in everyone}
        names = [*self._tools]
        self._tool = {n: names.index(procedure.start[n]) for n in self._arms}
        self._opening, self._pedal = dict.fromkeys(self._arms, 1.0), dict.fromkeys(self._arms, 0.0)
        self._stage, self._k, self.missed = 0, 0, list[str]()
        self._script = self._work()
        self.outputs = self._said(still=True)

    def _carrier(self, kind: Kind, among: Sequence[str]) -> str:
        """Return the robot for a kind of tool: the one with it at the start, else the first that can carry it."""
        p = self.procedure
        able = [n for n in among if any(t.kind == kind and n in t.robots for t in self._tools.values())]
        if not able:
            raise WorldError(
                f"none of {', '.join(among) or 'the robots'} can carry a {kind}: add a section [tool.NAME]"
            )
        return next((n for n in able if self._tools[p.start[n]].kind == kind), able[0])

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, ArrayLike] | None:
        """Return the signals of this tick; None after the last stage."""
        self._now = signals.now
        if next(self._script, "end") == "end":
            return None
        self._k += 1
        return self._said()

    def _said(self, still: bool = False) -> dict[str, ArrayLike]:
        out: dict[str, ArrayLike] = {"surgeon.stage": float(self._stage)}
        for name, p in self._at.items():
            out[f"{name}.target"] = p.copy() if still else p + self._shake[name].output(self._k)
        for name in self._arms:
            out |= {f"{name}.opening": self._opening[name], f"{name}.tool": float(self._tool[name])}
            out[f"{name}.pedal"] = self._pedal[name]
        return out

    # -- what the surgeon sees ---------------------------------------------------------------------------------

    def _line(self, vessel: str) -> Array:
        """Return the nodes (n + 1, 3) of a vessel's centre line as they are now."""
        rings = self._now[f"{vessel}.nodes"].reshape(-1, 2, 3, 3)
        return np.vstack([rings[:, 0, 0], rings[-1:, 1, 0]])

    def _place(self, vessel: str, s: float) -> tuple[Array, Array]:
        """Return the present point (3,) and direction (3,) of a vessel at arc length s in m of its rest shape."""
        line, v = self._line(vessel), self._vessels[vessel]
        k = int(np.clip(np.searchsorted(v.arc, s) - 1, 0, v.segments - 1))
        part = (s - v.arc[k]) / v.lengths[k]
        along = line[k + 1] - line[k]
        return line[k] + part * along, along / max(float(np.linalg.norm(along)), 1e-9)

    def _bed(self) -> Array:
        """Return the cells (n, 3) of the bed as they are now."""
        return self._now[f"{self._organ.name}.nodes"].reshape(-1, 3)[self._organ.held]

    def _inwards(self, robot: str, p: Array) -> Array:
        """Return the direction (3,) of a robot's shaft, from the port to the tip at p (3,), in the World."""
        way = p - (self._arms[robot].port if robot in self._arms else self._camera.port)
        return way / np.linalg.norm(way)

    def _aimed(self, p: Array) -> Array:
        return p + self.manner.aim * self._rng.normal(size=3)

    # -- actions: each generator yields once per tick ------------------------------------------------------------

    def _work(self) -> Iterator[None]:
        yield from self._wait(0.2)
        for k, stage in enumerate((self._expose, self._show, self._clip, self._cut, self._remove), 1):
            self._stage = k
            yield from stage()
        yield from self._wait(0.5)

    def _wait(self, seconds: float) -> Iterator[None]:
        for _ in range(max(1, round(seconds / TICK))):
            yield

    def _move(self, to: Mapping[str, Array], speed: float) -> Iterator[None]:
        """Move the tips to points (3,) in the World along straight lines; all tips arrive at the same time."""
        start = {n: self._at[n] for n in to}
        long = max(float(np.linalg.norm(p - start[n])) for n, p in to.items())
        k = max(1, round(max(0.2, long / speed) / TICK))
        for s in minimum_jerk(np.arange(1, k + 1) / k):
            for n, p in to.items():
                self._at[n] = start[n] + s * (p - start[n])
            yield

    def _to(self, robot: str, p: Array) -> Iterator[None]:
        """Approach a point along the shaft: quickly until shortly before the point, then slowly."""
        yield from self._move({robot: p - self.manner.before * self._inwards(robot, p)}, self.manner.quick)
        yield from self._move({robot: p}, self.manner.slow)

    def _back(self, robot: str) -> Iterator[None]:
        p = self._at[robot]
        yield from self._move({robot: p - self.manner.before * self._inwards(robot, p)}, self.manner.quick)

    def _snap(self, robot: str) -> Iterator[None]:
        """Close the jaws and open them again."""
        self._opening[robot] = 0.0
        yield from self._wait(self.manner.press)
        self._opening[robot] = 1.0
        yield from self._wait(self.manner.press)

    def _change(self, robot: str, kind: Kind) -> Iterator[None]:
        """Draw the tip back towards the port, and change the tool."""
        port, p = self._arms[robot].port, self._at[robot]
        yield from self._back(robot)
        out = port + 0.85 * self.procedure.change_mm * MM * self._inwards(robot, p)
        yield from self._move({robot: out}, self.manner.quick)
        names = [*self._tools]
        self._tool[robot] = next(
            k for k, n in enumerate(names) if self._tools[n].kind == kind and robot in self._tools[n].robots
        )
        yield from self._wait(0.5)

    def _expose(self) -> Iterator[None]:
        """Grasp the organ at its end away from the vessel, and lift it."""
        organ, holder, root = self._organ, self._holder, self._line(self.procedure.vessel)[0]
        for _ in range(_TRIES):
            now = organ.weights @ self._now[f"{organ.name}.nodes"].reshape(-1, 3)
            far = now - root
            high = now[:, 2] > np.quantile(now[:, 2], 0.8)  # the grasper comes from above
            point = now[np.flatnonzero(high)[np.argmax(np.linalg.norm(far[high], axis=1))]]
            yield from self._to(holder, self._aimed(point))
            self._opening[holder] = 0.0
            yield from self._wait(self.manner.press)
            if self._now[f"{holder}.holds"][0] == 0:
                break
            self._opening[holder] = 1.0
            yield from self._back(holder)
        else:
            self.missed.append("grasp")
        yield from self._move({holder: self._at[holder] + self.manner.lift}, self.manner.slow)

    def _show(self) -> Iterator[None]:
        """Move the endoscope to the vessel, and hold it there."""
        vessel = self._vessels[self.procedure.vessel]
        p, _ = self._place(vessel.name, vessel.arc[-1] / 2)
        name = self._camera.robot
        yield from self._move({name: p - self.manner.view * self._inwards(name, p)}, self.manner.quick)
        yield from self._wait(self.procedure.seen_s + 0.5)

    def _clip(self) -> Iterator[None]:
        p, manner, vessel = self.procedure, self.manner, self._vessels[self.procedure.vessel]
        if self.mistake == "organ_punctured":
            yield from self._puncture()
        if self.mistake == "wrong_vessel":
            other = next(v for v in self._vessels.values() if v.name != vessel.name)
            yield from self._close_at(other.name, 0.75 * other.arc[-1])
        places = [manner.kept * vessel.arc[-1] + k * manner.apart for k in range(p.clips_kept)]
        places += [manner.taken * vessel.arc[-1] - k * manner.apart for k in range(p.clips_taken)]
        for k, s in enumerate(places):
            if k == 0 and self.mistake == "clip_missed":
                yield from self._close_at(vessel.name, s, aside=9e-3)
                continue
            for _ in range(_TRIES):
                shut = self._shut()
                yield from self._close_at(vessel.name, s)
                if self._shut() > shut:
                    break
            else:
                self.missed.append(f"clip {k + 1}")

    def _shut(self) -> int:
        """Return the number of clips that are closed on a vessel."""
        names = [n for n in self._now if n.endswith(".cover")]
        return sum(float(self._now[n][0]) >= 1 - 1e-9 for n in names)

    def _close_at(self, vessel: str, s: float, aside: float = 0.0) -> Iterator[None]:
        """Move the middle of the jaws to s in m along a vessel, or `aside` in m beside it; close and open the jaws."""
        robot = self._worker
        point, along = self._place(vessel, s)
        tool = self._tools[[*self._tools][self._tool[robot]]]
        ahead = self._inwards(robot, point)
        beside = np.cross(ahead, along)
        tip = point + ahead * tool.jaw_mm / 2 * MM + aside * beside / np.linalg.norm(beside)
        yield from self._to(robot, self._aimed(tip))
        yield from self._snap(robot)
        yield from self._back(robot)

    def _cut(self) -> Iterator[None]:
        vessel, manner = self._vessels[self.procedure.vessel], self.manner
        yield from self._change(self._worker, "scissors")
        outside = manner.kept * vessel.arc[-1] + self.procedure.clips_kept * manner.apart
        s = outside if self.mistake == "cut_outside" else manner.cut * vessel.arc[-1]
        for _ in range(_TRIES):
            yield from self._close_at(vessel.name, s)
            if self._now[f"{vessel.name}.cut"].any():
                return
        self.missed.append("cut")

    def _remove(self) -> Iterator[None]:
        """Free the bed cell by cell, from the instrument's side on; lift the organ at each cell; remove the organ."""
        robot, holder, organ = self._worker, self._holder, self._organ.name
        yield from self._change(robot, "cautery")
        order = np.argsort(np.linalg.norm(self._bed() - self._arms[robot].port, axis=1))
        left = order[:-1] if self.mistake == "bed_left" else order
        for cell in left.tolist():
            for _ in range(_TRIES):
                yield from self._to(robot, self._aimed(self._bed()[cell]))
                self._pedal[robot] = 1.0
                long = self.procedure.bed_j / max(t.power_w or 0.0 for t in self._tools.values())
                yield from self._wait(long + 0.2)
                self._pedal[robot] = 0.0
                yield from self._wait(TICK)
                if self._now[f"{organ}.freed"][cell] > 0.5:
                    break
            else:
                self.missed.append(f"cell {cell + 1} of the bed")
            yield from self._move({holder: self._at[holder] + self.manner.peel}, self.manner.slow)
            yield from self._back(robot)
        yield from self._back(robot)
        port = self._arms[holder].port
        out = port + 0.5 * self.procedure.out_mm * MM * self._inwards(holder, self._at[holder])
        yield from self._move({holder: out}, self.manner.quick)
        yield from self._wait(1.0)

    def _puncture(self) -> Iterator[None]:
        """Push the tip into the first organ to be spared, far deeper than allowed."""
        robot, port = self._worker, self._arms[self._worker].port
        v = self._spared.surface.vertices
        top = v[v[:, 2] > v[:, 2].max() - 5 * MM].mean(axis=0)
        deep = top + 3 * self.procedure.depth_mm * MM * (top - port) / np.linalg.norm(top - port)
        yield from self._move({robot: top - self.manner.before * self._inwards(robot, top)}, self.manner.quick)
        yield from self._move({robot: deep}, self.manner.slow)
        yield from self._back(robot)
        yield from self._back(robot)
