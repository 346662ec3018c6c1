"""Rest a mechanism with its loops closed, and say what stays open and why."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from twin.cad.meeting import locked_error
from twin.core.findings import Finding
from twin.core.units import DEG, MM
from twin.exchange.read.drives import with_drives
from twin.exchange.read.proposals import MEETING
from twin.exchange.read.source import Imported, note, warning
from twin.model.mechanism import Mechanism
from twin.reference import ReferenceModel
from twin.reference.assembling import CLOSED, assemble, closes_alone, is_closed, settle
from twin.reference.departing import breach
from twin.reference.regular import SINGULAR, Regularity, closed_beside, regularity
from twin.reference.states import Assembly

_UNREAD = ("import.unread", "import.schema", "import.plugin", "import.inactive")
"""Findings of what a file says that is not read, and might have let a loop close."""

_ROUNDS = 6
"""How often a more regular state is looked for beside the best so far."""

_IN = 1e-6
"""Breach of limits (m, rad) that is none."""


def close(imported: Imported) -> Imported:
    """Return the mechanism resting with its loops closed, posture `home` of where it rests, and a drive where driven.

    A loop that stays open is a finding with its size, and with what it leaves when all others are open: what does
    not close alone is the model's own gap, if nothing of the file is unread. Where the mechanism would rest singular,
    or open, a key frame of the file is its home, or else the most regular state beside it within the limits.
    """
    mechanism, findings = imported.mechanism, list(imported.findings)
    findings += _authored_open(imported)
    model = ReferenceModel(mechanism)
    home, said = _home(model, imported.keys)
    findings += said
    unread = [f for f in findings if f.severity == "warning" and f.code in _UNREAD]
    findings += [_gap(mechanism, name, *home.gap[name], unread) for name in home.gap if _open(*home.gap[name])]
    moved = [j for j in mechanism.active if abs(home.q_full.get(j.name, 0.0) - _drawn(mechanism, j.name)) > 1e-9]
    if moved:
        names = ", ".join(f"'{j.name}' at {_shown(mechanism, j.name, home)}" for j in moved)
        findings.append(note("moved", f"The loops fit best with driven joints moved: home has {names}.", moved[0].name))
    for joint in mechanism.joints:
        q = home.q_full.get(joint.name)
        if q is not None and joint.limits and not joint.limits[0] - 1e-9 <= q <= joint.limits[1] + 1e-9:
            text = f"joint '{joint.name}' rests at {_shown(mechanism, joint.name, home)}, outside its limits."
            findings.append(warning("rest", text, joint.name))
    freedom = model.mobility(home.x).freedom
    if len(mechanism.active) > freedom:
        text = (
            f"{len(mechanism.active)} joints are driven, but the mechanism has {freedom} degrees of freedom: take "
            "`active = true` off those that follow, and list the driven ones first."
        )
        findings.append(warning("driven", text, mechanism.name))
    q = {j.name: float(v) for j, v in zip(mechanism.active, home.q, strict=True)}
    others = {n: v for n, v in mechanism.postures.items() if n != "home"}  # the first posture is the drawn one
    mechanism = replace(mechanism, rest=home.link_poses, postures={"home": q, **others})
    return with_drives(replace(imported, mechanism=mechanism, findings=findings))


def _authored_open(imported: Imported) -> Iterator[Finding]:
    """Yield the joints whose two sides are apart where the file puts the bodies."""
    m = imported.mechanism
    for joint in m.joints:
        T = joint.relative(m.rest[joint.parent], m.rest[joint.child])
        offset, tilt = locked_error(T, joint.type)
        if offset > MEETING[0] or tilt > MEETING[1]:
            text = (
                f"joint '{joint.name}' is open by {offset / MM:.4g} mm and {tilt / DEG:.4g}° where the file puts its "
                f"bodies{'' if imported.posed else ', every coordinate zero'}: home is where it closes, or nearly does."
            )
            severity = "warning" if imported.posed else "info"
            yield Finding("import.open", severity, text, joint.name, size=offset, unit="m", limit=MEETING[0])


def _home(model: ReferenceModel, keys: Mapping[str, Mapping[str, float]]) -> tuple[Assembly, list[Finding]]:
    """Return the state to rest in, and what is to be said of the choice."""
    drawn = assemble(model)
    name = model.mechanism.name
    there = regularity(model, [drawn.x])[0] if is_closed(drawn) else None
    if there is not None and not there.singular:
        return drawn, []
    why = "the loops do not close as drawn" if there is None else f"as drawn {_lost(there)}"
    for key, values in keys.items():
        found = settle(model, values)
        if found is not None and breach(model.tree, found.x) < _IN and not regularity(model, [found.x])[0].singular:
            return found, [note("home", f"{why}: home is the key frame '{key}', its loops closed.", key)]
    if there is None:
        return drawn, []
    best, margin = drawn.x, there.margin
    for _ in range(_ROUNDS):
        inside = [x for x in closed_beside(model, best) if breach(model.tree, x) < _IN]
        graded = regularity(model, [best, *inside])[1:]
        better = max(zip(graded, inside, strict=True), key=lambda pair: pair[0].margin, default=None)
        if better is None or better[0].margin <= margin:
            break
        best, margin = better[1], better[0].margin
    if margin < SINGULAR:
        text = f"{why}, and no better state is found beside it: small moves may fail from there."
        return drawn, [warning("singular", text, name)]
    return model.state(best), [warning("home", f"{why}: home is a more regular state beside it.", name)]


def _lost(r: Regularity) -> str:
    return f"the mechanism is singular (rank of its loops {r.rank}, beside it {r.usual}), as with knees stretched"


def _open(offset: float, tilt: float) -> bool:
    return offset > CLOSED[0] or tilt > CLOSED[1]


def _gap(mechanism: Mechanism, name: str, offset: float, tilt: float, unread: Sequence[Finding]) -> Finding:
    if name in {c.name for c in mechanism.couplings}:
        what = f"coupling '{name}' is off by {tilt / DEG:.3g}° or {offset / MM:.3g} mm where the loops close best."
        return Finding("import.gap", "warning", what, name, size=offset, unit="m", limit=CLOSED[0])
    alone = closes_alone(mechanism, name)
    if _open(*alone):
        why = f"Alone, all free, it leaves {alone[0] / MM:.3g} mm and {alone[1] / DEG:.3g}°: "
        whose = f"of what is read of the file; {len(unread)} things are not, as: {unread[0].message}" if unread else ""
        why += whose or "the model's own gap."
    else:
        why = "Alone it closes: the loops of the file contradict one another, or another start would close them."
    text = f"loop '{name}' stays open by {offset / MM:.3g} mm and {tilt / DEG:.3g}°. {why}"
    return Finding("import.gap", "warning", text, name, size=offset, unit="m", limit=CLOSED[0])


def _drawn(mechanism: Mechanism, name: str) -> float:
    joint = mechanism.joint(name)
    T = joint.relative(mechanism.rest[joint.parent], mechanism.rest[joint.child])
    if joint.is_angle:
        return math.atan2(float(T[1, 0] - T[0, 1]), float(T[0, 0] + T[1, 1]))
    return float(T[2, 3])


def _shown(mechanism: Mechanism, name: str, home: Assembly) -> str:
    q = home.q_full[name]
    return f"{q / DEG:.4g}°" if mechanism.joint(name).is_angle else f"{q / MM:.4g} mm"
