"""Compile LLVM assembly to PTX, the assembly of NVIDIA's graphics processors, with a disk cache."""

from __future__ import annotations

import threading

import llvmlite
import llvmlite.binding as llvm

from twin.core import kernel_cache

ARCHITECTURE = "sm_70"
"""Oldest architecture that runs the code. Drivers translate it for every later one.

From this one on (V100), the cards for computing have half as many units for doubles as for single precision; of the
cards before, only the P100 had.
"""

_FEATURES = "+ptx63"
"""Version of PTX: that of CUDA 10, which every driver of 2018 and later reads."""

_lock = threading.Lock()
_ready = False


def ptx(text: str) -> str:
    """Return the PTX of a module, or read it from the cache; the key is a hash of the text and the version of LLVM.

    The text must call no function of the C library: LLVM would end the process.
    """
    with _lock:
        key = kernel_cache.key(f"{llvmlite.__version__} {ARCHITECTURE} {_FEATURES}", text)
        code = kernel_cache.read(key)
        if code is None:
            code = _code(text).encode()
            kernel_cache.keep(key, code)
        return code.decode()


def _code(text: str) -> str:
    """Return the PTX of LLVM assembly."""
    target = _machine()
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


def _machine() -> llvm.TargetMachine:
    """Return LLVM's description of the GPU."""
    global _ready
    if not _ready:
        llvm.initialize_all_targets()
        llvm.initialize_all_asmprinters()
        _ready = True
    target = llvm.Target.from_triple("nvptx64-nvidia-cuda")
    return target.create_target_machine(cpu=ARCHITECTURE, features=_FEATURES, opt=3)
