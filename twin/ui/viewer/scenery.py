"""Surroundings of the robots (floor, table, patient, tip paths), sections and pictures, and the controls of these."""

from __future__ import annotations

import threading

import numpy as np
import viser

from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.model.mechanism import Mechanism
from twin.reference import ReferenceModel
from twin.ui.session.drawn_parts import drawn_parts
from twin.ui.session.patient import none_there, patient_of
from twin.ui.session.trocars import in_trocars, rcm_at
from twin.ui.viewer import view_export
from twin.ui.viewer.camera_views import VIEWS, CameraViews
from twin.ui.viewer.drawn_nodes import DrawnNodes, add_person
from twin.ui.viewer.front import Front, ShownRobot
from twin.ui.viewer.robot_nodes import BLUE, RobotNodes
from twin.ui.viewer.surroundings import corners, furnish
from twin.ui.viewer.trocar_nodes import TrocarNodes

_SECTION_CHOICES = ("none", "x", "y", "z")


class Scenery:
    """The surroundings of all robots.

    Attributes:
        cameras: preset views of the browsers' cameras.
        trocars: scene nodes of trocars and shafts.
        props: scene nodes of the scene's props; None: no props.
    """

    def __init__(self, front: Front, props: Mechanism | None) -> None:
        self.front = front
        self.scene = front.server.scene
        boxes = []
        for nodes in front.nodes.values():
            boxes.append(np.array([nodes.to_world(corner) for corner in corners(nodes.box)]))
        self.props: RobotNodes | None = None
        if props is not None:
            poses = ReferenceModel(props).home().link_poses
            self.props = RobotNodes(front.server, f"/{props.name}", props, poses)
            boxes.append(corners(self.props.box))
        points = np.concatenate(boxes)
        low = points.min(axis=0)
        high = points.max(axis=0)
        self.middle = 0.5 * (low + high)
        self.size = float(np.linalg.norm(high - low))
        floor = float(low[2])
        if props is not None:
            floor = min(0.0, floor)
        self.grid = furnish(front.server, self.middle, self.size, floor)
        self._floor = floor
        self._patients: dict[str, RobotNodes] = {}
        self._patient_shown = False
        self.cameras = CameraViews(front, self.middle, self.size)
        self._trail_nodes: dict[str, list[viser.SceneNodeHandle]] = {}
        self._trail_shown = True
        # which of the displays "labels", "frames" and "axes" are switched on
        self._shown_labels: set[str] = set()
        self.trocars = TrocarNodes(front.server)
        self._section: tuple[int, float] | None = None
        self._export_lock = threading.Lock()
        self._drawn_section: tuple | None = None
        self._drawn_nodes: dict[str, DrawnNodes] = {}
        self._drawn_parts_shown = True
        self._person: viser.FrameHandle | None = None
        for a in front.robots:
            self._draw_parts(a)

    # -- the instrument -------------------------------------------------------------------------------

    def _draw_parts(self, robot: ShownRobot) -> None:
        """Draw what is drawn beside the measured bodies of a robot, such as belts and cables, if it has any."""
        files = robot.movable.robot.files
        if files is None:
            return
        scenery_parts = drawn_parts(files.description, [body.name for body in robot.movable.mechanism.bodies])
        if scenery_parts is None:
            return
        self._drawn_nodes[robot.name] = DrawnNodes(
            self.front.server, f"/{robot.name}", scenery_parts, robot.movable.assembly.link_poses
        )
        self._update_drawn_parts()

    def _update_drawn_parts(self) -> None:
        # a section cuts the measured bodies only
        for nodes in self._drawn_nodes.values():
            nodes.show(self._drawn_parts_shown and self._section is None)

    def drawn(self, visible: bool) -> None:
        """Show or hide what is drawn and not measured."""
        self._drawn_parts_shown = visible
        self._update_drawn_parts()
        if visible and self._drawn_nodes:
            self.front.say(" ".join(dict.fromkeys(nodes.note for nodes in self._drawn_nodes.values())))

    def person(self, visible: bool) -> None:
        """Show or hide an adult beside the robots, for scale."""
        if visible and self._person is None:
            towards_left = np.array([-0.79, -0.61, 0.0])
            foot = self.middle + (0.5 * self.size + 0.3) * towards_left
            self._person = add_person(self.front.server, np.array([foot[0], foot[1], self._floor]))
        if self._person is not None:
            self._person.visible = visible

    def trail(self, visible: bool) -> None:
        """Show or hide the tip path of each robot's protocol, and trocars and shafts."""
        self._trail_shown = visible
        for robot in self.front.robots:
            for handle in self._trail_nodes.pop(robot.name, []):
                handle.remove()
            if robot.playback is None or not visible:
                continue
            tip = robot.playback.tip[:: max(1, len(robot.playback.t) // 600)]
            line = self.scene.add_line_segments(
                f"/{robot.name}/trail", np.stack([tip[:-1], tip[1:]], axis=1).astype(np.float32), BLUE,
                thickness=2.0, thickness_units="screen",
            )  # fmt: skip
            self._trail_nodes[robot.name] = [line]

    def forget(self, robot: str) -> None:
        """Forget path, trocars, shafts, patient and section of a robot; they are removed with its scene nodes."""
        self._trail_nodes.pop(robot, None)
        self._patients.pop(robot, None)
        self._drawn_nodes.pop(robot, None)
        self._drawn_section = None
        self.trocars.forget(robot)

    def redraw(self, robot: str) -> None:
        """Show names, frames and joint axes, if they are switched on, at the new scene nodes of a robot."""
        nodes = self.front.nodes[robot]
        for a in self.front.robots:
            if a.name == robot:
                self._draw_parts(a)
        if "labels" in self._shown_labels:
            nodes.labels(True)
        if "frames" in self._shown_labels:
            nodes.frames(True)
        if "axes" in self._shown_labels:
            nodes.axes(True)

    def follow(self) -> None:
        """Draw trocars and shafts at the present poses; a shaft whose trocar error is 2 mm or more is not drawn."""
        for robot in self.front.robots:
            if robot.name in self._drawn_nodes:
                self._drawn_nodes[robot.name].follow(robot.movable.assembly.link_poses)
        shown_keys: set[str] = set()
        if self._trail_shown:
            for robot in self.front.robots:
                trocars = in_trocars(robot.movable, rcm_at(robot.playback, self.front.clock.time))
                size = self.front.nodes[robot.name].size
                for trocar in trocars:
                    shown_keys.add(self.trocars.draw(robot, size, trocar, len(trocars) > 1))
        self.trocars.hide_others(shown_keys)

    # -- the panel ------------------------------------------------------------------------------------

    def panel(self) -> None:
        """Create the controls for camera views, displayed objects, section, displayed size and place, and pictures."""
        gui = self.front.server.gui
        front = self.front
        views = gui.add_dropdown("camera", VIEWS)
        look = gui.add_button("Look from there")
        look.on_click(lambda e: self.cameras.look(views.value, e.client))
        views.on_update(lambda e: self.cameras.look(views.value, e.client))
        with gui.add_folder("Show"):
            boxes = {
                "floor": (True, lambda v: setattr(self.grid, "visible", v)),
                "table and patient": (False, self.patient),
                "drawn parts": (True, self.drawn),
                "person, for scale": (False, self.person),
                "link names": (False, self._labels),
                "link frames": (False, self._frames),
                "joint axes": (False, self._axes),
                "gizmo at the tool": (True, self.cameras.show_gizmo),
                "dark": (False, self.dark),
            }
            if self.props is not None:
                del boxes["table and patient"]  # the scene's props include table and patient
                boxes["transparent surroundings"] = (False, self.see_through)
            for name, (first, do) in boxes.items():
                box = gui.add_checkbox(name, first)
                box.on_update(self._switch_handler(name, box, do))
        with gui.add_folder("Section"):
            axis = gui.add_dropdown("cut across", _SECTION_CHOICES)
            part = gui.add_slider("where [%]", 0, 100, 1, 50)

            def cut(_: object) -> None:
                self._section = (
                    None if axis.value == "none" else (_SECTION_CHOICES.index(axis.value) - 1, part.value / 100)
                )
                front.ask("cut", self._update_drawn_parts)

            axis.on_update(cut)
            part.on_update(cut)
        with gui.add_folder("Size and place", expand_by_default=False):
            gui.add_markdown("These controls change only the display; no reading depends on them.")
            scale = gui.add_slider("size", 0.1, 10.0, 0.1, 1.0)
            place = gui.add_vector3("place [mm]", (0.0, 0.0, 0.0), step=10.0)
            yaw = gui.add_slider("turn [°]", -180, 180, 1, 0)

            def put(e: viser.GuiEvent) -> None:
                position = np.array(place.value) * MM
                size = scale.value
                angle = yaw.value * DEG
                if e.client is not None:
                    front.ask("place", lambda: self._place_robot(front.active, position, angle, size))

            for handle in (scale, place, yaw):
                handle.on_update(put)
        with gui.add_folder("Pictures"):
            shot = gui.add_button("Screenshot")
            turn = gui.add_button("Turntable (GIF)")
            page = gui.add_button("Recording without Python (HTML)")
            self._progress = gui.add_progress_bar(0.0, visible=False)
            shot.on_click(lambda e: self._export(lambda p: view_export.screenshot(e.client, front.title, p)))
            turn.on_click(lambda e: self._export(lambda p: view_export.turntable(e.client, front.title, p)))
            page.on_click(lambda e: front.ask("page", lambda: self._export_page(e.client)))

    def _note_labels(self, extra: str, visible: bool) -> None:
        if visible:
            self._shown_labels.add(extra)
        else:
            self._shown_labels.discard(extra)

    def _labels(self, visible: bool) -> None:
        self._note_labels("labels", visible)
        for nodes in self.front.nodes.values():
            nodes.labels(visible)

    def _frames(self, visible: bool) -> None:
        self._note_labels("frames", visible)
        for nodes in self.front.nodes.values():
            nodes.frames(visible)

    def _axes(self, visible: bool) -> None:
        self._note_labels("axes", visible)
        for nodes in self.front.nodes.values():
            nodes.axes(visible)

    def _switch_handler(self, name: str, box: viser.GuiCheckboxHandle, do):
        return lambda _: self.front.ask(name, lambda: do(box.value))

    def _export(self, work) -> None:
        """Run a long action; refuse further long actions until this action ends, because each action needs a thread."""
        if not self._export_lock.acquire(blocking=False):
            return
        try:
            self._progress.visible = True
            work(lambda part: setattr(self._progress, "value", 100 * part))
        except TwinError as error:  # exceptions in a thread of viser would be lost
            self.front.say(str(error), bad=True)
        finally:
            self._progress.visible = False
            self._export_lock.release()

    def _export_page(self, client: viser.ClientHandle | None) -> None:
        def work(progress) -> None:
            html = view_export.page(self.front, progress)
            if client is not None:
                client.send_file_download(f"{self.front.title}.html".replace(" ", "_"), html.encode())

        self._export(work)

    def _place_robot(self, a: ShownRobot, p: Array, turn: float, scale: float) -> None:
        a.scale = scale
        a.T_world_base = spatial.pose(spatial.rotation_z(turn), p)
        self.front.nodes[a.name].place(a.T_world_base, scale)
        self.front.gizmo.scale = float(np.clip(0.16 * self.front.nodes[a.name].size * scale, 0.01, 2.0))

    # -- surroundings ---------------------------------------------------------------------------------

    def dark(self, on: bool) -> None:
        """Set a dark or light background."""
        self.front.server.gui.configure_theme(
            dark_mode=on, control_width="large", show_logo=False, show_share_button=False
        )
        if on:
            self.grid.cell_color = (58, 64, 72)
            self.grid.section_color = (80, 88, 98)
        else:
            self.grid.cell_color = (205, 211, 219)
            self.grid.section_color = (186, 194, 204)

    def see_through(self, on: bool) -> None:
        """Draw the scene's props transparent (True), to show instruments in the patient, or opaque (False)."""
        assert self.props is not None
        for _, handle in self.props.meshes:
            handle.opacity = 0.3 if on else None

    def patient(self, visible: bool) -> None:
        """Show or hide patient and table of the present protocols.

        For a protocol without a patient, a notice names the protocols that have a patient.
        """
        self._patient_shown = visible
        missing = []
        for robot in self.front.robots:
            if robot.name in self._patients:
                self._patients.pop(robot.name).remove()
                self._show_links(robot, frozenset())
            loaded = robot.movable.robot
            if not visible or loaded.files is None or not loaded.files.protocols():
                continue
            protocol = loaded.protocol(robot.protocol)
            patient = patient_of(loaded, protocol, self._floor - float(robot.T_world_base[2, 3]))
            if patient is None:
                missing.append(none_there(loaded, protocol))
                continue
            self._patients[robot.name] = RobotNodes(
                self.front.server, f"/{robot.name}/patient", patient.mechanism, patient.poses
            )
            self._show_links(robot, frozenset(patient.replaces))
        if missing:
            self.front.say(" ".join(missing))

    def protocol_changed(self) -> None:
        """Update the patient after a change of protocol."""
        if self._patient_shown:
            self.front.ask("table and patient", lambda: self.patient(True))

    def _show_links(self, a: ShownRobot, hidden: frozenset[str]) -> None:
        for name, frame in self.front.nodes[a.name].bodies.items():
            frame.visible = name not in hidden

    def update(self) -> None:
        """Update the shown section, if any, to the present poses of the robots."""
        state = None
        if self._section is not None:
            # a move replaces the assembly of a robot
            states = [id(robot.movable.assembly) for robot in self.front.robots]
            state = (*self._section, *states)
        if state == self._drawn_section:
            return
        self._drawn_section = state
        for a in self.front.robots:
            node = self.front.nodes[a.name]
            point = None
            normal = np.zeros(3)
            if self._section is not None:
                axis, part = self._section
                normal[axis] = 1.0
                point = node.box[0] + part * (node.box[1] - node.box[0])
            node.section(a.movable.assembly.link_poses, point, normal)
