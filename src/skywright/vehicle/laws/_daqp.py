"""Quadratic programs in a compiled step: the C function of DAQP, called by its address.

    minimise  x'H x / 2 + f'x   with   lower <= (x_1 .. x_ms, A x) <= upper

Arnström, Bemporad, Axehill 2022, A dual active-set solver for embedded quadratic programming using
recursive LDL' updates, IEEE T-AC 67(8). The wheel brings no headers, so the layout of the two
records that the function takes is written here, and `load_solver` tests it on a problem whose
solution is known before anything flies.
"""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import carray, types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from skywright.core.arrays import Array
from skywright.core.compiled import Helper
from skywright.core.pointers import as_pointer

OPTIMAL, SOFT_OPTIMAL = 1, 2
"""Exit flags of a solution; others are below zero."""
SOFT = 8
"""A row of this sense may be violated, at a high price."""
UNBOUNDED = 1e30

PROBLEM = np.dtype(
    [("n", "i4"), ("m", "i4"), ("ms", "i4"), ("H", "i8"), ("f", "i8"), ("A", "i8"),
     ("upper", "i8"), ("lower", "i8"), ("sense", "i8"), ("breaks", "i8"), ("levels", "i4"),
     ("kind", "i4")], align=True,
)  # fmt: skip
"""DAQPProblem of DAQP 0.11: sizes, addresses; the last three belong to other kinds of problems."""
RESULT = np.dtype(
    [("x", "i8"), ("lam", "i8"), ("value", "f8"), ("slack", "f8"), ("flag", "i4"),
     ("iterations", "i4"), ("nodes", "i4"), ("solve_s", "f8"), ("setup_s", "f8")], align=True,
)  # fmt: skip
"""DAQPResult."""
FLAG_AT = int(RESULT.fields["flag"][1])  # type: ignore[index]
GUARD = 64
"""Bytes behind a result that the test of its layout watches."""


class Program(NamedTuple):
    """Arrays of a quadratic program and the two records that point at them."""

    H: Array  # (n, n)
    f: Array  # (n,)
    A: Array  # (m, n), of the rows that are no simple bounds
    upper: Array  # (n + m,)
    lower: Array
    sense: NDArray[np.int32]  # (n + m,)
    x: Array  # (n,)
    lam: Array  # (n + m,)
    problem: NDArray[Any]
    result: NDArray[Any]


def build_program(n: int, m: int) -> Program:
    """Return a program of n variables with bounds, and m further rows; keep a reference to it."""
    p = Program(
        np.zeros((n, n)), np.zeros(n), np.zeros((m, n)), np.zeros(n + m), np.zeros(n + m),
        np.zeros(n + m, np.int32), np.zeros(n), np.zeros(n + m), np.zeros(1, PROBLEM),
        np.zeros(1, RESULT),
    )  # fmt: skip
    for name, value in (("n", n), ("m", n + m), ("ms", n)):
        p.problem[name] = value
    for name in ("H", "f", "A", "upper", "lower", "sense"):
        p.problem[name] = getattr(p, name).ctypes.data
    p.result["x"], p.result["lam"] = p.x.ctypes.data, p.lam.ctypes.data
    return p


@cache
def load_solver() -> int:
    """Return the address of `daqp_quadprog`, tested.

    Raises RuntimeError where the library has another layout than written here.
    """
    import daqp

    # the library is loaded already, and stays so
    function = ctypes.CDLL(daqp.__file__).daqp_quadprog
    address = ctypes.cast(function, ctypes.c_void_p).value
    assert address is not None
    if not _test_layout(address):
        from importlib.metadata import version

        raise RuntimeError(
            f"daqp {version('daqp')} has another layout of its records than Skywright expects: "
            "install the version of requirements.lock"
        )
    return address


def _test_layout(address: int) -> bool:
    """Solve |x - (2, -1, 0.5)|^2 / 2 with x_1 <= 1 and x_2 + x_3 = 1: x = (1, -0.25, 1.25)."""
    p = build_program(3, 1)
    p.H[:], p.f[:], p.A[0] = np.eye(3), [-2.0, 1.0, -0.5], [0.0, 1.0, 1.0]
    p.lower[:], p.upper[:] = -UNBOUNDED, UNBOUNDED
    p.upper[0], p.lower[3], p.upper[3] = 1.0, 1.0, 1.0
    p.sense[3] = 5  # an equality
    watched = np.full(RESULT.itemsize + GUARD, 0x5A, np.uint8)
    watched[: RESULT.itemsize] = p.result.view(np.uint8)
    _python_solve(address, p.problem.ctypes.data, watched.ctypes.data)
    told = watched[: RESULT.itemsize].view(RESULT)[0]
    return bool(
        told["flag"] == OPTIMAL
        and 0 < told["iterations"] < 20
        and np.allclose(p.x, [1.0, -0.25, 1.25], atol=1e-9)
        and np.allclose(p.lam[[0, 3]], [1.0, -0.75], atol=1e-9)
        and np.isclose(told["value"], _value(p), atol=1e-9)
        and told["slack"] == 0.0
        and np.all(watched[RESULT.itemsize :] == 0x5A)
    )


def _value(p: Program) -> float:
    return float(0.5 * p.x @ p.H @ p.x + p.f @ p.x)


@intrinsic
def _call(typingctx: Any, function: Any, result: Any, problem: Any) -> Any:
    """Call `void f(void *result, void *problem, void *settings)` with default settings."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        pointer = cgutils.voidptr_t
        kind = ir.FunctionType(ir.VoidType(), [pointer] * 3)
        given = [builder.inttoptr(a, pointer) for a in args[1:]]
        target = builder.inttoptr(args[0], kind.as_pointer())
        builder.call(target, [*given, ir.Constant(pointer, None)])
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.int64), codegen


def _solve(function: int, problem: int, result: int) -> None:
    """Solve the program whose records stand at these addresses, with default settings."""
    _call(function, result, problem)


def _python_solve(function: int, problem: int, result: int) -> None:
    kind = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p)
    kind(int(function))(int(result), int(problem), None)


solve = Helper(_solve, _python_solve)


def _read_flag(result: int) -> int:
    """Return the exit flag of the result at an address."""
    return int(carray(as_pointer(result + FLAG_AT), 1, np.int32)[0])


def _python_read_flag(result: int) -> int:
    return ctypes.c_int32.from_address(int(result) + FLAG_AT).value


def _set_senses(sense: int, n: int, first: int, count: int, kind: int) -> None:
    """Make `count` rows from `first` of that sense and all others of `n` plain."""
    out = carray(as_pointer(sense), n, np.int32)
    for i in range(n):
        out[i] = kind if first <= i < first + count else 0


def _python_set_senses(sense: int, n: int, first: int, count: int, kind: int) -> None:
    out: Any = (ctypes.c_int32 * int(n)).from_address(int(sense))
    for i in range(int(n)):
        out[i] = int(kind) if first <= i < first + count else 0


read_flag = Helper(_read_flag, _python_read_flag)
set_senses = Helper(_set_senses, _python_set_senses)
