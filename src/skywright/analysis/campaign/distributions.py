"""Parse, check and draw the variations of `--vary`: `KEY=DIST`.

The draws of a run depend only on the campaign's seed, the number of the run and the key. They do
not depend on the number of runs, on their order or on the other varied keys. Therefore a campaign
can be extended, and a further key leaves the draws of the others unchanged.
"""

import csv
import hashlib
import math
import re
from collections.abc import Sequence
from io import StringIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from skywright.core.bounded import LARGEST_TABLE, read_text
from skywright.core.toml_files import describe_value, parse_value
from skywright.errors import InputError, neighbours

Value = float | int | str | bool

FORMS = {
    "uniform": "uniform(a,b)",
    "normal": "normal(m,s)",
    "loguniform": "loguniform(a,b)",
    "choice": "choice(a,b,...)",
    "csv": "csv(FILE) or csv(FILE,COLUMN)",
}
"""Names of the distributions and their syntax."""

_CALL = re.compile(r"\s*([A-Za-z_]\w*)\s*\((.*)\)\s*", re.S)


class Variation(NamedTuple):
    """A key and the distribution of its values over the runs."""

    key: str
    kind: str
    text: str
    """The distribution as written in `--vary`."""
    values: tuple[Value, ...]
    """Parameters; for `choice` the alternatives, for `csv` the cells."""

    @property
    def numeric(self) -> bool:
        """Whether every draw is a number."""
        return all(isinstance(v, int | float) and not isinstance(v, bool) for v in self.values)


def parse_variations(texts: Sequence[str]) -> tuple[Variation, ...]:
    """Parse all texts of `--vary`; a text that names a CSV file varies each of its columns.

    Raises InputError on a malformed text, an unknown distribution, wrong parameters, a bad CSV
    file, or a key that varies twice.
    """
    out: list[Variation] = []
    problems: list[str] = []
    for text in texts:  # report all problems at once
        try:
            out += _parse_text(text)
        except InputError as error:
            problems.append(str(error))
    if problems:
        raise InputError("\n".join(problems))
    for i, variation in enumerate(out):
        if variation.key in {v.key for v in out[:i]}:
            raise InputError(f"--vary {variation.key}: varies twice; give it once")
    return tuple(out)


def _parse_text(text: str) -> list[Variation]:
    if "=" in text or not text.strip().lower().endswith(".csv"):
        return [parse_variation(text)]
    columns = load_columns(Path(text.strip()), f"--vary {text}")
    return [
        Variation(key, "csv", f"csv({text.strip()},{key})", cells) for key, cells in columns.items()
    ]


def parse_variation(text: str) -> Variation:
    """Parse one `KEY=DIST`."""
    key, equals, right = text.partition("=")
    key = key.strip()
    if not equals or not key:
        raise InputError(
            f"--vary {text!r}: expected KEY=DIST, e.g. 'world.pipe.diameter_m="
            "uniform(0.3,0.6)', or a CSV file whose columns are keys"
        )
    label = f"--vary {key}"
    call = _CALL.fullmatch(right)
    if call is None:
        fixed = "" if "(" in right else f"; a fixed value is given by --set {key}={right.strip()}"
        raise InputError(
            f"{label}: {right.strip()!r} is not a distribution; valid: "
            f"{', '.join(FORMS.values())}" + fixed
        )
    name, inside = call.groups()
    if name not in FORMS:
        forms = ", ".join(FORMS.values())
        raise InputError(f"{label}: unknown distribution {name!r}; valid: {forms}")
    if name == "csv":
        return Variation(key, name, right.strip(), _load_column(inside, key, label))
    values = _split_values(inside)
    _check_parameters(name, values, label)
    return Variation(key, name, right.strip(), values)


def draw(variation: Variation, seed: int, run: int) -> Value:
    """Draw the value of a key for run number `run` of the campaign with `seed`."""
    if variation.kind == "csv":  # runs take the rows in order, then start again at the first
        return variation.values[run % len(variation.values)]
    rng = np.random.Generator(np.random.PCG64(_build_sequence(seed, run, variation.key)))
    if variation.kind == "choice":
        return variation.values[int(rng.integers(len(variation.values)))]
    a, b = (float(v) for v in variation.values)
    if variation.kind == "normal":
        return a + b * float(rng.standard_normal())
    u = float(rng.random())
    if variation.kind == "uniform":
        return a + (b - a) * u
    return min(max(a * math.exp(u * math.log(b / a)), a), b)


def draw_seed(seed: int, run: int) -> int:
    """Return the seed of run number `run`: below 2**48, so that spreadsheets keep every digit."""
    words = _build_sequence(seed, run, "").generate_state(1, np.uint64)
    return int(words[0] >> np.uint64(16))


def _build_sequence(seed: int, run: int, key: str) -> np.random.SeedSequence:
    digest = hashlib.sha256(key.encode()).digest()
    words = (int.from_bytes(digest[:4], "little"), int.from_bytes(digest[4:8], "little"))
    return np.random.SeedSequence(seed, spawn_key=(run, *words))


def _split_values(inside: str) -> tuple[Value, ...]:
    """Parse a list of values as TOML if possible, else as bare words separated by commas."""
    if not inside.strip():
        return ()
    whole = parse_value(f"[{inside}]")
    parts = (
        whole if isinstance(whole, list) else [parse_value(p.strip()) for p in inside.split(",")]
    )
    return tuple(parts)


def _is_finite(value: float) -> bool:
    """Return whether a number is finite; an integer beyond the range of floats is not."""
    try:
        return math.isfinite(value)
    except OverflowError:
        return False


def _check_parameters(name: str, values: tuple[Any, ...], label: str) -> None:
    form = FORMS[name]
    if name == "choice":
        if not values:
            raise InputError(f"{label}: choice() is empty; expected {form}")
        for v in values:
            if isinstance(v, list | dict) or v == "":
                raise InputError(f"{label}: choice contains {describe_value(v)}; expected {form}")
            if isinstance(v, int | float) and not _is_finite(v):
                raise InputError(
                    f"{label}: choice contains {describe_value(v)}; a finite number is needed"
                )
        return
    if len(values) != 2:
        raise InputError(f"{label}: {name} takes two numbers, found {len(values)}; write {form}")
    for v in values:
        if isinstance(v, bool) or not isinstance(v, int | float) or not _is_finite(v):
            raise InputError(f"{label}: {name} takes two finite numbers, found {describe_value(v)}")
    a, b = values
    if name == "normal":
        if b <= 0:
            raise InputError(f"{label}: the standard deviation of normal is {b}; it must be > 0")
    elif a >= b:
        raise InputError(f"{label}: {name}({a},{b}) is empty; the first number must be smaller")
    if name == "loguniform" and a <= 0:
        raise InputError(f"{label}: loguniform starts at {a}; it must be > 0")


def _load_column(inside: str, key: str, label: str) -> tuple[Value, ...]:
    file, comma, column = inside.partition(",")
    file, column = file.strip().strip("\"'"), column.strip().strip("\"'") or key
    if not file or (comma and not column):
        raise InputError(f"{label}: csv() names no file; write {FORMS['csv']}")
    columns = load_columns(Path(file), label)
    if column not in columns:
        raise InputError(
            f"{label}: {file} has no column {column!r}; valid: {neighbours(column, columns)}"
        )
    return columns[column]


def load_columns(path: Path, label: str) -> dict[str, tuple[Value, ...]]:
    """Read a CSV file with a header: column name -> cells, each a number, boolean, text or list.

    Raises InputError that names the line of a missing, surplus, empty or NaN cell.
    """
    text = read_text(path, LARGEST_TABLE, label=f"{label}: {path}")
    try:
        rows = list(csv.reader(StringIO(text, newline="")))
    except csv.Error as error:
        raise InputError(f"{label}: {path} cannot be read: {error}") from None
    lines = [(i, row) for i, row in enumerate(rows, start=1) if any(c.strip() for c in row)]
    if len(lines) < 2:
        raise InputError(
            f"{label}: {path} contains no data; a header and at least one row are required"
        )
    header = [name.strip() for name in lines[0][1]]
    if "" in header or len(set(header)) < len(header):
        raise InputError(f"{label}: {path}: the header has an empty or a repeated name")
    columns: dict[str, list[Value]] = {name: [] for name in header}
    for number, row in lines[1:]:
        if len(row) != len(header):
            raise InputError(
                f"{label}: {path}, line {number}: {len(row)} cells, the header has {len(header)}"
            )
        for name, cell in zip(header, row, strict=True):
            value = parse_value(cell.strip())
            if isinstance(value, list):  # lists are parsed when a run uses them
                value = cell.strip()
            if isinstance(value, dict) or value == "":
                raise InputError(f"{label}: {path}, line {number}: column {name!r} has no value")
            if (isinstance(value, int | float) and not _is_finite(value)) or (
                isinstance(value, str) and value.lower() in ("nan", "inf", "na", "null")
            ):
                raise InputError(
                    f"{label}: {path}, line {number}: {name} is {describe_value(value)}; "
                    "a finite number is needed"
                )
            columns[name].append(value)
    return {name: tuple(cells) for name, cells in columns.items()}
