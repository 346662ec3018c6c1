"""Check reach, singularity measures and aspects of the equations with the mechanism; see `twin.reference.boundary`."""

from __future__ import annotations

from twin.core.findings import Finding
from twin.kinematics import Kinematics
from twin.kinematics.margins import Margins
from twin.reference import ReferenceModel
from twin.reference.boundary import Boundary, disagreements, summary
from twin.validation.compare import EquationsComparison
from twin.validation.rows import Tolerances


def measures(kin: Kinematics, model: ReferenceModel, tolerances: Tolerances, out: EquationsComparison) -> None:
    """Check reach, singularity measures and aspects of the equations; skip the check if a row of `out` disagrees."""
    run = out.posed
    formula = kin.formula
    if run is None or not (formula.reach or formula.measures or formula.aspects):
        return
    heading = "reach, singularity measures, aspects"
    if any(r.pair == "A-B" and not r.agrees for r in out.residuals) or _off(out.findings):
        out.facts[heading] = {"rows judged": "not checked, because other rows disagree"}
        return
    turns = {j.name: j.is_angle for j in model.mechanism.joints}
    error = tolerances.position
    rows = Boundary(model, Margins(kin, turns, tuple(run.points), error), run.x, error).judge()
    out.facts[heading] = {"rows judged": summary(rows)}
    out.findings += disagreements(rows)


def _off(findings: list[Finding]) -> bool:
    return any(f.code.startswith("driven.") and f.severity == "disagreement" for f in findings)
