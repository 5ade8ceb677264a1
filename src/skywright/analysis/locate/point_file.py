"""Terrain points from a file: one name and three coordinates per line, and a header with units.

name, x_m, y_m, z_m
P1, 12.402, -3.118, 0.451
"""

from pathlib import Path

import numpy as np

from skywright.analysis.locate.trajectory_file import (
    check_unit,
    find_delimiter,
    name_column,
    read_bytes,
    split_row,
)
from skywright.core.arrays import Array
from skywright.errors import InputError
from skywright.models.localisation.trajectory import MAX_POSITION

VALID = "a CSV with the header name,x_m,y_m,z_m and a row a point"


def load_points(path: Path) -> dict[str, Array]:
    """Return points (3,) m by name. Raises InputError with one line for any other content."""
    text = read_bytes(path).decode("utf-8-sig", errors="replace")
    if "\0" in text:
        raise InputError(f"{path}: is not a text file; valid: {VALID}")
    rows = [
        (number, line.strip())
        for number, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.lstrip().startswith(("#", "%", "//"))
    ]
    if not rows:
        raise InputError(f"{path}: contains only comments; valid: {VALID}")
    delimiter = find_delimiter(rows[0][1])
    header = split_row(rows[0][1], delimiter)
    columns: dict[str, tuple[int, float]] = {}
    for i, cell in enumerate(header):
        named = name_column(cell)
        if named is not None and named[0] in "xyz":
            if named[0] in columns:
                raise InputError(f"{path}: line {rows[0][0]}: two columns give {named[0]}")
            if named[1] is None:
                check_unit(path, rows[0][0], cell, named[0])
            columns[named[0]] = (i, named[1] if named[1] is not None else 1.0)
    names = [i for i, c in enumerate(header) if c.lower() in ("name", "id", "point", "station")]
    if len(columns) < 3 or not names:
        raise InputError(
            f"{path}: line {rows[0][0]}: found the header {', '.join(header)[:80]}; valid: {VALID}"
        )
    points: dict[str, Array] = {}
    for number, line in rows[1:]:
        cells = split_row(line, delimiter)
        try:
            name = cells[names[0]]
            p = np.array([float(cells[columns[a][0]]) * columns[a][1] for a in "xyz"])
        except (ValueError, IndexError):
            raise InputError(
                f"{path}: line {number}: {line[:60]!r} is not a point; valid: {VALID}"
            ) from None
        if not np.all(np.abs(p) < MAX_POSITION):
            raise InputError(f"{path}: line {number}: {line[:60]!r} contains no finite position")
        if name in points:
            raise InputError(f"{path}: line {number}: point {name!r} occurs twice")
        points[name] = p
    if not points:
        raise InputError(f"{path}: has a header but no points; valid: {VALID}")
    return points


def pair_points(known_file: Path, measured_file: Path) -> tuple[list[str], Array, Array]:
    """Return names and coordinates (n, 3) m of the points that both files contain."""
    known, measured = load_points(known_file), load_points(measured_file)
    names = [n for n in known if n in measured]
    if len(names) < 3:
        raise InputError(
            f"{known_file} and {measured_file}: {len(names)} points in common; at least 3 "
            f"are required ({', '.join(list(known)[:5])} and "
            f"{', '.join(list(measured)[:5])})"
        )
    return names, np.array([known[n] for n in names]), np.array([measured[n] for n in names])
