"""Compile CasADi functions to machine code by LLVM: one vectorised loop over samples; no C compiler is needed."""

from twin.codegen.emit import Stage
from twin.codegen.kernel import Kernel

__all__ = ["Kernel", "Stage"]
