"""Warn about phases in which an angle of the tool turns by more than half a turn.

Angles change linearly in a phase, so that from 180 to -164 deg the tool turns by 344 deg. This may be meant. Usually,
the waypoint was copied from a table with angles between -180 and 180 deg, and the turn of 16 deg to 196 deg was meant.
"""

from __future__ import annotations

import numpy as np

from twin.core.findings import Finding, warning
from twin.core.quantity import deg
from twin.core.units import DEG
from twin.planning.protocol.course import Course
from twin.planning.protocol.waypoint import Waypoint

_HALF = 180 * DEG + 1e-6
"""Turn in rad above which the other direction is shorter; the small part is for rounding of a half turn."""


def long_turns(course: Course, phase: str, waypoint: Waypoint) -> list[Finding]:
    """Return a warning for each angle that turns the tool by more than 180 deg.

    Args:
        course: start and end of the phase.
        phase: name of the phase.
        waypoint: the waypoint at the end of the phase; the result is empty if this waypoint has joint values.
    """
    # A waypoint of joint values has no angles: those in it are zeros, not turns that somebody wrote.
    if waypoint.joints is not None:
        return []
    warnings = []
    where = f"waypoint '{waypoint.name}'"
    when = f"phase '{phase}'"
    for axis, (start, end) in enumerate(zip(course.angles0, waypoint.angles, strict=True)):
        turn = abs(end - start)
        if turn <= _HALF:
            continue
        full_turns = np.round((end - start) / (2 * np.pi))
        nearest = end - 2 * np.pi * full_turns
        angle = f"angle {axis + 1} (about {course.order[axis]})"
        what = f"{angle} turns by {deg(turn)}, from {_number(start)} to {_number(end)} deg"
        advice = (
            f"if the shorter turn of {deg(abs(nearest - start))} is meant, write {_number(nearest)} instead of "
            f"{_number(end)} in angles_deg of {where}"
        )
        warnings.append(warning("protocol.long_turn", where, what, deg(turn), 180, advice, when=when, word=""))
    return warnings


def hint(course: Course, phase: str, waypoint: Waypoint | None) -> str:
    """Return a text that names long turns of a failed phase as a possible cause; "" if there are no long turns."""
    if waypoint is None:
        return ""
    text = ""
    for finding in long_turns(course, phase, waypoint):
        text += f". {finding.message}: {finding.suggestion}"
    return text


def _number(radians: float) -> str:
    """Return an angle in deg as it is written in a protocol; -0 as 0."""
    return f"{radians / DEG + 0.0:.7g}"
