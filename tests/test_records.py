"""Inspection records: nothing finished is lost, two may write, bad files are told."""

from __future__ import annotations

import csv
import json
import math
import os
import signal
import sqlite3
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from skywright.cli import main
from skywright.errors import InputError
from skywright.inspection.history import database
from skywright.inspection.history.schema import VERSION
from skywright.run.records import Measurement, RecordStore
from skywright.run.records_export import (
    Origin,
    build_geojson,
    locate_on_earth,
    parse_origin,
    write_csv,
)


def build_measurement(x: float = 0.1, force: float = 2.0, spot: str = "a") -> Measurement:
    return Measurement(
        spot, "docked", x, -0.2, 0.001, (2.1, -0.2, 3.0), 10.0, 13.0, force, force + 0.01, 0.02,
        0.0004, 0.0003,
    )  # fmt: skip


def start(path: Path, structure: str = "bridge") -> tuple[RecordStore, str, object]:
    store = RecordStore(path, create=True)
    flight, now = store.add_flight(
        structure=structure, mission="bridge-contact", robot="f550-bridge", seed=1, run="runs/x"
    )
    return store, flight, now


def test_a_point_is_found_again_over_flights(tmp_path: Path) -> None:
    path = tmp_path / "r.db"
    for k in range(3):
        store, flight, now = start(path)
        store.add(flight, now, build_measurement(0.1 + 0.004 * k, 2.0 + k))
        store.add(flight, now, build_measurement(1.0, 5.0, "b"))
        store.close()
    store = RecordStore(path)
    history = store.find(at=(0.1, -0.2), radius=0.02)
    assert [r.force_des_n for r in history] == [2.0, 3.0, 4.0]
    assert len({r.flight for r in history}) == 3
    assert len(store.find()) == 6 and len(store.find(spot="b")) == 3
    assert store.find(structure="tunnel") == []
    assert history[0].time_utc.endswith("Z") and history[0].duration_s == pytest.approx(3.0)
    store.close()


def test_an_unknown_pose_quality_is_no_number(tmp_path: Path) -> None:
    store, flight, now = start(tmp_path / "r.db")
    store.add(flight, now, build_measurement()._replace(pose_std_m=math.nan))
    assert store.find()[0].pose_std_m is None
    store.close()


WRITER = """
import sys, os, signal
from pathlib import Path
sys.path.insert(0, {tests!r})
from test_records import build_measurement, start
store, flight, now = start(Path(sys.argv[1]))
for k in range(int(sys.argv[2])):
    store.add(flight, now, build_measurement(force=float(k)))
    print(k, flush=True)
if len(sys.argv) > 3:
    os.kill(os.getpid(), signal.SIGKILL)
"""


def write_in_a_process(path: Path, n: int, *more: str) -> subprocess.Popen[str]:
    code = WRITER.format(tests=str(Path(__file__).parent))
    return subprocess.Popen(
        [sys.executable, "-c", code, str(path), str(n), *more], stdout=subprocess.PIPE, text=True
    )


def test_a_killed_flight_loses_no_finished_measurement(tmp_path: Path) -> None:
    path = tmp_path / "r.db"
    process = write_in_a_process(path, 7, "die")
    told, _ = process.communicate(timeout=300)
    assert process.returncode == -signal.SIGKILL
    store = RecordStore(path)
    assert [r.force_des_n for r in store.find()] == [float(k) for k in told.split()]
    assert len(told.split()) == 7
    store.close()


def test_two_flights_write_at_once(tmp_path: Path) -> None:
    path = tmp_path / "r.db"
    both = [write_in_a_process(path, 40) for _ in range(2)]
    for process in both:
        process.communicate(timeout=300)
        assert process.returncode == 0
    store = RecordStore(path)
    found = store.find()
    assert len(found) == 80 and len({r.flight for r in found}) == 2
    store.close()


def test_many_threads_make_the_file_once(tmp_path: Path) -> None:
    """Some are switching the file's log while others do: SQLite does not wait there by itself."""
    for k in range(20):
        path = tmp_path / f"{k}.db"
        with ThreadPoolExecutor(8) as pool:
            list(pool.map(lambda _, path=path: RecordStore(path, create=True).close(), range(16)))
        assert sqlite3.connect(path).execute("PRAGMA user_version").fetchone()[0] == VERSION


def test_bad_files_are_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        RecordStore(tmp_path / "none.db")
    with pytest.raises(InputError, match="is a folder"):
        RecordStore(tmp_path)
    with pytest.raises(InputError, match="is a folder"):
        RecordStore(tmp_path, create=True)
    text = tmp_path / "text.db"
    text.write_text("time,force\n1,2\n" * 100)
    for create in (False, True):
        with pytest.raises(InputError, match="not a SQLite database"):
            RecordStore(text, create=create)
    assert text.read_text().startswith("time,force")
    other = tmp_path / "other.db"
    db = sqlite3.connect(other)
    db.execute("CREATE TABLE songs (name TEXT)")
    db.commit()
    with pytest.raises(InputError, match="without inspection records"):
        RecordStore(other, create=True)
    assert [r[0] for r in db.execute("SELECT name FROM sqlite_master")] == ["songs"]
    with pytest.raises(InputError, match="folder does not exist"):
        RecordStore(tmp_path / "nowhere" / "r.db", create=True)


def test_another_version_is_told(tmp_path: Path) -> None:
    path = tmp_path / "r.db"
    start(path)[0].close()
    db = sqlite3.connect(path)
    db.execute("PRAGMA user_version = 7")
    db.commit()
    db.close()
    with pytest.raises(InputError, match="version 7"):
        RecordStore(path)


def test_a_locked_file_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(database, "BUSY_S", 0.2)
    path = tmp_path / "r.db"
    store, flight, now = start(path)
    other = sqlite3.connect(path, isolation_level=None)
    other.execute("BEGIN EXCLUSIVE")
    began = time.monotonic()
    with pytest.raises(InputError, match="another program"):
        store.add(flight, now, build_measurement())
    assert time.monotonic() - began > 0.15
    other.execute("ROLLBACK")
    store.add(flight, now, build_measurement())
    assert len(store.find()) == 1
    store.close()


def test_a_full_disk_is_told_and_keeps_what_was_stored(tmp_path: Path) -> None:
    store, flight, now = start(tmp_path / "r.db")
    pages = store._db.execute("PRAGMA page_count").fetchone()[0]
    store._db.execute(f"PRAGMA max_page_count = {pages}")  # SQLite's own stand-in for a full disk
    stored = 0
    with pytest.raises(InputError, match="disk is full"):
        for _ in range(1000):
            store.add(flight, now, build_measurement(spot="a" * 200))
            stored += 1
    assert len(store.find()) == stored > 0
    store.close()


def test_a_damaged_file_is_told(tmp_path: Path) -> None:
    path = tmp_path / "r.db"
    store, flight, now = start(path)
    for _ in range(50):
        store.add(flight, now, build_measurement())
    store.close()
    data = bytearray(path.read_bytes())
    data[4096:] = os.urandom(len(data) - 4096)
    path.write_bytes(bytes(data))
    with pytest.raises(InputError, match=r"damaged|read"):
        RecordStore(path).find()


@given(
    east=st.floats(-100, 100), north=st.floats(-100, 100), lat=st.floats(-80, 80),
    lon=st.floats(-179, 179),
)  # fmt: skip
def test_places_on_earth_keep_their_distance(
    east: float, north: float, lat: float, lon: float
) -> None:
    """Back from degrees with the ellipsoid's own formula, in Cartesian coordinates."""
    a, f = 6378137.0, 1 / 298.257223563
    e2 = f * (2 - f)

    def cartesian(place: list[float]) -> tuple[float, float, float]:
        b, c = math.radians(place[1]), math.radians(place[0])
        n = a / math.sqrt(1 - e2 * math.sin(b) ** 2)
        return (
            (n + place[2]) * math.cos(b) * math.cos(c),
            (n + place[2]) * math.cos(b) * math.sin(c),
            (n * (1 - e2) + place[2]) * math.sin(b),
        )

    origin = Origin(lon, lat, 12.0)
    far = math.dist(
        cartesian(locate_on_earth(origin, east, north, 0.0)), cartesian([lon, lat, 12.0])
    )
    assert far == pytest.approx(math.hypot(east, north), abs=3e-3)


@pytest.mark.parametrize("text", ["", "1", "1,2,3,4", "a,b", "nan,1", "10,95", "200,0"])
def test_a_bad_origin_is_told(text: str) -> None:
    with pytest.raises(InputError, match="--origin"):
        parse_origin(text)


def test_exports_hold_every_record(tmp_path: Path) -> None:
    path = tmp_path / "r.db"
    store, flight, now = start(path)
    for k in range(3):
        store.add(flight, now, build_measurement(force=1.0 + k, spot='a "quoted", spot'))
    found = store.find()
    store.close()
    write_csv(found, tmp_path / "r.csv")
    with (tmp_path / "r.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["force_des_n"]) for row in rows] == [1.0, 2.0, 3.0]
    assert rows[0]["spot"] == 'a "quoted", spot'
    tree = build_geojson(found, Origin(-5.98, 37.41, 10.0))
    first = tree["features"][0]["geometry"]["coordinates"]
    assert tree["type"] == "FeatureCollection" and len(tree["features"]) == 3
    assert first[0] == pytest.approx(-5.98, abs=1e-4) and first[2] == pytest.approx(13.0)
    json.dumps(tree, allow_nan=False)


def test_the_command_lists_exports_and_refuses(tmp_path: Path) -> None:
    path = tmp_path / "r.db"
    store, flight, now = start(path)
    store.add(flight, now, build_measurement())
    store.close()

    def call(*args: str) -> tuple[int, str]:
        out = CliRunner().invoke(main, ["records", str(path), *args])
        return out.exit_code, out.output

    code, text = call("--json")
    assert code == 0 and json.loads(text)["records"][0]["force_des_n"] == 2.0
    code, text = call("--at", "0.1,-0.2", "--csv", str(tmp_path / "o.csv"))
    assert code == 0 and "1 measurements of 1 flights" in text and (tmp_path / "o.csv").is_file()
    for args, told in (
        (("--geojson", str(tmp_path / "o.geojson")), "--origin"),
        (("--at", "1"), "--at"),
        (("--spot", "z"), "no spot 'z'"),
        (("--csv", str(tmp_path / "o.txt")), "unknown format"),
        (("--radius", "0"), "radius"),
        (("--radius", "nan"), "radius"),
    ):
        code, text = call(*args)
        assert code == 2 and told in text, (args, text)
