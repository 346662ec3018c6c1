"""Parts of a World: blocks, which write signals, and hazards, which change one between two blocks."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping

from numpy.typing import ArrayLike

from twin.core.spatial import Array
from twin.simulation.world.signals import Signals


class Block(ABC):
    """A device, a controller or a plant: it reads any signal and writes its own.

    Its outputs depend only on the signals, the time and its own state, so that the same input gives the same bytes.
    Random numbers come from a generator seeded in its constructor. No wall clock, no file, no network.

    Attributes:
        outputs: the signals that it alone writes, "<owner>.<what>", with their values before the first tick.
        period: seconds between two steps, a multiple of the World's tick; 0: every tick.
    """

    outputs: Mapping[str, ArrayLike]
    period: float = 0.0

    @abstractmethod
    def step(self, signals: Signals, t: float, dt: float) -> Mapping[str, ArrayLike] | None:
        """Return the new values; a signal that is left out keeps its value.

        A device returns None when its input has ended: the World ends before this tick.

        Args:
            signals: the present signals; devices see those of the end of the tick before.
            t: begin of the tick in s.
            dt: time in s until the next step.
        """


class Hazard(ABC):
    """Changes one signal after the block that writes it, before another block reads it.

    A hazard belongs to one World, like a block.

    Attributes:
        signal: name of the signal; `<signal>.written` keeps the value that its block wrote.
    """

    signal: str

    @abstractmethod
    def change(self, t: float, value: Array) -> ArrayLike:
        """Return the value that replaces `value` (n,) in the tick that begins at t in s."""
