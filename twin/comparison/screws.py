"""Joint lines of equations: the forward function of a chain determines them, without a table or a drawing.

If one joint of a chain moves by delta from the drawn state, the tool moves by exp(S delta), whatever the other joints
are. Its logarithm is the joint's screw S. All screws together give poses at every state, which are compared with the
equations: equations that are no chain of hinges and slides (a parallel robot, a gear) are recognised by this.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from twin.comparison.side import Axis, JointGroup, RobotSide
from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.spatial import Array

Forward = Callable[[Array], Array]
"""Function from q (k, n) in rad and m to T_base_tool (k, 4, 4); NaN rows where there is no pose."""

TOOL = "tool"
"""Name of the tool frame of equations."""

_PROBE_ANGLE = 1.0
"""Angle in rad by which a hinge is moved to find its screw."""

_PROBE_LENGTH = 0.1
"""Distance in m by which a slide is moved to find its direction."""

_CHAIN_TOLERANCE = 1e-8
"""Largest difference in m, or as an entry of a rotation, with which equations are a chain."""

_STATE_COUNT = 64
"""Number of states at which the chain is compared with the equations."""

_SEED = 7
"""Seed of these states."""


class NotAChainError(TwinError):
    """Equations whose joints are no hinges and slides one after another."""


def chain_of(
    forward: Forward,
    names: Sequence[str],
    kinds: Sequence[str],
    label: str,
    name: str,
    only: Sequence[str] = (),
) -> RobotSide:
    """Return the side of the equations of a chain.

    Args:
        forward: the equations.
        names: names of the joints in the order of q.
        kinds: "revolute" or "prismatic" for each.
        label: how the user named the side.
        name: name of the robot.
        only: joints that move; all others are held at zero. (): all joints.

    Raises:
        NotAChainError: the poses of the equations are not those of a chain of hinges and slides.
    """
    moving: list[int] = []
    for i, joint in enumerate(names):
        if not only or joint in only:
            moving.append(i)
    drawn = np.zeros(len(names))
    T_drawn = forward(drawn[None])[0]
    if not np.isfinite(T_drawn).all():
        raise NotAChainError(f"{label}: the equations have no pose with all joints at zero")
    axes = []
    groups = [JointGroup(("base",))]
    for place, i in enumerate(moving):
        point, direction = _joint_line(forward, T_drawn, drawn, i, kinds[i], names[i], label)
        axes.append(Axis(names[i], kinds[i], place, place + 1, point, direction, 0.0))
        groups.append(JointGroup((f"link{place + 1}",)))
    side = RobotSide(
        label=label,
        name=name,
        axes=tuple(axes),
        groups=tuple(groups),
        frames={TOOL: (len(moving), T_drawn)},
        tool=TOOL,
        driven_joints=tuple([names[i] for i in moving]),
    )
    _require_same_poses(forward, side, moving, len(names))
    return side


def _joint_line(
    forward: Forward, T_drawn: Array, drawn: Array, i: int, kind: str, name: str, label: str
) -> tuple[Array, Array]:
    """Return (point, direction) (3,) of the line of joint i at the drawn state."""
    size = _PROBE_LENGTH if kind == "prismatic" else _PROBE_ANGLE
    # a large motion, because the logarithm of a small one would lose digits
    q = drawn.copy()
    q[i] += size
    T_moved = forward(q[None])[0]
    if not np.isfinite(T_moved).all():
        raise NotAChainError(f"{label}: the equations have no pose with only '{name}' moved")
    motion = T_moved @ spatial.inverse(T_drawn)
    turn = spatial.log_so3(motion[:3, :3])
    angle = float(np.linalg.norm(turn))
    if kind == "prismatic":
        distance = float(np.linalg.norm(motion[:3, 3]))
        if angle > _CHAIN_TOLERANCE or abs(distance - size) > _CHAIN_TOLERANCE:
            raise NotAChainError(f"{label}: joint '{name}' of the equations does not move the tool as a slide does")
        return np.zeros(3), motion[:3, 3] / distance
    if abs(angle - size) > _CHAIN_TOLERANCE:
        raise NotAChainError(f"{label}: joint '{name}' of the equations does not turn the tool by its own angle")
    direction = turn / angle
    # the point of the line nearest to the origin: (I - R) point = shift, without the part along the line
    point = np.linalg.lstsq(np.eye(3) - motion[:3, :3], motion[:3, 3], rcond=1e-9)[0]
    point = point - direction * (direction @ point)
    if abs(float(direction @ motion[:3, 3])) > _CHAIN_TOLERANCE:
        raise NotAChainError(f"{label}: joint '{name}' of the equations turns and slides the tool")
    return point, direction


def _require_same_poses(forward: Forward, side: RobotSide, moving: Sequence[int], count: int) -> None:
    """Require that the joint lines give the poses of the equations at random states of the `moving` of `count` joints.

    Raises:
        NotAChainError: they do not, or the equations have no poses there.
    """
    rng = np.random.default_rng(_SEED)
    displacements = np.zeros((_STATE_COUNT, len(moving)))
    for k, axis in enumerate(side.axes):
        half = np.pi if axis.is_angle else _PROBE_LENGTH
        displacements[:, k] = rng.uniform(-half, half, _STATE_COUNT)
    q = np.zeros((_STATE_COUNT, count))
    q[:, list(moving)] = displacements
    stated = forward(q)
    has_pose = np.isfinite(stated).all(axis=(1, 2))
    if not has_pose.any():
        raise NotAChainError(f"{side.label}: the equations have no poses at {_STATE_COUNT} states about zero")
    group, T_tool = side.frames[side.tool]
    poses = side.group_motions(displacements)[:, group] @ T_tool
    gap = float(np.abs(poses[has_pose] - stated[has_pose]).max())
    if gap > _CHAIN_TOLERANCE:
        raise NotAChainError(
            f"{side.label}: the equations are no chain of hinges and slides: their poses differ from those of the "
            f"joint lines by up to {gap:.3g} (m, or an entry of a rotation)"
        )
