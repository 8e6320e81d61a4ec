"""Call a C function by its address from compiled code, without Python's lock.

numba does not cache functions that close over a ctypes pointer; an address that arrives as an argument keeps the
cache on disk usable.
"""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic


@intrinsic
def call_step(typing_context, function, model, data):
    """Call ``void function(const mjModel*, mjData*)``; the three arguments are addresses (int64)."""

    def generate(context, builder, signature, arguments):
        pointer = cgutils.voidptr_t
        target = ir.FunctionType(ir.VoidType(), [pointer, pointer]).as_pointer()
        address, first, second = arguments
        callee = builder.inttoptr(address, target)
        builder.call(callee, [builder.inttoptr(first, pointer), builder.inttoptr(second, pointer)])
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.int64), generate


@intrinsic
def double_pointer(typing_context, address):
    """``(double*) address``, for numba.carray."""

    def generate(context, builder, signature, arguments):
        return builder.inttoptr(arguments[0], ir.DoubleType().as_pointer())

    return types.CPointer(types.float64)(types.int64), generate
