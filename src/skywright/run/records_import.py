"""Adds an existing run to a database."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

from skywright.description.loader import load_description
from skywright.errors import InputError
from skywright.inspection.history.store import InspectionStore
from skywright.run.directory import MISSION, load_run
from skywright.run.flight import Flown
from skywright.run.planning import plan_mission
from skywright.run.records import FlightRecords
from skywright.run.setup import Setup


def import_run(file: Path, directory: Path) -> str:
    """Add the findings of a run to the database `file`; returns the flight.

    Contacts with measured force are stored only during a mission, so they are not added. Raises
    InputError if the directory is not a run with a complete recording, is already in the database,
    or has no start time.
    """
    stored = load_run(directory)
    if not stored.recording.complete:
        raise InputError(f"{directory}: only a complete recording is imported: {stored.reason}")
    description = load_description(directory / MISSION)
    where = directory.resolve()
    store = InspectionStore(file, create=True)
    try:
        for flight in store.list_flights():
            if flight.run and Path(flight.run).resolve() == where:
                raise InputError(f"{file}: {directory} is in it as flight {flight.id}")
    finally:
        store.close()
    setup = Setup(description)
    plan = plan_mission(description, setup)
    began = float(stored.timing.get("started_unix_s", 0.0))
    if not began:
        raise InputError(f"{directory}: metrics.json has no timing.started_unix_s")
    records = FlightRecords(file, setup)
    try:
        records.start(where, datetime.fromtimestamp(began, UTC))
    finally:
        records.close()
    try:
        return records.add(Flown(setup, plan, stored.samples, stored.phases))
    except BaseException:
        records.undo()
        raise
