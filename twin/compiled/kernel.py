"""A kernel with arrays: structure of arrays in, structure of arrays out, on all processors."""

from __future__ import annotations

import ctypes
import os
import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np

from twin.compiled.emit import Stage, emit
from twin.compiled.machine import compiled, lanes
from twin.spatial import Array

_CHUNK = 4096
"""Samples that a thread takes at once: microseconds to milliseconds of work, a few hundred KB of memory."""


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(len(os.sched_getaffinity(0)), "twin-kernel")


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

    def __call__(self, *arrays: Array, carry: Array | None = None, threads: int | None = None) -> tuple[Array, ...]:
        """Return an array (numbers, k) for each output.

        Args:
            arrays: (numbers, k) float64 in the order of `inputs`; samples along the last axis.
            carry: what the first sample takes over; afterwards what the last one left.
            threads: at most so many; default as many as there are processors.
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
        results = tuple(np.zeros((count, k)) for count in self.outputs.values())
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
        flat = [a[:, 0] for a in ins]
        arguments = (0, 1, _pointers(ins), _pointers([outs]), None)
        lock, result = threading.Lock(), outs[:, 0]

        def one(*vectors: Array) -> Array:
            with lock:
                for a, v in zip(flat, vectors, strict=True):
                    a[:] = v
                self._call(*arguments)  # by self, whose code must stay in memory
                return result.copy()

        return one

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
        bounds = [*range(begin, end, _CHUNK), end]
        share = max(1, -(-(len(bounds) - 1) // (threads or 10**9)))
        pieces = [(bounds[i], bounds[min(i + share, len(bounds) - 1)]) for i in range(0, len(bounds) - 1, share)]
        # ctypes lets other threads run meanwhile
        list(_pool().map(lambda piece: self._call(*piece, ins, outs, None), pieces))


def _pointers(arrays: Sequence[Array]) -> ctypes.Array:
    rows: list[int] = []
    for a in arrays:
        first, step = a.ctypes.data, a.strides[0]  # asked once an array: it costs more than all the rest
        rows += range(first, first + len(a) * step, step) if step else [first] * len(a)
    return (ctypes.c_void_p * max(1, len(rows)))(*rows)
