"""Operate on an organ in a World: instruments with tools grasp, clip, cut and cauterise.

The effect of a tool depends on its position: a clip closes the part of a vessel's width between its legs; scissors cut
the vessel between their blades; cautery heats the cells of the bed near its tip.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from twin.core import spatial
from twin.core.errors import WorldError
from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.body import Frame
from twin.model.movable import Movable
from twin.model.procedure import ProcedureTable
from twin.model.surface import inside, nearest
from twin.model.tissue import Tissue
from twin.model.tool import ToolTable
from twin.model.vessel import Vessel
from twin.simulation.plants.tissue.bed import Hold
from twin.simulation.plants.tissue.organs import PERIOD
from twin.simulation.plants.tissue.plant import Links, Tissues
from twin.simulation.plants.tissue.sight import Sight
from twin.simulation.plants.tissue.tubes import Held, Tube
from twin.simulation.world import Signals

UNUSED, ON_NOTHING = -2, -1
"""Values of `clip_<k>.on` for a clip that is still in its applier, and for one that was closed around no vessel."""

_CLIP = (0.75 * MM, 0.75 * MM)
"""Half the width and half the height of a clip in m, across its length; ASSUMED."""

_APART = 1.0 * MM
"""Minimum distance in m along a vessel from a cut to a clip, because blades do not cut a clip."""

_TORN = 10 * MM
"""Distance in m by which a held point slips before the jaws lose it; ASSUMED."""

_LOOK = 12
"""Number of steps between two updates of `<vessel>.seen`."""


@dataclass(frozen=True)
class Instrument:
    """A robot that carries tools.

    Attributes:
        links: the links of the robot that touch organs.
        tip: frame of the tip; z is along the shaft and points out of the instrument.
        port: (3,) position of the robot's port in the World in m.
        tool: name of the tool that the robot carries at the start.
    """

    links: Links
    tip: Frame
    port: Array
    tool: str

    @property
    def robot(self) -> str:
        """Name of the robot."""
        return self.links.signal.removesuffix(".q")

    def T_world_tip(self) -> Array:  # noqa: N802
        """Return the pose (4, 4) of the tip in the World at the latest joint values."""
        return self.links.pose(self.tip.body) @ self.tip.T_body_frame


@dataclass
class _State:
    """State of an instrument: tool, whether jaws are open, what they hold (-1: nothing, 0: organ, k: k-th vessel)."""

    tool: str
    T: Array
    opened: bool = True
    holds: int = -1
    rest: Array = field(default_factory=lambda: np.zeros(3))


@dataclass
class _Clip:
    on: int = UNUSED
    at: float = 0.0
    cover: float = 0.0
    T: Array | None = None


def clips_of(tools: Mapping[str, ToolTable]) -> list[Movable]:
    """Return the clips of all appliers, at the origin of the World."""
    out: list[Movable] = []
    for tool in tools.values():
        size = (*_CLIP, (tool.jaw_mm / 2) * MM)
        out += [
            Movable(f"clip_{len(out) + 1 + k}", "box", size, 1e-4, 0.2, color_rgba=(0.75, 0.75, 0.8, 1.0))
            for k in range(tool.clips or 0)
        ]
    return out


class Operating(Tissues):
    """Writes the signals of `Tissues`, and the effects of tools. A grasper holds the organ or a vessel by friction.

    Signals that it reads, besides `<robot>.q`:
        `<robot>.opening`: opening of the jaws, 0 (closed) to 1. A tool acts when the opening falls to 0.5 or less.
        `<robot>.tool`: index of the requested tool, in the order of the scene.
        `<robot>.pedal`: 1 while cautery is on.

    Signals that it writes:
        `<robot>.tip` (3,): tip in the World in m.
        `<robot>.carries`: index of the tool that the robot carries.
        `<robot>.holds`: what the jaws hold: -1 nothing, 0 the organ, 1 the first vessel, 2 the second, and so on.
        `<robot>.pull` (3,): force in N on what the jaws hold.
        `<robot>.slipped`: slip of the held point in m.
        `<robot>.lifted` (3,): displacement in m of the held point from its rest position.
        `<organ>.energy` (n,): energy in J applied to each cell of the bed.
        `<organ>.freed` (n,): 1: the cell of the bed is free.
        `<organ>.depth`: depth in m of the deepest tip below the rest surface of an organ that must be spared.
        `<vessel>.nodes`: nodes of the vessel's deformable in the World in m.
        `<vessel>.cut` (n,): 1: the segment is cut away.
        `<vessel>.seen`: fraction of the vessel that the camera sees.
        `clip_<k>.pose` (16,): pose of the clip in the World, row by row.
        `clip_<k>.on`: index of the clip's vessel; -1: the clip is on no vessel; -2: the clip is not used yet.
        `clip_<k>.at`: position of the clip along the vessel in m.
        `clip_<k>.cover`: fraction of the vessel's width between the legs of the clip; at 1 the vessel is closed.
    """

    def __init__(
        self,
        tissues: Sequence[Tissue],
        robots: Sequence[Links],
        instruments: Sequence[Instrument],
        vessels: Sequence[Vessel],
        tools: Mapping[str, ToolTable],
        procedure: ProcedureTable,
        sight: Sight,
        period: float = PERIOD,
    ) -> None:
        """Start with open jaws.

        Raises:
            WorldError: as `Tissues`; or a vessel does not begin at its organ, or belongs to an organ that is not
                operated on.
        """
        self._instruments, self._tools, self._procedure = tuple(instruments), dict(tools), procedure
        self._names, self._sight, self._steps = [*tools], sight, 0
        self._organ = next(t for t in tissues if t.name == procedure.organ)
        self._spared = [t for t in tissues if t.name in procedure.spare]
        self._energy, self._freed = (np.zeros(len(self._organ.held)) for _ in range(2))
        self._tubes = [Tube(v, period) for v in vessels]
        self._roots = [self._root(v) for v in vessels]
        self._states = {i.robot: _State(i.tool, i.T_world_tip()) for i in instruments}
        self._clips = [_Clip() for _ in clips_of(tools)]
        self._depths = dict.fromkeys(procedure.spare, 0.0)
        self._seen, self.period = 0.0, period
        self._at = dict[int, Array]()
        super().__init__(tissues, robots, period, procedure.organ)

    def step(self, signals: Signals, t: float, dt: float) -> Mapping[str, ArrayLike]:
        """Move instruments and organs, and compute the effects of the tools."""
        hold = self._hold
        for k, i in enumerate(self._instruments):
            self._use(k, i, signals)
        for tube, root in zip(self._tubes, self._roots, strict=True):
            if root is not None:
                hold.pull(root, tube.reaction)
        super().step(signals, t, dt)
        nodes = self.organs.nodes[self._organ.name]
        for tube, root in zip(self._tubes, self._roots, strict=True):
            tube.step(tube.points[0] if root is None else root @ nodes)
        for k, i in enumerate(self._instruments):
            self._after(k, i)
        if self._steps % _LOOK == 0:
            surfaces = [(self.organs.vertices(t.name), t.surface.triangles) for t in self.organs.tissues]
            tube = next(x for x in self._tubes if x.vessel.name == self._procedure.vessel)
            self._seen = self._sight.seen(tube.points[3:-1], surfaces)
        self._steps += 1
        return self._signals()

    @property
    def _hold(self) -> Hold:
        organ = self.organs.operable
        assert organ is not None
        assert organ.hold is not None
        return organ.hold

    def _root(self, v: Vessel) -> Array | None:
        """Return the weights (k,) of the organ's nodes at a vessel's first point; None: the vessel is on no organ."""
        if not v.organ:
            return None
        if v.organ != self._organ.name:
            raise WorldError(f"vessel '{v.name}' is on '{v.organ}'; only '{self._organ.name}' is operated on")
        p, weights = self._surface_point(v.points[0], self._organ.nodes)
        if (far := float(np.linalg.norm(p - v.points[0]))) > v.radius:
            raise WorldError(
                f"vessel '{v.name}' begins {far / MM:.1f} mm from '{v.organ}'; begin it on the surface, within its "
                f"radius of {v.radius / MM:g} mm"
            )
        return weights

    def _surface_point(self, p: Array, nodes: Array) -> tuple[Array, Array]:
        """Return the point (3,) of the organ's surface nearest to p (3,), and the weights (k,) of the nodes there."""
        organ = self._organ
        point, triangle, shares = nearest(p, organ.weights @ nodes, organ.surface.triangles)
        return point, shares @ organ.weights[organ.surface.triangles[triangle]]

    # -- tools -----------------------------------------------------------------------------------------------

    def _use(self, k: int, i: Instrument, signals: Signals) -> None:
        """Change the tool, move the jaws, or apply the cautery of instrument k, as the signals request."""
        state, robot = self._states[i.robot], i.robot
        i.links.poses(signals.now[i.links.signal])
        T = state.T = i.T_world_tip()
        wanted = self._names[int(np.clip(signals.now[f"{robot}.tool"][0], 0, len(self._names) - 1))]
        drawn_back = np.linalg.norm(T[:3, 3] - i.port) <= self._procedure.change_mm * MM
        if wanted != state.tool and state.holds < 0 and drawn_back and robot in self._tools[wanted].robots:
            state.tool = wanted
        tool, opened = self._tools[state.tool], bool(signals.now[f"{robot}.opening"][0] > 0.5)
        if state.opened and not opened:
            match tool.kind:
                case "grasper":
                    self._grasp(k, state, tool)
                case "clip_applier":
                    self._clip(state, tool)
                case "scissors" | "scalpel":
                    self._cut(state, tool)
                case "cautery":
                    pass
        elif opened and not state.opened:
            self._open(k, i, state)
        state.opened = opened
        if tool.kind == "cautery" and signals.now[f"{robot}.pedal"][0] > 0.5:
            self._burn(T[:3, 3], tool)
        if state.holds >= 0:
            held = self._hold.grips[k] if state.holds == 0 else self._tubes[state.holds - 1].held[k]
            held.p = held.p + T[:3, 3] - self._at[k]
            self._at[k] = T[:3, 3].copy()

    def _grasp(self, k: int, state: _State, tool: ToolTable) -> None:
        """Hold the point of organ or vessel nearest to the tip, if its distance is at most half the gap of the jaws."""
        assert tool.open_mm is not None
        tip, reach = state.T[:3, 3], tool.open_mm / 2 * MM
        nodes = self.organs.nodes[self._organ.name]
        p, weights = self._surface_point(tip, nodes)
        best = float(np.linalg.norm(p - tip))
        holds, at = 0 if best <= reach else -1, 0
        for v, tube in enumerate(self._tubes):
            far = np.linalg.norm(tube.points - tip, axis=1)
            node = int(np.argmin(far))
            if 0 < node < len(far) - 1 and far[node] < min(best, reach):
                best, holds, at = float(far[node]), v + 1, node
        if holds == 0:
            self._hold.grasp(k, weights, p, tool.slips_at)
            state.rest = weights @ self._organ.nodes
            self.organs.mute(self._instruments[k].robot, True)
        elif holds > 0:
            tube = self._tubes[holds - 1]
            tube.held[k] = Held(at, tube.points[at].copy(), tool.slips_at, np.zeros(3))
            state.rest = tube.vessel.points[at]
        state.holds, self._at[k] = holds, tip.copy()

    def _open(self, k: int, i: Instrument, state: _State) -> None:
        if state.holds == 0:
            self._hold.release(k)
            self.organs.mute(i.robot, False)
        elif state.holds > 0:
            del self._tubes[state.holds - 1].held[k]
        state.holds = -1

    def _between(self, state: _State, tool: ToolTable) -> tuple[int, float, float]:
        """Return (index of the vessel between the jaws, position along it in m, fraction of its width in the jaws).

        A vessel is between the jaws if the distance from the vessel's centre line to the middle line of the jaws is at
        most half of the gap of the jaws.
        """
        assert tool.open_mm is not None
        tip, z, long = state.T[:3, 3], state.T[:3, 2], tool.jaw_mm * MM
        best = (ON_NOTHING, 0.0, 0.0)
        for v, tube in enumerate(self._tubes):
            far, along, at, sine = tube.crossed(tip - long * z, tip)
            if far > tool.open_mm / 2 * MM:
                continue
            half = tube.vessel.radius / sine
            cover = (min(along + half, long) - max(along - half, 0.0)) / (2 * half)
            if cover > best[2]:
                best = (v, at, cover)
        return best

    def _clip(self, state: _State, tool: ToolTable) -> None:
        """Close the next clip."""
        clip = next((c for c in self._clips if c.on == UNUSED), None)
        if clip is None:
            return
        clip.on, clip.at, clip.cover = self._between(state, tool)
        clip.T = state.T @ spatial.pose(p=[0, 0, -tool.jaw_mm / 2 * MM])
        if clip.on >= 0:
            tube = self._tubes[clip.on]
            node = int(np.argmin(np.abs(tube.vessel.arc - clip.at)))
            tube.flat[node] = max(tube.flat[node], clip.cover)
            tube.across = state.T[:3, 0].copy()
            clip.T[:3, 3] = tube.at(clip.at)

    def _cut(self, state: _State, tool: ToolTable) -> None:
        """Cut the vessel between the blades, if all of its width is between them and no clip is in the way."""
        v, at, cover = self._between(state, tool)
        if v < 0 or cover < 1.0 - 1e-9:
            return
        if all(c.on != v or abs(c.at - at) >= _APART for c in self._clips):
            self._tubes[v].sever(at)

    def _burn(self, tip: Array, tool: ToolTable) -> None:
        """Heat the cell of the bed nearest to the tip; free the cell when its energy reaches the procedure's limit."""
        nodes = self.organs.nodes[self._organ.name][self._organ.held]
        far = np.linalg.norm(nodes - tip, axis=1)
        far[self._freed > 0.5] = np.inf
        cell = int(np.argmin(far))
        if far[cell] <= tool.jaw_mm * MM:
            self._energy[cell] += (tool.power_w or 0.0) * self.period
            if self._energy[cell] >= self._procedure.bed_j:
                self._freed[cell] = 1.0
                self._hold.let_go(int(self._organ.held[cell]))

    def _after(self, k: int, i: Instrument) -> None:
        """Release a point that has slipped out of the jaws, and measure the depth of the tip in organs to be spared."""
        state = self._states[i.robot]
        if self._slipped(k, state) > _TORN:
            self._open(k, i, state)
        if k == 0:
            self._depths = dict.fromkeys(self._depths, 0.0)
        for t in self._spared:
            tip = state.T[None, :3, 3]
            if inside(tip, t.surface.vertices, t.surface.triangles)[0]:
                p, _, _ = nearest(tip[0], t.surface.vertices, t.surface.triangles)
                self._depths[t.name] = max(self._depths[t.name], float(np.linalg.norm(p - tip[0])))

    def _slipped(self, k: int, state: _State) -> float:
        if state.holds == 0:
            return self._hold.grips[k].slipped
        return self._tubes[state.holds - 1].held[k].slipped if state.holds > 0 else 0.0

    # -- signals ---------------------------------------------------------------------------------------------

    def _signals(self) -> dict[str, ArrayLike]:
        out = super()._signals()
        nodes = self.organs.nodes[self._organ.name]
        for k, i in enumerate(self._instruments):
            state, name = self._states[i.robot], i.robot
            pull, lifted = np.zeros(3), np.zeros(3)
            if state.holds == 0:
                grip = self._hold.grips[k]
                pull, lifted = grip.force, grip.weights @ nodes - state.rest
            elif state.holds > 0:
                tube = self._tubes[state.holds - 1]
                held = tube.held[k]
                pull, lifted = held.force, tube.points[held.node] - state.rest
            out |= {f"{name}.tip": state.T[:3, 3], f"{name}.carries": float(self._names.index(state.tool))}
            out |= {f"{name}.holds": float(state.holds), f"{name}.pull": pull, f"{name}.lifted": lifted}
            out[f"{name}.slipped"] = self._slipped(k, state)
        organ = self._organ.name
        out |= {f"{organ}.energy": self._energy.copy(), f"{organ}.freed": self._freed.copy()}
        out |= {f"{name}.depth": depth for name, depth in self._depths.items()}
        for tube in self._tubes:
            name = tube.vessel.name
            out |= {f"{name}.nodes": tube.nodes().ravel(), f"{name}.cut": tube.cut.astype(float)}
        out[f"{self._procedure.vessel}.seen"] = self._seen
        applier = next(
            (i for i in self._instruments if self._tools[self._states[i.robot].tool].kind == "clip_applier"), None
        )
        left = 0
        for k, clip in enumerate(self._clips, 1):
            out |= {f"clip_{k}.on": float(clip.on), f"clip_{k}.at": clip.at, f"clip_{k}.cover": clip.cover}
            if clip.on >= 0 and clip.T is not None:
                clip.T[:3, 3] = self._tubes[clip.on].at(clip.at)
            T = clip.T
            if T is None:
                i = applier or self._instruments[0]
                state = self._states[i.robot]
                T = state.T @ spatial.pose(p=[0, 0, -(30 + 11 * left) * MM])  # in the tube of the applier
                left += 1
            out[f"clip_{k}.pose"] = T.ravel()
        return out
