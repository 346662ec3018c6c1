"""Playback of recorded signals, to repeat a World."""

from __future__ import annotations

from twin.core.errors import WorldError, unknown
from twin.core.spatial import Array
from twin.simulation.world import Block, Recording, Signals


class Recorded(Block):
    """Writes recorded signals tick by tick until the recording ends.

    If a hazard changed a recorded signal, this block writes the value from before the change.
    """

    def __init__(self, recording: Recording, *signals: str) -> None:
        """Select signals by name; `hand` selects all signals whose names begin with `hand.`.

        Raises:
            WorldError: no signal has this name, or the recording is empty.
        """
        recorded = [name for name in recording.sizes if not name.endswith(".written")]
        for selected in signals:
            if not any(_is_of(name, selected) for name in recorded):
                raise WorldError(unknown("recorded signal", selected, recorded))
        if not len(recording.rows):
            raise WorldError("the recording has no tick")
        self._rows: dict[str, Array] = {}
        for name in recorded:
            if any(_is_of(name, wanted) for wanted in signals):
                before_hazard = f"{name}.written"
                source = before_hazard if before_hazard in recording.sizes else name
                self._rows[name] = recording[source]
        self._count = len(recording.rows)
        self._tick = 0
        self.outputs = {name: rows[0] for name, rows in self._rows.items()}

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, Array] | None:
        """Return the next row; None at the end of the recording."""
        if self._tick == self._count:
            return None
        values = {name: rows[self._tick] for name, rows in self._rows.items()}
        self._tick += 1
        return values


def _is_of(signal: str, selected: str) -> bool:
    """Return whether a signal is the selected one, or one of the selected owner."""
    return signal == selected or signal.startswith(f"{selected}.")
