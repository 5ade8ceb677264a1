"""Write and read scans in the open format .nde, version 4.3: HDF5 with a set-up in JSON.

    /Properties (JSON)    /Public/Setup (JSON)
    /Public/Groups/0/Datasets/0-AScanAmplitude  int16 [U, V, time]
    /Public/Groups/0/Datasets/1-CScanTime       float64 [U, V] s
    /Public/Groups/0/Datasets/0-Impedance       (r, i) [channel, cycle]

Tests check the written files against the published schemas. Coordinates u and v lie on the
surface: u along, v across. h5py is an extra.
"""

from __future__ import annotations

import json
import math
import os
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.errors import InputError
from skywright.inspection.calibration import ComplexArray
from skywright.inspection.files.nde_setup import (
    ENCODERS,
    FULL,
    GROUP,
    SIMULATED,
    VERSION,
    build_eddy,
    build_properties,
    build_ultrasonic,
)


class UltrasonicScan(NamedTuple):
    """A-scans on a grid of points."""

    ascan: Array  # (u, v, time) share of full screen, -1 to 1
    time: Array | None  # (u, v) s, gated time of flight; NaN: none
    sample_rate_hz: float
    start_s: float  # start of the A-scan, after the transmitted pulse
    u: tuple[float, float]  # m, first point and spacing, along
    v: tuple[float, float]  # m, first point and spacing, across
    velocity_mps: float
    frequency_hz: float
    diameter_m: float  # of the probe's element
    thickness_m: float  # nominal wall
    instrument: tuple[str, str]  # model and serial number
    simulated: bool
    rate_hz: float = 100.0  # of acquisition
    gain_db: float = 0.0
    shear_mps: float = 3240.0


class EddyScan(NamedTuple):
    """Impedance of one or more coils over the acquisition cycles."""

    impedance: ComplexArray  # (channel, cycle), instrument units
    position: Array  # (cycle, 2) u, v m, of the probe's centre
    offsets: Array  # (channel, 2) m, of each coil from that centre
    frequency_hz: float
    drive_v: float
    rate_hz: float
    thickness_m: float
    instrument: tuple[str, str]
    simulated: bool
    gain_db: float = 0.0


def write_nde(path: Path, scan: UltrasonicScan | EddyScan) -> None:
    """Write a scan, complete or not at all. Raises InputError if numbers or shapes are invalid."""
    h5py = _import_h5py()
    _check(path, scan)
    ultrasonic = isinstance(scan, UltrasonicScan)
    setup = build_ultrasonic(scan) if isinstance(scan, UltrasonicScan) else build_eddy(scan)
    partial = path.with_name(path.name + ".partial")
    try:
        with h5py.File(partial, "w") as file:
            file["Properties"] = json.dumps(build_properties(ultrasonic, scan.simulated))
            file["Public/Setup"] = json.dumps(setup)
            if isinstance(scan, UltrasonicScan):
                data = np.round(np.clip(scan.ascan, -1.0, 1.0) * FULL).astype(np.int16)
                file[GROUP + "0-AScanAmplitude"] = data
                if scan.time is not None:
                    file[GROUP + "1-CScanTime"] = np.asarray(scan.time, np.float64)
            else:
                values = np.empty(scan.impedance.shape, [("r", np.float64), ("i", np.float64)])
                values["r"], values["i"] = scan.impedance.real, scan.impedance.imag
                file[GROUP + "0-Impedance"] = values
                for k in range(2):
                    file[f"{ENCODERS}{k}-Encoder"] = np.asarray(scan.position[:, k], np.float64)
            file.flush()
        with partial.open("rb") as written:
            os.fsync(written.fileno())
        partial.replace(path)
    except OSError as error:
        with suppress(OSError):
            partial.unlink()
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from None


def read_nde(path: Path) -> UltrasonicScan | EddyScan:
    """Read the first group of a file; a thickness that it does not state is NaN.

    Raises InputError, in one line, if the file is incomplete, of another format or version, or if
    its data do not match its set-up or are outside the ranges that `write_nde` accepts.
    """
    h5py = _import_h5py()
    if not path.is_file():
        raise InputError(f"{path}: is a folder" if path.is_dir() else f"{path}: no such file")
    try:
        with h5py.File(path, "r") as file:
            properties = json.loads(file["Properties"][()])
            setup = json.loads(file["Public/Setup"][()])
            version = str(setup["version"])
            if not version.startswith("4."):
                raise InputError(f"{path}: .nde version {version}; valid: 4.0 to {VERSION}")
            notice = str(properties["file"].get("notice", ""))
            datasets = {d["dataClass"]: d for d in setup["groups"][0]["datasets"]}
            arrays = {name: file[d["path"]][()] for name, d in datasets.items()}
            scan: UltrasonicScan | EddyScan
            if "AScanAmplitude" in arrays:
                scan = _read_ultrasonic(setup, datasets, arrays, notice == SIMULATED)
            elif "Impedance" in arrays:
                encoders = setup["dataMappings"][0]["allCycle"]["datasets"]
                places = [_scale(file[d["path"]][()], d, "Meter") for d in encoders]
                scan = _read_eddy(setup, arrays["Impedance"], places, notice == SIMULATED)
            else:
                raise InputError(
                    f"{path}: no A-scans and no impedance in its first group; found: "
                    + (", ".join(datasets) or "nothing")
                )
            _check(path, scan, ("time", "thickness_m"))
            return scan
    except InputError:
        raise
    except OSError:
        raise InputError(
            f"{path}: is no complete HDF5 file: not an .nde file, or only a part of one"
        ) from None
    except (
        LookupError, ValueError, TypeError, ArithmeticError, AttributeError, RuntimeError,
    ) as error:  # fmt: skip
        what = " ".join(str(error).split())[:120]
        raise InputError(f"{path}: is damaged or incomplete: {what}") from None


def _import_h5py() -> Any:
    try:
        import h5py
    except ImportError:
        raise InputError(".nde files need h5py: pip install 'skywright[nde]'") from None
    return h5py


def _check(
    path: Path, scan: UltrasonicScan | EddyScan, may_be_nan: tuple[str, ...] = ("time",)
) -> None:
    for name, value in scan._asdict().items():
        array = np.asarray(value)
        bad = ~np.isfinite(array) if array.dtype.kind in "fc" else np.zeros(0)
        if name not in may_be_nan and np.any(bad):
            what = f"holds {np.sum(bad)} values without a number" if bad.ndim else f"is {value}"
            raise InputError(f"{path}: {name} {what}; valid: finite numbers")
    positive = ("sample_rate_hz", "velocity_mps", "frequency_hz", "thickness_m", "rate_hz")
    for name in positive:
        if getattr(scan, name, 1.0) <= 0:
            raise InputError(f"{path}: {name} is {getattr(scan, name):g}; valid: above 0")
    if isinstance(scan, UltrasonicScan):
        if scan.ascan.ndim != 3 or min(scan.ascan.shape) < 1:
            raise InputError(
                f"{path}: A-scans of the shape {scan.ascan.shape}; valid: (u, v, time)"
            )
        if scan.time is not None and scan.time.shape != scan.ascan.shape[:2]:
            raise InputError(f"{path}: {scan.time.shape} times for A-scans {scan.ascan.shape[:2]}")
        if min(scan.u[1], scan.v[1]) <= 0:
            raise InputError(
                f"{path}: the grid has spacings of {scan.u[1]:g} and {scan.v[1]:g} m; "
                "valid: above 0"
            )
    elif scan.impedance.ndim != 2 or len(scan.position) != scan.impedance.shape[1]:
        raise InputError(
            f"{path}: {len(scan.position)} positions for an impedance of {scan.impedance.shape}"
        )
    elif len(scan.offsets) != len(scan.impedance):
        raise InputError(f"{path}: {len(scan.offsets)} coils for {len(scan.impedance)} channels")


def _read_unit(setup: dict[str, Any]) -> tuple[tuple[str, str], float, float]:
    """Return ((model, serial), acquisition rate in Hz, thickness in m)."""
    unit = setup["acquisitionUnits"][0]
    plate = setup["specimens"][0].get("plateGeometry", {})
    model = (str(unit["model"]), str(unit.get("serialNumber", "")))
    return model, float(unit["acquisitionRate"]), float(plate.get("thickness", math.nan))


def _scale(raw: Array, described: dict[str, Any], unit: str) -> Array:
    """Return the values of a dataset in `unit`. Raises ValueError for another unit, or no range."""
    name, value = described["dataClass"], described["dataValue"]
    if value["unit"] != unit:
        raise ValueError(f"{name} in the unit {value['unit']!r}; valid: {unit}")
    low, high, bottom, top = (float(value[k]) for k in ("min", "max", "unitMin", "unitMax"))
    if (low, high) == (bottom, top):
        return np.asarray(raw, float)
    if not (low < high and math.isfinite(high - low) and math.isfinite(top - bottom)):
        raise ValueError(f"{name} from {low:g} to {high:g}; valid: min below max, both finite")
    return np.asarray(bottom + (raw.astype(float) - low) / (high - low) * (top - bottom))


def _read_ultrasonic(
    setup: dict[str, Any], datasets: dict[str, Any], arrays: dict[str, Any], simulated: bool
) -> UltrasonicScan:
    described = datasets["AScanAmplitude"]
    axes = {d["axis"]: d for d in described["dimensions"]}
    order = [d["axis"] for d in described["dimensions"]]
    raw = arrays["AScanAmplitude"]
    if list(raw.shape) != [axes[name]["quantity"] for name in order]:
        raise ValueError(f"A-scans of the shape {raw.shape} do not fit their set-up")
    wanted = ["UCoordinate", "VCoordinate", "Ultrasound"]
    if sorted(order) != sorted(wanted):
        raise ValueError(f"A-scans over {', '.join(order)}; only grids of u and v are read")
    ascan = np.transpose(_scale(raw, described, "Percent"), [order.index(n) for n in wanted])
    time = None
    if "CScanTime" in arrays:
        names = [d["axis"] for d in datasets["CScanTime"]["dimensions"]]
        time = _scale(arrays["CScanTime"], datasets["CScanTime"], "Seconds")
        time = np.transpose(time, [names.index(n) for n in wanted[:2]])
    process = setup["groups"][0]["processes"][0]["ultrasonicConventional"]
    probe = setup["probes"][0]["conventionalRound"]
    instrument, rate, thickness = _read_unit(setup)
    u, v, t = (axes[name] for name in wanted)
    step = float(t["resolution"])
    return UltrasonicScan(
        ascan / 100.0, time, 1.0 / step if step else math.inf, float(t.get("offset", 0.0)),
        (float(u.get("offset", 0.0)), float(u["resolution"])),
        (float(v.get("offset", 0.0)), float(v["resolution"])), float(process["velocity"]),
        float(probe["centralFrequency"]), float(probe["diameter"]), thickness, instrument,
        simulated, rate, float(process.get("gain", 0.0)),
    )  # fmt: skip


def _read_eddy(setup: dict[str, Any], raw: Any, places: list[Array], simulated: bool) -> EddyScan:
    process = setup["groups"][0]["processes"][0]["eddyCurrent"]
    sensors = setup["probes"][0]["eddyCurrentProbe"]["sensorGroups"][0]["sensors"]
    instrument, rate, thickness = _read_unit(setup)
    # h5py returns pairs named r and i as complex numbers
    impedance = np.asarray(raw if raw.dtype.names is None else raw["r"] + 1j * raw["i"])
    position = np.stack([np.asarray(p, float) for p in places], axis=1)
    if len(position) != impedance.shape[1]:
        raise ValueError(f"{len(position)} positions for {impedance.shape[1]} cycles")
    offsets = np.array([[s["primaryOffset"], s["secondaryOffset"]] for s in sensors], float)
    return EddyScan(
        impedance, position, offsets, float(process["frequency"]),
        float(process["driveAmplitude"]), rate, thickness, instrument, simulated,
        float(process.get("gain", 0.0)),
    )  # fmt: skip
