"""Read the mechanism data of an MJCF from the model that MuJoCo compiles."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import mujoco
import numpy as np

from twin.exchange.audit import poses
from twin.exchange.audit.file_drives import FileDrive, FileMotor, JointDynamics, drive_of_motors
from twin.exchange.audit.file_joints import FileJoint
from twin.exchange.audit.mechanism_data import VACUUM, FileFrame, FileMass, FileMechanism
from twin.exchange.audit.motion_lines import JointLine
from twin.exchange.audit.poses import Array

MARK = "frame_"
"""Prefix in the names of sites that represent named frames."""

POINT = "point_"
"""Prefix in the names of sites that represent named points. All other sites belong to loop closures."""

FREE, BALL, SLIDE, HINGE = range(4)
"""Numbers of MuJoCo's joint types (enumeration mjtJoint)."""

_NO_GRAVITY, _NO_LIMITS, _NO_LOOPS, _NO_DRIVES = (
    int(mujoco.mjtDisableBit.mjDSBL_GRAVITY),
    int(mujoco.mjtDisableBit.mjDSBL_LIMIT),
    int(mujoco.mjtDisableBit.mjDSBL_EQUALITY),
    int(mujoco.mjtDisableBit.mjDSBL_ACTUATION),
)
"""Flags of <option> with which MuJoCo ignores gravity, limits of joints, equality constraints, or actuators."""

_CONNECT, _WELD, _COUPLE, _TENDON = range(4)
"""Numbers of MuJoCo's equality constraints (enumeration mjtEq): connect, weld, joint, tendon."""


def compiled_mechanism(model: mujoco.MjModel, bodies: dict[str, int]) -> FileMechanism:
    """Return the mechanism data of a compiled model.

    `bodies` maps link names to MuJoCo's body numbers; the world may be one of the links.
    """
    gravity = np.zeros(3) if model.opt.disableflags & _NO_GRAVITY else np.array(model.opt.gravity)
    mechanism = FileMechanism(tuple(bodies), complete=True, gravity=gravity, couplings=_couplings(model))
    mechanism.medium = VACUUM
    if model.opt.density or model.opt.viscosity:  # without them, wind has no effect
        mechanism.medium = (model.opt.density, model.opt.viscosity, *model.opt.wind.tolist())
    mechanism.motors = _motors(model)
    mechanism.all_motors = True
    mechanism.self_collision = _self_collision(model)
    fixed_links: set[str] = set()
    weight_shares: dict[str, float] = {}
    shown: dict[str, bool] = {}
    for name, body in bodies.items():
        weight_shares[name] = float(model.body_gravcomp[body])
        if body:  # the world has floors and walls
            shown[name] = bool(model.body_geomnum[body])
        # A body fixed to the world needs no mass: 0 means "not stated".
        if body and (model.body_mass[body] or model.body_weldid[body]):
            R = poses.rotation(model.body_iquat[body][[1, 2, 3, 0]])
            inertia = R @ np.diag(model.body_inertia[body]) @ R.T
            mechanism.masses[name] = FileMass(float(model.body_mass[body]), model.body_ipos[body].copy(), inertia)
        if body == 0 or (model.body_parentid[body] == 0 and not model.body_jntnum[body]):
            fixed_links.add(name)
    mechanism.weight_shares = weight_shares
    mechanism.shown = shown
    names = [model.body(number).name for number in range(model.nbody)]
    drives = _drives(model, mechanism.motors)
    for body in range(1, model.nbody):
        mechanism.joints.append(_tree_joint(model, body, names, drives))
    mechanism.fixed_to_world = frozenset(fixed_links)
    mechanism.joints += _loop_joints(model, names)
    _read_sites(model, names, mechanism)
    mechanism.opening = _opening_under_load(model)
    return mechanism


def _self_collision(model: mujoco.MjModel) -> bool:
    """Return whether shapes of any two moving bodies are allowed to collide, also if they never meet.

    MuJoCo filters collisions by the bits of two shapes: one's contype and the other's conaffinity share a bit.
    """
    robot = model.body_weldid[model.geom_bodyid] > 0  # not fixed to the world, as floors and the base are
    types = np.bitwise_or.reduce(model.geom_contype[robot], initial=0)
    affinities = np.bitwise_or.reduce(model.geom_conaffinity[robot], initial=0)
    return bool(types & affinities)


def _tree_joint(model: mujoco.MjModel, body: int, names: list[str], drives: list[FileDrive]) -> FileJoint:
    """Return the joint between a body and its parent; a body may have several joints of MuJoCo, or none."""
    T = _pose(model.body_pos[body], model.body_quat[body])
    first = model.body_jntadr[body]
    joints = range(first, first + model.body_jntnum[body])
    labels: list[str] = []
    motions: list[JointLine] = []
    driven: list[FileDrive] = []
    for joint in joints:
        labels.append(model.joint(joint).name)
        if drives[joint].driven:
            driven.append(drives[joint])
        for line in _motions(model, joint):
            motions.append(line.transformed(T))
    if len(joints) == 1 and model.jnt_type[first] in (HINGE, SLIDE):  # a body is placed at `ref`, not at zero
        T = motions[0].motion(-float(model.qpos0[model.jnt_qposadr[first]])) @ T
    drive = FileDrive()
    if len(joints) == 1:
        drive = drives[first]
    elif len(driven) == 1:
        drive = driven[0]
    parent = names[model.body_parentid[body]]
    return FileJoint(_nonempty(labels), parent, names[body], T, tuple(motions), drive)


def _read_sites(model: mujoco.MjModel, names: list[str], mechanism: FileMechanism) -> None:
    """Add the named frames and points of the sites to `mechanism`; sites that equality constraints join are neither."""
    loop_sites: set[int] = set()
    for equality in range(model.neq):
        if _is_between_sites(model, equality):
            loop_sites.update((int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])))
    for site in range(model.nsite):
        if site in loop_sites:
            continue
        label = model.site(site).name
        T = _pose(model.site_pos[site], model.site_quat[site])
        body = names[model.site_bodyid[site]]
        if label.startswith(POINT):
            mechanism.points[label.removeprefix(POINT)] = FileFrame(body, poses.pose(None, T[:3, 3]))
            mechanism.fully_listed |= {"point"}
            continue
        mechanism.frames[label.removeprefix(MARK)] = FileFrame(body, T)
        if label.startswith(MARK):
            mechanism.fully_listed |= {"frame"}


def _opening_under_load(model: mujoco.MjModel) -> float | None:
    """Return the length in m (angle in rad) by which the softest equality constraint opens if 1 g pulls at it.

    A constraint with the impedance d and the stiffness k balances an acceleration a at the displacement
    (1 - d) a / (d^2 k), with k = 1 / (d_width timeconst dampratio)^2 (MuJoCo, "Computation", solver parameters). Links
    that carry heavier ones open by a multiple of it. Return None if there is no constraint.
    """
    openings = []
    for equality in range(model.neq):
        if not _is_active(model, equality):
            continue
        time, ratio = model.eq_solref[equality].tolist()
        start, width = np.clip(model.eq_solimp[equality][:2], 1e-4, 0.9999).tolist()
        if time > 0:
            if not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_REFSAFE:
                time = max(time, 2 * model.opt.timestep)
            stiffness = 1 / (width * time * ratio) ** 2 if ratio > 0 else np.inf
        else:  # negative parameters are stiffness and damping themselves
            stiffness = -time / width**2
        opening = np.inf
        if stiffness:
            opening = 9.81 * (1 - start) / (start**2 * stiffness)
        openings.append(opening)
    return max(openings, default=None)


def _is_active(model: mujoco.MjModel, equality: int) -> bool:
    """Return whether an equality constraint acts from the start."""
    return bool(model.eq_active0[equality]) and not model.opt.disableflags & _NO_LOOPS


def _is_between_sites(model: mujoco.MjModel, equality: int) -> bool:
    return int(model.eq_objtype[equality]) == int(mujoco.mjtObj.mjOBJ_SITE)


def _nonempty(names: Iterable[str]) -> tuple[str, ...]:
    return tuple(filter(None, names))  # names are optional in MJCF


def _pose(p: Array, wxyz: Array) -> Array:
    return poses.pose(poses.rotation(np.asarray(wxyz)[[1, 2, 3, 0]]), np.array(p))


def _motions(model: mujoco.MjModel, joint: int) -> list[JointLine]:
    point = model.jnt_pos[joint].copy()
    axis = model.jnt_axis[joint].copy()
    if model.jnt_type[joint] == SLIDE:
        return [JointLine("slide", point, axis)]
    if model.jnt_type[joint] == HINGE:
        return [JointLine("turn", point, axis)]
    slides: list[JointLine] = []
    turns: list[JointLine] = []
    for direction in np.eye(3):
        slides.append(JointLine("slide", point, direction))
        turns.append(JointLine("turn", point, direction))
    if model.jnt_type[joint] == BALL:
        return turns
    return slides + turns


def _texts(model: mujoco.MjModel) -> dict[str, str]:
    """Return {name: content} of the <text> elements, which state the kinds of the motors."""
    texts: dict[str, str] = {}
    for i in range(model.ntext):
        start = int(model.text_adr[i])
        end = start + int(model.text_size[i])
        content, _, _ = bytes(model.text_data[start:end]).partition(b"\0")  # MuJoCo ends texts with a zero byte
        name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_TEXT, i) or ""
        texts[name] = content.decode("utf-8", "replace")
    return texts


def _tendon_parts(model: mujoco.MjModel, tendon: int) -> range:
    """Return the numbers of the parts of a tendon."""
    first = model.tendon_adr[tendon]
    return range(first, first + model.tendon_num[tendon])


def _ratios(model: mujoco.MjModel, tendon: int, gear: float) -> dict[str, float]:
    """Return {joint: gear times coefficient} of a fixed tendon; {} for a spatial tendon."""
    ratios: dict[str, float] = {}
    for wrap in _tendon_parts(model, tendon):
        if int(model.wrap_type[wrap]) != int(mujoco.mjtWrap.mjWRAP_JOINT):
            return {}
        ratios[model.joint(int(model.wrap_objid[wrap])).name] = gear * float(model.wrap_prm[wrap])
    return ratios


def _motors(model: mujoco.MjModel) -> dict[str, FileMotor]:
    """Return {name: motor} for the actuators that pull fixed tendons. Actuator length = gear times tendon length."""
    motors: dict[str, FileMotor] = {}
    kinds = _texts(model)
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
        servo = int(model.actuator_biastype[actuator]) == int(mujoco.mjtBias.mjBIAS_AFFINE)
        effort = np.inf
        if model.actuator_forcelimited[actuator]:
            effort = float(np.abs(model.actuator_forcerange[actuator]).max())
        name = model.actuator(actuator).name
        motors[name] = FileMotor(
            ratios,
            kinds.get(name),
            (low, high),
            effort,
            None,
            float(model.tendon_armature[tendon]) / gear**2,
            -float(model.actuator_biasprm[actuator, 1]) * servo,
            -float(model.actuator_biasprm[actuator, 2]) * servo,
            _law(model, actuator),
        )
    return motors


def _law(model: mujoco.MjModel, actuator: int) -> str:
    """Return what the gains of an actuator give: always a force, which MuJoCo may delay."""
    if model.actuator_dyntype[actuator] == mujoco.mjtDyn.mjDYN_NONE:
        return "force"
    return f"force, delayed by {model.actuator_dynprm[actuator, 0]:g} s"


def _drives(model: mujoco.MjModel, motors: dict[str, FileMotor]) -> list[FileDrive]:
    """Return the drive of each joint, from its actuator and its range."""
    actuator_of_joint: dict[int, int] = {}  # joint -> actuator
    if not model.opt.disableflags & _NO_DRIVES:
        for actuator in range(model.nu):
            if int(model.actuator_trntype[actuator]) == int(mujoco.mjtTrn.mjTRN_JOINT):
                actuator_of_joint[int(model.actuator_trnid[actuator, 0])] = actuator
    drives: list[FileDrive] = []
    for joint in range(model.njnt):
        if model.jnt_type[joint] not in (SLIDE, HINGE):
            drives.append(FileDrive())
            continue
        limits = (-np.inf, np.inf)
        if model.jnt_limited[joint] and not model.opt.disableflags & _NO_LIMITS:
            low, high = map(float, model.jnt_range[joint])
            margin = float(model.jnt_margin[joint])  # MuJoCo pushes back from this far within the range
            limits = (low + margin, high - margin)
        dof = model.jnt_dofadr[joint]
        # np.max, because stiffness and damping may be polynomials
        joint_dynamics = JointDynamics(
            stiffness=float(np.max(model.jnt_stiffness[joint])),
            damping=float(np.max(model.dof_damping[dof])),
            friction=float(np.max(model.dof_frictionloss[dof])),
            inertia=float(np.max(model.dof_armature[dof])),
        )
        actuator = actuator_of_joint.get(joint)
        if actuator is None:
            gains = drive_of_motors(motors, model.joint(joint).name)
            stiffness, damping = gains or (None, None)
            drive = FileDrive(limits, gains is not None, stiffness, damping)
            drives.append(replace(drive, joint_dynamics=joint_dynamics, breaks=np.inf))
            continue
        gear = float(model.actuator_gear[actuator, 0])
        stiffness = -float(model.actuator_biasprm[actuator, 1]) * gear**2
        damping = -float(model.actuator_biasprm[actuator, 2]) * gear**2
        effort = None
        if model.actuator_forcelimited[actuator]:
            effort = float(np.abs(model.actuator_forcerange[actuator]).max() * abs(gear))
        elif model.actuator_forcerange[actuator].any() or model.actuator_forcelimited.any():
            # The limit is switched off by forcelimited="false", or missing although others of the file are limited.
            effort = np.inf
        drive = FileDrive(limits, True, stiffness, damping, effort, control=_control(model, actuator, joint, limits))
        drives.append(replace(drive, joint_dynamics=joint_dynamics, law=_law(model, actuator), breaks=np.inf))
    return drives


def _control(
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


def _loop_joints(model: mujoco.MjModel, names: list[str]) -> list[FileJoint]:
    """Return the loop closures as joints: a <connect> becomes a tie of two points, a <weld> a fixed joint."""
    joints = []
    for equality in range(model.neq):
        kind = int(model.eq_type[equality])
        if kind not in (_CONNECT, _WELD) or not _is_active(model, equality):
            continue
        first = int(model.eq_obj1id[equality])
        second = int(model.eq_obj2id[equality])
        if _is_between_sites(model, equality):
            T_first = _pose(model.site_pos[first], model.site_quat[first])
            T_second = _pose(model.site_pos[second], model.site_quat[second])
            first = int(model.site_bodyid[first])
            second = int(model.site_bodyid[second])
        elif kind == _CONNECT:
            T_first = poses.pose(None, model.eq_data[equality, 0:3])
            T_second = poses.pose(None, model.eq_data[equality, 3:6])
        else:  # the anchor is a point of the second body; the relative pose is T_first_second
            T_first = _pose(model.eq_data[equality, 3:6], model.eq_data[equality, 6:10])
            T_second = np.eye(4)
        name = model.equality(equality).name
        if kind == _CONNECT:
            joints.append(
                FileJoint(_nonempty([name]), names[first], names[second], tied=((T_first[:3, 3], T_second[:3, 3]),))
            )
        else:
            joints.append(FileJoint(_nonempty([name]), names[first], names[second], T_first @ poses.inverse(T_second)))
    return joints


def _couplings(model: mujoco.MjModel) -> dict[str, tuple[dict[str, float], float]]:
    couplings: dict[str, tuple[dict[str, float], float]] = {}
    for equality in range(model.neq):
        if not _is_active(model, equality):
            continue
        if int(model.eq_type[equality]) == _TENDON and model.eq_obj2id[equality] < 0:
            tendon = int(model.eq_obj1id[equality])
            ratios: dict[str, float] = {}
            for wrap in _tendon_parts(model, tendon):
                ratios[model.joint(int(model.wrap_objid[wrap])).name] = float(model.wrap_prm[wrap])
            couplings[model.equality(equality).name] = (
                ratios,
                float(model.eq_data[equality, 0] + model.tendon_length0[tendon]),
            )
        elif int(model.eq_type[equality]) == _COUPLE and model.eq_obj2id[equality] >= 0:
            first = model.joint(int(model.eq_obj1id[equality]))
            second = model.joint(int(model.eq_obj2id[equality]))
            total = model.eq_data[equality, 0] + first.qpos0[0] - model.eq_data[equality, 1] * second.qpos0[0]
            couplings[model.equality(equality).name] = (
                {first.name: 1.0, second.name: -float(model.eq_data[equality, 1])},
                float(total),
            )
    return couplings
