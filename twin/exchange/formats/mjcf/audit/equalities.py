"""Read the equality constraints of an MJCF: loops, couplings, and how far loops open under load."""

from __future__ import annotations

from collections.abc import Iterable

import mujoco
import numpy as np

from twin.exchange.audit import poses
from twin.exchange.audit.file_joints import FileJoint
from twin.exchange.formats.mjcf.audit.mujoco_conventions import NO_LOOPS, pose_of

_CONNECT, _WELD, _COUPLE, _TENDON = range(4)
"""Numbers of MuJoCo's equality constraints (enumeration mjtEq): connect, weld, joint, tendon."""

_IMPEDANCES = (1e-4, 0.9999)
"""Range to which MuJoCo clips impedances (mjMINIMP, mjMAXIMP)."""

_EARTH = 9.81
"""Acceleration in m/s2 of 1 g."""


def opening_under_load(model: mujoco.MjModel) -> float | None:
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
        start, width = np.clip(model.eq_solimp[equality][:2], *_IMPEDANCES).tolist()
        if time > 0:
            if not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_REFSAFE:
                time = max(time, 2 * model.opt.timestep)
            stiffness = 1 / (width * time * ratio) ** 2 if ratio > 0 else np.inf
        else:  # negative parameters are stiffness and damping themselves
            stiffness = -time / width**2
        opening = np.inf
        if stiffness:
            opening = _EARTH * (1 - start) / (start**2 * stiffness)
        openings.append(opening)
    return max(openings, default=None)


def _is_active(model: mujoco.MjModel, equality: int) -> bool:
    """Return whether an equality constraint acts from the start."""
    return bool(model.eq_active0[equality]) and not model.opt.disableflags & NO_LOOPS


def is_between_sites(model: mujoco.MjModel, equality: int) -> bool:
    """Return whether an equality constraint joins two sites, not two bodies."""
    return int(model.eq_objtype[equality]) == int(mujoco.mjtObj.mjOBJ_SITE)


def nonempty_names(names: Iterable[str]) -> tuple[str, ...]:
    """Return the names that are stated: names are optional in MJCF."""
    return tuple(filter(None, names))


def tendon_parts(model: mujoco.MjModel, tendon: int) -> range:
    """Return the numbers of the parts of a tendon."""
    first = model.tendon_adr[tendon]
    return range(first, first + model.tendon_num[tendon])


def loop_joints(model: mujoco.MjModel, names: list[str]) -> list[FileJoint]:
    """Return the loop closures as joints: a <connect> becomes a tie of two points, a <weld> a fixed joint."""
    joints = []
    for equality in range(model.neq):
        kind = int(model.eq_type[equality])
        if kind not in (_CONNECT, _WELD) or not _is_active(model, equality):
            continue
        first = int(model.eq_obj1id[equality])
        second = int(model.eq_obj2id[equality])
        if is_between_sites(model, equality):
            T_first = pose_of(model.site_pos[first], model.site_quat[first])
            T_second = pose_of(model.site_pos[second], model.site_quat[second])
            first = int(model.site_bodyid[first])
            second = int(model.site_bodyid[second])
        elif kind == _CONNECT:
            T_first = poses.pose(None, model.eq_data[equality, 0:3])
            T_second = poses.pose(None, model.eq_data[equality, 3:6])
        else:  # the anchor is a point of the second body; the relative pose is T_first_second
            T_first = pose_of(model.eq_data[equality, 3:6], model.eq_data[equality, 6:10])
            T_second = np.eye(4)
        name = model.equality(equality).name
        if kind == _CONNECT:
            joints.append(
                FileJoint(
                    nonempty_names([name]), names[first], names[second], tied=((T_first[:3, 3], T_second[:3, 3]),)
                )
            )
        else:
            joints.append(
                FileJoint(nonempty_names([name]), names[first], names[second], T_first @ poses.inverse(T_second))
            )
    return joints


def read_couplings(model: mujoco.MjModel) -> dict[str, tuple[dict[str, float], float]]:
    """Return {name: ({joint: ratio}, sum in m or rad)} of the constraints of one tendon, or of two joints."""
    couplings: dict[str, tuple[dict[str, float], float]] = {}
    for equality in range(model.neq):
        if not _is_active(model, equality):
            continue
        if int(model.eq_type[equality]) == _TENDON and model.eq_obj2id[equality] < 0:
            tendon = int(model.eq_obj1id[equality])
            ratios: dict[str, float] = {}
            for wrap in tendon_parts(model, tendon):
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
