"""Check reach, singularity measures and aspects of the equations with the mechanism; see `twin.reference.boundary`."""

from __future__ import annotations

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
    if _disagrees(out):
        out.facts[heading] = {"rows judged": "not checked, because other rows disagree"}
        return
    is_angle = {joint.name: joint.is_angle for joint in model.mechanism.joints}
    error = tolerances.position
    margins = Margins(kin, is_angle, tuple(run.points), error)
    rows = Boundary(model, margins, run.x, error).judge()
    out.facts[heading] = {"rows judged": summary(rows)}
    out.findings += disagreements(rows)


def _disagrees(out: EquationsComparison) -> bool:
    """Return whether the equations disagree with the mechanism in a row, or give no joint values."""
    for row in out.residuals:
        if row.pair == "A-B" and not row.agrees:
            return True
    return any(finding.code.startswith("driven.") and finding.severity == "disagreement" for finding in out.findings)
