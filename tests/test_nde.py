"""Files .nde: valid against the published schemas, read back equal, half a file in one line."""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np
import pytest

from skywright.errors import InputError
from skywright.inspection.files.nde import EddyScan, UltrasonicScan, read_nde, write_nde
from skywright.inspection.files.nde_setup import SIMULATED

ROOT = Path(__file__).resolve().parent.parent
SCHEMAS = ROOT.parent / "shared" / "data" / "nde"


def build_ultrasonic(n_u: int = 4, n_v: int = 3, timed: bool = True) -> UltrasonicScan:
    """Echoes of a wedge: 5 mm thick at u = 0, one millimetre more each step."""
    t = np.arange(600) / 1e8
    wall = 0.005 + 0.001 * np.arange(n_u)
    echo = 2 * wall / 5920.0
    shape = np.exp(-(((t[None] - echo[:, None]) / 1e-7) ** 2)) * np.cos(
        2 * np.pi * 5e6 * (t[None] - echo[:, None])
    )
    ascan = np.repeat(0.8 * shape[:, None], n_v, axis=1)
    time = np.repeat(echo[:, None], n_v, axis=1)
    time[0, 0] = np.nan
    return UltrasonicScan(
        ascan, time if timed else None, 1e8, 0.0, (0.1, 0.01), (0.0, 0.02), 5920.0, 5e6, 0.006,
        0.008, ("gauge", "42"), True,
    )  # fmt: skip


def build_eddy(channels: int = 3, cycles: int = 50) -> EddyScan:
    r = np.random.default_rng(1)
    z = r.normal(size=(channels, cycles)) + 1j * r.normal(size=(channels, cycles))
    position = np.column_stack([np.linspace(0, 0.1, cycles), np.zeros(cycles)])
    offsets = np.column_stack([np.zeros(channels), 0.0025 * np.arange(channels)])
    return EddyScan(z, position, offsets, 1e5, 1.0, 1000.0, 0.008, ("array", ""), True)


def edit_setup(path: Path, place: tuple[str | int, ...], values: dict[str, object]) -> None:
    """Replace keys of the table at `place` of a file's set-up."""
    with h5py.File(path, "a") as file:
        setup = json.loads(file["Public/Setup"][()])
        table = setup
        for key in place:
            table = table[key]
        table.update(values)
        del file["Public/Setup"]
        file["Public/Setup"] = json.dumps(setup)


def echo_wall(scan: UltrasonicScan) -> np.ndarray:
    """Thickness (m) from the largest sample of each A-scan."""
    at = np.argmax(scan.ascan, axis=2) / scan.sample_rate_hz + scan.start_s
    return 0.5 * scan.velocity_mps * at


@pytest.mark.parametrize("timed", [True, False])
def test_an_ultrasonic_scan_reads_back(tmp_path: Path, timed: bool) -> None:
    path, scan = tmp_path / "s.nde", build_ultrasonic(timed=timed)
    write_nde(path, scan)
    again = read_nde(path)
    assert isinstance(again, UltrasonicScan)
    assert again.ascan == pytest.approx(scan.ascan, abs=1 / 32767)  # 16 bits
    assert (again.u, again.v, again.instrument, again.simulated) == (
        scan.u, scan.v, scan.instrument, True
    )  # fmt: skip
    for name in ("sample_rate_hz", "velocity_mps", "frequency_hz", "diameter_m", "thickness_m"):
        assert getattr(again, name) == pytest.approx(getattr(scan, name))
    assert (again.time is None) == (not timed)
    if again.time is not None and scan.time is not None:
        assert again.time == pytest.approx(scan.time, nan_ok=True)
    # what it is for: the wall, to the half of a sample's length
    assert echo_wall(again)[:, 0] == pytest.approx([0.005, 0.006, 0.007, 0.008], abs=3e-5)


def test_an_eddy_current_scan_reads_back(tmp_path: Path) -> None:
    path, scan = tmp_path / "s.nde", build_eddy()
    write_nde(path, scan)
    again = read_nde(path)
    assert isinstance(again, EddyScan)
    for name in ("impedance", "position", "offsets"):
        assert np.array_equal(getattr(again, name), getattr(scan, name))
    assert again[3:] == scan[3:]


@pytest.mark.parametrize("simulated", [True, False])
def test_a_simulated_scan_says_so(tmp_path: Path, simulated: bool) -> None:
    path = tmp_path / "s.nde"
    write_nde(path, build_eddy()._replace(simulated=simulated))
    with h5py.File(path) as file:
        told = json.loads(file["Properties"][()])["file"]
    assert told.get("notice") == (SIMULATED if simulated else None)
    assert read_nde(path).simulated == simulated


if SCHEMAS.is_dir():  # beside the checkout, where they are

    @pytest.mark.parametrize("build", [build_ultrasonic, build_eddy])
    def test_what_is_written_is_valid(tmp_path: Path, build: object) -> None:
        import fastjsonschema

        path = tmp_path / "s.nde"
        write_nde(path, build())  # type: ignore[operator]
        with h5py.File(path) as file:
            for name, place in (("Properties", "Properties"), ("Setup", "Public/Setup")):
                schema = json.loads((SCHEMAS / f"{name}-Schema-4.3.0.json").read_text())
                validate = fastjsonschema.compile(schema, formats={"date-time": r".*"})
                validate(json.loads(file[place][()]))
                broken = json.loads(file[place][()]) | {"version": "9", "methods": ["RT"]}
                with pytest.raises(fastjsonschema.JsonSchemaException):
                    validate(broken)


@pytest.mark.parametrize("build", [build_ultrasonic, build_eddy])
@pytest.mark.parametrize("share", [0.0, 0.3, 0.6, 0.95])
def test_half_a_file_is_told_in_one_line(tmp_path: Path, build: object, share: float) -> None:
    path = tmp_path / "s.nde"
    write_nde(path, build())  # type: ignore[operator]
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(InputError, match=r"s\.nde: is ") as told:
        read_nde(path)
    assert "\n" not in str(told.value)


def test_other_files_are_told(tmp_path: Path) -> None:
    path = tmp_path / "s.nde"
    with pytest.raises(InputError, match="no such file"):
        read_nde(path)
    path.write_text("t,value\n1,2\n")
    with pytest.raises(InputError, match="no complete HDF5 file"):
        read_nde(path)
    with h5py.File(path, "w") as file:
        file["x"] = 1
    with pytest.raises(InputError, match="damaged or incomplete"):
        read_nde(path)
    write_nde(path, build_ultrasonic())
    with h5py.File(path, "a") as file:
        setup = json.loads(file["Public/Setup"][()])
        del file["Public/Setup"]
        setup["groups"][0]["datasets"][0]["dimensions"][2]["quantity"] = 7
        file["Public/Setup"] = json.dumps(setup)
    with pytest.raises(InputError, match="do not fit their set-up"):
        read_nde(path)
    with h5py.File(path, "a") as file:
        del file["Public/Setup"]
        file["Public/Setup"] = json.dumps(setup | {"version": "3.1.0"})
    with pytest.raises(InputError, match=r"version 3\.1\.0; valid: 4\.0"):
        read_nde(path)


@pytest.mark.parametrize(
    ("place", "values", "says"),
    [
        (("datasets", 0, "dimensions", 2), {"resolution": 0}, "sample_rate_hz is inf"),
        (("datasets", 0, "dimensions", 2), {"resolution": -1e-8}, "sample_rate_hz is -1e"),
        (("datasets", 0, "dimensions", 0), {"resolution": float("nan")}, "u holds 1 values"),
        (("datasets", 0, "dimensions", 0), {"resolution": 0.0}, "has spacings of 0 and"),
        (("datasets", 0, "dataValue"), {"max": -32767}, "-32767; valid: min below max"),
        (("datasets", 0, "dataValue"), {"unit": "Linear"}, "unit 'Linear'; valid: Percent"),
        (("datasets", 1, "dataValue"), {"unit": "Meter"}, "unit 'Meter'; valid: Seconds"),
        (("processes", 0, "ultrasonicConventional"), {"velocity": -5.0}, "velocity_mps is -5"),
        (("processes", 0, "ultrasonicConventional"), {"gain": 10**400}, "too large"),
    ],
)
def test_wrong_numbers_of_a_file_are_refused(
    tmp_path: Path, place: tuple[str | int, ...], values: dict[str, object], says: str
) -> None:
    path = tmp_path / "s.nde"
    write_nde(path, build_ultrasonic())
    edit_setup(path, ("groups", 0, *place), values)
    with pytest.raises(InputError, match=says) as caught:
        read_nde(path)
    assert str(caught.value).startswith(f"{path}: ") and "\n" not in str(caught.value)


def test_encoders_are_in_metres(tmp_path: Path) -> None:
    path, value = tmp_path / "s.nde", ("dataMappings", 0, "allCycle", "datasets", 0, "dataValue")
    write_nde(path, build_eddy())
    edit_setup(path, value, {"min": 0.0, "max": 1.0, "unitMin": 2.0, "unitMax": 4.0})
    again = read_nde(path)
    assert isinstance(again, EddyScan)
    assert again.position[:, 0] == pytest.approx(2.0 + 2.0 * build_eddy().position[:, 0])
    edit_setup(path, value, {"unit": "Step"})
    with pytest.raises(InputError, match="Encoder in the unit 'Step'; valid: Meter"):
        read_nde(path)


def test_a_file_without_a_plate_has_no_thickness(tmp_path: Path) -> None:
    path = tmp_path / "s.nde"
    write_nde(path, build_ultrasonic())
    edit_setup(path, ("specimens", 0), {"plateGeometry": {}})
    assert np.isnan(read_nde(path).thickness_m)


@pytest.mark.parametrize(
    ("scan", "says"),
    [
        (build_eddy()._replace(frequency_hz=0.0), "frequency_hz is 0"),
        (build_eddy()._replace(frequency_hz=float("nan")), "frequency_hz is nan"),
        (build_eddy()._replace(position=np.zeros((3, 2))), "3 positions"),
        (build_eddy()._replace(offsets=np.zeros((1, 2))), "1 coils for 3"),
        (build_eddy()._replace(impedance=np.full((3, 50), np.nan + 0j)), "without a number"),
        (build_ultrasonic()._replace(u=(0.0, 0.0)), "has spacings of"),
        (build_ultrasonic()._replace(time=np.zeros((9, 9))), "times for A-scans"),
    ],
)
def test_scans_that_no_file_can_hold_are_told(
    tmp_path: Path, scan: UltrasonicScan | EddyScan, says: str
) -> None:
    path = tmp_path / "s.nde"
    with pytest.raises(InputError, match=says):
        write_nde(path, scan)
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(InputError, match="cannot be written"):
        write_nde(tmp_path / "nowhere" / "s.nde", build_eddy())


def test_saturation_is_clipped(tmp_path: Path) -> None:
    scan = build_ultrasonic()
    write_nde(tmp_path / "s.nde", scan._replace(ascan=3.0 * scan.ascan))
    again = read_nde(tmp_path / "s.nde")
    assert isinstance(again, UltrasonicScan)
    assert np.max(again.ascan) == 1.0 and np.min(again.ascan) == -1.0
