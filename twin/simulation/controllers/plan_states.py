"""States of an arm while a motion is planned for one of the arms of a console: first value of `<robot>.planned`."""

from __future__ import annotations

OFF, AIM, HELD, RUN = 0.0, 1.0, 2.0, 3.0
"""OFF: the hand moves the arm. AIM: the hand moves the target of a plan; the arm is at rest. HELD: the arm is at rest.
RUN: the arm follows the poses of a plan."""
