"""Addresses in compiled code: array views by address, and calls through a pointer.

Passing many arrays of large records to numba costs microseconds a call, because it looks up the
type of every argument; an address has no such cost. The caller keeps the arrays alive.
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
    """Call the C function `void f(void *)` at an address; the argument is an address."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        kind = ir.FunctionType(ir.VoidType(), [cgutils.voidptr_t])
        pointer = builder.inttoptr(args[0], kind.as_pointer())
        builder.call(pointer, [builder.inttoptr(args[1], cgutils.voidptr_t)])
        return context.get_dummy_value()

    return types.void(types.intp, types.intp), codegen
