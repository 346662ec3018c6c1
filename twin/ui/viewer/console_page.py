"""The page of a scene that is controlled from its console: the same World as in `twin serve`, with viser's controls.

Users move two handles (`twin.ui.session.pens`) by arrows at the tools, by sliders and by pedals. The motions of the
handles are the input of the World (`twin.ui.session.scene_control`).
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from html import escape
from typing import Any

import numpy as np
import viser

from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.json_types import JsonMapping, JsonObject
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.model.console import CameraTable
from twin.model.task import goal_of
from twin.reference import ReferenceModel
from twin.simulation.console_scene import HANDS, drag
from twin.simulation.controllers.jaw import GripParameters
from twin.simulation.controllers.pivot import FULCRUMS
from twin.simulation.controllers.tool_following import SCALE
from twin.simulation.tasks.align import task as alignment
from twin.simulation.tasks.align.task import Alignment
from twin.ui.session import plan_view
from twin.ui.session.exercise import NO_TASK, Exercise
from twin.ui.session.loaded_scene import LoadedScene
from twin.ui.session.pens import Pens
from twin.ui.session.scene_control import LiveConsole
from twin.ui.viewer.fields import FieldNodes
from twin.ui.viewer.loop import ViewerPage
from twin.ui.viewer.nodes import BLUE, RobotNodes, object_nodes
from twin.ui.viewer.planning import PlanningPanel
from twin.ui.viewer.room import FIRST, OUTSIDE, extent, furnish
from twin.ui.viewer.score import ScorePanel
from twin.ui.viewer.trainer_panel import TrainerPanel

ARROWS = 90.0
"""Size in pixels of the arrows at a tool, independent of their distance from the camera."""

CLOSE = np.array([0.15, -0.26, 0.2])
"""Vector (3,) in m from the mean position of the tools to the camera, for the view "close"."""

AWAY = 0.7
"""Factor on the usual distance of the camera in the views from outside, below 1 because the scene is wide and low."""

FAR = 100.0
"""Maximum distance in m from the camera at which objects are drawn in views of the room."""

CAVITY = 0.4
"""The same distance in the endoscope's view, in which only the cavity is visible."""

BEFORE_LENS = 0.01
"""Distance in m from the lens to the target line of a camera task."""

THICK = 0.006
"""Thickness of this line as a fraction of the picture's height."""

_FELT = 0.05
"""Smallest force on a hand in N that is shown."""

STILL = 1e-9
"""Largest joint motion in rad or m between two frames that counts as rest; rounding errors move an arm at a limit."""

RESTS = 0.2
"""Time in s without motion after which the handle of a tool that could not reach its goal is moved back to the tool."""

TOUCHED = 0.7
"""Time in s, after a user has changed a control, during which the control is not set to the value in the World."""

_CAMERA = (("pan [°]", DEG, 0.5), ("tilt [°]", DEG, 0.5), ("depth [mm]", MM, 0.5), ("roll [°]", DEG, 0.5))
_TONES = {"good": "#1f8a55", "warn": "#c77700", "bad": "#d62f2f", "plain": "inherit"}
_HELP = """Drag the arrows at an instrument to move it, and the rings to rotate it. While the pedal **camera** is
pressed, the arrows move the endoscope's picture. While the pedal **clutch** is pressed, only the arrows move."""


class ConsoleFront(ViewerPage):
    """The page of a scene with a console.

    Attributes:
        console: the scene's World and its console.
        pens: the handles that this page moves.
        nodes: scene nodes of each robot and each movable object.
        arrows: transform controls at the tool of each hand, by hand.
    """

    def __init__(
        self,
        title: str,
        loaded: LoadedScene,
        server: viser.ViserServer,
        exercise: Exercise = NO_TASK,
        stopping: threading.Event | None = None,
    ) -> None:
        """Create World and page.

        Args:
            title: title of the page.
            loaded: a scene with a console; the models of its machines are shown as ghosts.
            server: the server of viser.
            exercise: task, condition, session file and report.
            stopping: event that ends the page.

        Raises:
            TwinError: the scene has no console, its robots do not match the console, or its props do not match the
                task.
        """
        super().__init__(server, title, stopping)
        self.console = LiveConsole(loaded, exercise)
        self._fields: FieldNodes | None = None
        if self.console.feed is not None:
            self._fields = FieldNodes(server, self.console.feed)
        self.pens = Pens(self.console)
        camera = loaded.scene.cameras[self.console.table.camera]
        self._view_angle = camera.view_deg * DEG
        self._poses = poses = self.console.world.frame().link_poses
        self.nodes: dict[str, RobotNodes] = {}
        for name, member in self.console.shown.items():
            # the model of a machine is a ghost
            ghost = None if name in self.console.members else BLUE
            self.nodes[name] = RobotNodes(server, f"/{name}", member.mechanism, poses[name], ghost)
        for item in self.console.objects:
            self.nodes[item.name] = object_nodes(server, item, poses[item.name][item.name])
        boxes = [nodes.box for nodes in self.nodes.values()]
        self.props: RobotNodes | None = None
        goal = goal_of(exercise.task, Alignment)
        if goal is not None:
            self._draw_line(server, camera, goal.line)
        props = alignment.beside(loaded.props, goal)
        if props is not None:
            self.props = RobotNodes(server, f"/{props.name}", props, ReferenceModel(props).home().link_poses)
            boxes.append(self.props.box)
        low, self._middle, self._size = extent(boxes)
        furnish(server, self._middle, self._size, min(0.0, float(low[2])))
        self._shown = self.console.state_row()
        self._rest_time = 0.0
        self._left_to_settle: set[str] = set()
        self._T_arrows = {hand: self.console.moved(hand) for hand in HANDS}
        self._dragged: set[str] = set()
        self._touched: dict[str, float] = {}
        self._written: JsonObject = {}
        self._through: set[int] = set()
        self._T_endoscope = np.zeros((4, 4))
        self.arrows = {hand: self._arrows(hand) for hand in HANDS}
        self._panel()
        eye, target, _ = self.camera("close")
        server.initial_camera.position = eye
        server.initial_camera.look_at = target
        server.on_client_disconnect(lambda client: self.ask(f"gone {client.client_id}", lambda: self._forget(client)))

    # -- the loop -------------------------------------------------------------------------------------

    def frame(self, passed: float, wished: bool) -> None:
        """Send the hand states to the World, step the World by the elapsed time `passed`, and show its state."""
        self.pens.say(passed)
        for text in self.console.advance(passed):
            self.say(text, bad=True)
        row = self.console.state_row()
        moved = bool(np.abs(row - self._shown).max() > STILL)
        if moved or wished or not self.pens.settled:
            self._rest_time = 0.0
        else:
            self._rest_time += passed
        if moved:
            self._shown = row
            self._poses = self.console.world.frame().link_poses
            for name, nodes in self.nodes.items():
                nodes.write(self._poses[name])
        if self._fields is not None and self._fields.follow(lambda robot: self._poses[robot], passed):
            self._bend(self._fields)
        if self._rest_time > RESTS:
            for hand in self._left_to_settle - self._dragged:
                self.pens.settle(hand)
            self._left_to_settle &= self._dragged
        self._follow()
        self._look_through()
        self._show()

    def _bend(self, fields: FieldNodes) -> None:
        """Show the deformables, and a notice of their first error."""
        error = fields.show(self.console.world.t)
        if error:
            self.say(error, bad=True)

    def close(self) -> None:
        """Release the hands and the port."""
        self.pens.release()
        self.console.close()
        super().close()

    # -- arrows ---------------------------------------------------------------------------------------

    def _arrows(self, hand: str) -> viser.TransformControlsHandle:
        T = self._T_arrows[hand]
        arrows = self.server.scene.add_transform_controls(
            f"/hands/{hand}",
            scale=ARROWS,
            fixed=True,
            depth_test=False,
            position=T[:3, 3],
            wxyz=spatial.quat_from_matrix_wxyz(T[:3, :3]),
        )

        @arrows.on_update
        async def _(event: viser.TransformControlsEvent) -> None:
            if event.client is None:
                return
            R = spatial.matrix_from_quat_wxyz(np.array(event.target.wxyz))
            T = spatial.pose(R, np.array(event.target.position))
            client = _name(event.client)
            ended = event.phase == "end"
            self.ask(hand, lambda: self._move(hand, client, T, ended))

        return arrows

    def _move(self, hand: str, client: str, T: Array, ended: bool) -> None:
        T_old = self._T_arrows[hand]
        self._T_arrows[hand] = T
        self._dragged.discard(hand)
        self.pens.move(client, hand, T_old, T)
        self._left_to_settle.add(hand)
        if not ended:
            self._dragged.add(hand)

    def _follow(self) -> None:
        """Move the arrows to the tools or the target; skip arrows that are dragged, or that a tool still follows."""
        for hand, arrows in self.arrows.items():
            if hand in self._dragged or hand in self._left_to_settle or self.wished(hand):
                continue
            T = self.console.moved(hand)
            if np.array_equal(T, self._T_arrows[hand]):
                continue
            self._T_arrows[hand] = T
            arrows.position = T[:3, 3]
            arrows.wxyz = spatial.quat_from_matrix_wxyz(T[:3, :3])

    def _forget(self, client: viser.ClientHandle) -> None:
        """Release the hands if the browser that has closed the page controlled them."""
        self._through.discard(client.client_id)
        if self.pens.client == _name(client):
            self._dragged.clear()
            self.pens.release()
            self.say(f"{_name(client)} was closed: nothing moves")

    # -- views ----------------------------------------------------------------------------------------

    def _draw_line(self, server: viser.ViserServer, camera: CameraTable, length: float) -> None:
        """Draw a grey line before the lens; `length` is a fraction of the picture's height."""
        frame = self.console.members[camera.robot].mechanism.frame(camera.frame)
        T = frame.T_body_frame @ camera.in_frame
        height = 2 * BEFORE_LENS * np.tan(self._view_angle / 2)
        server.scene.add_box(
            f"/{camera.robot}/{frame.body}/line",
            color=(154, 154, 154),
            dimensions=(length * height, THICK * height, THICK * height),
            wxyz=spatial.quat_from_matrix_wxyz(T[:3, :3]),
            position=T[:3, 3] + BEFORE_LENS * T[:3, 2],
            cast_shadow=False,
            receive_shadow=False,
        )

    def camera(self, view: str) -> tuple[Array, Array, Array]:
        """Return (camera position, target, up vector) of a view, each (3,) in m in the World."""
        if view == "endoscope":
            T = self.console.view
            lens = T[:3, 3]
            # the camera looks against the z axis of the picture
            return lens, lens - 0.08 * T[:3, 2], T[:3, 1]
        up = np.array([0.0, 0.0, 1.0])
        if view == "close":
            tools = [self.console.tool(hand)[:3, 3] for hand in HANDS]
            middle = np.mean(tools, axis=0)
            return middle + CLOSE, middle, up
        return self._middle + AWAY * self._size * OUTSIDE[view], self._middle, up

    def look(self, view: str, client: viser.ClientHandle) -> None:
        """Move the camera of a browser to a view; in the endoscope's view, the camera follows the endoscope."""
        eye, target, up = self.camera(view)
        with client.atomic():
            client.camera.up_direction = up
            client.camera.position = eye
            client.camera.look_at = target
            if view == "endoscope":
                self._through.add(client.client_id)
                client.camera.fov = self._view_angle
                client.camera.near = 0.001
                client.camera.far = CAVITY
            else:
                self._through.discard(client.client_id)
                client.camera.fov = FIRST * DEG
                client.camera.near = 0.01
                client.camera.far = FAR

    def _look_through(self) -> None:
        """Move the cameras of the browsers with the endoscope's view to the endoscope."""
        if np.array_equal(self.console.view, self._T_endoscope):
            return
        self._T_endoscope = self.console.view.copy()
        for client in self.server.get_clients().values():
            if client.client_id in self._through:
                self.look("endoscope", client)

    # -- controls -------------------------------------------------------------------------------------

    def _panel(self) -> None:
        gui = self.server.gui
        pens = self.pens
        gui.set_panel_label(self.title)
        gui.configure_theme(control_width="large", show_logo=False, show_share_button=False)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(350)
        self._status = gui.add_html("")
        self._score = None
        if self.console.referee is not None:
            self._score = ScorePanel(
                self.server,
                self.console,
                lambda client: self.ask("end", lambda: self.console.end(client)),
                lambda client: self.ask("restart", lambda: self._restart(client)),
            )
        self._trainer = None
        if self.console.machines is not None:
            self._trainer = TrainerPanel(gui, self.console, self.pens, self._on_click)
        gui.add_markdown(_HELP)
        views = gui.add_button_group("look", ("close", "endoscope", *OUTSIDE))
        views.on_click(lambda e: e.client and self.look(views.value, e.client))
        with gui.add_folder("Pedals"):
            self._clutch = gui.add_checkbox("clutch", False, hint="The pedal stays pressed until you click again")
            self._pedal = gui.add_checkbox("camera", False, hint="The pedal stays pressed until you click again")
            self._on(self._clutch, "clutch", lambda client, v: pens.press(client, clutch=v))
            self._on(self._pedal, "camera pedal", lambda client, v: pens.press(client, camera=v))
        self._planning = PlanningPanel(self.server, self.console, pens, self._on_click)
        with gui.add_folder("Instruments"):
            self._scale = gui.add_slider("motion scale", *SCALE, 0.01, self.console.table.scale)
            self._on(self._scale, "scale", self.console.rescale)
            self._jaws = {}
            for hand in HANDS:
                slider = gui.add_slider(f"{hand} jaw [% open]", 0, 100, 1, 0, hint=self.console.arm(hand))
                self._jaws[hand] = slider
                self._on(slider, f"jaw {hand}", lambda client, v, hand=hand: pens.squeeze(client, hand, v / 100))
        self._haptics = gui.add_checkbox("forces", self.console.reading["haptics"], hint="Forces on the hands")
        self._on(self._haptics, "haptics", self.console.feel)
        self._choices(gui)
        with gui.add_folder("Camera"):
            limits = drag(self.console.table)
            values = self.console.camera_at
            self._camera = []
            for k, (name, unit, step) in enumerate(_CAMERA):
                low = limits.lower[k] / unit
                high = limits.upper[k] / unit
                slider = gui.add_slider(name, low, high, step, _rounded(values[k], unit, step))
                self._camera.append(slider)
                self._on(slider, f"aim {k}", lambda client, v, k=k, unit=unit: pens.aim(client, k, v * unit))
        let_go = gui.add_button(
            "Release the hands", hint="Let other clients use the hands; also happens after 5 s without use"
        )
        let_go.on_click(lambda _: self.ask("let go", pens.release))
        if self.props is not None:
            clear = gui.add_checkbox("transparent patient", True)
            clear.on_update(lambda _: self.ask("clear", lambda: self._see_through(clear.value)))
            self._see_through(True)

    def _choices(self, gui: viser.GuiApi) -> None:
        """Add the controls for the fulcrum and for the tools, if the scene has them."""
        self._tools: JsonObject = {}
        tools = {tool.title: name for name, tool in self.console.scene.tools.items()}
        if tools:
            for hand in HANDS:
                choice = gui.add_dropdown(f"tool of the {hand} hand", list(tools), initial_value=self._tool(hand))
                self._on(choice, f"tool {hand}", lambda c, v, hand=hand: self.console.take_tool(c, hand, tools[v]))
                self._tools[hand] = choice
        self._direct = None
        fulcrum = self.console.reading["fulcrum"]
        if fulcrum is not None:
            self._direct = gui.add_checkbox(
                "direct fulcrum", fulcrum == "direct", hint="The hands move the outer ends of the instruments"
            )
            self._on(self._direct, "fulcrum", lambda c, v: self.console.choose_fulcrum(c, FULCRUMS[int(v)]))

    def _tool(self, hand: str) -> str:
        """Return the title of the tool of a hand."""
        return self.console.scene.tools[self.console.reading["hands"][hand]["tool"]].title

    def _on_click(self, button: Any, kind: str, do: Callable[[str], object]) -> None:
        """Store a request when a user presses a button."""

        def pressed(event: viser.GuiEvent) -> None:
            if event.client is not None:
                client = _name(event.client)
                self.ask(kind, lambda: do(client))

        button.on_click(pressed)

    def _on(self, control: Any, kind: str, do: Callable[[str, Any], object]) -> None:
        """Store a request when a user changes a control; ignore changes by the page itself."""

        def changed(event: viser.GuiEvent) -> None:
            if event.client is None:
                return
            client = _name(event.client)
            value = control.value
            self._touched[kind] = self.now
            self.ask(kind, lambda: wish(client, value))

        def wish(client: str, value: Any) -> None:
            try:
                do(client, value)
            except TwinError:
                self._written.pop(kind, None)  # the control shows the value in the World again
                raise

        control.on_update(changed)

    def _see_through(self, on: bool) -> None:
        assert self.props is not None
        for body, handle in self.props.meshes:
            handle.opacity = 0.3 if on and body == "patient" else None

    def _restart(self, client: str) -> None:
        self.console.restart(client)
        self.pens.release()
        self._dragged.clear()
        self._left_to_settle.clear()

    def _felt(self) -> list[tuple[str, str]]:
        """Return [(tone, text)] on the forces on the hands; [] without a force."""
        texts = []
        for hand, force in self.console.forces().items():
            size = float(np.linalg.norm(force))
            if size >= _FELT:
                texts.append(f"{hand} {size:.1f} N")
        if not texts:
            return []
        return [("warn", f"Force: {', '.join(texts)}")]

    def _show(self) -> None:
        """Set the controls to the values in the World, and show the status."""
        pens = self.pens
        reading = self.console.reading
        self._set(self._clutch, "clutch", pens.clutch)
        self._set(self._pedal, "camera pedal", pens.camera)
        self._set(self._haptics, "haptics", reading["haptics"])
        for hand, choice in self._tools.items():
            self._set(choice, f"tool {hand}", self._tool(hand))
        if self._direct is not None:
            self._set(self._direct, "fulcrum", reading["fulcrum"] == "direct")
        self._set(self._scale, "scale", reading["scale"], 0.005)
        for hand, slider in self._jaws.items():
            percent_open = round(100 * pens.pens[hand].grip / GripParameters().travel)
            self._set(slider, f"jaw {hand}", percent_open, 0.5)
        values = self.console.camera_at
        for k, slider in enumerate(self._camera):
            _, unit, step = _CAMERA[k]
            if pens.aims:
                self._written.pop(f"aim {k}", None)
            else:
                self._set(slider, f"aim {k}", _rounded(values[k], unit, step), step / 2)
        planned = plan_view.status(reading["plan"], self.console.planning.preview)
        lines = [status(reading, planned)]
        for hand in HANDS:
            lines.append(hand_text(reading, hand))
        lines += self._felt()
        html = ""
        for tone, text in lines:
            html += f"<div style='padding:0 1em .4em;color:{_TONES[tone]}'>{escape(text)}</div>"
        self._status.content = html
        self._planning.show(self.now)
        if self._trainer is not None:
            self._trainer.show(self.console.world.t)
        if self._score is not None:
            self._score.show(self.console.reading["task"])

    def _set(self, control: Any, kind: str, value: Any, apart: float = 0.0) -> None:
        """Set a control to `value`, if `value` has changed and differs from the control's value by more than `apart`.

        A control that a user has just changed is not set.
        """
        if value == self._written.get(kind) or self.wished(kind):
            return
        if self.now - self._touched.get(kind, -np.inf) < TOUCHED:
            return
        self._written[kind] = value
        if isinstance(value, str):
            differs = control.value != value
        else:
            differs = abs(control.value - value) > apart
        if differs:
            control.value = value


def _rounded(value: float, unit: float, step: float) -> float:
    return step * round(float(value) / unit / step)


def _name(client: viser.ClientHandle) -> str:
    return f"page {client.client_id + 1}"


def status(reading: JsonMapping, planned: tuple[str, str] | None = None) -> tuple[str, str]:
    """Return (tone, text): the most important information on the state of a `LiveConsole`.

    The tone is "good", "warn", "bad" or "plain". `planned` is the status (tone, text) of planning mode; None: no
    status.
    """
    moved = []
    walls = []
    for hand in reading["hands"].values():
        if hand["follows"]:
            moved.append(hand["robot"])
        if hand["wall"]:
            walls.append(f"{hand['robot']}: {hand['wall']}")
    if reading["stopped"]:
        return "bad", f"The simulation has stopped: {reading['stopped']}"
    if reading["task"] and reading["task"]["over"]:
        return "good", f"{reading['task']['over']} Press Restart to begin again."
    if planned is not None:
        return planned
    if reading["owner"] is None:
        return "plain", "No client controls the hands: nothing moves."
    if reading["silent"]:
        return "warn", f"No data from {reading['owner']}: nothing moves."
    if walls:
        return "warn", "; ".join(walls)
    if reading["camera"]:
        return "warn", f"Camera: {reading['camera']}"
    if reading["rate"] < 0.8:
        return "warn", f"The simulation runs at {reading['rate']}x real time."
    if reading["mode"] == "nothing":
        return "good", "Clutch: only the arrows move; the instruments are at rest."
    if reading["mode"] == "camera":
        return "good", "Camera: both hands move the picture."
    return "good", f"{reading['owner']} controls {' and '.join(moved) or 'no arm'}."


def hand_text(reading: JsonMapping, hand: str) -> tuple[str, str]:
    """Return (tone, text) on one hand: its robot, and whether the robot follows, is at rest or is at a limit."""
    state = reading["hands"][hand]
    plan = reading["plan"]
    tone = "plain"
    motion = "is at rest"
    if state["follows"]:
        tone = "good"
        motion = "follows"
        if plan is not None and plan["phase"] == "aim":
            motion = "is at rest; its target follows"
    if state["wall"]:
        tone = "warn"
        motion = state["wall"]
    return tone, f"{hand.capitalize()} hand: {state['robot']} {motion}"
