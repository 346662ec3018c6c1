"""CasADi functions as machine code: one loop over samples, several samples an instruction, no compiler needed."""

from twin.codegen.emit import Stage
from twin.codegen.kernel import Kernel

__all__ = ["Kernel", "Stage"]
