"""Find a rest pose in which the loops of a mechanism close; report loops that cannot be closed, with the reason."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from twin.cad.meeting import locked_error
from twin.core.findings import Finding, Severity, finding
from twin.core.quantity import Quantity, deg, mm
from twin.core.spatial import Array
from twin.exchange.read.drives import with_drives
from twin.exchange.read.proposals import MEETING
from twin.exchange.read.source import Findings, Imported, note, warning
from twin.exchange.read.start import inside, shown, started
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.reference import ReferenceModel
from twin.reference.assembly import CLOSED, assemble, closes_alone, is_closed, settle
from twin.reference.regularity import SINGULAR, Regularity, closed_beside, regularity
from twin.reference.singular_departure import limit_excess
from twin.reference.states import Assembly

_UNREAD = ("import.unread", "import.schema", "import.plugin", "import.inactive")
"""Codes of findings on unsupported data, which may be the reason why a loop does not close."""

_ROUNDS = 6
"""Maximum number of searches for a less singular state near the best state found."""

_IN = 1e-6
"""Tolerance of joint limits in m and rad."""


def close(imported: Imported) -> Imported:
    """Close the loops at the rest pose (posture `home`), and add a drive to each driven joint that has none.

    For each loop that cannot be closed, a finding states the gap. The finding calls the gap a defect of the model if
    the gap remains when all other loops are cut, and all elements of the file are supported.

    The rest pose is that of the file, with all joints moved into their limits (see `start.started`). If the loops
    cannot be closed near it, or the closed state is singular, `home` is the first key frame of the file at which the
    loops close within the joint limits and the state is not singular. If no key frame has these properties, a singular
    state is replaced by the least singular nearby state within the joint limits.
    """
    findings = Findings(imported.findings)
    findings += _authored_open(imported)
    mechanism, said = started(imported)
    findings += said
    model = ReferenceModel(mechanism)
    home, said = _home(model, imported.keys)
    findings += said
    unread = [f for f in findings if f.severity == "warning" and f.code in _UNREAD]
    for name, (offset, tilt) in home.gap.items():
        if _open(offset, tilt):
            findings.append(_gap(mechanism, name, offset, tilt, unread))
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
    moved: list[Joint] = []
    values: list[str] = []
    for joint in mechanism.active:
        drawn = joint.coordinate(mechanism.rest[joint.parent], mechanism.rest[joint.child])
        # 1e-9 rad or m is more than the rounding of a coordinate that is computed from two body poses.
        if abs(home.q_full.get(joint.name, 0.0) - drawn) > 1e-9:
            moved.append(joint)
            values.append(f"'{joint.name}' at {shown(joint, home.q_full[joint.name])}")
    if moved:
        text = f"Driven joints were moved to close the loops; their values at home: {', '.join(values)}."
        findings.note("moved", text, moved[0].name)


def _report_outside(mechanism: Mechanism, home: Assembly, findings: Findings) -> None:
    """Add a finding for each joint that is outside its limits at home."""
    for joint in mechanism.joints:
        q = home.q_full.get(joint.name)
        if q is None or not joint.limits:
            continue
        low, high = joint.limits
        if not low - 1e-9 <= q <= high + 1e-9:
            text = (
                f"joint '{joint.name}' is at {shown(joint, q)} at home, outside its limits {shown(joint, low)} .. "
                f"{shown(joint, high)}."
            )
            findings.warn("rest", text, joint.name)


def _authored_open(imported: Imported) -> Iterator[Finding]:
    """Yield a finding for each joint whose two frames do not coincide at the body poses of the file."""
    m = imported.mechanism
    if imported.posed:
        severity: Severity = "warning"
        poses = "the body poses of the file"
    else:
        # A URDF states no pose: nobody claimed that its loops close at zero.
        severity = "info"
        poses = "the body poses of the file (all coordinates zero)"
    for joint in m.joints:
        T = joint.relative(m.rest[joint.parent], m.rest[joint.child])
        offset, tilt = locked_error(T, joint.type)
        if offset > MEETING[0] or tilt > MEETING[1]:
            text = (
                f"joint '{joint.name}' is open by {mm(offset)} and {deg(tilt)} at {poses}; home is the nearest state "
                "in which this joint is closed"
            )
            yield finding(severity, "import.open", joint.name, text, Quantity(offset, "m"), MEETING[0], word="")


def _home(model: ReferenceModel, keys: Mapping[str, Mapping[str, float]]) -> tuple[Assembly, list[Finding]]:
    """Return (state for `home`, findings that explain the choice of the state)."""
    drawn = assemble(model)
    if is_closed(drawn):
        drawn = inside(model, drawn) or drawn
    drawn_regularity: Regularity | None = None
    if is_closed(drawn):
        drawn_regularity = regularity(model, [drawn.x])[0]
    if drawn_regularity is None:
        reason = "the loops do not close at the rest pose of the file"
    elif drawn_regularity.singular:
        reason = (
            f"at the rest pose the mechanism is singular (rank of the loop equations {drawn_regularity.rank}; at "
            f"nearby states {drawn_regularity.usual})"
        )
    else:
        return drawn, []
    for key, values in keys.items():
        state = settle(model, values)
        if state is None or limit_excess(model.tree, state.x) >= _IN:
            continue
        if not regularity(model, [state.x])[0].singular:
            return state, [note("home", f"{reason}: home is key frame '{key}', with its loops closed.", key)]
    if drawn_regularity is None:
        return drawn, []
    name = model.mechanism.name
    best, margin = _less_singular(model, drawn, drawn_regularity.margin)
    if margin < SINGULAR:
        text = f"{reason}, and no nearby state was found that is less singular: small moves from home may fail."
        return drawn, [warning("singular", text, name)]
    return model.state(best), [warning("home", f"{reason}: home is a nearby state that is less singular.", name)]


def _less_singular(model: ReferenceModel, drawn: Assembly, margin: float) -> tuple[Array, float]:
    """Return the least singular state (nq,) found near `drawn` within the joint limits, and its margin.

    `margin` is that of `drawn`, which is returned if no better state is found.
    """
    best = drawn.x
    for _ in range(_ROUNDS):
        within = [x for x in closed_beside(model, best) if limit_excess(model.tree, x) < _IN]
        # `best` comes first, because all ranks are compared with the ranks near the first state.
        graded = regularity(model, [best, *within])[1:]
        nearby_best: Array | None = None
        nearby_margin = -np.inf
        for grade, x in zip(graded, within, strict=True):
            if nearby_best is None or grade.margin > nearby_margin:
                nearby_best = x
                nearby_margin = grade.margin
        if nearby_best is None or nearby_margin <= margin:
            break
        best = nearby_best
        margin = nearby_margin
    return best, margin


def _open(offset: float, tilt: float) -> bool:
    return offset > CLOSED[0] or tilt > CLOSED[1]


def _gap(mechanism: Mechanism, name: str, offset: float, tilt: float, unread: Sequence[Finding]) -> Finding:
    if any(coupling.name == name for coupling in mechanism.couplings):
        text = (
            f"the sum of coupling '{name}' differs from its constant by {deg(tilt)} or {mm(offset)} at the state with "
            "the smallest gaps"
        )
        return finding("warning", "import.gap", name, text, Quantity(offset, "m"), CLOSED[0], word="")
    alone_offset, alone_tilt = closes_alone(mechanism, name)
    if _open(alone_offset, alone_tilt):
        why = f"With all other loops cut, a gap of {mm(alone_offset)} and {deg(alone_tilt)} remains. "
        if unread:
            why += f"{len(unread)} elements of the file are not supported; the first: {unread[0].message}"
        else:
            why += "The gap is a defect of the model."
    else:
        why = "With all other loops cut, this loop closes: the loops contradict each other, or need another start pose."
    text = f"loop '{name}' stays open by {mm(offset)} and {deg(tilt)}. {why}"
    return finding("warning", "import.gap", name, text, Quantity(offset, "m"), CLOSED[0], word="")
