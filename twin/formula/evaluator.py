"""Evaluate expressions on NumPy arrays: CasADi functions without its argument handling, and compiled kernels."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import cached_property, partial
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from twin.core.spatial import Array
from twin.formula import symbolic

if TYPE_CHECKING:
    from twin.codegen import Kernel

_KERNEL_SAMPLES = 20_000
"""Minimum number of samples in a batch for which a compiled kernel is used."""

_BLOCK_SIZE = 32
"""Number of samples in one mapped call; larger blocks are no faster, and are slower for small batches."""

_MAX_SINGLE_SAMPLES = 16
"""Maximum number of samples that are evaluated one by one: a block, which is always full, costs more."""


def attach(function: ca.Function, *arguments: Array) -> tuple[Array, Callable[[], None]]:
    """Return (array, procedure). The procedure has no arguments and writes the value of the function to the array.

    The procedure reads the current numbers from the memory of `arguments`, which are contiguous arrays. Nothing is
    copied or checked, so that the procedure is fast enough for control loops.
    """
    result = np.zeros(function.size1_out(0))
    buffer, trigger = function.buffer()
    for i, argument in enumerate(arguments):
        if argument.size:
            buffer.set_arg(i, argument.data)  # pyright: ignore[reportCallIssue]
    if result.size:
        buffer.set_res(0, result.data)  # pyright: ignore[reportCallIssue]
    procedure = partial(trigger)
    procedure.__dict__["memory"] = buffer, arguments  # kept alive as long as this procedure
    return result, procedure


class Evaluator:
    """A CasADi function of one vector, fast for single vectors and for batches.

    CasADi's virtual machine evaluates single vectors, until `compile_one` replaces it, and batches in blocks; a
    compiled kernel evaluates large batches. `Function.buffer()` avoids CasADi's argument handling, which takes about 30
    times as long as a small function. Because a viewer calls from several threads, two locks protect the memory of
    these calls: one that of single vectors, the other that of blocks.

    Attributes:
        one: function that returns the value, in the declared shape, at one vector z.
    """

    def __init__(self, name: str, z: symbolic.SX, expression: symbolic.SX, shape: tuple[int, ...] = ()) -> None:
        self.name = name
        self.shape = shape or (expression.numel(),)
        if expression.shape[1] > 1:
            column = symbolic.flat(expression)
        else:
            column = ca.densify(expression)
        self.function = ca.Function(name, [z], [column])
        self._block_lock = threading.Lock()
        self.one = self._caller()

    def compile_one(self) -> None:
        """Replace `one` by compiled code, which takes half the time and gives the same numbers to the last bit.

        Compilation takes time, and therefore pays off only in loops of many calls.
        """
        from twin import codegen

        stage = codegen.Stage(self.function, ("z",), ("out",))
        sizes = {"z": self.function.size1_in(0)}
        shape = self.shape
        try:
            code = codegen.Kernel([stage], sizes, ["out"], single=True, exact=True).single()
        except ValueError:  # kernels do not support some operations: CasADi remains
            return
        if len(shape) == 1:
            self.one = code
        else:
            self.one = lambda z: code(z).reshape(shape)

    def _caller(self) -> Callable[[Array], Array]:
        """Return the function `one`, by CasADi's virtual machine."""
        # Local names are used instead of attributes, `with` and `[:]`, which would take as long as the function itself.
        argument, compute = self.bind()
        lock = threading.Lock()
        acquire = lock.acquire
        release = lock.release

        def one(z: Array) -> Array:
            acquire()
            try:
                argument[...] = z
                return compute()
            finally:
                release()

        return one

    def bind(self) -> tuple[Array, Callable[[], Array]]:
        """Return a vector z to fill, and a function that returns the value at z; for use in a single thread.

        This is faster in control loops than `one`, which needs a lock and copies its argument.
        """
        z = np.zeros(self.function.size1_in(0))
        result, compute = attach(self.function, z)
        copy = result.reshape(self.shape).copy

        def call() -> Array:
            compute()
            return copy()

        return z, call

    @cached_property
    def _kernel(self) -> Kernel | None:
        """The compiled kernel for large batches; None if kernels do not support an operation of the function."""
        from twin import codegen

        stage = codegen.Stage(self.function, ("z",), ("out",))
        sizes = {"z": self.function.size1_in(0)}
        try:
            return codegen.Kernel([stage], sizes, ["out"])
        except ValueError:  # kernels do not support rootfinders and some operations: use CasADi
            return None

    @cached_property
    def _mapped(self) -> tuple:
        """Inputs (block, n) and outputs (block, m) of a mapped call, the function that makes it, and its buffer."""
        function = self.function.map(_BLOCK_SIZE)
        inputs = np.zeros((_BLOCK_SIZE, self.function.size1_in(0)))
        outputs = np.zeros((_BLOCK_SIZE, self.function.size1_out(0)))
        buffer, trigger = function.buffer()
        buffer.set_arg(0, inputs.reshape(-1).data)  # pyright: ignore[reportCallIssue]
        buffer.set_res(0, outputs.reshape(-1).data)  # pyright: ignore[reportCallIssue]
        return inputs, outputs, trigger, buffer  # the buffer must stay alive

    def many(self, samples: Array) -> Array:
        """Return the values (k, *shape) at the rows of Z (k, n)."""
        count = len(samples)
        width = self.function.size1_out(0)
        if count >= _KERNEL_SAMPLES and width and self._kernel is not None:
            return self._kernel.rows(np.asarray(samples, float)).reshape(count, *self.shape)
        result = np.zeros((count, width))
        if count <= _MAX_SINGLE_SAMPLES:
            for i in range(count):
                result[i] = self.one(samples[i]).ravel()
        elif width:
            with self._block_lock:
                inputs, outputs, trigger, _ = self._mapped
                for start in range(0, count, _BLOCK_SIZE):
                    size = min(_BLOCK_SIZE, count - start)
                    inputs[:size] = samples[start : start + size]
                    trigger()
                    result[start : start + size] = outputs[:size]
        return result.reshape(count, *self.shape)
