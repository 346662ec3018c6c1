"""Surroundings of the robots (floor, table, patient, trocars, shafts, tip paths), cameras, sections and pictures."""

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
from twin.ui.session.patient import none_there, patient_of
from twin.ui.session.trocars import in_trocars, rcm_at
from twin.ui.viewer import view_export
from twin.ui.viewer.front import Front, ShownRobot
from twin.ui.viewer.nodes import BLUE, ORANGE, RobotNodes
from twin.ui.viewer.room import FIRST, OUTSIDE, corners, furnish

VIEWS = (*OUTSIDE, "along the shaft", "endoscope", "microscope")
ENDOSCOPE = 70
"""Vertical angle of view in deg of the camera in the endoscope view, as of a common laparoscope."""

_CUTS = ("none", "x", "y", "z")


class Scenery:
    """The surroundings of all robots, and the cameras of the browsers."""

    def __init__(self, front: Front, props: Mechanism | None) -> None:
        self.front, self.scene = front, front.server.scene
        found = [front.nodes[a.name].to_world(c) for a in front.actors for c in corners(front.nodes[a.name].box)]
        self.props: RobotNodes | None = None
        if props is not None:
            poses = ReferenceModel(props).home().link_poses
            self.props = RobotNodes(front.server, f"/{props.name}", props, poses)
            found += list(corners(self.props.box))
        low, high = np.min(found, axis=0), np.max(found, axis=0)
        self.middle, self.size = 0.5 * (low + high), float(np.linalg.norm(high - low))
        floor = float(low[2]) if props is None else min(0.0, float(low[2]))
        self.grid = furnish(front.server, self.middle, self.size, floor)
        self._floor = floor
        self._patients: dict[str, RobotNodes] = {}
        self._patient_shown = False
        self._gizmo_wanted, self._through_lens = True, False
        self._trail: dict[str, list[viser.SceneNodeHandle]] = {}
        self._trail_shown = True
        self._lines: dict[str, viser.LineSegmentsHandle] = {}
        self._balls: dict[str, viser.IcosphereHandle] = {}
        self._cut: tuple[int, float] | None = None
        self._one = threading.Lock()
        self._cut_drawn: tuple | None = None

    # -- the instrument -------------------------------------------------------------------------------

    def trail(self, visible: bool) -> None:
        """Show or hide the tip path of each robot's protocol, and trocars and shafts."""
        self._trail_shown = visible
        for a in self.front.actors:
            for handle in self._trail.pop(a.name, []):
                handle.remove()
            if a.playback is None or not visible:
                continue
            tip = a.playback.tip[:: max(1, len(a.playback.t) // 600)]
            line = self.scene.add_line_segments(
                f"/{a.name}/trail", np.stack([tip[:-1], tip[1:]], axis=1).astype(np.float32), BLUE,
                thickness=2.0, thickness_units="screen",
            )  # fmt: skip
            self._trail[a.name] = [line]

    def follow(self) -> None:
        """Draw trocars and shafts at the present poses; a shaft whose trocar error is 2 mm or more is not drawn."""
        shown = set()
        for a in self.front.actors if self._trail_shown else ():
            size = self.front.nodes[a.name].size
            found = in_trocars(a.desk, rcm_at(a.playback, self.front.clock.time))
            for t in found:
                key = f"{a.name}/{t.name}" if len(found) > 1 else a.name
                shown.add(key)
                end = t.place + 0.12 * size * t.axis if t.tip is None else t.tip
                ends = np.array([[end, t.place - 0.12 * size * t.axis]], np.float32)
                if key not in self._lines:
                    of = f"_{t.name}" if len(found) > 1 else ""
                    self._lines[key] = self.scene.add_line_segments(
                        f"/{a.name}/shaft_axis{of}", ends, ORANGE, thickness=2.0, thickness_units="screen"
                    )
                    self._balls[key] = self.scene.add_icosphere(
                        f"/{a.name}/rcm{of}", 0.007 * size, ORANGE, cast_shadow=False
                    )
                self._lines[key].points = ends
                self._balls[key].position = t.place
                missed = np.linalg.norm(np.cross(t.place - end, t.axis))
                self._balls[key].visible, self._lines[key].visible = True, bool(missed < 2 * MM)
        for key in self._lines.keys() - shown:
            self._lines[key].visible = self._balls[key].visible = False

    # -- the panel ------------------------------------------------------------------------------------

    def panel(self) -> None:
        """Create the controls for camera views, displayed objects, section, displayed size and place, and pictures."""
        gui, front = self.front.server.gui, self.front
        views = gui.add_dropdown("camera", VIEWS)
        look = gui.add_button("Look from there")
        look.on_click(lambda e: self.look(views.value, e.client))
        views.on_update(lambda e: self.look(views.value, e.client))
        with gui.add_folder("Show"):
            boxes = {
                "floor": (True, lambda v: setattr(self.grid, "visible", v)),
                "table and patient": (False, self.patient),
                "link names": (False, lambda v: [n.labels(v) for n in front.nodes.values()]),
                "link frames": (False, lambda v: [n.frames(v) for n in front.nodes.values()]),
                "joint axes": (False, lambda v: [n.axes(v) for n in front.nodes.values()]),
                "gizmo at the tool": (True, self.gizmo),
                "dark": (False, self.dark),
            }
            if self.props is not None:
                del boxes["table and patient"]  # the scene's props include table and patient
                boxes["transparent surroundings"] = (False, self.see_through)
            for name, (first, do) in boxes.items():
                box = gui.add_checkbox(name, first)
                box.on_update(self._switch(name, box, do))
        with gui.add_folder("Section"):
            axis = gui.add_dropdown("cut across", _CUTS)
            part = gui.add_slider("where [%]", 0, 100, 1, 50)

            def cut(_: object) -> None:
                self._cut = None if axis.value == "none" else (_CUTS.index(axis.value) - 1, part.value / 100)
                front.ask("cut", lambda: None)

            axis.on_update(cut)
            part.on_update(cut)
        with gui.add_folder("Size and place", expand_by_default=False):
            gui.add_markdown("These controls change only the display; no reading depends on them.")
            scale = gui.add_slider("size", 0.1, 10.0, 0.1, 1.0)
            place = gui.add_vector3("place [mm]", (0.0, 0.0, 0.0), step=10.0)
            yaw = gui.add_slider("turn [°]", -180, 180, 1, 0)

            def put(e: viser.GuiEvent) -> None:
                p, s, turn = np.array(place.value) * MM, scale.value, yaw.value * DEG
                if e.client is not None:
                    front.ask("place", lambda: self._put(front.hand, p, turn, s))

            for handle in (scale, place, yaw):
                handle.on_update(put)
        with gui.add_folder("Pictures"):
            shot = gui.add_button("Screenshot")
            turn = gui.add_button("Turntable (GIF)")
            page = gui.add_button("Recording without Python (HTML)")
            self._progress = gui.add_progress_bar(0.0, visible=False)
            shot.on_click(lambda e: self._busy(lambda p: view_export.screenshot(e.client, front.title, p)))
            turn.on_click(lambda e: self._busy(lambda p: view_export.turntable(e.client, front.title, p)))
            page.on_click(lambda e: front.ask("page", lambda: self._page(e.client)))

    def _switch(self, name: str, box: viser.GuiCheckboxHandle, do):
        return lambda _: self.front.ask(name, lambda: do(box.value))

    def _busy(self, work) -> None:
        """Run a long action; refuse further long actions until this action ends, because each action needs a thread."""
        if not self._one.acquire(blocking=False):
            return
        try:
            self._progress.visible = True
            work(lambda part: setattr(self._progress, "value", 100 * part))
        except TwinError as error:  # exceptions in a thread of viser would be lost
            self.front.say(str(error), bad=True)
        finally:
            self._progress.visible = False
            self._one.release()

    def _page(self, client: viser.ClientHandle | None) -> None:
        def work(progress) -> None:
            html = view_export.page(self.front, progress)
            if client is not None:
                client.send_file_download(f"{self.front.title}.html".replace(" ", "_"), html.encode())

        self._busy(work)

    def _put(self, a: ShownRobot, p: Array, turn: float, scale: float) -> None:
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
        self.grid.cell_color = (58, 64, 72) if on else (205, 211, 219)
        self.grid.section_color = (80, 88, 98) if on else (186, 194, 204)

    def gizmo(self, on: bool) -> None:
        """Show or hide the handle (gizmo) at the tool; it is always hidden in the endoscope view."""
        self._gizmo_wanted = on
        self.front.gizmo.visible = on and not self._through_lens

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
        for a in self.front.actors:
            if a.name in self._patients:
                self._patients.pop(a.name).remove()
                self._show_links(a, frozenset())
            robot = a.desk.robot
            if not visible or robot.files is None or not robot.files.protocols():
                continue
            protocol = robot.protocol(a.protocol)
            patient = patient_of(robot, protocol, self._floor - float(a.T_world_base[2, 3]))
            if patient is None:
                missing.append(none_there(robot, protocol))
                continue
            self._patients[a.name] = RobotNodes(
                self.front.server, f"/{a.name}/patient", patient.mechanism, patient.poses
            )
            self._show_links(a, frozenset(patient.replaces))
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
        state = None if self._cut is None else (*self._cut, *(id(a.desk.assembly) for a in self.front.actors))
        if state == self._cut_drawn:
            return
        self._cut_drawn = state
        for a in self.front.actors:
            node = self.front.nodes[a.name]
            point = None
            normal = np.zeros(3)
            if self._cut is not None:
                axis, part = self._cut
                normal[axis] = 1.0
                point = node.box[0] + part * (node.box[1] - node.box[0])
            node.section(a.desk.assembly.link_poses, point, normal)

    def look(self, view: str, client: viser.ClientHandle | None) -> None:
        """Move the camera of a browser to a preset view; if `client` is None, move the cameras of all browsers."""
        clients = [client] if client is not None else list(self.front.server.get_clients().values())
        eye, at, up = self.camera(view)
        inside = view == "endoscope"
        self._through_lens = inside
        self.front.gizmo.visible = self._gizmo_wanted and not inside  # it would cover the endoscope view
        for c in clients:
            with c.atomic():
                c.camera.up_direction = up
                c.camera.position = eye
                c.camera.look_at = at
                c.camera.fov = (ENDOSCOPE if inside else FIRST) * DEG
                c.camera.near = 0.001 if inside else 0.01

    def camera(self, view: str) -> tuple[Array, Array, Array]:
        """Return (camera position, target, up vector) of a preset view, each (3,) in m in the world frame."""
        a = self.front.hand
        node = self.front.nodes[a.name]
        tip, axis = a.desk.shaft()
        lens, sight, above = (node.to_world(x) for x in a.desk.camera())
        R = node.to_world(np.eye(3)[0]) - node.to_world(np.zeros(3))  # x axis of the base in world, with scale
        size = node.size * a.scale
        p, up = node.to_world(tip), np.array([0.0, 0.0, 1.0])
        along = node.to_world(tip + axis) - p
        along /= np.linalg.norm(along)
        side = R / np.linalg.norm(R) if abs(along[2]) > 0.9 else up
        return {
            **{name: (self.middle + self.size * way, self.middle, up) for name, way in OUTSIDE.items()},
            "along the shaft": (p - 0.6 * size * along + 0.04 * size * side, p, side),
            "endoscope": (lens, sight, (above - lens) / np.linalg.norm(above - lens)),
            "microscope": (p + 0.25 * size * up + 0.05 * size * np.array([1.0, -1.0, 0]), p, up),
        }[view]
