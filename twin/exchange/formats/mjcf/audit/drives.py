"""Read the drives and motors of an MJCF from the actuators of its compiled model."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np

from twin.exchange.audit.file_drives import FileDrive, FileMotor, JointDynamics, drive_of_motors
from twin.exchange.formats.mjcf.audit.equalities import tendon_parts
from twin.exchange.formats.mjcf.audit.mujoco_conventions import HINGE, NO_DRIVES, NO_LIMITS, SLIDE


def _stated_texts(model: mujoco.MjModel) -> dict[str, str]:
    """Return {name: content} of the <text> elements, which state the kinds of the motors."""
    texts: dict[str, str] = {}
    for i in range(model.ntext):
        start = int(model.text_adr[i])
        end = start + int(model.text_size[i])
        content, _, _ = bytes(model.text_data[start:end]).partition(b"\0")  # MuJoCo ends texts with a zero byte
        name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_TEXT, i) or ""
        texts[name] = content.decode("utf-8", "replace")
    return texts


def _ratios(model: mujoco.MjModel, tendon: int, gear: float) -> dict[str, float]:
    """Return {joint: gear times coefficient} of a fixed tendon; {} for a spatial tendon."""
    ratios: dict[str, float] = {}
    for wrap in tendon_parts(model, tendon):
        if int(model.wrap_type[wrap]) != int(mujoco.mjtWrap.mjWRAP_JOINT):
            return {}
        ratios[model.joint(int(model.wrap_objid[wrap])).name] = gear * float(model.wrap_prm[wrap])
    return ratios


def read_motors(model: mujoco.MjModel) -> dict[str, FileMotor]:
    """Return {name: motor} for the actuators that pull fixed tendons. Actuator length = gear times tendon length."""
    motors: dict[str, FileMotor] = {}
    kinds = _stated_texts(model)
    for actuator in range(model.nu):
        if int(model.actuator_trntype[actuator]) != int(mujoco.mjtTrn.mjTRN_TENDON):
            continue
        tendon = int(model.actuator_trnid[actuator, 0])
        gear = float(model.actuator_gear[actuator, 0])
        ratios = _ratios(model, tendon, gear)
        if not gear or not ratios:
            continue
        low, high = -np.inf, np.inf
        if model.tendon_limited[tendon]:
            first, last = map(float, model.tendon_range[tendon])
            low, high = sorted((first * gear, last * gear))  # a negative gear exchanges them
        stiffness = 0.0
        damping = 0.0
        if int(model.actuator_biastype[actuator]) == int(mujoco.mjtBias.mjBIAS_AFFINE):
            stiffness = -float(model.actuator_biasprm[actuator, 1])
            damping = -float(model.actuator_biasprm[actuator, 2])
        effort = np.inf
        if model.actuator_forcelimited[actuator]:
            effort = float(np.abs(model.actuator_forcerange[actuator]).max())
        name = model.actuator(actuator).name
        motors[name] = FileMotor(
            row=ratios,
            kind=kinds.get(name),
            limits=(low, high),
            effort=effort,
            inertia=float(model.tendon_armature[tendon]) / gear**2,
            stiffness=stiffness,
            damping=damping,
            law=_force_law(model, actuator),
        )
    return motors


def _force_law(model: mujoco.MjModel, actuator: int) -> str:
    """Return what the gains of an actuator give: always a force, which MuJoCo may delay."""
    if model.actuator_dyntype[actuator] == mujoco.mjtDyn.mjDYN_NONE:
        return "force"
    return f"force, delayed by {model.actuator_dynprm[actuator, 0]:g} s"


def read_drives(model: mujoco.MjModel, motors: dict[str, FileMotor]) -> list[FileDrive]:
    """Return the drive of each joint, from its actuator and its range; `motors` drive joints without an actuator."""
    actuator_of_joint: dict[int, int] = {}
    if not model.opt.disableflags & NO_DRIVES:
        for actuator in range(model.nu):
            if int(model.actuator_trntype[actuator]) == int(mujoco.mjtTrn.mjTRN_JOINT):
                actuator_of_joint[int(model.actuator_trnid[actuator, 0])] = actuator
    drives: list[FileDrive] = []
    for joint in range(model.njnt):
        if model.jnt_type[joint] not in (SLIDE, HINGE):
            drives.append(FileDrive())
            continue
        actuator = actuator_of_joint.get(joint)
        if actuator is None:
            gains = drive_of_motors(motors, model.joint(joint).name)
            stiffness, damping = gains or (None, None)
            drive = FileDrive(_limits(model, joint), gains is not None, stiffness, damping)
        else:
            drive = _actuator_drive(model, actuator, joint)
        drives.append(replace(drive, joint_dynamics=_joint_dynamics(model, joint), breaks=np.inf))
    return drives


def _limits(model: mujoco.MjModel, joint: int) -> tuple[float, float]:
    """Return the (lower, upper) limits of a slide or hinge in m or rad, infinite without limits."""
    if not model.jnt_limited[joint] or model.opt.disableflags & NO_LIMITS:
        return -np.inf, np.inf
    low, high = map(float, model.jnt_range[joint])
    margin = float(model.jnt_margin[joint])  # MuJoCo pushes back from this far within the range
    return low + margin, high - margin


def _joint_dynamics(model: mujoco.MjModel, joint: int) -> JointDynamics:
    """Return what resists the motion of a slide or hinge by itself."""
    dof = model.jnt_dofadr[joint]
    # np.max, because stiffness and damping may be polynomials
    return JointDynamics(
        stiffness=float(np.max(model.jnt_stiffness[joint])),
        damping=float(np.max(model.dof_damping[dof])),
        friction=float(np.max(model.dof_frictionloss[dof])),
        inertia=float(np.max(model.dof_armature[dof])),
    )


def _actuator_drive(model: mujoco.MjModel, actuator: int, joint: int) -> FileDrive:
    """Return the drive of a joint with an actuator of its own. Its gains are for the motor: the gear counts twice."""
    gear = float(model.actuator_gear[actuator, 0])
    effort = None
    if model.actuator_forcelimited[actuator]:
        effort = float(np.abs(model.actuator_forcerange[actuator]).max() * abs(gear))
    elif model.actuator_forcerange[actuator].any() or model.actuator_forcelimited.any():
        # The limit is switched off by forcelimited="false", or missing although others of the file are limited.
        effort = np.inf
    limits = _limits(model, joint)
    return FileDrive(
        limits=limits,
        driven=True,
        stiffness=-float(model.actuator_biasprm[actuator, 1]) * gear**2,
        damping=-float(model.actuator_biasprm[actuator, 2]) * gear**2,
        effort=effort,
        control=_control_range(model, actuator, joint, limits),
        law=_force_law(model, actuator),
    )


def _control_range(
    model: mujoco.MjModel, actuator: int, joint: int, limits: tuple[float, float]
) -> tuple[float, float] | None:
    """Return the range of coordinates that a position servo can be asked for; None for other actuators.

    A control is the coordinate, or its displacement from `ref`; the nearer one to the limits of the joint is meant. A
    range beyond the limits is judged with the file's own limits, so it is cut here.
    """
    gear = float(model.actuator_gear[actuator, 0])
    stiffness = -float(model.actuator_biasprm[actuator, 1])
    if int(model.actuator_biastype[actuator]) != int(mujoco.mjtBias.mjBIAS_AFFINE) or stiffness <= 0 or not gear:
        return None
    low, high = limits
    if not model.actuator_ctrllimited[actuator]:
        return limits
    first, last = map(float, model.actuator_ctrlrange[actuator])
    lowest, highest = sorted((first / gear, last / gear))  # a negative gear exchanges them
    nearest: tuple[float, float] = limits
    least_loss = np.inf
    for start in (0.0, float(model.qpos0[model.jnt_qposadr[joint]])):
        reachable = (max(low, lowest + start), min(high, highest + start))
        loss = max(reachable[0] - low, high - reachable[1])
        if np.isnan(loss):  # no limits on either side
            loss = 0.0
        if loss < least_loss:
            nearest = reachable
            least_loss = loss
    return nearest
