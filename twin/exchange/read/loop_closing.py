"""Find a rest pose in which the loops of a mechanism close; report loops that cannot be closed, with the reason."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from twin.cad.meeting import locked_gap_sizes
from twin.core.findings import Finding, Severity, finding
from twin.core.quantity import Quantity, deg, mm
from twin.core.spatial import Array
from twin.exchange.read.assumed_drives import with_drives
from twin.exchange.read.imported_robot import Findings, Imported, note, warning
from twin.exchange.read.proposals import MEETING_TOLERANCE
from twin.exchange.read.start_values import start_within_limits, state_within_limits, value_text
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.reference import ReferenceModel
from twin.reference.assembly import CLOSED, assemble, closes_alone, is_closed, settle
from twin.reference.regularity import SINGULAR, Regularity, closed_beside, regularity
from twin.reference.singular_departure import limit_excess
from twin.reference.states import Assembly

_UNREAD_CODES = ("import.unread", "import.schema", "import.plugin", "import.inactive")
"""Codes of findings on unsupported data, which may be the reason why a loop does not close."""

_MAX_SEARCHES = 6
"""Maximum number of searches for a less singular state near the best state found."""

_LIMIT_TOLERANCE = 1e-6
"""Tolerance of joint limits in m and rad at the states that are candidates for home."""

_COORDINATE_ROUNDING = 1e-9
"""Rounding in m or rad of a coordinate that is computed from the poses of two bodies."""


def close(imported: Imported) -> Imported:
    """Close the loops at the rest pose (posture `home`), and add a drive to each driven joint that has none.

    For each loop that cannot be closed, a finding states the gap. The finding calls the gap a defect of the model if
    the gap remains when all other loops are cut, and all elements of the file are supported.

    The rest pose is that of the file, with all joints moved into their limits (see `start_within_limits`). If the loops
    cannot be closed near it, or the closed state is singular, `home` is the first key frame of the file at which the
    loops close within the joint limits and the state is not singular. If no key frame has these properties, a singular
    state is replaced by the least singular nearby state within the joint limits.
    """
    findings = Findings(imported.findings)
    findings += _authored_open(imported)
    mechanism, home_findings = start_within_limits(imported)
    findings += home_findings
    model = ReferenceModel(mechanism)
    home, home_findings = _home(model, imported.keys)
    findings += home_findings
    unread = []
    for reported in findings:
        if reported.severity == "warning" and reported.code in _UNREAD_CODES:
            unread.append(reported)
    for name, (offset, tilt) in home.gap.items():
        if _is_open(offset, tilt):
            findings.append(_gap_finding(mechanism, name, offset, tilt, unread))
    _report_moved(mechanism, home, findings)
    _report_outside(mechanism, home, findings)
    freedom = model.mobility(home.x).freedom
    if len(mechanism.active) > freedom:
        text = (
            f"{len(mechanism.active)} joints are driven, but the mechanism has {freedom} degrees of freedom: remove "
            "`active = true` from the passive joints, and list the driven joints first."
        )
        findings.warn("driven", text, mechanism.name)
    home_values: dict[str, float] = {}
    for joint, q in zip(mechanism.active, home.q, strict=True):
        home_values[joint.name] = float(q)
    postures: dict[str, Mapping[str, float]] = {"home": home_values}  # home must be the first posture
    for name, values in mechanism.postures.items():
        if name != "home":
            postures[name] = values
    mechanism = replace(mechanism, rest=home.link_poses, postures=postures)
    return with_drives(replace(imported, mechanism=mechanism, findings=findings))


def _report_moved(mechanism: Mechanism, home: Assembly, findings: Findings) -> None:
    """Add a finding that names the driven joints whose values at home differ from those of the rest pose."""
    moved_joints: list[Joint] = []
    values: list[str] = []
    for joint in mechanism.active:
        rest_value = joint.coordinate(mechanism.rest[joint.parent], mechanism.rest[joint.child])
        if abs(home.q_full.get(joint.name, 0.0) - rest_value) > _COORDINATE_ROUNDING:
            moved_joints.append(joint)
            values.append(f"'{joint.name}' at {value_text(joint, home.q_full[joint.name])}")
    if moved_joints:
        text = f"Driven joints were moved to close the loops; their values at home: {', '.join(values)}."
        findings.note("moved", text, moved_joints[0].name)


def _report_outside(mechanism: Mechanism, home: Assembly, findings: Findings) -> None:
    """Add a finding for each joint that is outside its limits at home."""
    for joint in mechanism.joints:
        q = home.q_full.get(joint.name)
        if q is None or not joint.limits:
            continue
        low, high = joint.limits
        if not low - _COORDINATE_ROUNDING <= q <= high + _COORDINATE_ROUNDING:
            limits = f"{value_text(joint, low)} .. {value_text(joint, high)}"
            text = f"joint '{joint.name}' is at {value_text(joint, q)} at home, outside its limits {limits}."
            findings.warn("rest", text, joint.name)


def _authored_open(imported: Imported) -> Iterator[Finding]:
    """Yield a finding for each joint whose two frames do not coincide at the body poses of the file."""
    mechanism = imported.mechanism
    if imported.posed:
        severity: Severity = "warning"
        poses = "the body poses of the file"
    else:
        # A URDF states no pose: nobody claimed that its loops close at zero.
        severity = "info"
        poses = "the body poses of the file (all coordinates zero)"
    for joint in mechanism.joints:
        T = joint.relative(mechanism.rest[joint.parent], mechanism.rest[joint.child])
        offset, tilt = locked_gap_sizes(T, joint.type)
        if offset > MEETING_TOLERANCE[0] or tilt > MEETING_TOLERANCE[1]:
            text = (
                f"joint '{joint.name}' is open by {mm(offset)} and {deg(tilt)} at {poses}; home is the nearest state "
                "in which this joint is closed"
            )
            yield finding(
                severity, "import.open", joint.name, text, Quantity(offset, "m"), MEETING_TOLERANCE[0], word=""
            )


def _home(model: ReferenceModel, keys: Mapping[str, Mapping[str, float]]) -> tuple[Assembly, list[Finding]]:
    """Return (state for `home`, findings that explain the choice of the state)."""
    rest_state = assemble(model)
    if is_closed(rest_state):
        rest_state = state_within_limits(model, rest_state) or rest_state
    rest_regularity: Regularity | None = None
    if is_closed(rest_state):
        rest_regularity = regularity(model, [rest_state.x])[0]
    if rest_regularity is None:
        reason = "the loops do not close at the rest pose of the file"
    elif rest_regularity.singular:
        reason = (
            f"at the rest pose the mechanism is singular (rank of the loop equations {rest_regularity.rank}; at "
            f"nearby states {rest_regularity.usual})"
        )
    else:
        return rest_state, []
    for key, values in keys.items():
        state = settle(model, values)
        if state is None or limit_excess(model.tree, state.x) >= _LIMIT_TOLERANCE:
            continue
        if not regularity(model, [state.x])[0].singular:
            return state, [note("home", f"{reason}: home is key frame '{key}', with its loops closed.", key)]
    if rest_regularity is None:
        return rest_state, []
    name = model.mechanism.name
    best, margin = _less_singular(model, rest_state, rest_regularity.margin)
    if margin < SINGULAR:
        text = f"{reason}, and no nearby state was found that is less singular: small moves from home may fail."
        return rest_state, [warning("singular", text, name)]
    return model.state(best), [warning("home", f"{reason}: home is a nearby state that is less singular.", name)]


def _less_singular(model: ReferenceModel, rest_state: Assembly, margin: float) -> tuple[Array, float]:
    """Return the least singular state (nq,) found near `rest_state` within the joint limits, and its margin.

    `margin` is that of `rest_state`, which is returned if no better state is found.
    """
    best = rest_state.x
    for _ in range(_MAX_SEARCHES):
        states_within_limits = []
        for x in closed_beside(model, best):
            if limit_excess(model.tree, x) < _LIMIT_TOLERANCE:
                states_within_limits.append(x)
        # `best` comes first, because all ranks are compared with the ranks near the first state.
        grades = regularity(model, [best, *states_within_limits])[1:]
        nearby_best: Array | None = None
        nearby_margin = -np.inf
        for grade, x in zip(grades, states_within_limits, strict=True):
            if nearby_best is None or grade.margin > nearby_margin:
                nearby_best = x
                nearby_margin = grade.margin
        if nearby_best is None or nearby_margin <= margin:
            break
        best = nearby_best
        margin = nearby_margin
    return best, margin


def _is_open(offset: float, tilt: float) -> bool:
    """Return whether a gap in m and rad is more than that of a closed loop."""
    return offset > CLOSED[0] or tilt > CLOSED[1]


def _gap_finding(mechanism: Mechanism, name: str, offset: float, tilt: float, unread: Sequence[Finding]) -> Finding:
    """Return the finding on a loop or coupling `name` that stays open by a gap in m and rad, with the likely cause."""
    if any(coupling.name == name for coupling in mechanism.couplings):
        text = (
            f"the sum of coupling '{name}' differs from its constant by {deg(tilt)} or {mm(offset)} at the state with "
            "the smallest gaps"
        )
        return finding("warning", "import.gap", name, text, Quantity(offset, "m"), CLOSED[0], word="")
    alone_offset, alone_tilt = closes_alone(mechanism, name)
    if _is_open(alone_offset, alone_tilt):
        reason = f"With all other loops cut, a gap of {mm(alone_offset)} and {deg(alone_tilt)} remains. "
        if unread:
            reason += f"{len(unread)} elements of the file are not supported; the first: {unread[0].message}"
        else:
            reason += "The gap is a defect of the model."
    else:
        reason = (
            "With all other loops cut, this loop closes: the loops contradict each other, or need another start pose."
        )
    text = f"loop '{name}' stays open by {mm(offset)} and {deg(tilt)}. {reason}"
    return finding("warning", "import.gap", name, text, Quantity(offset, "m"), CLOSED[0], word="")
