"""The page of viser that mirrors a machine: solid robot (measured), ghost (desired), and a plot of their deviation."""

from __future__ import annotations

import threading
from html import escape

import numpy as np
import viser

from twin.core.units import MM
from twin.ui.session.mirror import Mirror
from twin.ui.viewer.deviation import DeviationCurve, largest
from twin.ui.viewer.loop import ViewerPage
from twin.ui.viewer.nodes import BLUE, RobotNodes
from twin.ui.viewer.room import OUTSIDE, furnish


class MirrorFront(ViewerPage):
    """The page that shows the measured and desired joint values of a machine.

    Attributes:
        mirror: the mirrored robot.
        nodes: scene nodes of the solid robot and of the ghost.
    """

    def __init__(
        self, title: str, mirror: Mirror, server: viser.ViserServer, stopping: threading.Event | None = None
    ) -> None:
        """Draw the robot in its home posture."""
        super().__init__(server, title, stopping)
        self.mirror = mirror
        mechanism = mirror.robot.mechanism
        self.nodes = {
            n: RobotNodes(server, f"/{n}", mechanism, mirror.links[n], ghost)
            for n, ghost in ((mirror.name, None), (mirror.ghost, BLUE))
        }
        low, high = self.nodes[mirror.name].box
        middle, size = 0.5 * (low + high), float(np.linalg.norm(high - low))
        furnish(server, middle, size, float(low[2]))
        server.initial_camera.position = middle + 1.3 * size * next(iter(OUTSIDE.values()))
        server.initial_camera.look_at = middle
        server.gui.set_panel_label(title)
        self._status = server.gui.add_html("")
        self._curve, self._begin = DeviationCurve(server.gui, ["deviation of the tips [mm]"]), self.now

    def frame(self, passed: float, wished: bool) -> None:
        """Show the newest state of the machine, and add a point to the curve if it is due."""
        mirror = self.mirror
        mirror.step()
        for name, node in self.nodes.items():
            node.write(mirror.links[name])
        t = self.now - self._begin
        if not self._curve.due(t):
            return
        apart = mirror.deviation
        self._curve.add(t, [apart["tip"]])
        lines = [
            f"{mirror.name}: {mirror.level or 'does not answer'}",
            f"Deviation of the tips: {apart['tip'] / MM:.2f} mm",
            largest(apart["joints"], mirror.robot.mechanism.active),
            "Solid: the machine's measured joints. Ghost: its desired joints.",
            *([mirror.problem] if mirror.problem else []),
        ]
        said = "".join(f"<div style='padding:0 1em .4em'>{escape(line)}</div>" for line in lines)
        self._status.content = said

    def close(self) -> None:
        """End the connection, and release the port."""
        self.mirror.close()
        super().close()
