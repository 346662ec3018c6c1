"""The forces of an MJCF at rest: those of its actuators at a keyframe, and those that hold the robot there.

At rest, actuators and loops balance the weight: columns @ forces + loops @ tensions = weight, with one row for each
coordinate of velocity. What they leave, in the least-squares sense, is unbalanced.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from twin.exchange.audit.poses import Array


@dataclass(frozen=True)
class Balance:
    """The forces at a keyframe at rest.

    Attributes:
        forces: forces (nu,) of the actuators in N or N m.
        holding: the smallest ones (nu,) of position servos that hold the robot, with closed loops.
        remaining: largest effort of a coordinate in N or N m that `forces` and loops leave unbalanced.
        least_remaining: the same for `holding`.
        weight: largest effort of a coordinate in N or N m due to the weight.
    """

    forces: Array
    holding: Array
    remaining: float
    least_remaining: float
    weight: float


def holding_forces(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """Return the forces (nu,) in N or N m with which the actuators hold the robot at rest, with closed loops.

    The forces of the actuators and of the equality constraints balance gravity, in the least-squares sense. Loops hold
    what they can: the efforts are the smallest ones.
    """
    columns, loops, gravity = _static_efforts(model, data)
    forces, *_ = np.linalg.lstsq(np.hstack([columns, loops]), gravity, rcond=None)
    return forces[: model.nu]


def _static_efforts(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[Array, Array, Array]:
    """Return what acts at rest: efforts (nv, nu) by actuator, those (nv, k) by loop constraint, and weight (nv,)."""
    columns = np.zeros((model.nv, model.nu))
    moments = data.actuator_moment.ravel()  # a sparse matrix, compressed by rows: one row for each actuator
    for actuator in range(model.nu):
        first = int(data.moment_rowadr[actuator])
        for entry in range(first, first + int(data.moment_rownnz[actuator])):
            columns[int(data.moment_colind[entry]), actuator] = moments[entry]
    loop_rows = np.flatnonzero(data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY)
    loops = np.zeros((model.nv, len(loop_rows)))
    for column, constraint in enumerate(loop_rows):
        efforts = np.zeros(model.nv)
        unit_force = np.zeros(data.nefc)
        unit_force[constraint] = 1.0
        mujoco.mj_mulJacTVec(model, data, efforts, unit_force)
        loops[:, column] = efforts
    return columns, loops, data.qfrc_bias - data.qfrc_passive


def balance_at_keyframe(model: mujoco.MjModel) -> Balance | None:
    """Return the forces at the first keyframe; None without a keyframe."""
    if not model.nkey:
        return None
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_fwdVelocity(model, data)
    mujoco.mj_fwdActuation(model, data)
    columns, loops, gravity = _static_efforts(model, data)
    forces = data.actuator_force.copy()
    is_servo = model.actuator_biastype == int(mujoco.mjtBias.mjBIAS_AFFINE)
    pulled, *_ = np.linalg.lstsq(np.hstack([columns * is_servo, loops]), gravity, rcond=None)
    holding = pulled[: model.nu] * is_servo
    remaining = _unbalanced(gravity - columns @ forces, loops)
    least_remaining = _unbalanced(gravity - columns @ holding, loops)
    weight = float(np.abs(gravity).max(initial=0.0))
    return Balance(forces, holding, remaining, least_remaining, weight)


def _unbalanced(efforts: Array, loops: Array) -> float:
    """Return the largest of the efforts (nv,) in N or N m that the loops (nv, k) cannot carry."""
    carried, *_ = np.linalg.lstsq(loops, efforts, rcond=None)
    return float(np.abs(efforts - loops @ carried).max(initial=0.0))
