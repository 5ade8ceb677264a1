"""Registration of flights by datum points: closed forms, coverage of deviations, the database."""

from __future__ import annotations

import math
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from skywright.cli import main
from skywright.core.rotations import exp_so3
from skywright.errors import InputError
from skywright.inspection.history.corrosion import build_history
from skywright.inspection.history.entries import Datum, Indication, Reading
from skywright.inspection.history.registration import TURN_STD, register_flight
from skywright.inspection.history.store import InspectionStore

MARKS = np.array([[0.0, 0.0, 0.0], [1.2, 0.1, 0.0], [0.1, 0.9, 0.02], [1.1, 1.0, -0.01]])
U95 = 0.002


def name(points: np.ndarray, u95: float = U95) -> dict[str, Datum]:
    return {f"D{k}": Datum(f"D{k}", *p, u95) for k, p in enumerate(np.asarray(points).tolist())}


def displace(points: np.ndarray, shift: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Places in the asset as a flight has them, whose frame is shifted and turned."""
    R = np.empty((3, 3))
    exp_so3(np.ascontiguousarray(turn), R)
    return (np.asarray(points) - shift) @ R


def test_exact_points_give_the_frame_back() -> None:
    shift, turn = np.array([0.02, -0.01, 0.005]), np.radians([0.3, -0.2, 1.0])
    found = register_flight(name(MARKS, 1e-6), name(displace(MARKS, shift, turn), 1e-6))
    assert found is not None and found.points == 4 and not found.notes
    far = np.array([2.0, -1.0, 0.0])
    back, std = found.carry(displace(far[None], shift, turn)[0])
    assert np.linalg.norm(back - far) < 1e-6
    assert std < 1e-5
    assert np.degrees(found.turn) == pytest.approx([0.3, -0.2, 1.0], abs=1e-4)


def test_stated_deviations_hold_over_many_flights() -> None:
    """The normalised error of a carried place has three degrees of freedom."""
    rng, far, ratio = np.random.default_rng(1), np.array([1.8, -0.5, 0.1]), []
    sigma = U95 / 2
    for _ in range(400):
        shift, turn = rng.normal(0, 0.02, 3), rng.normal(0, math.radians(1.0), 3)
        asset = MARKS + rng.normal(0, sigma, MARKS.shape)
        flown = displace(MARKS, shift, turn) + rng.normal(0, sigma, MARKS.shape)
        found = register_flight(name(asset), name(flown), 0.05)
        assert found is not None
        lever = displace(far[None], shift, turn)[0]
        J = np.hstack([np.eye(3), -np.cross(np.eye(3), found.middle - lever)])
        error = found.carry(lever)[0] - far
        ratio.append(error @ np.linalg.solve(J @ found.covariance @ J.T, error))
    assert np.mean(ratio) == pytest.approx(3.0, abs=3 * math.sqrt(6 / 400))


def test_one_point_fixes_the_shift_and_leaves_the_turn_open() -> None:
    shift = np.array([0.03, 0.0, 0.0])
    found = register_flight(name(MARKS[:1]), name(MARKS[:1] - shift), 0.05)
    assert found is not None
    near, far = found.carry(MARKS[0] - shift), found.carry(MARKS[3] - shift)
    # prior 0.05 m against sqrt(2) mm: the shift is known to 1.4 mm
    assert near[1] == pytest.approx(math.sqrt(2) * U95 / 2, rel=0.01)
    assert far[1] == pytest.approx(TURN_STD * np.linalg.norm(MARKS[3]), rel=0.05)
    assert found.notes[0].startswith("1 datum point does not determine the rotation")
    assert register_flight(name(MARKS), {}) is None


def test_a_point_of_the_fit_is_judged_by_the_deviation_of_its_residual() -> None:
    """A point pulls the fit towards itself: its residual is half of what it moved, and scatters
    less than the point. 6.5 deviations (of asset and flight) leave a residual of 4.4, which is 5.3
    of its own; the limit for one of 4 points is 4.5."""
    flown = MARKS.copy()
    flown[2, 0] += 6.5 * math.sqrt(2.0) * U95 / 2
    found = register_flight(name(MARKS), name(flown))
    assert found is not None and [x[:8] for x in found.notes] == ["datum D2"]
    flown[2, 0] = MARKS[2, 0] + 3.0 * math.sqrt(2.0) * U95 / 2
    found = register_flight(name(MARKS), name(flown))
    assert found is not None and not found.notes


@pytest.mark.parametrize("points", [2, 3, 4])
def test_a_mark_is_named_if_it_moved_and_hardly_ever_otherwise(points: int) -> None:
    """5e-4 of 500 sound registrations are 0.25; ten deviations towards the others are found."""
    rng, marks, named = np.random.default_rng(5), MARKS[:points], []
    for k in range(540):
        shift, turn = rng.normal(0, 0.05, 3), rng.normal(0, TURN_STD / 2, 3)
        asset = marks + rng.normal(0, U95 / 2, marks.shape)
        true = marks.copy()
        if k >= 500:
            towards = marks.mean(axis=0) - marks[1]
            true[1] += 10.0 * math.sqrt(2.0) * U95 / 2 * towards / np.linalg.norm(towards)
        flown = displace(true, shift, turn) + rng.normal(0, U95 / 2, marks.shape)
        found = register_flight(name(asset), name(flown), 0.05)
        assert found is not None
        named.append(any("D1" in note and "has moved" in note for note in found.notes))
    assert sum(named[:500]) <= 2
    assert all(named[500:])


def test_a_mark_that_moved_is_named_and_widens_what_is_stated() -> None:
    rng = np.random.default_rng(2)
    flown = MARKS + rng.normal(0, U95 / 2, MARKS.shape)
    sound = register_flight(name(MARKS), name(flown))
    flown[2] += [0.0, 0.03, 0.0]
    found = register_flight(name(MARKS), name(flown))
    assert sound is not None and found is not None
    assert not sound.notes
    assert any("D2" in note and "has moved, or" in note for note in found.notes)
    assert found.carry(MARKS[2])[1] > 3 * sound.carry(MARKS[2])[1]


def test_mixed_up_names_are_refused() -> None:
    with pytest.raises(InputError, match="names and frames"):
        register_flight(name(MARKS), name(MARKS[[1, 0, 3, 2]]))


def test_flights_merge_in_the_frame_of_the_asset(tmp_path: Path) -> None:
    """A corroding spot 60 mm apart in two flights' frames is one place once both are registered."""
    path, place = tmp_path / "r.db", np.array([0.6, 0.4, 0.0])
    store, shift = InspectionStore(path, create=True), np.array([0.06, 0.0, 0.0])
    part = store.add_component("tank", "shell", required_mm=6.0)
    flights = []
    for year, value, off in ((2020, 10.0, 0 * shift), (2024, 9.4, shift)):
        flight, t = store.add_flight(
            structure="tank", mission="m", robot="r", seed=1, run="",
            started=datetime(year, 1, 1, tzinfo=UTC), registration_std_m=0.05,
        )  # fmt: skip
        x, y, z = (place - off).tolist()
        store.add_reading(flight, t, Reading("thickness", value, "mm", 0.1, x, y, z, 0.002),
                          component=part)  # fmt: skip
        store.add_indication(flight, t, Indication("crack", x, y, z, 0.003), component=part)
        flights.append(flight)
    assert len(build_history(store.find_readings(), {("tank", "shell"): 6.0}, 0.02)) == 2
    tables = {}
    for key, points in (("asset", MARKS), (flights[0], MARKS), (flights[1], MARKS - shift)):
        tables[key] = tmp_path / f"{key}.csv"
        rows = [f"D{k},{x},{y},{z},{U95}" for k, (x, y, z) in enumerate(points.tolist())]
        tables[key].write_text("\n".join(["name,x_m,y_m,z_m,u95_m", *rows]))
    call = CliRunner().invoke
    for args in (["--structure", "tank"], ["--flight", flights[0]], ["--flight", flights[1]]):
        table = str(tables.get(args[1], tables["asset"]))
        done = call(main, ["records", str(path), "--datums", table, *args])
        assert done.exit_code == 0, done.output
    assert "4 datum points of tank" in done.output and "60.0, 0.0" in done.output
    merged = build_history(store.find_readings(), {("tank", "shell"): 6.0}, 0.02)
    assert len(merged) == 1 and len(merged[0].inspections) == 2
    assert merged[0].long_term is not None
    assert merged[0].long_term.mm_per_year == pytest.approx(0.15, rel=0.01)
    assert merged[0].place_std_m is not None and 0.0005 < merged[0].place_std_m < 0.003
    found = store.find_indications()
    assert [i.indication.x_m for i in found] == pytest.approx([0.6, 0.6], abs=2e-5)  # by the prior
    assert all(i.registration_std_m is not None and i.registration_std_m < 0.002 for i in found)
    store.close()


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("name,x_m,y_m,z_m\nA,0,0,0\n", "lacks u95_m"),
        ("name,x_m,y_m,z_m,u95_m\n", "holds no datum point"),
        ("name,x_m,y_m,z_m,u95_m\nA,0,0,nan,0.1\n", "line 2: z_m is 'nan'"),
        ("name,x_m,y_m,z_m,u95_m\nA,0,0,0,0\n", "u95_m is '0'; valid: above 0"),
        ("name,x_m,y_m,z_m,u95_m\nA,0,0,0,1\nA,1,0,0,1\n", "A twice"),
    ],
)
def test_a_wrong_table_is_told_in_one_line(tmp_path: Path, text: str, says: str) -> None:
    store = InspectionStore(tmp_path / "r.db", create=True)
    store.add_flight(structure="tank", mission="m", robot="r", seed=1, run="")
    store.close()
    (tmp_path / "d.csv").write_text(text)
    done = CliRunner().invoke(
        main,
        ["records", str(tmp_path / "r.db"), "--datums", str(tmp_path / "d.csv"), "--structure",
         "tank"],
    )  # fmt: skip
    assert done.exit_code == 2 and says in done.output, done.output


def test_a_refused_table_leaves_the_database_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / "r.db"
    store = InspectionStore(path, create=True)
    flight, t = store.add_flight(structure="tank", mission="m", robot="r", seed=1, run="")
    store.add_reading(flight, t, Reading("thickness", 9.0, "mm", 0.1, 0.6, 0.4, 0.0))
    store.add_datums("tank", None, name(MARKS).values())
    store.add_datums("tank", flight, name(MARKS - [0.06, 0.0, 0.0]).values())
    before = store.find_readings()
    assert before[0].reading.x_m == pytest.approx(0.66, abs=1e-4)
    swapped = MARKS[[1, 0, 3, 2]]
    for owner in (flight, None):
        with pytest.raises(InputError, match="still differ"):
            store.add_datums("tank", owner, name(swapped).values())
    assert store.find_readings() == before
    store.close()
    table = tmp_path / "d.csv"
    table.write_text("name,x_m,y_m,z_m,u95_m\nD0,1e300,0,0,0.1\n")
    call = ["records", str(path), "--datums", str(table), "--structure", "tank"]
    done = CliRunner().invoke(main, call)
    assert done.exit_code == 2 and "x_m is '1e300'; valid: -1e+08 to 1e+08" in done.output
    done = CliRunner().invoke(main, [*call, "--report", str(tmp_path / "r.html")])
    assert done.exit_code == 2 and "export in a second command" in done.output


def test_marks_of_a_flight_belong_to_the_asset_of_the_flight(tmp_path: Path) -> None:
    """Under another asset they would never be used."""
    store = InspectionStore(tmp_path / "r.db", create=True)
    flight, _ = store.add_flight(structure="tank", mission="m", robot="r", seed=1, run="")
    store.add_asset("bridge")
    marks = list(name(MARKS).values())
    for asset, key, says in (
        ("bridge", flight, f"no flight '{flight}' of 'bridge'; valid: none"),
        ("tank", "gone", f"no flight 'gone' of 'tank'; valid: {flight}"),
    ):
        with pytest.raises(InputError, match=says):
            store.add_datums(asset, key, marks)
        assert store.list_datums(asset, key) == {}
    store.add_datums("tank", flight, marks)
    assert len(store.list_datums("tank", flight)) == 4
    store.close()


def test_the_table_of_flights_has_a_value_below_each_heading(tmp_path: Path) -> None:
    path, table = tmp_path / "r.db", tmp_path / "d.csv"
    store = InspectionStore(path, create=True)
    flight, _ = store.add_flight(structure="tank", mission="m", robot="r", seed=1, run="")
    store.close()
    table.write_text("name,x_m,y_m,z_m,u95_m\nD0,0,0,0,0.1\n")
    done = CliRunner().invoke(
        main, ["records", str(path), "--datums", str(table), "--structure", "tank"]
    )
    head, row = (
        [x.strip() for x in line.strip("┃│").replace("│", "┃").split("┃")]
        for line in done.output.splitlines() if line[0] in "┃│"
    )  # fmt: skip
    assert dict(zip(head, row, strict=True)) == {
        "flight": flight, "common": "0", "shift (mm)": "-", "turn (deg)": "-",
        "residual (mm)": "-",
    }  # fmt: skip
