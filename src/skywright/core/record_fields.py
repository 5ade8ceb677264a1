"""Array fields of records are arrays to compiled code, like any other.

numba types them by their shape (`NestedArray`), so that a helper which takes a field here and a
local array there is compiled once for each. The value is the same either way: an array structure
that points into the record. Imported by whatever compiles.
"""

from __future__ import annotations

from typing import Any

from numba import types
from numba.core.typing.arraydecl import RecordAttribute


def _resolve(self: Any, record: Any, field: str) -> Any:
    found = record.typeof(field)
    if isinstance(found, types.NestedArray):
        return types.Array(found.dtype, found.ndim, "C")
    return found


RecordAttribute.generic_resolve = _resolve
