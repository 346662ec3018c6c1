"""Run PTX on an NVIDIA graphics processor (GPU) through the driver; no CUDA toolkit and no compiler is needed.

A GPU is optional: without one, or without the extra `gpu`, everything is computed by the processor.
"""

from __future__ import annotations

import ctypes
import threading
from collections import OrderedDict
from collections.abc import Callable, Sequence
from functools import cache
from types import ModuleType
from typing import Any, Protocol, SupportsInt

import numpy as np

from twin.core import extras
from twin.core.errors import GpuError, TwinError
from twin.core.machine_code import ptx

Address = SupportsInt
"""Address in the memory of a GPU, or handle of the driver (stream, function); `int` of it has 64 bits."""

_DRIVER = "cuda.bindings.driver"

OLDEST_GENERATION = 7
"""Oldest generation of GPUs (major number of the compute capability) that runs the PTX (`machine_code.ptx`)."""

_MOST_LOADED_KERNELS = 64
"""Maximum number of loaded kernels."""


class Gpu(Protocol):
    """What is needed of a GPU. Copies and kernels of a stream are done in sequence; streams work side by side."""

    name: str

    def free_bytes(self) -> int:
        """Return how much of the GPU's memory is free."""
        ...

    def function(self, text: str, entry: str) -> Address:
        """Return the entry of a module, given as LLVM assembly for PTX."""
        ...

    def stream(self) -> Address:
        """Return a new stream."""
        ...

    def pinned(self, count: int) -> np.ndarray:
        """Return an array (count,) float64 in memory that the GPU reads and writes by itself."""
        ...

    def reserved(self, count: int) -> Address:
        """Return the address of `count` doubles in the GPU's memory."""
        ...

    def release(self, addresses: Sequence[Address], arrays: Sequence[np.ndarray], streams: Sequence[Address]) -> None:
        """Free addresses of `reserved`, arrays of `pinned` and streams."""
        ...

    def copy_to(self, address: Address, array: np.ndarray, stream: Address) -> None:
        """Begin to copy a pinned array into the GPU's memory."""
        ...

    def copy_from(self, array: np.ndarray, address: Address, stream: Address) -> None:
        """Begin to copy the GPU's memory into a pinned array."""
        ...

    def launch(
        self, function: Address, blocks: int, threads: int, arguments: Sequence[SupportsInt], stream: Address
    ) -> None:
        """Begin to run an entry in `blocks` blocks of `threads` threads; integers and addresses have 64 bits."""
        ...

    def wait(self, stream: Address) -> None:
        """Wait until all work of a stream is done."""
        ...


class CudaGpu:
    """A GPU by NVIDIA's driver."""

    def __init__(self, driver: ModuleType) -> None:
        """Open the first GPU; `driver` is the module `cuda.bindings.driver`.

        Raises:
            GpuError: there is no such GPU, or the driver refuses.
        """
        self._driver = driver
        self._lock = threading.Lock()
        self._loaded: OrderedDict[tuple[str, str], tuple[Address, Address]] = OrderedDict()  # module and function
        self._pinned: dict[int, Address] = {}  # address in this process -> address that the driver gave
        self._call("start", driver.cuInit, 0)
        device = self._call("find GPU 0", driver.cuDeviceGet, 0)
        major = driver.CUdevice_attribute.CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_MAJOR
        generation = self._call("tell the generation of the GPU", driver.cuDeviceGetAttribute, major, device)
        if generation < OLDEST_GENERATION:
            raise GpuError(f"the GPU has compute capability {generation}.x; {OLDEST_GENERATION}.0 or more is needed")
        # The context that other libraries of the process use as well.
        self._context = self._call("open the GPU", driver.cuDevicePrimaryCtxRetain, device)
        text = self._call("name the GPU", driver.cuDeviceGetName, 256, device)
        self.name = text.split(b"\0")[0].decode()

    def _call(self, purpose: str, function: Callable[..., Any], *arguments: object) -> Any:
        """Call a function of the driver; return its only result, or a tuple of all; `purpose` is for the message.

        Raises:
            GpuError: the driver returns an error.
        """
        try:
            error, *results = function(*arguments)
        except RuntimeError as failure:  # the library of the driver, or a function of it, is not found
            if function is self._driver.cuInit:
                raise GpuError("the NVIDIA driver is missing") from failure
            raise GpuError(f"the NVIDIA driver cannot {purpose}: {failure}") from failure
        if error != self._driver.CUresult.CUDA_SUCCESS:
            raise GpuError(f"the NVIDIA driver cannot {purpose}: {error.name}")
        if len(results) == 1:
            return results[0]
        return tuple(results)

    def _enter(self) -> None:
        """Make the GPU's context that of this thread."""
        self._call("open the GPU in this thread", self._driver.cuCtxSetCurrent, self._context)

    def free_bytes(self) -> int:
        """Return how much of the GPU's memory is free."""
        self._enter()
        free, _ = self._call("tell its free memory", self._driver.cuMemGetInfo)
        return int(free)

    def function(self, text: str, entry: str) -> Address:
        """Return the entry of a module, given as LLVM assembly for PTX.

        Modules stay loaded; beyond `_MOST_LOADED_KERNELS`, the one that was asked for longest ago is unloaded, so that
        a caller must not keep a function while others are asked for.
        """
        with self._lock:
            key = (text, entry)
            if key in self._loaded:
                self._loaded.move_to_end(key)
                _, function = self._loaded[key]
                return function
            self._enter()
            code = ptx(text).encode() + b"\0"
            module = self._call("load a kernel", self._driver.cuModuleLoadData, code)
            function = self._call(f"find the entry '{entry}'", self._driver.cuModuleGetFunction, module, entry.encode())
            self._loaded[key] = (module, function)
            if len(self._loaded) > _MOST_LOADED_KERNELS:
                _, (oldest, _) = self._loaded.popitem(last=False)
                self._call("unload a kernel", self._driver.cuModuleUnload, oldest)
            return function

    def stream(self) -> Address:
        """Return a new stream."""
        self._enter()
        flags = self._driver.CUstream_flags.CU_STREAM_NON_BLOCKING.value
        return self._call("start a stream", self._driver.cuStreamCreate, flags)

    def pinned(self, count: int) -> np.ndarray:
        """Return an array (count,) float64 in memory that the GPU reads and writes by itself."""
        self._enter()
        size = 8 * count
        address = self._call(f"reserve {size / 1e6:.0f} MB for copies", self._driver.cuMemHostAlloc, size, 0)
        memory = (ctypes.c_double * count).from_address(int(address))
        array = np.ctypeslib.as_array(memory)
        self._pinned[array.ctypes.data] = address
        return array

    def reserved(self, count: int) -> Address:
        """Return the address of `count` doubles in the GPU's memory."""
        self._enter()
        size = 8 * count
        return self._call(f"reserve {size / 1e6:.0f} MB of the GPU's memory", self._driver.cuMemAlloc, size)

    def release(self, addresses: Sequence[Address], arrays: Sequence[np.ndarray], streams: Sequence[Address]) -> None:
        """Free addresses of `reserved`, arrays of `pinned` (no view of them may be left) and streams."""
        self._enter()
        for stream in streams:
            self._call("end a stream", self._driver.cuStreamDestroy, stream)
        for address in addresses:
            self._call("free the GPU's memory", self._driver.cuMemFree, address)
        for array in arrays:
            self._call("free memory for copies", self._driver.cuMemFreeHost, self._pinned.pop(array.ctypes.data))

    def copy_to(self, address: Address, array: np.ndarray, stream: Address) -> None:
        """Begin to copy a pinned array into the GPU's memory."""
        self._enter()
        host = array.ctypes.data
        self._call("copy samples", self._driver.cuMemcpyHtoDAsync, address, host, array.nbytes, stream)

    def copy_from(self, array: np.ndarray, address: Address, stream: Address) -> None:
        """Begin to copy the GPU's memory into a pinned array."""
        self._enter()
        host = array.ctypes.data
        self._call("copy results", self._driver.cuMemcpyDtoHAsync, host, address, array.nbytes, stream)

    def launch(
        self, function: Address, blocks: int, threads: int, arguments: Sequence[SupportsInt], stream: Address
    ) -> None:
        """Begin to run an entry in `blocks` blocks of `threads` threads; integers and addresses have 64 bits."""
        self._enter()
        values = tuple(map(int, arguments))
        types = (ctypes.c_uint64,) * len(values)
        shape = (blocks, 1, 1, threads, 1, 1)
        shared_memory = 0
        self._call(
            "run a kernel", self._driver.cuLaunchKernel, function, *shape, shared_memory, stream, (values, types), 0
        )

    def wait(self, stream: Address) -> None:
        """Wait until all work of a stream is done."""
        self._enter()
        self._call("finish a kernel", self._driver.cuStreamSynchronize, stream)


@cache
def found() -> tuple[Gpu | None, str]:
    """Return (the first GPU of this computer or None, reason why there is none).

    The GPU is searched once: drivers do not appear while a program runs.
    """
    try:
        driver = extras.require(_DRIVER, "a graphics processor")
        return CudaGpu(driver), ""
    except TwinError as error:
        return None, str(error)


def required() -> Gpu:
    """Return the first GPU of this computer.

    Raises:
        GpuError: there is none; the message says why.
    """
    gpu, reason = found()
    if gpu is None:
        raise GpuError(f"no graphics processor can compute: {reason}; choose --device cpu or auto")
    return gpu
