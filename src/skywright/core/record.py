"""Records: one class defines the NumPy type, the type for mypy, and the name of a port.

    class Reading(Record):
        t: float  # s
        count: int
        p_WB: Vec3  # m
        table: Annotated[Array, 3, 2]
        inner: Other  # a record in a record

`Reading.dtype` is the structured NumPy type, in 8-byte words; compiled code receives a record by
reference and reads `me.t`, `me.table[i, j]`. A record may inherit the fields of others.
"""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, get_args, get_origin, get_type_hints

import numpy as np

from skywright.core.arrays import Array as Array
from skywright.core.arrays import Ints

Integers = Ints
Vec2 = Annotated[Array, 2]
Vec3 = Annotated[Array, 3]
Vec4 = Annotated[Array, 4]
Mat3 = Annotated[Array, 3, 3]


class Record:
    """Base of all records; `dtype` follows from the annotations of the class and of its bases.

    Raises TypeError for an annotation that is not a number, an array or a record.
    """

    dtype: ClassVar[np.dtype[Any]]

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        # local classes are known only here, if annotations are strings
        hints = get_type_hints(cls, localns=_list_nested(cls), include_extras=True)
        hints.pop("dtype", None)
        fields = [
            (name, *_read_hint(cls, name, hint))
            for name, hint in hints.items()
            if get_origin(hint) is not ClassVar
        ]
        cls.dtype = np.dtype(fields)


def _list_nested(cls: type) -> dict[str, Any]:
    return {
        n: v for base in reversed(cls.__mro__) for n, v in vars(base).items() if isinstance(v, type)
    }


def _read_hint(cls: type, name: str, hint: Any) -> tuple[Any, tuple[int, ...]]:
    """Return (base type, shape) of a field."""
    shape: tuple[int, ...] = ()
    if get_origin(hint) is Annotated:
        hint, shape = get_args(hint)[0], get_args(hint)[1:]
    base = _BASES.get(hint) if not isinstance(hint, type) or hint in (int, float) else None
    if isinstance(hint, type) and issubclass(hint, Record):
        return hint.dtype, shape
    array = hint in (Array, Integers)
    if base is None or array != bool(shape) or not all(isinstance(n, int) and n > 0 for n in shape):
        raise TypeError(
            f"{cls.__qualname__}.{name}: {hint!r} is not a type of a field; valid: float, int, "
            "Vec3, Mat3, Annotated[Array, 3, 2], Annotated[Integers, 4], a Record"
        )
    return base, shape


_BASES: dict[Any, Any] = {float: np.float64, int: np.int64, Array: np.float64, Integers: np.int64}


class View:
    """Python view of a record: `view.t`, `view.p_WB[0] = 1.0`; writes modify the array.

    NumPy's own `recarray` returns a method for a field that is called `sum` or `size`.
    """

    __slots__ = ("_row",)

    def __init__(self, row: Any) -> None:
        """`row` is an element of a structured array, such as `array[0]`."""
        object.__setattr__(self, "_row", row)

    def __getattr__(self, name: str) -> Any:
        try:
            value = self._row[name]
        except ValueError:
            raise self._unknown(name) from None
        return View(value) if isinstance(value, np.void) else value

    def __setattr__(self, name: str, value: Any) -> None:
        try:
            self._row[name] = value._row if isinstance(value, View) else value
        except (TypeError, ValueError) as error:
            known = name in self.dtype.fields
            raise (ValueError(f"{name}: {error}") if known else self._unknown(name)) from None

    def __repr__(self) -> str:
        return "\n".join(f"{n} = {' '.join(str(self[n]).split())}" for n in self.dtype.fields)

    def _unknown(self, name: str) -> AttributeError:
        return AttributeError(f"no field {name!r}; valid: {', '.join(self.dtype.fields)}")

    __getitem__, __setitem__ = __getattr__, __setattr__

    def copy(self) -> Any:
        """Return a copy of the row, with named fields."""
        r = self._row  # its own `copy` goes field by field, in several times the time
        return np.frombuffer(bytearray(r.tobytes()), r.dtype)[0] if r.dtype.itemsize else r.copy()

    @property
    def dtype(self) -> Any:
        """Its NumPy type."""
        return self._row.dtype


def find_place(view: Any, name: str) -> memoryview:
    """Return the memory of a field of a `View`; `.tolist()` gives its present value or values.

    It is ten times as fast as reading the field by its name.
    """
    field: memoryview = np.asarray(object.__getattribute__(view, "_row"))[name].data
    return field


def fill(record: Any, source: Any) -> None:
    """Copy the fields that both structured values have."""
    for name in record.dtype.names:
        if name in source.dtype.names:
            record[name] = source[name]
