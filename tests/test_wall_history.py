"""Wall loss over flights: owners of a required thickness, close inspections, failed checks."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from itertools import pairwise
from pathlib import Path

import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from skywright.cli import main
from skywright.inspection.history.corrosion import (
    MERGE_DAYS,
    build_history,
    divide_inspections,
)
from skywright.inspection.history.entries import (
    Calibrated,
    Reading,
    StoredCalibration,
    StoredReading,
)
from skywright.inspection.history.store import InspectionStore

T0 = datetime(2020, 1, 1, tzinfo=UTC)
YEAR = 365.25
LIMIT = {("A", "shell"): 6.0, ("B", "shell"): 3.0}


def read(
    days: float, mm: float, asset: str = "A", spot: str = "1", flight: str = "", row: int = 0
) -> StoredReading:
    t = (T0 + timedelta(days=days)).isoformat()
    reading = Reading("thickness", mm, "mm", 0.1, 0.0, 0.0, 0.0, spot=spot)
    return StoredReading(
        row, flight or f"f{days:g}", asset, "shell", row or None, t, False, 0.01, reading
    )


def test_each_asset_has_its_required_thickness() -> None:
    """9 to 8 mm in four years: 8 a to a limit of 6 mm, 20 a to one of 3 mm."""
    readings = [read(days, mm, asset) for days, mm in ((0, 9.0), (4 * YEAR, 8.0)) for asset in "AB"]
    places = build_history(readings, LIMIT)
    assert [(p.asset, p.required_mm) for p in places] == [("A", 6.0), ("B", 3.0)]
    assert [p.life_years for p in places] == pytest.approx([8.0, 20.0])
    assert [p.life_years for p in build_history(readings[::2], LIMIT)] == pytest.approx([8.0])


def test_the_output_names_the_structure(tmp_path: Path) -> None:
    path = tmp_path / "r.db"
    store = InspectionStore(path, create=True)
    for asset, required in (("A-tank", 6.0), ("B-tank", 3.0)):
        part = store.add_component(asset, "shell", required_mm=required)
        for days, mm in ((0.0, 9.0), (4 * YEAR, 8.0)):
            flight, t = store.add_flight(
                structure=asset, mission="m", robot="r", seed=1, run="", simulated=False,
                started=T0 + timedelta(days=days),
            )  # fmt: skip
            reading = Reading("thickness", mm, "mm", 0.1, 0, 0, 0, spot="1")
            store.add_reading(flight, t, reading, component=part)
    store.close()
    done = CliRunner().invoke(main, ["records", str(path), "--thickness"])
    assert done.exit_code == 0
    first, second = done.output.split("B-tank\n")
    assert "A-tank\n" in first and "7.17" in first and "17.9" in second
    assert "B-tank shell 1: a flight states no registration" in done.output


def test_a_repeated_inspection_does_not_change_the_rate_much() -> None:
    """The third reading, two hours after the second, was taken for a loss of 175 mm per year."""
    twice = [read(0, 9.0), read(4 * YEAR, 8.0)]
    (before,) = build_history(twice, LIMIT)
    (after,) = build_history([*twice, read(4 * YEAR + 2 / 24, 7.96)], LIMIT)
    assert before.life_years == pytest.approx(8.0)
    assert len(after.inspections) == 2 and after.inspections[-1].readings == 2
    assert after.inspections[-1].flights == ("f1461", "f1461.08")
    assert after.actual_mm == pytest.approx(7.98)
    assert after.life_years == pytest.approx(1.98 / (1.02 / 4))
    assert after.life_years == pytest.approx(before.life_years, rel=0.05)
    # two flights at the same time are one inspection, too
    (same,) = build_history([*twice, read(4 * YEAR, 8.0, flight="again")], LIMIT)
    assert same.life_years == pytest.approx(8.0)


@given(st.lists(st.floats(0.0, 400.0), min_size=1, max_size=40))
def test_inspections_are_apart_by_the_window(days: list[float]) -> None:
    each = divide_inspections([read(d, 9.0) for d in days])
    assert sum(one.readings for one in each) == len(days)
    gaps = [(b.time - a.time) / timedelta(days=1) for a, b in pairwise(each)]
    assert all(gap >= MERGE_DAYS for gap in gaps)
    # weekly readings do not chain to one inspection
    assert len(divide_inspections([read(7.0 * k, 9.0) for k in range(52)])) == 11


def test_a_rate_within_its_deviation_governs_with_a_note() -> None:
    readings = [read(0, 9.0), read(4 * YEAR, 8.0), read(4 * YEAR + 40, 7.9)]
    (place,) = build_history(readings, LIMIT)
    assert place.short_term is not None and not place.short_term.significant
    assert place.life_years == pytest.approx(1.9 / (0.1 / (40 / YEAR)), rel=1e-6)
    (note,) = [n for n in place.notes if "governs" in n]
    assert "the short-term rate governs, but its loss of 0.10 mm is within" in note
    assert "the long-term rate gives a life of 7.1" in note


def check(
    row: int, flight: str, stage: str, passed: bool, method: str = "UT", note: str = ""
) -> StoredCalibration:
    done = Calibrated(method, "gauge", "1", stage, "wedge", {}, passed, note)
    return StoredCalibration(row, flight, T0.isoformat(), done)


def test_readings_of_a_failed_check_are_omitted_with_a_note() -> None:
    """A wall of 9.0 mm four years later, measured with a gauge that had drifted."""
    readings = [read(0, 9.0, row=1), read(4 * YEAR, 9.0, flight="bad", row=3)]
    good = [check(1, "f0", "before", True), check(2, "f0", "after", True)]
    bad = [check(3, "bad", "before", True), check(4, "bad", "after", False, note="14 for 12.5 mm")]
    passed = bad[1]._replace(calibrated=bad[1].calibrated._replace(passed=True))
    (place,) = build_history(readings, LIMIT, calibrations=[*good, bad[0], passed])
    assert len(place.inspections) == 2
    (place,) = build_history(readings, LIMIT, calibrations=[*good, *bad])
    assert [one.flights for one in place.inspections] == [("f0",)] and place.long_term is None
    assert place.notes == (
        "omits 1 reading of flight bad, whose calibration check after the flight failed: "
        "14 for 12.5 mm",
    )
    # the location stays in the list if no reading of it is valid
    (place,) = build_history(readings[1:], LIMIT, calibrations=bad)
    assert place.inspections == [] and place.actual_mm is None and place.life_years is None
    assert place.to_json()["actual_mm"] is None and len(place.notes) == 1
    # another instrument of the flight does not matter, but a reading without a calibration counts
    other = check(5, "bad", "after", False, method="ET")
    assert len(build_history(readings, LIMIT, calibrations=[bad[0], other])[0].inspections) == 2
    loose = [readings[0], readings[1]._replace(calibration=None)]
    assert len(build_history(loose, LIMIT, calibrations=[other])[0].inspections) == 1


def test_the_command_reads_the_checks(tmp_path: Path) -> None:
    path = tmp_path / "r.db"
    store = InspectionStore(path, create=True)
    part = store.add_component("tank", "shell", required_mm=6.0)
    flight, t = store.add_flight(structure="tank", mission="m", robot="r", seed=1, run="")
    before = Calibrated("UT", "g", "1", "before", "wedge", {}, True)
    row = store.add_calibration(flight, t, before)
    reading = Reading("thickness", 9.0, "mm", 0.1, 0, 0, 0, spot="A")
    store.add_reading(flight, t, reading, component=part, calibration=row)
    call = ["records", str(path), "--thickness"]
    assert "9.00 ± 0.05" in CliRunner().invoke(main, call).output
    store.add_calibration(flight, t, before._replace(stage="after", passed=False, note="drift"))
    store.close()
    done = CliRunner().invoke(main, call)
    assert done.exit_code == 0 and "9.00 ± 0.05" not in done.output
    assert "tank shell A: omits 1 reading of flight" in done.output and "drift" in done.output
