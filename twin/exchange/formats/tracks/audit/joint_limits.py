"""Check the joint values of a track against the limits that it states."""

from __future__ import annotations

import numpy as np

from twin.core.json_types import JsonObject
from twin.exchange.audit.file_content import FileClip
from twin.exchange.audit.ledger import Ledger, Measured
from twin.exchange.audit.poses import Array

LIMIT_TOL = 1e-6
"""Maximum violation of a joint limit, in m or rad, that counts as a rounding error."""


def check_joint_limits(
    data: JsonObject, joints: list[str], low: Array, high: Array, clip: FileClip, ledger: Ledger
) -> None:
    """Report joints beyond their limits `low` and `high` (joints,) in m or rad, and lists of a wrong length."""
    kinds = data.get("joint_types", [])
    for key, value in (("joint_types", kinds), ("joint_lower", low), ("joint_upper", high)):
        if len(value) != len(joints):
            text = f"{key} has {len(value)} entries for {len(joints)} joints."
            ledger.wrong("tracks.shape", text, key)
            return
    worst = 0.0
    where = ""
    when = ""
    for number, joint in enumerate(joints):
        q = clip.joints.get(joint)
        if q is None:  # the list of positions has a wrong length, which has been reported
            continue
        if not low[number] <= high[number]:
            text = f"joint '{joint}': lower limit {low[number]:g} is above upper limit {high[number]:g}."
            ledger.wrong("tracks.limits", text, joint, suggestion="exchange the limits")
            continue
        violations = np.maximum(np.maximum(low[number] - q, q - high[number]), 0)
        worst_key = int(np.argmax(violations))
        violation = float(violations[worst_key])
        moment = f"t = {clip.times[worst_key]:.4g} s"
        if violation > worst:
            worst = violation
            where = joint
            when = moment
        if violation > LIMIT_TOL:
            _report_violation(
                joint, kinds[number] == "revolute", q, (low[number], high[number]), worst_key, moment, ledger
            )
    ledger.row("joints beyond their limits", worst, "rad or m", LIMIT_TOL, where=where, when=when)


def _report_violation(
    joint: str, is_angle: bool, q: Array, limits: tuple[float, float], key: int, moment: str, ledger: Ledger
) -> None:
    """Report that the values q (n,) of a joint in rad or m exceed its limits, most at key k."""
    low, high = limits
    violation = float(max(low - q[key], q[key] - high))
    scale = 1e3
    unit = "mm"
    hint = ""
    if is_angle:
        scale = 180 / np.pi
        unit = "deg"
        radians = np.radians(q)
        # The most frequent mistake: the whole motion fits if its numbers are degrees.
        if np.all((radians >= low) & (radians <= high)):
            hint = "; as a value in degrees, it would be within the limits"
    text = f"joint '{joint}' is at {q[key] * scale:.5g} {unit}, {violation * scale:.4g} {unit} beyond its limits{hint}."
    size = Measured(violation * scale, LIMIT_TOL * scale, unit)
    advice = "write angles in radians and lengths in metres"
    ledger.wrong("tracks.limits", text, joint, size=size, when=moment, suggestion=advice)
