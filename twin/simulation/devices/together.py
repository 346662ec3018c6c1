"""Combine several devices into one device, which ends as soon as one of the devices ends."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from numpy.typing import ArrayLike

from twin.core.spatial import Array
from twin.simulation.world import Block, Signals


class Together(Block):
    """Writes the signals of all its devices."""

    def __init__(self, devices: Sequence[Block]) -> None:
        """Join devices that step in every tick."""
        self.devices = tuple(devices)
        self.outputs = {name: value for d in devices for name, value in d.outputs.items()}

    def attach(self, signals: Signals, memory: Mapping[str, Array]) -> None:
        """Attach all devices."""
        for device in self.devices:
            device.attach(signals, {name: memory[name] for name in device.outputs})

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, ArrayLike] | None:
        """Step all devices; return None if the input of one device has ended."""
        out: dict[str, ArrayLike] = {}
        for device in self.devices:
            if (said := device.step(signals, t, dt)) is None:
                return None
            out |= said
        return out
