"""Choose the states of the mechanism at which a formula is judged: near its postures, or all over the joint range."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from twin.core.errors import TwinError
from twin.formula.contract import Formula
from twin.kinematics import compile_formula
from twin.reference import ReferenceModel
from twin.validation.explain.equation_steps import Tolerance
from twin.validation.explain.reference_values import ReferenceValues, symbol_values
from twin.validation.explain.row_deviations import Judge
from twin.validation.explain.sampled_states import sample_states
from twin.validation.joint_range import range_errors
from twin.validation.rows import Tolerances

Progress = Callable[[str, float], None]
"""Called with a description of the current step and the fraction done."""

_MOST_OF_EACH = 12
"""Number of right and of wrong states at which equations are judged that are wrong in a part of the joint range."""


def known(
    formula: Formula,
    model: ReferenceModel,
    parameters: Mapping[str, float] | None = None,
    progress: Progress = lambda label, fraction: None,
    variants: Mapping[str, str] | str | None = None,
) -> ReferenceValues:
    """Return the mechanism's values of the formula's symbols at sampled poses.

    A redundant mechanism has many solutions for a pose. The formula is judged with two of them: the sampled solution,
    and the solution nearest to the formula's joint values. The solution with fewer wrong rows is returned.
    """
    run = sample_states(model, progress=lambda fraction: progress("sample the mechanism", fraction))
    if not (model.redundant and formula.has("inverse")):
        return symbol_values(formula, run, model, parameters)
    sampled = symbol_values(formula, sample_states(model, regular=True), model, parameters)
    try:
        extra_joints = model.mechanism.extra_joints(j.name for j in formula.joints)
        kin = compile_formula(formula, variants, parameters, extra_joints)
        q = kin.inverse_many(run.Ts_base_tool)
        near = model.run_poses(run.Ts_base_tool, near=np.where(np.isfinite(q), q, run.q))
    except TwinError:  # equations without a solution are reported row by row
        return sampled
    nearest = symbol_values(formula, near, model, parameters)
    wrong_at_nearest = len(Judge(formula, variants, nearest).failing())
    if not wrong_at_nearest:
        return nearest
    wrong_at_sampled = len(Judge(formula, variants, sampled).failing())
    if wrong_at_nearest < wrong_at_sampled:
        return nearest
    return sampled


def judge_over_range(
    formula: Formula,
    model: ReferenceModel,
    variants: Mapping[str, str] | str | None,
    parameters: Mapping[str, float] | None,
    tolerance: Tolerance | None,
) -> Judge | None:
    """Return a judge at states all over the joint range, if the equations are wrong at some of them; else None.

    States at which the inverse gives another solution of the same pose are left out: its rows differ, but are right.
    """
    extra_joints = model.mechanism.extra_joints(j.name for j in formula.joints)
    try:
        kin = compile_formula(formula, variants, parameters, extra_joints)
    except TwinError:  # a symbol without a value, which is explained row by row
        return None
    tolerances = Tolerances()
    if tolerance is not None:
        tolerances = Tolerances(tolerance.length, tolerance.angle)
    errors = range_errors(kin, model, tolerances, free_angles=False)
    is_wrong = errors.wrong(tolerances)
    wrong = np.flatnonzero(is_wrong)
    right = np.flatnonzero(errors.inside & errors.own & ~is_wrong)
    if not len(wrong):
        return None
    # As many right states as wrong ones, so that an edit must keep what is right.
    every = max(1, len(wrong) // _MOST_OF_EACH)
    wrong_ones = wrong[::every][:_MOST_OF_EACH]
    states = np.concatenate([wrong_ones, right[:_MOST_OF_EACH]])
    run = model.collect(errors.drawn.run.x[states])
    judge = Judge(formula, variants, symbol_values(formula, run, model, parameters), tolerance)
    if not judge.failing():
        return None
    return judge
