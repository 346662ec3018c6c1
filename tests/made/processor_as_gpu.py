"""A GPU that is none: the processor runs the text of each kernel for a GPU, one thread after the other.

All but the driver is real: the text that becomes PTX (only its entry differs), the blocks, the copies, the distances
between numbers. Copies and kernels are done late, when a stream is waited for, so that what reads a result too early
reads NaN.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any

import llvmlite.binding as llvm
import numpy as np

from twin.codegen.gpu_entry import ENTRY
from twin.core import machine_code
from twin.core.errors import GpuError

_THREADS = """
define void @all(i64 %threads, i64 %end, i64 %in, i64 %a, i64 %b, i64 %out, i64 %c, i64 %d) {
entry:
  %in.p = inttoptr i64 %in to ptr
  %out.p = inttoptr i64 %out to ptr
  br label %loop
loop:
  %i = phi i64 [ 0, %entry ], [ %next, %loop ]
  call void @sample(i64 %i, i64 %end, ptr %in.p, i64 %a, i64 %b, ptr %out.p, i64 %c, i64 %d)
  %next = add i64 %i, 1
  %more = icmp slt i64 %next, %threads
  br i1 %more, label %loop, label %exit
exit:
  ret void
}
"""
"""Runs all threads of a launch, one after the other."""


class ProcessorAsGpu:
    """See the module; `free` is the memory that is left, in bytes."""

    def __init__(self, free: int = 1 << 32, name: str = "processor as GPU") -> None:
        self.name = name
        self.free = free
        self.memory: dict[int, np.ndarray] = {}
        self.launches: list[tuple[int, int]] = []
        self.modules = 0
        self._work: dict[int, list] = {}
        self._functions: dict[str, Any] = {}
        self._alive: list[Any] = []

    @property
    def waiting(self) -> list[int]:
        """Number of copies and launches of each stream that are not done."""
        return [len(work) for work in self._work.values()]

    def free_bytes(self) -> int:
        return self.free

    def function(self, text: str, entry: str) -> Any:
        assert entry == ENTRY
        if text not in self._functions:
            self.modules += 1
            self._functions[text] = self._compiled(text)
        return self._functions[text]

    def _compiled(self, text: str) -> Any:
        sample = text[: text.index("declare i32 @llvm.nvvm")]
        target = machine_code._processor()
        module = llvm.parse_assembly(sample + _THREADS)
        module.verify()
        options = llvm.create_pipeline_tuning_options(speed_level=2)
        builder = llvm.create_pass_builder(target, options)
        builder.getModulePassManager().run(module, builder)
        code = target.emit_object(module)
        library = llvm.JITLibraryBuilder().add_object_img(code).add_current_process().export_symbol("all")
        engine = llvm.create_lljit_compiler(target, use_jit_link=True)
        tracker = library.link(engine, f"threads{self.modules}")
        self._alive.append((tracker, engine))
        return ctypes.CFUNCTYPE(None, *[ctypes.c_int64] * 8)(tracker["all"])

    def stream(self) -> int:
        self._work[len(self._work)] = []
        return len(self._work) - 1

    def pinned(self, count: int) -> np.ndarray:
        return np.full(count, np.nan)

    def reserved(self, count: int) -> int:
        if 8 * count > self.free:
            raise GpuError(f"{self.name} is full")
        self.free -= 8 * count
        array = np.full(count, np.nan)
        self.memory[array.ctypes.data] = array
        return array.ctypes.data

    def release(self, addresses: Sequence[int], arrays: Sequence[np.ndarray], streams: Sequence[int]) -> None:
        for address in addresses:
            self.free += self.memory.pop(address).nbytes

    def copy_to(self, address: int, array: np.ndarray, stream: int) -> None:
        self._work[stream].append(lambda: self._filled(address, array))

    def _filled(self, address: int, array: np.ndarray) -> None:
        self._at(address, array.size)[:] = array

    def _at(self, address: int, count: int) -> np.ndarray:
        """Return the memory (count,) from an address within a reserved piece."""
        for begin, piece in self.memory.items():
            first = (address - begin) // 8
            if first >= 0 and first + count <= piece.size:
                return piece[first : first + count]
        raise AssertionError("the address is in no reserved memory")

    def copy_from(self, array: np.ndarray, address: int, stream: int) -> None:
        array[:] = np.nan
        self._work[stream].append(lambda: self._read(address, array))

    def _read(self, address: int, array: np.ndarray) -> None:
        array[:] = self._at(address, array.size)

    def launch(self, function: Any, blocks: int, threads: int, arguments: Sequence[Any], stream: int) -> None:
        self.launches.append((blocks, threads))
        self._work[stream].append(lambda: function(blocks * threads, *arguments))

    def wait(self, stream: int) -> None:
        for work in self._work[stream]:
            work()
        self._work[stream].clear()
