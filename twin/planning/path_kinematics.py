"""What planning needs of a robot: limits of joints and motors, its inverse, and its mechanism.

`twin.api.path_kinematics` makes a `PathKinematics` from a robot with equations, `without_equations` from a mechanism
alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol as Interface

import numpy as np

from twin.core.spatial import Array
from twin.core.units import display_unit
from twin.model.mechanism import Mechanism
from twin.planning.space import Space


@dataclass(frozen=True)
class Gap:
    """Two carriages on one rail, whose distance |q[i] - q[j]| must be at least `smallest`, in m.

    Attributes:
        i, j: indices of their joints.
        smallest: smallest distance in m.
        name: names of both joints, as "q1-q2".
    """

    i: int
    j: int
    smallest: float
    name: str


class MovableMechanism(Interface):
    """Interface of a mechanism that moves along a path; a motion can start at any state (nq,) that a method returned.

    Every method raises `AssemblyError` if the mechanism cannot follow the motion.
    """

    def drawn(self) -> tuple[Array, Array]:
        """Return (state as drawn in the CAD, its driven joint values (n,))."""
        ...

    def carry(self, q: Array, start: Array) -> tuple[Array, Array]:
        """Return states (k, nq) and T_base_tool (k, 4, 4) for driven joint values q (k, n), from state `start`."""
        ...

    def follow(self, Ts: Array, directions: np.ndarray, p_tool: Array, start: Array) -> tuple[Array, Array, Array]:
        """Return states (k, nq), driven joint values (k, n) and T_base_tool (k, 4, 4) along target poses Ts (k, 4, 4).

        The tool follows the poses only in the directions whose entry in the mask `directions` (6,) is true:
        translations along x, y, z of base, then rotations about them. `p_tool` (3,) in m is the point of the tool that
        follows the positions.
        """
        ...

    def jacobians(self, state: Array, p_tool: Array) -> Array:
        """Return Jacobians (k, 6, n) of the tool point p_tool with respect to the driven joints, linear part first.

        The first is at the given state; the others are at states close to it, because the given state may be singular.
        """
        ...


@dataclass(frozen=True)
class MotorLimits:
    """The k actuators of transmissions, which have their own limits; directly driven joints are not included.

    Attributes:
        names: (k,) names of the actuators.
        rows: (k, n) matrix from joint values to motor values, in m or rad: motor values = rows @ q.
        lower, upper: (k,) limits of the motor values in m or rad; infinite without a limit.
        max_speed: (k,) limits of the motor speeds in m/s or rad/s; infinite without a limit.
        revolute: (k,) whether a motor value is in rad.
    """

    names: tuple[str, ...]
    rows: Array
    lower: Array
    upper: Array
    max_speed: Array
    revolute: tuple[bool, ...]

    def unit(self, motor: int) -> tuple[str, float]:
        """Return (display unit of a motor, its factor to SI)."""
        return display_unit(self.revolute[motor])


NO_MOTORS = MotorLimits((), np.zeros((0, 0)), np.zeros(0), np.zeros(0), np.zeros(0), ())


def motors_of(mechanism: Mechanism) -> MotorLimits:
    """Return the actuators of a mechanism's transmissions; `NO_MOTORS` if there are none."""
    by_name = {actuator.name: actuator for actuator in mechanism.actuators}
    rows = []
    names = []
    limits = []
    max_speeds = []
    revolute = []
    for row, name in enumerate(mechanism.motor_names):
        actuator = by_name.get(name)
        if actuator is None:  # a joint without a transmission, whose motor has the limits of the joint
            continue
        rows.append(row)
        names.append(actuator.name)
        limits.append(actuator.limits or (-np.inf, np.inf))
        max_speeds.append(actuator.max_speed or np.inf)
        revolute.append(actuator.is_angle)
    if not names:
        return NO_MOTORS
    # Unit joint values give the columns of the matrix from joints to motors.
    motors_of_joints = mechanism.motors(np.eye(len(mechanism.active))).T
    ranges = np.array(limits, float)
    return MotorLimits(
        names=tuple(names),
        rows=motors_of_joints[rows],
        lower=ranges[:, 0],
        upper=ranges[:, 1],
        max_speed=np.array(max_speeds),
        revolute=tuple(revolute),
    )


StateTest = Callable[[Array, Array], np.ndarray]
"""Function: T_base_tool (k, 4, 4), q (k, n) -> (k,) bool: whether each state is allowed."""


@dataclass(frozen=True)
class PathKinematics:
    """Planning data of a robot. Its functions take k poses and return k rows; unreachable poses raise no error.

    Attributes:
        joint_names: names of the n active joints, in the order of q.
        inverse: T_base_tool (k, 4, 4) -> q (k, n) in m or rad; rows without solution are NaN.
        reach: T_base_tool (k, 4, 4) -> margins (k,) in m, by limb; at least 0 where reachable.
        singularity: T_base_tool (k, 4, 4), q (k, n) -> {name: measure (k,)}; a measure is 0 at a singularity.
        singularity_alarm: absolute value below which a measure is reported, by the beginning of the measure's name.
        lower, upper: (n,) hard limits in m or rad, never exceeded.
        soft_lower, soft_upper: (n,) limits in m or rad; exceeding them causes a warning.
        max_speed, max_acceleration: (n,) limits in m or rad per s and per s2.
        max_jerk: (n,) limits in m or rad per s3, infinite for joints without a jerk limit; None: no joint has one.
        branch: T_base_tool (k, 4, 4), q (k, n) -> labels (k,) of the working mode; None: the mode is not checked.
        gaps: pairs of carriages on a common rail.
        motors: actuators of transmissions.
        revolute: (n,) whether each joint is in rad; left out: all joints are lengths.
        unsolved_reason: T_base_tool (4, 4) -> why the equations have no solution there, or ""; None: not available.
        mechanism: the mechanism as it moves, for phases whose path it determines; None: not available.
        space: (scene or "", clearance in m, additional test) -> joint space in which the path of a free phase is
            searched; None: not available.
        auxiliary: {name: value as drawn, in m or rad} of the auxiliary joints; `inverse` returns these values.
        can_assume: T_base_tool (k, 4, 4) -> whether the robot can certainly assume all these poses; None: always true.
            If false (fewer than six degrees of freedom, or no equations), the mechanism determines the path; see
            `mechanism_follower`.
        passive: T_base_tool (k, 4, 4), q (k, n) -> {passive joint: (margin (k,) to its limits, whether in rad)}; a
            margin is NaN where the mechanism is not at this pose. None: limits of passive joints are not checked.
    """

    joint_names: tuple[str, ...]
    inverse: Callable[[Array], Array]
    reach: Callable[[Array], Mapping[str, Array]]
    singularity: Callable[[Array, Array], Mapping[str, Array]]
    singularity_alarm: Mapping[str, float]
    lower: Array
    upper: Array
    soft_lower: Array
    soft_upper: Array
    max_speed: Array
    max_acceleration: Array
    max_jerk: Array | None = None
    branch: Callable[[Array, Array], np.ndarray] | None = None
    gaps: tuple[Gap, ...] = ()
    motors: MotorLimits = NO_MOTORS
    revolute: tuple[bool, ...] = ()
    unsolved_reason: Callable[[Array], str] | None = None
    mechanism: MovableMechanism | None = None
    space: Callable[[str, float, StateTest], Space] | None = None
    auxiliary: Mapping[str, float] = field(default_factory=dict)
    can_assume: Callable[[Array], bool] | None = None
    passive: Callable[[Array, Array], Mapping[str, tuple[Array, bool]]] | None = None

    def __post_init__(self) -> None:
        if not self.revolute:
            object.__setattr__(self, "revolute", (False,) * len(self.joint_names))

    def unit(self, joint: int) -> tuple[str, float]:
        """Return (display unit of a joint, its factor to SI)."""
        return display_unit(self.revolute[joint])

    def alarm(self, measure: str) -> float:
        """Return the alarm value of a singularity measure; 0 if none is set."""
        alarm = 0.0
        longest = -1
        for prefix, value in self.singularity_alarm.items():
            # of several that fit, the longest one is the most special
            if measure.startswith(prefix) and len(prefix) > longest:
                alarm = value
                longest = len(prefix)
        return alarm


def without_equations(
    mechanism: Mechanism,
    movable: MovableMechanism,
    gaps: Sequence[tuple[str, str, float]],
    space: Callable[[str, float, StateTest], Space] | None = None,
) -> PathKinematics:
    """Return the planning data of a robot without equations.

    Args:
        mechanism: its joints and their limits.
        movable: the same mechanism, which moves along a path.
        gaps: (joint, joint, smallest distance in m) of carriages on a common rail.
        space: see `PathKinematics`.
    """
    active = mechanism.active
    hard = mechanism.limits
    order = []
    soft_ranges = []
    max_speeds = []
    max_accelerations = []
    max_jerks = []
    revolute = []
    for joint in active:
        order.append(joint.name)
        soft_ranges.append(joint.soft_limits or joint.limits or (-np.inf, np.inf))
        max_speeds.append(joint.max_speed or np.inf)
        max_accelerations.append(joint.max_acceleration or np.inf)
        max_jerks.append(joint.max_jerk or np.inf)
        revolute.append(joint.is_angle)
    soft = np.array(soft_ranges).reshape(-1, 2)
    rail_gaps = []
    for a, b, smallest in gaps:
        rail_gaps.append(Gap(order.index(a), order.index(b), smallest, f"{a}-{b}"))
    auxiliary = {}
    for _, name, _, drawn_value in mechanism.extra_joints(()):
        auxiliary[name] = drawn_value
    return PathKinematics(
        joint_names=tuple(order),
        # Without equations, no pose has a known solution: phases follow the mechanism instead, see `can_assume`.
        inverse=lambda Ts: np.full((len(Ts), len(order)), np.nan),
        reach=lambda Ts: {},
        singularity=lambda Ts, q: {},
        singularity_alarm={},
        lower=hard[:, 0],
        upper=hard[:, 1],
        soft_lower=soft[:, 0],
        soft_upper=soft[:, 1],
        max_speed=np.array(max_speeds),
        max_acceleration=np.array(max_accelerations),
        max_jerk=np.array(max_jerks),
        gaps=tuple(rail_gaps),
        motors=motors_of(mechanism),
        revolute=tuple(revolute),
        mechanism=movable,
        space=space,
        auxiliary=auxiliary,
        can_assume=lambda Ts: False,
    )
