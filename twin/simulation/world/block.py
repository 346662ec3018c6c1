"""Parts of a World. Blocks write signals; hazards change a signal before other blocks read it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping

from numpy.typing import ArrayLike

from twin.core.spatial import Array
from twin.simulation.world.signals import Signals


class Block(ABC):
    """A device, a controller or a plant: a block reads any signals and writes its own.

    The outputs depend only on the signals, the time and the block's own state, so that equal inputs give equal bytes.
    Random numbers come from a generator that is seeded in the constructor. A block uses no wall clock, file or network.

    Attributes:
        outputs: the signals that only this block writes, named "<owner>.<what>", with their initial values.
        period: time in s between two steps, a multiple of the World's tick; 0: every tick.
    """

    outputs: Mapping[str, ArrayLike]
    period: float = 0.0

    def attach(self, signals: Signals, memory: Mapping[str, Array]) -> None:
        """Prepare for the steps in a World; the World calls this once, before the first step.

        A fast block keeps views of the signals that it reads, and writes its outputs into `memory` instead of returning
        them.

        Args:
            signals: the signals of the World.
            memory: {output signal: memory (n,) of its values}.
        """
        return

    @abstractmethod
    def step(self, signals: Signals, t: float, dt: float) -> Mapping[str, ArrayLike] | None:
        """Return new values of signals; signals that are not returned keep their values. None: no value changes.

        A device returns None when its input has ended; the World then ends before this tick.

        Args:
            signals: the current signals; devices see the signals at the end of the previous tick.
            t: start of the tick in s.
            dt: time in s until the next step of this block.
        """


class Hazard(ABC):
    """Changes one signal after one block has written it, and before other blocks read it.

    A hazard, like a block, is used in one World only.

    Attributes:
        signal: name of the changed signal; the value that the block wrote is in `<signal>.written`.
    """

    signal: str

    @abstractmethod
    def change(self, t: float, value: Array) -> ArrayLike:
        """Return the value that replaces `value` (n,) in the tick that starts at t in s."""
