"""Probability of detection of a mission: known flaws, many flights, one table."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from skywright.analysis.campaign.campaign import CampaignResult
from skywright.analysis.pod.table import Inspections
from skywright.errors import InputError, neighbours
from skywright.run.inspected import Inspected, read_inspected
from skywright.run.rows import Row

TABLE = "pod.csv"


class Flights(NamedTuple):
    """The inspections of a campaign."""

    table: Inspections
    size: str  # name of the measure of a flaw's size
    sizes: tuple[str, ...]  # all size measures of the flaws
    flown: int
    left_out: dict[str, int]
    """Outcome -> number of runs without an inspection: they did not take off, or the program
    failed. Their reason is known in advance or visible, so they do not count as misses."""
    site: str


def collect_inspections(rows: Sequence[Row], size: str | None = None) -> Flights:
    """Return the table of a campaign's rows: one row per flaw and flight, and one per clean site.

    `size` names the size measure; the default is the first one of the kind. An interrupted flight
    counts with what it found until then. Raises InputError if no row has flaws.
    """
    inspected: list[tuple[Row, Inspected]] = []
    left_out: dict[str, int] = {}
    for row in rows:
        if row.inspected is None:
            left_out[row.outcome] = left_out.get(row.outcome, 0) + 1
        else:
            inspected.append((row, read_inspected(row.inspected)))
    flaws = [(row, flaw) for row, one in inspected for flaw in one.flaws]
    if not flaws:
        reasons = ", ".join(f"{n} {name}" for name, n in left_out.items())
        raise InputError(
            "no run inspected a flaw"
            + (f": {reasons}" if reasons else "")
            + "; the world needs flaws that the mission passes over, such as the weld of a scan"
        )
    sizes = tuple(dict.fromkeys(name for _, flaw in flaws for name in flaw.sizes))
    if size is not None and size not in sizes:
        raise InputError(f"--size {size!r}: no such measure; valid: {neighbours(size, sizes)}")
    chosen = size or sizes[0]
    keys = list(dict.fromkeys(key for row, _ in flaws for key in row.varied))
    conditions = list(dict.fromkeys(key for _, flaw in flaws for key in flaw.conditions))
    signals = all(flaw.signal is not None for _, flaw in flaws)
    names, columns = [], {name: list[str]() for name in (*keys, *conditions)}
    lists: dict[str, list[float]] = {name: [] for name in ("size", "hit", "contact", "signal")}

    def add(row: Row, name: str, numbers: tuple[float, ...], more: dict[str, float]) -> None:
        names.append(name)
        for column, value in zip(lists.values(), numbers, strict=True):
            column.append(value)
        for key in keys:
            columns[key].append(str(row.varied.get(key, "")))
        for key in conditions:
            columns[key].append(f"{more[key]:.6g}" if key in more else "")

    for row, flaw in flaws:
        value = flaw.sizes.get(chosen, math.nan)
        if not value > 0:
            raise InputError(f"run {row.run}: {flaw.name}: {chosen} is {value:g}; valid: above 0")
        seen = math.nan if flaw.signal is None else flaw.signal
        add(row, f"{row.run}/{flaw.name}", (value, flaw.hit, flaw.contact, seen), flaw.conditions)
    for row, one in inspected:
        for k in range(one.sites):
            add(row, "", (0.0, float(k < one.calls), 1.0, math.nan), {})
    arrays = {name: np.array(values, float) for name, values in lists.items()}
    clean = arrays["size"] == 0
    signal = arrays["signal"] if signals and not clean.any() else None
    unit = next((u for u in ("mm", "um", "m", "units") if chosen.endswith("_" + u)), "")
    table = Inspections(
        arrays["size"], unit, arrays["hit"], signal, arrays["contact"], tuple(names),
        {name: tuple(cells) for name, cells in columns.items()},
    )  # fmt: skip
    site = next((one.site for _, one in inspected if one.site), "")
    return Flights(table, chosen, sizes, len(inspected), left_out, site)


def write_table(flights: Flights) -> str:
    """Return the table in the format of `skywright pod FILE`."""
    t, out = flights.table, io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    signal = ["signal"] if t.signal is not None else []
    unit = f"_{t.unit}" if t.unit in ("m", "mm", "um") else ""
    writer.writerow([f"size{unit}", "hit", "contact", "flaw", *signal, *t.others])
    assert t.hit is not None and t.contact is not None and t.flaw is not None
    for i in range(len(t.size)):
        numbers = [] if t.signal is None else [f"{t.signal[i]:.6g}"]
        writer.writerow([
            f"{t.size[i]:.17g}", int(t.hit[i]), int(t.contact[i]), t.flaw[i], *numbers,
            *(cells[i] for cells in t.others.values()),
        ])  # fmt: skip
    return out.getvalue()


def describe_flights(flights: Flights, result: CampaignResult) -> dict[str, Any]:
    """Return the additional keys of `skywright pod MISSION --json`: origin of the inspections."""
    return {
        "flights": flights.flown, "left_out": flights.left_out, "size": flights.size,
        "sizes": list(flights.sizes), "site": flights.site, "folder": str(result.folder),
        "simulated": True,
    }  # fmt: skip


def save_table(flights: Flights, folder: Path) -> Path:
    """Write the table into the campaign's folder."""
    path = folder / TABLE
    partial = path.with_name(TABLE + ".partial")
    partial.write_text(write_table(flights), encoding="utf-8")
    partial.replace(path)
    return path
