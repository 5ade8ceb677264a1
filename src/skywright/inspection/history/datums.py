"""Datum points: reading from a table, storage in the database, and registration of flights."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path

import numpy as np

from skywright.core.bounded import LARGEST_TABLE, read_text
from skywright.errors import InputError
from skywright.inspection.history.database import DatabaseFile
from skywright.inspection.history.entries import Datum, Reading, StoredIndication, StoredReading
from skywright.inspection.history.registration import Registration, register_flight
from skywright.recordings.text_table import list_names

COLUMNS = ("name", "x_m", "y_m", "z_m", "u95_m")
LARGEST_M = 1e8
"""m, largest valid coordinate; exceeds the coordinates in every frame of the earth."""


def load_datums(path: Path) -> list[Datum]:
    """Read datum points from a CSV file with the columns name, x_m, y_m, z_m, u95_m.

    Raises InputError, with file, line and column, if the table is not valid.
    """
    text = read_text(path, LARGEST_TABLE)
    try:
        reader = csv.DictReader(io.StringIO(text, newline=""))
        rows, header = list(reader), tuple(reader.fieldnames or ())
    except csv.Error as error:
        raise InputError(f"{path}: cannot be read as a table: {error}") from None
    if missing := [name for name in COLUMNS if name not in header]:
        raise InputError(
            f"{path}: lacks {', '.join(missing)}; valid: a header with {', '.join(COLUMNS)}"
        )
    if not rows:
        raise InputError(f"{path}: holds no datum point")
    return [_read_datum(path, number, row) for number, row in enumerate(rows, 2)]


def _read_datum(path: Path, number: int, row: dict[str, str | None]) -> Datum:
    name, numbers = (row["name"] or "").strip(), []
    if not name:
        raise InputError(f"{path}, line {number}: name is empty; valid: the name of a mark")
    for key in COLUMNS[1:]:
        try:
            value = float(row[key] or "")
        except ValueError:
            value = math.nan
        if not abs(value) <= LARGEST_M or (key == "u95_m" and value <= 0):
            what = f"{'above 0' if key == 'u95_m' else f'{-LARGEST_M:g}'} to {LARGEST_M:g}"
            raise InputError(f"{path}, line {number}: {key} is {row[key]!r}; valid: {what} (m)")
        numbers.append(value)
    return Datum(name, *numbers)


class DatumFile(DatabaseFile):
    """The part of the database that stores datum points and registers flights by them."""

    def add_datums(self, asset: str, flight: str | None, datums: Iterable[Datum]) -> None:
        """Store the datum points of an asset (`flight` None), or those measured by a flight.

        A stored point of the same name is replaced. Raises InputError, and stores nothing, if a
        name occurs twice, if `flight` is not a flight of `asset`, or if a flight cannot be
        registered by these points.
        """
        points = list(datums)
        names = [d.name for d in points]
        if twice := sorted({n for n in names if names.count(n) > 1}):
            raise InputError(f"datum points: {', '.join(twice)} twice; valid: each name once")
        new = {**self.list_datums(asset, flight), **{d.name: d for d in points}}
        flights = dict(self.read(
            "SELECT id, registration_std_m FROM flights WHERE structure = ?", (asset,)
        ))  # fmt: skip
        if flight is not None and flight not in flights:
            raise InputError(
                f"{self.path}: datum points: no flight {flight!r} of {asset!r}; valid: "
                f"{list_names(tuple(flights), 5) or 'none, as it has no flight'}"
            )
        for one, prior in flights.items():
            if flight is None:
                register_flight(new, self.list_datums(asset, one), prior)
            elif one == flight:
                register_flight(self.list_datums(asset), new, prior)
        self.write(
            *(
                ("DELETE FROM datums WHERE asset = ? AND coalesce(flight, '') = ? AND name = ?",
                 (asset, flight or "", name))
                for name in names
            ),
            *(
                ("INSERT INTO datums (asset, flight, name, x_m, y_m, z_m, u95_m)"
                 " VALUES (?, ?, ?, ?, ?, ?, ?)", (asset, flight, *d))
                for d in points
            ),
        )  # fmt: skip

    def list_datums(self, asset: str, flight: str | None = None) -> dict[str, Datum]:
        """Return the datum points of an asset, or those measured by `flight`, by name."""
        rows = self.read(
            "SELECT name, x_m, y_m, z_m, u95_m FROM datums"
            " WHERE asset = ? AND coalesce(flight, '') = ? ORDER BY name", (asset, flight or ""),
        )  # fmt: skip
        return {row[0]: Datum(*row) for row in rows}

    def find_registration(self, flight: str) -> Registration | None:
        """Return the registration of a flight; None if it shares no datum points with its asset.

        Raises InputError if there is no such flight, or if its points do not fit.
        """
        rows = self.read(
            "SELECT structure, registration_std_m FROM flights WHERE id = ?", (flight,)
        )
        if not rows:
            raise InputError(f"{self.path}: no flight {flight!r}")
        asset, prior = rows[0]
        measured = self.list_datums(asset, flight)
        return register_flight(self.list_datums(asset), measured, prior) if measured else None

    def carry_readings(self, found: list[StoredReading]) -> list[StoredReading]:
        """Return readings in the frame of the asset if datum points register their flight.

        Their `registration_std_m` is then the standard deviation of the registration at their
        position. Other readings are returned unchanged.
        """
        find, out = lru_cache(maxsize=None)(self.find_registration), []
        for r in found:
            known = find(r.flight)
            if known is None:
                out.append(r)
                continue
            x, y, z, std = _carry(known, r.reading)
            moved = r.reading._replace(x_m=x, y_m=y, z_m=z)
            out.append(r._replace(reading=moved, registration_std_m=std))
        return out

    def carry_indications(self, found: list[StoredIndication]) -> list[StoredIndication]:
        """Transform indications in the same way as `carry_readings`."""
        find, out = lru_cache(maxsize=None)(self.find_registration), []
        for i in found:
            known = find(i.flight)
            if known is None:
                out.append(i)
                continue
            p, std = known.carry(np.array([i.indication.x_m, i.indication.y_m, i.indication.z_m]))
            x, y, z = p.tolist()
            moved = i.indication._replace(x_m=x, y_m=y, z_m=z)
            out.append(i._replace(indication=moved, registration_std_m=std))
        return out


def _carry(known: Registration, r: Reading) -> tuple[float, float, float, float]:
    p, std = known.carry(np.array([r.x_m, r.y_m, r.z_m]))
    x, y, z = p.tolist()
    return x, y, z, std
