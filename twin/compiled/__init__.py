"""CasADi functions as machine code: one loop over samples, several samples an instruction, no compiler needed."""

from twin.compiled.emit import Stage
from twin.compiled.kernel import Kernel

__all__ = ["Kernel", "Stage"]
