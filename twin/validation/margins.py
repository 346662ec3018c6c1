"""Margins along a path: joint limits, reach, singularity measures, and conditioning of the mechanism's Jacobians."""

from __future__ import annotations

import numpy as np

from twin.core.findings import Finding, Kind
from twin.core.quantity import Quantity, moved
from twin.core.spatial import Array, Index
from twin.core.units import DEG, MM, display_unit
from twin.model.mechanism import Mechanism
from twin.planning.trajectory import PathKinematics, Trajectory
from twin.reference import ReferenceModel, Run
from twin.reference.conditioning import conditioning
from twin.reference.loops import LENGTH_SCALE
from twin.validation.rows import Clock

SINGULAR = 1e-6
"""Conditioning (0: singular, 1: best) below which a Jacobian of the mechanism counts as singular."""

_SINGULAR = Kind(
    "singularity.mechanism",
    "disagreement",
    "plan the path at a larger distance from this pose: the assembly mode may change there",
)
_JUMP = Kind(
    "branch.jump", "disagreement", "plan the path at a larger distance from this pose", word="expected at most"
)


def margins(trajectory: Trajectory, mechanism: Mechanism, paths: PathKinematics, clock: Clock) -> dict[str, str]:
    """Return texts with minimum margin and time, by name of the joint, motor, gap, reach or singularity measure.

    The joint limits are from the mechanism, all other quantities from `paths`.
    """
    out: dict[str, str] = {}
    for j, joint in enumerate(mechanism.active):
        if joint.limits is None:
            continue
        q = trajectory.q[:, j]
        sides = np.stack([q - joint.limits[0], joint.limits[1] - q])
        side, k = (int(i) for i in np.unravel_index(int(np.argmin(sides)), sides.shape))
        unit, scale = display_unit(joint.is_angle)
        share = 100 * sides[side, k] / (joint.limits[1] - joint.limits[0])
        end = ("lower", "upper")[side]
        size = f"{sides[side, k] / scale:.2f} {unit} to its {end} limit ({share:.0f} % of its range)"
        out[f"joint {joint.name}"] = f"{size}, {clock.when(k)}"
    for i, name in enumerate(paths.motors.names):
        m, (unit, scale) = trajectory.q @ paths.motors.rows[i], paths.motors.unit(i)
        sides = np.minimum(m - paths.motors.lower[i], paths.motors.upper[i] - m)
        rates = np.abs(trajectory.qd @ paths.motors.rows[i])
        k, fastest = int(np.argmin(sides)), int(np.argmax(rates))
        left = f"{sides[k] / scale:.2f} {unit} to a limit, {clock.when(k)}; " if np.isfinite(sides[k]) else ""
        most = paths.motors.max_speed[i] / scale
        of = f" (limit {most:.4g})" if np.isfinite(most) else ""
        out[f"motor {name}"] = f"{left}maximum speed {rates[fastest] / scale:.4g}{of} {unit}/s, {clock.when(fastest)}"
    for gap in paths.gaps:
        apart = np.abs(trajectory.q[:, gap.i] - trajectory.q[:, gap.j])
        k = int(np.argmin(apart))
        out[f"gap {gap.name}"] = f"{apart[k] / MM:.2f} mm (required {gap.smallest / MM:g} mm), {clock.when(k)}"
    for name, values in paths.reach(trajectory.Ts_base_tool).items():
        k = int(np.argmin(values))
        out[f"reach {name}"] = f"{values[k] / MM:.2f} mm, {clock.when(k)}"
    for name, values in paths.singularity(trajectory.Ts_base_tool, trajectory.q).items():
        k = int(np.argmin(np.abs(values)))
        alarm = f", alarm below {paths.alarm(name):g}" if paths.alarm(name) else ""
        out[f"singularity {name}"] = f"{values[k]:.4f}{alarm}, {clock.when(k)}"
    if paths.branch is not None:
        labels = paths.branch(trajectory.Ts_base_tool, trajectory.q)
        k = int(np.argmax(labels != labels[0]))
        out["working mode"] = f"{labels[0]} throughout" if not k else f"{labels[0]}, then {labels[k]}, {clock.when(k)}"
    return out


def of_mechanism(
    model: ReferenceModel, posed: Run, rows: Index, clock: Clock
) -> tuple[dict[str, str], list[Finding], dict[str, Array]]:
    """Return (facts as text, findings, curves) on the mechanism's distance from singularities, without the equations.

    While the Jacobians have full rank, the passive joints follow the driven joints continuously, and the assembly mode
    cannot change. The assembly mode therefore counts as constant if, at the compared samples, the Jacobians have full
    rank and no passive joint jumps. `rows` are the trajectory indices of the samples in `posed`.
    """
    found = conditioning(model, posed.x, LENGTH_SCALE)
    at = clock.at(rows)
    facts, findings = {}, []
    for name, values, words in (
        ("mechanism, tool at rest (type 1)", found.stands, "the joints move and the tool is at rest"),
        ("mechanism, drives at rest (type 2)", found.moves, "the tool moves while every drive is at rest"),
    ):
        if np.isnan(values).all():  # the tool is on a body that never moves
            continue
        k = int(np.nanargmin(values))
        facts[name] = f"{values[k]:.4f} (0: singular, 1: best), {at.when(k)}"
        if values[k] < SINGULAR:
            findings.append(
                _SINGULAR(
                    model.mechanism.name,
                    f"the mechanism becomes singular ({words}): conditioning (0: singular, 1: best)",
                    Quantity(values[k]),
                    SINGULAR,
                    when=at.when(k),
                )
            )
    findings += _jumps(model, posed, at)
    return facts, findings, {"conditioning.type1": found.stands, "conditioning.type2": found.moves}


def _jumps(model: ReferenceModel, posed: Run, at: Clock) -> list[Finding]:
    """Return a finding for each passive joint with an unusually large step between neighbouring samples.

    Steps in which a driven joint also jumps (samples far apart) are skipped.
    """
    out = []
    floors = [2 * DEG if j.is_angle else 2 * MM for j in model.mechanism.active]
    driven = np.abs(np.diff(posed.q, axis=0))
    led = np.asarray((driven > _usual(driven) + floors).any(axis=1))
    for joint in model.mechanism.passive:
        q = np.unwrap(posed.q_passive[joint.name]) if joint.is_angle else posed.q_passive[joint.name]
        if len(q) < 4:
            continue
        steps = np.abs(np.diff(q))
        floor = 2 * DEG if joint.is_angle else 2 * MM
        usual = _usual(steps)
        k = int(np.argmax(np.where(led, -np.inf, steps - usual)))
        if not led[k] and steps[k] > usual[k] + floor:
            out.append(
                _JUMP(
                    joint.name,
                    f"passive joint {joint.name} jumps between two samples: the mechanism changes its assembly mode",
                    moved(steps[k], joint.is_angle),
                    moved(usual[k], joint.is_angle),
                    when=at.when(k + 1),
                )
            )
    return out


def _usual(steps: Array) -> Array:
    """Return an upper limit for each step (k, ...): eight times the larger neighbouring step."""
    return 8 * np.maximum(np.concatenate([steps[:1], steps[:-1]]), np.concatenate([steps[1:], steps[-1:]]))
