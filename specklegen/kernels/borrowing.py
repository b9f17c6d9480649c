"""Arrays without an owner: what kernels make of all that they are given, and of arrays that their loops pass on.

Numba counts a reference to each array of a tuple when a function begins and when it ends, by an atomic instruction. In
the walks through volumes that was two thirds to four fifths of the time (487 -> 93 ns an event in a box), in that of a
beam a third. An array without an owner has nothing to count. Its memory lives as long as the caller's array does, so it
must not leave the kernel that borrows it: no kernel returns an array that it was given, nor a part of one.
"""

from typing import Any

from numba import types
from numba.core.compiler_machinery import register_pass
from numba.core.lowering import Lower
from numba.core.typed_passes import NativeLowering
from numba.extending import intrinsic

from specklegen.kernels.lowering import compiler_with


def _without_owner(context, builder, kind, given):
    """The same value, of whose arrays nobody counts references, also of those in tuples."""
    if isinstance(kind, types.Array):
        array = context.make_array(kind)(context, builder, given)
        array.meminfo = context.get_constant_null(types.MemInfoPointer(types.voidptr))
        return array._getvalue()
    if isinstance(kind, types.BaseTuple):
        for n, each in enumerate(kind):  # type: ignore[arg-type]
            part = _without_owner(context, builder, each, builder.extract_value(given, n))
            given = builder.insert_value(given, part, n)
    return given


def _borrowed(typing_context, value):
    """An array, or a tuple with arrays in it, whose references nobody counts."""

    def generate(context, builder, signature, arguments):
        return _without_owner(context, builder, signature.args[0], arguments[0])

    return value(value), generate


borrowed: Any = intrinsic(_borrowed)


class _Borrowing(Lower):
    """Numba's translation to LLVM, of a function that borrows its arguments."""

    def lower_function_body(self) -> Any:
        kinds = self.fndesc.argtypes
        self.fnargs = [
            _without_owner(self.context, self.builder, kind, given)
            for kind, given in zip(kinds, self.fnargs, strict=True)
        ]
        return super().lower_function_body()


@register_pass(mutates_CFG=True, analysis_only=False)
class _BorrowingLowering(NativeLowering):
    """The pass that translates so."""

    _name = "borrowing_lowering"

    @property
    def lowering_class(self) -> type[Lower]:
        return _Borrowing


BorrowingCompiler = compiler_with(_BorrowingLowering)
"""Numba's compiler, of functions that borrow their arguments."""
