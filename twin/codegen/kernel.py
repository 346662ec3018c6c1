"""A kernel with arrays: structure of arrays in, structure of arrays out, on all processors."""

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
from twin.codegen.machine import compiled, lanes
from twin.core.spatial import Array

_CHUNK, _PIECES = 4096, 64
"""Least samples that a thread takes at once, and about the most pieces of work: each costs a turn of Python's lock."""
_WORTH = 2e-4
"""Seconds of work for which it is worth waking a thread."""


@cache
def _processors() -> int:
    return len(os.sched_getaffinity(0))


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(_processors(), "twin-kernel")


class Kernel:
    """Stages of CasADi functions, called for many samples.

    Attributes:
        inputs: numbers of a sample by name.
        outputs: numbers of a result by name.
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
    ) -> None:
        """Compile, or take from the cache.

        Args:
            stages: see `Stage`.
            inputs: numbers of a sample by name.
            outputs: names of what is wanted.
            single: one sample at a time: the fastest for a few samples.
            carried: what one sample takes over from the one before (see `emit`): samples in sequence, no threads.
            backwards: with `carried`: from the last sample to the first.

        Raises:
            ValueError: an operation of CasADi that cannot be compiled.
        """
        self.inputs, self._carried = dict(inputs), dict(carried or {})
        self._width = 1 if single or carried else lanes()
        text, self.outputs = emit(stages, inputs, outputs, self._width, self._carried, backwards)
        self._call, self._alive = compiled(text)

    def __call__(
        self,
        *arrays: Array,
        carry: Array | None = None,
        threads: int | None = None,
        out: Sequence[Array] | None = None,
    ) -> tuple[Array, ...]:
        """Return an array (numbers, k) for each output.

        Args:
            arrays: (numbers, k) float64 in the order of `inputs`; samples along the last axis.
            carry: what the first sample takes over; afterwards what the last one left.
            threads: at most so many; default as many as there are processors.
            out: arrays (numbers, k) float64 that are filled and returned: fresh memory costs as much as a small kernel.

        Raises:
            ValueError: an array has another shape, or one of `out` cannot be filled.
        """
        if len(arrays) != len(self.inputs):
            raise ValueError(f"{len(arrays)} arrays for {', '.join(self.inputs)}")
        k = arrays[0].shape[-1] if arrays else 0
        given = []
        for (name, count), a in zip(self.inputs.items(), arrays, strict=True):
            if a.shape != (count, k):
                raise ValueError(f"'{name}' has shape {a.shape}, not {(count, k)}")
            # Samples must be neighbours in memory; the rows of a slice may lie apart.
            packed = a.dtype == np.float64 and (k <= 1 or a.strides[1] == a.itemsize)
            given.append(a if packed else np.ascontiguousarray(a, np.float64))
        shapes = {name: (count, k) for name, count in self.outputs.items()}
        results = tuple(np.zeros(shape) for shape in shapes.values()) if out is None else tuple(out)
        for (name, shape), a in zip(shapes.items(), results, strict=True):
            if a.shape != shape or a.dtype != np.float64 or not (a.flags.c_contiguous and a.flags.writeable):
                raise ValueError(f"out for '{name}' is no contiguous float64 array of shape {shape}")
        whole = k - k % self._width
        self._run(given, results, 0, whole, carry, threads)
        if whole < k:  # the last few, in a vector of their own
            more = ((0, 0), (0, self._width - k + whole))
            rest = [np.ascontiguousarray(np.pad(a[:, whole:], more, "edge")) for a in given]
            last = tuple(np.zeros((count, self._width)) for count in self.outputs.values())
            self._run(rest, last, 0, self._width, carry, 1)
            for a, b in zip(results, last, strict=True):
                a[:, whole:] = b[:, : k - whole]
        return results

    def single(self) -> Callable[..., Array]:
        """Return a function of one vector for each input, that returns all results as one vector.

        Arrays stay where they are, so that a call costs a microsecond more than its arithmetic.
        """
        ins = [np.zeros((count, 1)) for count in self.inputs.values()]
        outs = np.zeros((sum(self.outputs.values()), 1))
        flat, result = [a[:, 0] for a in ins], outs[:, 0]
        # Arguments are made once, and Python's lock is not given away for what takes less time than that.
        address = ctypes.cast(self._call, ctypes.c_void_p).value or 0
        code = ctypes.PYFUNCTYPE(None)(address)  # pyright: ignore[reportArgumentType]
        pointers = (ctypes.cast(_pointers(a), ctypes.c_void_p) for a in (ins, [outs]))
        arguments = (ctypes.c_int64(0), ctypes.c_int64(1), *pointers, ctypes.c_void_p())
        lock = threading.Lock()
        acquire, release, copy = lock.acquire, lock.release, result.copy  # `with` and `[:]` cost a third more

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
            raise ValueError(f"no carry for {', '.join(self._carried)}")
        if carry is not None and (carry.dtype != np.float64 or carry.size != sum(self._carried.values())):
            raise ValueError(f"carry has {carry.size} numbers, not {sum(self._carried.values())}")
        if self._carried or threads == 1 or end - begin <= _CHUNK:
            self._call(begin, end, ins, outs, start)
            return
        size = _CHUNK * max(1, (end - begin) // (_CHUNK * _PIECES))
        left = deque((i, min(i + size, end)) for i in range(begin, end, size))
        first = time.perf_counter()
        self._call(*left.popleft(), ins, outs, None)
        wanted = min(threads or len(left), (time.perf_counter() - first) * len(left) / _WORTH, _processors())

        def work() -> None:  # ctypes lets other threads run meanwhile
            with contextlib.suppress(IndexError):
                while True:
                    self._call(*left.popleft(), ins, outs, None)

        helpers = [_pool().submit(work) for _ in range(int(wanted) - 1)]
        work()
        for helper in helpers:
            if not helper.cancel():  # one that has not begun has nothing left to do
                helper.result()


def _pointers(arrays: Sequence[Array]) -> ctypes.Array:
    rows: list[int] = []
    for a in arrays:
        first, step = a.ctypes.data, a.strides[0]  # asked once an array: it costs more than all the rest
        rows += range(first, first + len(a) * step, step) if step else [first] * len(a)
    return (ctypes.c_void_p * max(1, len(rows)))(*rows)
