"""Compile LLVM assembly to machine code in memory, with a disk cache."""

from __future__ import annotations

import contextlib
import ctypes
import hashlib
import os
import stat
import threading
from typing import Any

import llvmlite
import llvmlite.binding as llvm

from twin.core.atomic import atomic_folder
from twin.core.cache import cache_folder
from twin.core.errors import OutputError

_CACHED = 1024
"""Maximum number of kernels in the cache; the oldest kernels are removed first."""

Call = Any
"""C type of the kernel: a function of (begin, end, in, out, carry)."""

_lock = threading.Lock()
_ready = False


def compiled(text: str) -> tuple[Call, Any]:
    """Compile a kernel, or read it from the cache; return (kernel, object to keep alive while the kernel is used).

    The cache is in the user's folder and may be deleted at any time. The key of a kernel is a hash of the text, the
    processor and the version of LLVM. Truncated files, and files that other users can write, are not loaded.
    """
    with _lock:
        target = _machine()
        cpu = f"{llvm.get_host_cpu_name()} {llvm.get_host_cpu_features().flatten()}"
        key = hashlib.sha256(f"{llvmlite.__version__} {cpu}\n{text}".encode()).hexdigest()
        code = _cached(key)
        if code is None:
            code = _code(text, target)
            _keep(key, code)
        library = llvm.JITLibraryBuilder().add_object_img(code).add_current_process().export_symbol("kernel")
        # Code and constants are in one block: if they were more than 2 GB apart, LLVM would abort the process.
        engine = llvm.create_lljit_compiler(target, use_jit_link=True)
        tracker = library.link(engine, f"k{key[:16]}")
        pointer, integer = ctypes.c_void_p, ctypes.c_int64
        call = ctypes.CFUNCTYPE(None, integer, integer, pointer, pointer, pointer)(tracker["kernel"])
        return call, (tracker, engine)


def lanes() -> int:
    """Return the number of doubles in two vector registers: a kernel uses two at once to hide latencies."""
    features = llvm.get_host_cpu_features()
    return 16 if features.get("avx512f") else 8 if features.get("avx2") else 4


def _machine() -> llvm.TargetMachine:
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
    module = llvm.parse_assembly(text)
    module.verify()
    options = llvm.create_pipeline_tuning_options(speed_level=2)
    options.loop_vectorization = options.slp_vectorization = options.loop_unrolling = False  # already vectorised
    builder = llvm.create_pass_builder(target, options)
    builder.getModulePassManager().run(module, builder)
    return target.emit_object(module)


def _cached(key: str) -> bytes | None:
    path = cache_folder("kernels") / f"{key}.o"
    try:
        for at in (path.parent, path):
            seen = at.stat()
            if seen.st_uid != os.getuid() or seen.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
                return None
        data = path.read_bytes()
    except OSError:
        return None
    digest, code = data[:32], data[32:]
    return code if hashlib.sha256(code).digest() == digest else None


def _keep(key: str, code: bytes) -> None:
    folder = cache_folder("kernels")
    with contextlib.suppress(OSError, OutputError):  # a cache that cannot be written is not an error
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        for old in sorted(folder.glob("*.o"), key=lambda p: p.stat().st_mtime)[:-_CACHED]:
            old.unlink()
        with atomic_folder(folder) as work:
            (work / f"{key}.o").write_bytes(hashlib.sha256(code).digest() + code)
            (work / f"{key}.o").chmod(0o600)
