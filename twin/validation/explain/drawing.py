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
from twin.core.spatial import Array
from twin.formula.contract import Formula
from twin.reference import ReferenceModel
from twin.validation.explain.explanation_data import FaultyPart
from twin.validation.explain.row_deviations import Judge

CODES = ("cad.noise", "cad.meeting", "cad.tilt")
"""Codes of findings about joints whose parts do not meet."""

_MOST = 12
"""Maximum number of combinations of parts that are tried."""

_MOST_SORTED = 200
"""Maximum number of combinations of which those with the most evidence are tried first."""

_MORE_THAN_ALL = 10**6
"""Number of wrong rows without a mechanism: more than any formula has."""

_OPEN = (1e-8, 1e-7)
"""Gaps in m and rad above which a loop is open."""


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
    parts: tuple[FaultyPart, ...]
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
        if self.judge is None or self.judge.reference.run is None:
            return False
        gaps = self.judge.reference.run.gaps
        if not gaps.size:  # there are no loops
            return True
        return bool((gaps.max(axis=(0, 1)) < _OPEN).all())

    @property
    def agrees(self) -> bool:
        """Whether all compared assignments agree with the corrected mechanism; False if none was compared."""
        return self.judge is not None and bool(self.judge.residuals) and not self.judge.failing()

    @property
    def rank(self) -> tuple[int, bool, bool, int]:
        """Sort key; the best combination has the largest key. Evidence in the CAD comes before agreement of rows."""
        wrong = _MORE_THAN_ALL
        if self.judge is not None:
            wrong = len(self.judge.failing())
        return _score(self.chosen), self.closes, self.agrees, -wrong


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
    lengths = {p.name: float(p.value) for p in formula.parameters}
    all_faults = faults(cad, lengths)
    located = [fault for fault in all_faults if fault.suspects]
    tried: list[_Tried] = []
    if located:
        tried = _tried(cad, located, judged, progress)
    best = _best(tried)
    chosen: dict[tuple[str, ...], Suspect] = {}
    for fault, suspect in zip(located, best.chosen, strict=False):
        chosen[fault.joints] = suspect
    parts: list[FaultyPart] = []
    for fault in all_faults:
        parts.append(_part(fault, findings, chosen.get(fault.joints), best, tried))
    agrees = best.agrees and len(located) == len(all_faults)
    return Corrected(findings, tuple(parts), best.model, best.judge, agrees)


def _tried(
    cad: CadModel,
    located: Sequence[FrameMismatch],
    judged: Callable[[ReferenceModel], Judge],
    progress: Callable[[float], None],
) -> list[_Tried]:
    """Correct combinations of parts, one suspect for each fault, those with the most evidence in the CAD first."""
    combinations = product(*(fault.suspects for fault in located))
    choices = sorted(islice(combinations, _MOST_SORTED), key=_score, reverse=True)
    best = _score(choices[0])
    tried: list[_Tried] = []
    for i, chosen in enumerate(choices[:_MOST]):
        some_agrees = any(combination.agrees for combination in tried)
        # Less evidence is enough only as long as no combination makes every row agree.
        if _score(chosen) < best and some_agrees:
            break
        progress(i / min(_MOST, len(choices)))
        tried.append(_put_right(cad, chosen, judged))
    return tried


def _best(tried: Sequence[_Tried]) -> _Tried:
    """Return the best combination: of those with which every row agrees, if there are any, otherwise of all."""
    agreeing = [combination for combination in tried if combination.agrees]
    return max(agreeing or tried, default=_Tried(()), key=lambda combination: combination.rank)


def _score(suspects: Sequence[Suspect]) -> int:
    """Return how much evidence in the CAD there is against suspected parts together."""
    return sum(suspect.score for suspect in suspects)


def drawing(cad: CadModel) -> tuple[Finding, ...]:
    """Return the findings on joints whose parts do not meet in the CAD."""
    return tuple(finding for finding in cad.findings if finding.code in CODES)


def _put_right(cad: CadModel, chosen: Sequence[Suspect], judged: Callable[[ReferenceModel], Judge]) -> _Tried:
    """Return the CAD with the chosen parts corrected, assembled and judged."""
    faces = dict(cad.measured)
    given: dict[tuple[str, str], Array] = {}
    for suspect in chosen:
        given |= suspect.given
        measured = suspect.faces[suspect.body]
        corrected = measured
        if suspect.features:
            corrected = {name: measured[name] for name in measured if name in suspect.features}
        faces[suspect.body] = {**faces[suspect.body], **corrected}
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
) -> FaultyPart:
    """Return the result about one fault, as text and data; `chosen`: the suspect in the best combination."""
    gaps: list[str] = []
    joints: dict[str, None] = {}
    for finding in findings:
        if finding.where in fault.joints:
            unit = "°" if finding.unit == "deg" else " mm"
            gaps.append(f"{finding.size or 0.0:.6g}{unit}")
            joints[finding.where] = None
    noun = "joints" if len(fault.joints) > 1 else "joint"
    head = f"{noun} {', '.join(joints)}, {' and '.join(gaps)}"
    if chosen is None:
        text = f"{head}: no single faulty part explains these gaps"
        return FaultyPart(fault.joints, "", (), "", (), (), text)
    others = [suspect for suspect in fault.suspects if suspect is not chosen]
    told_by, why, undecided = _decide(chosen, others, top, tried)
    alternatives = tuple(_name(suspect) for suspect in undecided)
    text = f"{head}: {_name(chosen)} is wrong"
    if alternatives:
        text += f", or {', or '.join(alternatives)}; CAD and rows do not determine which"
    elif why:
        text += f" ({'; '.join(why[:2])})"
    return FaultyPart(fault.joints, chosen.body, chosen.features, told_by, tuple(why), alternatives, text)


def _decide(
    chosen: Suspect, others: list[Suspect], top: _Tried, tried: Sequence[_Tried]
) -> tuple[str, list[str], list[Suspect]]:
    """Return (kind of evidence as in `FaultyPart.told_by`, evidence as text, alternative parts)."""
    why = list(chosen.for_it)
    for suspect in others:
        why += suspect.against_it
    if not others:
        return "joints", [*why, "the other part of the joint has no gaps at further joints"], []
    closes: list[bool] = []  # for each of the others: whether the loops close with it
    agrees: list[bool] = []
    undecided: list[Suspect] = []
    for suspect in others:
        # A part with which no combination was tried may also be the faulty one.
        with_it = [combination for combination in tried if suspect in combination.chosen]
        closes.append(not with_it or any(combination.closes for combination in with_it))
        agrees.append(not with_it or any(combination.agrees for combination in with_it))
        if agrees[-1]:
            undecided.append(suspect)
    has_most_evidence = max(suspect.score for suspect in others) < chosen.score
    none_agrees = not any(combination.agrees for combination in tried)
    if has_most_evidence and (top.agrees or none_agrees):
        return "drawing", why, []
    if top.closes and not any(closes):
        return "loops", [*why, "the loops close at every pose only if this part is corrected"], []
    if top.agrees and not any(agrees):
        return "rows", [*why, "every row agrees only if this part is corrected"], []
    if not top.agrees:
        return "", why, others
    return "", why, undecided


def _name(suspect: Suspect) -> str:
    if suspect.given:
        joints = ", ".join(joint for joint, _ in suspect.given)
        return f"'{suspect.body}' (the numbers for the position of {joints} on this body)"
    if not suspect.features:
        return f"the placement of '{suspect.body}' in the CAD"
    return f"'{suspect.body}' at its {' and '.join(suspect.features)}"
