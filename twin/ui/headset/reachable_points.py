"""Compute the reachable tool positions in a separate process, and make documents with these positions."""

from __future__ import annotations

import numpy as np

from twin.core.json_types import JsonObject
from twin.ui.headset.client_messages import RefusedError
from twin.ui.headset.stream_frames import floats
from twin.ui.session.movable_robot import MovableRobot
from twin.ui.session.workspace_cloud import Cloud, job_of

POSE_COUNT = 100_000
"""Number of evaluated poses."""

_MAX_POINTS_PER_DOCUMENT = 4000
"""Maximum number of points in one document, so that headsets can draw the points in time."""


_DEFAULT_SIZE = 0.5
"""Size in m that stands for a robot without meshes."""


class ReachablePoints:
    """Computation of the tool positions that a robot can reach with the present tool orientation.

    Attributes:
        on: whether the workspace is shown.
        sent: the documents sent so far, for clients that connect later.
    """

    def __init__(self, movable: MovableRobot, source: str) -> None:
        self.on = False
        self.sent: list[JsonObject] = []
        self._cleared_documents: list[JsonObject] = []
        self._movable = movable
        self._source = source
        self._cloud = Cloud()
        self._size = _largest_mesh(movable)

    def close(self) -> None:
        """End the process that computes the workspace."""
        self._cloud.close()

    def ask(self, on: bool) -> None:
        """Start the computation (`on` is True), or stop it and clear the points.

        Raises:
            RefusedError: the robot has no closed-form inverse.
        """
        movable = self._movable
        self.sent = []
        if not on:
            self.on = False
            self._cloud.cancel()
            self._cleared_documents = [{"type": "cloud", "first": True, "points": "", "values": "", "done": True}]
            return
        if movable.kin is None or not movable.kin.closed_inverse:
            raise RefusedError(
                "refused", f"{movable.robot.name} has no closed-form inverse: computing its workspace takes too long"
            )
        self.on = True
        job = job_of(movable, self._source, 0.5 * self._size, POSE_COUNT)
        self._cloud.start(job)

    def poll(self) -> list[JsonObject]:
        """Return the documents that are new since the last call: points, or an error."""
        if self._cleared_documents:
            new = self._cleared_documents
            self._cleared_documents = []
            return new
        if not self.on:
            return []
        chunk = self._cloud.poll()
        if chunk is None:
            return []
        if chunk.error:
            self.on = False
            return [{"type": "error", "code": "failed", "message": chunk.error[:500]}]
        # rounded up, so that no document exceeds the maximum
        step = max(1, -(-len(chunk.points) // _MAX_POINTS_PER_DOCUMENT))
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


def _largest_mesh(movable: MovableRobot) -> float:
    """Return the diagonal in m of the box around the largest mesh of a robot; `_DEFAULT_SIZE` if it has no meshes."""
    diagonals = []
    for body in movable.mechanism.bodies:
        for mesh in body.meshes:
            extent = np.ptp(mesh.vertices, axis=0)
            diagonals.append(float(np.linalg.norm(extent)))
    return max(diagonals, default=_DEFAULT_SIZE)
