"""Compute, in a separate process, the tool positions that a robot can reach with the present tool orientation.

A process of low priority does not slow down dragging; a thread would, because threads share the interpreter.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from twin.analysis import measure
from twin.core.errors import KinematicsError
from twin.core.jobs import Stream
from twin.core.spatial import Array
from twin.kinematics.closed_loops import LoopSolver
from twin.kinematics.closed_loops.bounds import Bound
from twin.kinematics.closed_loops.passive_limits import PassiveCheck, passive_limits
from twin.model.mechanism import Mechanism
from twin.ui.session.movable_robot import MovableRobot

if TYPE_CHECKING:
    from twin.kinematics import Kinematics

_NEAR_POSES = 1000
"""Number of poses near the present one that show whether the tool can move in every direction."""

_NEAR_FRACTION = 0.01
"""Edge length of the box of these poses as a fraction of that of the searched box."""

_SURFACE_SHARE = 0.01
"""Share of reachable poses in this box below which the reachable ones form a surface, not a volume."""

POSES_PER_CHECK = 20_000
"""Number of poses between two checks for cancellation; this number is computed in less than half a second."""


@dataclass(frozen=True, eq=False)
class WorkspaceJob:
    """Arguments of the computation of a workspace.

    Attributes:
        robot, variants, parameters: arguments of `twin.load`.
        limits: limits (n, 2) of the active joints, in rad or m; infinite without a limit.
        T_base_tool: present tool pose (4, 4); all poses have its orientation, and its position is the centre of the
            searched box.
        reach: half the edge length of the searched box in m.
        count: total number of poses.
        bounds: limits of joints, of motors, and of the distances between two carriages on a rail.
        mechanism: the mechanism, without meshes, whose passive joints have limits; None: these are not checked.
    """

    robot: str
    variants: dict[str, str] | str | None
    parameters: dict[str, float]
    limits: Array
    T_base_tool: Array
    reach: float
    count: int = 1_000_000
    bounds: tuple[Bound, ...] = ()
    mechanism: Mechanism | None = None


def job_of(movable: MovableRobot, source: str, reach: float, count: int) -> WorkspaceJob:
    """Return the job for the present state of a robot that has equations; the other arguments are as in the job.

    Args:
        movable: the robot.
        source: first argument of `twin.load` for it.
        reach: half the edge length of the searched box in m.
        count: number of poses.
    """
    assert movable.kin is not None
    # the process loads the robot anew: its files know neither changed parameters nor the trocars of the protocol
    parameters = {}
    for name, value in movable.kin.parameters.items():
        if name in movable.parameters or name.startswith("trocar_"):
            parameters[name] = float(value)
    return WorkspaceJob(
        robot=source,
        variants=dict(movable.kin.variants),
        parameters=parameters,
        limits=movable.mechanism.limits,
        # a copy: the robot may move while the process computes
        T_base_tool=movable.assembly.T_base_tool.copy(),
        reach=reach,
        count=count,
        bounds=movable.solver.bounds,
        mechanism=_without_meshes(movable.mechanism),
    )


@dataclass(frozen=True, eq=False)
class WorkspaceChunk:
    """Results of a job that are new since the last call of `Cloud.poll`.

    Attributes:
        points: reachable tool positions (m, 3), float32, in m in the base frame.
        condition: condition numbers (m,), float32, at these positions; infinite at a singularity.
        evaluated: number of poses evaluated so far, reachable or not; 0 after an error.
        count: total number of poses; 0 after an error.
        error: why the job ended early or found no position; "" without an error.
    """

    points: np.ndarray
    condition: np.ndarray
    evaluated: int
    count: int
    error: str = ""


def poses(job: WorkspaceJob, first: int, last: int) -> Array:
    """Return the poses (last - first, 4, 4) of a job with indices `first` to `last` - 1, in the order of evaluation.

    Pose 0 is the present pose. The positions are a low-discrepancy sequence (additive recurrence): for every n, the
    first n poses cover the searched box evenly.
    """
    i = np.arange(first, last)[:, None]
    # one generator for each axis: the powers of the inverse root (Roberts, The Unreasonable Effectiveness of
    # Quasirandom Sequences, 2018)
    fractions = (0.5 + i / measure.ROOT ** np.arange(1, 4)) % 1
    Ts = np.tile(job.T_base_tool, (last - first, 1, 1))
    Ts[:, :3, 3] += job.reach * (2 * fractions - 1)
    return Ts


def evaluate(job: WorkspaceJob) -> Iterator[WorkspaceChunk]:
    """Yield the reachable positions of a job in chunks, evaluated with the same kernel as `twin workspace`.

    Raises:
        TwinError: the robot is unknown or has no closed-form inverse, the job does not match the robot, or no pose is
            reachable.
    """
    from twin.api import load

    kin = load(job.robot, variants=job.variants, parameters=job.parameters).kinematics()
    _check(kin, job)
    passive = _passive(kin, job)
    bounds = measure.shared(job.bounds)
    # a column of the kernel's input is a pose by rows; CasADi reshapes by columns
    kernel = measure.kernel(kin, job.limits, lambda T: ca.reshape(T, 4, 4).T, bounds=bounds, passive=passive, size=16)
    reached = 0
    for first in range(0, job.count, POSES_PER_CHECK):
        last = min(first + POSES_PER_CHECK, job.count)
        Ts = poses(job, first, last)
        inside, inverse, *_ = kernel(Ts.reshape(-1, 16).T)
        is_reached = inside[0] > 0
        reached += int(is_reached.sum())
        if last == job.count and not reached:
            solved = np.isfinite(kin.inverse_many(Ts)[:, 0]).any()
            why = "within the joint limits" if solved else "reachable"
            raise KinematicsError(f"{kin.formula.name}: none of {job.count} positions is {why} with this orientation.")
        with np.errstate(divide="ignore"):
            condition = 1 / inverse[0, is_reached]
        yield WorkspaceChunk(Ts[is_reached, :3, 3].astype(np.float32), condition.astype(np.float32), last, job.count)


def _without_meshes(mechanism: Mechanism) -> Mechanism:
    """Return a mechanism without meshes, which is fast to send to another process."""
    bodies = [replace(body, meshes=()) for body in mechanism.bodies]
    return replace(mechanism, bodies=tuple(bodies))


def _passive(kin: Kinematics, job: WorkspaceJob) -> PassiveCheck | None:
    """Return the check of limits of passive joints; None: none is checked."""
    if job.mechanism is None or not passive_limits(job.mechanism):
        return None
    check = PassiveCheck(LoopSolver(job.mechanism))
    # equations of another assembly mode have other passive joints
    if not measure.agree(kin, check, job.T_base_tool):
        return None
    return check


def _check(kin: Kinematics, job: WorkspaceJob) -> None:
    """Check that the equations can evaluate a job.

    Raises:
        KinematicsError: they cannot; the message has the reason.
    """
    name = kin.formula.name
    n = len(kin.joints)
    if not kin.closed_inverse:
        raise KinematicsError(
            f"{name}: its equations have no closed-form inverse; a numerical solution for each pose takes too long."
        )
    if np.shape(job.limits) != (n, 2) or job.count < 1:
        raise KinematicsError(
            f"{name}: the shape of the limits is {np.shape(job.limits)} (required ({n}, 2)), the number of poses "
            f"{job.count} (minimum 1)."
        )
    if n < 6:
        near_poses = poses(replace(job, reach=_NEAR_FRACTION * job.reach), 0, _NEAR_POSES)
        reachable = np.isfinite(kin.inverse_many(near_poses)[:, 0])
        # the reachable poses form a surface, as thick as the equations' tolerance
        if reachable[0] and reachable.mean() < _SURFACE_SHARE:
            raise KinematicsError(
                f"{name}: its {n} joints cannot move the tool in every direction at constant orientation."
            )


class Cloud:
    """Computation of one workspace at a time in a separate process; see `twin.core.jobs.Stream`."""

    def __init__(self) -> None:
        self._stream = Stream(evaluate)
        self.start = self._stream.start
        self.cancel = self._stream.cancel
        self.close = self._stream.close

    def poll(self) -> WorkspaceChunk | None:
        """Return the new results of the present job; None without new results."""
        new, end = self._stream.poll()
        if not new and not end:
            return None
        # an error may end the job before its first chunk
        point_parts = [np.zeros((0, 3), np.float32)]
        condition_parts = [np.zeros(0, np.float32)]
        for chunk in new:
            point_parts.append(chunk.points)
            condition_parts.append(chunk.condition)
        points = np.concatenate(point_parts)
        condition = np.concatenate(condition_parts)
        if end:
            return WorkspaceChunk(points, condition, 0, 0, end)
        return WorkspaceChunk(points, condition, new[-1].evaluated, new[-1].count)
