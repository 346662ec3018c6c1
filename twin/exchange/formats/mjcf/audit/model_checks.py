"""Check what an MJCF file declares beside poses: servos, names, colliders, softness, keyframes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Hashable, Mapping
from typing import TypeVar

import mujoco
import numpy as np

from twin.exchange.audit.poses import Array
from twin.exchange.audit.report import Ledger, Measured, quantity
from twin.exchange.formats.mjcf.audit.claims import Balance
from twin.exchange.formats.mjcf.audit.physics import BALL, HINGE, SLIDE

ROUNDING_TOL = 1e-5
"""Maximum relative difference of limits or gains that counts as a rounding error: MuJoCo saves six digits."""

KEY_GAP = 1e-4
"""Maximum residual in m or rad of an equality constraint at a keyframe; simulations start from keyframes."""

Form = TypeVar("Form", bound=Hashable)

_COMMON = 0.7
"""Fraction of elements that must be alike, so that the others count as different by mistake."""

_UNLIMITED = 1e29
"""Limits of tracks in m or rad above this size mean "no limit"."""

_RANGE_SLACK = 1e-6
"""Largest excess over a range, in m or rad, that counts as a rounding error of a keyframe."""


def gap_of(m: mujoco.MjModel, d: mujoco.MjData) -> tuple[float, str]:
    """Return (largest residual of an equality constraint in m or rad, name of this constraint)."""
    gaps = np.where(d.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY, np.abs(d.efc_pos), 0.0)
    if not gaps.any():
        return 0.0, ""
    row = int(np.argmax(gaps))
    return float(gaps[row]), m.equality(int(d.efc_id[row])).name


def opening(m: mujoco.MjModel, equality: str, gap: float) -> str:
    """Return the residual of an equality constraint as text: a length of points, else in m or rad."""
    if equality and m.equality(equality).type == mujoco.mjtEq.mjEQ_CONNECT:
        return quantity(gap, "m")
    return f"{gap:.4g} m or rad"


def check_model(m: mujoco.MjModel, ledger: Ledger) -> None:
    """Report faults of actuators, names, colliders, solver parameters and keyframes."""
    d = mujoco.MjData(m)
    names: dict[str, int] = {}
    for j in range(m.njnt):
        if m.joint(j).name:
            names[m.joint(j).name] = j
    for a in range(m.nu):
        if int(m.actuator_trntype[a]) != int(mujoco.mjtTrn.mjTRN_JOINT):
            continue
        name = m.actuator(a).name
        j = int(m.actuator_trnid[a, 0])
        if names.get(name, j) != j:
            text = f"actuator '{name}' drives joint '{m.joint(j).name}', not the joint of the same name."
            advice = "let the actuator drive the joint of the same name, or rename the actuator"
            ledger.wrong("mjcf.actuator", text, name, suggestion=advice)
    for a in range(m.nu):
        _check_servo(m, a, ledger)
        _check_ranges(m, a, ledger)
    _check_names(m, ledger)
    _check_colliders(m, ledger)
    _check_softness(m, ledger)
    _check_soft_limits(m, ledger)
    for k in range(m.nkey):
        _check_key(m, d, k, ledger)


def check_limits(
    m: mujoco.MjModel, track: str, low: Mapping[str, float], high: Mapping[str, float], ledger: Ledger
) -> None:
    """Compare the joint ranges of a model with the joint limits in a track.

    `track` is the file name of the track. `low` and `high` map joints to their limits in the track, in m or rad.
    """
    for j in range(m.njnt):
        joint = m.joint(j).name
        if joint not in low or abs(low[joint]) > _UNLIMITED:
            continue
        lower = -np.inf
        upper = np.inf
        if m.jnt_limited[j]:
            lower, upper = m.jnt_range[j].tolist()
        difference = float(np.max(np.abs([lower - low[joint], upper - high[joint]])))
        scale = 1.0
        for limit in (low[joint], high[joint]):
            if abs(limit) < _UNLIMITED:
                scale = max(scale, abs(limit))
        if not difference <= ROUNDING_TOL * scale:
            text = (
                f"joint '{joint}' has range {lower:g} .. {upper:g}; in {track} it is {low[joint]:g} .. {high[joint]:g}."
            )
            ledger.wrong("mjcf.limits", text, joint, size=difference)


def _check_servo(m: mujoco.MjModel, a: int, ledger: Ledger) -> None:
    """Report a position servo whose control is no position: force = gain * control - stiffness * coordinate + ...

    The control is the coordinate, or the displacement of the coordinate from `ref`.
    """
    name = m.actuator(a).name
    gain = float(m.actuator_gainprm[a, 0])
    stiffness = -float(m.actuator_biasprm[a, 1])
    affine = int(m.actuator_biastype[a]) == int(mujoco.mjtBias.mjBIAS_AFFINE)
    if not affine or stiffness <= 0:  # a motor, or a drive of the speed
        return
    if abs(gain - stiffness) > ROUNDING_TOL * stiffness:
        text = (
            f"actuator '{name}': gainprm is {gain:.6g}, but -biasprm[1] is {stiffness:.6g}: a control of 1 moves the "
            f"drive by {gain / stiffness:.6g}."
        )
        ledger.wrong(
            "mjcf.control", text, name, size=Measured(gain, stiffness), suggestion="write gainprm = -biasprm[1]"
        )
    stretch = _stretch(m, a)
    gear = float(m.actuator_gear[a, 0])
    if stretch is None or not m.actuator_ctrllimited[a] or not gear:
        return
    range_, at_home, kind = stretch
    lowest, highest = np.sort(m.actuator_ctrlrange[a] / gear)
    beyond = []
    for start in (0.0, at_home):
        low, high = range_ - start
        beyond.append(max(float(low - lowest), float(highest - high)))
    largest = float(np.abs(range_).max())
    if min(beyond) > ROUNDING_TOL * max(1.0, largest):
        text = (
            f"actuator '{name}': ctrlrange {lowest:.6g} .. {highest:.6g} goes beyond the range of its {kind} by "
            f"{min(beyond):.6g}: relative to home it is {low:.6g} .. {high:.6g}."
        )
        advice = f"write ctrlrange = range of the {kind} - its value at home"
        ledger.wrong("mjcf.control", text, name, size=min(beyond), suggestion=advice)


def _check_ranges(m: mujoco.MjModel, a: int, ledger: Ledger) -> None:
    """Report ranges of an actuator that the file declares and switches off: MuJoCo then ignores them."""
    name = m.actuator(a).name
    for what, limited, range_ in (
        ("ctrl", m.actuator_ctrllimited[a], m.actuator_ctrlrange[a]),
        ("force", m.actuator_forcelimited[a], m.actuator_forcerange[a]),
    ):
        if limited or not range_.any():
            continue
        text = (
            f"actuator '{name}' has {what}range {range_[0]:g} .. {range_[1]:g}, but {what}limited is false: MuJoCo "
            "ignores the range."
        )
        ledger.add("mjcf.range_off", "warning", text, name, suggestion=f"remove {what}limited, or {what}range")


def _stretch(m: mujoco.MjModel, a: int) -> tuple[Array, float, str] | None:
    """Return (range (2,), value at home, "joint" or "tendon") of what an actuator moves; None if it has no range."""
    i = int(m.actuator_trnid[a, 0])
    moves = int(m.actuator_trntype[a])
    if moves == int(mujoco.mjtTrn.mjTRN_TENDON) and m.tendon_limited[i]:
        return m.tendon_range[i], float(m.tendon_length0[i]), "tendon"
    if moves == int(mujoco.mjtTrn.mjTRN_JOINT) and m.jnt_limited[i] and m.jnt_type[i] in (HINGE, SLIDE):
        return m.jnt_range[i], float(m.qpos0[m.jnt_qposadr[i]]), "joint"
    return None


def _check_names(m: mujoco.MjModel, ledger: Ledger) -> None:
    """Report hinges and slides without a name if most others of the file have one: values are assigned by name."""
    single = [j for j in range(m.njnt) if m.jnt_type[j] in (HINGE, SLIDE)]
    unnamed = [j for j in single if not m.joint(j).name]
    if 2 * len(unnamed) >= len(single):
        return
    for j in unnamed:
        body = m.body(int(m.jnt_bodyid[j])).name
        text = f"the joint of body '{body}' has no name; {len(single) - len(unnamed)} others of the file have one."
        ledger.add("mjcf.unnamed", "warning", text, body, suggestion="name the joint as in the other files")


def _check_colliders(m: mujoco.MjModel, ledger: Ledger) -> None:
    """Report meshes that a body has twice, and meshes that collide in another way than most others in the file."""
    forms: dict[int, tuple[int, int]] = {}
    seen: set[tuple[bytes, ...]] = set()
    for g in range(m.ngeom):
        if m.geom_type[g] != mujoco.mjtGeom.mjGEOM_MESH:
            continue
        forms[g] = (int(m.geom_contype[g]), int(m.geom_conaffinity[g]))
        fields = (m.geom_bodyid, m.geom_dataid, m.geom_pos, m.geom_quat, m.geom_contype, m.geom_conaffinity)
        place = tuple(field[g].tobytes() for field in (*fields, m.geom_group, m.geom_matid))
        if place in seen:
            name, mesh = _body_and_mesh(m, g)
            text = f"body '{name}' has the shape of mesh '{mesh}' twice at the same place."
            ledger.add("mjcf.repeated", "warning", text, name, suggestion="keep one of them")
        seen.add(place)
    common = _usual(forms.values())
    if common is None:
        return
    count = list(forms.values()).count(common)
    for g, form in forms.items():
        if form != common:
            name, mesh = _body_and_mesh(m, g)
            text = (
                f"body '{name}': the shape of mesh '{mesh}' has contype {form[0]} and conaffinity {form[1]}, "
                f"{count} others have {common[0]} and {common[1]}: it collides with other things."
            )
            ledger.add("mjcf.collider", "warning", text, name, suggestion="give all shapes the same bits")


def _body_and_mesh(m: mujoco.MjModel, geom: int) -> tuple[str, str]:
    """Return the names of the body and of the mesh of a geom."""
    body = m.body(int(m.geom_bodyid[geom]))
    mesh = m.mesh(int(m.geom_dataid[geom]))
    return body.name, mesh.name


def _usual(forms: Collection[Form]) -> Form | None:
    """Return the form that most have; None if there is none, or so few that they do not say which is meant."""
    if len(forms) < 3:
        return None
    common, count = Counter(forms).most_common(1)[0]
    return common if count >= _COMMON * len(forms) else None


def _solver_text(row: tuple[float, ...], common: tuple[float, ...]) -> str:
    """Return the parameters of the solver in words, beside those of most others."""
    own = f"solref {row[0]:g} {row[1]:g} and solimp {row[2]:g} {row[3]:g}"
    return f"{own}, most others have {common[0]:g} {common[1]:g} and {common[2]:g} {common[3]:g}"


def _check_softness(m: mujoco.MjModel, ledger: Ledger) -> None:
    """Report equality constraints whose solver parameters differ from those of most others in the file."""
    rows: list[tuple[float, ...]] = []
    for e in range(m.neq):
        rows.append((*m.eq_solref[e].tolist(), *m.eq_solimp[e].tolist()))
    if not rows:
        return
    common, _ = Counter(rows).most_common(1)[0]
    for e, row in enumerate(rows):
        if row != common:
            name = m.equality(e).name
            text = f"equality '{name}' has {_solver_text(row, common)}: its loop opens by another amount under load."
            ledger.wrong("mjcf.softness", text, name, suggestion="give all loops the same solref and solimp")


def _check_soft_limits(m: mujoco.MjModel, ledger: Ledger) -> None:
    """Report limits of joints that yield by other parameters of the solver than most others in the file."""
    rows: dict[str, tuple[float, ...]] = {}
    for j in range(m.njnt):
        if m.jnt_limited[j]:
            rows[m.joint(j).name] = (*m.jnt_solref[j].tolist(), *m.jnt_solimp[j].tolist())
    common = _usual(rows.values())
    if common is None:
        return
    for name, row in rows.items():
        if row != common:
            text = f"the limit of joint '{name}' has {_solver_text(row, common)}: it yields differently."
            ledger.add("mjcf.softness", "warning", text, name, suggestion="give all limits the same parameters")


def _check_key(m: mujoco.MjModel, d: mujoco.MjData, k: int, ledger: Ledger) -> None:
    name = m.key(k).name or f"key {k}"
    mujoco.mj_resetDataKeyframe(m, d, k)
    mujoco.mj_fwdPosition(m, d)
    worst, where = gap_of(m, d)
    if m.neq:
        ledger.row(f"loops at keyframe '{name}'", worst, "m", KEY_GAP)
    if worst > KEY_GAP:
        text = f"keyframe '{name}': equality '{where}' is open by {opening(m, where, worst)}."
        ledger.wrong("mjcf.keyframe", text, name, size=Measured(worst, KEY_GAP, "m"))
    for j in range(m.njnt):
        q = float(d.qpos[m.jnt_qposadr[j]])
        low, high = m.jnt_range[j]
        if m.jnt_limited[j] and m.jnt_type[j] != BALL and not low - _RANGE_SLACK <= q <= high + _RANGE_SLACK:
            text = f"keyframe '{name}': joint '{m.joint(j).name}' is at {q:.6g}, outside {low:.6g} .. {high:.6g}."
            ledger.wrong("mjcf.keyframe", text, name, size=q)
    _check_push(m, d, name, ledger)


def _check_push(m: mujoco.MjModel, d: mujoco.MjData, name: str, ledger: Ledger) -> None:
    """Report actuators whose force is at its limit at a keyframe with zero velocity.

    If even the right force would be above the limit, the motor is too weak, which is a warning; else the control is
    wrong.
    """
    mujoco.mj_fwdVelocity(m, d)
    mujoco.mj_fwdActuation(m, d)
    needed = _holding(m, d)
    for a in range(m.nu):
        if not m.actuator_forcelimited[a]:
            continue
        bound = float(np.abs(m.actuator_forcerange[a]).max())
        if abs(needed[a]) > bound:
            text = (
                f"keyframe '{name}': actuator '{m.actuator(a).name}' cannot hold the robot: it needs "
                f"{abs(needed[a]):.4g} N or N m, its maximum effort is {bound:g}."
            )
            where = m.actuator(a).name
            ledger.add("mjcf.effort", "warning", text, where, size=Measured(needed[a], bound))
        elif abs(d.actuator_force[a]) >= bound:
            text = f"keyframe '{name}': actuator '{m.actuator(a).name}' is at its maximum effort, {bound:g} N or N m."
            ledger.wrong(
                "mjcf.keyframe",
                text,
                m.actuator(a).name,
                size=Measured(d.actuator_force[a], bound),
                suggestion="set the actuator's control in the keyframe to the value of its joint",
            )


def _holding(m: mujoco.MjModel, d: mujoco.MjData) -> Array:
    """Return the forces (nu,) in N or N m with which the actuators hold the robot at rest, with closed loops.

    The forces of the actuators and of the equality constraints balance gravity, in the least-squares sense. Loops hold
    what they can: the efforts are the smallest ones.
    """
    columns, loops, gravity = _statics(m, d)
    forces, *_ = np.linalg.lstsq(np.hstack([columns, loops]), gravity, rcond=None)
    return forces[: m.nu]


def _statics(m: mujoco.MjModel, d: mujoco.MjData) -> tuple[Array, Array, Array]:
    """Return what acts at rest: efforts (nv, nu) by actuator, those (nv, k) by loop constraint, and weight (nv,)."""
    columns = np.zeros((m.nv, m.nu))
    for a in range(m.nu):
        for k in range(int(d.moment_rownnz[a])):
            at = int(d.moment_rowadr[a]) + k
            columns[int(d.moment_colind[at]), a] = d.actuator_moment.ravel()[at]
    held = np.flatnonzero(d.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY)
    loops = np.zeros((m.nv, len(held)))
    for i, k in enumerate(held):
        row = np.zeros(m.nv)
        force = np.zeros(d.nefc)
        force[k] = 1.0
        mujoco.mj_mulJacTVec(m, d, row, force)
        loops[:, i] = row
    return columns, loops, d.qfrc_bias - d.qfrc_passive


def balance_at_keyframe(m: mujoco.MjModel) -> Balance | None:
    """Return the forces at the first keyframe; None without a keyframe."""
    if not m.nkey:
        return None
    d = mujoco.MjData(m)
    mujoco.mj_resetDataKeyframe(m, d, 0)
    mujoco.mj_fwdPosition(m, d)
    mujoco.mj_fwdVelocity(m, d)
    mujoco.mj_fwdActuation(m, d)
    columns, loops, gravity = _statics(m, d)
    forces = d.actuator_force.copy()
    servo = m.actuator_biastype == int(mujoco.mjtBias.mjBIAS_AFFINE)
    pulled, *_ = np.linalg.lstsq(np.hstack([columns * servo, loops]), gravity, rcond=None)
    holding = pulled[: m.nu] * servo
    remaining = _unbalanced(gravity - columns @ forces, loops)
    least = _unbalanced(gravity - columns @ holding, loops)
    weight = float(np.abs(gravity).max(initial=0.0))
    return Balance(forces, holding, remaining, least, weight)


def _unbalanced(efforts: Array, loops: Array) -> float:
    """Return the largest of the efforts (nv,) in N or N m that the loops (nv, k) cannot carry."""
    carried, *_ = np.linalg.lstsq(loops, efforts, rcond=None)
    return float(np.abs(efforts - loops @ carried).max(initial=0.0))
