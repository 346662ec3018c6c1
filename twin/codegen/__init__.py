"""Compile CasADi functions with LLVM to a vectorised loop over samples; no C compiler is needed."""

from twin.codegen.emit import Stage
from twin.codegen.kernel import Kernel

__all__ = ["Kernel", "Stage"]
