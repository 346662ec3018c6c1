"""Documents of planning mode for the pages: the ghost of the arm at the target, the planned motion, its clearance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from twin.core.json_types import JsonObject
from twin.ui.headset.stream_frames import floats, sevens
from twin.ui.session.plan_jobs import PREVIEW_PERIOD
from twin.ui.session.plan_mode import PlanMode, Preview


class PlanDocuments:
    """Maker of the documents `target` (ghost), `plan` (planned motion) and `clearance` from the planning mode."""

    def __init__(self, mode: PlanMode, bodies: Mapping[str, Sequence[str]]) -> None:
        """Set the planning mode; `bodies`: names of the bodies, by arm, in the order of the links in a frame."""
        self._mode = mode
        self._bodies = bodies
        self._changes = mode.changes
        self._sent_parts = 0
        self._ghost: Mapping[str, np.ndarray] = mode.ghost
        self._preview: Preview | None = None

    def changed_documents(self) -> list[JsonObject]:
        """Return the documents whose content has changed since the last call."""
        mode = self._mode
        documents: list[JsonObject] = []
        if mode.changes == self._changes:
            return documents
        self._changes = mode.changes
        if mode.ghost is not self._ghost:
            self._ghost = mode.ghost
            documents.append(self._target())
        preview = mode.preview
        if preview is not self._preview:
            self._preview = preview
            self._sent_parts = 0
            documents.append(self._plan(preview))
        if preview is not None:
            parts = len(preview.clear) + (preview.proven is not None)
            if parts != self._sent_parts:
                self._sent_parts = parts
                documents.append(self._clearance(preview))
        return documents

    def all_documents(self) -> list[JsonObject]:
        """Return all documents that a new client needs."""
        mode = self._mode
        if mode.phase == "off":
            return []
        documents = [self._target()]
        if mode.preview is not None:
            documents.append(self._plan(mode.preview))
            documents.append(self._clearance(mode.preview))
        return documents

    def _target(self) -> JsonObject:
        robot = self._mode.robot
        ghost = self._mode.ghost
        links = []
        if ghost:
            links = [ghost[name] for name in self._bodies.get(robot, ())]
        return {"type": "target", "robot": robot, "poses": floats(_packed_poses(np.array(links)))}

    def _plan(self, preview: Preview | None) -> JsonObject:
        robot = self._mode.robot
        if preview is None:
            return {
                "type": "plan",
                "robot": robot,
                "poses": "",
                "tip": "",
                "tree": "",
                "every": PREVIEW_PERIOD,
                "duration": 0.0,
            }
        motion = preview.motion
        columns = [motion.links.index(name) for name in self._bodies[robot]]
        stride = max(1, len(motion.Ts) // 200)
        return {
            "type": "plan",
            "robot": robot,
            "poses": floats(_packed_poses(motion.shown[:, columns])),
            "tip": floats(motion.Ts[::stride, :3, 3]),
            "tree": floats(motion.tree),
            "every": PREVIEW_PERIOD,
            "duration": motion.duration,
        }

    def _clearance(self, preview: Preview) -> JsonObject:
        times: list[float] = []
        distances: list[float] = []
        for samples in preview.clear:
            times += samples.t.tolist()
            distances += samples.distance.tolist()
        document: JsonObject = {
            "type": "clearance",
            "robot": self._mode.robot,
            "t": [round(t, 4) for t in times],
            "distance": [round(distance, 6) for distance in distances],
            "proven": None,
            "found": None,
            "bodies": [],
        }
        certificate = preview.proven
        if certificate is not None:
            document["proven"] = round(certificate.bound, 6)
            document["found"] = round(certificate.computed, 6)
            document["bodies"] = list(certificate.bodies)
        return document


def _packed_poses(Ts: np.ndarray) -> np.ndarray:
    if not Ts.size:
        return np.zeros((0, 7))
    return sevens(Ts)
