"""Compile LLVM assembly, with a disk cache: to machine code in memory, or to PTX, the assembly of NVIDIA's GPUs.

Both take the same kind of text and differ in target and passes. The key of the cache is a hash of text and target.
"""

from __future__ import annotations

import ctypes
import threading
from typing import TYPE_CHECKING

import llvmlite
import llvmlite.binding as llvm

from twin.core import kernel_cache

if TYPE_CHECKING:
    from _ctypes import CFuncPtr

PTX_ARCHITECTURE = "sm_70"
"""Oldest architecture of GPUs that runs the PTX. Drivers translate it for every later one.

From this one on (V100), the cards for computing have half as many units for doubles as for single precision; of the
cards before, only the P100 had.
"""

_PTX_VERSION = "+ptx63"
"""Version of PTX: that of CUDA 10, which every driver of 2018 and later reads."""

_lock = threading.Lock()
"""LLVM's targets are set up, and texts compiled, by one thread at a time."""

_has_processor_target = False
_has_gpu_target = False


def compiled(text: str) -> tuple[CFuncPtr, object]:
    """Compile a kernel, or read it from the cache; return (kernel, object to keep alive while the kernel is used).

    The kernel is a C function of (first row, row after the last, addresses of the inputs and of the outputs, address of
    the values that one row hands to the next, or None). Its key in the cache is a hash of the text, the processor and
    the version of LLVM.
    """
    with _lock:
        target = _processor()
        cpu = f"{llvm.get_host_cpu_name()} {llvm.get_host_cpu_features().flatten()}"
        key = kernel_cache.key(f"{llvmlite.__version__} {cpu}", text)
        code = kernel_cache.read(key)
        if code is None:
            code = _object_code(text, target)
            kernel_cache.keep(key, code)
        library = llvm.JITLibraryBuilder().add_object_img(code).add_current_process().export_symbol("kernel")
        # Code and constants are in one block: if they were more than 2 GB apart, LLVM would abort the process.
        engine = llvm.create_lljit_compiler(target, use_jit_link=True)
        tracker = library.link(engine, f"k{key[:16]}")
        pointer = ctypes.c_void_p
        integer = ctypes.c_int64
        prototype = ctypes.CFUNCTYPE(None, integer, integer, pointer, pointer, pointer)
        kernel = prototype(tracker["kernel"])
        return kernel, (tracker, engine)


def ptx(text: str) -> str:
    """Return the PTX of a module, or read it from the cache; the key is a hash of the text and the version of LLVM.

    The text must call no function of the C library: LLVM would end the process.
    """
    with _lock:
        key = kernel_cache.key(f"{llvmlite.__version__} {PTX_ARCHITECTURE} {_PTX_VERSION}", text)
        code = kernel_cache.read(key)
        if code is None:
            code = _ptx(text).encode()
            kernel_cache.keep(key, code)
        return code.decode()


def lanes() -> int:
    """Return the number of doubles in two vector registers: a kernel uses two at once to hide latencies."""
    features = llvm.get_host_cpu_features()
    if features.get("avx512f"):
        return 16
    if features.get("avx2"):
        return 8
    return 4


def _processor() -> llvm.TargetMachine:
    """Return LLVM's description of this processor."""
    global _has_processor_target
    if not _has_processor_target:
        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        _has_processor_target = True
    return llvm.Target.from_default_triple().create_target_machine(
        cpu=llvm.get_host_cpu_name(),
        features=llvm.get_host_cpu_features().flatten(),
        opt=2,
        reloc="pic",
        codemodel="default",
        jit=True,
    )


def _gpu() -> llvm.TargetMachine:
    """Return LLVM's description of the GPU."""
    global _has_gpu_target
    if not _has_gpu_target:
        llvm.initialize_all_targets()
        llvm.initialize_all_asmprinters()
        _has_gpu_target = True
    target = llvm.Target.from_triple("nvptx64-nvidia-cuda")
    return target.create_target_machine(cpu=PTX_ARCHITECTURE, features=_PTX_VERSION, opt=3)


def _object_code(text: str, target: llvm.TargetMachine) -> bytes:
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


def _ptx(text: str) -> str:
    """Return the PTX of LLVM assembly."""
    target = _gpu()
    module = llvm.parse_assembly(text)
    module.triple = target.triple
    module.data_layout = str(target.target_data)
    module.verify()
    options = llvm.create_pipeline_tuning_options(speed_level=3)
    options.loop_vectorization = False
    options.slp_vectorization = False
    builder = llvm.create_pass_builder(target, options)
    builder.getModulePassManager().run(module, builder)
    return target.emit_assembly(module)
