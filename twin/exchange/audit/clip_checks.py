"""Check the keys of a clip by themselves: times, rate, quaternions and poses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.exchange.audit.file_content import FileClip
from twin.exchange.audit.ledger import Ledger, Measured
from twin.exchange.audit.poses import Array

UNIT_LENGTH_TOL = 1e-4
"""Maximum difference between a quaternion's length and 1 that counts as a rounding error of single precision."""

MAX_TURN = np.radians(120)
"""Maximum rotation in rad between two keys. Players use the shorter rotation; for larger angles, it may be wrong."""

START_TOL = 1e-9
"""Maximum time in s of a clip's first key. If a clip starts later, players first show the rest pose."""

RATE_TOL = 1e-3
"""Largest relative difference between an interval of keys and 1 / rate that counts as rounding."""

MAX_DISTANCE = 50.0
"""Distance in m between a link and the origin above which the unit of length is probably wrong."""


def check_times(ledger: Ledger, times: Array, clip: str, code: str) -> bool:
    """Report faults of key times (k,) in s; return whether the times can be used."""
    if not len(times):
        ledger.wrong(f"{code}.times", f"clip '{clip}' has no keys.", clip)
        return False
    if not np.all(np.isfinite(times)):
        ledger.wrong(f"{code}.finite", f"clip '{clip}': a key time is not a finite number.", clip)
        return False
    steps = np.diff(times)
    if len(steps) and np.min(steps) <= 0:
        key = int(np.argmin(steps))
        text = (
            f"clip '{clip}': key {key + 1} at {times[key + 1]:.6g} s does not come after key {key} at "
            f"{times[key]:.6g} s."
        )
        ledger.wrong(
            f"{code}.times",
            text,
            clip,
            size=Measured(steps[key], 0.0, "s"),
            when=f"key {key + 1}",
            suggestion="times must increase strictly",
        )
        return False
    if abs(times[0]) > START_TOL:
        text = f"clip '{clip}' starts at {times[0]:.6g} s, not at 0: players wait until this time, or begin there."
        ledger.add(f"{code}.start", "warning", text, clip, size=Measured(times[0], 0.0, "s"))
    return True


def check_rate(ledger: Ledger, times: Array, stated: float, clip: str) -> None:
    """Compare a stated key rate in Hz with key times (k,) in s. Only the last interval may be shorter than 1 / rate."""
    steps = np.diff(times)
    if not len(steps):
        return
    if not (np.isfinite(stated) and stated > 0):
        ledger.wrong("tracks.rate", f"clip '{clip}': rate {stated:g} Hz must be above 0.", clip)
        return
    inner = steps
    # The last key is at the end of the motion, which need not be a multiple of the interval.
    if len(steps) > 1:
        inner = steps[:-1]
    off_rate = np.abs(inner * stated - 1)
    key = int(np.argmax(off_rate))
    worst = float(off_rate[key])
    if len(steps) > 1 and steps[-1] * stated > 1 + RATE_TOL:
        key = len(steps) - 1
        worst = float(steps[-1] * stated - 1)
    if worst > RATE_TOL:
        text = (
            f"clip '{clip}': the stated rate is {stated:g} Hz, but keys {key} and {key + 1} are {steps[key]:.6g} s "
            f"apart ({1 / steps[key]:.6g} Hz)."
        )
        ledger.wrong(
            "tracks.rate",
            text,
            clip,
            size=Measured(1 / steps[key], stated, "Hz"),
            when=f"t = {times[key]:.4g} s",
            suggestion="state the actual rate of the keys",
        )
    ledger.row("stated rate against key times", worst, "1", RATE_TOL, where=clip)


def check_quaternions(
    ledger: Ledger,
    xyzw: Array,
    times: Array | Sequence[float],
    where: str,
    code: str,
    interpolated: bool = True,
    takes_shorter: bool = False,
) -> None:
    """Report faults of the quaternions (k, 4) of a link: a length that is not 1, sign changes, large rotations.

    Sign changes and rotations by more than `MAX_TURN` between two keys are faults only if players interpolate the
    quaternions (`interpolated` is True). A sign change is a warning if the format `takes_shorter` rotations, as glTF.
    """
    if not np.all(np.isfinite(xyzw)):
        text = f"{where}: a quaternion is not finite."
        ledger.wrong(f"{code}.finite", text, where)
        return
    size = np.linalg.norm(xyzw, axis=1)
    key = int(np.argmax(np.abs(size - 1)))
    if abs(size[key] - 1) > UNIT_LENGTH_TOL:
        text = (
            f"{where}: a quaternion has length {size[key]:.6g}, not 1: players normalise it, scale the node, or fail."
        )
        ledger.wrong(f"{code}.quaternion", text, where, size=Measured(size[key], 1.0), when=f"t = {times[key]:.4g} s")
        return
    if not interpolated:
        return
    dots = np.sum(xyzw[1:] * xyzw[:-1], axis=1)
    flips = np.flatnonzero(dots < 0).tolist()
    if flips:
        key = flips[0]
        text = (
            f"{where}: the quaternion changes sign {len(flips)} times, first between {times[key]:.4g} and "
            f"{times[key + 1]:.4g} s"
        )
        severity = "disagreement"
        if takes_shorter:
            severity = "warning"
            text += (
                ": the file is valid and its motion is right, because glTF 2.0 (appendix C.4) requires that players "
                "take the shorter rotation, at which the sign does no harm. Players that interpolate components, as "
                "old versions of glTFast do, rotate the link by up to 180 deg."
            )
        else:
            text += ": players that interpolate components (Unity) rotate the link by up to 180 deg."
        count = Measured(float(len(flips)), 0.0)
        ledger.add(f"{code}.quaternion_sign", severity, text, where, size=count, when=f"t = {times[key]:.4g} s")
    # q and -q are one rotation: the size of the product alone gives its angle
    # The clip is for rounding, which lifts the cosine between equal rotations above 1.
    turn = 2 * np.arccos(np.clip(np.abs(dots) / (size[1:] * size[:-1]), 0, 1))
    if len(turn) and np.max(turn) > MAX_TURN:
        key = int(np.argmax(turn))
        text = (
            f"{where} rotates by {np.degrees(turn[key]):.4g} deg between {times[key]:.4g} and {times[key + 1]:.4g} s; "
            "above 180 deg, players rotate backwards."
        )
        ledger.wrong(
            f"{code}.step",
            text,
            where,
            size=Measured(float(np.degrees(turn[key])), float(np.degrees(MAX_TURN)), "deg"),
            when=f"t = {times[key]:.4g} s",
        )


def check_poses(ledger: Ledger, clip: FileClip, code: str) -> None:
    """Report poses that are not finite, and links so far from the origin that lengths are probably in mm."""
    for name, T in clip.links.items():
        if not np.all(np.isfinite(T)):
            ledger.wrong(f"{code}.finite", f"clip '{clip.name}': the pose of link '{name}' is not finite.", name)
            continue
        distances = np.linalg.norm(T[:, :3, 3], axis=1)
        if len(distances) and np.max(distances) > MAX_DISTANCE:
            farthest = float(np.max(distances))
            time = clip.times[int(np.argmax(distances))]
            text = (
                f"clip '{clip.name}': link '{name}' is {farthest:.4g} m from the origin: the numbers look like "
                "millimetres, but the file is in metres."
            )
            ledger.add(
                f"{code}.size",
                "warning",
                text,
                name,
                size=Measured(farthest, MAX_DISTANCE, "m"),
                when=f"t = {time:.4g} s",
                suggestion="check the unit",
            )
