"""Turn a kernel of width 1 into a kernel for a graphics processor (GPU): each thread computes one sample.

The loop of `twin.codegen.emit` remains as it is and is called for one sample, so that processor and GPU run the same
operations. Around it, a function finds the addresses of the sample's numbers, and an entry finds the number of the
thread. Text for NVIDIA's PTX differs from text for a processor in the entry only.
"""

from __future__ import annotations

import re

_LIBRARY = re.compile(r"declare double @(?!llvm\.)|@llvm\.(?:exp|log|pow|sinh|cosh|tanh)\.")
"""Functions of the C library, and intrinsics that LLVM replaces by them; a GPU has no C library."""

THREADS = 128
"""Number of threads in a block. With more, a block of the largest kernels would need more registers than there are."""

ENTRY = "samples"
"""Name of the entry in PTX."""


def computable(text: str) -> bool:
    """Return whether a GPU can run a kernel: whether its text calls no function of the C library."""
    return not _LIBRARY.search(text)


def sample_text(text: str, inputs: int, outputs: int) -> str:
    """Return LLVM assembly of `void sample(i64 i, i64 end, in, i64, i64, out, i64, i64)`, which computes sample i.

    Nothing happens for i >= end. Numbers of samples are float64. `in` and `out` are addresses; each is followed by the
    distances, in numbers, from one number of a sample to the next and from one sample to the next, so that samples may
    be stored by rows or by columns.

    Args:
        text: kernel of width 1 without carried arguments, from `emit`.
        inputs: count of numbers that a sample takes.
        outputs: count of numbers that it gives.
    """
    head = "define void @kernel("
    if text.count(head) != 1:
        raise ValueError("the text has no function @kernel, or several")
    loop = text.replace(head, "define internal void @kernel(")
    lines = [
        loop,
        "define internal void @sample(i64 %i, i64 %end, ptr %in, i64 %in.number, i64 %in.sample, "
        "ptr %out, i64 %out.number, i64 %out.sample) alwaysinline nounwind {",
        "entry:",
        f"  %ins = alloca [{max(1, inputs)} x ptr], align 8",
        f"  %outs = alloca [{max(1, outputs)} x ptr], align 8",
        "  %exists = icmp slt i64 %i, %end",
        "  br i1 %exists, label %compute, label %exit",
        "compute:",
        *_rows("in", inputs),
        *_rows("out", outputs),
        "  %next = add i64 %i, 1",
        "  call void @kernel(i64 %i, i64 %next, ptr %ins, ptr %outs, ptr null) alwaysinline",
        "  br label %exit",
        "exit:",
        "  ret void",
        "}",
    ]
    return "\n".join(lines)


def _rows(kind: str, count: int) -> list[str]:
    """Return the lines that store the address of each number's row; `kind` is "in" or "out".

    The kernel adds i numbers to the address of a row. The address of sample i is i * distance numbers behind the first
    one; therefore the row begins at i * (distance - 1) numbers.
    """
    lines = [
        f"  %{kind}.less = sub i64 %{kind}.sample, 1",
        f"  %{kind}.moved = mul i64 %i, %{kind}.less",
        f"  %{kind}.0 = getelementptr double, ptr %{kind}, i64 %{kind}.moved",
    ]
    for number in range(count):
        lines.append(f"  %{kind}.p{number} = getelementptr ptr, ptr %{kind}s, i64 {number}")
        lines.append(f"  store ptr %{kind}.{number}, ptr %{kind}.p{number}, align 8")
        if number + 1 < count:
            following = f"getelementptr double, ptr %{kind}.{number}, i64 %{kind}.number"
            lines.append(f"  %{kind}.{number + 1} = {following}")
    return lines


def ptx_text(sample: str) -> str:
    """Return LLVM assembly for PTX of the entry `ENTRY`, whose threads call `sample` for the samples below `end`.

    The entry's parameters are those of `sample` without i, which is the number of the thread.
    """
    registers = {"block": "ctaid", "threads": "ntid", "thread": "tid"}
    lines = [sample]
    for register in registers.values():
        lines.append(f"declare i32 @llvm.nvvm.read.ptx.sreg.{register}.x()")
    lines += [
        f"define ptx_kernel void @{ENTRY}(i64 %end, ptr addrspace(1) %in, i64 %in.number, i64 %in.sample, "
        "ptr addrspace(1) %out, i64 %out.number, i64 %out.sample) #0 {",
    ]
    for name, register in registers.items():
        lines.append(f"  %{name}.32 = call i32 @llvm.nvvm.read.ptx.sreg.{register}.x()")
        lines.append(f"  %{name} = zext i32 %{name}.32 to i64")
    lines += [
        "  %before = mul i64 %block, %threads",
        "  %i = add i64 %before, %thread",
        "  %in.any = addrspacecast ptr addrspace(1) %in to ptr",
        "  %out.any = addrspacecast ptr addrspace(1) %out to ptr",
        "  call void @sample(i64 %i, i64 %end, ptr %in.any, i64 %in.number, i64 %in.sample, "
        "ptr %out.any, i64 %out.number, i64 %out.sample)",
        "  ret void",
        "}",
        f'attributes #0 = {{ nounwind "nvvm.maxntid"="{THREADS}" }}',
    ]
    return "\n".join(lines)
