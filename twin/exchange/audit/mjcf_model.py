"""Check a single MJCF: actuators on the wrong joint, keyframes with open loops or without equilibrium."""

from __future__ import annotations

import mujoco
import numpy as np

from twin.exchange.audit.report import Ledger, quantity

KEY_GAP = 1e-4
"""Maximum residual in m or rad of an equality constraint at a keyframe, from which simulations start."""


def check_model(m: mujoco.MjModel, d: mujoco.MjData, ledger: Ledger) -> None:
    """Report faults of actuators and keyframes."""
    names = {m.joint(j).name: j for j in range(m.njnt) if m.joint(j).name}
    for a in range(m.nu):
        name, j = m.actuator(a).name, int(m.actuator_trnid[a, 0])
        if int(m.actuator_trntype[a]) != int(mujoco.mjtTrn.mjTRN_JOINT):
            continue
        if names.get(name, j) != j:
            text = f"actuator '{name}' drives joint '{m.joint(j).name}', not the joint of the same name."
            ledger.add(
                "mjcf.actuator",
                "disagreement",
                text,
                where=name,
                suggestion="exchange the joints or the names of the actuators",
            )
    for k in range(m.nkey):
        _check_key(m, d, k, ledger)
    mujoco.mj_resetData(m, d)


def _check_key(m: mujoco.MjModel, d: mujoco.MjData, k: int, ledger: Ledger) -> None:
    name = m.key(k).name or f"key {k}"
    mujoco.mj_resetDataKeyframe(m, d, k)
    mujoco.mj_fwdPosition(m, d)
    gaps = np.where(d.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY, np.abs(d.efc_pos), 0.0)
    worst = float(gaps.max(initial=0.0))
    if m.neq:
        ledger.row(f"loops at keyframe '{name}'", worst, "m", KEY_GAP)
    if worst > KEY_GAP:
        where = m.equality(int(d.efc_id[int(np.argmax(gaps))])).name
        text = f"keyframe '{name}': equality '{where}' is open by {quantity(worst, 'm')}."
        ledger.add("mjcf.keyframe", "disagreement", text, where=name, size=worst, unit="m", limit=KEY_GAP)
    for j in range(m.njnt):
        q = float(d.qpos[m.jnt_qposadr[j]])
        low, high = m.jnt_range[j]
        if m.jnt_limited[j] and m.jnt_type[j] != int(mujoco.mjtJoint.mjJNT_BALL) and not low - 1e-6 <= q <= high + 1e-6:
            text = f"keyframe '{name}': joint '{m.joint(j).name}' is at {q:.6g}, outside {low:.6g} .. {high:.6g}."
            ledger.add("mjcf.keyframe", "disagreement", text, where=name, size=q)
    _check_push(m, d, name, ledger)


def _check_push(m: mujoco.MjModel, d: mujoco.MjData, name: str, ledger: Ledger) -> None:
    """Report actuators whose force is at its limit at a keyframe with zero velocity."""
    mujoco.mj_fwdVelocity(m, d)
    mujoco.mj_fwdActuation(m, d)
    for a in range(m.nu):
        if not m.actuator_forcelimited[a]:
            continue
        bound = float(np.abs(m.actuator_forcerange[a]).max())
        if abs(d.actuator_force[a]) >= bound:
            text = f"keyframe '{name}': actuator '{m.actuator(a).name}' starts at its maximum of {bound:g} N or N m."
            ledger.add(
                "mjcf.keyframe",
                "disagreement",
                text,
                where=m.actuator(a).name,
                size=float(d.actuator_force[a]),
                limit=bound,
                suggestion="set its control to the value of its joint",
            )
