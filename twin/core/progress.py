"""How a long computation tells its caller how far it is."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, float], None]
"""Function that is called to report progress, with the name of the current step and the fraction done (0 to 1)."""

StepProgress = Callable[[float], None]
"""The same within one step: called with the fraction done (0 to 1)."""


def silent(label: str, fraction: float) -> None:
    """Report nothing: the default of a `Progress`."""


def silent_step(fraction: float) -> None:
    """Report nothing: the default of a `StepProgress`."""
