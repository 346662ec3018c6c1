"""A kernel on a graphics processor (GPU): samples are streamed through its memory in blocks."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from twin.codegen.gpu_entry import ENTRY, THREADS, ptx_text, sample_text
from twin.core import compute_device
from twin.core.errors import GpuError
from twin.core.gpu import Address, Gpu
from twin.core.spatial import Array

_LANE_COUNT = 2
"""Number of blocks under way: while one is computed, the other one is copied."""

_BLOCK_SAMPLES = 1 << 18
"""Maximum number of samples in a block; a GPU has 1e5 threads under way at once."""

_MEMORY_SHARE = 0.5
"""Maximum share of the GPU's free memory that is reserved; other programs use the GPU as well."""

_BLOCK_START_S = 1e-4
"""Time in s for starting the work of a block, and for one pass of Python over it."""

_BYTES_PER_DOUBLE = 8
"""Bytes of a number."""

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
        if self._array is None:
            return 0
        return len(self._array)


class _Lanes:
    """The lanes of a GPU. They stay reserved, because reserving takes longer than computing a block."""

    def __init__(self, gpu: Gpu) -> None:
        self.lock = threading.Lock()
        """Held during a call: its blocks use all lanes."""
        self.lanes = [_Lane(gpu) for _ in range(_LANE_COUNT)]

    @property
    def count(self) -> int:
        """Number of doubles that are reserved on the GPU."""
        return sum(lane.count for lane in self.lanes)


_lanes_of: dict[Gpu, _Lanes] = {}
_lanes_lock = threading.Lock()


def _lanes(gpu: Gpu) -> _Lanes:
    """Return the lanes of a GPU, which all kernels share, in all threads."""
    with _lanes_lock:
        if gpu not in _lanes_of:
            _lanes_of[gpu] = _Lanes(gpu)
        return _lanes_of[gpu]


@dataclass(frozen=True)
class _Block:
    """Samples `first` to `last` - 1 on their way through a lane: its numbers before and after the computation."""

    lane: _Lane
    inputs: Array
    outputs: Array
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
        copying = _BYTES_PER_DOUBLE * numbers * samples / _BYTES_PER_S
        starting = _BLOCK_START_S * math.ceil(samples / _BLOCK_SAMPLES)
        return copying + starting

    def columns(self, gpu: Gpu, input_arrays: Sequence[Array], results: Sequence[Array], begin: int, end: int) -> None:
        """Compute samples `begin` to `end` - 1; arrays are (c, k), a column for each sample.

        Raises:
            GpuError: the driver refuses, or the memory of the GPU is too small.
        """

        def fill(block: _Block) -> None:
            rows = block.inputs.reshape(self.inputs, -1)
            samples = block.last - block.first
            row = 0
            for array in input_arrays:
                rows[row : row + len(array), :samples] = array[:, block.first : block.last]
                row += len(array)

        def drain(block: _Block) -> None:
            rows = block.outputs.reshape(self.outputs, -1)
            samples = block.last - block.first
            row = 0
            for array in results:
                array[:, block.first : block.last] = rows[row : row + len(array), :samples]
                row += len(array)

        self._stream(gpu, begin, end, fill, drain, by_rows=False)

    def rows(self, gpu: Gpu, input_array: Array, results: Array, begin: int, end: int) -> None:
        """Compute samples `begin` to `end` - 1; arrays are (k, c), a row for each sample.

        Raises:
            GpuError: the driver refuses, or the memory of the GPU is too small.
        """

        def fill(block: _Block) -> None:
            samples = block.last - block.first
            block.inputs.reshape(-1, self.inputs)[:samples] = input_array[block.first : block.last]

        def drain(block: _Block) -> None:
            samples = block.last - block.first
            results[block.first : block.last] = block.outputs.reshape(-1, self.outputs)[:samples]

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
            blocks_under_way: deque[_Block] = deque()
            try:
                for turn, first in enumerate(range(begin, end, size)):
                    if len(blocks_under_way) == _LANE_COUNT:
                        self._finish(gpu, blocks_under_way, drain)
                    lane = lanes.lanes[turn % _LANE_COUNT]
                    numbers, input_address = lane.memory(size * (self.inputs + self.outputs))
                    inputs = numbers[: size * self.inputs]
                    outputs = numbers[size * self.inputs :]
                    output_address = int(input_address) + inputs.nbytes
                    block = _Block(lane, inputs, outputs, first, min(first + size, end))
                    fill(block)
                    samples = block.last - first
                    if by_rows:
                        distances_in = (1, self.inputs)
                        distances_out = (1, self.outputs)
                    else:
                        distances_in = (size, 1)
                        distances_out = (size, 1)
                    arguments = (samples, input_address, *distances_in, output_address, *distances_out)
                    blocks_under_way.append(block)
                    gpu.copy_to(input_address, inputs, lane.stream)
                    gpu.launch(function, math.ceil(samples / THREADS), THREADS, arguments, lane.stream)
                    gpu.copy_from(outputs, output_address, lane.stream)
                while blocks_under_way:
                    self._finish(gpu, blocks_under_way, drain)
            except BaseException:
                # The memory of a lane must not be used again while the GPU still writes into it.
                for block in blocks_under_way:
                    gpu.wait(block.lane.stream)
                raise
            self._seconds_per_sample = (time.perf_counter() - begun) / (end - begin)

    def _finish(self, gpu: Gpu, blocks_under_way: deque[_Block], drain: Callable[[_Block], None]) -> None:
        """Wait for the oldest block, and copy its results."""
        block = blocks_under_way[0]
        gpu.wait(block.lane.stream)
        drain(block)
        blocks_under_way.popleft()

    def _size(self, gpu: Gpu, lanes: _Lanes, samples: int) -> int:
        """Return the number of samples in a block.

        Raises:
            GpuError: the memory is too small for a block of one sample per thread of the smallest launch.
        """
        bytes_per_sample = _BYTES_PER_DOUBLE * (self.inputs + self.outputs)
        # what the lanes hold already is not free, but can be replaced
        usable = _MEMORY_SHARE * (gpu.free_bytes() + _BYTES_PER_DOUBLE * lanes.count)
        most = int(usable / (_LANE_COUNT * bytes_per_sample))
        if most < min(samples, THREADS):
            needed_bytes = _LANE_COUNT * bytes_per_sample * THREADS / _MEMORY_SHARE
            free = f"{gpu.name} has {gpu.free_bytes() / 1e6:.3g} MB of free memory"
            raise GpuError(
                f"{free}; a kernel needs {needed_bytes / 1e6:.3g} MB: end other programs, or choose --device cpu"
            )
        return min(samples, _BLOCK_SAMPLES, most)
