"""Compilation of steps, and calls of their machine code by address.

numba passes records by reference: a step that takes only records has the machine code
`i32 step(ret**, error**, record*, record*, ...)`. No C wrapper is needed. The signature contains
the layouts of all records, hence also the key of numba's cache does. The returned status reports
exceptions. `check_calls` tests this convention once a process, before the first flight.
"""

from __future__ import annotations

import ctypes
import pickle
import re
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from llvmlite import ir
from numba import from_dtype, types
from numba.core import cgutils
from numba.extending import intrinsic

from skywright.core.compiled import COMPILE, Helper
from skywright.core.user_code import njit
from skywright.core.user_files import is_user_module

MAX_PORTS = 12
"""Most ports of a step."""


def compile_step(function: Any, ports: Sequence[np.dtype[Any] | None]) -> tuple[int, Any]:
    """Return the address of a step's machine code for ports of these types (None: absent).

    The second value keeps the code alive. Raises numba's errors.
    """
    dispatcher = _build_dispatcher(function)
    signature = tuple(types.none if p is None else _find_type(p, p.isalignedstruct) for p in ports)
    dispatcher.compile(types.void(*signature))
    found = dispatcher.overloads[signature]
    return int(found.library.get_pointer_to_function(found.fndesc.llvm_func_name)), dispatcher


def shorten_error(error: Exception) -> str:
    """Return the lines of numba's message that state the error and its location."""
    if isinstance(error, KeyError):
        return f"a record has no field {error}"
    text = re.sub(r"\x1b\[\d*m", "", str(error))  # numba's messages contain colour codes
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    kept = [x for x in lines if not x.startswith(("During:", "Failed in", "This error", "<"))]
    return " ".join(kept[:3] + [x for x in lines if x.startswith("File ")][-1:])


@cache  # numba iterates over the fields each time; dtypes that differ in alignment are equal
def _find_type(record: np.dtype[Any], _aligned: bool) -> Any:
    return from_dtype(record)


@cache
def _build_dispatcher(function: Any) -> Any:
    if isinstance(function, Helper):
        return function.dispatcher
    if hasattr(function, "py_func"):
        return function
    return njit(**COMPILE, boundscheck=is_user_module(function.__module__))(function)


@intrinsic
def call_step(typingctx: Any, function: Any, ports: Any, n: Any) -> Any:
    """Call a step of `n` ports with the addresses at `ports`; return its error, 0 for none."""

    def codegen(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        address, base, count = values
        pointer, word = cgutils.voidptr_t, ir.IntType(64)
        result = cgutils.alloca_once(builder, pointer)
        error = cgutils.alloca_once(builder, pointer)
        failed = cgutils.alloca_once_value(builder, ir.Constant(word, 0))
        first = builder.inttoptr(base, word.as_pointer())
        after = builder.append_basic_block("called")
        choose = builder.switch(count, after)
        for arity in range(MAX_PORTS + 1):
            block = builder.append_basic_block(f"ports{arity}")
            choose.add_case(ir.Constant(count.type, arity), block)
            with builder.goto_block(block):
                kind = ir.FunctionType(
                    ir.IntType(32), [pointer.as_pointer()] * 2 + [pointer] * arity
                )
                given = [
                    builder.inttoptr(
                        builder.load(builder.gep(first, [ir.Constant(word, i)])), pointer
                    )
                    for i in range(arity)
                ]
                step = builder.inttoptr(address, kind.as_pointer())
                status = builder.call(step, [result, error, *given])
                raised = builder.icmp_signed(">", status, ir.Constant(ir.IntType(32), 0))
                at = builder.ptrtoint(builder.load(error), word)
                builder.store(builder.select(raised, at, ir.Constant(word, 0)), failed)
                builder.branch(after)
        builder.position_at_end(after)
        return builder.load(failed)

    return types.int64(types.int64, types.int64, types.int64), codegen


class _Raised(ctypes.Structure):
    """numba's description of an exception (numba/core/callconv.py: excinfo_t)."""

    _fields_ = (
        ("data", ctypes.c_void_p), ("size", ctypes.c_int32), ("hash", ctypes.c_void_p),
        ("unwrap", ctypes.c_void_p), ("dynamic", ctypes.c_int32),
    )  # fmt: skip


def read_error(address: int) -> tuple[BaseException, str]:
    """Return the exception that a step raised, and `file:line` where it did."""
    raised = _Raised.from_address(address)
    kind, arguments, place = pickle.loads(ctypes.string_at(raised.data, raised.size))
    return kind(*(arguments or ())), f"{place[1]}:{place[2]}" if place else ""


PROBE = np.dtype([("a", np.float64), ("b", np.int64)])


@njit(cache=True)
def _call(function: int, ports: int, n: int) -> int:
    return int(call_step(function, ports, n))


def _probe_two(me, other):  # type: ignore[no-untyped-def]
    me.a += other.a
    other.b += 1
    if other.b > 1:
        raise ValueError("probe")


def _probe_absent(me, absent, other):  # type: ignore[no-untyped-def]
    if absent is not None:
        me.a = -1.0
    me.b = other.b + 7


@cache
def check_calls() -> None:
    """Test the calling convention: values, an absent port, an exception.

    Raises RuntimeError if numba has changed it.
    """
    x, y = np.zeros(1, PROBE), np.ones(1, PROBE)
    ports = np.array([x.ctypes.data, y.ctypes.data, 0], np.int64)
    y["b"] = 0
    two, keep = compile_step(_probe_two, (PROBE, PROBE))
    first = _call(two, ports.ctypes.data, 2)
    second = _call(two, ports.ctypes.data, 2)
    three, keep_too = compile_step(_probe_absent, (PROBE, None, PROBE))
    ports[:] = [x.ctypes.data, 0, y.ctypes.data]
    third = _call(three, ports.ctypes.data, 3)
    good = first == 0 == third and second != 0 and x["a"][0] == 2.0 and x["b"][0] == 9
    if not good or str(read_error(second)[0]) != "probe":
        import numba

        raise RuntimeError(
            f"numba {numba.__version__} uses another calling convention than Skywright "
            "expects: install the version of requirements.lock"
        )
    del keep, keep_too
