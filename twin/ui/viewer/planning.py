"""Planning mode in the page of a console: buttons, ghost, planned motion, and clearance of the motion.

Both this page and the page of `twin serve` use the planning mode of `twin.ui.session.plan_mode`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import viser

from twin.core.spatial import Array
from twin.core.units import MM
from twin.simulation.console_scene import HANDS
from twin.ui.session import plan_view
from twin.ui.session.pens import Pens
from twin.ui.session.plan_mode import Preview
from twin.ui.session.scene_control import LiveConsole, PlanStep
from twin.ui.viewer.nodes import BLUE, GREEN, RED, RobotNodes

_TREE = (123, 135, 148)
_BOUND = "#d81b2a"

_OPACITY = 0.5
"""Opacity of the ghost, which must be visible inside props and beside the solid arm."""

_POINTS = 200
"""Maximum number of points in the drawn path of the tip."""

Ask = Callable[[Any, str, Callable[[str], object]], None]


class PlanningPanel:
    """Buttons and displays of planning mode; all browsers show the same state."""

    def __init__(self, server: viser.ViserServer, console: LiveConsole, pens: Pens, on_click: Ask) -> None:
        """Add the controls; `on_click` connects a button to a request. A request is called with the client's name."""
        self._server = server
        self._console = console
        self._pens = pens
        gui = server.gui
        with gui.add_folder("Plan a motion"):
            self._aim = gui.add_button_group(
                "move a target",
                [f"{hand} hand" for hand in HANDS],
                hint="Move a target with the arrows of a hand; the target may pass through anything, and no arm moves",
            )
            self._find = gui.add_button("Plan a motion", hint="Plan a motion of the arm to the target")
            self._accept = gui.add_button("Accept", color="green", hint="Let the arm make the planned motion")
            self._cancel = gui.add_button("Cancel", hint="End planning; the arm stays where it is")
            self._plot = gui.add_uplot(
                (np.zeros(1), np.zeros(1), np.zeros(1)),
                (
                    {"label": "s"},
                    {"label": "clearance", "stroke": "#2268c9", "width": 2},
                    {"label": "proven", "stroke": _BOUND, "dash": (4.0, 3.0), "width": 1},
                ),
                title="Clearance of the motion [mm]",
                scales={"x": {"time": False}, "y": {"auto": True}},
                aspect=1.6,
                visible=False,
            )
        on_click(self._aim, "plan", lambda client: self._ask(client, "aim", self._aim.value.split()[0]))
        on_click(self._find, "plan", self._again)
        on_click(self._accept, "plan", lambda client: self._ask(client, "accept"))
        on_click(self._cancel, "cancel of a plan", lambda client: self._ask(client, "cancel"))
        self._arm = ""
        self._ghost: RobotNodes | None = None
        self._lines: dict[str, viser.LineSegmentsHandle] = {}
        self._preview: Preview | None = None
        self._preview_began = 0.0
        self._parts = 0
        self._red = False
        self._poses: Mapping[str, Array] = {}
        self._buttons("off")

    # -- requests -------------------------------------------------------------------------------------

    def _ask(self, client: str, do: PlanStep, hand: str = "") -> None:
        if do != "cancel":
            self._pens.use(client)  # silence of the hands would end the motion
        if do == "aim":
            self._pens.rest()
        self._console.plan(client, do, hand or self._console.planning.hand)

    def _again(self, client: str) -> None:
        """Plan a motion to the target; in the phase "preview", let the hand move the target again."""
        step: PlanStep = "aim" if self._console.planning.phase == "preview" else "find"
        self._ask(client, step)

    # -- display --------------------------------------------------------------------------------------

    def show(self, now: float) -> None:
        """Show the state of planning mode at the time `now` in s.

        In phases in which the hands move nothing, this call keeps the hands active, so that they are not released.
        """
        mode = self._console.planning
        if self._pens.client is not None and mode.phase in plan_view.RESTS:
            self._pens.use(self._pens.client)
        self._buttons(mode.phase)
        if mode.preview is not self._preview:
            self._preview = mode.preview
            self._preview_began = now
            self._parts = -1
            self._draw(mode.robot)
        self._stand(mode.robot, plan_view.ghost(mode, now - self._preview_began))
        self._paint(mode.phase == "aim" and bool(mode.blocked))
        for name, line in self._lines.items():
            visible = mode.phase == "preview" or (mode.phase == "run" and name == "tip")
            if line.visible != visible:
                line.visible = visible
        self._show_clearance()

    def _buttons(self, phase: str) -> None:
        """Show the buttons of a phase, and enable those that can be used."""
        # a control is written only if it changes: each write is sent to all browsers
        if self._aim.visible != (phase == "off"):
            self._aim.visible = phase == "off"
        for button in (self._find, self._accept, self._cancel):
            if button.visible != (phase != "off"):
                button.visible = phase != "off"
        can_find = phase in ("aim", "preview")
        if self._find.disabled == can_find:
            self._find.disabled = not can_find
        can_accept = phase == "preview"
        if self._accept.disabled == can_accept:
            self._accept.disabled = not can_accept
        _relabel(self._find, "Change the target" if phase == "preview" else "Plan a motion")
        _relabel(self._cancel, "Stop the arm" if phase == "run" else "Cancel")

    def _stand(self, robot: str, poses: Mapping[str, Array]) -> None:
        """Show the ghost of an arm at the link poses T_base_body; without poses, hide the ghost."""
        if robot and robot != self._arm and poses:
            if self._ghost is not None:
                self._ghost.remove()
            mechanism = self._console.members[robot].mechanism
            self._ghost = RobotNodes(self._server, f"/plan/{robot}", mechanism, poses, BLUE)
            self._ghost.place(self._console.place(robot), 1.0)
            for _, handle in self._ghost.meshes:
                handle.opacity = _OPACITY
            self._arm = robot
            self._red = False
            self._poses = poses
        if self._ghost is None:
            return
        if self._ghost.root.visible != bool(poses):
            self._ghost.show(bool(poses))
        if not poses:
            return
        for name in self._ghost.bodies:
            if not np.array_equal(poses[name], self._poses[name]):
                self._poses = poses
                self._ghost.write(poses)
                break

    def _paint(self, blocked: bool) -> None:
        """Show the ghost in red if the target is not free, else in blue."""
        if self._ghost is None or blocked == self._red:
            return
        self._red = blocked
        with self._server.atomic():
            for _, handle in self._ghost.meshes:
                handle.color = RED if blocked else BLUE

    def _draw(self, robot: str) -> None:
        """Draw the tip's path in the planned motion, and the search tree."""
        for line in self._lines.values():
            line.remove()
        self._lines = {}
        if self._preview is None:
            return
        motion = self._preview.found
        rows = np.unique(np.linspace(0, len(motion.Ts) - 1, _POINTS).astype(int))
        tip = motion.Ts[rows, :3, 3]
        T_world_base = self._console.place(robot)
        self._draw_line("tip", np.stack([tip[:-1], tip[1:]], axis=1), T_world_base, GREEN, 3.0)
        self._draw_line("tree", motion.tree, T_world_base, _TREE, 1.0)

    def _draw_line(
        self, name: str, points: Array, T_world_base: Array, color: tuple[int, int, int], thickness: float
    ) -> None:
        """Draw line segments (k, 2, 3), in m in the base frame of the arm; `thickness` is in pixels."""
        if not len(points):
            return
        self._lines[name] = self._server.scene.add_line_segments(
            f"/plan_{name}",
            (points @ T_world_base[:3, :3].T + T_world_base[:3, 3]).astype(np.float32),
            color,
            thickness=thickness,
            thickness_units="screen",
        )

    def _show_clearance(self) -> None:
        """Show the plot of the clearance, as soon as the first clearances are known."""
        preview = self._preview
        parts = 0
        visible = False
        if preview is not None:
            parts = len(preview.clear) + (preview.proven is not None)
            visible = bool(preview.clear)
        if parts == self._parts:
            return
        self._parts = parts
        if self._plot.visible != visible:
            self._plot.visible = visible
        if preview is None or not visible:
            return
        t, distance = plan_view.curve(preview)
        largest = float(distance.max())
        proven = np.full(len(t), np.nan)
        if preview.proven is not None:
            bound = preview.proven.proven
            largest = max(largest, bound)
            proven = np.full(len(t), bound / MM)
        top = 1.1 * max(largest, 0.0) / MM or 1.0  # an empty range could not be drawn
        self._plot.scales = {"x": {"time": False}, "y": {"range": (0.0, top)}}
        self._plot.data = (t, distance / MM, proven)


def _relabel(button: viser.GuiButtonHandle, label: str) -> None:
    if button.label != label:
        button.label = label
