"""Arrays without an owner: what kernels make of all that they are given.

Numba counts a reference to each array of a tuple when a function begins and when it ends, by an atomic instruction. In
the walks through volumes that was two thirds to four fifths of the time (487 -> 93 ns an event in a box), in that of a
beam a third. An array without an owner has nothing to count. Its memory lives as long as the caller's array does, which
is longer than the call. So a kernel borrows its arguments alone, never an array of its own, which Numba frees after its
last mention; and it returns no array.
"""

from typing import Any

from numba import types
from numba.core.compiler_machinery import register_pass
from numba.core.errors import LoweringError
from numba.core.lowering import Lower
from numba.core.typed_passes import NativeLowering

from specklegen.kernels.lowering import compiler_with


def _without_owner(context, builder, kind, given):
    """Return a value of whose arrays nobody counts references, also of those in tuples."""
    if isinstance(kind, types.Array):
        array = context.make_array(kind)(context, builder, given)
        array.meminfo = context.get_constant_null(types.MemInfoPointer(types.voidptr))
        return array._getvalue()
    if isinstance(kind, types.BaseTuple):
        for n, inner in enumerate(kind):  # type: ignore[arg-type]
            part = _without_owner(context, builder, inner, builder.extract_value(given, n))
            given = builder.insert_value(given, part, n)
    return given


def _holds_array(kind: Any) -> bool:
    return isinstance(kind, types.Array) or (isinstance(kind, types.BaseTuple) and any(map(_holds_array, kind.types)))


class _Borrowing(Lower):
    """Numba's translation to LLVM, of a function that borrows its arguments."""

    def lower_function_body(self) -> Any:
        if _holds_array(self.fndesc.restype):
            raise LoweringError("a kernel borrows its arrays, so it must not return one: compile it by `returning`")
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
