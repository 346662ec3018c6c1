"""Scene nodes of trocars and of the instrument shafts in them."""

from __future__ import annotations

import numpy as np
import viser

from twin.core.units import MM
from twin.ui.session.trocars import InTrocar
from twin.ui.viewer.front import ShownRobot
from twin.ui.viewer.robot_nodes import ORANGE

_MAX_SHAFT_ERROR = 2 * MM
"""Trocar error in m from which a shaft is not drawn: it would not pass through its trocar."""

_SHAFT_PART = 0.12
"""Length of a shaft outside its trocar, as a part of the robot's size; inside too, if the tip is unknown."""

_BALL_PART = 0.007
"""Radius of the ball at a trocar, as a part of the robot's size."""


class TrocarNodes:
    """Balls at the trocars of all robots, and lines along the shafts in them; they are made when they are first drawn.

    The key of a ball and of its line is the name of the robot or, if it has several trocars, "<robot>/<trocar>".
    """

    def __init__(self, server: viser.ViserServer) -> None:
        self._scene = server.scene
        self._shaft_lines: dict[str, viser.LineSegmentsHandle] = {}
        self._trocar_balls: dict[str, viser.IcosphereHandle] = {}

    def draw(self, robot: ShownRobot, size: float, trocar: InTrocar, several: bool) -> str:
        """Draw a trocar and its shaft; return the key of their scene nodes.

        Args:
            robot: the robot whose instrument is in the trocar.
            size: size of the robot in m, without its factor on the displayed size.
            trocar: the trocar, in the base frame of the robot.
            several: whether the robot has other trocars.
        """
        key = robot.name
        suffix = ""
        if several:
            key = f"{robot.name}/{trocar.name}"
            suffix = f"_{trocar.name}"
        tip = trocar.tip
        if tip is None:
            tip = trocar.place + _SHAFT_PART * size * trocar.axis
        ends = np.array([[tip, trocar.place - _SHAFT_PART * size * trocar.axis]], np.float32)
        if key not in self._shaft_lines:
            self._shaft_lines[key] = self._scene.add_line_segments(
                f"/{robot.name}/shaft_axis{suffix}", ends, ORANGE, thickness=2.0, thickness_units="screen"
            )
            self._trocar_balls[key] = self._scene.add_icosphere(
                f"/{robot.name}/rcm{suffix}", _BALL_PART * size, ORANGE, cast_shadow=False
            )
        self._shaft_lines[key].points = ends
        self._trocar_balls[key].position = trocar.place
        error = np.linalg.norm(np.cross(trocar.place - tip, trocar.axis))
        self._trocar_balls[key].visible = True
        self._shaft_lines[key].visible = bool(error < _MAX_SHAFT_ERROR)
        return key

    def hide_others(self, shown_keys: set[str]) -> None:
        """Hide the nodes whose keys are not among those that `draw` has returned."""
        for key in self._shaft_lines.keys() - shown_keys:
            self._shaft_lines[key].visible = False
            self._trocar_balls[key].visible = False

    def forget(self, robot: str) -> None:
        """Forget the nodes of a robot, which are removed with its other scene nodes."""
        for key in list(self._shaft_lines):
            if key == robot or key.startswith(f"{robot}/"):
                del self._shaft_lines[key]
                del self._trocar_balls[key]
