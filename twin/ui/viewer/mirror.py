"""The page of viser for a twin that mirrors a machine: solid, ghost, and the curve of their deviation."""

from __future__ import annotations

import threading
from html import escape

import numpy as np
import viser

from twin.core.units import DEG, MM
from twin.ui.session.mirror import Mirror
from twin.ui.viewer.loop import Loop
from twin.ui.viewer.nodes import BLUE, RobotNodes
from twin.ui.viewer.room import OUTSIDE, furnish

_SECONDS, _EVERY = 12.0, 0.1
"""Duration in s of the curve, and time between two of its points."""


class MirrorFront(Loop):
    """The page of a twin that mirrors a machine.

    Attributes:
        mirror: the twin.
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
        self._status, self._said = server.gui.add_html(""), ""
        self._t, self._tips = np.zeros(1), np.zeros(1)
        self._curve = server.gui.add_uplot(
            (self._t, self._tips),
            ({"label": "s"}, {"label": "tips apart [mm]", "stroke": "#0a66c2", "width": 2}),
            title="Deviation of the tips [mm]",
            scales={"x": {"time": False}, "y": {"auto": True}},
            aspect=1.6,
        )
        self._due = self._begin = self.now

    def frame(self, passed: float, wished: bool) -> None:
        """Show the newest state and the curve."""
        mirror = self.mirror
        mirror.step()
        for name, node in self.nodes.items():
            node.write(mirror.links[name])
        if self.now < self._due:
            return
        self._due = self.now + _EVERY
        apart = mirror.deviation
        self._t = np.append(self._t, self.now - self._begin)
        self._tips = np.append(self._tips, apart["tip"] / MM)
        kept = self._t > self._t[-1] - _SECONDS
        self._t, self._tips = self._t[kept], self._tips[kept]
        self._curve.data = (self._t, self._tips)
        active = mirror.robot.mechanism.active
        shown = [(abs(v) / (DEG if j.is_angle else MM), j) for v, j in zip(apart["joints"], active, strict=True)]
        size, joint = max(shown, key=lambda pair: pair[0])
        lines = [
            f"{mirror.name}: {mirror.level or 'does not answer'}",
            f"Tips apart: {apart['tip'] / MM:.2f} mm",
            f"Largest joint difference: {joint.name} {size:.2f}{'°' if joint.is_angle else ' mm'}",
            "Machine solid; its desired joints as ghost.",
            *([mirror.problem] if mirror.problem else []),
        ]
        said = "".join(f"<div style='padding:0 1em .4em'>{escape(line)}</div>" for line in lines)
        if said != self._said:
            self._said = self._status.content = said

    def close(self) -> None:
        """End the connection, and release the port."""
        self.mirror.close()
        super().close()
