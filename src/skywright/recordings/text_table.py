"""Helpers for readers of text tables from other programs: decoding, cells, numbers, time spans."""

import csv
import math

from skywright.errors import InputError


def decode(raw: bytes) -> str:
    """Decode UTF-16 (with a byte order mark), UTF-8 (with or without one), or else Latin-1."""
    try:
        marked = raw.startswith((b"\xff\xfe", b"\xfe\xff"))
        return raw.decode("utf-16" if marked else "utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


def split_row(line: str, delimiter: str) -> list[str]:
    """Return the stripped cells of a row."""
    if delimiter == " ":
        return line.split()
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter))]
    except (csv.Error, StopIteration):
        return [line]


def read_number(cell: str) -> float:
    """Return the number in a cell, NaN if there is none."""
    try:
        return float(cell)
    except ValueError:
        return math.nan


def parse_span(text: str, after: str, example: str) -> tuple[float, float]:
    """Parse the time span `T0:T1` of --calibrate; return T0 and T1 (s).

    Raises InputError if `text` is not a time span. The message contains `after`, which states the
    start of the time, and `example`.
    """
    start, _, stop = text.partition(":")
    span = read_number(start), read_number(stop)
    if not (math.isfinite(span[0]) and math.isfinite(span[1]) and span[0] < span[1]):
        raise InputError(
            f"--calibrate: {text[:60]!r} is not a time span; valid: T0:T1 in seconds {after}, "
            f"T0 below T1, such as {example}"
        )
    return span
