"""Helpers of kernels: compiled into the kernels that call them, and not by themselves.

Numba takes a function that another one calls for one that Python may call as well. It makes two wrappers of it, links
in all that it calls, optimises the whole and turns it into machine code, which nobody runs once the helper has been
folded into its callers; with a hundred helpers that was a third of the time that the walks took to compile. A helper of
this module is typed and translated, its own lines are tidied up, and that is what its callers link in. They alone are
optimised as a whole and become machine code.
"""

from collections.abc import Callable
from typing import Any, Literal

from numba import njit
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import _LowerResult
from numba.core.compiler_machinery import register_pass
from numba.core.registry import CPUDispatcher
from numba.core.typed_passes import NativeLowering
from numba.core.types import unliteral

from specklegen.kernels.lowering import compiler_with


class _LinkedLibrary(JITCodeLibrary):
    """Code that others link in: never optimised as a whole, never machine code."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


class _Address:
    """Address of a helper's code for its callers, in place of a function that Python can call."""


@register_pass(mutates_CFG=True, analysis_only=False)
class _LinkedLowering(NativeLowering):
    """Numba's translation to LLVM, without wrappers and without machine code."""

    _name = "linked_lowering"

    def run_pass(self, state: Any) -> Literal[True]:
        flags = state.flags
        flags.no_cpython_wrapper = flags.no_cfunc_wrapper = flags.no_compile = True
        state.library = _LinkedLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        super().run_pass(state)
        made, address = state["cr"], _Address()
        state.targetctx.insert_user_function(address, made.fndesc, [state.library])
        state["cr"] = _LowerResult(made.fndesc, made.call_helper, cfunc=address, env=made.env)
        return True


_HelperCompiler = compiler_with(_LinkedLowering)


class Helper(CPUDispatcher):
    """A function that kernels call; called from Python, as tests do, it is compiled like any other."""

    def __init__(
        self,
        py_func: Callable[..., Any],
        locals: Any = None,  # noqa: A002  Numba's own names
        targetoptions: Any = None,
        pipeline_class: Any = _HelperCompiler,
    ) -> None:
        super().__init__(py_func, locals or {}, targetoptions, pipeline_class)
        self._alone: Any = None

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Find what is compiled for types of arguments; a number that stands in the call is one of its type."""
        return super().get_call_template(
            tuple(map(unliteral, args)), {name: unliteral(value) for name, value in kws.items()}
        )

    def add_overload(self, cres: Any) -> None:
        """Keep what was compiled for callers, and from Python's way to call it."""
        self.overloads[tuple(cres.signature.args)] = cres

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """Call the function from Python."""
        if self._alone is None:
            options = {name: value for name, value in self.targetoptions.items() if name != "nopython"}
            self._alone = njit(**options)(self.py_func)
        return self._alone(*arguments, **named)
