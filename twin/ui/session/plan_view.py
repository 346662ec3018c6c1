"""Data of planning mode for a page: status as text, clearance of the planned motion, and link poses of the ghost."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from twin.core.json_types import JsonMapping
from twin.core.spatial import Array
from twin.core.units import MM
from twin.ui.session.plan_jobs import PREVIEW_PERIOD
from twin.ui.session.plan_mode import PlanMode, PlanPhase, Preview

RESTING_PHASES: tuple[PlanPhase, ...] = ("plan", "preview", "run")
"""Phases of planning mode in which the hands move neither an arm nor the target."""

_END_PAUSE = 0.6
"""Time in s for which the ghost stays at the end of a previewed motion before it repeats the motion."""


def status(state: JsonMapping | None, preview: Preview | None) -> tuple[str, str] | None:
    """Return the status of planning mode as (tone, text); tone: "good", "warn" or "bad". None if there is no status.

    Args:
        state: the state of planning mode, as `PlanMode.state` returns it.
        preview: the planned motion; None before it is found.
    """
    if state is None:
        return None
    phase = state["phase"]
    robot = state["robot"]
    if state["said"]:
        if state["bad"]:
            tone = "bad"
        elif phase == "off":
            tone = "good"
        else:
            tone = "warn"
        return tone, state["said"]
    if phase == "aim" and state["blocked"]:
        return "warn", f"Target of {robot} (red): {state['blocked']}."
    if phase == "aim":
        text = f"Move the target of {robot}; the target may pass through anything, and the arm is at rest."
        text += " Then plan a motion."
        if not state["ready"]:
            text += " The geometry is being loaded."
        return "good", text
    if phase == "plan":
        return "good", f"Planning a motion of {robot}: {100 * state['done']:.0f} %"
    if phase == "run":
        return "good", f"{robot} follows the plan: {100 * state['done']:.0f} %"
    if phase == "preview" and preview is not None:
        length = preview.motion.duration
        return "good", f"Motion of {robot}, {length:.1f} s. {clearance(preview)} Accept it, or cancel."
    return None


def clearance(preview: Preview) -> str:
    """Return a text on the smallest clearance of a planned motion, and on the proven lower bound of the clearance."""
    certificate = preview.proven
    if certificate is None:
        return "The clearance is being computed."
    text = f"Minimum clearance {certificate.computed / MM:.1f} mm"
    if all(certificate.bodies):
        text += f" ({' and '.join(certificate.bodies)})"
    return f"{text}, proven to be at least {certificate.bound / MM:.1f} mm."


def curve(preview: Preview) -> tuple[Array, Array]:
    """Return times (k,) in s of a planned motion, and the clearances (k,) in m computed so far at these times."""
    times = [np.zeros(0)]
    distances = [np.zeros(0)]
    for piece in preview.clear:
        times.append(piece.t)
        distances.append(piece.distance)
    return np.concatenate(times), np.concatenate(distances)


def ghost(mode: PlanMode, t: float) -> Mapping[str, Array]:
    """Return the poses T_base_body (4, 4) of the ghost, by body; empty without a ghost.

    In the phases before the preview, the ghost is at the target. In a preview that began `t` s ago, the ghost repeats
    the motion. While the arm follows the motion, the ghost is at the end of the motion.
    """
    if mode.phase == "off":
        return {}
    if mode.preview is None or mode.phase not in ("preview", "run"):
        return mode.ghost
    motion = mode.preview.motion
    k = len(motion.shown) - 1
    if mode.phase == "preview":
        # during the pause, the index would be beyond the last state
        t_motion = t % (motion.duration + _END_PAUSE)
        k = min(k, int(t_motion / PREVIEW_PERIOD))
    return dict(zip(motion.links, motion.shown[k], strict=True))
