"""The database of measurements: migration, writers at once, kills; rates by closed forms."""

from __future__ import annotations

import json
import math
import os
import signal
import sqlite3
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from skywright.cli import main
from skywright.errors import InputError
from skywright.inspection.history.corrosion import (
    YEAR_S,
    Inspected,
    build_history,
    compute_rate,
    group_places,
)
from skywright.inspection.history.entries import (
    Calibrated,
    Indication,
    Reading,
    StoredReading,
)
from skywright.inspection.history.schema import APPLICATION_ID, STEPS, VERSION, VERSION_1
from skywright.inspection.history.store import InspectionStore
from skywright.run.records import RecordStore

T0 = datetime(2020, 1, 1, tzinfo=UTC)


def after(years: float) -> datetime:
    return T0 + timedelta(seconds=years * YEAR_S)


def build_reading(value: float, x: float = 0.0, u95: float = 0.2, spot: str = "") -> Reading:
    return Reading("thickness", value, "mm", u95, x, 0.0, 1.0, 0.004, spot=spot)


def add_flight(store: InspectionStore, years: float, std: float | None = 0.002) -> str:
    return store.add_flight(
        structure="tank", mission="thickness-survey", robot="othex", seed=1, run="",
        started=after(years), registration_std_m=std,
    )[0]  # fmt: skip


def write_version_1(path: Path, rows: int = 5) -> list[tuple[object, ...]]:
    """A file as the first version wrote it."""
    db = sqlite3.connect(path)
    db.execute("PRAGMA journal_mode = WAL")
    for statement in VERSION_1:
        db.execute(statement)
    db.execute(f"PRAGMA application_id = {APPLICATION_ID}")
    db.execute("PRAGMA user_version = 1")
    db.execute(
        "INSERT INTO flights VALUES ('f1','2025-01-01T00:00:00Z','bridge','m','r',3,'runs/x')"
    )
    made = [
        (k + 1, "f1", f"2025-01-01T00:00:{k:02d}Z", f"s{k}", "docked", 0.1 * k, -0.2, 0.001, 2.1,
         -0.2, 3.0, 3.0, 2.0, 2.0 + k, 0.02, None if k == 1 else 0.0004, 0.0003)
        for k in range(rows)
    ]  # fmt: skip
    db.executemany(f"INSERT INTO measurements VALUES ({','.join('?' * 17)})", made)
    db.commit()
    db.close()
    return made


def read_back(path: Path) -> list[tuple[object, ...]]:
    store = RecordStore(path)
    found = store.find()
    store.close()
    return [
        (r.id, r.flight, r.time_utc, r.spot, r.how, r.x_m, r.y_m, r.off_m, r.east_m, r.north_m,
         r.up_m, r.duration_s, r.force_des_n, r.force_n, r.force_std_n, r.pose_std_m, r.wander_m)
        for r in found
    ]  # fmt: skip


def test_a_file_of_the_first_version_is_migrated_whole(tmp_path: Path) -> None:
    path = tmp_path / "r.db"
    made = write_version_1(path)
    assert read_back(path) == made
    store = RecordStore(path)
    assert store.read("PRAGMA user_version") == [(VERSION,)]
    flight = store.list_flights()[0]
    assert (flight.asset, flight.seed, flight.simulated) == ("bridge", 3, True)
    force = store.find_readings(quantity="force")
    assert [r.reading.value for r in force] == [2.0, 3.0, 4.0, 5.0, 6.0]
    assert force[0].reading.place_u95_m == 0.0008 and force[1].reading.place_u95_m is None
    store.close()
    assert read_back(path) == made  # opened once more: nothing changes


def test_a_file_of_the_second_version_gains_coverages(tmp_path: Path) -> None:
    path = tmp_path / "r.db"
    made = write_version_1(path)
    db = sqlite3.connect(path)
    for statement in STEPS[1]:
        db.execute(statement)
    db.execute("PRAGMA user_version = 2")
    db.commit()
    db.close()
    assert read_back(path) == made
    store = InspectionStore(path)
    assert store.read("PRAGMA user_version") == [(VERSION,)]
    assert store.list_coverages(store.list_flights()[0].id) == []
    store.close()


KILLED = """
import os, signal, sys
from skywright.inspection.history import database
from skywright.run.records import RecordStore
from pathlib import Path
class Deadly(tuple):
    def __iter__(self):
        for k, statement in enumerate(tuple.__iter__(self)):
            if k == int(sys.argv[2]):
                os.kill(os.getpid(), signal.SIGKILL)
            yield statement
database.STEPS = (database.STEPS[0], Deadly(database.STEPS[1]))
RecordStore(Path(sys.argv[1]))
"""


@pytest.mark.parametrize("at", [3, 15, 17])
def test_a_migration_that_is_killed_leaves_the_old_file(tmp_path: Path, at: int) -> None:
    path = tmp_path / "r.db"
    made = write_version_1(path)
    done = subprocess.run([sys.executable, "-c", KILLED, str(path), str(at)], check=False)
    assert done.returncode == -signal.SIGKILL
    db = sqlite3.connect(path)
    assert db.execute("PRAGMA user_version").fetchone()[0] == 1
    assert db.execute("SELECT count(*) FROM measurements").fetchone()[0] == 5
    db.close()
    assert read_back(path) == made


def test_two_programs_migrate_at_once(tmp_path: Path) -> None:
    path = tmp_path / "r.db"
    made = write_version_1(path, 40)
    with ThreadPoolExecutor(6) as pool:
        assert all(rows == made for rows in pool.map(lambda _: read_back(path), range(6)))


def test_a_newer_file_is_refused_in_one_line_and_stays(tmp_path: Path) -> None:
    path = tmp_path / "r.db"
    RecordStore(path, create=True).close()
    db = sqlite3.connect(path)
    db.execute(f"PRAGMA user_version = {VERSION + 1}")
    db.close()
    before = path.read_bytes()
    done = CliRunner().invoke(main, ["records", str(path)])
    assert done.exit_code == 2 and len(done.output.strip().splitlines()) == 1
    assert f"records of version {VERSION + 1}" in done.output and "install a newer" in done.output
    with pytest.raises(InputError, match="version"):
        RecordStore(path, create=True)
    assert path.read_bytes() == before


WRITER = """
import os, signal, sys
sys.path.insert(0, {tests!r})
from pathlib import Path
from test_history import add_flight, after, build_reading
from skywright.inspection.history.entries import Indication
from skywright.inspection.history.store import InspectionStore
store = InspectionStore(Path(sys.argv[1]), create=True)
flight = add_flight(store, 0.0)
pipe = store.add_component("tank", "pipe", nominal_mm=10.0)
for k in range(int(sys.argv[2])):
    store.add_reading(flight, after(0.0), build_reading(float(k)), component=pipe)
    store.add_indication(flight, after(0.0), Indication("crack", 0.0, 0.0, float(k)))
    print(k, flush=True)
if len(sys.argv) > 3:
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_writers_at_once_and_a_kill_lose_nothing(tmp_path: Path) -> None:
    path = tmp_path / "r.db"
    code = WRITER.format(tests=str(Path(__file__).parent))
    runs = [
        subprocess.Popen(
            [sys.executable, "-c", code, str(path), "30", *more], stdout=subprocess.PIPE, text=True
        )
        for more in ((), ("die",))
    ]
    told = [run.communicate(timeout=300)[0] for run in runs]
    assert [run.returncode for run in runs] == [0, -signal.SIGKILL]
    store = InspectionStore(path)
    readings, found = store.find_readings(component="pipe"), store.find_indications()
    assert len(readings) == len(found) == sum(len(t.split()) for t in told) == 60
    assert len(store.list_components()) == 1 and len({r.flight for r in readings}) == 2
    store.close()


def test_what_is_stored_is_found_again(tmp_path: Path) -> None:
    store = InspectionStore(tmp_path / "r.db", create=True)
    store.add_asset("tank", "tank 7", "centre of the lower ring, x east")
    pipe = store.add_component("tank", "pipe", material="carbon steel", nominal_mm=9.5)
    assert store.add_component("tank", "pipe", required_mm=6.0) == pipe
    assert store.list_components("tank")[0][3:] == ("carbon steel", 9.5, 6.0)
    text = "[procedure]\ngain_db = 40\n"
    procedure = store.add_procedure("UT-1", "B", text)
    assert store.add_procedure("UT-1", "B", text) == procedure
    with pytest.raises(InputError, match="another revision"):
        store.add_procedure("UT-1", "B", text + " ")
    flight = add_flight(store, 1.0)
    done = Calibrated(
        "UT", "gauge", "42", "before", "step wedge 5/10 mm", {"velocity_mps": 5920.0}, True
    )
    calibration = store.add_calibration(flight, after(1.0), done)
    store.add_calibration(flight, after(1.0), done._replace(stage="after", passed=False, note="!"))
    assert [c.calibrated.stage for c in store.list_calibrations(flight)] == ["before", "after"]
    assert store.list_calibrations(flight)[0].calibrated == done
    assert len(store.read("SELECT * FROM instruments")) == 1
    good, bad = build_reading(9.1), build_reading(3.0)._replace(accepted=False, reason="no film")
    for r in (good, bad):
        store.add_reading(flight, after(1.0), r, component=pipe, calibration=calibration)
    assert [r.reading for r in store.find_readings(asset="tank")] == [good, bad]
    crack = Indication("crack", 1.0, 2.0, 3.0, 0.005, 6.0, 1.1, 0.4, 55.0, "% FSH", "s.nde#1")
    row = store.add_indication(flight, after(1.0), crack, component=pipe)
    assert store.find_indications()[0].disposition == "open"
    store.decide(row, "monitor", "A. Inspector")
    store.decide(row, "repair", "B. Inspector", "grown")
    last = store.find_indications(flight=flight)[0]
    assert last.indication == crack and last.disposition == "repair" and "grown" in last.decided
    assert len(store.read("SELECT * FROM dispositions")) == 2  # the first stays
    store.close()


@pytest.mark.parametrize(
    ("reading", "says"),
    [
        (build_reading(math.nan), "value is nan"),
        (build_reading(9.0, math.inf), "x_m is inf"),
        (build_reading(9.0, u95=-0.1), "u95 is -0.1"),
        (build_reading(9.0)._replace(value=None), "accepted without a value"),
        (build_reading(9.0)._replace(accepted=False), "refused without a reason"),
    ],
)
def test_entries_that_say_nothing_are_refused(tmp_path: Path, reading: Reading, says: str) -> None:
    store = InspectionStore(tmp_path / "r.db", create=True)
    flight = add_flight(store, 0.0)
    with pytest.raises(InputError, match=says):
        store.add_reading(flight, T0, reading)
    with pytest.raises(InputError, match="valid: open, accept"):
        store.decide(1, "maybe", "x")
    with pytest.raises(InputError, match="no indication 7"):
        store.decide(7, "accept", "x")
    with pytest.raises(InputError, match="records cannot be written: FOREIGN KEY"):
        store.add_reading("no flight", T0, build_reading(9.0))
    assert store.find_readings() == []
    store.close()


def build_inspected(years: float, mm: float, std: float) -> Inspected:
    return Inspected((f"f{years}",), after(years), mm, std, 1, 0.0, 0.0, 0.0, False)


def test_rates_and_lives_have_the_deviations_of_a_monte_carlo() -> None:
    """0.1 mm over 4 years gives 0.035 mm/a; the life's deviation against 200,000 draws."""
    rate = compute_rate(build_inspected(0, 10.0, 0.1), build_inspected(4, 8.0, 0.1), 6.0)
    assert rate.mm_per_year == pytest.approx(0.5)
    assert rate.std_mm_per_year == pytest.approx(math.sqrt(2) * 0.1 / 4, rel=1e-9)
    assert rate.std_mm_per_year == pytest.approx(0.035, abs=5e-4)
    assert rate.life_years == pytest.approx(4.0) and rate.significant
    r = np.random.default_rng(1)
    a, b = 10.0 + 0.02 * r.normal(size=200_000), 8.0 + 0.03 * r.normal(size=200_000)
    rate = compute_rate(build_inspected(0, 10.0, 0.02), build_inspected(4, 8.0, 0.03), 6.0)
    assert rate.life_std_years == pytest.approx(np.std((b - 6.0) / ((a - b) / 4)), rel=0.02)
    slower = compute_rate(build_inspected(0, 10.0, 0.02), build_inspected(10, 8.0, 0.03), 6.0)
    assert slower.life_std_years == pytest.approx(np.std((b - 6.0) / ((a - b) / 10)), rel=0.02)
    # "at least" is the life at the upper bound of the rate: below it in 5 of 100 draws or fewer
    lives = (8.0 - 6.0) / np.maximum((a - b) / 4, 1e-9)
    assert rate.life_low_years is not None
    assert np.mean(lives < rate.life_low_years) == pytest.approx(0.05, abs=0.005)


@given(
    shift=st.floats(-3, 3), loss=st.floats(-0.5, 2.0), years=st.floats(0.5, 20.0),
    std=st.floats(0.01, 0.3),
)  # fmt: skip
def test_a_history_does_not_depend_on_where_thickness_counts_from(
    shift: float, loss: float, years: float, std: float
) -> None:
    def rate(d: float) -> object:
        first, last = (
            build_inspected(0, 10.0 + d, std),
            build_inspected(years, 10.0 - loss + d, std),
        )
        return compute_rate(first, last, 5.0 + d)

    one, other = rate(0.0), rate(shift)
    for name in ("loss_mm", "mm_per_year", "life_years", "life_std_years", "life_low_years"):
        a, b = getattr(one, name), getattr(other, name)
        assert (a is None) == (b is None) or abs(loss) < 1e-9
        assert a is None or b is None or b == pytest.approx(a, rel=1e-5, abs=1e-9)


def store_reading(flight: str, x: float, mm: float, years: float, spot: str = "") -> StoredReading:
    reading = build_reading(mm, x, spot=spot)
    t = after(years).isoformat()
    return StoredReading(0, flight, "tank", "pipe", None, t, True, 0.002, reading)


def test_flights_merge_at_a_place_in_the_frame_of_the_asset() -> None:
    r = np.random.default_rng(2)
    readings = [
        store_reading(f"f{k}", x + 0.004 * r.normal(), 10.0 - 0.1 * k, float(k))
        for k in range(4)
        for x in (0.0, 0.2, 0.4)
    ]
    groups = group_places(readings, 0.05)
    assert [len(members) for _, members in groups] == [4, 4, 4]
    places = build_history(readings, {("tank", "pipe"): 6.0})
    for p in places:
        assert p.long_term is not None and p.short_term is not None
        assert p.long_term.mm_per_year == pytest.approx(0.1) and len(p.inspections) == 4
        assert p.place_std_m == pytest.approx(math.hypot(0.002, 0.002))
        assert p.life_years == pytest.approx((9.7 - 6.0) / 0.1)
        assert p.interval_years == pytest.approx(0.5 * p.life_years)
    # names bind where places do not
    named = [store_reading(f"f{k}", 0.3 * k, 10.0, float(k), "TML-1") for k in range(3)]
    assert [len(m) for _, m in group_places(named, 0.05)] == [3]
    mixed = [store_reading("a", 0.0, 10.0, 0.0, "TML-1"), store_reading("b", 0.0, 10.0, 1.0)]
    assert len(group_places(mixed, 0.05)) == 2


def test_the_rate_that_gives_the_shorter_life_governs() -> None:
    readings = [
        store_reading("a", 0.0, 12.0, 0.0), store_reading("b", 0.0, 11.5, 8.0),
        store_reading("c", 0.0, 10.5, 10.0),
    ]  # fmt: skip
    (place,) = build_history(readings, {("tank", "pipe"): 8.0})
    assert place.long_term is not None and place.short_term is not None
    assert place.long_term.mm_per_year == pytest.approx(0.15, rel=1e-3)
    assert place.short_term.mm_per_year == pytest.approx(0.5, rel=1e-3)
    assert place.life_years == pytest.approx(5.0, rel=1e-3)


def test_notes_tell_what_a_number_hides() -> None:
    grown = [store_reading("a", 0.0, 8.0, 0.0), store_reading("b", 0.0, 9.0, 1.0)]
    (place,) = build_history(grown, {("tank", "pipe"): 8.5})
    assert place.life_years is None and place.interval_years is None
    assert any("thicker than before" in note for note in place.notes)
    thin = [store_reading("a", 0.0, 8.0, 0.0), store_reading("b", 0.0, 5.0, 1.0)]
    (place,) = build_history(thin, {("tank", "pipe"): 6.0})
    assert place.life_years == 0.0 and "below the required thickness" in place.notes
    near = [store_reading("a", 0.0, 8.0, 0.0), store_reading("b", 0.0, 6.1, 1.0)]
    assert "within the deviation" in " ".join(build_history(near, {("tank", "pipe"): 6.0})[0].notes)
    (place,) = build_history([grown[0]], {})
    assert place.long_term is None and place.life_years is None
    refused = grown[0]._replace(reading=build_reading(1.0)._replace(accepted=False, reason="air"))
    assert build_history([refused], {}) == []
    bare = grown[0]._replace(reading=build_reading(8.0)._replace(u95=None))
    (place,) = build_history([bare, grown[1]], {})  # costs no other reading its history
    assert [one.thickness_mm for one in place.inspections] == [9.0]
    assert place.notes[0] == "omits 1 reading of flight a without u95"
    with pytest.raises(InputError, match="have the same time"):
        compute_rate(build_inspected(1, 9, 0.1), build_inspected(1, 8, 0.1), None)


def test_readings_of_a_flight_share_their_calibration() -> None:
    """Ten readings make the mean no surer than u95 says, and their scatter counts if larger."""
    many = [store_reading("a", 0.0, 8.0 + 0.01 * k, 0.0) for k in range(10)]
    (place,) = build_history(many, {})
    assert place.inspections[0].std_mm == pytest.approx(0.1)
    wide = [store_reading("a", 0.0, 8.0 + 0.2 * k, 0.0) for k in range(10)]
    (place,) = build_history(wide, {})
    assert place.inspections[0].std_mm == pytest.approx(np.std(0.2 * np.arange(10), ddof=1))


def test_the_command_shows_history_and_decides(tmp_path: Path) -> None:
    path = tmp_path / "r.db"
    store = InspectionStore(path, create=True)
    pipe = store.add_component("tank", "pipe", nominal_mm=10.0, required_mm=6.0)
    for years, mm in ((0.0, 10.0), (4.0, 8.0)):
        flight = add_flight(store, years)
        store.add_reading(flight, after(years), build_reading(mm), component=pipe)
    store.add_indication(flight, after(4.0), Indication("crack", 0.0, 0.0, 0.0, depth_mm=1.0))
    store.close()

    def call(*args: str) -> tuple[int, str]:
        done = CliRunner().invoke(main, ["records", str(path), *args])
        return done.exit_code, done.output

    code, out = call("--thickness")
    assert code == 0 and "0.500 ± 0.035" in out and "SIMULATED" in out and "8.00 ± 0.10" in out
    code, out = call("--thickness", "--component", "pipe", "--json")
    told = json.loads(out)["locations"][0]
    assert told["life_years"] == pytest.approx(4.0) and told["long_term"]["significant"]
    code, out = call("--decide", "1=monitor:look again", "--who", "A. Inspector")
    assert code == 0 and "monitor: A. Inspector" in out and "look again" in out
    code, out = call("--indications", "--json")
    assert json.loads(out)["indications"][0]["disposition"] == "monitor"
    for args, says in (
        (("--decide", "1=monitor"), "requires --who"),
        (("--decide", "monitor", "--who", "x"), "valid: ID=WORD"),
        (("--decide", "9=accept", "--who", "x"), "no indication 9"),
        (("--decide", "1=perhaps", "--who", "x"), "valid: open"),
        (("--who", "x"), "valid with --decide"),
        (("--component", "wall", "--thickness"), "there are: pipe"),
        (("--flight", "zz", "--indications"), "no flight 'zz'"),
        (("--thickness", "--indications"), "choose one"),
    ):
        code, out = call(*args)
        assert code == 2 and says in out and len(out.strip().splitlines()) == 1, out


def test_a_read_only_old_file_is_told(tmp_path: Path) -> None:
    if os.geteuid() == 0:  # root writes everything: SQLite's own read-only flag stands in
        path = tmp_path / "r.db"
        write_version_1(path)
        store = InspectionStore.__new__(InspectionStore)
        store.path = path
        store._db = sqlite3.connect(f"file:{path}?mode=ro", uri=True, isolation_level=None)
        with pytest.raises(InputError, match="older version requires"):
            store._try(store._migrate, "opened")
        store._db.close()
        return
    path = tmp_path / "r.db"
    write_version_1(path)
    path.chmod(0o400)
    tmp_path.chmod(0o500)
    with pytest.raises(InputError):
        RecordStore(path)
    tmp_path.chmod(0o700)
