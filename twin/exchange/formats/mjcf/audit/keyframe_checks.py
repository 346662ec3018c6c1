"""Check the keyframes of an MJCF: simulations start there, with closed loops, and with controls that hold the robot."""

from __future__ import annotations

import mujoco
import numpy as np

from twin.exchange.audit.ledger import Ledger, Measured
from twin.exchange.formats.mjcf.audit.equality_residuals import gap_text, largest_gap
from twin.exchange.formats.mjcf.audit.mujoco_conventions import BALL
from twin.exchange.formats.mjcf.audit.statics import holding_forces

KEY_GAP = 1e-4
"""Maximum residual in m or rad of an equality constraint at a keyframe; simulations start from keyframes."""

_CONTROL_DIGITS = 9
"""Decimals of a computed control in messages: less is rounding of the equations of balance."""

_RANGE_SLACK = 1e-6
"""Largest excess over a range, in m or rad, that counts as a rounding error of a keyframe."""


def check_keyframe(model: mujoco.MjModel, data: mujoco.MjData, key: int, ledger: Ledger) -> None:
    """Report a keyframe with open loops, joints outside of their ranges, or actuators at their limits."""
    name = model.key(key).name or f"key {key}"
    mujoco.mj_resetDataKeyframe(model, data, key)
    mujoco.mj_fwdPosition(model, data)
    worst, where = largest_gap(model, data)
    if model.neq:
        ledger.row(f"loops at keyframe '{name}'", worst, "m", KEY_GAP)
    if worst > KEY_GAP:
        text = f"keyframe '{name}': equality '{where}' is open by {gap_text(model, where, worst)}."
        ledger.wrong("mjcf.keyframe", text, name, size=Measured(worst, KEY_GAP, "m"))
    for joint in range(model.njnt):
        q = float(data.qpos[model.jnt_qposadr[joint]])
        low, high = model.jnt_range[joint]
        if (
            model.jnt_limited[joint]
            and model.jnt_type[joint] != BALL
            and not low - _RANGE_SLACK <= q <= high + _RANGE_SLACK
        ):
            text = (
                f"keyframe '{name}': joint '{model.joint(joint).name}' is at {q:.6g}, outside {low:.6g} .. {high:.6g}."
            )
            ledger.wrong("mjcf.keyframe", text, name, size=q)
    _check_holding_forces(model, data, name, ledger)


def _check_holding_forces(model: mujoco.MjModel, data: mujoco.MjData, name: str, ledger: Ledger) -> None:
    """Report actuators whose force is at its limit at a keyframe with zero velocity.

    If even the right force would be above the limit, the motor is too weak, which is a warning; else the control is
    wrong.
    """
    mujoco.mj_fwdVelocity(model, data)
    mujoco.mj_fwdActuation(model, data)
    needed_forces = holding_forces(model, data)
    for actuator in range(model.nu):
        if not model.actuator_forcelimited[actuator]:
            continue
        label = model.actuator(actuator).name
        bound = float(np.abs(model.actuator_forcerange[actuator]).max())
        needed = needed_forces[actuator]
        force = data.actuator_force[actuator]
        if abs(needed) > bound:
            text = (
                f"keyframe '{name}': actuator '{label}' cannot hold the robot: it needs {abs(needed):.4g} N or N m, "
                f"its maximum effort is {bound:g}."
            )
            ledger.add("mjcf.effort", "warning", text, label, size=Measured(needed, bound))
        elif abs(force) >= bound:
            text = (
                f"keyframe '{name}': actuator '{label}' is at its maximum effort, {bound:g} N or N m"
                f"{_control_text(model, data, actuator, needed)}."
            )
            advice = "set the actuator's control in the keyframe to the value of its joint"
            ledger.wrong("mjcf.keyframe", text, label, size=Measured(force, bound), suggestion=advice)


def _control_text(model: mujoco.MjModel, data: mujoco.MjData, actuator: int, needed: float) -> str:
    """Return which control an actuator has, and which one gives the force `needed`; "" if it does not follow.

    Its force is gain times control plus bias, without activation and at zero velocity.
    """
    is_plain = int(model.actuator_dyntype[actuator]) == int(mujoco.mjtDyn.mjDYN_NONE)
    has_fixed_gain = int(model.actuator_gaintype[actuator]) == int(mujoco.mjtGain.mjGAIN_FIXED)
    gain = float(model.actuator_gainprm[actuator, 0])
    if not (is_plain and has_fixed_gain) or gain == 0.0:
        return ""
    bias = 0.0
    if int(model.actuator_biastype[actuator]) == int(mujoco.mjtBias.mjBIAS_AFFINE):
        constant, stiffness = model.actuator_biasprm[actuator, :2].tolist()
        bias = constant + stiffness * float(data.actuator_length[actuator])
    elif int(model.actuator_biastype[actuator]) != int(mujoco.mjtBias.mjBIAS_NONE):
        return ""
    right_control = round((needed - bias) / gain, _CONTROL_DIGITS) or 0.0
    return f": its control is {data.ctrl[actuator]:g}, and {right_control:g} would hold the robot"
