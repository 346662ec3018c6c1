"""Combine several devices into one device, which ends as soon as one of the devices ends."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from numpy.typing import ArrayLike

from twin.core.spatial import Array
from twin.simulation.world import Block, Signals


class CombinedDevices(Block):
    """Writes the signals of all its devices."""

    def __init__(self, devices: Sequence[Block]) -> None:
        """Join devices that step in every tick."""
        self.devices = tuple(devices)
        outputs: dict[str, ArrayLike] = {}
        for device in devices:
            outputs.update(device.outputs)
        self.outputs = outputs

    def attach(self, signals: Signals, memory: Mapping[str, Array]) -> None:
        """Attach all devices."""
        for device in self.devices:
            own_memory = {name: memory[name] for name in device.outputs}
            device.attach(signals, own_memory)

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, ArrayLike] | None:
        """Step all devices; return None if the input of one device has ended."""
        values: dict[str, ArrayLike] = {}
        for device in self.devices:
            of_device = device.step(signals, t, dt)
            if of_device is None:
                return None
            values.update(of_device)
        return values
