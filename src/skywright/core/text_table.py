"""Tables as text: what every reader of others' files needs before it knows the columns."""

import csv
import math

from skywright.errors import InputError


def decode(raw: bytes) -> str:
    """Return text in UTF-8 or UTF-16 with or without a mark at its start, else in Latin-1."""
    try:
        marked = raw.startswith((b"\xff\xfe", b"\xfe\xff"))
        return raw.decode("utf-16" if marked else "utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


def split_row(line: str, delimiter: str) -> list[str]:
    """Return the cells of a row, stripped."""
    if delimiter == " ":
        return line.split()
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter))]
    except (csv.Error, StopIteration):
        return [line]


def read_number(cell: str) -> float:
    """Return a cell's number, NaN where it holds none."""
    try:
        return float(cell)
    except ValueError:
        return math.nan


def parse_span(text: str, after: str, example: str) -> tuple[float, float]:
    """Return the seconds of `T0:T1` of --calibrate, counted from what `after` says.

    Raises InputError for anything else, with an `example`.
    """
    start, _, stop = text.partition(":")
    span = read_number(start), read_number(stop)
    if not (math.isfinite(span[0]) and math.isfinite(span[1]) and span[0] < span[1]):
        raise InputError(
            f"--calibrate: {text[:60]!r} is not a time span; valid: T0:T1 in seconds {after}, "
            f"T0 below T1, such as {example}"
        )
    return span
