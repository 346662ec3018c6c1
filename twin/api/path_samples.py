"""The values that are proved along a path, at sampled times: of the plan, and of the reference model."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.proof.motion import value_groups as groups

if TYPE_CHECKING:
    from twin.planning.trajectory import Trajectory
    from twin.proof.motion.path import TimedPath
    from twin.reference import ReferenceModel

MOST_SAMPLES = 1000
"""Largest number of samples at which the reference model is solved."""


@dataclass(frozen=True)
class SampledPath:
    """Values at times.

    An instant that two phases share belongs to both, as in the proof: the smaller limit of the tool's speed counts,
    and the larger distance from an RCM. (The plan is at rest there.)

    Attributes:
        t: (k,) times in s.
        values: {(group, name) of a claim: values (k,), NaN where there is none}, in the unit of the claim: m, rad, m/s
            or rad/s; speeds of the tool are divided by their limits, determinants by the one at the start. A loop gap
            is the largest in m or rad.
    """

    t: Array
    values: Mapping[tuple[str, str], Array]


def sampled(model: ReferenceModel, trajectory: Trajectory, path: TimedPath, most: int = MOST_SAMPLES) -> SampledPath:
    """Return the values of a trajectory at its samples, or at at most `most` of them.

    The bodies are those of the reference model at the planned joint values: this shares no code with the proof.
    """
    count = len(trajectory.t)
    stride = max(1, math.ceil(count / most))
    last = count - 1
    # the end of a motion is where limits are often reached, and a stride may step over it
    rows = np.unique(np.append(np.arange(0, count, stride), last))
    values = _planned(model, trajectory, path, rows)
    values |= _of_model(model, trajectory, path, rows)
    return SampledPath(trajectory.t[rows], values)


def _planned(
    model: ReferenceModel, trajectory: Trajectory, path: TimedPath, rows: np.ndarray
) -> dict[tuple[str, str], Array]:
    """Return the values that the samples of the plan contain."""
    mechanism = model.mechanism
    q = trajectory.q[rows]
    qd = trajectory.qd[rows]
    values = {}
    for j, joint in enumerate(mechanism.active):
        if joint.limits is not None:
            low, high = joint.limits
            values[groups.JOINT_LIMIT, joint.name] = np.minimum(q[:, j] - low, high - q[:, j])
        values[groups.JOINT_SPEED, joint.name] = np.abs(qd[:, j])
    positions = mechanism.motors(q)
    speeds = mechanism.motors(qd)
    actuators = {actuator.name: actuator for actuator in mechanism.actuators}
    for i, motor in enumerate(mechanism.motor_names):
        if motor not in actuators:  # the motor is its joint, whose values are above
            continue
        limits = actuators[motor].limits
        if limits is not None:
            low, high = limits
            values[groups.MOTOR_LIMIT, motor] = np.minimum(positions[:, i] - low, high - positions[:, i])
        values[groups.MOTOR_SPEED, motor] = np.abs(speeds[:, i])
    for gap in path.gaps:
        values[groups.GAP, gap.name] = np.abs(q[:, gap.first] - q[:, gap.second])
    tip_limit = np.full(len(rows), np.inf)
    rotation_limit = np.full(len(rows), np.inf)
    for span, phase in zip(trajectory.phases, path.phases, strict=True):
        is_of_phase = (rows >= span.start) & (rows <= span.stop)
        tip_limit[is_of_phase] = np.minimum(tip_limit[is_of_phase], phase.tip_speed)
        rotation_limit[is_of_phase] = np.minimum(rotation_limit[is_of_phase], phase.rotation_speed)
    tip_speed = np.linalg.norm(trajectory.tip_velocity[rows], axis=1)
    rotation_speed = np.linalg.norm(trajectory.angular_velocity[rows], axis=1)
    values[groups.TOOL_SPEED, groups.TIP] = tip_speed / tip_limit
    values[groups.TOOL_SPEED, groups.ROTATION] = rotation_speed / rotation_limit
    return values


def _of_model(
    model: ReferenceModel, trajectory: Trajectory, path: TimedPath, rows: np.ndarray
) -> dict[tuple[str, str], Array]:
    """Return the values of the mechanism, driven by the joint values of the plan."""
    mechanism = model.mechanism
    run = model.run(trajectory.q[rows])
    links = model.link_poses(run.x)
    values = {}
    for joint in mechanism.limited:
        values[groups.PASSIVE_LIMIT, joint.name] = -joint.beyond(links[joint.parent], links[joint.child])
    Ts = run.Ts_base_tool @ path.T_tool_frame
    for enforced, name in ((True, groups.ENFORCED), (False, groups.MONITORED)):
        distance = np.full(len(rows), np.nan)
        for span, phase in zip(trajectory.phases, path.phases, strict=True):
            if phase.rcm is None or phase.enforced != enforced:
                continue
            is_of_phase = (rows >= span.start) & (rows <= span.stop)
            axis = Ts[is_of_phase, :3, :3] @ path.shaft_axis
            distance_in_phase = spatial.point_to_line(phase.rcm, Ts[is_of_phase, :3, 3], axis)
            # NaN until now where no phase before had an RCM
            distance[is_of_phase] = np.fmax(distance[is_of_phase], distance_in_phase)
        values[groups.RCM, name] = distance
    tree = model.tree
    if not tree.loops.names:
        return values
    poses, J = tree.update(run.x)
    gaps, jacobian = tree.loops.evaluate(run.x, poses, J)
    values[groups.LOOP_GAP, groups.LOOPS] = np.abs(gaps).max(axis=1)
    passive = jacobian[:, :, tree.passive]
    if passive.shape[2]:
        # the product of the singular values is the determinant, also of a matrix that is not square
        singular_values = np.linalg.svd(passive, compute_uv=False)
        logs = np.log(singular_values).sum(axis=1)
        values[groups.DETERMINANT, groups.LOOPS] = np.exp(logs - logs[0])  # divided by that of the start
    return values
