"""A minimal writer of PX4 ULog files, for tests (format: docs.px4.io, "ULog File Format")."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray


def write_ulog(
    path: Path,
    topics: dict[str, dict[str, NDArray[np.float64]]],
    parameters: dict[str, float] | None = None,
) -> Path:
    """Write topics: name -> field -> (n,) values; "timestamp" is in seconds, the rest float32.

    Fields like "q[0]", "q[1]" become one array, and "esc[0].rpm" an array of nested messages.
    """
    out = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0)]

    def message(kind: bytes, body: bytes) -> None:
        out.append(struct.pack("<H", len(body)) + kind + body)

    message(b"B", bytes(40))
    for name, value in (parameters or {}).items():
        key = f"{'int32_t' if isinstance(value, int) else 'float'} {name}".encode()
        packed = struct.pack("<i" if isinstance(value, int) else "<f", value)
        message(b"P", bytes([len(key)]) + key + packed)
    for name, fields in topics.items():
        for text in _formats(name, fields):
            message(b"F", text.encode())
    for i, name in enumerate(topics):
        message(b"A", struct.pack("<BH", 0, i) + name.encode())
    rows: list[tuple[float, bytes]] = []
    for i, fields in enumerate(topics.values()):
        names = [n for n in fields if n != "timestamp"]
        data = np.column_stack([fields[n] for n in names]).astype("<f4")
        for t, row in zip(fields["timestamp"], data, strict=True):
            rows.append((t, struct.pack("<HQ", i, round(t * 1e6)) + row.tobytes()))
    for _, body in sorted(rows, key=lambda r: r[0]):
        message(b"D", body)
    path.write_bytes(b"".join(out))
    return path


def _formats(name: str, fields: dict[str, NDArray[np.float64]]) -> list[str]:
    arrays: dict[str, int] = {}
    nested: dict[str, list[str]] = {}
    for field in fields:
        if field == "timestamp":
            continue
        base, _, rest = field.partition("[")
        if "]." in rest:
            index, _, inner = rest.partition("].")
            if int(index) == 0:
                nested.setdefault(base, []).append(inner)
        arrays[base] = arrays.get(base, 0) + 1
    lines, own = [], []
    for base, count in arrays.items():
        if base in nested:
            own.append(f"{name}_{base}:" + "".join(f"float {i};" for i in nested[base]))
            lines.append(f"{name}_{base}[{count // len(nested[base])}] {base};")
        else:
            lines.append(f"float{f'[{count}]' if f'{base}[0]' in fields else ''} {base};")
    return [*own, f"{name}:uint64_t timestamp;" + "".join(lines)]
