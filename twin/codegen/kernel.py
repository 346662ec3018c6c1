"""Run a compiled kernel on all processors; each number of the samples has an array of its own (structure of arrays)."""

from __future__ import annotations

import contextlib
import ctypes
import os
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np

from twin.codegen.emit import Stage, emit
from twin.core.machine import compiled, lanes
from twin.core.spatial import Array

_CHUNK, _PIECES = 4096, 64
"""Minimum number of samples in a chunk, and maximum number of chunks. A chunk acquires Python's lock once."""
_BLOCK = 1024
"""Number of samples in a block that is transposed at once: input and output (20 numbers each) fit into the cache."""
_WORTH = 2e-4
"""Minimum computing time in s for which a further thread is used."""


@cache
def _processors() -> int:
    return len(os.sched_getaffinity(0))


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(_processors(), "twin-kernel")


class Kernel:
    """Compiled stages (CasADi functions), called for many samples.

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
        self.inputs, self._carried = dict(inputs), dict(carried or {})
        self._width = 1 if single or carried else lanes()
        text, self.outputs = emit(stages, inputs, outputs, self._width, self._carried, backwards, exact)
        self._call, self._alive = compiled(text)

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
        k = arrays[0].shape[-1] if arrays else 0
        given = []
        for (name, count), a in zip(self.inputs.items(), arrays, strict=True):
            if a.shape != (count, k):
                raise ValueError(f"'{name}' has shape {a.shape}, not {(count, k)}")
            # Each row (the samples of one number) must be contiguous in memory; the rows need not be adjacent.
            packed = a.dtype == np.float64 and (k <= 1 or a.strides[1] == a.itemsize)
            given.append(a if packed else np.ascontiguousarray(a, np.float64))
        shapes = {name: (count, k) for name, count in self.outputs.items()}
        results = tuple(np.zeros(shape) for shape in shapes.values()) if out is None else tuple(out)
        for (name, shape), a in zip(shapes.items(), results, strict=True):
            if a.shape != shape or a.dtype != np.float64 or not (a.flags.c_contiguous and a.flags.writeable):
                raise ValueError(f"out for '{name}' is not a contiguous float64 array of shape {shape}")
        whole = k - k % self._width
        self._run(given, results, 0, whole, carry, threads)
        if whole < k:  # process the last samples in a separate, incomplete vector
            more = ((0, 0), (0, self._width - k + whole))
            rest = [np.ascontiguousarray(np.pad(a[:, whole:], more, "edge")) for a in given]
            last = tuple(np.zeros((count, self._width)) for count in self.outputs.values())
            self._run(rest, last, 0, self._width, carry, 1)
            for a, b in zip(results, last, strict=True):
                a[:, whole:] = b[:, : k - whole]
        return results

    def rows(self, Z: Array) -> Array:
        """Return all outputs as one array (k, m), one row per sample, for samples Z (k, n) of the only input.

        Several threads are used if the computing time is long enough. Samples and results are transposed in blocks that
        fit into the processor's cache: transposing all samples at once takes five times as long as the arithmetic of a
        closed-form inverse.
        """
        (count,), size, k = self.inputs.values(), sum(self.outputs.values()), len(Z)
        if Z.shape != (k, count):
            raise ValueError(f"samples have shape {Z.shape}, not {(k, count)}")
        result, left = np.zeros((k, size)), deque(range(0, k, _BLOCK))

        def work(most: int = k) -> None:
            given, made = np.zeros((count, _BLOCK)), np.zeros((size, _BLOCK))
            ins, outs = _pointers([given]), _pointers([made])
            with contextlib.suppress(IndexError):
                for _ in range(most):
                    begin = left.popleft()
                    end = min(begin + _BLOCK, k)
                    given[:, : end - begin] = Z[begin:end].T
                    whole = -(-(end - begin) // self._width) * self._width  # results beyond the end are discarded
                    self._call(0, whole, ins, outs, None)
                    result[begin:end] = made[:, : end - begin].T

        first = time.perf_counter()
        work(1)
        _share(work, len(left), (time.perf_counter() - first) * len(left))
        return result

    def single(self) -> Callable[..., Array]:
        """Return a function that takes one vector for each input and returns all results as one vector.

        The function allocates its buffers once; the overhead of a call is one microsecond.
        """
        ins = [np.zeros((count, 1)) for count in self.inputs.values()]
        outs = np.zeros((sum(self.outputs.values()), 1))
        flat, result = [a[:, 0] for a in ins], outs[:, 0]
        # PYFUNCTYPE does not release Python's lock, because releasing it would take longer than the call.
        address = ctypes.cast(self._call, ctypes.c_void_p).value or 0
        code = ctypes.PYFUNCTYPE(None)(address)  # pyright: ignore[reportArgumentType]
        pointers = (ctypes.cast(_pointers(a), ctypes.c_void_p) for a in (ins, [outs]))
        arguments = (ctypes.c_int64(0), ctypes.c_int64(1), *pointers, ctypes.c_void_p())
        lock = threading.Lock()
        acquire, release, copy = lock.acquire, lock.release, result.copy  # `with` and `[:]` are a third slower

        def several(*vectors: Array, _alive: Kernel = self) -> Array:
            acquire()
            try:
                for a, v in zip(flat, vectors, strict=True):
                    a[...] = v
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

        first = flat[0] if flat else result
        return one if len(flat) == 1 else several

    def _run(
        self,
        given: Sequence[Array],
        results: Sequence[Array],
        begin: int,
        end: int,
        carry: Array | None,
        threads: int | None,
    ) -> None:
        if end <= begin:
            return
        ins, outs = _pointers(given), _pointers(results)
        start = None if carry is None else carry.ctypes.data
        if self._carried and carry is None:
            raise ValueError(f"argument `carry` is missing for {', '.join(self._carried)}")
        if carry is not None and (carry.dtype != np.float64 or carry.size != sum(self._carried.values())):
            raise ValueError(f"argument `carry` has {carry.size} numbers; expected {sum(self._carried.values())}")
        if self._carried or threads == 1 or end - begin <= _CHUNK:
            self._call(begin, end, ins, outs, start)
            return
        size = _CHUNK * max(1, (end - begin) // (_CHUNK * _PIECES))
        left = deque((i, min(i + size, end)) for i in range(begin, end, size))
        first = time.perf_counter()
        self._call(*left.popleft(), ins, outs, None)
        each = time.perf_counter() - first

        # ctypes releases Python's lock, so that threads run in parallel. After a Ctrl-C in this thread, other
        # threads still compute their chunks; `_alive` keeps the arrays in memory until then.
        def work(_alive: object = (given, results)) -> None:
            try:
                while True:
                    self._call(*left.popleft(), ins, outs, None)
            except IndexError:
                return
            except BaseException:
                left.clear()
                raise

        _share(work, threads or len(left), each * len(left))


def _share(work: Callable[[], None], most: int, seconds: float) -> None:
    """Run `work` in this thread and, if the computing time is long enough, in other threads at the same time.

    Args:
        work: function that processes chunks until none are left.
        most: maximum number of threads, including this thread.
        seconds: computing time in s with one thread.
    """
    wanted = min(most, seconds / _WORTH, _processors())
    helpers = [_pool().submit(work) for _ in range(int(wanted) - 1)]
    work()
    for helper in helpers:
        if not helper.cancel():  # a thread that has not started is no longer needed
            helper.result()


def _pointers(arrays: Sequence[Array]) -> ctypes.Array:
    rows: list[int] = []
    for a in arrays:
        first, step = a.ctypes.data, a.strides[0]  # read once per array, because reading `ctypes.data` is slow
        rows += range(first, first + len(a) * step, step) if step else [first] * len(a)
    return (ctypes.c_void_p * max(1, len(rows)))(*rows)
