"""A simulated surgeon who removes an organ in five stages, with assistants who hold the grasper and the endoscope.

The hands move along straight lines with minimum jerk, aim with an error, and tremble. The surgeon sees the organ, its
bed and the vessels at the start of each movement, and repeats failed attempts. All habits are ASSUMED.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike

from twin.core.errors import WorldError, unknown
from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.scene import Place
from twin.model.tool import Kind
from twin.simulation import operating_scene
from twin.simulation.console_scene import start
from twin.simulation.devices.hand import HandMotion, Tremor, minimum_jerk
from twin.simulation.plants.tissue.operating import Grasped
from twin.simulation.procedure_scene import TICK
from twin.simulation.setup import Member, Setup
from twin.simulation.tasks.procedure.task import KIND, Mistake
from twin.simulation.world import Block, Signals
from twin.simulation.world.signal_kinds import (
    CLIP_COVER,
    ORGAN_FREED,
    ORGAN_NODES,
    ROBOT_HOLDS,
    ROBOT_OPENING,
    ROBOT_PEDAL,
    ROBOT_TIP_TARGET,
    ROBOT_TOOL,
    SURGEON_STAGE,
    VESSEL_CUT,
    VESSEL_NODES,
)

_TRIES = 3
"""Number of attempts at a grasp, a clip, a cut or a cell of the bed before the surgeon goes on."""


@dataclass(frozen=True)
class ProcedureHabits:
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

    hand: HandMotion = field(default_factory=lambda: HandMotion(tremor=0.1e-3))
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
class SurgeonArm:
    """A robot that the surgeon moves: its name; its port (3,) and the tip (3,) at the start, in m in the World."""

    robot: str
    port: Array
    tip: Array


def _arm(place: Place, member: Member) -> SurgeonArm:
    T = place.T_world_base @ member.kin.forward(start(place, member.mechanism))
    return SurgeonArm(place.name, operating_scene.port_of(place), T[:3, 3])


class ProcedureSurgeon(Block):
    """Writes `<robot>.target` of all robots, `.opening`, `.tool` and `.pedal` of robots with tools, `surgeon.stage`.

    Attributes:
        missed: names of the steps that the surgeon gave up.
    """

    def __init__(
        self, setup: Setup, seed: int = 0, mistake: Mistake = "", manner: ProcedureHabits | None = None
    ) -> None:
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
            raise WorldError(unknown("mistake", mistake, KIND.mistakes))
        scene = setup.scene
        self.procedure = operating_scene.procedure_of(scene, setup.task)
        self.manner = manner or ProcedureHabits()
        self.mistake = mistake
        self._rng = np.random.default_rng(seed)
        everyone = []
        for place in operating_scene.robots_of(setup):
            everyone.append(_arm(place, setup.members[place.name]))
        self._camera = everyone[-1]
        self._arms = {arm.robot: arm for arm in everyone[:-1]}
        self._tools = dict(scene.tools)
        self._organ = operating_scene.organ_of(setup)
        self._spared = next(organ for organ in setup.organs if organ.name == self.procedure.spare[0])
        self._vessels = {vessel.name: vessel for vessel in scene.vessels}
        self._holder = self._carrier("grasper", list(self._arms))
        # the grasper holds the organ while the other robot works
        others = list(self._arms)
        others.remove(self._holder)
        self._worker = self._carrier("clip_applier", others)
        for kind in ("scissors", "cautery"):
            if self._carrier(kind, others) != self._worker:
                raise WorldError(f"{self._worker} cannot carry {kind}; add {self._worker} to `robots` of such a tool")
        self._at: dict[str, Array] = {}  # tips in m in the World
        self._tremors: dict[str, Tremor] = {}
        for arm in everyone:
            self._at[arm.robot] = arm.tip.copy()
            self._tremors[arm.robot] = Tremor(self._rng, self.manner.hand, TICK)
        self._tool_names = list(self._tools)
        self._tool: dict[str, int] = {}  # index of the present tool
        for robot in self._arms:
            self._tool[robot] = self._tool_names.index(self.procedure.start[robot])
        self._opening = dict.fromkeys(self._arms, 1.0)
        self._pedal = dict.fromkeys(self._arms, 0.0)
        self._stage = 0
        self._k = 0
        self.missed: list[str] = []
        self._script = self._work()
        self.outputs = self._output_signals(without_tremor=True)

    def _carrier(self, kind: Kind, among: Sequence[str]) -> str:
        """Return the robot for a kind of tool: the one with it at the start, else the first that can carry it."""
        able = []
        for robot in among:
            if self._can_carry(robot, kind):
                able.append(robot)
        if not able:
            robots = ", ".join(among) or "the robots"
            raise WorldError(f"none of {robots} can carry a {kind}: add a section [tool.NAME]")
        for robot in able:
            if self._tools[self.procedure.start[robot]].kind == kind:
                return robot
        return able[0]

    def _can_carry(self, robot: str, kind: Kind) -> bool:
        return any(tool.kind == kind and robot in tool.robots for tool in self._tools.values())

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, ArrayLike] | None:
        """Return the signals of this tick; None after the last stage."""
        self._now = signals.now
        finished = object()
        if next(self._script, finished) is finished:
            return None
        self._k += 1
        return self._output_signals()

    def _output_signals(self, without_tremor: bool = False) -> dict[str, ArrayLike]:
        """Return the signals, with the hands' tremor or without it."""
        values: dict[str, ArrayLike] = {SURGEON_STAGE.name: float(self._stage)}
        for robot, p in self._at.items():
            if without_tremor:
                values[ROBOT_TIP_TARGET.of(robot)] = p.copy()
            else:
                values[ROBOT_TIP_TARGET.of(robot)] = p + self._tremors[robot].output(self._k)
        for robot in self._arms:
            values[ROBOT_OPENING.of(robot)] = self._opening[robot]
            values[ROBOT_TOOL.of(robot)] = float(self._tool[robot])
            values[ROBOT_PEDAL.of(robot)] = self._pedal[robot]
        return values

    # -- what the surgeon sees ---------------------------------------------------------------------------------

    def _line(self, vessel: str) -> Array:
        """Return the nodes (n + 1, 3) of a vessel's centre line as they are now."""
        rings = self._now[VESSEL_NODES.of(vessel)].reshape(-1, 2, 3, 3)
        return np.vstack([rings[:, 0, 0], rings[-1:, 1, 0]])

    def _place(self, vessel: str, s: float) -> tuple[Array, Array]:
        """Return the present point (3,) and direction (3,) of a vessel at arc length s in m of its rest shape."""
        line = self._line(vessel)
        v = self._vessels[vessel]
        k = int(np.clip(np.searchsorted(v.arc, s) - 1, 0, v.segments - 1))
        fraction = (s - v.arc[k]) / v.lengths[k]
        along = line[k + 1] - line[k]
        length = max(float(np.linalg.norm(along)), 1e-9)  # not 0, by which it is divided
        return line[k] + fraction * along, along / length

    def _bed(self) -> Array:
        """Return the cells (n, 3) of the bed as they are now."""
        nodes = self._now[ORGAN_NODES.of(self._organ.name)].reshape(-1, 3)
        return nodes[self._organ.pinned_nodes]

    def _inwards(self, robot: str, p: Array) -> Array:
        """Return the direction (3,) of a robot's shaft, from the port to the tip at p (3,), in the World."""
        arm = self._arms.get(robot, self._camera)
        along_shaft = p - arm.port
        return along_shaft / np.linalg.norm(along_shaft)

    def _aimed(self, p: Array) -> Array:
        return p + self.manner.aim * self._rng.normal(size=3)

    # -- actions: each generator yields once per tick ------------------------------------------------------------

    def _work(self) -> Iterator[None]:
        yield from self._wait(0.2)
        stages = (self._expose, self._show, self._clip, self._cut, self._remove)
        for k, stage in enumerate(stages, 1):
            self._stage = k
            yield from stage()
        yield from self._wait(0.5)

    def _wait(self, seconds: float) -> Iterator[None]:
        for _ in range(max(1, round(seconds / TICK))):
            yield

    def _move(self, to: Mapping[str, Array], speed: float) -> Iterator[None]:
        """Move the tips to points (3,) in the World along straight lines; all tips arrive at the same time."""
        start = {}
        longest = 0.0
        for robot, p in to.items():
            start[robot] = self._at[robot]
            longest = max(longest, float(np.linalg.norm(p - start[robot])))
        duration = max(0.2, longest / speed)  # a short movement takes time, too
        ticks = max(1, round(duration / TICK))
        for s in minimum_jerk(np.arange(1, ticks + 1) / ticks):
            for robot, p in to.items():
                self._at[robot] = start[robot] + s * (p - start[robot])
            yield

    def _to(self, robot: str, p: Array) -> Iterator[None]:
        """Approach a point along the shaft: quickly until shortly before the point, then slowly."""
        approach_point = p - self.manner.before * self._inwards(robot, p)
        yield from self._move({robot: approach_point}, self.manner.quick)
        yield from self._move({robot: p}, self.manner.slow)

    def _back(self, robot: str) -> Iterator[None]:
        p = self._at[robot]
        drawn_back = p - self.manner.before * self._inwards(robot, p)
        yield from self._move({robot: drawn_back}, self.manner.quick)

    def _snap(self, robot: str) -> Iterator[None]:
        """Close the jaws and open them again."""
        self._opening[robot] = 0.0
        yield from self._wait(self.manner.press)
        self._opening[robot] = 1.0
        yield from self._wait(self.manner.press)

    def _change(self, robot: str, kind: Kind) -> Iterator[None]:
        """Draw the tip back towards the port, and change the tool."""
        port = self._arms[robot].port
        p = self._at[robot]
        yield from self._back(robot)
        near_port = port + 0.85 * self.procedure.change_mm * MM * self._inwards(robot, p)
        yield from self._move({robot: near_port}, self.manner.quick)
        for k, tool in enumerate(self._tools.values()):
            if tool.kind == kind and robot in tool.robots:
                self._tool[robot] = k
                break
        yield from self._wait(0.5)

    def _expose(self) -> Iterator[None]:
        """Grasp the organ at its end away from the vessel, and lift it."""
        organ = self._organ
        holder = self._holder
        root = self._line(self.procedure.vessel)[0]
        for _ in range(_TRIES):
            vertices = organ.weights @ self._now[ORGAN_NODES.of(organ.name)].reshape(-1, 3)
            heights = vertices[:, 2]
            high = np.flatnonzero(heights > np.quantile(heights, 0.8))  # the grasper comes from above
            distances = np.linalg.norm(vertices[high] - root, axis=1)
            point = vertices[high[np.argmax(distances)]]
            yield from self._to(holder, self._aimed(point))
            self._opening[holder] = 0.0
            yield from self._wait(self.manner.press)
            if self._now[ROBOT_HOLDS.of(holder)][0] == Grasped.ORGAN:
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
        viewpoint = p - self.manner.view * self._inwards(name, p)
        yield from self._move({name: viewpoint}, self.manner.quick)
        yield from self._wait(self.procedure.seen_s + 0.5)

    def _clip(self) -> Iterator[None]:
        manner = self.manner
        vessel = self._vessels[self.procedure.vessel]
        length = vessel.arc[-1]
        if self.mistake == "organ_punctured":
            yield from self._puncture()
        if self.mistake == "wrong_vessel":
            other_vessel = next(candidate for candidate in self._vessels.values() if candidate.name != vessel.name)
            yield from self._close_at(other_vessel.name, 0.75 * other_vessel.arc[-1])
        places = []
        for k in range(self.procedure.clips_kept):
            places.append(manner.kept * length + k * manner.apart)
        for k in range(self.procedure.clips_taken):
            places.append(manner.taken * length - k * manner.apart)
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
        count = 0
        for name, value in self._now.items():
            if CLIP_COVER.owner_of(name) is not None and float(value[0]) >= 1 - 1e-9:
                count += 1
        return count

    def _close_at(self, vessel: str, s: float, aside: float = 0.0) -> Iterator[None]:
        """Move the middle of the jaws to s in m along a vessel, or `aside` in m beside it; close and open the jaws."""
        robot = self._worker
        point, along = self._place(vessel, s)
        tool = self._tools[self._tool_names[self._tool[robot]]]
        inwards = self._inwards(robot, point)
        beside = np.cross(inwards, along)
        tip = point + inwards * tool.jaw_mm / 2 * MM + aside * beside / np.linalg.norm(beside)
        yield from self._to(robot, self._aimed(tip))
        yield from self._snap(robot)
        yield from self._back(robot)

    def _cut(self) -> Iterator[None]:
        vessel = self._vessels[self.procedure.vessel]
        manner = self.manner
        yield from self._change(self._worker, "scissors")
        s = manner.cut * vessel.arc[-1]
        if self.mistake == "cut_outside":
            s = manner.kept * vessel.arc[-1] + self.procedure.clips_kept * manner.apart
        for _ in range(_TRIES):
            yield from self._close_at(vessel.name, s)
            if self._now[VESSEL_CUT.of(vessel.name)].any():
                return
        self.missed.append("cut")

    def _remove(self) -> Iterator[None]:
        """Free the bed cell by cell, from the instrument's side on; lift the organ at each cell; remove the organ."""
        robot = self._worker
        holder = self._holder
        organ = self._organ.name
        yield from self._change(robot, "cautery")
        distances = np.linalg.norm(self._bed() - self._arms[robot].port, axis=1)
        cells = np.argsort(distances)
        if self.mistake == "bed_left":
            cells = cells[:-1]
        power = 0.0
        for tool in self._tools.values():
            power = max(power, tool.power_w or 0.0)
        heating_time = self.procedure.bed_j / power
        for cell in cells.tolist():
            for _ in range(_TRIES):
                yield from self._to(robot, self._aimed(self._bed()[cell]))
                self._pedal[robot] = 1.0
                yield from self._wait(heating_time + 0.2)
                self._pedal[robot] = 0.0
                yield from self._wait(TICK)
                if self._now[ORGAN_FREED.of(organ)][cell] > 0.5:
                    break
            else:
                self.missed.append(f"cell {cell + 1} of the bed")
            yield from self._move({holder: self._at[holder] + self.manner.peel}, self.manner.slow)
            yield from self._back(robot)
        yield from self._back(robot)
        port = self._arms[holder].port
        removed = port + 0.5 * self.procedure.out_mm * MM * self._inwards(holder, self._at[holder])
        yield from self._move({holder: removed}, self.manner.quick)
        yield from self._wait(1.0)

    def _puncture(self) -> Iterator[None]:
        """Push the tip into the first organ to be spared, far deeper than allowed."""
        robot = self._worker
        port = self._arms[robot].port
        vertices = self._spared.surface.vertices
        heights = vertices[:, 2]
        top = vertices[heights > heights.max() - 5 * MM].mean(axis=0)
        deep = top + 3 * self.procedure.depth_mm * MM * (top - port) / np.linalg.norm(top - port)
        approach_point = top - self.manner.before * self._inwards(robot, top)
        yield from self._move({robot: approach_point}, self.manner.quick)
        yield from self._move({robot: deep}, self.manner.slow)
        yield from self._back(robot)
        yield from self._back(robot)
