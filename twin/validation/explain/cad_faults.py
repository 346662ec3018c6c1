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
from twin.cad.frame_mismatch import FrameMismatch, Suspect, faults
from twin.core.errors import TwinError
from twin.core.findings import Finding
from twin.core.progress import StepProgress, silent_step
from twin.core.spatial import Array
from twin.formula.contract import Formula
from twin.reference import ReferenceModel
from twin.validation.explain.explanation_data import FaultyPart
from twin.validation.explain.row_deviations import Judge

MISMATCH_CODES = ("cad.noise", "cad.meeting", "cad.tilt")
"""Codes of findings about joints whose parts do not meet."""

_MOST_COMBINATIONS = 12
"""Maximum number of combinations of parts that are tried."""

_MOST_RANKED_COMBINATIONS = 200
"""Maximum number of combinations of which those with the most evidence are tried first."""

_WRONG_ROWS_WITHOUT_MECHANISM = 10**6
"""Number of wrong rows without a mechanism: more than any formula has."""

_LARGEST_CLOSED_GAPS = (1e-8, 1e-7)
"""Gaps in m and rad above which a loop is open."""


@dataclass(frozen=True)
class CorrectedCad:
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
class _Correction:
    """The CAD with one combination of parts corrected; `model`, `judge`: None if the mechanism cannot be assembled."""

    suspects: tuple[Suspect, ...]
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
        return bool((gaps.max(axis=(0, 1)) < _LARGEST_CLOSED_GAPS).all())

    @property
    def agrees(self) -> bool:
        """Whether all compared assignments agree with the corrected mechanism; False if none was compared."""
        return self.judge is not None and bool(self.judge.residuals) and not self.judge.failing()

    @property
    def rank(self) -> tuple[int, bool, bool, int]:
        """Sort key; the best combination has the largest key. Evidence in the CAD comes before agreement of rows."""
        wrong = _WRONG_ROWS_WITHOUT_MECHANISM
        if self.judge is not None:
            wrong = len(self.judge.failing())
        return _evidence_score(self.suspects), self.closes, self.agrees, -wrong


def correct(
    formula: Formula,
    cad: CadModel,
    judge_of: Callable[[ReferenceModel], Judge],
    progress: StepProgress = silent_step,
) -> CorrectedCad | None:
    """Find the faults of the CAD and judge the rows with the corrected CAD; None if the parts of every joint meet.

    Lengths declared in the description are evidence. `judge_of` returns the judge of the rows for a mechanism.
    """
    findings = findings_on_joints(cad)
    if not findings:
        return None
    lengths: dict[str, float] = {}
    for parameter in formula.parameters:
        lengths[parameter.name] = float(parameter.value)
    all_faults = faults(cad, lengths)
    located = [fault for fault in all_faults if fault.suspects]
    corrections: list[_Correction] = []
    if located:
        corrections = _corrections(cad, located, judge_of, progress)
    best = _best_correction(corrections)
    chosen: dict[tuple[str, ...], Suspect] = {}
    for fault, suspect in zip(located, best.suspects, strict=False):
        chosen[fault.joints] = suspect
    parts: list[FaultyPart] = []
    for fault in all_faults:
        parts.append(_faulty_part(fault, findings, chosen.get(fault.joints), best, corrections))
    # A fault without a suspect stays in the corrected CAD, so that agreement with it proves nothing.
    agrees = best.agrees and len(located) == len(all_faults)
    return CorrectedCad(findings, tuple(parts), best.model, best.judge, agrees)


def _corrections(
    cad: CadModel,
    located: Sequence[FrameMismatch],
    judge_of: Callable[[ReferenceModel], Judge],
    progress: StepProgress,
) -> list[_Correction]:
    """Correct combinations of parts, one suspect for each fault, those with the most evidence in the CAD first."""
    suspects_of_faults = [fault.suspects for fault in located]
    combinations = product(*suspects_of_faults)
    choices = sorted(islice(combinations, _MOST_RANKED_COMBINATIONS), key=_evidence_score, reverse=True)
    best_score = _evidence_score(choices[0])
    corrections: list[_Correction] = []
    some_agrees = False
    for i, suspects in enumerate(choices[:_MOST_COMBINATIONS]):
        # Less evidence is enough only as long as no combination makes every row agree.
        if _evidence_score(suspects) < best_score and some_agrees:
            break
        progress(i / min(_MOST_COMBINATIONS, len(choices)))
        correction = _corrected(cad, suspects, judge_of)
        some_agrees |= correction.agrees
        corrections.append(correction)
    return corrections


def _best_correction(corrections: Sequence[_Correction]) -> _Correction:
    """Return the best combination: of those with which every row agrees, if there are any, otherwise of all."""
    agreeing = _agreeing_corrections(corrections)
    return max(agreeing or corrections, default=_Correction(()), key=lambda correction: correction.rank)


def _agreeing_corrections(corrections: Sequence[_Correction]) -> list[_Correction]:
    """Return the combinations with which every compared row agrees."""
    return [correction for correction in corrections if correction.agrees]


def _evidence_score(suspects: Sequence[Suspect]) -> int:
    """Return how much evidence in the CAD there is against suspected parts together."""
    score = 0
    for suspect in suspects:
        score += suspect.score
    return score


def findings_on_joints(cad: CadModel) -> tuple[Finding, ...]:
    """Return the findings on joints whose parts do not meet in the CAD."""
    findings = [finding for finding in cad.findings if finding.code in MISMATCH_CODES]
    return tuple(findings)


def _corrected(cad: CadModel, suspects: Sequence[Suspect], judge_of: Callable[[ReferenceModel], Judge]) -> _Correction:
    """Return the CAD with the suspected parts corrected, assembled and judged."""
    faces = dict(cad.measured)
    given_positions: dict[tuple[str, str], Array] = {}
    for suspect in suspects:
        given_positions |= suspect.given
        measured = suspect.faces[suspect.body]
        faces_of_body = dict(faces[suspect.body])
        for name, face in measured.items():
            # Without named features, the whole part is in the wrong place.
            if not suspect.features or name in suspect.features:
                faces_of_body[name] = face
        faces[suspect.body] = faces_of_body
    try:
        model = ReferenceModel(frames.moved(cad.mechanism, cad.description, faces, given_positions))
        return _Correction(tuple(suspects), model, judge_of(model))
    except TwinError:  # the mechanism cannot be assembled, or can hardly be moved
        return _Correction(tuple(suspects))


def _faulty_part(
    fault: FrameMismatch,
    findings: Sequence[Finding],
    chosen: Suspect | None,
    best: _Correction,
    corrections: Sequence[_Correction],
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
    told_by, why, undecided = _evidence_between_suspects(chosen, others, best, corrections)
    alternatives: list[str] = []
    for suspect in undecided:
        alternatives.append(_suspect_text(suspect))
    text = f"{head}: {_suspect_text(chosen)} is wrong"
    if alternatives:
        text += f", or {', or '.join(alternatives)}; CAD and rows do not determine which"
    elif why:
        text += f" ({'; '.join(why[:2])})"
    return FaultyPart(fault.joints, chosen.body, chosen.features, told_by, tuple(why), tuple(alternatives), text)


def _evidence_between_suspects(
    chosen: Suspect, others: list[Suspect], best: _Correction, corrections: Sequence[_Correction]
) -> tuple[str, list[str], list[Suspect]]:
    """Return (kind of evidence as in `FaultyPart.told_by`, evidence as text, alternative parts)."""
    why = list(chosen.for_it)
    for suspect in others:
        why += suspect.against_it
    if not others:
        return "joints", [*why, "the other part of the joint has no gaps at further joints"], []
    other_may_close = False
    undecided: list[Suspect] = []  # those with which the rows agree, as far as is known
    for suspect in others:
        # A part with which no combination was tried may also be the faulty one.
        may_close = True
        may_agree = True
        with_suspect = [correction for correction in corrections if suspect in correction.suspects]
        if with_suspect:
            may_close = any(correction.closes for correction in with_suspect)
            may_agree = bool(_agreeing_corrections(with_suspect))
        other_may_close |= may_close
        if may_agree:
            undecided.append(suspect)
    scores_of_others = [suspect.score for suspect in others]
    has_most_evidence = max(scores_of_others) < chosen.score
    if has_most_evidence and (best.agrees or not _agreeing_corrections(corrections)):
        return "drawing", why, []
    if best.closes and not other_may_close:
        return "loops", [*why, "the loops close at every pose only if this part is corrected"], []
    if best.agrees and not undecided:
        return "rows", [*why, "every row agrees only if this part is corrected"], []
    if not best.agrees:
        return "", why, others
    return "", why, undecided


def _suspect_text(suspect: Suspect) -> str:
    """Return the suspected part as text: numbers of the description, a placement, or features of a body."""
    if suspect.given:
        joints = [joint for joint, _ in suspect.given]
        return f"'{suspect.body}' (the numbers for the position of {', '.join(joints)} on this body)"
    if not suspect.features:
        return f"the placement of '{suspect.body}' in the CAD"
    return f"'{suspect.body}' at its {' and '.join(suspect.features)}"
