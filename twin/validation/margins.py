"""Margins along a path: joint limits, reach, singularity measures, and conditioning of the mechanism's Jacobians.

The margins of the equations are also checked with the mechanism, see `twin.reference.margin_zeros`.
"""

from __future__ import annotations

import numpy as np

from twin.core.findings import Finding, Kind
from twin.core.quantity import Quantity, moved
from twin.core.spatial import Array, Index
from twin.core.units import DEG, MM, display_unit
from twin.kinematics import Kinematics
from twin.kinematics.margins import Margins
from twin.model.mechanism import Mechanism
from twin.planning.path_kinematics import MotorLimits, PathKinematics
from twin.planning.trajectory import Trajectory
from twin.reference import ReferenceModel, SolvedSamples
from twin.reference.conditioning import conditioning
from twin.reference.loops import LENGTH_SCALE
from twin.reference.margin_zeros import ZeroCheck, disagreements, summary
from twin.validation.equations_comparison import EquationsComparison
from twin.validation.residual_rows import SampleClock, Tolerances

SINGULAR_CONDITIONING = 1e-6
"""Conditioning (0: singular, 1: best) below which a Jacobian of the mechanism counts as singular."""

_JUMP_RATIO = 8.0
"""A step above this multiple of both neighbouring steps is a jump: between equal times, smooth motions change less."""

_LARGEST_PLAIN_TURN = 2 * DEG
"""Step in rad that is no jump, however small its neighbours are, as at the beginning of a motion."""

_LARGEST_PLAIN_SLIDE = 2 * MM
"""Step in m that is no jump, however small its neighbours are."""

_BECOMES_SINGULAR = Kind(
    "singularity.mechanism",
    "disagreement",
    "plan the path at a larger distance from this pose: the assembly mode may change there",
)
_BRANCH_JUMPS = Kind(
    "branch.jump", "disagreement", "plan the path at a larger distance from this pose", word="expected at most"
)


def margin_texts(
    trajectory: Trajectory, mechanism: Mechanism, paths: PathKinematics, clock: SampleClock
) -> dict[str, str]:
    """Return texts with minimum margin and time, by name of the joint, motor, gap, reach or singularity measure.

    The joint limits are from the mechanism, all other quantities from `paths`.
    """
    texts: dict[str, str] = {}
    for j, joint in enumerate(mechanism.active):
        if joint.limits is not None:
            texts[f"joint {joint.name}"] = _joint_margin(trajectory.q[:, j], joint.limits, joint.is_angle, clock)
    for i, name in enumerate(paths.motors.names):
        texts[f"motor {name}"] = _motor_margin(trajectory, paths.motors, i, clock)
    for gap in paths.gaps:
        distance = np.abs(trajectory.q[:, gap.i] - trajectory.q[:, gap.j])
        k = int(np.argmin(distance))
        texts[f"gap {gap.name}"] = f"{distance[k] / MM:.2f} mm (required {gap.smallest / MM:g} mm), {clock.when(k)}"
    for name, values in paths.reach(trajectory.Ts_base_tool).items():
        k = int(np.argmin(values))
        texts[f"reach {name}"] = f"{values[k] / MM:.2f} mm, {clock.when(k)}"
    for name, values in paths.singularity(trajectory.Ts_base_tool, trajectory.q).items():
        k = int(np.argmin(np.abs(values)))
        alarm = ""
        if paths.alarm(name):
            alarm = f", alarm below {paths.alarm(name):g}"
        texts[f"singularity {name}"] = f"{values[k]:.4f}{alarm}, {clock.when(k)}"
    if paths.branch is not None:
        modes = paths.branch(trajectory.Ts_base_tool, trajectory.q)
        first_change = int(np.argmax(modes != modes[0]))
        if first_change == 0:
            texts["working mode"] = f"{modes[0]} throughout"
        else:
            texts["working mode"] = f"{modes[0]}, then {modes[first_change]}, {clock.when(first_change)}"
    return texts


def _joint_margin(q: Array, limits: tuple[float, float], is_angle: bool, clock: SampleClock) -> str:
    """Return a text with the smallest distance of joint values q (k,) from the limits."""
    low, high = limits
    to_low = q - low
    to_high = high - q
    k_low = int(np.argmin(to_low))
    k_high = int(np.argmin(to_high))
    end = "lower"
    k = k_low
    distance = to_low[k_low]
    if to_high[k_high] < distance:
        end = "upper"
        k = k_high
        distance = to_high[k_high]
    unit, scale = display_unit(is_angle)
    share = 100 * distance / (high - low)
    return f"{distance / scale:.2f} {unit} to its {end} limit ({share:.0f} % of its range), {clock.when(k)}"


def _motor_margin(trajectory: Trajectory, motors: MotorLimits, i: int, clock: SampleClock) -> str:
    """Return a text with the smallest distance of motor i from its limits, if it has any, and its largest speed."""
    unit, scale = motors.unit(i)
    m = trajectory.q @ motors.rows[i]
    distance = np.minimum(m - motors.lower[i], motors.upper[i] - m)
    nearest = int(np.argmin(distance))
    position = ""
    if np.isfinite(distance[nearest]):
        position = f"{distance[nearest] / scale:.2f} {unit} to a limit, {clock.when(nearest)}; "
    rates = np.abs(trajectory.qd @ motors.rows[i])
    fastest = int(np.argmax(rates))
    max_speed = motors.max_speed[i] / scale
    limit = ""
    if np.isfinite(max_speed):
        limit = f" (limit {max_speed:.4g})"
    return f"{position}maximum speed {rates[fastest] / scale:.4g}{limit} {unit}/s, {clock.when(fastest)}"


def mechanism_margins(
    model: ReferenceModel, posed: SolvedSamples, rows: Index, clock: SampleClock
) -> tuple[dict[str, str], list[Finding], dict[str, Array]]:
    """Return (facts as text, findings, curves) on the mechanism's distance from singularities, without the equations.

    While the Jacobians have full rank, the passive joints follow the driven joints continuously, and the assembly mode
    cannot change. The assembly mode therefore counts as constant if, at the compared samples, the Jacobians have full
    rank and no passive joint jumps. `rows` are the trajectory indices of the samples in `posed`.
    """
    conditions = conditioning(model, posed.x, LENGTH_SCALE)
    at = clock.at(rows)
    facts: dict[str, str] = {}
    findings: list[Finding] = []
    for name, values, words in (
        ("mechanism, tool at rest (type 1)", conditions.type1, "the joints move and the tool is at rest"),
        ("mechanism, drives at rest (type 2)", conditions.type2, "the tool moves while every drive is at rest"),
    ):
        if np.isnan(values).all():  # the tool is on a body that never moves
            continue
        k = int(np.nanargmin(values))
        facts[name] = f"{values[k]:.4f} (0: singular, 1: best), {at.when(k)}"
        if values[k] < SINGULAR_CONDITIONING:
            what = f"the mechanism becomes singular ({words}): conditioning (0: singular, 1: best)"
            findings.append(
                _BECOMES_SINGULAR(
                    model.mechanism.name, what, Quantity(values[k]), SINGULAR_CONDITIONING, when=at.when(k)
                )
            )
    findings += _passive_jumps(model, posed, at)
    return facts, findings, {"conditioning.type1": conditions.type1, "conditioning.type2": conditions.type2}


def _passive_jumps(model: ReferenceModel, posed: SolvedSamples, at: SampleClock) -> list[Finding]:
    """Return a finding for each passive joint with an unusually large step between neighbouring samples.

    Steps in which a driven joint also jumps (samples far apart) are skipped.
    """
    findings: list[Finding] = []
    driven_steps = np.abs(np.diff(posed.q, axis=0))
    driven_floors = [_largest_plain_step(joint.is_angle) for joint in model.mechanism.active]
    driven_jumps = np.any(driven_steps > _usual_steps(driven_steps) + driven_floors, axis=1)
    for joint in model.mechanism.passive:
        q = posed.q_passive[joint.name]
        if joint.is_angle:
            q = np.unwrap(q)
        if len(q) < 4:  # three steps: one, with a neighbour on either side
            continue
        steps = np.abs(np.diff(q))
        usual = _usual_steps(steps)
        excess = np.where(driven_jumps, -np.inf, steps - usual)
        k = int(np.argmax(excess))
        if driven_jumps[k] or steps[k] <= usual[k] + _largest_plain_step(joint.is_angle):
            continue
        what = f"passive joint {joint.name} jumps between two samples: the mechanism changes its assembly mode"
        size = moved(steps[k], joint.is_angle)
        limit = moved(usual[k], joint.is_angle)
        findings.append(_BRANCH_JUMPS(joint.name, what, size, limit, when=at.when(k + 1)))
    return findings


def _largest_plain_step(is_angle: bool) -> float:
    """Return a step in rad or m that is never a jump, however small its neighbours are."""
    if is_angle:
        return _LARGEST_PLAIN_TURN
    return _LARGEST_PLAIN_SLIDE


def _usual_steps(steps: Array) -> Array:
    """Return an upper limit for each step (k, ...): `_JUMP_RATIO` times the larger neighbouring step."""
    before = np.concatenate([steps[:1], steps[:-1]])
    after = np.concatenate([steps[1:], steps[-1:]])
    return _JUMP_RATIO * np.maximum(before, after)


def check_equations_margins(
    kin: Kinematics, model: ReferenceModel, tolerances: Tolerances, comparison: EquationsComparison
) -> None:
    """Check reach, singularity measures and aspects of the equations, unless a row of `comparison` disagrees."""
    run = comparison.posed
    formula = kin.formula
    if run is None or not (formula.reach or formula.measures or formula.aspects):
        return
    heading = "reach, singularity measures, aspects"
    if _equations_disagree(comparison):
        comparison.facts[heading] = {"rows judged": "not checked, because other rows disagree"}
        return
    is_angle = {joint.name: joint.is_angle for joint in model.mechanism.joints}
    error = tolerances.position
    margins = Margins(kin, is_angle, tuple(run.points), error)
    rows = ZeroCheck(model, margins, run.x, error).judge()
    comparison.facts[heading] = {"rows judged": summary(rows)}
    comparison.findings += disagreements(rows)


def _equations_disagree(comparison: EquationsComparison) -> bool:
    """Return whether the equations disagree with the mechanism in a row, or give no joint values."""
    for row in comparison.residuals:
        if row.pair == "A-B" and not row.agrees:
            return True
    return any(
        finding.code.startswith("driven.") and finding.severity == "disagreement" for finding in comparison.findings
    )
