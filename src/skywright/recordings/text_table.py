"""Helpers for readers of text tables from other programs.

They decode the text, split rows into cells, convert decimal commas, and find columns by name and
unit. `--columns` of several commands has the format of `parse_columns`.
"""

import csv
import math
import re
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from skywright.core.bounded import read_bytes
from skywright.errors import InputError

FOREIGN = {"m": ("cm", "mil", "ft", "yd", "nm", "km"), "s": ("h", "d", "us", "ns")}
"""Units of lengths (quantities with the unit m) and times (s) that not every table can have."""
_NAMES = {
    "m": "meter metre", "cm": "centimeter centimetre", "mm": "millimeter millimetre",
    "um": "micron micrometer micrometre", "nm": "nanometer nanometre", "km": "kilometer kilometre",
    "in": "inch inches", "mil": "mil thou", "ft": "foot feet", "yd": "yard",
    "s": "sec second", "ms": "msec millisecond", "us": "usec microsecond",
    "ns": "nsec nanosecond", "min": "min minute", "h": "hr hour", "d": "day",
}  # fmt: skip
SPELLINGS = {
    name + end: unit
    for unit, names in _NAMES.items()
    for name in names.split()
    for end in ("", "s")
} | {'"': "in"}
"""Other spellings of units, in the singular and the plural."""
MICRO = str.maketrans("\N{MICRO SIGN}\N{GREEK SMALL LETTER MU}", "uu")
_NUMBER = re.compile(r"(?!\d+\.\d+\.\d)[-+]?[\d.,]+(?:[eE][-+]?\d+)?")
"""A number with a decimal comma or point; no date such as 01.03.2026."""


class Cells(NamedTuple):
    """A table as text; each row has as many cells as the header."""

    header: list[str]
    rows: list[tuple[int, list[str]]]  # (number of the line in the file, stripped cells)
    delimiter: str


def read_cells(path: Path, limit: int) -> Cells:
    """Read a delimited text file of at most `limit` bytes; lines that begin with # are comments.

    The delimiter is that of comma, semicolon and tab that gives most columns, or spaces if the
    header contains none of them. Raises InputError if the file is empty or no text, has no rows,
    or has a row with another number of cells than the header.
    """
    text = decode(read_bytes(path, limit))
    if "\0" in text:
        raise InputError(f"{path}: is not a text file; valid: a table with a header and rows")
    lines = [
        (number, line) for number, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]  # fmt: skip
    if not lines:
        raise InputError(f"{path}: the file is empty; valid: a table with a header and rows")
    first = lines[0][1]
    delimiter = max(",;\t", key=lambda d: len(split_row(first, d)))
    if len(split_row(first, delimiter)) == 1:
        delimiter = " "
    header = split_row(first, delimiter)
    rows = [(number, split_row(line, delimiter)) for number, line in lines[1:]]
    check_widths(path, header, rows)
    return Cells(header, rows, delimiter)


def check_widths(path: Path, header: list[str], rows: list[tuple[int, list[str]]]) -> None:
    """Raise InputError if there are no rows, or if a row and the header have different lengths."""
    for number, cells in rows:
        if len(cells) != len(header):
            raise InputError(
                f"{path}: row {number} has {len(cells)} cells; the header has {len(header)}"
            )
    if not rows:
        raise InputError(f"{path}: the table has a header and no rows")


def check_repeated(path: Path, rows: list[tuple[int, list[str]]]) -> list[str]:
    """Return a note on rows that repeat another in every column, also in those not read.

    They may be copies, or readings that nothing distinguishes. Raises InputError if the table
    consists of copies of a block of rows, as of a file that was appended to itself.
    """
    cells = [tuple(cell.strip() for cell in row) for _, row in rows]
    block = next((k for k in range(2, len(cells)) if cells[k] == cells[0]), 0)
    whole = block and len(cells) % block == 0 and cells[block:] == cells[:-block]
    if whole and len({*cells}) > 1:
        raise InputError(
            f"{path}: rows {rows[block][0]} to {rows[-1][0]} are copies of the {block} rows "
            "before; valid: each row once"
        )
    repeated = len(cells) - len({*cells})
    if not repeated:
        return []
    return [
        f"{repeated} of {len(cells)} rows repeat another in every column and count as separate "
        "readings: remove copies"
    ]


def convert_commas(
    path: Path, rows: Sequence[list[str]], delimiter: str, columns: Collection[int]
) -> bool:
    """Replace decimal commas by points in `columns` of the rows; return whether there are any.

    Commas in a table that is delimited by commas are no decimal commas. Raises InputError if
    numbers contain both commas and points, because one of them may separate thousands.
    """
    if delimiter == "," or not any("," in row[k] for row in rows for k in columns):
        return False
    numbers = [row[k] for row in rows for k in columns if _NUMBER.fullmatch(row[k])]
    comma = next((cell for cell in numbers if "," in cell), None)
    point = next((cell for cell in numbers if "." in cell), None)
    if comma is None:
        return False
    if point is not None:
        raise InputError(
            f"{path}: numbers contain both , and . (such as "
            f"{' and '.join(dict.fromkeys((comma[:20], point[:20])))}); use a decimal point only"
        )
    for row in rows:
        for k in columns:
            if _NUMBER.fullmatch(row[k]):
                row[k] = row[k].replace(",", ".")
    return True


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


def plain_name(name: str) -> str:
    """Return a column's name in lower case, without spaces and units in brackets."""
    return re.sub(r"\[.*?\]|\(.*?\)|\s", "", name.lower().translate(MICRO))


def plain_unit(unit: str) -> str:
    """Return a unit in lower case, without other SPELLINGS, and with u for the letter µ."""
    plain = unit.strip().lower().translate(MICRO).rstrip(".")
    return SPELLINGS.get(plain, plain)


def list_foreign(units: Collection[str]) -> list[str]:
    """Return the FOREIGN units of a quantity that is read in `units`."""
    return [u for base, more in FOREIGN.items() if base in units for u in more if u not in units]


def split_unit(name: str, units: Collection[str]) -> tuple[str, str]:
    """Split "Depth [mm]", "depth (mm)" or "depth_mm" into ("depth", "mm").

    Returns the name in lower case and "" if it states none of the `units`. The unit is that of
    `plain_unit`.
    """
    plain = name.strip().lower().translate(MICRO)
    match = re.fullmatch(
        r"(.*?[^\s_])(?:[\s_]*\[\s*(\w+)\s*\]|[\s_]*\(\s*(\w+)\s*\)|[\s_]+([^\W_]+))", plain
    )
    unit = plain_unit(next(filter(None, match.groups()[1:]), "")) if match else ""
    return (match[1], unit) if match and unit in units else (plain, "")


def parse_columns(text: str, units: Mapping[str, Collection[str]]) -> dict[str, tuple[str, str]]:
    """Parse "value=Wall[mm],t=Time[ms]" and return {quantity: (name in the file, unit)}.

    `units` maps the valid quantities to their units. The unit is "" if `text` does not state it.
    Raises InputError if a quantity or unit is unknown, or if a quantity is given twice.
    """
    found: dict[str, tuple[str, str]] = {}
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\w+)\s*=\s*([^\[\]]+?)\s*(?:\[\s*(\w*)\s*\])?\s*", part)
        what, name, unit = match.groups() if match else (part.strip()[:40], "", None)
        unit = plain_unit(unit or "")
        if not match or what not in units:
            raise InputError(
                f"--columns: {what!r}; valid: QUANTITY=NAME[UNIT],... with a quantity of "
                + ", ".join(units)
            )
        if unit and unit not in units[what]:
            raise InputError(
                f"--columns: {what} in {unit!r}; valid units: {', '.join(units[what]) or 'none'}"
            )
        if what in found:
            raise InputError(f"--columns: {what} is given twice")
        found[what] = (name.lower(), unit)
    return found


def match_columns(
    header: Sequence[str], name: str, unit: str, units: Collection[str]
) -> list[tuple[int, str]]:
    """Return (index, unit) of the columns that a name of `parse_columns` selects.

    Case and spaces are not compared, nor a part in brackets that only the header contains. Of
    several such columns, those whose header states `unit` are selected. A column without `unit`
    has that of its header, "" if the header states none of the `units`.
    """
    wanted, *cells = (re.sub(r"\s", "", x.lower().translate(MICRO)) for x in (name, *header))
    whole = [k for k, cell in enumerate(cells) if cell == wanted]
    fits = whole or [k for k, cell in enumerate(header) if plain_name(cell) == wanted]
    stated = {k: split_unit(header[k], units)[1] for k in fits}
    same = [k for k in fits if unit and stated[k] == unit]
    return [(k, unit or stated[k]) for k in same or fits]


def find_columns(
    path: Path,
    header: Sequence[str],
    given: Mapping[str, tuple[str, str]],
    units: Mapping[str, Collection[str]],
) -> dict[str, tuple[int, str]]:
    """Return {quantity: (index, unit)} of what `parse_columns` gives.

    Raises InputError if two quantities have one column, and unless each selects one column whose
    header contradicts no unit.
    """
    found: dict[str, tuple[int, str]] = {}
    owners: dict[int, str] = {}
    for what, (name, unit) in given.items():
        index, _ = found[what] = _find_column(path, header, name, unit, units[what])
        if index in owners:
            raise InputError(
                f"{path}: --columns: {owners[index]} and {what} are both {header[index][:40]!r}; "
                "valid: a column for each"
            )
        owners[index] = what
    return found


def _find_column(
    path: Path, header: Sequence[str], name: str, unit: str, units: Collection[str]
) -> tuple[int, str]:
    """Return the (index, unit) of `match_columns`.

    Raises InputError unless it is one column, if its header states a FOREIGN unit or another unit
    than `unit`, and, without a known unit, if the header has a part in brackets, which may be one.
    """
    fits = match_columns(header, name, unit, units)
    if len(fits) != 1:
        raise InputError(
            f"{path}: --columns: {'several columns' if fits else 'no column'} {name!r}; found: "
            + list_names(header)
        )
    index, found = fits[0]
    foreign = list_foreign(units)
    stated = split_unit(header[index], {*units, *foreign})[1]
    inside = " ".join(re.findall(r"[\[(]([^\])]*)", header[index]))  # "UT, in", "in." or "in mm"
    words = [plain_unit(word) for word in re.split(r"[\s,;/]+", inside)]
    if not stated and unit not in words:
        stated = next((word for word in words if word in {*units, *foreign}), "")
    shown = f"{path}: --columns: {header[index][:40]!r} states"
    if stated in foreign:
        raise InputError(
            f"{shown} {stated}; valid units: {', '.join(units)}; convert the values, and correct "
            "the header"
        )
    if unit and stated not in ("", unit):
        raise InputError(f"{shown} {stated}, but {unit} is given; correct one of them")
    if units and not found and re.search(r"[\[(]", header[index]):
        raise InputError(
            f"{shown} no unit that is valid here; give it as {name}[UNIT] with one of "
            + ", ".join(units)
        )
    return index, found


def list_names(names: Sequence[str], limit: int = 14) -> str:
    """Return column names for a message, at most `limit` of them."""
    shown = ", ".join(name[:30] or "(empty)" for name in names[:limit])
    return shown + (" ..." if len(names) > limit else "")


def read_number(cell: str) -> float:
    """Return the number in a cell, NaN if there is none."""
    try:
        return float(cell)
    except ValueError:
        return math.nan


def join_numbers(name: str, value: str | Sequence[float] | None, form: str) -> str | None:
    """Return numbers as a text of the `form` "T0:T1" or "X,Y,Z"; texts and None are unchanged.

    Raises InputError, which names the argument, for anything else.
    """
    if value is None or isinstance(value, str):
        return value
    mark = ":" if ":" in form else ","
    count = len(form.split(mark))
    try:
        numbers = [float(x) for x in value]
    except (TypeError, ValueError):
        numbers = []
    if len(numbers) != count:
        raise InputError(f"{name}: {value!r}; valid: {count} numbers, or a text {form}")
    return mark.join(map(repr, numbers))


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
