"""Check the mechanism along a trajectory: distance from the RCM, limits of all joints, timing."""

from __future__ import annotations

import numpy as np

from twin.core import spatial
from twin.core.findings import Finding, Kind
from twin.core.quantity import moved
from twin.core.units import DEG, display_unit
from twin.planning.check import check
from twin.validation.case import Case
from twin.validation.compare import Comparison
from twin.validation.consistent import fixes
from twin.validation.margins import margins, of_mechanism
from twin.validation.plausible import wide_limits
from twin.validation.retimed import retimed
from twin.validation.rows import row
from twin.validation.shaft import between_samples
from twin.validation.timing import timing

_MECHANISM = Kind("rcm.mechanism", "disagreement", word="tolerance")
_PASSIVE = Kind("limit.passive", "disagreement", "change the protocol, or correct the limit of the joint", word="")

_NO_CLOCK = ("timing.clock", "timing.phases")
"""Codes of findings on times and phases, without which rates cannot be computed."""


def about_rcm(case: Case, out: Comparison) -> None:
    """Check the distance of the driven mechanism's shaft from the RCM, in each phase with an RCM."""
    run, trajectory, mechanism = out.driven, case.trajectory, case.cad.mechanism
    if run is None or any(r.consequence_of for r in out.residuals if r.quantity == "tool"):
        return
    Ts = run.Ts_base_tool @ mechanism.frame_in_tool(trajectory.frame)
    for span in trajectory.phases:
        if span.rcm is None:
            continue
        rows = np.arange(span.start, span.stop + 1)
        axis = Ts[rows, :3, :3] @ trajectory.shaft_axis
        missed = spatial.point_to_line(span.rcm, Ts[rows, :3, 3], axis)
        enforced = span.rcm_mode != "monitored"
        tolerance = case.tolerances.rcm if enforced else case.protocol.tolerances.rcm
        note = f"{'enforced' if enforced else 'monitored'}, on the mechanism driven by the equations"
        r = row("B", "rcm", span.name, "m", missed, tolerance, case.clock.at(rows), note=note)
        if enforced:
            when = f"{span.name}, t = {r.t:.2f} s"
            out.judge(r, _MECHANISM, "the mechanism's shaft misses the enforced RCM", "RCM", when=when)
        else:
            out.residuals.append(r)


def passive_limits(case: Case, out: Comparison) -> None:
    """Check the limits of passive joints: range of the coordinate, or cone angle of a spherical joint."""
    run, model = out.posed, case.model
    joints = model.mechanism.limited
    if run is None or not joints:
        return
    links = model.link_poses(run.x)
    at = case.clock.at(out.coarse)
    left: dict[str, str] = {}
    for joint in joints:
        if joint.cone is not None:
            margin = -joint.beyond(links[joint.parent], links[joint.child])
            unit, scale = "deg", DEG
        elif joint.name in run.q_passive and joint.limits is not None:
            q = run.q_passive[joint.name]
            margin = np.minimum(q - joint.limits[0], joint.limits[1] - q)
            unit, scale = display_unit(joint.is_angle)
        else:
            continue
        k = int(np.argmin(margin))
        when = at.when(k)
        left[joint.name] = f"{margin[k] / scale:.1f} {unit} left, {when}"
        if margin[k] < 0:
            beyond = moved(-margin[k], joint.is_angle)
            what = f"passive joint {joint.name} is {beyond} beyond its limit"
            out.findings.append(_PASSIVE(joint.name, what, beyond, 0.0, when=when))
    out.facts["limits of passive joints"] = left


def passage(case: Case, out: Comparison) -> None:
    """Check the RCM between samples, and the distance of the mechanism from singularities."""
    if out.driven is not None and not any(r.consequence_of for r in out.residuals if r.quantity == "tool"):
        between_samples(case.model, case.trajectory, case.protocol.tolerances.rcm, out, case.clock)
    if out.posed is not None:
        facts, found, curves = of_mechanism(case.model, out.posed, out.coarse, case.clock)
        out.facts["margins along the path"] = facts
        out.findings += found
        out.series |= curves


def of_protocol(case: Case, out: Comparison) -> list[Finding]:
    """Add facts on the motion to `out`; return findings of the planner, and of the checks that use only the samples."""
    trajectory, mechanism = case.trajectory, case.cad.mechanism
    facts, found = timing(trajectory, mechanism, case.protocol)
    out.facts["timing, from the samples alone"] = facts
    if not any(f.code in _NO_CLOCK for f in found):
        rows, facts, again = retimed(trajectory, mechanism, case.protocol)
        out.residuals += rows
        out.facts["timing of each phase, by two solvers"] = facts
        found += again
    said = [*trajectory.findings, *wide_limits(mechanism)]
    if case.paths is None or any(f.code in _NO_CLOCK for f in found):
        return [*said, *found]
    # A trajectory may be older than the robot or come from another program, so its own findings are recomputed.
    said += [f for f in check(trajectory, case.protocol, case.paths) if f not in said]
    left = margins(trajectory, mechanism, case.paths, case.clock)
    out.facts["margins along the path"] = left | out.facts.get("margins along the path", {})
    ways, notes = fixes(case.protocol, trajectory, case.paths, mechanism.frame_in_tool(trajectory.frame))
    if ways:
        out.facts["ways to keep the RCM"] = ways
    return [*said, *found, *notes]
