"""Sample the states of the mechanism at which a formula is judged: around its postures, or all over the joint range.

If the CAD is noisy, rows differ there by its noise. The features are given further random errors of the size that the
gaps of the joints show: for small errors, a row changes as much by the further errors as it differs by those in the
CAD.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence

import numpy as np

from twin.cad import frames
from twin.cad.build import CadModel
from twin.cad.noise import Noise, with_noise
from twin.core.errors import AssemblyError, TwinError
from twin.core.progress import Progress, StepProgress, silent, silent_step
from twin.core.spatial import Array
from twin.formula.contract import Formula
from twin.kinematics import Kinematics, compile_formula
from twin.model.joint import Joint
from twin.reference import Assembly, ReferenceModel, SolvedSamples
from twin.reference.conditioning import conditioning
from twin.reference.loops import LENGTH_SCALE
from twin.reference.newton import minimise
from twin.validation.explain.equation_steps import Tolerance
from twin.validation.explain.reference_values import ReferenceValues, symbol_values
from twin.validation.explain.row_deviations import Judge, Residuals
from twin.validation.joint_range import range_errors
from twin.validation.residual_rows import Tolerances

SAMPLES = 24
"""Number of poses at which a formula is judged."""

_BOX_PART_OF_RANGE = 0.06
"""Half width of the box of joint values that is sampled around each posture, as a fraction of each joint's range."""

_MOST_POSTURES = 4
"""Maximum number of postures around which the mechanism is sampled: the first ones in the description."""

_FEWEST_STATES = 6
"""Minimum number of states with which a formula is judged, if the mechanism hardly moves."""

_BOX_FACTORS = (1.0, 0.5, 0.2, 0.05)
"""Parts of the box in which states are drawn one after the other, until there are enough that can be assembled."""

_ASSUMED_TURN = 0.5
"""Half range in rad that is assumed of a joint without limits."""

_ASSUMED_SLIDE = 0.1
"""Half range in m that is assumed of a sliding joint without limits."""

_WIDEST_TURN = 0.3
"""Maximum half width of the box in rad, for a joint with a long range."""

_WIDEST_SLIDE = 0.02
"""Maximum half width of the box in m, for a sliding joint with a long range."""

_LEAST_CONDITIONING_RATIO = 0.1
"""A posture is skipped as near a singularity if its conditioning is below this fraction of the best conditioning."""

_DRAWN_MECHANISMS = 12
"""Number of mechanisms with further random errors."""

_NOISE_SEED = 1
"""Seed of these errors: the same rows are explained by noise in every run."""

_LIMIT_IN_SIGMAS = 5.0
"""Differences up to so many standard deviations are explained by noise."""


def sample_states(
    model: ReferenceModel,
    samples: int = SAMPLES,
    seed: int = 7,
    progress: StepProgress = silent_step,
    regular: bool = False,
) -> SolvedSamples:
    """Return states of the mechanism around its first postures; without postures: around the rest poses.

    With `regular`, postures near a singularity, where several assembly modes meet, are skipped. The result has fewer
    than `samples` states, but at least `_FEWEST_STATES`, if the mechanism can take few of the drawn ones.

    Raises:
        TwinError: the mechanism can take fewer than `_FEWEST_STATES` of the drawn states.
    """
    mechanism = model.mechanism
    rng = np.random.default_rng(seed)
    low, high, half = _sampled_box(mechanism.active)
    starts = _start_states(model, regular)
    states: list[Array] = []
    for shrink in _BOX_FACTORS:
        for i, start in enumerate(starts):
            # The starts that are left share the samples that are missing.
            missing_count = (samples - len(states)) // (len(starts) - i)
            box = shrink * half
            q = start.q + box * rng.uniform(-1, 1, (missing_count, len(half)))
            states += _solved_states(model, np.clip(q, low, high), start)
            progress(len(states) / samples)
        if len(states) >= samples:
            break
    if len(states) < _FEWEST_STATES:
        raise TwinError(
            f"{mechanism.name}: the mechanism hardly moves near its postures, so there are no poses for the check"
        )
    return model.collect(np.array(states))


def _sampled_box(joints: Sequence[Joint]) -> tuple[Array, Array, Array]:
    """Return (lower limits, upper limits, half widths of the sampled box), each (n,), in m and rad.

    Limits may be infinite; the half widths are finite.
    """
    ranges: list[tuple[float, float]] = []
    most: list[float] = []
    for joint in joints:
        assumed = _ASSUMED_SLIDE
        longest = _WIDEST_SLIDE
        if joint.is_angle:
            assumed = _ASSUMED_TURN
            longest = _WIDEST_TURN
        ranges.append(joint.limits or (-assumed, assumed))
        most.append(longest)
    limits = np.array(ranges)
    half = np.minimum(_BOX_PART_OF_RANGE * np.ptp(limits, axis=1), most)
    return limits[:, 0], limits[:, 1], half


def _start_states(model: ReferenceModel, regular: bool) -> list[Assembly]:
    """Return the states around which the mechanism is sampled."""
    mechanism = model.mechanism
    starts: list[Assembly] = []
    for name in list(mechanism.postures)[:_MOST_POSTURES]:
        with contextlib.suppress(AssemblyError):
            starts.append(model.solve(np.asarray(mechanism.posture(name), float)))
    if not starts:
        starts = [model.home()]
    if not regular:
        return starts
    states = [start.x for start in starts]
    values = conditioning(model, np.array(states), LENGTH_SCALE).type1
    regular_starts: list[Assembly] = []
    for start, value in zip(starts, values, strict=True):
        if value >= _LEAST_CONDITIONING_RATIO * values.max():
            regular_starts.append(start)
    return regular_starts


def _solved_states(model: ReferenceModel, q: Array, start: Assembly) -> list[Array]:
    """Return the reachable states at joint values q (k, n), solved together or, if that fails, one by one."""
    if not len(q):
        return []
    try:
        return list(model.solve_many(q, start).x)
    except AssemblyError:
        states: list[Array] = []
        for joint_values in q:
            with contextlib.suppress(AssemblyError):
                states.append(model.solve(joint_values, start).x)
        return states


_MOST_STATES_OF_EACH = 12
"""Number of right and of wrong states at which equations are judged that are wrong in a part of the joint range."""


def sampled_values(
    formula: Formula,
    model: ReferenceModel,
    parameters: Mapping[str, float] | None = None,
    progress: Progress = silent,
    variants: Mapping[str, str] | str | None = None,
) -> ReferenceValues:
    """Return the mechanism's values of the formula's symbols at sampled poses.

    A redundant mechanism has many solutions for a pose. The formula is judged with two of them: the sampled solution,
    and the solution nearest to the formula's joint values. The solution with fewer wrong rows is returned.
    """
    states = sample_states(model, progress=lambda fraction: progress("sample the mechanism", fraction))
    if not (model.redundant and formula.has("inverse")):
        return symbol_values(formula, states, model, parameters)
    sampled = symbol_values(formula, sample_states(model, regular=True), model, parameters)
    try:
        kinematics = compiled_kinematics(formula, model, variants, parameters)
        q = kinematics.inverse_many(states.Ts_base_tool)
        nearest_states = model.run_poses(states.Ts_base_tool, near=np.where(np.isfinite(q), q, states.q))
    except TwinError:  # equations without a solution are reported row by row
        return sampled
    nearest = symbol_values(formula, nearest_states, model, parameters)
    wrong_at_nearest = len(Judge(formula, variants, nearest).failing())
    if not wrong_at_nearest:
        return nearest
    wrong_at_sampled = len(Judge(formula, variants, sampled).failing())
    if wrong_at_nearest < wrong_at_sampled:
        return nearest
    return sampled


def compiled_kinematics(
    formula: Formula,
    model: ReferenceModel,
    variants: Mapping[str, str] | str | None,
    parameters: Mapping[str, float] | None,
) -> Kinematics:
    """Return the compiled equations of a formula, with the joints of the mechanism that it does not name.

    Raises:
        TwinError: a symbol has no value, or equations are missing.
    """
    names = [joint.name for joint in formula.joints]
    extra_joints = model.mechanism.extra_joints(names)
    return compile_formula(formula, variants, parameters, extra_joints)


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
    try:
        kinematics = compiled_kinematics(formula, model, variants, parameters)
    except TwinError:  # a symbol without a value, which is explained row by row
        return None
    tolerances = Tolerances()
    if tolerance is not None:
        tolerances = Tolerances(tolerance.length, tolerance.angle)
    errors = range_errors(kinematics, model, tolerances, free_angles=False)
    is_wrong = errors.wrong(tolerances)
    wrong = np.flatnonzero(is_wrong)
    right = np.flatnonzero(errors.inside & errors.own & ~is_wrong)
    if not len(wrong):
        return None
    # The wrong states are spread over the range; with as many right ones, an edit must also keep what is right.
    stride = max(1, len(wrong) // _MOST_STATES_OF_EACH)
    spread = wrong[::stride][:_MOST_STATES_OF_EACH]
    chosen = np.concatenate([spread, right[:_MOST_STATES_OF_EACH]])
    run = model.collect(errors.drawn.run.x[chosen])
    judge = Judge(formula, variants, symbol_values(formula, run, model, parameters), tolerance)
    if not judge.failing():
        return None
    return judge


def noise_limits(noise: Noise, cad: CadModel, judge: Judge, parameters: Mapping[str, float] | None) -> dict[str, Array]:
    """Return the largest differences (k, 1) that noise of the CAD explains, by symbol, in units of the tolerance.

    `judge` has states of the mechanism of `cad`. At a state where a symbol has no value with some of the further errors
    (near the end of reach), its difference is not limited. A symbol that has a value in no draw is not in the result.
    """
    rng = np.random.default_rng(_NOISE_SEED)
    draws: list[Residuals] = []
    for _ in range(_DRAWN_MECHANISMS):
        draws.append(_residuals_with_errors(noise, cad, judge, parameters, rng))
    largest: dict[str, Array] = {}
    for place, residual in judge.residuals.items():
        changes: list[Array] = []
        for residuals in draws:
            if place in residuals:
                changes.append(residuals[place] - residual)
        if not changes:
            continue
        # About the judged mechanism, not about the mean of the draws: the errors in the CAD are one more draw.
        sigma_of_entries = np.sqrt(np.square(changes).mean(axis=0))
        # Entries of one value have similar errors; the largest of them is the most certain estimate.
        sigma = sigma_of_entries.max(axis=1, keepdims=True)
        known_sigma = np.where(np.isnan(sigma), np.inf, sigma)
        limit = np.maximum(1.0, _LIMIT_IN_SIGMAS * known_sigma)
        largest[place.symbol] = np.maximum(limit, largest.get(place.symbol, 1.0))
    return largest


def _residuals_with_errors(
    noise: Noise, cad: CadModel, judge: Judge, parameters: Mapping[str, float] | None, rng: np.random.Generator
) -> Residuals:
    """Return the residuals at the driven joint values of `judge`, for a mechanism with further errors."""
    faces = with_noise(cad.measured, noise.position, noise.direction, rng)
    model = ReferenceModel(frames.moved(cad.mechanism, cad.description, faces))
    assert judge.reference.run is not None
    X, _ = minimise(model.tree, judge.reference.run.x.copy(), model.loops_only, model.tree.passive)
    return judge.on(symbol_values(judge.formula, model.collect(X), model, parameters)).residuals
