"""The passes of numba that kernels need.

Left out is what plain scalar loops have none of: closures, `with`, array expressions, unrolled tuples, parallel loops.
Each pass walks through every function, and these take a tenth of all time.
"""

from numba.core.compiler import CompilerBase
from numba.core.compiler_machinery import PassManager
from numba.core.typed_passes import (
    InlineOverloads,
    NativeLowering,
    NoPythonBackend,
    NopythonTypeInference,
    PreLowerStripPhis,
)
from numba.core.untyped_passes import (
    DeadBranchPrune,
    FixupArgs,
    GenericRewrites,
    IRProcessing,
    ReconstructSSA,
    RewriteSemanticConstants,
    TranslateByteCode,
)

_PASSES = (
    (TranslateByteCode, "read the bytecode"),
    (FixupArgs, "arguments"),
    (IRProcessing, "blocks and scopes"),
    (RewriteSemanticConstants, "dimensions of arrays that are known"),
    (GenericRewrites, "constant names and indices"),
    (DeadBranchPrune, "branches that cannot be reached"),
    (ReconstructSSA, "each variable is assigned once"),
    (NopythonTypeInference, "types"),
    (PreLowerStripPhis, "remove phi nodes"),
    (InlineOverloads, "functions of numba's own that are written out"),
    (NativeLowering, "to LLVM"),
    (NoPythonBackend, "the result"),
)


class KernelCompiler(CompilerBase):
    """numba's compiler with these passes."""

    def define_pipelines(self) -> list[PassManager]:
        """One way through them."""
        passes = PassManager("kernel")
        for one, what_for in _PASSES:
            passes.add_pass(one, what_for)
        passes.finalize()
        return [passes]
