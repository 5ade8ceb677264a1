"""Import of gauge tables: dates, units, columns, provenance, codes, and all or nothing."""

from __future__ import annotations

import json
import os
import re
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from skywright.cli import main
from skywright.cli.records_lists import find_readings
from skywright.errors import InputError
from skywright.inspection.files.gauge_table import load_readings
from skywright.inspection.history.database import parse_stamp
from skywright.inspection.history.datums import load_datums
from skywright.inspection.history.entries import Reading
from skywright.inspection.history.store import InspectionStore
from skywright.run.records import RecordStore

START = datetime(2026, 3, 1, tzinfo=UTC)


def call(*args: object) -> tuple[int, str]:
    done = CliRunner().invoke(main, ["records", *map(str, args)])
    return done.exit_code, done.output


def write(path: Path, *lines: str) -> Path:
    path.write_text("\n".join(lines) + "\n")
    return path


def add(db: Path, table: Path, *more: object, measured: str = "2026-03-01") -> tuple[int, str]:
    return call(db, "--import", table, "--structure", "tank", "--component", "pipe",
                "--measured", measured, *more)  # fmt: skip


def show_history(db: Path, *more: object) -> list[dict[str, Any]]:
    code, out = call(db, "--thickness", "--json", *more)
    assert code == 0, out
    found: list[dict[str, Any]] = json.loads(out)["locations"]
    return found


def list_flights(db: Path) -> list[Any]:
    store = InspectionStore(db)
    found = store.list_flights()
    store.close()
    return list(found)


def test_the_dates_of_a_table_are_inspections(tmp_path: Path) -> None:
    """9.0, 8.0 and 6.6 mm in ten years: 0.24 mm/a over all, 0.28 mm/a in the second half."""
    db = tmp_path / "h.db"
    table = write(
        tmp_path / "g.csv", "t,spot,thickness_mm,u95_mm", "2015-03-01,1,9.0,0.1",
        "2025-03-01T10:00:00Z,1,6.6,0.1", "2020-03-01,1,8.0,0.1",
    )  # fmt: skip
    code, out = add(db, table, "--required", 6)
    assert code == 0 and "3 readings" in out
    flights = list_flights(db)
    assert [f.started_utc[:4] for f in flights] == ["2015", "2020", "2025"]
    (place,) = show_history(db)
    assert len(place["inspections"]) == 3 and place["actual_mm"] == pytest.approx(6.6)
    assert place["long_term"]["mm_per_year"] == pytest.approx(0.24, rel=1e-3)
    assert place["short_term"]["mm_per_year"] == pytest.approx(0.28, rel=1e-3)
    assert place["life_years"] == pytest.approx(0.6 / 0.28, rel=1e-3)
    # an export of all flights takes the same way
    export, again = tmp_path / "export.csv", tmp_path / "again.db"
    assert call(db, "--readings", "--csv", export)[0] == 0
    assert add(again, export, "--required", 6, measured="2026-01-01")[0] == 0
    (copy,) = show_history(again)
    assert copy["life_years"] == pytest.approx(place["life_years"], rel=1e-6)


@pytest.mark.parametrize(
    ("text", "columns", "mm"),
    [
        ("spot,thickness_mm,thickness_nominal\n1,6.1,9.5\n", None, 6.1),
        ("spot,thickness_mm,thickness_flag\n1,6.1,1\n", None, 6.1),
        ("spot,thickness_inch\n1,0.25\n", None, 6.35),
        ("spot,thickness_cm\n1,0.61\n", None, 6.1),
        ("spot,thickness_mm,thickness_in\n1,6.1,0.3\n", "value=thickness_in[in]", 7.62),
        ("spot,value,unit\n1,0.25,in\n", None, 6.35),
        ("spot,thickness,unit\n1,6.1,MM\n", None, 6.1),
        ("spot,Wand,unit\n1,0.25,in\n", "value=Wand", 6.35),
        ("spot,Wand\n1,6.1\n", "value=Wand", 6.1),
        ("spot,thickness [mm]\n1,6.1\n", None, 6.1),
        ("spot,Thickness (in)\n1,0.25\n", None, 6.35),
        ("spot,Dicke [mm]\n1,6.1\n", "value=Dicke[mm]", 6.1),
        ("spot,Wall [µm]\n1,6100\n", "value=Wall", 6.1),
        ("spot,Wall\n1,6100\n", "value=Wall[µm]", 6.1),
        ("spot,Dicke [in]\n1,0.25\n", "value=dicke", 6.35),
        ("spot,Dicke [mm],Dicke [in]\n1,9,0.25\n", "value=Dicke[in]", 6.35),
        ("spot,Dicke (max),Dicke (min)\n1,9,6.1\n", "value=Dicke (min)[mm]", 6.1),
        ("spot;thickness [mm]\n1;6,1\n", None, 6.1),
        ("spot,thickness_inches\n1,0.25\n", None, 6.35),
        ("spot,Wall (inch)\n1,0.25\n", "value=Wall[in]", 6.35),
        ("spot,Wall [in]\n1,0.25\n", "value=Wall[inches]", 6.35),
        ("spot,Dicke [Zoll]\n1,0.25\n", "value=Dicke[in]", 6.35),
        ("spot,Wall_microns\n1,6100\n", "value=Wall_microns", 6.1),
        ("spot,Wall_meters\n1,0.0061\n", "value=Wall_meters", 6.1),
        ("spot,Wall (centimetres)\n1,0.61\n", "value=Wall", 6.1),
        ("spot,thickness_micrometer\n1,6100\n", None, 6.1),
        ("spot,thickness,unit\n1,6100,Micrometres\n", None, 6.1),
        ("spot,Dicke (Zoll)\n1,0.25\n", "value=Dicke (Zoll)[in]", 6.35),
        ("spot,Wall_us\n1,6.1\n", "value=Wall_us[mm]", 6.1),  # ultrasound
        ("spot,thickness_um,unit\n1,6100,µm\n", None, 6.1),
        ("spot,thickness,unit\n1,6.1,Millimetre\n", None, 6.1),
        ("spot,thickness_in,unit\n1,0.25,inches\n", None, 6.35),
        ("spot,thickness_mm,Unit\n1,6.1,CDU-2\n", None, 6.1),
        ("spot,thickness_mm,Unit\n1,6.1,H\n", None, 6.1),
        ("spot,thickness_mm,thickness_mils\n1,6.1,240\n", None, 6.1),
        ("spot,thickness_mm,thickness_us\n1,6.1,2.06\n", None, 6.1),
        ("t_s,date_us,spot,thickness_mm\n0,03/01/2026,1,6.1\n", None, 6.1),
    ],
)
def test_the_value_has_the_unit_that_the_table_states(
    tmp_path: Path, text: str, columns: str | None, mm: float
) -> None:
    (tmp_path / "g.csv").write_text(text)
    ((row,), _) = load_readings(tmp_path / "g.csv", START, columns)
    assert row.reading.value == pytest.approx(mm) and row.reading.unit == "mm"


def test_the_column_unit_is_that_of_columns_without_a_unit(tmp_path: Path) -> None:
    """A value in inches, and u95 in mm by its own header."""
    table = write(tmp_path / "g.csv", "spot,value,unit,u95_mm", "1,0.25,in,0.1")
    ((row,), _) = load_readings(table, START)
    assert row.reading.value == pytest.approx(6.35) and row.reading.u95 == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("text", "columns", "says"),
    [
        ("spot,thickness_mm,value_mm\n1,6,9\n", None, "two columns give value: thickness_mm, valu"),
        ("spot,thickness_mm,thickness_mm\n1,6,9\n", None, "two columns give value"),
        ("spot,thickness_mm,thickness_mm\n1,6,9\n", "value=thickness_mm", "several columns"),
        ("x_m,x_mm,y_m,z_m,thickness_mm\n1,1,1,1,6\n", None, "two columns give x: x_m, x_mm"),
        ("t_s,time_utc,spot,thickness_mm\n1,2026-03-01,A,6\n", None, "two columns give t"),
        (
            "spot,thickness_mils\n1,250\n",
            None,
            "the column thickness_mils states mil; valid units: m",
        ),
        ("spot,thickness\n1,6.1\n", None, "the column thickness has no unit"),
        ("spot,value\n1,6.1\n", None, "the column value has no unit; valid: value_mm"),
        ("spot,thickness_mm,u95\n1,6.1,0.1\n", None, "the column u95 has no unit"),
        ("spot,value,unit\n1,5,N\n", None, "row 2: unit is 'N'; valid: m, mm"),
        ("spot,thickness_mm,quantity\n1,5,force\n", None, "a length, because value is in mm"),
        ("spot,thickness_mm,quantity\n1,5,THK\n", None, "valid: thickness, coating, force"),
        ("spot,thickness_mm,origin\n1,5,lab\n", None, "origin is 'lab'; valid: SIMULATED or"),
        ("spot,thickness_mm\n,5\n", None, "row 2: spot is ''"),
        ("spot,thickness_mm,component\n1,5,pipe\n1,9,shell\n", None, "the column component has 2"),
        ("spot,thickness_mm,place_u95_m\n1,5,-1\n", None, "place_u95_m is '-1'; valid: 0 or more"),
        ("t,spot,thickness_mm\n1772366400000,1,9\n", None, "row 2: t is '1772366400000'; valid: "),
        ("t,spot,thickness_mm\n1772366400,1,9\n", None, "at most 30 days from --measured"),
        ("t,spot,thickness_mm\n0205-03-01,1,9\n", None, "a year from 1900 to 2100"),
        ("t,spot,thickness_mm\n0001-01-01T00:00+14:00,1,9\n", None, "is no time"),
        ("time_utc,spot,thickness_mm\n20.5,1,9\n", None, "'20.5' is no time"),
        ("Time,spot,thickness_mm\n20.5,1,9\n", None, "or --columns t=Time[s] for times since"),
        ("time_utc,spot,thickness_mm\n20.5,1,9\n", None, "or the header t_s for times since"),
        ("Time (UTC),spot,thickness_mm\n20.5,1,9\n", None, "or the header t_s for times since"),
        ("date,t_s,spot,thickness_mm\n2026-03-01,1,A,6\n", None, "two columns give t: date, t_s"),
        ("spot,thickness [mils]\n1,250\n", None, "thickness [mils] states mil; valid units: m"),
        ("spot,Dicke [Zoll]\n1,0.25\n", "value=Dicke", "'Dicke [Zoll]' states no unit"),
        ("spot,Dicke (Zoll)\n1,0.25\n", "value=Dicke (Zoll)", "give it as dicke (zoll)[UNIT] with"),
        ("Time (probe),spot,thickness_mm\n1,1,6\n", "t=Time (probe)", "states no unit that is"),
        ("spot,Wall_foot\n1,0.02\n", "value=Wall_foot", "'Wall_foot' states ft; valid units: m"),
        ("spot,Wall_microns\n1,6\n", "value=Wall_microns[mm]", "states um, but mm is given"),
        ("Time_hrs,spot,thickness_mm\n1,1,6\n", "t=Time_hrs", "'Time_hrs' states h; valid units"),
        ("Time (days),spot,thickness_mm\n1,1,6\n", "t=Time", "'Time (days)' states d; valid"),
        ("spot,thickness_mm,unit\n1,6,micron\n", None, "row 2: unit is 'micron'; valid: mm, which"),
        ("spot,Wall (mil)\n1,250\n", "value=Wall", "'Wall (mil)' states mil; valid units: m, mm"),
        ("spot,Wall_mil\n1,250\n", "value=Wall_mil", "'Wall_mil' states mil; valid units: m, mm"),
        (
            "spot,Wall_mil\n1,250\n",
            "value=Wall_mil[mm]",
            "um, cm, in; convert the values, and corr",
        ),
        ("spot,Wall (mil)\n1,250\n", "value=Wall[mm]", "'Wall (mil)' states mil; valid units"),
        ("spot,Wall (in.)\n1,0.3\n", "value=Wall[mm]", "'Wall (in.)' states in, but mm is given"),
        ("spot,Wall [UT: in]\n1,0.3\n", "value=Wall[mm]", "states in, but mm is given"),
        ("spot,Wall (inches)\n1,0.25\n", "value=Wall[mm]", "states in, but mm is given"),
        ("Time [h],spot,thickness_mm\n1,1,6\n", "t=Time[s]", "'Time [h]' states h; valid units: s"),
        ("spot,Dicke [Zoll]\n1,0.25\n", "value=Dicke", "give it as dicke[UNIT] with one of m, mm"),
        ("spot,Wall [in]\n1,0.25\n", "value=Wall[mm]", "'Wall [in]' states in, but mm is given"),
        ("spot,thickness_mm,unit\n1,0.25,in\n", None, "row 2: unit is 'in'; valid: mm, which the"),
        ("spot,thickness_mm,Unit\n1,250,mils\n", None, "row 2: Unit is 'mils'; valid: mm, which"),
        ("spot,W,unit\n1,0.25,in\n", "value=W[mm]", "mm, which the header or --columns states"),
        ("spot,thickness,Unit\n1,6.1,CDU-2\n", None, "row 2: Unit is 'CDU-2'; valid: m, mm"),
        ("spot,W_mm\n1,6\n", "value=W_mm,u95=W_mm", "value and u95 are both 'W_mm'"),
        ("spot,x,y [ft],z,thickness_mm\n1,1,1,1,6\n", None, "the column y [ft] states ft; valid"),
        ("time [h],spot,thickness_mm\n1,1,6\n", None, "time [h] states h; valid units: s, ms, min"),
        ("date_us,spot,thickness_mm\n03/01/2026,1,6\n", None, "date_us states us; valid units: s"),
        ("spot,Wall (mil)\n1,250\n", "value=Wall (mil)", "'Wall (mil)' states mil; valid"),
        ("X [ft],y_m,z_m,thickness_mm\n1,1,1,6\n", "x=X", "'X [ft]' states ft; valid units: m"),
        ("Time [h],spot,thickness_mm\n1,1,6\n", "t=Time", "'Time [h]' states h; valid units: s"),
        ("spot,Dicke [mm],dicke\n1,6,9\n", "value=Dicke (max)", "no column 'dicke (max)'"),
        ("spot,Dicke [mm],Dicke (mm)\n1,6,9\n", "value=Dicke[mm]", "several columns 'dicke'"),
        ("spot;thickness_mm;u95_mm\n1;9,1;0.1\n", None, "both , and . (such as 9,1 and 0.1)"),
    ],
)
def test_an_ambiguous_table_is_refused(
    tmp_path: Path, text: str, columns: str | None, says: str
) -> None:
    (tmp_path / "g.csv").write_text(text)
    with pytest.raises(InputError) as caught:
        load_readings(tmp_path / "g.csv", START, columns)
    assert says in str(caught.value)


@pytest.mark.parametrize(
    "name", ["date", "Time", "timestamp", "Datetime", "t_utc", "time_utc", "Time [UTC]"]
)
def test_a_column_of_dates_is_read_by_its_usual_names(tmp_path: Path, name: str) -> None:
    """Dates of a column that is not read would be averaged to one inspection."""
    table = write(
        tmp_path / "g.csv", f"{name},spot,thickness_mm,Prüfer,asset", "2015-03-01,1,9.0,A,tank",
        "2025-03-01T10:00:00Z,1,6.6,B,tank",
    )  # fmt: skip
    rows, notes = load_readings(table, START)
    assert [row.time.year for row in rows] == [2015, 2025]
    assert notes == ("columns ignored: Prüfer",)


def test_ignored_columns_and_decimal_commas_are_noted(tmp_path: Path) -> None:
    db = tmp_path / "h.db"
    table = write(
        tmp_path / "g.csv", "Zeit;spot;thickness_mm;u95_mm;Ort", "1;1,5;9,25;0,1;K 1.2",
    )  # fmt: skip
    code, out = add(db, table)
    assert code == 0 and f"{table}: columns ignored: Zeit, Ort" in out
    assert f"{table}: decimal commas read as decimal points" in out
    store = InspectionStore(db)
    (found,) = store.find_readings()
    store.close()
    assert found.reading.value == pytest.approx(9.25) and found.reading.spot == "1,5"


def test_ignored_units_are_noted(tmp_path: Path) -> None:
    table = write(
        tmp_path / "g.csv", "spot,thickness_mm,Unit", "1,6.1,mm", "2,6.2,Zoll", "3,6.3,CDU-2",
        "4,6.4,Zoll", "5,6.5,",
    )  # fmt: skip
    rows, notes = load_readings(table, START)
    assert [row.reading.value for row in rows] == [6.1, 6.2, 6.3, 6.4, 6.5]
    assert notes == ("texts ignored in the column Unit: Zoll, CDU-2",)
    table = write(tmp_path / "g.csv", "spot,thickness_mm,Unit", "1,6.1,Millimetres", "2,6.2,MM")
    assert load_readings(table, START).notes == ()


@pytest.mark.parametrize(
    ("unit", "seconds"),
    [
        ("ms", 2.5), ("msec", 2.5), ("milliseconds", 2.5), ("s", 2500.0), ("sec", 2500.0),
        ("Seconds", 2500.0), ("minute", 150e3), ("Minutes", 150e3),
    ],
)  # fmt: skip
def test_times_of_a_named_unit_count_from_the_start(
    tmp_path: Path, unit: str, seconds: float
) -> None:
    lines = "0,1,9", "2500,1,9"
    table = write(tmp_path / "g.csv", f"time [{unit}],spot,thickness_mm", *lines)
    rows, _ = load_readings(table, START)
    assert (rows[1].time - START).total_seconds() == pytest.approx(seconds)
    table = write(tmp_path / "g.csv", f"Clock_{unit},spot,thickness_mm", *lines)
    assert load_readings(table, START, f"t=Clock_{unit}").rows[1].time == rows[1].time


@pytest.mark.parametrize(
    ("header", "columns"),
    [("Time", "t=Time[s]"), ("Clock (local)", "t=Clock[s]"), ("t_s", None)],
)
def test_numbers_are_times_as_the_refusal_of_a_time_advises(
    tmp_path: Path, header: str, columns: str | None
) -> None:
    table = write(tmp_path / "g.csv", f"{header},spot,thickness_mm", "20.5,1,9")
    ((row,), _) = load_readings(table, START, columns)
    assert (row.time - START).total_seconds() == pytest.approx(20.5)
    if columns is not None:
        with pytest.raises(InputError, match=re.escape(f"--columns {columns} for times since")):
            load_readings(table, START, columns.replace("[s]", "[utc]"))


def test_exports_of_a_spot_hold_the_same_readings(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    db, targets = tmp_path / "h.db", [tmp_path / "o.csv", tmp_path / "o.parquet"]
    table = write(tmp_path / "g.csv", "spot,thickness_mm,u95_mm", "1,9.0,0.1", "2,8.0,0.1")
    assert add(db, table)[0] == 0
    code, out = call(db, "--readings", "--spot", 1, "--csv", targets[0], "--parquet", targets[1])
    assert code == 0, out
    for target in targets:
        assert [row.reading.spot for row in load_readings(target, START).rows] == ["1"]


def test_readings_of_some_flights_are_in_chronological_order(tmp_path: Path) -> None:
    store = RecordStore(tmp_path / "h.db", create=True)
    flights = []
    for k in range(3):
        flight, _ = store.add_flight(structure="tank", mission="m", robot="r", seed=1, run="")
        flights.append(flight)
        for day in (1, 3):
            t = START + timedelta(days=day, seconds=-k)
            store.add_reading(flight, t, Reading("thickness", 9.0, "mm", 0.1, 0, 0, 0, spot="A"))
    both = find_readings(store, None, None, flights[:2])
    every = store.find_readings()
    assert both == [r for r in every if r.flight in flights[:2]] and len(both) == 4
    assert find_readings(store, None, None, []) == every and len(every) == 6
    assert find_readings(store, None, None, [], spot="B") == []
    store.close()


def test_a_column_is_given_once() -> None:
    with pytest.raises(InputError, match="value is given twice"):
        load_readings(Path("g.csv"), START, "value=A,value=B")
    with pytest.raises(InputError, match="is no time"):
        parse_stamp("9999-12-31T23:00-14:00", "x")


def test_an_import_keeps_origin_quantity_and_unit(tmp_path: Path) -> None:
    first, second, export = tmp_path / "a.db", tmp_path / "b.db", tmp_path / "a.csv"
    store = InspectionStore(first, create=True)
    part = store.add_component("tank", "pipe")
    for simulated in (True, False):
        flight, t = store.add_flight(
            structure="tank", mission="m", robot="r", seed=1, run="", simulated=simulated,
            started=START,
        )  # fmt: skip
        wall = Reading("thickness", 9.123456789, "mm", 0.1, 0, 0, 0, spot=f"A{simulated}")
        force = Reading("force", -5.0, "N", 0.5, 0, 0, 0, spot="A")
        store.add_readings(flight, [(t, wall), (t, force)], component=part)
    stored = store.find_readings()
    store.close()
    assert call(first, "--readings", "--csv", export)[0] == 0
    assert add(second, export)[0] == 0
    store = InspectionStore(second)
    copies = store.find_readings()
    store.close()
    assert len(copies) == 4 and sum(c.simulated for c in copies) == 2
    for one, copy in zip(stored, copies, strict=True):
        assert copy.simulated == one.simulated and copy.reading[:10] == one.reading[:10]
    # and the database does not take its own readings twice
    code, out = add(first, export)
    assert code == 2 and "4 of 4 rows are stored already" in out


def test_codes_of_a_lost_signal_are_refused_readings(tmp_path: Path) -> None:
    db = tmp_path / "h.db"
    table = write(
        tmp_path / "g.csv", "spot,thickness_mm,u95_mm,accepted,reason", "1,0.00,0.1,1,",
        "2,-999,0.1,1,ok", "3,9999,0.1,1,", "4,8.2,0.1,1,", "5,0,0.1,0,no echo",
    )  # fmt: skip
    code, out = add(db, table)
    assert code == 0 and "5 readings" in out and "1 accepted" in out
    store = InspectionStore(db)
    reasons = [r.reading.reason for r in store.find_readings()]
    store.close()
    assert [("is no thickness" in r, r[:7]) for r in reasons] == [
        (True, "0 mm is"), (True, "-999 mm"), (True, "9999 mm"), (False, ""), (False, "no echo"),
    ]  # fmt: skip
    assert [p["actual_mm"] for p in show_history(db)] == [pytest.approx(8.2)]


def test_a_table_is_imported_once(tmp_path: Path) -> None:
    db = tmp_path / "h.db"
    table = write(tmp_path / "g.csv", "spot,thickness_mm,u95_mm", "1,9.0,0.1", "2,8.0,0.1")
    assert add(db, table)[0] == 0
    code, out = add(db, table)
    assert code == 2 and "2 of 2 rows are stored already" in out and "row 2" in out
    more = write(tmp_path / "m.csv", "spot,thickness_mm,u95_mm", "3,7.0,0.1", "2,8.0,0.1")
    code, out = add(db, more)
    assert code == 2 and "1 of 2 rows" in out and "row 3" in out
    assert len(list_flights(db)) == 1 and len(show_history(db)) == 2
    # another time, another place or another component are other readings
    assert add(db, table, measured="2026-03-02")[0] == 0
    places = write(tmp_path / "p.csv", "x_m,y_m,z_m,thickness_mm,u95_mm", "0,0,0,9,0.1")
    assert add(db, places)[0] == 0
    places.write_text("x_m,y_m,z_m,thickness_mm,u95_mm\n1,0,0,9,0.1\n")
    assert add(db, places)[0] == 0


def test_a_table_is_imported_once_also_after_its_flight_is_registered(tmp_path: Path) -> None:
    """A mark 10 mm off moves what is listed; neither the table nor its export is new."""
    db, export = tmp_path / "h.db", tmp_path / "export.csv"
    table = write(tmp_path / "g.csv", "x_m,y_m,z_m,thickness_mm", "1,0,0,9.0", "2,0,0,8.0")
    assert add(db, table)[0] == 0
    (flight,) = list_flights(db)
    for x, owner in ((0.0, ("--structure", "tank")), (-0.01, ("--flight", flight.id))):
        marks = write(tmp_path / "d.csv", "name,x_m,y_m,z_m,u95_m", f"A,{x},0,0,0.001")
        assert call(db, "--datums", marks, *owner)[0] == 0
    assert call(db, "--readings", "--csv", export)[0] == 0
    assert load_readings(export, START).rows[0].reading.x_m == pytest.approx(1.01, abs=1e-4)
    for again in (table, export):
        code, out = add(db, again)
        assert code == 2 and "2 of 2 rows are stored already" in out and flight.id in out
    assert len(list_flights(db)) == 1


def test_a_table_appended_to_itself_is_refused_and_a_repeated_row_is_noted(tmp_path: Path) -> None:
    """Equal readings of one second are readings; a copy of all rows is none."""
    db, head = tmp_path / "h.db", "t_s,spot,thickness_mm,u95_mm"
    two = ("0,1,9.0,0.1", "5,1,8.0,0.1")
    code, out = add(db, write(tmp_path / "g.csv", head, *two, *two, *two))
    assert code == 2, out
    assert "rows 4 to 7 are copies of the 2 rows before" in out
    assert len(out.strip().splitlines()) == 1 and list_flights(db) == []
    table = write(tmp_path / "g.csv", head, *two, "0,1, 9.0,0.1")
    found = load_readings(table, START)
    assert len(found.rows) == 3
    assert found.notes[0].startswith("1 of 3 rows repeat another in every column and count as")
    write(table, "spot,thickness_mm", "1,9.0", "1,9.0", "1,9.0")
    assert len(load_readings(table, START).rows) == 3
    # another time or value, or a number of the reading, is another reading
    write(table, head, "0,1,9.0,0.1", "5,1,9.0,0.1", "0,1,8.0,0.1")
    assert len(load_readings(table, START).rows) == 3
    write(table, "spot,thickness_mm,No", "1,9.0,1", "1,9.0,2")
    assert len(load_readings(table, START).rows) == 2


@pytest.mark.parametrize(
    ("row", "options", "says"),
    [
        ("2026-03-01,1,9,-0.1", (), "u95_mm is '-0.1'"),
        ("1772366400000,1,9,0.1", (), "at most 30 days"),
        ("2026-03-01,1,9,0.1", ("--required", "-1"), "required_mm -1"),
        ("2026-03-01,1,9,0.1", ("--registration", "nan"), "--registration nan"),
        ("2026-03-01,1,9,0.1", ("--measured", "0001-01-01"), "a year from 1900"),
    ],
)
def test_a_refused_table_stores_nothing(
    tmp_path: Path, row: str, options: tuple[str, ...], says: str
) -> None:
    db = tmp_path / "h.db"
    table = write(tmp_path / "g.csv", "t,spot,thickness_mm,u95_mm", "2025-03-01,1,9,0.1", row)
    code, out = add(db, table, *options)
    assert code == 2 and says in out and len(out.strip().splitlines()) == 1, out
    store = InspectionStore(db)
    for name in ("assets", "components", "flights", "readings"):
        assert store.read(f"SELECT * FROM {name}") == []
    store.close()


def test_a_block_of_entries_is_stored_whole_or_not(tmp_path: Path) -> None:
    store = InspectionStore(tmp_path / "h.db", create=True)
    with pytest.raises(InputError, match="refused without a reason"), store.transaction():
        part = store.add_component("tank", "pipe")
        flight, t = store.add_flight(structure="tank", mission="m", robot="r", seed=1, run="")
        good = Reading("thickness", 9.0, "mm", 0.1, 0, 0, 0)
        store.add_reading(flight, t, good, component=part)
        store.add_reading(flight, t, good._replace(accepted=False), component=part)
    assert store.list_flights() == [] and store.list_components() == []
    with pytest.raises(InputError, match="FOREIGN KEY"), store.transaction():
        store.add_component("tank", "pipe")
        store.add_reading("no flight", t, good)
    assert store.list_components() == []
    with store.transaction():
        store.add_component("tank", "pipe")
    assert len(store.list_components()) == 1
    store.add_component("tank", "shell")  # afterwards each entry is a transaction again
    store.close()
    store = InspectionStore(tmp_path / "h.db")
    assert len(store.list_components()) == 2
    store.close()


def test_a_pipe_is_no_table(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "ff")
    with pytest.raises(InputError, match="device or pipe"):
        load_datums(tmp_path / "ff")
    with pytest.raises(InputError, match="device or pipe"):
        load_readings(tmp_path / "ff", START)


def test_a_wrong_target_is_refused_before_anything_is_stored(tmp_path: Path) -> None:
    db = tmp_path / "h.db"
    table = write(tmp_path / "g.csv", "spot,thickness_mm,u95_mm", "1,9.0,0.1")
    for option in ("--parquet", "--local", "--dicom", "--report", "--csv"):
        code, out = add(db, table, option, tmp_path / "x.docx")
        assert code == 2 and "x.docx" in out, out
    assert not db.exists()
    assert add(db, table)[0] == 0


@pytest.mark.parametrize("option", ["--report", "--dicom"])
@pytest.mark.parametrize(
    ("table", "shown"),
    [
        (
            "t,spot,thickness_mm,u95_mm\n2015-03-01,1,9,0.1\n2020-03-01,1,8,0.1\n",
            "2 flights (2015-03-01, 2020-03-01)",
        ),
        (
            "origin,spot,thickness_mm,u95_mm\nmeasured,1,9,0.1\nSIMULATED,1,8,0.1\n",
            "2 flights (2026-03-01, 2026-03-01 SIMULATED)",
        ),
    ],
)
def test_an_export_of_one_flight_refuses_several_before_they_are_stored(
    tmp_path: Path, option: str, table: str, shown: str
) -> None:
    db, source = tmp_path / "h.db", write(tmp_path / "g.csv", table)
    target = tmp_path / {"--report": "r.html", "--dicom": "r.dcm"}[option]
    code, out = add(db, source, option, target)
    assert code == 2 and shown in out and "give one flight as --flight" in out, out
    assert list_flights(db) == []
    # the message states what to do
    assert add(db, source)[0] == 0
    code, out = call(db, "--flight", list_flights(db)[0].id, "--report", tmp_path / "r.html")
    assert code == 0 and (tmp_path / "r.html").exists(), out


def test_an_option_without_effect_is_refused(tmp_path: Path) -> None:
    db = tmp_path / "h.db"
    table = write(tmp_path / "g.csv", "spot,thickness_mm,u95_mm", "1,9.0,0.1", "2,8.0,0.1")
    assert add(db, table)[0] == 0
    assert [p["name"] for p in show_history(db, "--spot", "2")] == ["2"]
    for args, says in (
        (("--thickness", "--csv", tmp_path / "o.csv"), "--csv: valid for --readings"),
        (("--indications", "--csv", tmp_path / "o.csv"), "--csv: valid for --readings"),
        (("--indications", "--spot", "1"), "--spot: valid for"),
        (("--component", "pipe"), "not for contact measurements"),
        (("--flight", "x"), "--flight: valid for --readings, --indications, --report, --datums; "),
        (("--readings", "--origin", "1,2"), "--origin: valid with --geojson"),
        (("--readings", "--radius", "1"), "--radius: valid with --at or --thickness"),
        (("--radius", "1"), "--radius: valid with --at or --thickness"),
        (
            ("--readings", "--spot", "1", "--local", tmp_path / "o.json"),
            "--spot: not valid with --local, whose content is selected by --structure, "
            "--component, --flight",
        ),
        (
            ("--report", tmp_path / "o.html", "--component", "pipe"),
            "--component: not valid with --report, whose content is selected by --flight",
        ),
        (("--thickness", "--radius", "nan"), "--radius nan"),
        (("--thickness", "--at", "0,0"), "--at: valid for contact measurements"),
        (("--readings", "--geojson", tmp_path / "o.geojson"), "--geojson: valid for contact"),
        (("--thickness", "--flight", "x"), "merges the flights"),
        (("--import", table, "--flight", "x"), "not for --import"),
        (("--import", tmp_path / "gone"), "gone: no such file or run directory"),
        (("--import", table, "--spot", "1"), "--spot: valid for"),
        (("--report", tmp_path / "o.html"), "--report requires --flight"),
        (("--dicom", tmp_path / "o.dcm"), "--dicom requires --flight and --component"),
        (("--thickness", "--report", tmp_path / "o.html"), "--report: valid for"),
        (("--thickness", "--csv", tmp_path / "o.csv"), "not for --thickness\n"),
    ):
        code, out = call(db, *args)
        assert code == 2 and says in out and len(out.strip().splitlines()) == 1, out
    assert not (tmp_path / "o.csv").exists()
