"""Read the mechanism data of an MJCF from the model that MuJoCo compiles."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import mujoco
import numpy as np

from twin.exchange.audit import poses
from twin.exchange.audit.mechanism_data import (
    EMPTY,
    FileDrive,
    FileFrame,
    FileJoint,
    FileMass,
    FileMotor,
    FilePhysics,
    JointLine,
    drive_of_motors,
)
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


def compiled_physics(model: mujoco.MjModel, bodies: dict[str, int]) -> FilePhysics:
    """Return the mechanism data of a compiled model.

    `bodies` maps link names to MuJoCo's body numbers; the world may be one of the links.
    """
    m = model
    gravity = np.zeros(3) if m.opt.disableflags & _NO_GRAVITY else np.array(m.opt.gravity)
    out = FilePhysics(tuple(bodies), complete=True, gravity=gravity, couplings=_couplings(m))
    out.medium = EMPTY
    if m.opt.density or m.opt.viscosity:  # without them, wind has no effect
        out.medium = (m.opt.density, m.opt.viscosity, *m.opt.wind.tolist())
    out.weight_shares = {name: float(m.body_gravcomp[i]) for name, i in bodies.items()}
    out.motors = _motors(m)
    out.all_motors = True
    out.shown = {name: bool(m.body_geomnum[i]) for name, i in bodies.items() if i}  # the world has floors and walls
    out.self_collision = _self_collision(m)
    names = [m.body(i).name for i in range(m.nbody)]
    for name, i in bodies.items():
        if i and (m.body_mass[i] or m.body_weldid[i]):  # a body fixed to the world needs no mass: 0 means "not stated"
            R = poses.rotation(m.body_iquat[i][[1, 2, 3, 0]])
            inertia = R @ np.diag(m.body_inertia[i]) @ R.T
            out.masses[name] = FileMass(float(m.body_mass[i]), m.body_ipos[i].copy(), inertia)
    drives = _drives(m, out.motors)
    for i in range(1, m.nbody):
        out.joints.append(_joint(m, i, names, drives))
    held: set[str] = set()
    for name, i in bodies.items():
        if i == 0 or (m.body_parentid[i] == 0 and not m.body_jntnum[i]):
            held.add(name)
    out.fixed_to_world = frozenset(held)
    out.joints += _ties(m, names)
    _read_sites(m, names, out)
    out.opening = _opening(m)
    return out


def _self_collision(m: mujoco.MjModel) -> bool:
    """Return whether shapes of any two moving bodies are allowed to collide, also if they never meet.

    MuJoCo filters collisions by the bits of two shapes: one's contype and the other's conaffinity share a bit.
    """
    robot = m.body_weldid[m.geom_bodyid] > 0  # not fixed to the world, as floors and the base are
    types = np.bitwise_or.reduce(m.geom_contype[robot], initial=0)
    affinities = np.bitwise_or.reduce(m.geom_conaffinity[robot], initial=0)
    return bool(types & affinities)


def _joint(m: mujoco.MjModel, body: int, names: list[str], drives: list[FileDrive]) -> FileJoint:
    """Return the joint between a body and its parent; a body may have several joints of MuJoCo, or none."""
    T = _pose(m.body_pos[body], m.body_quat[body])
    first = m.body_jntadr[body]
    own = range(first, first + m.body_jntnum[body])
    labels: list[str] = []
    motions: list[JointLine] = []
    driven: list[FileDrive] = []
    for j in own:
        labels.append(m.joint(j).name)
        if drives[j].driven:
            driven.append(drives[j])
        for line in _motions(m, j):
            motions.append(line.transformed(T))
    if len(own) == 1 and m.jnt_type[first] in (HINGE, SLIDE):  # a body is placed at `ref`, not at zero
        T = motions[0].motion(-float(m.qpos0[m.jnt_qposadr[first]])) @ T
    drive = FileDrive()
    if len(own) == 1:
        drive = drives[first]
    elif len(driven) == 1:
        drive = driven[0]
    parent = names[m.body_parentid[body]]
    return FileJoint(_named(labels), parent, names[body], T, tuple(motions), drive)


def _read_sites(m: mujoco.MjModel, names: list[str], out: FilePhysics) -> None:
    """Add the named frames and points of the sites to `out`; sites that equality constraints join are neither."""
    tying: set[int] = set()
    for e in range(m.neq):
        if _by_sites(m, e):
            tying.update((int(m.eq_obj1id[e]), int(m.eq_obj2id[e])))
    for s in range(m.nsite):
        if s in tying:
            continue
        label = m.site(s).name
        T = _pose(m.site_pos[s], m.site_quat[s])
        body = names[m.site_bodyid[s]]
        if label.startswith(POINT):
            out.points[label.removeprefix(POINT)] = FileFrame(body, poses.pose(None, T[:3, 3]))
            out.fully_listed |= {"point"}
            continue
        out.frames[label.removeprefix(MARK)] = FileFrame(body, T)
        if label.startswith(MARK):
            out.fully_listed |= {"frame"}


def _opening(m: mujoco.MjModel) -> float | None:
    """Return the length in m (angle in rad) by which the softest equality constraint opens if 1 g pulls at it.

    A constraint with the impedance d and the stiffness k balances an acceleration a at the displacement
    (1 - d) a / (d^2 k), with k = 1 / (d_width timeconst dampratio)^2 (MuJoCo, "Computation", solver parameters). Links
    that carry heavier ones open by a multiple of it. Return None if there is no constraint.
    """
    openings = []
    for e in range(m.neq):
        if not _holds(m, e):
            continue
        time, ratio = m.eq_solref[e].tolist()
        start, width = np.clip(m.eq_solimp[e][:2], 1e-4, 0.9999).tolist()
        if time > 0:
            if not m.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_REFSAFE:
                time = max(time, 2 * m.opt.timestep)
            stiffness = 1 / (width * time * ratio) ** 2 if ratio > 0 else np.inf
        else:  # negative parameters are stiffness and damping themselves
            stiffness = -time / width**2
        opening = np.inf
        if stiffness:
            opening = 9.81 * (1 - start) / (start**2 * stiffness)
        openings.append(opening)
    return max(openings, default=None)


def _holds(m: mujoco.MjModel, e: int) -> bool:
    """Return whether an equality constraint acts from the start."""
    return bool(m.eq_active0[e]) and not m.opt.disableflags & _NO_LOOPS


def _by_sites(m: mujoco.MjModel, e: int) -> bool:
    return int(m.eq_objtype[e]) == int(mujoco.mjtObj.mjOBJ_SITE)


def _named(names: Iterable[str]) -> tuple[str, ...]:
    return tuple(n for n in names if n)  # names are optional in MJCF


def _pose(p: Array, wxyz: Array) -> Array:
    return poses.pose(poses.rotation(np.asarray(wxyz)[[1, 2, 3, 0]]), np.array(p))


def _motions(m: mujoco.MjModel, j: int) -> list[JointLine]:
    point = m.jnt_pos[j].copy()
    axis = m.jnt_axis[j].copy()
    if m.jnt_type[j] == SLIDE:
        return [JointLine("slide", point, axis)]
    if m.jnt_type[j] == HINGE:
        return [JointLine("turn", point, axis)]
    turns = [JointLine("turn", point, direction) for direction in np.eye(3)]
    if m.jnt_type[j] == BALL:
        return turns
    slides = [JointLine("slide", point, direction) for direction in np.eye(3)]
    return slides + turns


def _texts(m: mujoco.MjModel) -> dict[str, str]:
    """Return {name: content} of the <text> elements, which state the kinds of the motors."""
    texts: dict[str, str] = {}
    for i in range(m.ntext):
        start = int(m.text_adr[i])
        end = start + int(m.text_size[i])
        content, _, _ = bytes(m.text_data[start:end]).partition(b"\0")  # MuJoCo ends texts with a zero byte
        name = mujoco.mj_id2name(m, mujoco.mjtObj.mjOBJ_TEXT, i) or ""
        texts[name] = content.decode("utf-8", "replace")
    return texts


def _wraps(m: mujoco.MjModel, tendon: int) -> range:
    """Return the numbers of the parts of a tendon."""
    first = m.tendon_adr[tendon]
    return range(first, first + m.tendon_num[tendon])


def _ratios(m: mujoco.MjModel, tendon: int, gear: float) -> dict[str, float]:
    """Return {joint: gear times coefficient} of a fixed tendon; {} for a spatial tendon."""
    ratios: dict[str, float] = {}
    for w in _wraps(m, tendon):
        if int(m.wrap_type[w]) != int(mujoco.mjtWrap.mjWRAP_JOINT):
            return {}
        ratios[m.joint(int(m.wrap_objid[w])).name] = gear * float(m.wrap_prm[w])
    return ratios


def _motors(m: mujoco.MjModel) -> dict[str, FileMotor]:
    """Return {name: motor} for the actuators that pull fixed tendons. Actuator length = gear times tendon length."""
    out: dict[str, FileMotor] = {}
    kinds = _texts(m)
    for a in range(m.nu):
        if int(m.actuator_trntype[a]) != int(mujoco.mjtTrn.mjTRN_TENDON):
            continue
        t = int(m.actuator_trnid[a, 0])
        gear = float(m.actuator_gear[a, 0])
        ratios = _ratios(m, t, gear)
        if not gear or not ratios:
            continue
        low, high = -np.inf, np.inf
        if m.tendon_limited[t]:
            low, high = sorted(float(length) * gear for length in m.tendon_range[t])
        servo = int(m.actuator_biastype[a]) == int(mujoco.mjtBias.mjBIAS_AFFINE)
        effort = np.inf
        if m.actuator_forcelimited[a]:
            effort = float(np.abs(m.actuator_forcerange[a]).max())
        name = m.actuator(a).name
        out[name] = FileMotor(
            ratios,
            kinds.get(name),
            (low, high),
            effort,
            None,
            float(m.tendon_armature[t]) / gear**2,
            -float(m.actuator_biasprm[a, 1]) * servo,
            -float(m.actuator_biasprm[a, 2]) * servo,
            _law(m, a),
        )
    return out


def _law(m: mujoco.MjModel, a: int) -> str:
    """Return what the gains of an actuator give: always a force, which MuJoCo may delay."""
    if m.actuator_dyntype[a] == mujoco.mjtDyn.mjDYN_NONE:
        return "force"
    return f"force, delayed by {m.actuator_dynprm[a, 0]:g} s"


def _drives(m: mujoco.MjModel, motors: dict[str, FileMotor]) -> list[FileDrive]:
    """Return the drive of each joint, from its actuator and its range."""
    acting: dict[int, int] = {}  # joint -> actuator
    if not m.opt.disableflags & _NO_DRIVES:
        for a in range(m.nu):
            if int(m.actuator_trntype[a]) == int(mujoco.mjtTrn.mjTRN_JOINT):
                acting[int(m.actuator_trnid[a, 0])] = a
    out: list[FileDrive] = []
    for j in range(m.njnt):
        if m.jnt_type[j] not in (SLIDE, HINGE):
            out.append(FileDrive())
            continue
        limits = (-np.inf, np.inf)
        if m.jnt_limited[j] and not m.opt.disableflags & _NO_LIMITS:
            low, high = map(float, m.jnt_range[j])
            margin = float(m.jnt_margin[j])  # MuJoCo pushes back from this far within the range
            limits = (low + margin, high - margin)
        dof = m.jnt_dofadr[j]
        # np.max, because stiffness and damping may be polynomials
        passive = (
            float(np.max(m.jnt_stiffness[j])),
            float(np.max(m.dof_damping[dof])),
            float(np.max(m.dof_frictionloss[dof])),
            float(np.max(m.dof_armature[dof])),
        )
        a = acting.get(j)
        if a is None:
            gains = drive_of_motors(motors, m.joint(j).name)
            stiffness, damping = gains or (None, None)
            drive = FileDrive(limits, gains is not None, stiffness, damping)
            out.append(replace(drive, passive=passive, breaks=np.inf))
            continue
        gear = float(m.actuator_gear[a, 0])
        stiffness = -float(m.actuator_biasprm[a, 1]) * gear**2
        damping = -float(m.actuator_biasprm[a, 2]) * gear**2
        effort = None
        if m.actuator_forcelimited[a]:
            effort = float(np.abs(m.actuator_forcerange[a]).max() * abs(gear))
        elif m.actuator_forcerange[a].any() or m.actuator_forcelimited.any():
            # The limit is switched off by forcelimited="false", or missing although others of the file are limited.
            effort = np.inf
        drive = FileDrive(limits, True, stiffness, damping, effort, control=_control(m, a, j, limits))
        out.append(replace(drive, passive=passive, law=_law(m, a), breaks=np.inf))
    return out


def _control(m: mujoco.MjModel, a: int, j: int, limits: tuple[float, float]) -> tuple[float, float] | None:
    """Return the range of coordinates that a position servo can be asked for; None for other actuators.

    A control is the coordinate, or its displacement from `ref`; the nearer one to the limits of the joint is meant. A
    range beyond the limits is judged with the file's own limits, so it is cut here.
    """
    gear = float(m.actuator_gear[a, 0])
    stiffness = -float(m.actuator_biasprm[a, 1])
    if int(m.actuator_biastype[a]) != int(mujoco.mjtBias.mjBIAS_AFFINE) or stiffness <= 0 or not gear:
        return None
    low, high = limits
    if not m.actuator_ctrllimited[a]:
        return limits
    lowest, highest = sorted(float(control) / gear for control in m.actuator_ctrlrange[a])
    nearest: tuple[float, float] = limits
    least = np.inf
    for start in (0.0, float(m.qpos0[m.jnt_qposadr[j]])):
        reached = (max(low, lowest + start), min(high, highest + start))
        lost = max(reached[0] - low, high - reached[1])
        if np.isnan(lost):  # no limits on either side
            lost = 0.0
        if lost < least:
            nearest, least = reached, lost
    return nearest


def _ties(m: mujoco.MjModel, names: list[str]) -> list[FileJoint]:
    """Return the loop closures as joints: a <connect> becomes a tie of two points, a <weld> a fixed joint."""
    out = []
    for e in range(m.neq):
        kind = int(m.eq_type[e])
        if kind not in (_CONNECT, _WELD) or not _holds(m, e):
            continue
        a = int(m.eq_obj1id[e])
        b = int(m.eq_obj2id[e])
        if _by_sites(m, e):
            T_a = _pose(m.site_pos[a], m.site_quat[a])
            T_b = _pose(m.site_pos[b], m.site_quat[b])
            a = int(m.site_bodyid[a])
            b = int(m.site_bodyid[b])
        elif kind == _CONNECT:
            T_a = poses.pose(None, m.eq_data[e, 0:3])
            T_b = poses.pose(None, m.eq_data[e, 3:6])
        else:  # the anchor is a point of the second body; the relative pose is T_first_second
            T_a = _pose(m.eq_data[e, 3:6], m.eq_data[e, 6:10])
            T_b = np.eye(4)
        name = m.equality(e).name
        if kind == _CONNECT:
            out.append(FileJoint(_named([name]), names[a], names[b], tied=((T_a[:3, 3], T_b[:3, 3]),)))
        else:
            out.append(FileJoint(_named([name]), names[a], names[b], T_a @ poses.inverse(T_b)))
    return out


def _couplings(m: mujoco.MjModel) -> dict[str, tuple[dict[str, float], float]]:
    out: dict[str, tuple[dict[str, float], float]] = {}
    for e in range(m.neq):
        if not _holds(m, e):
            continue
        if int(m.eq_type[e]) == _TENDON and m.eq_obj2id[e] < 0:
            tendon = int(m.eq_obj1id[e])
            ratios: dict[str, float] = {}
            for w in _wraps(m, tendon):
                ratios[m.joint(int(m.wrap_objid[w])).name] = float(m.wrap_prm[w])
            out[m.equality(e).name] = (ratios, float(m.eq_data[e, 0] + m.tendon_length0[tendon]))
        elif int(m.eq_type[e]) == _COUPLE and m.eq_obj2id[e] >= 0:
            one = m.joint(int(m.eq_obj1id[e]))
            two = m.joint(int(m.eq_obj2id[e]))
            total = m.eq_data[e, 0] + one.qpos0[0] - m.eq_data[e, 1] * two.qpos0[0]
            out[m.equality(e).name] = ({one.name: 1.0, two.name: -float(m.eq_data[e, 1])}, float(total))
    return out
