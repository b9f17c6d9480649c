"""Numba's compiler with another last step, the translation to LLVM."""

from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import PassManager
from numba.core.typed_passes import NativeLowering


def compiler_with(lowering: type[NativeLowering]) -> type[CompilerBase]:
    """Numba's compiler, with a pass of its kind in the place of Numba's own translation."""

    class Compiler(CompilerBase):
        def define_pipelines(self) -> list[PassManager]:
            steps = DefaultPassBuilder.define_nopython_pipeline(self.state)
            steps.passes = [(lowering if step is NativeLowering else step, reason) for step, reason in steps.passes]
            steps.finalize()
            return [steps]

    return Compiler
