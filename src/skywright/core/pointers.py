"""Addresses in compiled code: views on arrays by address, and calls through a pointer.

Handing numba many arrays of large records costs microseconds a call, because every argument's type
is looked up again; an address costs nothing. The caller keeps the arrays alive.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic


@intrinsic
def as_pointer(typingctx: Any, address: Any) -> Any:
    """Turn an integer address into a void pointer (for `numba.carray`)."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.inttoptr(args[0], cgutils.voidptr_t)

    return types.voidptr(types.intp), codegen


@intrinsic
def call_pointer(typingctx: Any, function: Any, argument: Any) -> Any:
    """Call the C function `void f(void *)` at an address with an address."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        kind = ir.FunctionType(ir.VoidType(), [cgutils.voidptr_t])
        pointer = builder.inttoptr(args[0], kind.as_pointer())
        builder.call(pointer, [builder.inttoptr(args[1], cgutils.voidptr_t)])
        return context.get_dummy_value()

    return types.void(types.intp, types.intp), codegen
