"""If the parts of a joint do not meet in the CAD, find the faulty part, and test whether it explains the wrong rows.

The rows are the results of the equations that are compared with the mechanism. Each suspected part is corrected in the
CAD, and the rows are compared with the resulting mechanism. Evidence in the CAD (lengths, identical parts, closing
loops) has priority over the agreement of the rows.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import islice, product

from twin.cad import frames
from twin.cad.build import CadModel
from twin.cad.faulty import FrameMismatch, Suspect, faults
from twin.core.errors import TwinError
from twin.core.findings import Finding
from twin.formula.contract import Formula
from twin.reference import ReferenceModel
from twin.validation.explain.judge import Judge
from twin.validation.explain.result import PartOff

CODES = ("cad.noise", "cad.meeting", "cad.tilt")
"""Codes of findings about joints whose parts do not meet."""

_MOST = 12
"""Maximum number of combinations of parts that are tried."""

_OPEN = (1e-8, 1e-7)
"""Gaps in m and rad above which a loop is open."""

_TIMES = {"mm": "mm", "deg": "°"}


@dataclass(frozen=True)
class Corrected:
    """The CAD with its faulty parts corrected.

    Attributes:
        findings: findings of the CAD reader on joints whose parts do not meet.
        parts: the faulty parts, one per fault.
        model: model of the corrected mechanism; None if nothing was corrected.
        judge: judge of the rows with the corrected mechanism; None if nothing was corrected.
        agrees: whether all compared assignments of the formula agree with the corrected mechanism.
    """

    findings: tuple[Finding, ...]
    parts: tuple[PartOff, ...]
    model: ReferenceModel | None
    judge: Judge | None
    agrees: bool


@dataclass(frozen=True)
class _Tried:
    """The CAD with one combination of parts corrected; `model`, `judge`: None if the mechanism cannot be assembled."""

    chosen: tuple[Suspect, ...]
    model: ReferenceModel | None = None
    judge: Judge | None = None

    @property
    def closes(self) -> bool:
        """Whether every loop closes at every pose."""
        if self.judge is None or self.judge.truth.run is None:
            return False
        gaps = self.judge.truth.run.gaps
        return not gaps.size or bool((gaps.max(axis=(0, 1)) < _OPEN).all())

    @property
    def agrees(self) -> bool:
        """Whether all compared assignments agree with the corrected mechanism; False if none was compared."""
        return self.judge is not None and bool(self.judge.residuals) and not self.judge.failing()

    @property
    def rank(self) -> tuple[int, bool, bool, int]:
        """Sort key; the best combination has the largest key. Evidence in the CAD comes before agreement of rows."""
        off = len(self.judge.failing()) if self.judge is not None else 10**6
        return sum(s.score for s in self.chosen), self.closes, self.agrees, -off


def correct(
    formula: Formula,
    cad: CadModel,
    judged: Callable[[ReferenceModel], Judge],
    progress: Callable[[float], None] = lambda f: None,
) -> Corrected | None:
    """Find the faults of the CAD and judge the rows with the corrected CAD; None if the parts of every joint meet.

    Lengths declared in the description are evidence. `judged` is a function that returns a judge of the rows for a
    mechanism.
    """
    findings = drawing(cad)
    if not findings:
        return None
    found = faults(cad, {p.name: float(p.value) for p in formula.parameters})
    told = [f for f in found if f.suspects]
    choices = sorted(islice(product(*(f.suspects for f in told)), 200), key=lambda c: -sum(s.score for s in c))
    best = sum(s.score for s in choices[0])
    first = [c for c in choices if sum(s.score for s in c) == best]
    tried: list[_Tried] = []
    for i, chosen in enumerate(choices[:_MOST] if told else []):
        if chosen not in first and any(t.agrees for t in tried):
            break
        progress(i / min(_MOST, len(choices)))
        tried.append(_put_right(cad, chosen, judged))
    top = max((t for t in tried if t.agrees), default=None, key=lambda t: t.rank)
    top = top or max(tried, default=_Tried(()), key=lambda t: t.rank)
    sides = dict(zip((f.joints for f in told), top.chosen, strict=False))
    parts = tuple(_part(f, findings, sides.get(f.joints), top, tried) for f in found)
    return Corrected(findings, parts, top.model, top.judge, top.agrees and len(told) == len(found))


def drawing(cad: CadModel) -> tuple[Finding, ...]:
    """Return the findings on joints whose parts do not meet in the CAD."""
    return tuple(f for f in cad.findings if f.code in CODES)


def _put_right(cad: CadModel, chosen: Sequence[Suspect], judged: Callable[[ReferenceModel], Judge]) -> _Tried:
    faces = dict(cad.measured)
    given = {k: T for s in chosen for k, T in s.given.items()}
    for s in chosen:
        mine = {n: m for n, m in s.faces[s.body].items() if n in (s.features or s.faces[s.body])}
        faces[s.body] = {**faces[s.body], **mine}
    try:
        model = ReferenceModel(frames.moved(cad.mechanism, cad.description, faces, given))
        return _Tried(tuple(chosen), model, judged(model))
    except TwinError:  # the mechanism cannot be assembled, or can hardly be moved
        return _Tried(tuple(chosen))


def _part(
    fault: FrameMismatch,
    findings: Sequence[Finding],
    chosen: Suspect | None,
    top: _Tried,
    tried: Sequence[_Tried],
) -> PartOff:
    sizes = [f for f in findings if f.where in fault.joints]
    much = " and ".join(f"{_number(f.size or 0.0)} {_TIMES[f.unit]}".replace(" °", "°") for f in sizes)
    where = ", ".join(dict.fromkeys(f.where for f in sizes))
    head = f"joint{'s' if len(fault.joints) > 1 else ''} {where}, {much}"
    if chosen is None:
        text = f"{head}: no single faulty part explains these gaps"
        return PartOff(fault.joints, "", (), "", (), (), text)
    others = [s for s in fault.suspects if s is not chosen]
    by, why, rest = _decide(chosen, others, top, tried)
    left = [_name(s) for s in rest]
    what = _name(chosen)
    if left:
        text = f"{head}: {what} is wrong, or {', or '.join(left)}; CAD and rows do not determine which"
    else:
        text = f"{head}: {what} is wrong" + (f" ({'; '.join(why[:2])})" if why else "")
    return PartOff(fault.joints, chosen.body, chosen.features, by, tuple(why), tuple(left), text)


def _decide(
    chosen: Suspect, others: list[Suspect], top: _Tried, tried: Sequence[_Tried]
) -> tuple[str, list[str], list[Suspect]]:
    """Return (kind of evidence as in `PartOff.told_by`, evidence as text, alternative parts)."""
    why = [*chosen.for_it, *(text for s in others for text in s.against_it)]
    if not others:
        return "joints", [*why, "the other part of the joint has no gaps at further joints"], []
    if all(s.score < chosen.score for s in others) and top.agrees >= any(t.agrees for t in tried):
        return "drawing", why, []
    same = {s: [t for t in tried if s in t.chosen] for s in others}
    if top.closes and all(same[s] and not any(t.closes for t in same[s]) for s in others):
        return "loops", [*why, "the loops close at every pose only if this part is corrected"], []
    if top.agrees and all(same[s] and not any(t.agrees for t in same[s]) for s in others):
        return "rows", [*why, "every row agrees only if this part is corrected"], []
    if not top.agrees:
        return "", why, others
    return "", why, [s for s in others if any(t.agrees for t in same[s]) or not same[s]]


def _name(s: Suspect) -> str:
    if s.given:
        return f"'{s.body}' (the numbers for the position of {', '.join(joint for joint, _ in s.given)} on this body)"
    if not s.features:
        return f"the placement of '{s.body}' in the CAD"
    return f"'{s.body}' at its {' and '.join(s.features)}"


def _number(x: float) -> str:
    return f"{x:.6g}"
