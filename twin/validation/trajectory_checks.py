"""Check the mechanism along a trajectory: distance from the RCM and from trocars, limits of all joints, timing."""

from __future__ import annotations

import numpy as np

from twin.core import spatial
from twin.core.findings import Finding, Kind
from twin.core.quantity import moved
from twin.core.units import DEG, display_unit
from twin.model.mechanism import Mechanism
from twin.planning.check import check
from twin.validation.case import Case
from twin.validation.checked_plan import retimed
from twin.validation.equations_comparison import EquationsComparison
from twin.validation.margins import margin_texts, mechanism_margins
from twin.validation.rcm_between_samples import between_samples
from twin.validation.rcm_fixes import rcm_fixes
from twin.validation.residual_rows import row
from twin.validation.sampled_timing import check_rates

LARGEST_PLAUSIBLE_TURN = 8 * np.pi
"""Range in rad of an angular joint above which its limits are probably in a wrong unit."""

LARGEST_PLAUSIBLE_SLIDE = 4.0
"""Range of a sliding joint, divided by the robot's size, above which its limits are probably in a wrong unit."""

_RCM_MISSED = Kind("rcm.mechanism", "disagreement", word="tolerance")
_SHAFT_MISSES_TROCAR = Kind(
    "rcm.trocar", "disagreement", "correct the frames of the trocar's joints or of the instrument", word="tolerance"
)
_RANGE_IMPLAUSIBLE = Kind(
    "limit.implausible", "disagreement", "check the unit of its limits; omit the limits of a joint without end stops"
)
_PASSIVE_LIMIT_EXCEEDED = Kind(
    "limit.passive", "disagreement", "change the protocol, or correct the limit of the joint", word=""
)

_CLOCK_CODES = ("timing.clock", "timing.phases")
"""Codes of findings on times and phases, without which rates cannot be computed."""


def check_rcm(case: Case, comparison: EquationsComparison) -> None:
    """Check the distance of the driven mechanism's shaft from the RCM, in each phase with an RCM."""
    run = comparison.driven
    trajectory = case.trajectory
    if run is None or _tool_follows(comparison):
        return
    Ts = run.Ts_base_tool @ case.cad.mechanism.frame_in_tool(trajectory.frame)
    for span in trajectory.phases:
        if span.rcm is None:
            continue
        rows = np.arange(span.start, span.stop + 1)
        axis = Ts[rows, :3, :3] @ trajectory.shaft_axis
        distance = spatial.point_to_line(span.rcm, Ts[rows, :3, 3], axis)
        enforced = span.rcm_mode != "monitored"
        if enforced:
            tolerance = case.tolerances.rcm
            note = "enforced, on the mechanism driven by the equations"
        else:
            tolerance = case.protocol.tolerances.rcm
            note = "monitored, on the mechanism driven by the equations"
        residual = row(
            "B",
            "rcm",
            span.name,
            unit="m",
            differences=distance,
            tolerance=tolerance,
            clock=case.clock.at(rows),
            note=note,
        )
        if enforced:
            when = f"{span.name}, t = {residual.t:.2f} s"
            comparison.judge(residual, _RCM_MISSED, "the mechanism's shaft misses the enforced RCM", "RCM", when=when)
        else:
            comparison.residuals.append(residual)


def check_shafts_through_trocars(case: Case, comparison: EquationsComparison) -> None:
    """Check the distance of each shaft axis from its trocar along the motion."""
    run = comparison.posed
    mechanism = case.cad.mechanism
    shafts = {}
    for name in mechanism.trocars:
        shaft = mechanism.shaft_through(name)
        if shaft is not None:
            shafts[name] = shaft
    if run is None or not shafts:
        return
    links = case.model.link_poses(run.x)
    tolerance = case.protocol.tolerances.rcm
    times = case.clock.at(comparison.coarse)
    for name, shaft in shafts.items():
        T = links[shaft.body] @ shaft.T_body_frame
        # z of the frame is along the shaft
        distances = spatial.point_to_line(mechanism.trocar_at(name), T[:, :3, 3], T[:, :3, 2])
        residual = row(
            "B",
            "rcm",
            name,
            unit="m",
            differences=distances,
            tolerance=tolerance,
            clock=times,
            note=f"{shaft.body} in trocar {name}",
        )
        comparison.judge(residual, _SHAFT_MISSES_TROCAR, f"{shaft.body} misses trocar '{name}'")


def _tool_follows(comparison: EquationsComparison) -> bool:
    """Return whether the tool pose of the driven mechanism is wrong because of an equation that is already named."""
    return any(residual.quantity == "tool" and residual.consequence_of for residual in comparison.residuals)


def check_passive_limits(case: Case, comparison: EquationsComparison) -> None:
    """Check the limits of passive joints: range of the coordinate, or cone angle of a spherical joint."""
    run = comparison.posed
    joints = case.model.mechanism.limited
    if run is None or not joints:
        return
    links = case.model.link_poses(run.x)
    clock = case.clock.at(comparison.coarse)
    margins_left: dict[str, str] = {}
    for joint in joints:
        if joint.cone is not None:
            margin = -joint.beyond(links[joint.parent], links[joint.child])
            unit = "deg"
            scale = DEG
        elif joint.name in run.q_passive and joint.limits is not None:
            low, high = joint.limits
            q = run.q_passive[joint.name]
            margin = np.minimum(q - low, high - q)
            unit, scale = display_unit(joint.is_angle)
        else:
            continue
        k = int(np.argmin(margin))
        when = clock.when(k)
        margins_left[joint.name] = f"{margin[k] / scale:.1f} {unit} left, {when}"
        if margin[k] < 0:
            beyond = moved(-margin[k], joint.is_angle)
            what = f"passive joint {joint.name} is {beyond} beyond its limit"
            comparison.findings.append(_PASSIVE_LIMIT_EXCEEDED(joint.name, what, beyond, 0.0, when=when))
    comparison.facts["limits of passive joints"] = margins_left


def wide_limits(mechanism: Mechanism) -> list[Finding]:
    """Return a finding for each driven joint with an implausibly wide range."""
    size = _size_of_robot(mechanism)
    findings = []
    for joint in mechanism.active:
        if joint.limits is None:
            continue
        low, high = joint.limits
        width = high - low
        most = LARGEST_PLAUSIBLE_TURN if joint.is_angle else LARGEST_PLAUSIBLE_SLIDE * size
        if most > 0 and width > most:
            text = f"joint {joint.name} has an implausibly wide range"
            range_width = moved(width, joint.is_angle)
            findings.append(_RANGE_IMPLAUSIBLE(joint.name, text, range_width, moved(most, joint.is_angle)))
    return findings


def _size_of_robot(mechanism: Mechanism) -> float:
    """Return the diagonal in m of the box around all joint origins in the rest pose; 0 without joints."""
    places = []
    for joint in mechanism.joints:
        if joint.parent in mechanism.rest:
            T_base_joint = mechanism.rest[joint.parent] @ joint.T_parent_joint
            places.append(T_base_joint[:3, 3])
    if not places:
        return 0.0
    return float(np.linalg.norm(np.ptp(np.array(places), axis=0)))


def check_between_samples(case: Case, comparison: EquationsComparison) -> None:
    """Check the RCM between samples, and the distance of the mechanism from singularities."""
    if comparison.driven is not None and not _tool_follows(comparison):
        between_samples(
            case.model, case.trajectory, tolerance=case.protocol.tolerances.rcm, comparison=comparison, clock=case.clock
        )
    if comparison.posed is not None:
        facts, findings, curves = mechanism_margins(case.model, comparison.posed, comparison.coarse, case.clock)
        comparison.facts["margins along the path"] = facts
        comparison.findings += findings
        comparison.series |= curves


def check_protocol(case: Case, comparison: EquationsComparison) -> list[Finding]:
    """Add facts on the motion to `comparison`; return findings of the planner, and of the checks by samples alone."""
    trajectory = case.trajectory
    mechanism = case.cad.mechanism
    facts, from_samples = check_rates(trajectory, mechanism, case.protocol)
    comparison.facts["timing, from the samples alone"] = facts
    has_clock = not any(finding.code in _CLOCK_CODES for finding in from_samples)
    if has_clock:
        rows, facts, by_second_solver = retimed(trajectory, mechanism, case.protocol)
        comparison.residuals += rows
        comparison.facts["timing of each phase, by two solvers"] = facts
        from_samples += by_second_solver
    of_plan = [*trajectory.findings, *wide_limits(mechanism)]
    if case.paths is None or not has_clock:
        return [*of_plan, *from_samples]
    # A trajectory may be older than the robot or come from another program, so its own findings are recomputed.
    added = []
    for finding in check(trajectory, case.protocol, case.paths):
        if finding not in of_plan:
            added.append(finding)
    of_plan += added
    along_path = margin_texts(trajectory, mechanism, case.paths, case.clock)
    comparison.facts["margins along the path"] = along_path | comparison.facts.get("margins along the path", {})
    ways, notes = rcm_fixes(case.protocol, trajectory, case.paths, mechanism.frame_in_tool(trajectory.frame))
    if ways:
        comparison.facts["ways to keep the RCM"] = ways
    return [*of_plan, *from_samples, *notes]
