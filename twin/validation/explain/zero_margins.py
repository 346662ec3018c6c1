"""Check reach, singularity measures and aspects of a formula at the states of the mechanism where they are zero."""

from __future__ import annotations

from twin.kinematics import compile_formula
from twin.kinematics.margins import Margins
from twin.reference import ReferenceModel
from twin.reference.boundary import Boundary, Judged
from twin.validation.explain.row_deviations import Judge


def check_margins(judge: Judge, model: ReferenceModel, parameters: dict[str, float] | None = None) -> list[Judged]:
    """Return the result for each margin; none without samples of the mechanism, or without margins.

    `parameters` are values in SI units that replace those of the formula.
    """
    formula = judge.formula
    samples = judge.reference.run
    if samples is None:
        return []
    if not (formula.reach or formula.measures or formula.aspects):
        return []
    extra_joints = model.mechanism.extra_joints(j.name for j in formula.joints)
    kin = compile_formula(formula, judge.variants, parameters, extra_joints)
    is_angle = {j.name: j.is_angle for j in model.mechanism.joints}
    error = judge.tolerance.length
    margins = Margins(kin, is_angle, tuple(samples.points), error)
    boundary = Boundary(model, margins, samples.x, error)
    return boundary.judge()
