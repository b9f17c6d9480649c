"""Arrays without an owner, for the kernels that a loop calls.

Numba counts a reference to each array of a tuple when a function begins and when it ends, by an atomic instruction: in
the walk of a beam that was a third of the time and more. An array without an owner has nothing to count. Its memory
lives as long as the caller's array does, so it must not leave the kernel that borrows it.
"""

from typing import Any

from numba import types
from numba.extending import intrinsic


def _without_owner(context, builder, kind, given):
    array = context.make_array(kind)(context, builder, given)
    array.meminfo = context.get_constant_null(types.MemInfoPointer(types.voidptr))
    return array._getvalue()


def _borrowed(typing_context, value):
    """An array, or a named tuple of arrays, whose references nobody counts."""

    def generate(context, builder, signature, arguments):
        kind, given = signature.args[0], arguments[0]
        if isinstance(kind, types.Array):
            return _without_owner(context, builder, kind, given)
        for n, each in enumerate(kind):
            array = _without_owner(context, builder, each, builder.extract_value(given, n))
            given = builder.insert_value(given, array, n)
        return given

    return value(value), generate


borrowed: Any = intrinsic(_borrowed)
