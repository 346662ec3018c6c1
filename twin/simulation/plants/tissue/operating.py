"""Operate on an organ in a World: instruments with tools grasp, clip, cut and cauterise.

The effect of a tool depends on its position: a clip closes the part of a vessel's width between its legs; scissors cut
the vessel between their blades; cautery heats the cells of the bed near its tip.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike

from twin.core import spatial
from twin.core.errors import WorldError
from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.body import Frame
from twin.model.movable import Movable
from twin.model.surface import inside, nearest
from twin.model.tissue import Tissue
from twin.model.tool import ToolTable
from twin.model.vessel import Vessel
from twin.simulation.plants.tissue.bed import Grip, Hold
from twin.simulation.plants.tissue.organs import PERIOD
from twin.simulation.plants.tissue.plant import Links, Tissues
from twin.simulation.plants.tissue.sight import Sight
from twin.simulation.plants.tissue.tubes import Held, Tube
from twin.simulation.tasks.procedure.task import ProcedureTable
from twin.simulation.world import Signals
from twin.simulation.world.signal_kinds import (
    ORGAN_DEPTH,
    ORGAN_ENERGY,
    ORGAN_FREED,
    ROBOT_CARRIES,
    ROBOT_HOLDS,
    ROBOT_LIFTED,
    ROBOT_OPENING,
    ROBOT_PEDAL,
    ROBOT_PULL,
    ROBOT_SLIPPED,
    ROBOT_TIP,
    ROBOT_TOOL,
    VESSEL_CUT,
    VESSEL_NODES,
    VESSEL_SEEN,
)


class ClipPlace(IntEnum):
    """Values of `clip_<k>.on` for a clip on no vessel; other values are the index of the clip's vessel."""

    UNUSED = -2
    """The clip is still in its applier."""
    ON_NOTHING = -1
    """The clip was closed around no vessel."""


class Grasped(IntEnum):
    """Values of `<robot>.holds`; a value k above 0 is the k-th vessel."""

    NOTHING = -1
    ORGAN = 0


_CLIP_HALF_SIZE = (0.75 * MM, 0.75 * MM)
"""Half the width and half the height of a clip in m, across its length; ASSUMED."""

_CLIP_DISTANCE = 1.0 * MM
"""Minimum distance in m along a vessel from a cut to a clip, because blades do not cut a clip."""

_WHOLE_WIDTH = 1.0 - 1e-9
"""Fraction of a vessel's width that counts as all of it: fractions are rounded."""

_LARGEST_SLIP = 10 * MM
"""Distance in m by which a held point slips before the jaws lose it; ASSUMED."""

_FIRST_CLIP = 30
_CLIP_SPACING = 11
"""Distances in mm, as drawn: from the tip of the applier to the first clip in it, and from clip to clip."""

_STEPS_PER_LOOK = 12
"""Number of steps between two updates of `<vessel>.seen`."""


@dataclass(frozen=True)
class OperatingRobot:
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
    """State of an instrument.

    Attributes:
        tool: name of the tool.
        T: (4, 4) pose of the tip in the World.
        opened: whether the jaws are open.
        holds: what the jaws hold; a value of `Grasped`, or k for the k-th vessel.
        rest: (3,) rest position of the held point in m.
    """

    tool: str
    T: Array
    opened: bool = True
    holds: int = Grasped.NOTHING
    rest: Array = field(default_factory=lambda: np.zeros(3))


@dataclass
class _Clip:
    """State of a clip; see the signals of `Operating`. T: (4, 4) pose in the World; None: still in its applier."""

    on: int = ClipPlace.UNUSED
    at: float = 0.0
    cover: float = 0.0
    T: Array | None = None


def clips_of(tools: Mapping[str, ToolTable]) -> list[Movable]:
    """Return the clips of all appliers, at the origin of the World."""
    clips: list[Movable] = []
    for tool in tools.values():
        half_length = (tool.jaw_mm / 2) * MM
        for _ in range(tool.clips or 0):
            name = f"clip_{len(clips) + 1}"
            size = (*_CLIP_HALF_SIZE, half_length)
            clips.append(Movable(name, "box", size, 1e-4, 0.2, color_rgba=(0.75, 0.75, 0.8, 1.0)))
    return clips


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
        instruments: Sequence[OperatingRobot],
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
        self._instruments = tuple(instruments)
        self._tools = dict(tools)
        self._tool_names = list(tools)
        self._procedure = procedure
        self._sight = sight
        self._steps = 0
        self._organ = next(tissue for tissue in tissues if tissue.name == procedure.organ)
        self._spared: list[Tissue] = []
        for tissue in tissues:
            if tissue.name in procedure.spare:
                self._spared.append(tissue)
        self._energy = np.zeros(len(self._organ.pinned_nodes))
        self._freed = np.zeros(len(self._organ.pinned_nodes))
        self._tubes: list[Tube] = []
        self._root_weights: list[Array | None] = []
        for vessel in vessels:
            self._tubes.append(Tube(vessel, period))
            self._root_weights.append(self._root(vessel))
        self._states: dict[str, _State] = {}
        for instrument in instruments:
            self._states[instrument.robot] = _State(instrument.tool, instrument.T_world_tip())
        self._clips = [_Clip() for _ in clips_of(tools)]
        self._tip_depths = dict.fromkeys(procedure.spare, 0.0)
        self._seen = 0.0
        self.period = period
        self._tip_before: dict[int, Array] = {}  # of the instruments that hold something
        super().__init__(tissues, robots, period, procedure.organ)

    def step(self, signals: Signals, t: float, dt: float) -> Mapping[str, ArrayLike]:
        """Move instruments and organs, and compute the effects of the tools."""
        for number, instrument in enumerate(self._instruments):
            self._use(number, instrument, signals)
        for tube, root_weights in zip(self._tubes, self._root_weights, strict=True):
            if root_weights is not None:
                self._hold.pull(root_weights, tube.reaction)
        super().step(signals, t, dt)
        nodes = self.organs.nodes[self._organ.name]
        for tube, root_weights in zip(self._tubes, self._root_weights, strict=True):
            first = tube.points[0]
            if root_weights is not None:
                first = root_weights @ nodes
            tube.step(first)
        self._tip_depths = dict.fromkeys(self._tip_depths, 0.0)
        for number, instrument in enumerate(self._instruments):
            self._release_torn(number, instrument)
            self._measure_depth(self._states[instrument.robot])
        if self._steps % _STEPS_PER_LOOK == 0:
            self._look()
        self._steps += 1
        return self._signals()

    def _look(self) -> None:
        """Compute the visible fraction of the procedure's vessel."""
        surfaces = []
        for tissue in self.organs.tissues:
            surfaces.append((self.organs.vertices(tissue.name), tissue.surface.triangles))
        tube = next(tube for tube in self._tubes if tube.vessel.name == self._procedure.vessel)
        # without the ends, which are in the organs
        self._seen = self._sight.seen(tube.points[3:-1], surfaces)

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
        distance = float(np.linalg.norm(p - v.points[0]))
        if distance > v.radius:
            raise WorldError(
                f"vessel '{v.name}' begins {distance / MM:.1f} mm from '{v.organ}'; begin it on the surface, within "
                f"its radius of {v.radius / MM:g} mm"
            )
        return weights

    def _surface_point(self, p: Array, nodes: Array) -> tuple[Array, Array]:
        """Return the point (3,) of the organ's surface nearest to p (3,), and the weights (k,) of the nodes there."""
        organ = self._organ
        point, triangle, shares = nearest(p, organ.weights @ nodes, organ.surface.triangles)
        corners = organ.surface.triangles[triangle]
        return point, shares @ organ.weights[corners]

    # -- tools -----------------------------------------------------------------------------------------------

    def _use(self, k: int, instrument: OperatingRobot, signals: Signals) -> None:
        """Change the tool, move the jaws, or apply the cautery of instrument k, as the signals request."""
        robot = instrument.robot
        state = self._states[robot]
        instrument.links.poses(signals.now[instrument.links.signal])
        state.T = instrument.T_world_tip()
        self._change_tool(instrument, state, signals)
        tool = self._tools[state.tool]
        opened = bool(signals.now[ROBOT_OPENING.of(robot)][0] > 0.5)
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
            self._open(k, instrument, state)
        state.opened = opened
        tip = state.T[:3, 3]
        if tool.kind == "cautery" and signals.now[ROBOT_PEDAL.of(robot)][0] > 0.5:
            self._burn(tip, tool)
        held_point = self._held_point(k, state)
        if held_point is not None:
            # the held point moves as the tip does, and keeps its distance from the tip
            held_point.p = held_point.p + tip - self._tip_before[k]
            self._tip_before[k] = tip.copy()

    def _change_tool(self, instrument: OperatingRobot, state: _State, signals: Signals) -> None:
        """Change to the requested tool, if the jaws hold nothing and the instrument is drawn back to its port."""
        requested = signals.now[ROBOT_TOOL.of(instrument.robot)][0]
        requested_tool = self._tool_names[int(np.clip(requested, 0, len(self._tool_names) - 1))]
        if requested_tool == state.tool or state.holds >= 0:
            return
        distance = np.linalg.norm(state.T[:3, 3] - instrument.port)
        is_drawn_back = distance <= self._procedure.change_mm * MM
        if is_drawn_back and instrument.robot in self._tools[requested_tool].robots:
            state.tool = requested_tool

    def _grasp(self, k: int, state: _State, tool: ToolTable) -> None:
        """Hold the point of organ or vessel nearest to the tip, if its distance is at most half the gap of the jaws."""
        assert tool.open_mm is not None
        tip = state.T[:3, 3]
        reach = tool.open_mm / 2 * MM
        nodes = self.organs.nodes[self._organ.name]
        p, weights = self._surface_point(tip, nodes)
        least_distance = float(np.linalg.norm(p - tip))
        state.holds = Grasped.ORGAN if least_distance <= reach else Grasped.NOTHING
        vessel_node = 0
        for v, tube in enumerate(self._tubes):
            distances = np.linalg.norm(tube.points - tip, axis=1)
            node = int(np.argmin(distances))
            is_end = node in (0, len(distances) - 1)  # the ends are attached, and cannot be held
            if not is_end and distances[node] < min(least_distance, reach):
                least_distance = float(distances[node])
                state.holds = v + 1
                vessel_node = node
        if state.holds == Grasped.ORGAN:
            self._hold.grasp(k, weights, p, tool.slips_at)
            state.rest = weights @ self._organ.nodes
            self.organs.mute(self._instruments[k].robot, True)
        elif state.holds > 0:
            tube = self._tubes[state.holds - 1]
            tube.held[k] = Held(vessel_node, tube.points[vessel_node].copy(), tool.slips_at, np.zeros(3))
            state.rest = tube.vessel.points[vessel_node]
        self._tip_before[k] = tip.copy()

    def _held_point(self, k: int, state: _State) -> Grip | Held | None:
        """Return what the jaws of instrument k hold: a point of the organ or a node of a vessel; None: nothing."""
        if state.holds == Grasped.NOTHING:
            return None
        if state.holds == Grasped.ORGAN:
            return self._hold.grips[k]
        return self._tubes[state.holds - 1].held[k]

    def _open(self, k: int, instrument: OperatingRobot, state: _State) -> None:
        if state.holds == Grasped.ORGAN:
            self._hold.release(k)
            self.organs.mute(instrument.robot, False)
        elif state.holds > 0:
            del self._tubes[state.holds - 1].held[k]
        state.holds = Grasped.NOTHING

    def _vessel_between_jaws(self, state: _State, tool: ToolTable) -> tuple[int, float, float]:
        """Return (index of the vessel between the jaws, position along it in m, fraction of its width in the jaws).

        A vessel is between the jaws if the distance from the vessel's centre line to the middle line of the jaws is at
        most half of the gap of the jaws.
        """
        assert tool.open_mm is not None
        tip = state.T[:3, 3]
        z = state.T[:3, 2]
        jaw_length = tool.jaw_mm * MM
        most_covered = (int(ClipPlace.ON_NOTHING), 0.0, 0.0)
        for v, tube in enumerate(self._tubes):
            distance, along_jaw, position, sine = tube.crossed(tip - jaw_length * z, tip)
            if distance > tool.open_mm / 2 * MM:
                continue
            half_width = tube.vessel.radius / sine  # along the jaws; wider if the vessel crosses them at an angle
            covered = min(along_jaw + half_width, jaw_length) - max(along_jaw - half_width, 0.0)
            cover = covered / (2 * half_width)
            if cover > most_covered[2]:
                most_covered = (v, position, cover)
        return most_covered

    def _clip(self, state: _State, tool: ToolTable) -> None:
        """Close the next clip."""
        clip = next((clip for clip in self._clips if clip.on == ClipPlace.UNUSED), None)
        if clip is None:
            return
        clip.on, clip.at, clip.cover = self._vessel_between_jaws(state, tool)
        middle_of_jaws = -tool.jaw_mm / 2 * MM
        clip.T = state.T @ spatial.pose(p=[0, 0, middle_of_jaws])
        if clip.on >= 0:
            tube = self._tubes[clip.on]
            node = int(np.argmin(np.abs(tube.vessel.arc - clip.at)))
            tube.flat[node] = max(tube.flat[node], clip.cover)
            tube.across = state.T[:3, 0].copy()
            clip.T[:3, 3] = tube.at(clip.at)

    def _cut(self, state: _State, tool: ToolTable) -> None:
        """Cut the vessel between the blades, if all of its width is between them and no clip is in the way."""
        v, position, cover = self._vessel_between_jaws(state, tool)
        if v == ClipPlace.ON_NOTHING or cover < _WHOLE_WIDTH:
            return
        for clip in self._clips:
            if clip.on == v and abs(clip.at - position) < _CLIP_DISTANCE:
                return
        self._tubes[v].sever(position)

    def _burn(self, tip: Array, tool: ToolTable) -> None:
        """Heat the cell of the bed nearest to the tip; free the cell when its energy reaches the procedure's limit."""
        nodes = self.organs.nodes[self._organ.name][self._organ.pinned_nodes]
        distances = np.linalg.norm(nodes - tip, axis=1)
        distances[self._freed > 0.5] = np.inf
        cell = int(np.argmin(distances))
        if distances[cell] <= tool.jaw_mm * MM:
            self._energy[cell] += (tool.power_w or 0.0) * self.period
            if self._energy[cell] >= self._procedure.bed_j:
                self._freed[cell] = 1.0
                self._hold.let_go(int(self._organ.pinned_nodes[cell]))

    def _release_torn(self, k: int, instrument: OperatingRobot) -> None:
        """Release a point that has slipped out of the jaws."""
        state = self._states[instrument.robot]
        held_point = self._held_point(k, state)
        if held_point is not None and held_point.slipped > _LARGEST_SLIP:
            self._open(k, instrument, state)

    def _measure_depth(self, state: _State) -> None:
        """Measure the depth of the tip in organs to be spared; the deepest tip counts."""
        tip = state.T[:3, 3]
        for tissue in self._spared:
            surface = tissue.surface
            if inside(tip[None], surface.vertices, surface.triangles)[0]:
                p, _, _ = nearest(tip, surface.vertices, surface.triangles)
                depth = float(np.linalg.norm(p - tip))
                self._tip_depths[tissue.name] = max(self._tip_depths[tissue.name], depth)

    # -- signals ---------------------------------------------------------------------------------------------

    def _signals(self) -> dict[str, ArrayLike]:
        values = super()._signals()
        for k, instrument in enumerate(self._instruments):
            self._add_instrument(values, k, instrument.robot)
        organ = self._organ.name
        values[ORGAN_ENERGY.of(organ)] = self._energy.copy()
        values[ORGAN_FREED.of(organ)] = self._freed.copy()
        for name, depth in self._tip_depths.items():
            values[ORGAN_DEPTH.of(name)] = depth
        for tube in self._tubes:
            values[VESSEL_NODES.of(tube.vessel.name)] = tube.nodes().ravel()
            values[VESSEL_CUT.of(tube.vessel.name)] = tube.cut.astype(float)
        values[VESSEL_SEEN.of(self._procedure.vessel)] = self._seen
        self._add_clips(values)
        return values

    def _add_instrument(self, values: dict[str, ArrayLike], k: int, robot: str) -> None:
        """Add the signals of instrument k."""
        state = self._states[robot]
        pull = np.zeros(3)
        lifted = np.zeros(3)
        slipped = 0.0
        held_point = self._held_point(k, state)
        if held_point is not None:
            pull = held_point.force
            slipped = held_point.slipped
            if isinstance(held_point, Grip):
                p = held_point.weights @ self.organs.nodes[self._organ.name]
            else:
                p = self._tubes[state.holds - 1].points[held_point.node]
            lifted = p - state.rest
        values[ROBOT_TIP.of(robot)] = state.T[:3, 3]
        values[ROBOT_CARRIES.of(robot)] = float(self._tool_names.index(state.tool))
        values[ROBOT_HOLDS.of(robot)] = float(state.holds)
        values[ROBOT_PULL.of(robot)] = pull
        values[ROBOT_LIFTED.of(robot)] = lifted
        values[ROBOT_SLIPPED.of(robot)] = slipped

    def _add_clips(self, values: dict[str, ArrayLike]) -> None:
        """Add the signals of the clips; a clip on a vessel moves with the vessel."""
        T_applier = self._states[self._applier().robot].T
        in_applier = 0
        for k, clip in enumerate(self._clips, 1):
            values[f"clip_{k}.on"] = float(clip.on)
            values[f"clip_{k}.at"] = clip.at
            values[f"clip_{k}.cover"] = clip.cover
            T = clip.T
            if T is None:  # in the tube of the applier, one behind the other
                behind_tip = _FIRST_CLIP + in_applier * _CLIP_SPACING
                T = T_applier @ spatial.pose(p=[0, 0, -behind_tip * MM])
                in_applier += 1
            elif clip.on >= 0:
                T[:3, 3] = self._tubes[clip.on].at(clip.at)
            values[f"clip_{k}.pose"] = T.ravel()

    def _applier(self) -> OperatingRobot:
        """Return the instrument that carries the clip applier; the first instrument, if none carries it."""
        for instrument in self._instruments:
            tool = self._tools[self._states[instrument.robot].tool]
            if tool.kind == "clip_applier":
                return instrument
        return self._instruments[0]
