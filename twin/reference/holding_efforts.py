"""Static efforts of the active joints that hold the mechanism's weight, with closed loops."""

from __future__ import annotations

import numpy as np

from twin.core.spatial import Array
from twin.model.mechanism import Mechanism
from twin.reference.model import ReferenceModel
from twin.reference.states import Assembly

_STEP = 1e-5
"""Step in m or rad of the central difference; by virtual work, the effort is the slope of the potential energy."""


def holding_efforts(model: ReferenceModel, state: Assembly) -> dict[str, float]:
    """Return {active joint: effort in N or N m}: the efforts that hold the mechanism at rest in a state.

    Gravity is that of the mechanism. Bodies without inertia are massless.

    Raises:
        AssemblyError: the loops cannot be closed at a small step from the state.
    """
    efforts = {}
    mechanism = model.mechanism
    for i, joint in enumerate(mechanism.active):
        step = _STEP * (np.arange(len(state.q)) == i)
        ahead = model.solve(state.q + step, state)
        behind = model.solve(state.q - step, state)
        rise = _energy(mechanism, ahead.link_poses) - _energy(mechanism, behind.link_poses)
        efforts[joint.name] = rise / (2 * _STEP)
    return efforts


def _energy(mechanism: Mechanism, link_poses: dict[str, Array]) -> float:
    """Return the potential energy in J of the bodies that have inertia."""
    energy = 0.0
    for body in mechanism.bodies:
        inertia = body.inertia
        if inertia is None:
            continue
        T = link_poses[body.name]
        p_base_com = T[:3, :3] @ inertia.p_body_com + T[:3, 3]
        energy -= inertia.mass * float(np.dot(mechanism.gravity, p_base_com))
    return energy
