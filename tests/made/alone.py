"""Run one block of a World alone."""

from __future__ import annotations

from twin.simulation.world import Signals


class Alone:
    """A block without its World; the test sets the signals that the block reads."""

    def __init__(self, block, **first):
        """Attach the block; `first` has the initial values of all signals that it reads, by name with `__` for `.`."""
        given = {name.replace("__", "."): value for name, value in first.items()}
        self.block, self.signals = block, Signals({**given, **block.outputs})
        self.memory = {name: self.signals.view(name) for name in block.outputs}
        block.attach(self.signals, self.memory)

    def step(self, t=0.0, dt=1e-3, **given):
        """Set the given signals, make one step of `dt` s at time `t` in s, and return the outputs by name."""
        for name, value in given.items():
            self.signals.view(name.replace("__", "."))[...] = value
        for name, value in (self.block.step(self.signals, t, dt) or {}).items():
            self.memory[name][...] = value
        return {name: value.copy() for name, value in self.memory.items()}
