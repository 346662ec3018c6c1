"""The right (green) arm of the Raven-II; `twin.robots._raven` has the equations of both arms."""

from __future__ import annotations

from twin.robots._raven import formula

FORMULA = formula("raven_right", "Raven-II, right arm", left=False)
