"""Read the mechanism data of an MJCF from the model that MuJoCo compiles."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import mujoco
import numpy as np

from twin.exchange.audit import poses
from twin.exchange.audit.physics import (
    FileDrive,
    FileFrame,
    FileJoint,
    FileMass,
    FileMotor,
    FilePhysics,
    JointLine,
    felt,
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
    out.floats = {name: float(m.body_gravcomp[i]) for name, i in bodies.items()}
    out.motors, out.all_motors = _motors(m), True
    names = [m.body(i).name for i in range(m.nbody)]
    for name, i in bodies.items():
        if i and (m.body_mass[i] or m.body_weldid[i]):  # a body fixed to the world needs no mass: 0 means "not stated"
            R = poses.rotation(m.body_iquat[i][[1, 2, 3, 0]])
            inertia = R @ np.diag(m.body_inertia[i]) @ R.T
            out.masses[name] = FileMass(float(m.body_mass[i]), m.body_ipos[i].copy(), inertia)
    drives = _drives(m, out.motors)
    for i in range(1, m.nbody):
        T = _pose(m.body_pos[i], m.body_quat[i])
        own = range(m.body_jntadr[i], m.body_jntadr[i] + m.body_jntnum[i]) if m.body_jntnum[i] else range(0)
        motions = tuple(line.seen(T) for j in own for line in _motions(m, j))
        single = [drives[j] for j in own] if len(own) == 1 else []
        known = [drives[j] for j in own if drives[j].driven]
        if len(own) == 1 and m.jnt_type[own[0]] in (HINGE, SLIDE):  # a body is placed at `ref`, not at zero
            T = motions[0].moved(-float(m.qpos0[m.jnt_qposadr[own[0]]])) @ T
        parent = names[m.body_parentid[i]]
        drive = single[0] if single else known[0] if len(known) == 1 else FileDrive()
        out.joints.append(FileJoint(_named(m.joint(j).name for j in own), parent, names[i], T, motions, drive))
    held = [n for n, i in bodies.items() if i == 0 or (m.body_parentid[i] == 0 and not m.body_jntnum[i])]
    out.held = frozenset(held)
    out.joints += _ties(m, names)
    tying = {int(i) for e in range(m.neq) if _by_sites(m, e) for i in (m.eq_obj1id[e], m.eq_obj2id[e])}
    for s in (s for s in range(m.nsite) if s not in tying):
        site = m.site(s)
        T = _pose(m.site_pos[s], m.site_quat[s])
        body = names[m.site_bodyid[s]]
        if site.name.startswith(POINT):
            out.points[site.name.removeprefix(POINT)] = FileFrame(body, poses.pose(None, T[:3, 3]))
            out.marks |= {"point"}
            continue
        out.frames[site.name.removeprefix(MARK)] = FileFrame(body, T)
        if site.name.startswith(MARK):
            out.marks |= {"frame"}
    out.opening = _opening(m)
    return out


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
        else:
            stiffness = -time / width**2
        openings.append(9.81 * (1 - start) / (start**2 * stiffness) if stiffness else np.inf)
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
    point, axis = m.jnt_pos[j].copy(), m.jnt_axis[j].copy()
    if m.jnt_type[j] in (SLIDE, HINGE):
        return [JointLine("slide" if m.jnt_type[j] == SLIDE else "turn", point, axis)]
    kinds = ("turn",) if m.jnt_type[j] == BALL else ("slide", "turn")
    return [JointLine(kind, point, d) for kind in kinds for d in np.eye(3)]


def _texts(m: mujoco.MjModel) -> Iterator[tuple[str, str]]:
    for i in range(m.ntext):
        start = int(m.text_adr[i])
        data = bytes(m.text_data[start : start + int(m.text_size[i])]).split(b"\0")[0]
        yield mujoco.mj_id2name(m, mujoco.mjtObj.mjOBJ_TEXT, i) or "", data.decode("utf-8", "replace")


def _motors(m: mujoco.MjModel) -> dict[str, FileMotor]:
    """Return {name: motor} for the actuators that pull fixed tendons. Actuator length = gear times tendon length."""
    out = {}
    kinds = dict(_texts(m))
    for a in range(m.nu):
        if int(m.actuator_trntype[a]) != int(mujoco.mjtTrn.mjTRN_TENDON):
            continue
        t, gear, name = int(m.actuator_trnid[a, 0]), float(m.actuator_gear[a, 0]), m.actuator(a).name
        wraps = range(m.tendon_adr[t], m.tendon_adr[t] + m.tendon_num[t])
        if not gear or any(int(m.wrap_type[w]) != int(mujoco.mjtWrap.mjWRAP_JOINT) for w in wraps):
            continue
        ends = sorted(float(v) * gear for v in m.tendon_range[t]) if m.tendon_limited[t] else (-np.inf, np.inf)
        servo = int(m.actuator_biastype[a]) == int(mujoco.mjtBias.mjBIAS_AFFINE)
        stiffness, damping = (-float(m.actuator_biasprm[a, k]) * servo for k in (1, 2))
        out[name] = FileMotor(
            {m.joint(int(m.wrap_objid[w])).name: gear * float(m.wrap_prm[w]) for w in wraps},
            kinds.get(name),
            (ends[0], ends[1]),
            float(np.abs(m.actuator_forcerange[a]).max()) if m.actuator_forcelimited[a] else np.inf,
            None,
            float(m.tendon_armature[t]) / gear**2,
            stiffness,
            damping,
        )
    return out


def _drives(m: mujoco.MjModel, motors: dict[str, FileMotor]) -> list[FileDrive]:
    """Return the drive of each joint, from its actuator and its range."""
    acting = {
        int(m.actuator_trnid[a, 0]): a
        for a in range(m.nu)
        if int(m.actuator_trntype[a]) == int(mujoco.mjtTrn.mjTRN_JOINT) and not m.opt.disableflags & _NO_DRIVES
    }
    out = []
    for j in range(m.njnt):
        limited = m.jnt_limited[j] and not m.opt.disableflags & _NO_LIMITS
        limits = tuple(map(float, m.jnt_range[j])) if limited else (-np.inf, np.inf)
        a = acting.get(j)
        dof = m.jnt_dofadr[j]
        own = (m.jnt_stiffness[j], m.dof_damping[dof], m.dof_frictionloss[dof], m.dof_armature[dof])
        stiff, damped, dry, heavy = (float(np.max(v)) for v in own)  # stiffness and damping may be polynomials
        passive = (stiff, damped, dry, heavy)
        if m.jnt_type[j] not in (SLIDE, HINGE):
            out.append(FileDrive())
            continue
        if a is None:
            gains = felt(motors, m.joint(j).name)
            stiffness, damping = gains or (None, None)
            drive = FileDrive((limits[0], limits[1]), gains is not None, stiffness, damping)
            out.append(replace(drive, passive=passive, breaks=np.inf))
            continue
        gear = float(m.actuator_gear[a, 0])
        stiffness, damping = (-float(m.actuator_biasprm[a, k]) * gear**2 for k in (1, 2))
        bounds = m.actuator_forcerange[a] if m.actuator_forcelimited[a] else None
        effort = None if bounds is None else float(max(abs(bounds[0]), abs(bounds[1])) * abs(gear))
        drive = FileDrive((limits[0], limits[1]), True, stiffness, damping, effort)
        out.append(replace(drive, passive=passive, law="force", breaks=np.inf))  # MuJoCo has no other law
    return out


def _ties(m: mujoco.MjModel, names: list[str]) -> list[FileJoint]:
    """Return the loop closures as joints: a <connect> becomes a tie of two points, a <weld> a fixed joint."""
    out = []
    for e in range(m.neq):
        kind = int(m.eq_type[e])
        if kind not in (_CONNECT, _WELD) or not _holds(m, e):
            continue
        one, two = int(m.eq_obj1id[e]), int(m.eq_obj2id[e])
        if _by_sites(m, e):
            ends = [(int(m.site_bodyid[s]), _pose(m.site_pos[s], m.site_quat[s])) for s in (one, two)]
        elif kind == _CONNECT:
            ends = [(b, poses.pose(None, m.eq_data[e, 3 * k : 3 * k + 3])) for k, b in enumerate((one, two))]
        else:  # the anchor is a point of the second body; the relative pose is T_first_second
            relative = _pose(m.eq_data[e, 3:6], m.eq_data[e, 6:10])
            ends = [(one, relative), (two, np.eye(4))]
        (a, T_a), (b, T_b) = ends
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
            t = int(m.eq_obj1id[e])
            rows = range(m.tendon_adr[t], m.tendon_adr[t] + m.tendon_num[t])
            ratios = {m.joint(int(m.wrap_objid[w])).name: float(m.wrap_prm[w]) for w in rows}
            out[m.equality(e).name] = (ratios, float(m.eq_data[e, 0] + m.tendon_length0[t]))
        elif int(m.eq_type[e]) == _COUPLE and m.eq_obj2id[e] >= 0:
            one, two = (m.joint(int(i)) for i in (m.eq_obj1id[e], m.eq_obj2id[e]))
            total = m.eq_data[e, 0] + one.qpos0[0] - m.eq_data[e, 1] * two.qpos0[0]
            out[m.equality(e).name] = ({one.name: 1.0, two.name: -float(m.eq_data[e, 1])}, float(total))
    return out
