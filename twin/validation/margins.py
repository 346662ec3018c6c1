"""What is left along a path: limits joint by joint, gaps, reach, singularities, and what the mechanism says itself."""

from __future__ import annotations

import numpy as np

from twin.core.findings import Finding
from twin.core.spatial import Array, Index
from twin.core.units import DEG, MM
from twin.model.mechanism import Mechanism
from twin.planning.trajectory import PathKinematics, Trajectory
from twin.reference import ReferenceModel, Run
from twin.reference.conditioning import conditioning
from twin.reference.loops import LENGTH_SCALE
from twin.validation.rows import Clock

SINGULAR = 1e-6
"""Conditioning of the mechanism below which its own Jacobian is singular in double precision."""


def margins(trajectory: Trajectory, mechanism: Mechanism, paths: PathKinematics, clock: Clock) -> dict[str, str]:
    """Return the least margin of each joint, gap, limb and singularity measure, and when; in words.

    Args:
        trajectory: where the joints are.
        mechanism: owner of the limits.
        paths: gaps, reach and singularity measures as planning uses them, evaluated anew at every sample.
        clock: of the trajectory.
    """
    out: dict[str, str] = {}
    for j, joint in enumerate(mechanism.active):
        if joint.limits is None:
            continue
        q = trajectory.q[:, j]
        sides = np.stack([q - joint.limits[0], joint.limits[1] - q])
        side, k = (int(i) for i in np.unravel_index(int(np.argmin(sides)), sides.shape))
        unit, scale = ("deg", DEG) if joint.is_angle else ("mm", MM)
        share = 100 * sides[side, k] / (joint.limits[1] - joint.limits[0])
        end = ("lower", "upper")[side]
        size = f"{sides[side, k] / scale:.2f} {unit} to its {end} limit ({share:.0f} % of its range)"
        out[f"joint {joint.name}"] = f"{size}, {_when(clock, k)}"
    for i, name in enumerate(paths.motors.names):
        m, (unit, scale) = trajectory.q @ paths.motors.rows[i], paths.motors.unit(i)
        sides = np.minimum(m - paths.motors.lower[i], paths.motors.upper[i] - m)
        rates = np.abs(trajectory.qd @ paths.motors.rows[i])
        k, fastest = int(np.argmin(sides)), int(np.argmax(rates))
        left = f"{sides[k] / scale:.2f} {unit} to a limit, {_when(clock, k)}; " if np.isfinite(sides[k]) else ""
        most = paths.motors.max_speed[i] / scale
        of = f" of {most:.4g}" if np.isfinite(most) else ""
        out[f"motor {name}"] = f"{left}at most {rates[fastest] / scale:.4g}{of} {unit}/s, {_when(clock, fastest)}"
    for gap in paths.gaps:
        apart = np.abs(trajectory.q[:, gap.i] - trajectory.q[:, gap.j])
        k = int(np.argmin(apart))
        out[f"gap {gap.name}"] = f"{apart[k] / MM:.2f} mm of {gap.smallest / MM:g} mm needed, {_when(clock, k)}"
    for name, values in paths.reach(trajectory.Ts_base_tool).items():
        k = int(np.argmin(values))
        out[f"reach {name}"] = f"{values[k] / MM:.2f} mm, {_when(clock, k)}"
    for name, values in paths.singularity(trajectory.Ts_base_tool, trajectory.q).items():
        k = int(np.argmin(np.abs(values)))
        alarm = f", alarm below {paths.alarm(name):g}" if paths.alarm(name) else ""
        out[f"singularity {name}"] = f"{values[k]:.4f}{alarm}, {_when(clock, k)}"
    if paths.branch is not None:
        labels = paths.branch(trajectory.Ts_base_tool, trajectory.q)
        k = int(np.argmax(labels != labels[0]))
        out["working mode"] = (
            f"{labels[0]} throughout" if not k else f"{labels[0]}, then {labels[k]}, {_when(clock, k)}"
        )
    return out


def of_mechanism(
    model: ReferenceModel, posed: Run, rows: Index, clock: Clock
) -> tuple[dict[str, str], list[Finding], dict[str, Array]]:
    """Return how near the mechanism itself comes to a singularity, what follows, and the curves.

    Its coordinates follow the drives continuously while its Jacobians keep their rank: the assembly branch cannot
    change then. So a rank that is kept at every compared sample, and coordinates that do not jump, rule a switch out
    without any word of the equations.

    Args:
        model: the mechanism.
        posed: its states, at the samples `rows` of the trajectory.
        rows: of `posed` in the trajectory.
        clock: of the trajectory.
    """
    found = conditioning(model, posed.x, LENGTH_SCALE)
    at = clock.at(rows)
    facts, findings = {}, []
    for name, values, words in (
        ("mechanism, tool stands (type 1)", found.stands, "the joints move and the tool stands still"),
        ("mechanism, drives stand (type 2)", found.moves, "the tool moves while every drive stands still"),
    ):
        k = int(np.argmin(values))
        facts[name] = f"{values[k]:.4f} of 1, {_when(at, k)}"
        if values[k] < SINGULAR:
            findings.append(
                Finding(
                    "singularity.mechanism",
                    "disagreement",
                    f"the mechanism becomes singular: {words}",
                    where=model.mechanism.name,
                    when=_when(at, k),
                    size=float(values[k]),
                    limit=SINGULAR,
                    suggestion="keep the path away from there; a branch may change",
                )
            )
    findings += _jumps(model, posed, at)
    return facts, findings, {"conditioning.type1": found.stands, "conditioning.type2": found.moves}


def _jumps(model: ReferenceModel, posed: Run, at: Clock) -> list[Finding]:
    """Say where a passive joint leaves the line through its neighbours by more than they differ themselves."""
    out = []
    for joint in model.mechanism.passive:
        q = np.unwrap(posed.q_passive[joint.name]) if joint.is_angle else posed.q_passive[joint.name]
        if len(q) < 4:
            continue
        steps = np.abs(np.diff(q))
        before = np.maximum(np.concatenate([steps[:1], steps[:-1]]), np.concatenate([steps[1:], steps[-1:]]))
        unit, scale, floor = ("deg", DEG, 2 * DEG) if joint.is_angle else ("mm", MM, 2 * MM)
        k = int(np.argmax(steps - 8 * before))
        if steps[k] > 8 * before[k] + floor:
            out.append(
                Finding(
                    "branch.jump",
                    "disagreement",
                    f"passive joint {joint.name} jumps by {steps[k] / scale:.3g} {unit} between samples that its "
                    "neighbours cross smoothly: the mechanism changes its assembly",
                    where=joint.name,
                    when=_when(at, k + 1),
                    size=float(steps[k] / scale),
                    unit=unit,
                    limit=float(8 * before[k] / scale),
                    suggestion="keep the path away from there",
                )
            )
    return out


def _when(clock: Clock, k: int) -> str:
    t = float(clock.t[k])
    return f"{clock.phase(t)}, t = {t:.2f} s"
