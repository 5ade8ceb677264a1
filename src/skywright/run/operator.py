"""An operator at a stick: the interface to missions, and the file format of recorded input.

A recording is a table (CSV) with a header: `t_s` from 0 on, the stick's axes `dx, dy, dz` from -1
to 1 (ahead, left, up, in the frame of the tool's target), `button` 0 or 1. Lines that begin with #
are comments. The comment `# v_max_mps = 0.03` gives the speed at full deflection: at another speed
the same input leads elsewhere. The comment `# starts_s = 0.0, 29.48` gives the start time of each
piece of work: if a piece takes shorter or longer than when it was recorded, the next one still
begins with its own rows. The stick is constant between rows.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from skywright.core.bounded import LARGEST_TABLE, read_bytes
from skywright.errors import InputError, neighbours
from skywright.vehicle.plant import MISSION_TICK

Array = NDArray[np.float64]

COLUMNS = ("t_s", "dx", "dy", "dz", "button")
GAP_MAX = 0.5  # s between rows: the input in a longer gap is unknown
MAX_BYTES = LARGEST_TABLE
"""The only limit of a recording's length: some 14 hours of input at 50 rows/s."""
FILE = "operator.csv"
"""In a run's directory: the input of its operator."""


class Stick(NamedTuple):
    """Present input of the operator."""

    axes: Array  # (3,) each from -1 to 1: ahead, left, up
    button: bool  # confirms that the work is done
    flight: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)  # of a pilot: right, ahead, turn, climb


STILL = Stick(np.zeros(3), False)


class Sight(NamedTuple):
    """State of the work as the operator sees it."""

    off: Array  # (3,) m, of the guided object from its target: ahead, left, up
    done: bool  # whether the work appears done: the tool stands or hangs; the peg is in
    towards: tuple[float, float, float] = (0.0, 0.0, -1.0)  # unit, into the contact
    force: float = 0.0  # N, felt along it
    asked: float = 0.0  # N, commanded; 0: no contact force
    hold_s: float = 0.0  # s, for which it must be held


class Operator(Protocol):
    """A person or a program at a stick."""

    def read(self, t: float, sight: Sight) -> Stick | None:
        """Return the stick at `t` (s since the operator took over); None: operator absent."""


class Recording:
    """A recorded operator: plays back open loop."""

    def __init__(
        self,
        t: Array,
        axes: Array,
        button: NDArray[np.bool_],
        v_max: float | None,
        starts: Sequence[float] = (0.0,),
    ):
        """`t` (n,) s, `axes` (n, 3), `button` (n,); `v_max` (m/s) of a full axis, if known.

        `starts` (s) are the beginnings of the pieces of work.
        """
        self.t, self.axes, self.button, self.v_max = t, axes, button, v_max
        self.starts = list(starts)
        self._shift, self._end = 0.0, float(t[-1])

    def begin(self, piece: int, t: float) -> None:
        """Play the rows of a piece of work from `t` (s) on."""
        starts, k = [*self.starts, math.inf, math.inf], min(piece, len(self.starts))
        self._shift = starts[k] - t
        self._end = min(starts[k + 1] - MISSION_TICK, float(self.t[-1]))

    def read(self, t: float, sight: Sight) -> Stick | None:
        """Return the last row at or before `t`; None beyond the end of the piece of work."""
        t += self._shift
        if not t <= self._end + 1e-9:
            return None
        i = max(int(np.searchsorted(self.t, t + 1e-9, side="right")) - 1, 0)
        return Stick(self.axes[i], bool(self.button[i]))

    def rows(self) -> list[tuple[float, Stick]]:
        """The rows as times (s) and sticks."""
        every = zip(self.t, self.axes, self.button, strict=True)
        return [(float(t), Stick(axes, bool(button))) for t, axes, button in every]


def list_recordings(packaged: Path) -> list[str]:
    """Return the names of the recordings in the folder of a kind of mission."""
    return sorted(p.stem for p in packaged.glob("*.csv"))


def find_recording(name: str, packaged: Path, folder: Path) -> str:
    """Return the path of a recording: a name in `packaged`, or a file in `folder` or here.

    Raises InputError that lists the packaged names.
    """
    known = list_recordings(packaged)
    if name in known:
        return str(packaged / f"{name}.csv")
    for base in (folder, Path()):
        try:
            path = base / Path(name).expanduser()
            if path.is_file():
                return str(path.resolve())
        except (OSError, ValueError, RuntimeError):
            continue
    raise InputError(
        f"mission.task.operator = {name[:80]!r}: no packaged recording and no file; packaged: "
        f"{neighbours(name, known)}"
    )


def load_recording(path: Path) -> Recording:
    """Read a recording; raises InputError that states the file, line and column of an error."""
    lines = [(i, x) for i, x in enumerate(_read_text(path).splitlines(), start=1) if x.strip()]
    rows = [(i, x) for i, x in lines if not x.lstrip().startswith("#")]
    if not rows:
        raise InputError(f"{path}: empty; valid: a header {','.join(COLUMNS)} and rows of numbers")
    header = [name.strip() for name in rows[0][1].split(",")]
    for name in COLUMNS:
        if name not in header:
            shown = ", ".join(n[:20] or "(empty)" for n in header[:8])
            raise InputError(
                f"{path}: column {name} is missing; found: {shown}; valid: {', '.join(COLUMNS)}"
            )
    extra = [name for name in header if name not in COLUMNS]
    if extra or len(header) != len(COLUMNS):
        what = f"unknown column {extra[0][:20]!r}" if extra else "a column occurs twice"
        raise InputError(f"{path}: {what}; valid: {', '.join(COLUMNS)}")
    table = np.array([_read_row(path, line, text, header) for line, text in rows[1:]])
    if len(table) < 2:
        raise InputError(f"{path}: {len(table)} rows of numbers; valid: at least 2")
    _check_times(path, table[:, 0], [line for line, _ in rows[1:]])
    speeds = _read_comment(path, lines, "v_max_mps", one=True)
    if speeds and not speeds[0] > 0.0:
        raise InputError(f"{path}: v_max_mps is {speeds[0]:g}; a number above 0 is required")
    starts = _read_comment(path, lines, "starts_s", one=False) or [0.0]
    if starts[0] != 0.0 or np.any(np.diff(starts) < 0.0) or starts[-1] > table[-1, 0]:
        raise InputError(
            f"{path}: starts_s is {', '.join(f'{x:g}' for x in starts[:8])}; valid: from 0 in "
            f"order, up to the last row at {table[-1, 0]:g}"
        )
    v_max = speeds[0] if speeds else None
    return Recording(table[:, 0], table[:, 1:4], table[:, 4] > 0.5, v_max, starts)


def write_recording(
    path: Path, rows: Sequence[tuple[float, Stick]], v_max: float, starts: Sequence[float] = (0.0,)
) -> None:
    """Write a recording atomically. Raises InputError if the disk is full."""
    begun = [x for x in starts if x <= rows[-1][0]] or [0.0]
    text = [
        "# Operator's input (Suarez 2020, equation 24): each axis from -1 to 1",
        "# dx ahead, dy left, dz up; button 1: the work is done",
        f"# v_max_mps = {v_max!r}",
        f"# starts_s = {', '.join(repr(float(x)) for x in begun)}",
        ",".join(COLUMNS),
    ]
    for t, stick in rows:
        text.append(",".join([*(repr(float(x)) for x in (t, *stick.axes)), str(int(stick.button))]))
    fresh = path.with_name(path.name + ".partial")
    try:
        fresh.write_text("\n".join(text) + "\n", encoding="utf-8")
        fresh.replace(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from None


def _read_text(path: Path) -> str:
    try:
        text = read_bytes(path, MAX_BYTES).decode("utf-8-sig")
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:
        raise InputError(f"{path}: is not a text file; valid: CSV with {','.join(COLUMNS)}")
    return text


def _read_row(path: Path, line: int, text: str, header: list[str]) -> list[float]:
    """Return the numbers of a row in the order of COLUMNS."""
    cells = text.split(",")
    if len(cells) != len(header):
        raise InputError(
            f"{path}: line {line} has {len(cells)} values, the header {len(header)}: the "
            "file is truncated or mixed"
        )
    found = {}
    for name, cell in zip(header, cells, strict=True):
        try:
            value = float(cell)
        except ValueError:
            value = math.nan
        good, valid = -1.0 <= value <= 1.0, "-1 to 1"
        if name == "t_s":
            good, valid = 0.0 <= value < math.inf, "0 or more"
        elif name == "button":
            good, valid = value in (0.0, 1.0), "0 or 1"
        if not good:  # also rejects NaN
            raise InputError(
                f"{path}: line {line}, {name} is {cell.strip()[:20]!r}; valid: {valid}"
            )
        found[name] = value
    return [found[name] for name in COLUMNS]


def _check_times(path: Path, t: Array, lines: list[int]) -> None:
    if t[0] > GAP_MAX:
        raise InputError(f"{path}: line {lines[0]}, t_s is {t[0]:g}; a recording must begin at 0")
    steps = np.diff(t)
    wrong = np.flatnonzero((steps <= 0.0) | (steps > GAP_MAX))
    if len(wrong):
        i = int(wrong[0])
        what = "times must grow" if steps[i] <= 0.0 else f"no more than {GAP_MAX:g} s between rows"
        raise InputError(f"{path}: line {lines[i + 1]}, t_s is {t[i + 1]:g} after {t[i]:g}; {what}")


def _read_comment(path: Path, lines: list[tuple[int, str]], name: str, one: bool) -> list[float]:
    """Return the number or the numbers of a comment; an empty list if there is no such comment."""
    for line, text in lines:
        match = re.fullmatch(rf"\s*#\s*{name}\s*=(.*)", text)
        if match:
            try:
                values = [float(x) for x in match.group(1).split(",")]
            except ValueError:
                values = []
            if not values or (one and len(values) > 1) or not all(map(math.isfinite, values)):
                raise InputError(
                    f"{path}: line {line}, {name} is {match.group(1).strip()[:20]!r}; valid: "
                    f"{'a number' if one else 'finite numbers, separated by commas'}"
                )
            return values
    return []
