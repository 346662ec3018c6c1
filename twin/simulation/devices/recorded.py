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
        own = [n for n in recording.sizes if not n.endswith(".written")]
        for wanted in signals:
            if not any(_is_of(n, wanted) for n in own):
                raise WorldError(unknown("recorded signal", wanted, own))
        if not len(recording.rows):
            raise WorldError("the recording has no tick")
        names = [n for n in own if any(_is_of(n, wanted) for wanted in signals)]
        written = {n: f"{n}.written" if f"{n}.written" in recording.sizes else n for n in names}
        self._rows = {name: recording[source] for name, source in written.items()}
        self._count, self._tick = len(recording.rows), 0
        self.outputs = {name: rows[0] for name, rows in self._rows.items()}

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, Array] | None:
        """Return the next row; None at the end of the recording."""
        if self._tick == self._count:
            return None
        k, self._tick = self._tick, self._tick + 1
        return {name: rows[k] for name, rows in self._rows.items()}


def _is_of(signal: str, wanted: str) -> bool:
    return signal == wanted or signal.startswith(f"{wanted}.")
