"""Find the joint values at which an imported mechanism starts: those of its file, moved into the joint limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from twin.core import spatial
from twin.core.findings import Finding
from twin.core.spatial import Array
from twin.core.units import DEG, MM, ROUNDING
from twin.exchange.read.imported_robot import Imported, motion, note, warning
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.reference import ReferenceModel
from twin.reference.assembly import is_closed
from twin.reference.newton import minimise
from twin.reference.singular_departure import limit_excess
from twin.reference.states import Assembly

_LIMIT_MARGIN = 1e-3
"""Distance from a limit, relative to the range of the joint (at most 1 rad or m), to which a joint is moved if loops
bind it. Without it, the steps between limits and loops approach a state at a limit, but do not reach it."""

_MAX_PROJECTIONS = 100
"""Maximum number of steps between limits and loops."""

_LIMIT_ROUNDING = 1e-9
"""Sum in rad and m by which joints may exceed their limits by rounding."""


def start_within_limits(imported: Imported) -> tuple[Mechanism, list[Finding]]:
    """Return the mechanism with all joints of the tree within their limits in its rest pose, and findings.

    If a joint of the file's rest pose is outside its limits, the rest pose gets the joint values of the first key frame
    that is within all limits; without such a key frame, each joint that is outside moves to its nearest limit. The
    loops may then be open.
    """
    mechanism = imported.mechanism
    limited: list[Joint] = []
    outside: list[Joint] = []
    file_values: dict[str, float] = {}
    for joint in mechanism.tree:
        # A ball joint has a cone and no single coordinate.
        if joint.limits is None or len(joint.free_axes) != 1:
            continue
        q = float(joint.coordinate(mechanism.rest[joint.parent], mechanism.rest[joint.child]))
        limited.append(joint)
        file_values[joint.name] = q
        if not _within(joint, q):
            outside.append(joint)
    if not outside:
        return mechanism, []
    first = outside[0]
    first_value = value_text(first, file_values[first.name])
    where = f"joint '{first.name}' would be at {first_value}, outside its limits {_limits_text(first)}"
    if len(outside) > 1:
        where += f", and {len(outside) - 1} others outside theirs"
    for key, values in imported.keys.items():
        if _all_within(limited, {**file_values, **values}):
            text = f"home is key frame '{key}': in the rest pose of the file {where}."
            return replace(mechanism, rest=rest_at_values(mechanism, values)), [note("home", text, key)]
    clipped: dict[str, float] = {}
    for joint in outside:
        low, high = _limits(joint)
        clipped[joint.name] = float(np.clip(file_values[joint.name], low, high))
    rest = rest_at_values(mechanism, clipped)
    if imported.posed:
        text = f"home has each joint at its nearest limit: in the rest pose of the file {where}."
        return replace(mechanism, rest=rest), [warning("home", text, first.name)]
    text = f"home has each joint at its limit nearest to zero: at zero {where}."
    return replace(mechanism, rest=rest), [note("home", text, first.name)]


def state_within_limits(model: ReferenceModel, state: Assembly) -> Assembly | None:
    """Return a closed state near a closed `state` in which all joints are within their limits; None if none is found.

    Joints outside their limits are moved inside, then the loops are closed again, until both hold: alternating
    projections. The driven joints move only if the passive joints alone cannot do it.
    """
    if limit_excess(model.tree, state.x) <= _LIMIT_ROUNDING:
        return state
    all_columns = np.arange(model.tree.model.nv)
    for columns in (model.tree.passive, all_columns):
        x = state.x
        for _ in range(_MAX_PROJECTIONS):
            states, _ = minimise(model.tree, _clipped(model, x)[None], model.loops_only, columns)
            x = states[0]
            if not np.isfinite(x).all():  # Newton's method diverged
                break
            if limit_excess(model.tree, x) <= _LIMIT_ROUNDING:
                closed_state = model.state(x)
                if is_closed(closed_state):
                    return closed_state
                break
    return None


def value_text(joint: Joint, q: float) -> str:
    """Return a joint value `q` (rad or m) as text in degrees or mm."""
    if joint.is_angle:
        return f"{q / DEG:.4g}°"
    return f"{q / MM:.4g} mm"


def _within(joint: Joint, q: float) -> bool:
    low, high = _limits(joint)
    return low - ROUNDING <= q <= high + ROUNDING


def _all_within(joints: Sequence[Joint], values: Mapping[str, float]) -> bool:
    return all(_within(joint, values[joint.name]) for joint in joints)


def _limits(joint: Joint) -> tuple[float, float]:
    assert joint.limits is not None
    return joint.limits


def _limits_text(joint: Joint) -> str:
    low, high = _limits(joint)
    return f"{value_text(joint, low)} .. {value_text(joint, high)}"


def rest_at_values(mechanism: Mechanism, values: Mapping[str, float]) -> dict[str, Array]:
    """Return the rest poses {body: T_base_body (4, 4)} with the joints of the tree that are in `values` moved to them.

    All other joints keep the relative pose of their bodies.
    """
    rest_poses = dict(mechanism.rest)
    for joint in mechanism.tree:
        T_parent_child = spatial.inverse(mechanism.rest[joint.parent]) @ mechanism.rest[joint.child]
        if joint.name in values:
            q = values[joint.name]
            T_parent_child = joint.T_parent_joint @ motion(joint, q) @ spatial.inverse(joint.T_child_joint)
        rest_poses[joint.child] = rest_poses[joint.parent] @ T_parent_child
    return rest_poses


def _clipped(model: ReferenceModel, x: Array) -> Array:
    """Return a copy of configuration x (nq,) with each joint that is outside its limits moved to just inside them."""
    clipped = x.copy()
    for joint in model.mechanism.tree:
        if joint.limits is None or joint.name not in model.tree.configuration:
            continue
        low, high = joint.limits
        margin = _LIMIT_MARGIN * min(high - low, 1.0)
        index = model.tree.configuration[joint.name]
        if clipped[index] < low:
            clipped[index] = low + margin
        elif clipped[index] > high:
            clipped[index] = high - margin
    return clipped
