"""A kernel on a graphics processor (GPU): samples are streamed through its memory in blocks."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

from twin.codegen.gpu_entry import ENTRY, THREADS, ptx_text, sample_text
from twin.core import compute_device
from twin.core.errors import GpuError
from twin.core.gpu import Address, Gpu
from twin.core.spatial import Array

_LANES = 2
"""Number of blocks under way: while one is computed, the other one is copied."""

_BLOCK = 1 << 18
"""Maximum number of samples in a block; a GPU has 1e5 threads under way at once."""

_SHARE = 0.5
"""Maximum share of the GPU's free memory that is reserved; other programs use the GPU as well."""

_LAUNCH = 1e-4
"""Time in s for starting the work of a block, and for one pass of Python over it."""

_BYTES_PER_S = 5e9
"""Rate of copies to and from the GPU on which a decision rests: a third of what PCIe 3 transfers."""


class _Lane:
    """Memory for one block, on the computer and on the GPU, and the stream of its work."""

    def __init__(self, gpu: Gpu) -> None:
        self.stream = gpu.stream()
        self._gpu = gpu
        self._array: Array | None = None
        self._address: Address = 0

    def memory(self, count: int) -> tuple[Array, Address]:
        """Return (array (count,), its address on the GPU); memory that is too small is replaced."""
        if self._array is None or len(self._array) < count:
            self.release()
            address = self._gpu.reserved(count)
            try:
                self._array = self._gpu.pinned(count)
            except BaseException:
                self._gpu.release((address,), (), ())
                raise
            self._address = address
        return self._array[:count], self._address

    def release(self) -> None:
        """Free the memory."""
        if self._array is not None:
            array = self._array
            self._array = None
            self._gpu.release((self._address,), (array,), ())

    @property
    def count(self) -> int:
        """Number of doubles that are reserved on the GPU."""
        return 0 if self._array is None else len(self._array)


class _Lanes:
    """The lanes of a GPU. They stay reserved, because reserving takes longer than computing a block."""

    def __init__(self, gpu: Gpu) -> None:
        self.lock = threading.Lock()
        """Held during a call: its blocks use all lanes."""
        self.lanes = [_Lane(gpu) for _ in range(_LANES)]

    @property
    def count(self) -> int:
        """Number of doubles that are reserved on the GPU."""
        return sum(lane.count for lane in self.lanes)


@cache
def _lanes(gpu: Gpu) -> _Lanes:
    return _Lanes(gpu)


@dataclass(frozen=True)
class _Block:
    """Samples `first` to `last` - 1 on their way through a lane."""

    lane: _Lane
    given: Array
    computed: Array
    first: int
    last: int


class GpuKernel:
    """The kernel of `twin.codegen.Kernel` for a GPU."""

    def __init__(self, text: str, inputs: int, outputs: int) -> None:
        """Store a kernel.

        Args:
            text: LLVM assembly of width 1 from `emit`, without carried arguments.
            inputs: count of numbers that a sample takes.
            outputs: count of numbers that it gives.
        """
        self.text = ptx_text(sample_text(text, inputs, outputs))
        self.inputs = inputs
        self.outputs = outputs
        self._seconds_per_sample = 0.0  # in the last call; 0: there was none

    def seconds(self, samples: int) -> float:
        """Return the expected time of a call in s: as in the last call, or, before the first one, that of the copies.

        Cards for computing do the arithmetic of doubles faster than the copies; other cards may not, which the first
        call shows.
        """
        if self._seconds_per_sample > 0:
            return self._seconds_per_sample * samples
        numbers = self.inputs + self.outputs
        copying = 8 * numbers * samples / _BYTES_PER_S
        starting = _LAUNCH * math.ceil(samples / _BLOCK)
        return copying + starting

    def columns(self, gpu: Gpu, given: Sequence[Array], results: Sequence[Array], begin: int, end: int) -> None:
        """Compute samples `begin` to `end` - 1; arrays are (c, k), a column for each sample.

        Raises:
            GpuError: the driver refuses, or the memory of the GPU is too small.
        """

        def fill(block: _Block) -> None:
            rows = block.given.reshape(self.inputs, -1)
            samples = block.last - block.first
            at = 0
            for array in given:
                rows[at : at + len(array), :samples] = array[:, block.first : block.last]
                at += len(array)

        def drain(block: _Block) -> None:
            rows = block.computed.reshape(self.outputs, -1)
            samples = block.last - block.first
            at = 0
            for array in results:
                array[:, block.first : block.last] = rows[at : at + len(array), :samples]
                at += len(array)

        self._stream(gpu, begin, end, fill, drain, by_rows=False)

    def rows(self, gpu: Gpu, given: Array, results: Array, begin: int, end: int) -> None:
        """Compute samples `begin` to `end` - 1; arrays are (k, c), a row for each sample.

        Raises:
            GpuError: the driver refuses, or the memory of the GPU is too small.
        """

        def fill(block: _Block) -> None:
            samples = block.last - block.first
            block.given.reshape(-1, self.inputs)[:samples] = given[block.first : block.last]

        def drain(block: _Block) -> None:
            samples = block.last - block.first
            results[block.first : block.last] = block.computed.reshape(-1, self.outputs)[:samples]

        self._stream(gpu, begin, end, fill, drain, by_rows=True)

    def _stream(
        self,
        gpu: Gpu,
        begin: int,
        end: int,
        fill: Callable[[_Block], None],
        drain: Callable[[_Block], None],
        *,
        by_rows: bool,
    ) -> None:
        """Send samples `begin` to `end` - 1 through the GPU in blocks, in turns through the lanes.

        Args:
            gpu: what computes.
            begin: first sample.
            end: last sample + 1.
            fill: copies the samples of a block into its lane.
            drain: copies their results out of it.
            by_rows: whether the numbers of a sample are neighbours in a lane; else, the samples of a number are.
        """
        compute_device.current().used.add(gpu.name)
        lanes = _lanes(gpu)
        with lanes.lock:
            begun = time.perf_counter()
            function = gpu.function(self.text, ENTRY)
            size = self._size(gpu, lanes, end - begin)
            under_way: deque[_Block] = deque()
            try:
                for turn, first in enumerate(range(begin, end, size)):
                    if len(under_way) == _LANES:
                        self._finish(gpu, under_way, drain)
                    lane = lanes.lanes[turn % _LANES]
                    numbers, given_address = lane.memory(size * (self.inputs + self.outputs))
                    given = numbers[: size * self.inputs]
                    computed = numbers[size * self.inputs :]
                    computed_address = int(given_address) + given.nbytes
                    block = _Block(lane, given, computed, first, min(first + size, end))
                    fill(block)
                    samples = block.last - first
                    if by_rows:
                        distances_in = (1, self.inputs)
                        distances_out = (1, self.outputs)
                    else:
                        distances_in = (size, 1)
                        distances_out = (size, 1)
                    arguments = (samples, given_address, *distances_in, computed_address, *distances_out)
                    under_way.append(block)
                    gpu.copy_to(given_address, given, lane.stream)
                    gpu.launch(function, math.ceil(samples / THREADS), THREADS, arguments, lane.stream)
                    gpu.copy_from(computed, computed_address, lane.stream)
                while under_way:
                    self._finish(gpu, under_way, drain)
            except BaseException:
                # The memory of a lane must not be used again while the GPU still writes into it.
                for block in under_way:
                    gpu.wait(block.lane.stream)
                raise
            self._seconds_per_sample = (time.perf_counter() - begun) / (end - begin)

    def _finish(self, gpu: Gpu, under_way: deque[_Block], drain: Callable[[_Block], None]) -> None:
        """Wait for the oldest block, and copy its results."""
        block = under_way[0]
        gpu.wait(block.lane.stream)
        drain(block)
        under_way.popleft()

    def _size(self, gpu: Gpu, lanes: _Lanes, samples: int) -> int:
        """Return the number of samples in a block.

        Raises:
            GpuError: the memory is too small for a block of one sample per thread of the smallest launch.
        """
        bytes_per_sample = 8 * (self.inputs + self.outputs)
        usable = _SHARE * (gpu.free_bytes() + 8 * lanes.count)
        most = int(usable / (_LANES * bytes_per_sample))
        if most < min(samples, THREADS):
            wanted = _LANES * bytes_per_sample * THREADS / _SHARE
            free = f"{gpu.name} has {gpu.free_bytes() / 1e6:.3g} MB of free memory"
            raise GpuError(f"{free}; a kernel needs {wanted / 1e6:.3g} MB: end other programs, or choose --device cpu")
        return min(samples, _BLOCK, most)
