"""Taking a point of any body by the hand: the active joints that bring it to the hand, the loops following."""

from __future__ import annotations

import numpy as np

from twin import spatial
from twin.errors import AssemblyError
from twin.reference.loops import LENGTH_SCALE
from twin.reference.model import ReferenceModel
from twin.reference.states import Assembly
from twin.spatial import Array

_STEPS = 3
"""Steps for one position of the hand; it comes again within milliseconds, and from where this one ended."""

_LONGEST = 0.03
"""Longest way in m that the point is led in one step."""

_DAMPING = 1e-3
"""Relative to the largest gain: a point at the end of its reach is pulled in vain, without wild joints."""


def follow(model: ReferenceModel, start: Assembly, body: str, p_body: Array, target: Array) -> Assembly:
    """Return an assembly in which a point of a body is nearer to a target, by the least motion of the active joints.

    Args:
        model: the mechanism; its hard limits are kept.
        start: where it stands.
        body: name of the body.
        p_body: the point (3,) on it, in m.
        target: where it should go, (3,) in base, in m.

    """
    tree, active = model.tree, model.mechanism.active
    number, T_joint_body = tree.body(body)
    p_joint = (T_joint_body @ np.append(p_body, 1.0))[:3]
    scale = np.array([1 / LENGTH_SCALE if j.is_angle else 1.0 for j in active])
    low, high = np.array([j.limits or (-np.inf, np.inf) for j in active]).T
    now, before = start, np.inf
    for _ in range(_STEPS):
        poses, J = tree.update(now.x[None])
        p = (poses[0, number] @ np.append(p_joint, 1.0))[:3]
        miss = np.asarray(target, float) - p
        way = float(np.linalg.norm(miss))
        if way < 1e-9 or way > 0.99 * before:  # there, or at the end of its reach
            break
        before = way
        own = J[0] * tree.moves(number)
        gain = ((own[:3] - spatial.hat(p) @ own[3:]) @ model.gains(now.x[None])[0]) * scale
        square = gain @ gain.T
        size = float(np.trace(square))
        if size < 1e-18:  # nothing moves this point, as on the axis of the first joint
            break
        step = gain.T @ np.linalg.solve(square + (_DAMPING**2 * size) * np.eye(3), miss * min(1.0, _LONGEST / way))
        try:
            now = model.solve(np.clip(now.q + scale * step, low, high), now)
        except AssemblyError:  # the loops end here: what was reached stays
            break
    return now
