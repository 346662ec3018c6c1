"""The front end: all content of the viser page; `twin.ui.session` holds the state of the robots."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np
import viser

from twin.api import Robot
from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.ui.session import readings, timeline
from twin.ui.session.deformable_feed import Feed
from twin.ui.session.file_watch import RobotFileWatch
from twin.ui.session.movable_robot import MovableRobot, MoveResult, start_of
from twin.ui.session.posture_text import posture_text, read_posture
from twin.ui.session.timeline import Clock, Planner, Playback
from twin.ui.session.trocars import rcm_at
from twin.ui.viewer.field_nodes import FieldNodes
from twin.ui.viewer.limit_wall import LimitWall
from twin.ui.viewer.loop import ViewerPage
from twin.ui.viewer.robot_nodes import BLUE, RobotNodes
from twin.ui.viewer.server import publish

_READING_PERIOD = 0.1
"""Minimum time in s between two updates of the readings; each update redraws the panels."""

_FIRST_PICTURE_TIME = 1.5
"""Time in s since the first browser connected after which planning begins: its first picture is drawn by then."""

_PLANNING_TIMEOUT = 4.0
"""Time in s from the start after which planning of protocols begins at the latest, without a browser."""


@dataclass
class ShownRobot:
    """A robot in the scene.

    Attributes:
        name: displayed name.
        source: argument of `twin.load`; other processes load the robot with this argument.
        movable: state of the robot.
        T_world_base: pose (4, 4) of the base in the scene.
        protocol: name or path of the protocol that was loaded last; None: the robot's default protocol.
        scale: factor on the displayed size.
        playback: playback of the protocol; None until it is planned.
    """

    name: str
    source: str
    movable: MovableRobot
    T_world_base: Array = field(default_factory=lambda: np.eye(4))
    protocol: str | None = None
    scale: float = 1.0
    playback: Playback | None = None


class QuestionTerminal(Protocol):
    """Interface of a terminal that asks one question at a time."""

    def ask(self, question: str, then: Callable[[bool], object]) -> None:
        """Print a question; `then` is called with True if the answer is yes, else with False."""

    def poll(self) -> None:
        """Read the answer, if there is one, and call the function `then` of the question."""


class SceneryInterface(Protocol):
    """Interface through which `Front` uses the surroundings of the robots; implemented by `scenery.Scenery`."""

    def panel(self) -> None:
        """Create the controls of the surroundings."""

    def trail(self, visible: bool) -> None:
        """Show or hide the tip path of each robot's protocol, and trocars and shafts."""

    def forget(self, robot: str) -> None:
        """Forget what is drawn for a robot, given by its name; it is removed with the robot's scene nodes."""

    def redraw(self, robot: str) -> None:
        """Draw what is switched on at the new scene nodes of a robot, given by its name."""

    def follow(self) -> None:
        """Draw trocars and shafts at the present poses."""

    def update(self) -> None:
        """Update the shown section, if any, to the present poses of the robots."""

    def protocol_changed(self) -> None:
        """Update the patient after a change of protocol."""


class PanelsInterface(Protocol):
    """Interface through which `Front` uses the controls and displays; implemented by `panels.Panels`."""

    @property
    def why(self) -> str:
        """Why the last planning of a protocol failed; "" if none has failed."""
        ...

    def rebuild(self) -> None:
        """Rebuild the panels for another active robot, or for another build of the active robot."""

    def show(self, reading: readings.RobotReading) -> None:
        """Show the readings of the active robot, the time, and the curves."""

    def shows_equation_points(self) -> bool:
        """Return whether the user has chosen to show the named points that the equations compute."""
        ...

    def error_magnification(self) -> float:
        """Return the factor by which differences between points of equations and mechanism are drawn larger."""
        ...

    def show_ghost(self, visible: bool) -> None:
        """Show or hide the ghost, and set its checkbox."""

    def ghost_poses(self, robot: ShownRobot) -> dict[str, Array] | None:
        """Return the link poses T_base_body (4, 4) of a robot's ghost, by body; None if they cannot be computed."""

    def show_planning(self, robot: ShownRobot, protocol: str | None) -> None:
        """Show that a protocol of a robot is being planned; None: its default protocol."""

    def show_failure(self, robot: ShownRobot, error: str) -> None:
        """Show why the protocol of a robot cannot be played."""

    def show_planned(self, robot: ShownRobot) -> None:
        """Show timeline and curves of the planned protocol of a robot."""

    def close(self) -> None:
        """End the processes of the panels."""


class Front(ViewerPage):
    """The page with one active robot and possibly further robots; created by `page.open_page`.

    Attributes:
        robots: the robots in the given order.
        active: the robot to which gizmo, sliders and readings refer.
        local: whether only this machine can open the page; if not, the page may not write files.
        terminal: terminal that asks for confirmations; None: the page never changes a robot's files.
        clock: clock of the protocols.
        feed: deformables; None: no deformables.
        nodes: scene nodes of each robot, by name of the robot.
        ghosts: scene nodes of each ghost that has been drawn, by name of the robot.
        scenery: surroundings of the robots; exists after `build_panels`.
        panels: controls and displays; exist after `build_panels`.
    """

    scenery: SceneryInterface
    panels: PanelsInterface

    def __init__(
        self,
        title: str,
        robots: list[ShownRobot],
        server: viser.ViserServer,
        stopping: threading.Event | None = None,
        *,
        local: bool = True,
        terminal: QuestionTerminal | None = None,
        feed: Feed | None = None,
    ) -> None:
        super().__init__(server, title, stopping)
        self.robots = robots
        self.active = robots[0]
        self.local = local
        self.terminal = terminal
        self.clock = Clock()
        self.feed = feed
        self._fields: FieldNodes | None = None
        self.clock.duration = 0.0
        if feed is not None:
            self._fields = FieldNodes(server, feed)
            self.clock.duration = feed.duration
        self.nodes: dict[str, RobotNodes] = {}
        for robot in robots:
            poses = robot.movable.assembly.link_poses
            self.nodes[robot.name] = RobotNodes(self.server, f"/{robot.name}", robot.movable.mechanism, poses)
        self.ghosts: dict[str, RobotNodes] = {}
        self.ghost_shown = False
        self.dragging = False
        self._planners: dict[str, Planner] = {}
        # robots that stay where they are when their next plan is ready, instead of going to its start
        self._kept_in_place = {robot.name for robot in robots if start_of(robot.movable.robot)}
        self._watch: RobotFileWatch | None = None
        self._linked_time: float | None = None  # time of a link, until a protocol is planned
        self._reading_time = self.now
        self._is_changed = True
        self.after_frame: list[Callable[[], object]] = []
        for robot in robots:
            self.nodes[robot.name].place(robot.T_world_base, robot.scale)
        self.wall = LimitWall(self.server, float(np.clip(0.11 * self.nodes[self.active.name].size, 0.005, 0.3)))
        self.gizmo = self._add_gizmo()

    def build_panels(
        self, scenery: Callable[[Front], SceneryInterface], panels: Callable[[Front], PanelsInterface]
    ) -> None:
        """Create the surroundings, then the panels, which contain controls for the surroundings."""
        self.scenery = scenery(self)
        self.panels = panels(self)
        self._make_links_draggable()
        self.refresh()

    # -- the loop -------------------------------------------------------------------------------------

    def frame(self, passed: float, has_requests: bool) -> None:
        """Advance the clock, draw one frame, and update the readings periodically."""
        self._is_changed |= has_requests
        self._receive_plans()
        if self.clock.advance(passed):
            self.move_to_clock()
        self.deform_organs(passed)
        if self._is_changed or self.clock.playing:
            self.draw()
        for act in list(self.after_frame):
            act()
        if self.terminal is not None:
            self.terminal.poll()
        if self.now - self._reading_time >= _READING_PERIOD and (self._is_changed or self.clock.playing):
            self._reading_time = self.now
            self._is_changed = False
            self.refresh()

    def close(self) -> None:
        """End processes and threads, and release the port."""
        self.panels.close()
        if self._watch is not None:
            self._watch.close()
        for planner in self._planners.values():
            planner.close()
        self._planners.clear()
        super().close()

    def continue_move(self, kind: str, move: Callable[[], MoveResult]) -> None:
        """Store a request for a move; a move that exceeds its time limit is continued in the next frame."""
        self.repeat(kind, lambda: move().more)

    # -- robots ---------------------------------------------------------------------------------------

    def draw(self) -> None:
        """Show the present state of robots, deformables, trocars, shafts, the gizmo and the active robot's ghost."""
        for robot in self.robots:
            self.nodes[robot.name].write(robot.movable.assembly.link_poses)
        if self._fields is not None:
            error = self._fields.show(self.clock.time)
            if error:
                self.say(error, bad=True)
        self.scenery.follow()
        if self.ghost_shown:
            self._draw_ghost()
        if not self.dragging:
            self._place_gizmo()

    def deform_organs(self, passed: float) -> None:
        """Deform the organs according to the present link poses; `passed` is the time in s since the last call."""
        if self._fields is not None:
            self._is_changed |= self._fields.follow(self._world_link_poses, passed)

    def _world_link_poses(self, name: str) -> dict[str, Array]:
        robot = self._robot_named(name)
        return {link: robot.T_world_base @ T for link, T in robot.movable.assembly.link_poses.items()}

    def _robot_named(self, name: str) -> ShownRobot:
        robots = {robot.name: robot for robot in self.robots}
        return robots[name]

    def refresh(self) -> None:
        """Compute and show the readings of the active robot."""
        robot = self.active
        reading = readings.read(robot.movable, rcm_at(robot.playback, self.clock.time))
        shown_points = reading.points if self.panels.shows_equation_points() else {}
        self.nodes[robot.name].equations(
            shown_points, reading.actual, reading.agrees, self.panels.error_magnification()
        )
        self.panels.show(reading)
        self.scenery.update()
        publish(self.server, self.state())

    # -- links to a posture ---------------------------------------------------------------------------

    def state(self) -> JsonObject:
        """Return pose of the tool, joint values and time, and the link that opens them again, as plain data."""
        robot = self.active
        with robot.movable.lock:
            q = robot.movable.assembly.q.copy()
            T = robot.movable.assembly.T_base_tool.copy()
        joints = {}
        for joint, value in zip(robot.movable.joints, q, strict=True):
            unit, scale = ("deg", DEG) if joint.is_angle else ("mm", MM)
            joints[joint.name] = {"value": float(value) / scale, "unit": unit}
        t = self.clock.time if robot.playback is not None else None
        return {
            "robot": robot.name,
            "joints": joints,
            "tool": {
                "position_mm": (T[:3, 3] / MM).tolist(),
                "quaternion_wxyz": spatial.quat_from_matrix_wxyz(T[:3, :3]).tolist(),
                "T_base_tool_m": T.tolist(),
            },
            "time_s": t,
            "scale": robot.scale,
            "link": posture_text(robot.movable.joints, q, t),
        }

    def follow_link(self, text: str) -> None:
        """Move the active robot to the posture and time of a link, see `posture_text`.

        Raises:
            TwinError: the link has another form, or the posture cannot be reached.
        """
        robot = self.active
        q, t = read_posture(text, robot.movable.joints)
        self.clock.playing = False
        if robot.playback is None:
            self._kept_in_place.add(robot.name)  # a plan that is ready later does not move the robot
        self._linked_time = t
        self._seek_linked_time()
        result = robot.movable.move_joints(q)
        robot.movable.clear_message()
        if not result.good:
            raise TwinError(f"the posture of the link is not reached: {result.reason}")

    def _seek_linked_time(self) -> None:
        if self._linked_time is None or self.clock.duration <= 0:
            return
        self.clock.seek(self._linked_time)
        self._linked_time = None

    def move_to_clock(self) -> None:
        """Move every robot that has a planned protocol to the protocol's state at the clock's time."""
        for robot in self.robots:
            if robot.playback is None:
                continue
            k = int(np.clip(round(self.clock.time * timeline.TICK_RATE), 0, len(robot.playback.t) - 1))
            robot.movable.follow_sample(robot.playback.x[k], robot.playback.Ts_base_tool[k])

    def set_active(self, name: str) -> None:
        """Make a robot the active one."""
        self.nodes[self.active.name].equations({}, {}, True, 1.0)
        self.active = self._robot_named(name)
        self.panels.rebuild()
        self._is_changed = True

    def rebuilt(self, robot: ShownRobot) -> None:
        """Remove a robot's ghost, because the robot's mechanism has changed."""
        ghost = self.ghosts.pop(robot.name, None)
        if ghost is not None:
            ghost.remove()
        self._is_changed = True

    # -- changed files --------------------------------------------------------------------------------

    def follow_files(self, watch: RobotFileWatch) -> None:
        """Replace the active robot whenever its files change; a robot that cannot be loaded leaves the last one."""
        self._watch = watch
        robot = self.active

        def look() -> None:
            change = watch.poll(self.now)
            if change is None:
                return
            files = ", ".join(change.files)
            if change.movable is None:
                self.panels.show_failure(robot, f"{files}: {change.error} The robot before this change stays.")
                self.say(f"{files}: {change.error}", bad=True)
                return
            note = self.replace(robot, change.movable)
            self.say(f"{files} changed: {robot.name} is rebuilt{note}")

        self.after_frame.append(look)

    def replace(self, robot: ShownRobot, movable: MovableRobot) -> str:
        """Show another build of a robot, in the same posture if it can take it; return a note if it cannot.

        The view stays. Changes of equations and parameters that were made in the page are made again.
        """
        note = ""
        old = robot.movable
        if [joint.name for joint in old.joints] != [joint.name for joint in movable.joints]:
            note = "; it has other joints, so it stands at its start"
        elif not movable.move_joints(old.assembly.q).good:
            note = f"; it stands at its start: {movable.last_move.reason}"
        movable.clear_message()
        if old.variants or old.parameters:
            try:
                movable.change(old.variants, old.parameters)
            except TwinError as error:
                note += f"; the changes of its equations are gone: {error}"
        robot.movable = movable
        # its joint values are those of the build before
        robot.playback = None
        if robot.protocol and _is_missing(movable.robot, robot.protocol):
            note += f"; its protocol {robot.protocol} has gone, so the default one is planned"
            robot.protocol = None
        self.scenery.forget(robot.name)
        with self.server.atomic():
            self.nodes[robot.name].remove()
            nodes = RobotNodes(self.server, f"/{robot.name}", movable.mechanism, movable.assembly.link_poses)
            nodes.place(robot.T_world_base, robot.scale)
        self.nodes[robot.name] = nodes
        self.scenery.redraw(robot.name)
        self._make_draggable(robot)
        self.rebuilt(robot)
        if robot is self.active:
            self.panels.rebuild()
        self._kept_in_place.add(robot.name)
        if movable.robot.files is not None and movable.robot.files.protocols():
            self.load(robot, robot.protocol)
        else:
            self.clock.playing = False
        return note

    def _draw_ghost(self) -> None:
        robot = self.active
        if robot.name not in self.ghosts:
            self.ghosts[robot.name] = RobotNodes(
                self.server,
                f"/ghost_{robot.name}",
                robot.movable.mechanism,
                robot.movable.assembly.link_poses,
                ghost=BLUE,
            )
        ghost = self.ghosts[robot.name]
        ghost.place(robot.T_world_base, robot.scale)
        poses = self.panels.ghost_poses(robot)
        if poses is not None:
            ghost.write(poses)

    def show_ghost(self, visible: bool) -> None:
        """Show or hide the ghost of the active robot."""
        self.ghost_shown = visible
        for name, ghost in self.ghosts.items():
            ghost.show(visible and name == self.active.name)

    # -- protocols ------------------------------------------------------------------------------------

    def load_soon(self) -> None:
        """Plan the protocols after a browser has drawn its first picture, because planning would delay this picture."""
        begin = self.now

        def wait() -> None:
            first_picture = np.inf
            for client in self.server.get_clients().values():
                # a browser reports its camera with its first picture; until then the time is 0
                first_picture = min(first_picture, client.camera._state.update_timestamp or np.inf)
            if time.time() - first_picture > _FIRST_PICTURE_TIME or self.now - begin > _PLANNING_TIMEOUT:
                self.after_frame.remove(wait)
                for robot in self.robots:
                    if robot.movable.robot.files is not None and robot.movable.robot.files.protocols():
                        self.load(robot, robot.protocol)

        self.after_frame.append(wait)

    def load(self, robot: ShownRobot, protocol: str | None) -> None:
        """Plan a protocol in a separate process; the robot plays the protocol when it is planned."""
        if robot.name in self._planners:
            self._planners.pop(robot.name).close()
        robot.playback = None
        self._planners[robot.name] = Planner(robot.source, protocol)
        self.panels.show_planning(robot, protocol)

    @property
    def planning(self) -> bool:
        """Whether a protocol is being planned."""
        return bool(self._planners)

    def _receive_plans(self) -> None:
        for name, planner in list(self._planners.items()):
            if not planner.done:
                continue
            self._planners.pop(name).close()
            robot = self._robot_named(name)
            if not isinstance(planner.answer, Playback):
                self.panels.show_failure(robot, str(planner.answer))
                continue
            if robot.movable.robot.files is not None:
                try:
                    self._use_protocol(robot, planner.protocol)
                except TwinError as error:
                    self.panels.show_failure(robot, str(error))
                    continue
            robot.playback = planner.answer
            robot.protocol = planner.protocol
            self.clock.duration = self._longest_motion()
            self.panels.show_planned(robot)
            self.scenery.protocol_changed()
            self._seek_linked_time()
            if robot.name in self._kept_in_place:
                self._kept_in_place.discard(robot.name)
            else:
                self.move_to_clock()
            self._is_changed = True

    def _use_protocol(self, robot: ShownRobot, name: str | None) -> None:
        """Move the trocars of a robot to the places of a protocol, and use the protocol's tip and shaft.

        Raises:
            TwinError: the mechanism, which may have a changed design, cannot be assembled with these trocars.
        """
        protocol = robot.movable.robot.protocol(name)
        bound = robot.movable.robot.bound(protocol)
        if bound is not robot.movable.robot:
            q = robot.movable.assembly.q
            robot.movable.bind(bound)
            if robot.name in self._kept_in_place:
                robot.movable.move_joints(q)
                robot.movable.clear_message()
        robot.movable.use_tool_frame_of(protocol)

    def _longest_motion(self) -> float:
        """Return the duration in s of the longest motion of the scene."""
        duration = 0.0
        if self.feed is not None:
            duration = self.feed.duration
        for robot in self.robots:
            if robot.playback is not None:
                duration = max(duration, robot.playback.duration)
        return duration

    # -- dragging -------------------------------------------------------------------------------------

    def _add_gizmo(self) -> viser.TransformControlsHandle:
        size = float(np.clip(0.16 * self.nodes[self.active.name].size * self.active.scale, 0.01, 0.4))
        gizmo = self.server.scene.add_transform_controls("/tool", scale=size, depth_test=False)

        @gizmo.on_update
        async def _(event: viser.TransformControlsEvent) -> None:
            if event.client is None:
                return
            if event.phase == "start":
                self.dragging = True
                self.clock.playing = False
                self.active.movable.remember()
            wxyz = np.array(event.target.wxyz)
            position = np.array(event.target.position)
            self.continue_move("tool", lambda: self._drag_tool(wxyz, position))
            if event.phase == "end":
                self.dragging = False
                self.ask("settle", self._end_drag)

        return gizmo

    def _end_drag(self) -> None:
        self.wall.hide()
        self.active.movable.clear_message()

    def _drag_tool(self, wxyz: Array, position: Array) -> MoveResult:
        node = self.nodes[self.active.name]
        R = spatial.matrix_from_quat_wxyz(np.asarray(node.root.wxyz)).T @ spatial.matrix_from_quat_wxyz(wxyz)
        u, _, vt = np.linalg.svd(R)  # nearest rotation: pages send rounded values
        result = self.active.movable.drag_tool(spatial.pose(u @ vt, node.to_base(position)))
        if self.dragging and not result.good and not result.more:
            self.wall.show(node.to_world(self.active.movable.assembly.T_base_tool[:3, 3]), position)
        else:
            self.wall.hide()
        return result

    def _place_gizmo(self) -> None:
        node = self.nodes[self.active.name]
        T = self.active.movable.assembly.T_base_tool
        self.gizmo.position = node.to_world(T[:3, 3])
        R = spatial.matrix_from_quat_wxyz(np.asarray(node.root.wxyz)) @ T[:3, :3]
        self.gizmo.wxyz = spatial.quat_from_matrix_wxyz(R)

    def _make_links_draggable(self) -> None:
        """Make all links draggable with the shift key and the left mouse button."""
        for robot in self.robots:
            self._make_draggable(robot)

    def _make_draggable(self, robot: ShownRobot) -> None:
        grabbed: dict[str, Array] = {}
        for body, handle in self.nodes[robot.name].meshes:
            handle.on_drag("left", modifier="shift")(self._drag_handler(robot, body, grabbed))

    def _drag_handler(self, robot: ShownRobot, body: str, grabbed: dict[str, Array]):
        node = self.nodes[robot.name]

        async def handle_drag(event: viser.SceneNodeDragEvent) -> None:
            if event.phase == "start":
                T_body_base = spatial.inverse(robot.movable.assembly.link_poses[body])
                p_base = node.to_base(np.array(event.start_position))
                robot.movable.remember()
                grabbed[body] = (T_body_base @ np.append(p_base, 1.0))[:3]
                self.clock.playing = False
                self.ask("prepare", robot.movable.solver.prepare)
            elif event.phase == "update" and body in grabbed:
                target = node.to_base(np.array(event.end_position))
                p = grabbed[body]
                self.continue_move("point", lambda: robot.movable.move_point(body, p, target))
            elif event.phase == "end":
                self.ask("settle", robot.movable.clear_message)

        return handle_drag


def _is_missing(robot: Robot, protocol: str) -> bool:
    """Return whether the file of a protocol no longer exists; `protocol` is as for `Robot.protocol`."""
    if Path(protocol).suffix == ".toml":
        return not Path(protocol).exists()
    if robot.files is None:
        return False
    try:
        return not robot.files.protocol(protocol).exists()
    except TwinError:
        return True
