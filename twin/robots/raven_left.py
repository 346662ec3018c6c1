"""The left (gold) arm of the Raven-II; `twin.robots._raven` has the equations of both arms."""

from __future__ import annotations

from twin.robots._raven import formula

FORMULA = formula("raven_left", "Raven-II, left arm", left=True)
