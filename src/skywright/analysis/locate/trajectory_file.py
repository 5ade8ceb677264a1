"""Read trajectories of other programs: TUM, EuRoC, CSV with a header, MCAP.

The format is detected from the content. Notes state what was dropped, repaired or guessed. Errors
state the file, the line, the invalid content and the valid alternatives.
"""

import io
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from skywright.analysis.locate.trajectory_mcap import load_topic
from skywright.core import bounded
from skywright.core.arrays import Array
from skywright.errors import InputError
from skywright.models.localisation.trajectory import MAX_DROPPED, Trajectory, clean
from skywright.recordings import text_table
from skywright.recordings.mcap_file import MAGIC

TIME_UNITS = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
LENGTH_UNITS = {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "km": 1e3, "in": 0.0254, "ft": 0.3048}
TIME_NAMES = {"t", "time", "timestamp", "stamp", "timestamps", "times"}
ORIENTATION = {"q", "quat", "quaternion", "orientation", "rotation", "rot"}
POSITION = {"p", "pos", "position", "translation", "trans", "point"}
OTHER = {
    "v", "vel", "velocity", "twist", "linear", "angular", "w", "omega", "b", "bias", "a", "acc",
    "accel", "acceleration", "cov", "covariance", "std", "sigma", "error", "e", "gyro",
}  # fmt: skip
MAX_BYTES = 1_000_000_000
VALID = (
    "a TUM file (t x y z qx qy qz qw), a EuRoC CSV, a CSV with a header such as "
    "t_s,x_m,y_m,z_m[,qw,qx,qy,qz], or an MCAP recording"
)
_COMMENT = ("#", "%", "//")


class Columns(NamedTuple):
    """Column of each quantity in a row and its factor to SI."""

    place: dict[str, int]  # t, x, y, z, perhaps qw, qx, qy, qz
    factor: dict[str, float]
    timed: bool  # the unit of time is given
    named: bool  # the columns have names
    width: int
    notes: tuple[str, ...]


def split_topic(text: str) -> tuple[Path, str | None]:
    """Split FILE:TOPIC; a topic begins with a slash. An existing file of the whole name has
    priority."""
    head, colon, topic = text.rpartition(":")
    if colon and topic.startswith("/") and head and not Path(text).exists():
        return Path(head), topic
    return Path(text), None


def load_trajectory(text: str) -> Trajectory:
    """Load FILE or FILE:TOPIC. Raises InputError with one line for unusable input."""
    path, topic = split_topic(text)
    raw = read_bytes(path)
    if raw[: len(MAGIC)] == MAGIC[: len(raw)]:
        return load_topic(path, topic)
    if topic is not None:
        raise InputError(f"{path}: is not an MCAP file and has no topic {topic}")
    return parse_text(path, raw)


def read_bytes(path: Path) -> bytes:
    """Return the content of a file. Raises InputError if it does not exist or is empty."""
    raw = bounded.read_bytes(path, MAX_BYTES, "cut it first")
    if not raw.strip():
        raise InputError(f"{path}: is empty; valid: {VALID}")
    return raw


def parse_text(path: Path, raw: bytes) -> Trajectory:
    """Parse the content of a text file."""
    text = text_table.decode(raw)
    if "\0" in text or sum(c < " " and c not in "\t\r\n\f" for c in text[:2000]) > 10:
        raise InputError(f"{path}: is neither text nor MCAP; valid: {VALID}")
    rows: list[tuple[int, str]] = []
    comment = 0, ""
    for number, line in enumerate(text.splitlines(), 1):
        stripped = line.strip()
        if not stripped:
            continue
        if stripped.startswith(_COMMENT):
            comment = (number, stripped.lstrip("#%/ ")) if not rows else comment
        else:
            rows.append((number, stripped))
    if not rows:
        raise InputError(f"{path}: contains no rows of numbers, only comments; valid: {VALID}")
    delimiter = find_delimiter(rows[0][1])
    cells = split_row(rows[0][1], delimiter)
    notes: list[str] = []
    numbers = [_is_number(c) for c in cells]
    named = _read_comment(path, comment, len(cells)) if numbers[0] else None
    if named is not None:
        columns = named
    elif all(numbers):
        columns = _guess_columns(path, rows[0], cells)
    else:
        columns = read_header(path, cells, rows[0][0])
        rows = rows[1:]
        if not rows:
            raise InputError(f"{path}: has a header but no rows of numbers")
    notes += columns.notes
    table = _read_rows(path, rows, delimiter, columns, notes)
    return _build(path, table, columns, rows, notes)


def find_delimiter(line: str) -> str:
    """Return the first delimiter that yields at least four cells, else the one that yields most."""
    counts = {d: len(split_row(line, d)) for d in (",", ";", "\t", " ")}
    return next((d for d, n in counts.items() if n >= 4), max(counts, key=lambda d: counts[d]))


def split_row(line: str, delimiter: str) -> list[str]:
    """Return the stripped cells of a row without trailing empty ones."""
    cells = text_table.split_row(line, delimiter)
    while len(cells) > 1 and not cells[-1]:
        cells.pop()
    return cells


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def name_column(cell: str) -> tuple[str, float | None] | None:
    """Return (quantity, factor or None without unit) of a column's name; None for other columns.

    Accepts x, x_mm, tx, pos_x [m], p_RS_R_x [m], field.pose.position.x, qw, q_RS_w, timestamp [ns],
    time(ms), header.stamp. `check_unit` tells a unit in brackets that is unknown from none.
    """
    text = cell.strip().strip("\"'").lstrip("#% ").lower()
    unit = None
    found = re.search(r"[\[(]\s*([a-z]*)\s*[\])]\s*$", text)
    if found:
        unit, text = text_table.plain_unit(found.group(1)), text[: found.start()].strip()
    words = [w for w in re.split(r"[._/\s]+", text) if w]
    if len(words) > 1 and unit is None and words[-1] in {**TIME_UNITS, **LENGTH_UNITS}:
        unit = words.pop()
    if not words:
        return None
    last, stem = words[-1], set(words[:-1])
    if last in TIME_NAMES or (last in ("rosbagtimestamp", "secs") and not stem):
        return ("t", TIME_UNITS.get(unit)) if unit else ("t", None)
    glued = re.fullmatch(r"(t|p|q|pos|quat)([xyzw])", last)
    if glued:
        stem, last = stem | {glued.group(1)}, glued.group(2)
        stem = stem - {"t"} if glued.group(1) == "t" else stem
    if last not in ("x", "y", "z", "w"):
        return None
    if stem & ORIENTATION:
        return f"q{last}", 1.0
    if last == "w" or (stem & OTHER and not stem & POSITION):
        return None
    return last, LENGTH_UNITS.get(unit) if unit else None


LABELS = {
    "utc", "gps", "tai", "unix", "epoch", "ros", "east", "north", "up", "enu", "ned", "local",
    "utm", "ecef", "wgs84", "e", "n", "u",
}  # fmt: skip
"""Words in brackets that name a time scale, a frame or an axis, and no unit."""


def check_unit(path: Path, line: int, cell: str, name: str) -> None:
    """Raise InputError if the brackets of a column's name hold a unit that `name` cannot have."""
    units = TIME_UNITS if name == "t" else LENGTH_UNITS
    found = re.search(r"[\[(]\s*([^\])]*?)\s*[\])][\s\"']*$", cell)
    if found is None or found.group(1).lower() in LABELS:
        return
    if found.group(1) and text_table.plain_unit(found.group(1)) not in units:
        raise InputError(
            f"{path}: line {line}: unknown unit {found.group(1)[:20]!r} of {name}; valid: "
            f"{', '.join(units)}"
        )


def read_header(path: Path, cells: list[str], line: int) -> Columns:
    """Find columns by name.

    Raises InputError if time or a coordinate is missing, duplicate, or in an unknown unit.
    """
    index: dict[str, int] = {}
    factor: dict[str, float] = {}
    notes: list[str] = []
    timed = bare = False
    for i, cell in enumerate(cells):
        named = name_column(cell)
        if named is None:
            continue
        name, scale = named
        if name in index and name != "t":
            raise InputError(
                f"{path}: line {line}: two columns give {name}: {cells[index[name]][:40]!r} and "
                f"{cell[:40]!r}"
            )
        if name in index and "header" not in cell.lower():
            continue  # the recorder's time is later than the message's
        if scale is None:
            check_unit(path, line, cell, name)
        index[name], factor[name] = i, scale if scale is not None else 1.0
        if name == "t":
            timed = scale is not None
        elif scale is None:
            bare = True
    for name in ("t", "x", "y", "z"):
        if name not in index:
            shown = ", ".join(c[:24] or "(empty)" for c in cells[:12])
            what = "time" if name == "t" else f"column {name}"
            raise InputError(f"{path}: line {line}: no {what}; found: {shown}; valid: {VALID}")
    if bare:
        notes.append("positions without a unit read as metres")
    _check_quaternion(index, notes)
    return Columns(index, factor, timed, True, len(cells), tuple(notes))


def _check_quaternion(index: dict[str, int], notes: list[str]) -> None:
    names = [n for n in ("qw", "qx", "qy", "qz") if n in index]
    if 0 < len(names) < 4:
        notes.append(f"orientation incomplete (only {', '.join(names)}): ignored")
        for name in names:
            del index[name]


def _read_comment(path: Path, comment: tuple[int, str], width: int) -> Columns | None:
    """Return columns named in a comment above the rows, as in EuRoC and many TUM files.

    A comment that does not name a time and three coordinates is no header.
    """
    line, text = comment[0], re.sub(r"\s+([\[(])", r"\1", comment[1])  # "t [s] x": two cells
    cells = split_row(text, find_delimiter(text)) if text else []
    named = {found[0] for found in map(name_column, cells) if found}
    if len(cells) != width or not named.issuperset("txyz"):
        return None
    return read_header(path, cells, line)


def _guess_columns(path: Path, row: tuple[int, str], cells: list[str]) -> Columns:
    """Return the columns of a file without names, from their number."""
    order = {
        4: ("t", "x", "y", "z"),
        8: ("t", "x", "y", "z", "qx", "qy", "qz", "qw"),
        17: ("t", "x", "y", "z", "qw", "qx", "qy", "qz"),
    }
    n = len(cells)
    if n not in order:
        kitti = "; 12 columns without times are KITTI poses: give them a time column"
        hint = kitti if n == 12 else ""
        raise InputError(f"{path}: line {row[0]}: {n} columns without names{hint}; valid: {VALID}")
    notes = []
    if n == 17:
        notes.append("17 columns without names: read as EuRoC's ground truth")
    elif n == 8 and "," in row[1]:
        notes.append("8 columns without names: read in TUM's order, t x y z qx qy qz qw")
    index = {name: i for i, name in enumerate(order[n])}
    return Columns(index, dict.fromkeys(index, 1.0), False, False, n, tuple(notes))


def _read_rows(
    path: Path, rows: list[tuple[int, str]], delimiter: str, columns: Columns, notes: list[str]
) -> Array:
    """Return (rows, columns) of numbers, NaN for other cells; rows of a wrong length are all
    NaN."""
    table = np.full((len(rows), columns.width), np.nan)
    ragged, first = 0, 0
    comma = delimiter in (";", "\t")
    for i, (number, line) in enumerate(rows):
        cells = split_row(line, delimiter)
        if len(cells) != columns.width:
            ragged += 1
            first = first or number
            continue
        for j, cell in enumerate(cells):
            try:
                table[i, j] = float(cell.replace(",", ".") if comma else cell)
            except ValueError:
                continue
    if ragged > MAX_DROPPED * len(rows):
        raise InputError(
            f"{path}: line {first}: {len(split_row(dict(rows)[first], delimiter))} cells where "
            f"{columns.width} are expected, and so {ragged} of {len(rows)} rows"
        )
    if ragged:
        notes.append(f"{ragged} rows with a wrong number of cells dropped (line {first} first)")
    return table


def _build(
    path: Path, table: Array, c: Columns, rows: list[tuple[int, str]], notes: list[str]
) -> Trajectory:
    t = table[:, c.place["t"]] * c.factor["t"]
    p = np.stack([table[:, c.place[n]] * c.factor[n] for n in "xyz"], axis=1)
    q = None
    if "qw" in c.place:
        q = table[:, [c.place[n] for n in ("qw", "qx", "qy", "qz")]]
    if not c.timed:
        t, note = guess_time_unit(t)
        if not note and c.named:
            note = "times without a unit read as s"
        notes += [note] if note else []
    return clean(path, t, p, q, notes, [number for number, _ in rows])


def guess_time_unit(t: Array) -> tuple[Array, str]:
    """Convert times to seconds; large values are stamps since 1970 in ms, us or ns."""
    known = t[np.isfinite(t)]
    size = float(np.median(np.abs(known))) if len(known) else 0.0
    for least, unit in ((1e17, "ns"), (1e14, "us"), (1e11, "ms")):
        if size > least:
            return t * TIME_UNITS[unit], f"times without a unit read as {unit}"
    step = float(np.median(np.abs(np.diff(known)))) if len(known) > 1 else 0.0
    if step > 1e5:  # no sensor pauses for a day between samples
        return t * 1e-9, "times without a unit read as ns"
    return t, ""


def format_table(names: Sequence[str], columns: Sequence[Array], digits: Sequence[int]) -> str:
    """Format columns (n,) as CSV, with a header and the given number of decimals each."""
    buffer = io.StringIO()
    formats = [f"%.{n}f" for n in digits]
    np.savetxt(buffer, np.column_stack(columns), formats, ",", header=",".join(names), comments="")
    return buffer.getvalue()


def format_tum(traj: Trajectory) -> str:
    """Format a TUM file; without orientations, the rotation is the identity."""
    q = np.tile([1.0, 0.0, 0.0, 0.0], (len(traj.t), 1)) if traj.q is None else traj.q
    buffer = io.StringIO()
    formats = ["%.6f"] + ["%.5f"] * 3 + ["%.6f"] * 4
    rows = np.column_stack([traj.t, traj.p, np.roll(q, -1, axis=1)])
    np.savetxt(buffer, rows, formats, " ", header="timestamp tx ty tz qx qy qz qw")
    return buffer.getvalue()
