"""The gaps of the loops of an MJCF: residuals of its equality constraints."""

from __future__ import annotations

import mujoco
import numpy as np

from twin.exchange.audit.value_text import quantity


def largest_gap(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[float, str]:
    """Return (largest residual of an equality constraint in m or rad, name of this constraint)."""
    gaps = np.where(data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY, np.abs(data.efc_pos), 0.0)
    if not gaps.any():
        return 0.0, ""
    row = int(np.argmax(gaps))
    return float(gaps[row]), model.equality(int(data.efc_id[row])).name


def gap_text(model: mujoco.MjModel, equality: str, gap: float) -> str:
    """Return the residual of an equality constraint as text: a length of points, else in m or rad."""
    if equality and model.equality(equality).type == mujoco.mjtEq.mjEQ_CONNECT:
        return quantity(gap, "m")
    return f"{gap:.4g} m or rad"
