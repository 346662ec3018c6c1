"""Documents of planning mode for the pages: the ghost of the arm at the target, the planned motion, its clearance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from twin.core.json_types import JsonObject
from twin.ui.headset.protocol import floats, sevens
from twin.ui.session.plan_mode import PlanMode, Preview
from twin.ui.session.plan_work import SHOWN


class PlanDocuments:
    """Maker of the documents `target` (ghost), `plan` (planned motion) and `clearance` from the planning mode."""

    def __init__(self, mode: PlanMode, bodies: Mapping[str, Sequence[str]]) -> None:
        """Set the planning mode; `bodies`: names of the bodies, by arm, in the order of the links in a frame."""
        self._mode, self._bodies = mode, bodies
        self._seen, self._parts = mode.changes, 0
        self._ghost: Mapping[str, np.ndarray] = mode.ghost
        self._preview: Preview | None = None

    def news(self) -> list[JsonObject]:
        """Return the documents whose content has changed since the last call."""
        mode, out = self._mode, []
        if mode.changes == self._seen:
            return out
        self._seen = mode.changes
        if mode.ghost is not self._ghost:
            self._ghost = mode.ghost
            out.append(self._target())
        if mode.preview is not self._preview:
            self._preview, self._parts = mode.preview, 0
            out.append(self._plan(mode.preview))
        if (p := mode.preview) is not None and (parts := len(p.clear) + (p.proven is not None)) != self._parts:
            self._parts = parts
            out.append(self._clearance(p))
        return out

    def all(self) -> list[JsonObject]:
        """Return all documents that a new client needs."""
        mode = self._mode
        if mode.phase == "off":
            return []
        out = [self._target()]
        if mode.preview is not None:
            out += [self._plan(mode.preview), self._clearance(mode.preview)]
        return out

    def _target(self) -> JsonObject:
        ghost = self._mode.ghost
        links = [ghost[n] for n in self._bodies.get(self._mode.robot, ())] if ghost else []
        return {"type": "target", "robot": self._mode.robot, "poses": floats(_sevens(np.array(links)))}

    def _plan(self, preview: Preview | None) -> JsonObject:
        robot = self._mode.robot
        if preview is None:
            return {"type": "plan", "robot": robot, "poses": "", "tip": "", "tree": "", "every": SHOWN, "duration": 0.0}
        found = preview.found
        rows = [found.links.index(n) for n in self._bodies[robot]]
        tip = found.Ts[:: max(1, len(found.Ts) // 200), :3, 3]
        return {
            "type": "plan",
            "robot": robot,
            "poses": floats(_sevens(found.shown[:, rows])),
            "tip": floats(tip),
            "tree": floats(found.tree),
            "every": SHOWN,
            "duration": found.duration,
        }

    def _clearance(self, preview: Preview) -> JsonObject:
        clear, proven = preview.clear, preview.proven
        return {
            "type": "clearance",
            "robot": self._mode.robot,
            "t": [round(float(t), 4) for c in clear for t in c.t],
            "distance": [round(float(d), 6) for c in clear for d in c.distance],
            "proven": None if proven is None else round(proven.proven, 6),
            "found": None if proven is None else round(proven.found, 6),
            "bodies": [] if proven is None else list(proven.bodies),
        }


def _sevens(Ts: np.ndarray) -> np.ndarray:
    return sevens(Ts) if Ts.size else np.zeros((0, 7))
