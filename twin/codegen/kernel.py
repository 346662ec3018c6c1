"""Run a compiled kernel on all processors; each number of the samples has an array of its own (structure of arrays)."""

from __future__ import annotations

import contextlib
import ctypes
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache, cached_property

import numpy as np

from twin.codegen.emit import Stage, emit
from twin.codegen.gpu_entry import computable
from twin.codegen.gpu_kernel import GpuKernel
from twin.core import compute_device, gpu
from twin.core.errors import GpuError
from twin.core.gpu import Gpu
from twin.core.jobs import usable_processors
from twin.core.machine_code import compiled, lanes
from twin.core.spatial import Array

_CHUNK_SAMPLES = 4096
"""Minimum number of samples in a chunk. A chunk acquires Python's lock once."""

_MOST_CHUNKS = 64
"""Maximum number of chunks."""

_BLOCK_SAMPLES = 1024
"""Number of samples in a block that is transposed at once: input and output (20 numbers each) fit into the cache."""

_THREAD_WORTH_S = 2e-4
"""Minimum computing time in s for which a further thread is used."""

_FEWEST_GPU_SAMPLES = 4096
"""Minimum number of samples for which a GPU is used."""

_GPU_LOADING_S = 1.0
"""Time in s for loading a kernel into a GPU. A kernel has taken as long on the processor before a GPU is considered.

How many calls will follow is not known: with this rule, a GPU that is faster costs at most about this time in vain.
"""


@cache
def _pool() -> ThreadPoolExecutor:
    """Return the threads that all kernels share."""
    return ThreadPoolExecutor(usable_processors(), "twin-kernel")


class Kernel:
    """Compiled stages (CasADi functions), called for many samples.

    The processor computes, or a GPU, as `twin.core.compute_device` states; the results differ by rounding only.

    Attributes:
        inputs: {name of the input: count of numbers per sample}.
        outputs: {name of the output: count of numbers per sample}.
    """

    def __init__(
        self,
        stages: Sequence[Stage],
        inputs: Mapping[str, int],
        outputs: Sequence[str],
        *,
        single: bool = False,
        carried: Mapping[str, int] | None = None,
        backwards: bool = False,
        exact: bool = False,
    ) -> None:
        """Compile the stages, or load them from the cache.

        Args:
            stages: see `Stage`.
            inputs: {name of the input: count of numbers per sample}.
            outputs: names of the requested results.
            single: whether to process one sample at a time, which is fastest for a few samples.
            carried: arguments that are results of the previous sample (see `emit`); samples are then processed in
                sequence, without threads.
            backwards: with `carried`, whether to process from the last sample to the first sample.
            exact: whether the results equal those of CasADi bit for bit; requires `single`. An exact kernel is slower,
                but still three times as fast as CasADi.

        Raises:
            ValueError: a CasADi operation is not supported.
        """
        self.inputs = dict(inputs)
        self._carried = dict(carried or {})
        self._width = lanes()
        if single or carried:
            self._width = 1
        text, self.outputs = emit(stages, inputs, outputs, self._width, self._carried, backwards, exact)
        self._call, self._keeps_alive = compiled(text)
        self._stages = tuple(stages)
        self._exact = exact
        self._busy_s = 0.0  # computing time of the processor in s, where the choice is "auto"
        self._fails_on_gpu = False  # where the choice is "auto"

    def __call__(
        self,
        *arrays: Array,
        carry: Array | None = None,
        threads: int | None = None,
        out: Sequence[Array] | None = None,
    ) -> tuple[Array, ...]:
        """Return an array (c, k) for each output: k samples of c numbers; c is in `outputs`.

        Args:
            arrays: float64 arrays (c, k), in the order of `inputs`; c is in `inputs`.
            carry: initial carried values; overwritten by the final values.
            threads: maximum number of threads; None: number of processors.
            out: float64 arrays (c, k) to fill and return, which saves allocations; None: new arrays.

        Raises:
            ValueError: an array has a wrong shape, an array of `out` is not contiguous float64, or `carry` is missing
                or has a wrong size.
        """
        if len(arrays) != len(self.inputs):
            raise ValueError(f"{len(arrays)} arrays given, expected one for each of {', '.join(self.inputs)}")
        sample_count = 0
        if arrays:
            sample_count = arrays[0].shape[-1]
        input_arrays = []
        for (name, count), array in zip(self.inputs.items(), arrays, strict=True):
            if array.shape != (count, sample_count):
                raise ValueError(f"'{name}' has shape {array.shape}, not {(count, sample_count)}")
            # Each row (the samples of one number) must be contiguous in memory; the rows need not be adjacent.
            has_packed_rows = sample_count <= 1 or array.strides[1] == array.itemsize
            if array.dtype != np.float64 or not has_packed_rows:
                array = np.ascontiguousarray(array, np.float64)
            input_arrays.append(array)
        if out is None:
            results = self._zeros(sample_count)
        else:
            results = tuple(out)
            self._check_out(results, sample_count)

        def compute(card: Gpu, kernel: GpuKernel) -> None:
            kernel.columns(card, input_arrays, results, 0, sample_count)

        if self._on_gpu(sample_count, compute):
            return results
        full_vectors_end = sample_count - sample_count % self._width
        self._run(input_arrays, results, 0, full_vectors_end, carry, threads)
        if full_vectors_end < sample_count:
            self._run_rest(input_arrays, results, full_vectors_end, carry)
        return results

    def _on_gpu(self, samples: int, compute: Callable[[Gpu, GpuKernel], None], seconds: float | None = None) -> bool:
        """Let a GPU compute samples, if one is to do it; return whether it has.

        Args:
            samples: number of samples.
            compute: function that computes them, given the GPU and the kernel for it.
            seconds: expected computing time of the processor in s; None: it is not known yet.

        Raises:
            GpuError: a GPU is required, and there is none, or it fails.
        """
        choice = compute_device.current().choice
        if choice == "gpu":
            card = gpu.required()
            if samples < _FEWEST_GPU_SAMPLES or self.for_gpu is None:
                return False
            compute(card, self.for_gpu)
            return True
        if choice == "cpu" or seconds is None or samples < _FEWEST_GPU_SAMPLES or self._fails_on_gpu:
            return False
        self._busy_s += seconds
        if self._busy_s < _GPU_LOADING_S:
            return False
        card, _ = gpu.found()
        if card is None or self.for_gpu is None or self.for_gpu.seconds(samples) >= seconds:
            return False
        try:
            compute(card, self.for_gpu)
        except GpuError:  # its memory may be taken by another program: the processor can compute all
            self._fails_on_gpu = True
            return False
        return True

    @cached_property
    def for_gpu(self) -> GpuKernel | None:
        """The kernel for a GPU; None: it must run on the processor.

        That is so for kernels that take results of the sample before, that equal CasADi bit for bit, or that call the C
        library.
        """
        if self._carried or self._exact:
            return None
        text, outputs = emit(self._stages, self.inputs, list(self.outputs), 1, {})
        if not computable(text):
            return None
        return GpuKernel(text, sum(self.inputs.values()), sum(outputs.values()))

    def _zeros(self, sample_count: int) -> tuple[Array, ...]:
        """Return an array (c, k) of zeros for each output."""
        return tuple(np.zeros((count, sample_count)) for count in self.outputs.values())

    def _check_out(self, arrays: Sequence[Array], sample_count: int) -> None:
        """Check the arrays of a caller for the results of k samples.

        Raises:
            ValueError: an array has a wrong shape, or is not contiguous float64.
        """
        for (name, count), array in zip(self.outputs.items(), arrays, strict=True):
            shape = (count, sample_count)
            usable = array.flags.c_contiguous and array.flags.writeable
            if array.shape != shape or array.dtype != np.float64 or not usable:
                raise ValueError(f"out for '{name}' is not a contiguous float64 array of shape {shape}")

    def _run_rest(
        self, input_arrays: Sequence[Array], results: Sequence[Array], begin: int, carry: Array | None
    ) -> None:
        """Process the samples from `begin`, fewer than a vector, in a vector that repeats the last sample."""
        sample_count = input_arrays[0].shape[1]
        missing = self._width - (sample_count - begin)
        last_vectors = []
        for array in input_arrays:
            padded = np.pad(array[:, begin:], ((0, 0), (0, missing)), "edge")
            last_vectors.append(np.ascontiguousarray(padded))
        vectors = self._zeros(self._width)
        self._run(last_vectors, vectors, 0, self._width, carry, 1)
        for result, vector in zip(results, vectors, strict=True):
            result[:, begin:] = vector[:, : sample_count - begin]

    def rows(self, Z: Array) -> Array:
        """Return all outputs as one array (k, m), one row per sample, for samples Z (k, n) of the only input.

        Several threads are used if the computing time is long enough. Samples and results are transposed in blocks that
        fit into the processor's cache: transposing all samples at once takes five times as long as the arithmetic of a
        closed-form inverse.
        """
        (count,) = self.inputs.values()
        size = sum(self.outputs.values())
        sample_count = len(Z)
        if Z.shape != (sample_count, count):
            raise ValueError(f"samples have shape {Z.shape}, not {(sample_count, count)}")
        result = np.zeros((sample_count, size))
        first = 0  # sample from which a GPU is to compute

        def compute(card: Gpu, kernel: GpuKernel) -> None:
            kernel.rows(card, Z, result, first, sample_count)

        if self._on_gpu(sample_count, compute):
            return result
        begins = deque(range(0, sample_count, _BLOCK_SAMPLES))

        def work(most: int = sample_count) -> None:
            input_block = np.zeros((count, _BLOCK_SAMPLES))
            output_block = np.zeros((size, _BLOCK_SAMPLES))
            ins = _pointers([input_block])
            outs = _pointers([output_block])
            with contextlib.suppress(IndexError):  # no block is left
                for _ in range(most):
                    begin = begins.popleft()
                    end = min(begin + _BLOCK_SAMPLES, sample_count)
                    samples = end - begin
                    input_block[:, :samples] = Z[begin:end].T
                    vectors_end = math.ceil(samples / self._width) * self._width  # results beyond the end are discarded
                    self._call(0, vectors_end, ins, outs, None)
                    result[begin:end] = output_block[:, :samples].T

        start = time.perf_counter()
        work(1)
        seconds = (time.perf_counter() - start) * len(begins)
        first = sample_count
        if begins:
            first = begins[0]
        if self._on_gpu(sample_count - first, compute, seconds / usable_processors()):
            return result
        _share(work, len(begins), seconds)
        return result

    def single(self) -> Callable[..., Array]:
        """Return a function that takes one vector for each input and returns all results as one vector.

        The function allocates its buffers once; the overhead of a call is one microsecond.
        """
        ins = []
        columns = []
        for count in self.inputs.values():
            array = np.zeros((count, 1))
            ins.append(array)
            columns.append(array[:, 0])
        outs = np.zeros((sum(self.outputs.values()), 1))
        result = outs[:, 0]
        # PYFUNCTYPE does not release Python's lock, because releasing it would take longer than the call.
        address = ctypes.cast(self._call, ctypes.c_void_p).value or 0
        code = ctypes.PYFUNCTYPE(None)(address)  # pyright: ignore[reportArgumentType]
        begin = ctypes.c_int64(0)
        end = ctypes.c_int64(1)
        in_pointers = ctypes.cast(_pointers(ins), ctypes.c_void_p)
        out_pointers = ctypes.cast(_pointers([outs]), ctypes.c_void_p)
        no_carry = ctypes.c_void_p()
        arguments = (begin, end, in_pointers, out_pointers, no_carry)
        lock = threading.Lock()
        # `with` and `[:]` are a third slower
        acquire = lock.acquire
        release = lock.release
        copy = result.copy

        def several(*vectors: Array, _alive: Kernel = self) -> Array:
            acquire()
            try:
                for column, vector in zip(columns, vectors, strict=True):
                    column[...] = vector
                code(*arguments)
                return copy()
            finally:
                release()

        def one(vector: Array, _alive: Kernel = self) -> Array:
            acquire()
            try:
                first[...] = vector
                code(*arguments)
                return copy()
            finally:
                release()

        if len(columns) != 1:
            return several
        first = columns[0]
        return one

    def _run(
        self,
        input_arrays: Sequence[Array],
        results: Sequence[Array],
        begin: int,
        end: int,
        carry: Array | None,
        threads: int | None,
    ) -> None:
        """Process the samples `begin` to `end` - 1, a multiple of the width; arguments as in `__call__`."""
        if end <= begin:
            return
        ins = _pointers(input_arrays)
        outs = _pointers(results)
        carry_address = None
        if carry is not None:
            carry_address = carry.ctypes.data
            expected = sum(self._carried.values())
            if carry.dtype != np.float64 or carry.size != expected:
                raise ValueError(f"argument `carry` has {carry.size} numbers; expected {expected}")
        elif self._carried:
            raise ValueError(f"argument `carry` is missing for {', '.join(self._carried)}")
        if self._carried or threads == 1 or end - begin <= _CHUNK_SAMPLES:
            self._call(begin, end, ins, outs, carry_address)
            return
        size = _CHUNK_SAMPLES * max(1, (end - begin) // (_CHUNK_SAMPLES * _MOST_CHUNKS))
        chunks: deque[tuple[int, int]] = deque()
        for first in range(begin, end, size):
            chunks.append((first, min(first + size, end)))
        start = time.perf_counter()
        self._call(*chunks.popleft(), ins, outs, None)
        seconds = (time.perf_counter() - start) * len(chunks)
        workers = min(threads or usable_processors(), usable_processors())
        rest_begin = begin + size

        def compute(card: Gpu, kernel: GpuKernel) -> None:
            kernel.columns(card, input_arrays, results, rest_begin, end)

        if self._on_gpu(end - rest_begin, compute, seconds / workers):
            return

        # ctypes releases Python's lock, so that threads run in parallel. After a Ctrl-C in this thread, other
        # threads still compute their chunks; `_alive` keeps the arrays in memory until then.
        def work(_alive: object = (input_arrays, results)) -> None:
            try:
                while True:
                    self._call(*chunks.popleft(), ins, outs, None)
            except IndexError:  # no chunk is left
                return
            except BaseException:
                chunks.clear()
                raise

        _share(work, threads or len(chunks), seconds)


def _share(work: Callable[[], None], most: int, seconds: float) -> None:
    """Run `work` in this thread and, if the computing time is long enough, in other threads at the same time.

    Args:
        work: function that processes chunks until none are left.
        most: maximum number of threads, including this thread.
        seconds: computing time in s with one thread.
    """
    thread_count = min(most, seconds / _THREAD_WORTH_S, usable_processors())
    helpers = []
    for _ in range(int(thread_count) - 1):
        helpers.append(_pool().submit(work))
    work()
    for helper in helpers:
        if not helper.cancel():  # a thread that has not started is no longer needed
            helper.result()


def _pointers(arrays: Sequence[Array]) -> ctypes.Array:
    """Return the addresses of all rows of the arrays, as an argument of the compiled code."""
    addresses: list[int] = []
    for array in arrays:
        # read once per array, because reading `ctypes.data` is slow
        first = array.ctypes.data
        step = array.strides[0]
        # the step is 0 if the rows are one and the same
        addresses += [first + i * step for i in range(len(array))]
    return (ctypes.c_void_p * max(1, len(addresses)))(*addresses)
