"""Small arrays on the stack of compiled functions: steps do not allocate on the heap.

    vec, R = local(3), local(3, 3)

In compiled code the array exists until the function returns: it must not be returned or stored. Its
values are undefined until written, as those of `np.empty`. Sizes are constants.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import AbstractTemplate, infer_global
from numba.extending import lower_builtin
from numba.np import arrayobj
from numpy.typing import NDArray


def local(n: int, m: int = 0) -> NDArray[np.float64]:
    """Return an array (n,) or (n, m) of numbers for use within this function."""
    return np.empty((n, m) if m else n)


@infer_global(local)
class _Local(AbstractTemplate):
    prefer_literal = True

    def generic(self, args: Any, kws: Any) -> Any:
        if kws or not all(isinstance(a, types.IntegerLiteral) for a in args):
            return None
        return types.Array(types.float64, len(args), "C")(*args)


# inlined at the call: an overload would be a function, whose stack ends on return
@lower_builtin(local, types.IntegerLiteral)
@lower_builtin(local, types.IntegerLiteral, types.IntegerLiteral)
def _build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    shape = [a.literal_value for a in signature.args]
    data = cgutils.alloca_once(builder, ir.ArrayType(ir.DoubleType(), int(np.prod(shape))))
    array = arrayobj.make_array(signature.return_type)(context, builder)
    steps = [8 * int(np.prod(shape[i + 1 :])) for i in range(len(shape))]
    arrayobj.populate_array(
        array,
        data=builder.bitcast(data, ir.DoubleType().as_pointer()),
        shape=[context.get_constant(types.intp, n) for n in shape],
        strides=[context.get_constant(types.intp, n) for n in steps],
        itemsize=context.get_constant(types.intp, 8),
        meminfo=None,
    )
    return array._getvalue()
