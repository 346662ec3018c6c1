"""The design panel: change equations and distances in the mechanism, compare two designs, compute the workspace."""

from __future__ import annotations

import math
from collections.abc import Callable
from html import escape

import numpy as np
import viser

from twin.core import spatial
from twin.core.errors import AssemblyError, MechanismError
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.model.joint_distance import distances, with_distance
from twin.ui.session.movable_robot import MovableRobot, MoveResult
from twin.ui.session.readings import RobotReading, read
from twin.ui.session.workspace_cloud import Cloud, WorkspaceChunk, job_of
from twin.ui.viewer import readout
from twin.ui.viewer.front import Front, ShownRobot
from twin.ui.viewer.robot_nodes import ORANGE, RobotNodes

MAX_SHOWN_POINTS = 60_000
"""Maximum number of workspace points sent to a browser."""

_DISPLAYED_UNITS = {"mm": (MM, "mm"), "m": (MM, "mm"), "deg": (DEG, "°"), "rad": (DEG, "°")}
"""{unit of a parameter: (its displayed unit in m or rad, sign of this unit)}; other units are displayed as they are."""

_REDRAW_PERIOD = 0.5
"""Time in s between two updates of a workspace that is being computed."""


class DesignPanel:
    """Panel for changes of equations and mechanism; changes are not written to files."""

    def __init__(self, front: Front, tab: viser.GuiTabHandle) -> None:
        self.front = front
        self.gui = front.server.gui
        self._tab = tab
        self._folders: list = []
        self._design_b: MovableRobot | None = None
        self._design_b_nodes: RobotNodes | None = None
        # set when the panel is built; the last two only for a robot with equations
        self._show_b: viser.GuiCheckboxHandle
        self._comparison: viser.GuiHtmlHandle
        self._cloud_text: viser.GuiMarkdownHandle
        self._cloud = Cloud()
        self._cloud_points: list[np.ndarray] = []
        self._cloud_condition: list[np.ndarray] = []
        self._draw_time = 0.0
        self._cloud_robot = ""  # name of the robot whose workspace is computed
        self.rebuild()
        front.after_frame.append(self._poll)

    def close(self) -> None:
        """End the process that computes the workspace."""
        self._cloud.close()

    def rebuild(self) -> None:
        """Build the panel for the active robot."""
        for handle in self._folders:
            handle.remove()
        self._folders = []
        robot = self.front.active
        with self._tab:
            if robot.movable.kin is not None:
                self._add_equations(robot)
            self._add_distances(robot)
            self._add_comparison(robot)
            if robot.movable.kin is not None:
                self._add_workspace(robot)

    # -- equations ------------------------------------------------------------------------------------

    def _add_equations(self, robot: ShownRobot) -> None:
        gui, movable = self.gui, robot.movable
        assert movable.kin is not None
        folder = gui.add_folder("Equations")
        self._folders.append(folder)
        with folder:
            for name, choices in movable.kin.choices.items():
                if len(choices) < 2:
                    continue
                dropdown = gui.add_dropdown(name, choices, initial_value=movable.kin.variants[name])
                dropdown.on_update(self._variant_handler(robot, name, dropdown))
            names = []
            for name, value in movable.kin.parameters.items():
                if isinstance(value, float) and np.isfinite(value):
                    names.append(name)
            if names:
                self._add_parameters(robot, sorted(names))

    def _add_parameters(self, robot: ShownRobot, choosable: list[str]) -> None:
        """Add the controls that change a parameter of the equations."""
        gui, movable = self.gui, robot.movable
        assert movable.kin is not None
        units = {parameter.name: parameter.unit for parameter in movable.kin.formula.parameters}
        chosen = gui.add_dropdown("parameter", choosable)
        number = gui.add_number("value", 0.0, step=0.01)
        reset = gui.add_button("as published")

        def choose(_: object = None) -> None:
            scale, sign = _DISPLAYED_UNITS.get(units.get(chosen.value, ""), (1.0, ""))
            number.label = f"value [{sign}]" if sign else "value"
            number.value = round(movable.kin.parameters[chosen.value] / scale, 6)  # type: ignore[union-attr]

        def change(event: viser.GuiEvent) -> None:
            if event.client is None:
                return
            name = chosen.value
            scale, _ = _DISPLAYED_UNITS.get(units.get(name, ""), (1.0, ""))
            value = number.value * scale

            def apply() -> None:
                movable.change(parameters={name: value})
                self._retry_tool_pose(robot)

            self._ask(apply)

        def reset_value(_: object) -> None:
            def apply() -> None:
                movable.reset_parameter(chosen.value)
                choose()
                self._retry_tool_pose(robot)

            self._ask(apply)

        choose()
        chosen.on_update(choose)
        number.on_update(change)
        reset.on_click(reset_value)

    def _variant_handler(self, robot: ShownRobot, name: str, dropdown: viser.GuiDropdownHandle):
        def choose_variant(event: viser.GuiEvent) -> None:
            value = dropdown.value

            def apply() -> None:
                robot.movable.change(variants={name: value})
                self._retry_tool_pose(robot)

            self._ask(apply)

        return choose_variant

    # -- mechanism ------------------------------------------------------------------------------------

    def _add_distances(self, robot: ShownRobot) -> None:
        gui, movable = self.gui, robot.movable
        by_title = {
            f"{distance.body}: {distance.joint} to {distance.other}": distance
            for distance in distances(movable.robot.mechanism)
        }
        if not by_title:
            return
        folder = gui.add_folder("Mechanism")
        self._folders.append(folder)
        with folder:
            chosen = gui.add_dropdown("distance", tuple(by_title))
            number = gui.add_number("length [mm]", 0.0, step=0.01)
            reset = gui.add_button("as drawn")

        def choose(_: object = None) -> None:
            number.value = round(by_title[chosen.value].distance / MM, 6)

        def change(event: viser.GuiEvent) -> None:
            if event.client is None:
                return
            distance, value = by_title[chosen.value], number.value * MM

            def apply() -> None:
                try:
                    movable.redesign(with_distance(movable.robot.mechanism, distance.joint, distance.other, value))
                except AssemblyError as error:
                    raise MechanismError(
                        f"{distance.joint} to {distance.other} = {value / MM:g} mm: {error}"
                    ) from error
                self.front.rebuilt(robot)
                self.front.panels.show_ghost(True)  # the ghost shows the unedited mechanism

            self._ask(apply)

        def reset_value(_: object) -> None:
            def apply() -> None:
                movable.redesign(movable.robot.mechanism)
                choose()
                self.front.rebuilt(robot)
                self.front.panels.show_ghost(False)

            self._ask(apply)

        choose()
        chosen.on_update(choose)
        number.on_update(change)
        reset.on_click(reset_value)

    # -- two designs ----------------------------------------------------------------------------------

    def _add_comparison(self, robot: ShownRobot) -> None:
        gui = self.gui
        folder = gui.add_folder("Two designs")
        self._folders.append(folder)
        with folder:
            keep = gui.add_button("Keep this design as B")
            self._show_b = gui.add_checkbox("also show B", False, disabled=self._design_b is None)
            self._comparison = gui.add_html("")

        def keep_design(_: object) -> None:
            def apply() -> None:
                design_b = MovableRobot(robot.movable.robot)
                if design_b.kin is not None:
                    design_b.change(robot.movable.variants, robot.movable.parameters)
                if robot.movable.mechanism is not robot.movable.robot.mechanism:
                    design_b.redesign(robot.movable.mechanism)
                design_b.move_joints(robot.movable.assembly.q)
                self._design_b = design_b
                self._show_b.disabled = False
                self._show_b.value = True
                self._show_design_b(True)

            self._ask(apply)

        keep.on_click(keep_design)
        self._show_b.on_update(lambda e: e.client and self._ask(lambda: self._show_design_b(self._show_b.value)))

    def _show_design_b(self, visible: bool) -> None:
        robot = self.front.active
        if self._design_b_nodes is not None:
            self._design_b_nodes.remove()
            self._design_b_nodes = None
        if visible and self._design_b is not None:
            link_poses = self._design_b.assembly.link_poses
            self._design_b_nodes = RobotNodes(
                self.front.server, "/design_b", self._design_b.mechanism, link_poses, ghost=ORANGE
            )
            box = self.front.nodes[robot.name].box
            aside = spatial.pose(p=[0.0, 1.15 * robot.scale * float(box[1, 1] - box[0, 1]), 0.0])
            self._design_b_nodes.place(aside @ robot.T_world_base, robot.scale)

    def unedited_poses(self, robot: ShownRobot) -> dict[str, Array] | None:
        """Return the link poses of the unedited mechanism at the present joint values, for a ghost.

        None if the mechanism is not edited, or if the unedited mechanism cannot be assembled at these joint values.
        """
        if robot.movable.mechanism is robot.movable.robot.mechanism:
            return None
        try:
            return dict(robot.movable.robot.reference().solve(robot.movable.assembly.q).link_poses)
        except AssemblyError:
            return None

    def show(self, reading: RobotReading) -> None:
        """Show the readings of both designs in a table; design B is moved to the tool pose of design A."""
        if self._design_b is None or self._design_b_nodes is None:
            return
        movable = self.front.active.movable
        goal = movable.requested_pose
        if goal is None:
            goal = movable.assembly.T_base_tool
        move_to_goal = self._design_b.move_tool(goal)
        self._design_b_nodes.write(self._design_b.assembly.link_poses)
        reading_b = read(self._design_b)
        rows = [
            ("", "A (active)", "B (orange)"),
            ("condition", _cloud_condition(reading), _cloud_condition(reading_b)),
            ("differs by", residual_html(reading), residual_html(reading_b)),
        ]
        for limit, limit_b in zip(reading.limits, reading_b.limits, strict=True):
            value = f"{limit.value:.3f} {limit.unit}"
            value_b = f"{limit_b.value:.3f} {limit_b.unit}"
            rows.append((limit.joint, value, value_b))
        html = ""
        for row in rows:
            cells = "".join(f"<td style='padding:0 .6em 0 0'>{cell}</td>" for cell in row)
            html += f"<tr>{cells}</tr>"
        table = f"<table style='font-size:12px;margin:0 .8em'>{html}</table>"
        self._comparison.content = table + refusal_html(move_to_goal)

    # -- workspace ------------------------------------------------------------------------------------

    def _add_workspace(self, robot: ShownRobot) -> None:
        gui = self.gui
        folder = gui.add_folder("Workspace")
        self._folders.append(folder)
        with folder:
            gui.add_markdown(
                "Reachable tool positions at the present orientation; **green**: well conditioned, **red**: badly "
                "conditioned."
            )
            edge = gui.add_number(
                "half edge [mm]", round(250 * self.front.nodes[robot.name].size) or 100, min=1, step=10
            )
            count = gui.add_dropdown("poses", ("100 000", "1 000 000"), initial_value="1 000 000")
            begin = gui.add_button("Compute workspace")
            stop = gui.add_button("Hide workspace")
            self._progress = gui.add_progress_bar(0.0)
            self._cloud_text = gui.add_markdown("")

        def compute() -> None:
            self._cloud_points = []
            self._cloud_condition = []
            self._cloud_robot = robot.name
            number = int(count.value.replace(" ", ""))
            job = job_of(robot.movable, robot.source, edge.value * MM, number)
            self._cloud.start(job)

        def hide() -> None:
            self._cloud.cancel()
            self.front.server.scene.remove_by_name(f"/{robot.name}/workspace")
            self._cloud_text.content = ""

        begin.on_click(lambda _: self._ask(compute))
        stop.on_click(lambda _: self._ask(hide))

    def _poll(self) -> None:
        chunk: WorkspaceChunk | None = self._cloud.poll()
        if chunk is None:
            return
        if chunk.error:
            self._cloud_text.content = f"<span style='color:#d62f2f'>{chunk.error}</span>"
            return
        self._cloud_points.append(chunk.points)
        self._cloud_condition.append(chunk.condition)
        is_complete = chunk.evaluated >= chunk.count
        if not is_complete and self.front.now - self._draw_time < _REDRAW_PERIOD:
            return
        self._draw_time = self.front.now
        points = np.concatenate(self._cloud_points)
        condition = np.concatenate(self._cloud_condition)
        self._progress.value = 100.0 * chunk.evaluated / chunk.count
        self._cloud_text.content = f"{_grouped(chunk.evaluated)} poses, **{_grouped(len(points))}** reachable"
        if not len(points):
            return
        step = point_step(len(points))
        self.front.server.scene.add_point_cloud(
            f"/{self._cloud_robot}/workspace",
            points[::step],
            condition_colors(condition[::step]),
            point_size=0.002,
            point_shape="circle",
            precision="float32",
        )

    def _ask(self, change: Callable[[], object]) -> None:
        self.front.ask("design", change)

    def _retry_tool_pose(self, robot: ShownRobot) -> None:
        """Move the robot to the last requested tool pose again, because the equations have changed."""
        goal = robot.movable.requested_pose
        if goal is None:
            goal = robot.movable.assembly.T_base_tool
        robot.movable.move_tool(goal)
        self.front.rebuilt(robot)


def point_step(count: int) -> int:
    """Return the step between the workspace points that are shown, at most `MAX_SHOWN_POINTS` of `count`."""
    return max(1, math.ceil(count / MAX_SHOWN_POINTS))


def _grouped(number: int) -> str:
    """Return a number with a space between groups of three digits."""
    return f"{number:,}".replace(",", " ")


def residual_html(reading: RobotReading) -> str:
    """Return a text on the largest difference between equations and mechanism: value with unit, and quantity."""
    if reading.residual is None:
        return "-"
    if not reading.comparable:
        return escape(reading.incomparable)
    what = f" ({escape(reading.residual.what)})" if reading.residual.what else ""
    return readout.residual_text(reading.residual) + what


def _cloud_condition(reading: RobotReading) -> str:
    if not reading.condition:
        return "-"
    return f"{reading.condition:.2f}"


def refusal_html(move_to_goal: MoveResult) -> str:
    """Return an HTML text on why design B cannot reach the pose of design A; "" if it can."""
    if move_to_goal.good:
        return ""
    text = f"Design B cannot reach the pose of design A and is shown at its nearest pose: {move_to_goal.reason}"
    return f"<div style='color:#d62f2f;font-size:12px;margin:.4em .8em' data-b-refused>{escape(text)}</div>"


def condition_colors(condition: np.ndarray) -> np.ndarray:
    """Return colours (m, 3), 0 to 255, for condition numbers (m,): green up to 3, red from 100, logarithmic between."""
    logarithm = np.log10(np.maximum(condition, 1e-9))
    # 0 at a condition number of 3, 1 at 100
    s = np.clip((logarithm - np.log10(3)) / (2 - np.log10(3)), 0, 1)[:, None]
    green, yellow, red = np.array([[31, 138, 85], [235, 190, 50], [214, 47, 47]], float)
    color = np.where(s < 0.5, green + 2 * s * (yellow - green), yellow + (2 * s - 1) * (red - yellow))
    return color.astype(np.uint8)
