"""What planning asks of a robot: limits, a space for paths around obstacles, and the functions of its equations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial
from importlib import import_module
from typing import TYPE_CHECKING, Literal

import numpy as np

from twin.core.errors import AssemblyError, TwinError
from twin.core.spatial import Array
from twin.planning.path_kinematics import PathKinematics, StateTest, without_equations
from twin.reference.joint_space import JointSpace

if TYPE_CHECKING:
    from twin.kinematics import Kinematics
    from twin.kinematics.closed_loops.passive_limits import PassiveCheck
    from twin.model.mechanism import Mechanism
    from twin.reference import ReferenceModel
    from twin.reference.follower import Follower

_TRIED_LENGTH = 0.02
"""Step of a prismatic joint in m to states at which forward equations are tried."""

_TRIED_ANGLE = 0.3
"""The same step of a revolute joint, in rad."""

_TRIED_ERROR = 1e-6
"""Largest difference of tool poses, in m or as an entry of a rotation, with which these equations count as right."""

_FREEDOMS_OF_A_POSE = 6


def of_mechanism(
    name: str,
    mechanism: Mechanism,
    follower: Follower,
    gaps: Sequence[tuple[str, str, float]],
    passive_check: Callable[[], PassiveCheck],
) -> PathKinematics:
    """Return the planning data of a robot from its mechanism alone.

    Args:
        name: name of the robot.
        mechanism: its mechanism.
        follower: moves the mechanism along paths.
        gaps: (lower joint, upper joint, minimum difference upper - lower in m) of joints on one rail.
        passive_check: returns the check of the limits of passive joints; called when poses are checked.
    """

    @cache  # shapes of bodies take seconds to read, and each phase of a protocol asks for them
    def space_around_obstacles(scene: str, clearance: float) -> JointSpace:
        around = None
        if scene:
            # by name: only a path around other robots reads a scene
            obstacles_in_base = import_module("twin.api.scene_obstacles").obstacles_in_base
            around = partial(obstacles_in_base, scene, name)
        return JointSpace(lambda: follower.model, clearance, around=around)

    def space(scene: str, clearance: float, keep: StateTest) -> JointSpace:
        return space_around_obstacles(scene, clearance).keeping(keep)

    def passive_margins(Ts: Array, q: Array) -> dict[str, tuple[Array, bool]]:
        try:
            check = passive_check()
        except AssemblyError:  # the loops do not close as drawn, which is reported elsewhere
            return {}
        if not check.limits:
            return {}
        return check.margins(q, Ts)

    by_mechanism = without_equations(mechanism, follower, gaps, space)
    return replace(by_mechanism, passive=passive_margins)


def with_equations(
    by_mechanism: PathKinematics,
    name: str,
    kin: Kinematics,
    follower: Follower,
    inverse_by: Literal["equations", "points"],
) -> PathKinematics:
    """Return the planning data of a mechanism with inverse, margins and measures of the equations of the same robot.

    Equations whose inverse is an iteration, and whose forward does not give the poses of the mechanism, are left out.

    Args:
        by_mechanism: data of the mechanism; see `of_mechanism`.
        name: name of the robot, for messages.
        kin: the compiled equations.
        follower: moves the mechanism along paths.
        inverse_by: what gives the joint values of poses: "equations", or "points", the published optimisation.

    Raises:
        TwinError: the driven joints of equations and mechanism differ in name or order.
    """
    order = by_mechanism.joint_names
    if order != kin.joints:
        raise TwinError(
            f"{name}: the driven joints are {', '.join(order)} in the description, but "
            f"{', '.join(kin.joints)} in the equations; use the same names in the same order"
        )
    if not kin.closed_inverse and not _forward_holds(kin, follower.model):
        return by_mechanism  # an inverse by iteration of wrong equations would try every pose in vain
    inverse = kin.inverse_many
    if inverse_by == "points":
        from twin.kinematics.point_search import point_solver

        inverse = point_solver(kin).inverse_many
    auxiliary = {}
    for _, joint_name, _, drawn_value in kin.extra_joints:
        auxiliary[joint_name] = drawn_value
    alarms = {}
    for measure in kin.formula.measures:
        alarms[measure.name] = measure.alarm
    return replace(
        by_mechanism,
        inverse=inverse,
        reach=lambda Ts: kin.reach(Ts=Ts),
        singularity=lambda Ts, q: kin.singularity(Ts=Ts, qs=q),
        singularity_alarm=alarms,
        branch=lambda Ts, q: kin.branch(Ts=Ts, qs=q),
        unsolved_reason=kin.why,
        auxiliary=auxiliary,
        # six degrees of freedom of the mechanism are a proof as well, where the equations give none
        can_assume=lambda Ts: kin.takes(Ts) or follower.model.freedoms == _FREEDOMS_OF_A_POSE,
    )


def _forward_holds(kin: Kinematics, model: ReferenceModel) -> bool:
    """Return whether the forward equations give the mechanism's tool poses at home and with each joint moved."""
    home = model.home().q
    low, high = model.mechanism.limits.T
    is_angle = [joint.is_angle for joint in model.mechanism.active]
    sizes = np.where(is_angle, _TRIED_ANGLE, _TRIED_LENGTH)
    steps = np.diag(sizes)  # one joint in each row
    # away from an upper limit that the step would exceed
    displaced = np.where(home + steps <= high, home + steps, home - steps)
    states = np.vstack([home, np.clip(displaced, low, high)])
    try:
        run = model.run(states)
    except AssemblyError:  # the plan will name the loop that opens
        return True
    Ts = kin.forward_many(run.q)
    if not np.isfinite(Ts).any():
        return False
    errors = np.abs(Ts - run.Ts_base_tool)
    largest_error = np.nanmax(errors, initial=0.0)
    return bool(largest_error <= _TRIED_ERROR)
