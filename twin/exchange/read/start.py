"""Find the joint values at which an imported mechanism starts: those of its file, moved into the joint limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from twin.core import spatial
from twin.core.findings import Finding
from twin.core.spatial import Array
from twin.core.units import DEG, MM, ROUNDING
from twin.exchange.read.source import Imported, motion, note, warning
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.reference import ReferenceModel
from twin.reference.assembly import is_closed
from twin.reference.newton import minimise
from twin.reference.singular_departure import limit_excess
from twin.reference.states import Assembly

_MARGIN = 1e-3
"""Distance from a limit, relative to the range of the joint (at most 1 rad or m), to which a joint is moved if loops
bind it. Without it, the steps between limits and loops approach a state at a limit, but do not reach it."""

_ROUNDS = 100
"""Maximum number of steps between limits and loops."""

_INSIDE = 1e-9
"""Sum in rad and m by which joints may exceed their limits by rounding."""


def started(imported: Imported) -> tuple[Mechanism, list[Finding]]:
    """Return the mechanism with all joints of the tree within their limits in its rest pose, and findings.

    If a joint of the file's rest pose is outside its limits, the rest pose gets the joint values of the first key frame
    that is within all limits; without such a key frame, each joint that is outside moves to its nearest limit. The
    loops may then be open.
    """
    m = imported.mechanism
    limited: list[Joint] = []
    outside: list[Joint] = []
    drawn: dict[str, float] = {}
    for joint in m.tree:
        # A ball joint has a cone and no single coordinate.
        if joint.limits is None or len(joint.free_axes) != 1:
            continue
        q = float(joint.coordinate(m.rest[joint.parent], m.rest[joint.child]))
        limited.append(joint)
        drawn[joint.name] = q
        if not _within(joint, q):
            outside.append(joint)
    if not outside:
        return m, []
    first = outside[0]
    where = f"joint '{first.name}' would be at {shown(first, drawn[first.name])}, outside its limits {_range(first)}"
    if len(outside) > 1:
        where += f", and {len(outside) - 1} others outside theirs"
    for key, values in imported.keys.items():
        if _all_within(limited, {**drawn, **values}):
            text = f"home is key frame '{key}': in the rest pose of the file {where}."
            return replace(m, rest=moved(m, values)), [note("home", text, key)]
    clipped: dict[str, float] = {}
    for joint in outside:
        low, high = _limits(joint)
        clipped[joint.name] = float(np.clip(drawn[joint.name], low, high))
    rest = moved(m, clipped)
    if imported.posed:
        text = f"home has each joint at its nearest limit: in the rest pose of the file {where}."
        return replace(m, rest=rest), [warning("home", text, first.name)]
    text = f"home has each joint at its limit nearest to zero: at zero {where}."
    return replace(m, rest=rest), [note("home", text, first.name)]


def inside(model: ReferenceModel, state: Assembly) -> Assembly | None:
    """Return a closed state near a closed `state` in which all joints are within their limits; None if none is found.

    Joints outside their limits are moved inside, then the loops are closed again, until both hold: alternating
    projections. The driven joints move only if the passive joints alone cannot do it.
    """
    if limit_excess(model.tree, state.x) <= _INSIDE:
        return state
    all_columns = np.arange(model.tree.model.nv)
    for columns in (model.tree.passive, all_columns):
        x = state.x
        for _ in range(_ROUNDS):
            states, _ = minimise(model.tree, _clipped(model, x)[None], model.loops_only, columns)
            x = states[0]
            if not np.isfinite(x).all():  # Newton's method diverged
                break
            if limit_excess(model.tree, x) <= _INSIDE:
                found = model.state(x)
                if is_closed(found):
                    return found
                break
    return None


def shown(joint: Joint, q: float) -> str:
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


def _range(joint: Joint) -> str:
    low, high = _limits(joint)
    return f"{shown(joint, low)} .. {shown(joint, high)}"


def moved(m: Mechanism, values: Mapping[str, float]) -> dict[str, Array]:
    """Return the rest poses {body: T_base_body (4, 4)} with the joints of the tree that are in `values` moved to them.

    All other joints keep the relative pose of their bodies.
    """
    rest = dict(m.rest)
    for joint in m.tree:
        between = spatial.inverse(m.rest[joint.parent]) @ m.rest[joint.child]
        if joint.name in values:
            q = values[joint.name]
            between = joint.T_parent_joint @ motion(joint, q) @ spatial.inverse(joint.T_child_joint)
        rest[joint.child] = rest[joint.parent] @ between
    return rest


def _clipped(model: ReferenceModel, x: Array) -> Array:
    """Return a copy of configuration x (nq,) with each joint that is outside its limits moved to just inside them."""
    out = x.copy()
    for joint in model.mechanism.tree:
        if joint.limits is None or joint.name not in model.tree.configuration:
            continue
        low, high = joint.limits
        margin = _MARGIN * min(high - low, 1.0)
        place = model.tree.configuration[joint.name]
        if out[place] < low:
            out[place] = low + margin
        elif out[place] > high:
            out[place] = high - margin
    return out
