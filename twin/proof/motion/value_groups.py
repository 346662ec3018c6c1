"""Names of what a proof along a path is about: groups of values, and values whose name is not that of a part.

They are those in certificates ("kind", "value"). A claim and the samples beside it are found by these names.
"""

from __future__ import annotations

JOINT_LIMIT = "joint limit"
JOINT_SPEED = "joint speed"
MOTOR_LIMIT = "motor limit"
MOTOR_SPEED = "motor speed"
GAP = "gap"
PASSIVE_LIMIT = "passive limit"
RCM = "RCM"
TOOL_SPEED = "tool speed"
LOOP_GAP = "loop gap"
DETERMINANT = "determinant"

SPEEDS = (JOINT_SPEED, MOTOR_SPEED, TOOL_SPEED)
"""Groups of values that depend on the timing."""

DRIVEN = (JOINT_LIMIT, JOINT_SPEED, MOTOR_LIMIT, MOTOR_SPEED, GAP)
"""Groups of values that follow from the driven joints alone."""

MARGINS = (JOINT_LIMIT, MOTOR_LIMIT, PASSIVE_LIMIT, GAP)
"""Groups of values that must not be below their limit."""

ENFORCED = "enforced"
MONITORED = "monitored"
"""Names of the distances from the RCM."""

TIP = "tip"
ROTATION = "rotation"
"""Names of the speeds of the tool."""

LOOPS = "loops"
"""Name of gap and determinant of all loops together."""
