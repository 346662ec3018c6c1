"""Find a rest pose in which the loops of a mechanism close; report loops that cannot be closed, with the reason."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from twin.cad.meeting import locked_error
from twin.core.findings import Finding, finding
from twin.core.quantity import Quantity, deg, mm
from twin.exchange.read.drives import with_drives
from twin.exchange.read.proposals import MEETING
from twin.exchange.read.source import Findings, Imported, note, warning
from twin.exchange.read.start import inside, shown, started
from twin.model.mechanism import Mechanism
from twin.reference import ReferenceModel
from twin.reference.assembling import CLOSED, assemble, closes_alone, is_closed, settle
from twin.reference.departing import breach
from twin.reference.regular import SINGULAR, Regularity, closed_beside, regularity
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
    moved = []
    for joint in mechanism.active:
        drawn = joint.coordinate(mechanism.rest[joint.parent], mechanism.rest[joint.child])
        if abs(home.q_full.get(joint.name, 0.0) - drawn) > 1e-9:
            moved.append(joint)
    if moved:
        names = ", ".join(f"'{j.name}' at {shown(j, home.q_full[j.name])}" for j in moved)
        text = f"Driven joints were moved to close the loops; their values at home: {names}."
        findings.note("moved", text, moved[0].name)
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
    freedom = model.mobility(home.x).freedom
    if len(mechanism.active) > freedom:
        text = (
            f"{len(mechanism.active)} joints are driven, but the mechanism has {freedom} degrees of freedom: remove "
            "`active = true` from the passive joints, and list the driven joints first."
        )
        findings.warn("driven", text, mechanism.name)
    q = {j.name: float(v) for j, v in zip(mechanism.active, home.q, strict=True)}
    others = {n: v for n, v in mechanism.postures.items() if n != "home"}  # home must be the first posture
    mechanism = replace(mechanism, rest=home.link_poses, postures={"home": q, **others})
    return with_drives(replace(imported, mechanism=mechanism, findings=findings))


def _authored_open(imported: Imported) -> Iterator[Finding]:
    """Yield a finding for each joint whose two frames do not coincide at the body poses of the file."""
    m = imported.mechanism
    for joint in m.joints:
        T = joint.relative(m.rest[joint.parent], m.rest[joint.child])
        offset, tilt = locked_error(T, joint.type)
        if offset > MEETING[0] or tilt > MEETING[1]:
            text = (
                f"joint '{joint.name}' is open by {mm(offset)} and {deg(tilt)} at the body poses of the file"
                f"{'' if imported.posed else ' (all coordinates zero)'}; home is the nearest state in which this joint "
                "is closed"
            )
            yield finding(
                "warning" if imported.posed else "info",
                "import.open",
                joint.name,
                text,
                Quantity(offset, "m"),
                MEETING[0],
                word="",
            )


def _home(model: ReferenceModel, keys: Mapping[str, Mapping[str, float]]) -> tuple[Assembly, list[Finding]]:
    """Return (state for `home`, findings that explain the choice of the state)."""
    drawn = assemble(model)
    if is_closed(drawn):
        drawn = inside(model, drawn) or drawn
    name = model.mechanism.name
    there = regularity(model, [drawn.x])[0] if is_closed(drawn) else None
    if there is not None and not there.singular:
        return drawn, []
    why = "the loops do not close at the rest pose of the file" if there is None else f"at the rest pose {_lost(there)}"
    for key, values in keys.items():
        found = settle(model, values)
        if found is not None and breach(model.tree, found.x) < _IN and not regularity(model, [found.x])[0].singular:
            return found, [note("home", f"{why}: home is key frame '{key}', with its loops closed.", key)]
    if there is None:
        return drawn, []
    best, margin = drawn.x, there.margin
    for _ in range(_ROUNDS):
        within = [x for x in closed_beside(model, best) if breach(model.tree, x) < _IN]
        graded = regularity(model, [best, *within])[1:]
        better = max(zip(graded, within, strict=True), key=lambda pair: pair[0].margin, default=None)
        if better is None or better[0].margin <= margin:
            break
        best, margin = better[1], better[0].margin
    if margin < SINGULAR:
        text = f"{why}, and no nearby state was found that is less singular: small moves from home may fail."
        return drawn, [warning("singular", text, name)]
    return model.state(best), [warning("home", f"{why}: home is a nearby state that is less singular.", name)]


def _lost(r: Regularity) -> str:
    return f"the mechanism is singular (rank of the loop equations {r.rank}; at nearby states {r.usual})"


def _open(offset: float, tilt: float) -> bool:
    return offset > CLOSED[0] or tilt > CLOSED[1]


def _gap(mechanism: Mechanism, name: str, offset: float, tilt: float, unread: Sequence[Finding]) -> Finding:
    if name in {c.name for c in mechanism.couplings}:
        text = (
            f"the sum of coupling '{name}' differs from its constant by {deg(tilt)} or {mm(offset)} at the state with "
            "the smallest gaps"
        )
        return finding("warning", "import.gap", name, text, Quantity(offset, "m"), CLOSED[0], word="")
    alone = closes_alone(mechanism, name)
    if _open(*alone):
        why = f"With all other loops cut, a gap of {mm(alone[0])} and {deg(alone[1])} remains. "
        left = f"{len(unread)} elements of the file are not supported; the first: {unread[0].message}" if unread else ""
        why += left or "The gap is a defect of the model."
    else:
        why = "With all other loops cut, this loop closes: the loops contradict each other, or need another start pose."
    text = f"loop '{name}' stays open by {mm(offset)} and {deg(tilt)}. {why}"
    return finding("warning", "import.gap", name, text, Quantity(offset, "m"), CLOSED[0], word="")
