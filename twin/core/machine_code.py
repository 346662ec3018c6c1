"""Compile LLVM assembly to machine code in memory, with a disk cache."""

from __future__ import annotations

import ctypes
import threading
from typing import TYPE_CHECKING

import llvmlite
import llvmlite.binding as llvm

from twin.core import kernel_cache

if TYPE_CHECKING:
    from _ctypes import CFuncPtr

_lock = threading.Lock()
_ready = False


def compiled(text: str) -> tuple[CFuncPtr, object]:
    """Compile a kernel, or read it from the cache; return (kernel, object to keep alive while the kernel is used).

    The kernel is a C function of (first row, row after the last, addresses of the inputs and of the outputs, address of
    the values that one row hands to the next, or None).

    The key of a kernel in the cache is a hash of the text, the processor and the version of LLVM.
    """
    with _lock:
        target = _machine()
        cpu = f"{llvm.get_host_cpu_name()} {llvm.get_host_cpu_features().flatten()}"
        key = kernel_cache.key(f"{llvmlite.__version__} {cpu}", text)
        code = kernel_cache.read(key)
        if code is None:
            code = _code(text, target)
            kernel_cache.keep(key, code)
        library = llvm.JITLibraryBuilder().add_object_img(code).add_current_process().export_symbol("kernel")
        # Code and constants are in one block: if they were more than 2 GB apart, LLVM would abort the process.
        engine = llvm.create_lljit_compiler(target, use_jit_link=True)
        tracker = library.link(engine, f"k{key[:16]}")
        pointer = ctypes.c_void_p
        integer = ctypes.c_int64
        prototype = ctypes.CFUNCTYPE(None, integer, integer, pointer, pointer, pointer)
        call = prototype(tracker["kernel"])
        return call, (tracker, engine)


def lanes() -> int:
    """Return the number of doubles in two vector registers: a kernel uses two at once to hide latencies."""
    features = llvm.get_host_cpu_features()
    if features.get("avx512f"):
        return 16
    if features.get("avx2"):
        return 8
    return 4


def _machine() -> llvm.TargetMachine:
    """Return LLVM's description of this processor."""
    global _ready
    if not _ready:
        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        _ready = True
    return llvm.Target.from_default_triple().create_target_machine(
        cpu=llvm.get_host_cpu_name(),
        features=llvm.get_host_cpu_features().flatten(),
        opt=2,
        reloc="pic",
        codemodel="default",
        jit=True,
    )


def _code(text: str, target: llvm.TargetMachine) -> bytes:
    """Return the object code of LLVM assembly."""
    module = llvm.parse_assembly(text)
    module.verify()
    options = llvm.create_pipeline_tuning_options(speed_level=2)
    # the text is already vectorised
    options.loop_vectorization = False
    options.slp_vectorization = False
    options.loop_unrolling = False
    builder = llvm.create_pass_builder(target, options)
    builder.getModulePassManager().run(module, builder)
    return target.emit_object(module)
