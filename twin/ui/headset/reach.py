"""The positions that the tool reaches, found in a process of its own and sent piece by piece."""

from __future__ import annotations

from typing import Any

import numpy as np

from twin.ui.headset.protocol import RefusedError, floats
from twin.ui.session.desk import Desk
from twin.ui.session.workspace import Cloud, Job

POSES = 100_000
"""Poses that are tried."""

_MOST = 4000
"""Points of one piece that are sent, at most: a headset draws them."""


class Reach:
    """The workspace of a desk, on request.

    Attributes:
        on: whether it is wanted.
        sent: the documents so far, for clients that come later.
    """

    def __init__(self, desk: Desk, source: str) -> None:
        self.on = False
        self.sent: list[dict[str, Any]] = []
        self._new: list[dict[str, Any]] = []
        self._desk, self._source, self._cloud = desk, source, Cloud()
        boxes = [m.vertices for b in desk.mechanism.bodies for m in b.meshes]
        self._size = max((float(np.linalg.norm(np.ptp(v, axis=0))) for v in boxes), default=0.5)

    def close(self) -> None:
        """End the process."""
        self._cloud.close()

    def ask(self, on: bool) -> None:
        """Begin, or stop and forget.

        Raises:
            RefusedError: the robot has no equations that could be asked.
        """
        desk = self._desk
        self.sent = []
        if not on:
            self.on = False
            self._cloud.cancel()
            self._new = [{"type": "cloud", "first": True, "points": "", "values": "", "done": True}]
            return
        if desk.kin is None or not desk.kin.closed_inverse:
            raise RefusedError("refused", f"{desk.robot.name} has no closed inverse: its workspace takes too long")
        self.on = True
        parameters = {n: float(v) for n, v in desk.kin.parameters.items() if n.startswith("trocar_")}
        T = desk.assembly.T_base_tool.copy()
        self._cloud.start(
            Job(self._source, dict(desk.kin.variants), parameters, desk.mechanism.limits, T, 0.5 * self._size, POSES)
        )

    def poll(self) -> list[dict[str, Any]]:
        """Return what is new, as documents."""
        if self._new:
            new, self._new = self._new, []
            return new
        chunk = self._cloud.poll() if self.on else None
        if chunk is None:
            return []
        if chunk.error:
            self.on = False
            return [{"type": "error", "code": "failed", "message": chunk.error[:500]}]
        step = max(1, -(-len(chunk.points) // _MOST))
        points, values = chunk.points[::step], chunk.condition[::step]
        document = {
            "type": "cloud",
            "first": not self.sent,
            "points": floats(points),
            "values": floats(np.minimum(values, np.float32(1e9))),
            "done": chunk.evaluated >= chunk.count,
        }
        self.sent.append(document)
        return [document]
