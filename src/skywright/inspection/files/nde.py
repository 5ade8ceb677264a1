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
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.errors import InputError
from skywright.inspection.calibration import ComplexArray

VERSION = "4.3.0"
FULL = 32767
"""The int16 value of full screen height."""
SIMULATED = "SIMULATED: computed from models, not measured"
GROUP = "/Public/Groups/0/Datasets/"
ENCODERS = "/Public/DataMappings/0/Datasets/"


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
    _check(scan)
    ultrasonic = isinstance(scan, UltrasonicScan)
    setup = _build_ultrasonic(scan) if isinstance(scan, UltrasonicScan) else _build_eddy(scan)
    partial = path.with_name(path.name + ".partial")
    try:
        with h5py.File(partial, "w") as file:
            file["Properties"] = json.dumps(_build_properties(ultrasonic, scan.simulated))
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
    """Read the first group of a file. Raises InputError, in one line, if the file is incomplete, of
    another format or version, or if its data do not match its set-up.
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
            simulated = notice == SIMULATED
            if "AScanAmplitude" in arrays:
                return _read_ultrasonic(setup, datasets, arrays, simulated)
            if "Impedance" in arrays:
                places = [
                    file[d["path"]][()] for d in setup["dataMappings"][0]["allCycle"]["datasets"]
                ]
                return _read_eddy(setup, arrays["Impedance"], places, simulated)
            raise InputError(
                f"{path}: no A-scans and no impedance in its first group; found: "
                + (", ".join(datasets) or "nothing")
            )
    except InputError:
        raise
    except OSError:
        raise InputError(
            f"{path}: is no complete HDF5 file: not an .nde file, or only a part of one"
        ) from None
    except (KeyError, ValueError, TypeError, IndexError, AttributeError, RuntimeError) as error:
        what = " ".join(str(error).split())[:120]
        raise InputError(f"{path}: is damaged or incomplete: {what}") from None


def _import_h5py() -> Any:
    try:
        import h5py
    except ImportError:
        raise InputError(".nde files need h5py: pip install 'skywright[nde]'") from None
    return h5py


def _check(scan: UltrasonicScan | EddyScan) -> None:
    for name, value in scan._asdict().items():
        if isinstance(value, float) and not math.isfinite(value):
            raise InputError(f".nde: {name} is {value}; valid: a finite number")
        array = np.asarray(value) if isinstance(value, np.ndarray) else np.zeros(0)
        if name != "time" and not np.all(np.isfinite(array)):
            raise InputError(
                f".nde: {name} holds {np.sum(~np.isfinite(array))} values without a number"
            )
    positive = ("sample_rate_hz", "velocity_mps", "frequency_hz", "thickness_m", "rate_hz")
    for name in positive:
        if getattr(scan, name, 1.0) <= 0:
            raise InputError(f".nde: {name} is {getattr(scan, name):g}; valid: above 0")
    if isinstance(scan, UltrasonicScan):
        if scan.ascan.ndim != 3 or min(scan.ascan.shape) < 1:
            raise InputError(f".nde: A-scans of the shape {scan.ascan.shape}; valid: (u, v, time)")
        if scan.time is not None and scan.time.shape != scan.ascan.shape[:2]:
            raise InputError(f".nde: {scan.time.shape} times for A-scans {scan.ascan.shape[:2]}")
        if min(scan.u[1], scan.v[1]) <= 0:
            raise InputError(
                f".nde: the grid has spacings of {scan.u[1]:g} and {scan.v[1]:g} m; valid: above 0"
            )
    elif scan.impedance.ndim != 2 or len(scan.position) != scan.impedance.shape[1]:
        raise InputError(
            f".nde: {len(scan.position)} positions for an impedance of {scan.impedance.shape}"
        )
    elif len(scan.offsets) != len(scan.impedance):
        raise InputError(f".nde: {len(scan.offsets)} coils for {len(scan.impedance)} channels")


def _build_properties(ultrasonic: bool, simulated: bool) -> dict[str, Any]:
    from importlib.metadata import version

    file = {
        "createdByAppName": "Skywright", "createdByAppVersion": version("skywright"),
        "creationDate": datetime.now(UTC).isoformat(timespec="seconds"),
        "creationFormatVersion": VERSION, "formatVersion": VERSION,
    }  # fmt: skip
    if simulated:
        file["notice"] = SIMULATED
    return {
        "$schema": f"./Properties-Schema-{VERSION}.json", "file": file,
        "methods": ["UT" if ultrasonic else "ET"],
    }  # fmt: skip


def _build_common(scan: UltrasonicScan | EddyScan, group: dict[str, Any]) -> dict[str, Any]:
    model, serial = scan.instrument
    unit = {
        "id": 0, "platform": "Skywright", "model": model or "unknown",
        "acquisitionRate": scan.rate_hz, **({"serialNumber": serial} if serial else {}),
    }  # fmt: skip
    plate = {"thickness": scan.thickness_m, "surfaces": [{"id": 0, "name": "Top"}]}
    return {
        "$schema": f"./Setup-Schema-{VERSION}.json", "version": VERSION,
        "scenario": "General Mapping", "groups": [group], "acquisitionUnits": [unit],
        "specimens": [{"id": 0, "plateGeometry": plate}],
    }  # fmt: skip


PLACED = {
    "specimenId": 0, "surfaceId": 0, "uCoordinateOffset": 0.0, "vCoordinateOffset": 0.0,
    "skewAngle": 0.0,
}  # fmt: skip


def _build_ultrasonic(scan: UltrasonicScan) -> dict[str, Any]:
    n_u, n_v, n_t = scan.ascan.shape
    u, v = (
        {"axis": f"{axis}Coordinate", "quantity": n, "offset": at[0], "resolution": at[1]}
        for axis, n, at in (("U", n_u, scan.u), ("V", n_v, scan.v))
    )
    ultrasound = {
        "axis": "Ultrasound", "quantity": n_t, "offset": scan.start_s,
        "resolution": 1.0 / scan.sample_rate_hz,
    }  # fmt: skip
    datasets: list[dict[str, Any]] = [{
        "id": 0, "dataTransformations": [{"processId": 0}], "dataClass": "AScanAmplitude",
        "storageMode": "Independent", "path": GROUP + "0-AScanAmplitude",
        "dataValue": {"min": -FULL, "max": FULL, "unitMin": -100.0, "unitMax": 100.0,
                      "unit": "Percent"},
        "dimensions": [u, v, ultrasound],
    }]  # fmt: skip
    length = n_t / scan.sample_rate_hz
    if scan.time is not None:
        end = scan.start_s + length
        datasets.append({
            "id": 1, "dataTransformations": [{"processId": 0}], "dataClass": "CScanTime",
            "storageMode": "Independent", "path": GROUP + "1-CScanTime",
            "dataValue": {"min": 0.0, "max": end, "unitMin": 0.0, "unitMax": end,
                          "unit": "Seconds"},
            "dimensions": [u, v],
        })  # fmt: skip
    process = {
        "id": 0, "inputs": [], "implementation": "Hardware",
        "outputs": [
            {"id": d["id"], "datasetId": d["id"], "dataClass": d["dataClass"]} for d in datasets
        ],
        "ultrasonicConventional": {
            "pulseEcho": {"probeId": 0}, "waveMode": "Longitudinal",
            "velocity": scan.velocity_mps, "wedgeDelay": 0.0,
            "digitizingFrequency": scan.sample_rate_hz, "rectification": "None",
            "gain": scan.gain_db,
            "beams": [{"id": 0, "refractedAngle": 0.0, "ascanStart": scan.start_s,
                       "ascanLength": length}],
        },
    }  # fmt: skip
    setup = _build_common(scan, {"id": 0, "datasets": datasets, "processes": [process]})
    material = {
        "name": "Steel",
        "longitudinalWave": {"nominalVelocity": scan.velocity_mps},
        "transversalVerticalWave": {"nominalVelocity": scan.shear_mps},
    }
    setup["specimens"][0]["plateGeometry"]["material"] = material
    round_probe = {
        "centralFrequency": scan.frequency_hz, "diameter": scan.diameter_m,
        "elements": [{"id": 0, "acquisitionUnitId": 0, "connectorName": "P1"}],
    }  # fmt: skip
    setup["probes"] = [{
        "id": 0, "model": scan.instrument[0] or "unknown", "conventionalRound": round_probe,
        "wedgeAssociation": {"wedgeId": 0, "mountingLocationId": 0},
    }]  # fmt: skip
    mounted = {
        "id": 0, "wedgeAngle": 0.0, "primaryOffset": 0.0, "secondaryOffset": 0.0,
        "tertiaryOffset": 0.0,
    }  # fmt: skip
    face = {
        "width": scan.diameter_m, "height": 0.0, "length": scan.diameter_m,
        "longitudinalVelocity": scan.velocity_mps, "mountingLocations": [mounted],
    }  # fmt: skip
    setup["wedges"] = [{"id": 0, "model": "contact", "angleBeamWedge": face, "positioning": PLACED}]
    return setup


def _build_eddy(scan: EddyScan) -> dict[str, Any]:
    channels, cycles = scan.impedance.shape
    most = float(max(np.max(np.abs(scan.impedance)), 1e-9))
    impedance = {
        "id": 0, "dataTransformations": [{"processId": 0}], "dataClass": "Impedance",
        "path": GROUP + "0-Impedance",
        "dataValue": {"min": -most, "max": most, "unitMin": -most, "unitMax": most,
                      "unit": "instrument units"},
        "dimensions": [
            {"axis": "Channel", "quantity": channels},
            {"axis": "AcquisitionCycle", "quantity": cycles},
        ],
    }  # fmt: skip
    process = {
        "id": 0, "inputs": [], "dataMappingId": 0, "implementation": "Hardware",
        "outputs": [{"id": 0, "datasetId": 0, "dataClass": "Impedance"}],
        "eddyCurrent": {
            "channels": [{"id": k, "sensorId": k} for k in range(channels)], "probeId": 0,
            "sensorGroupId": 0, "driveAmplitude": scan.drive_v, "frequency": scan.frequency_hz,
            "gain": scan.gain_db,
        },
    }  # fmt: skip
    setup = _build_common(scan, {"id": 0, "datasets": [impedance], "processes": [process]})
    setup["probes"] = [{
        "id": 0, "model": scan.instrument[0] or "unknown",
        "eddyCurrentProbe": {"sensorGroups": [{
            "id": 0, "name": "coils",
            "sensors": [
                {"id": k, "primaryOffset": float(a), "secondaryOffset": float(b),
                 "acquisitionUnitId": 0}
                for k, (a, b) in enumerate(scan.offsets)
            ],
        }]},
        "wedgeAssociation": {"wedgeId": 0, "orientation": "Normal"},
    }]  # fmt: skip
    setup["wedges"] = [{"id": 0, "model": "none", "positioning": PLACED}]
    setup["motionDevices"] = [
        {"id": k, "name": name, "encoder": {"mode": "Quadrature", "stepResolution": 1e6,
                                            "unit": "StepPerMeter"}}
        for k, name in enumerate(("U", "V"))
    ]  # fmt: skip
    encoders = []
    for k in range(2):
        low, high = float(np.min(scan.position[:, k])), float(np.max(scan.position[:, k]))
        value = {"min": low, "max": high, "unitMin": low, "unitMax": high, "unit": "Meter"}
        along = {"axis": "AcquisitionCycle", "quantity": cycles, "motionDeviceId": k}
        encoders.append({
            "id": k, "dataClass": "Encoder", "path": f"{ENCODERS}{k}-Encoder",
            "dataValue": value, "dimensions": [along],
        })  # fmt: skip
    setup["dataMappings"] = [
        {"id": 0, "specimenId": 0, "surfaceId": 0, "allCycle": {"datasets": encoders}}
    ]
    return setup


def _read_unit(setup: dict[str, Any]) -> tuple[tuple[str, str], float, float]:
    """Return ((model, serial), acquisition rate in Hz, thickness in m)."""
    unit = setup["acquisitionUnits"][0]
    plate = setup["specimens"][0].get("plateGeometry", {})
    model = (str(unit["model"]), str(unit.get("serialNumber", "")))
    return model, float(unit["acquisitionRate"]), float(plate.get("thickness", math.nan))


def _scale(raw: Array, value: dict[str, float]) -> Array:
    """Return the values of a dataset in its unit."""
    share = (raw.astype(float) - value["min"]) / (value["max"] - value["min"])
    return np.asarray(value["unitMin"] + share * (value["unitMax"] - value["unitMin"]))


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
    ascan = np.transpose(_scale(raw, described["dataValue"]), [order.index(n) for n in wanted])
    time = None
    if "CScanTime" in arrays:
        names = [d["axis"] for d in datasets["CScanTime"]["dimensions"]]
        time = _scale(arrays["CScanTime"], datasets["CScanTime"]["dataValue"])
        time = np.transpose(time, [names.index(n) for n in wanted[:2]])
    process = setup["groups"][0]["processes"][0]["ultrasonicConventional"]
    probe = setup["probes"][0]["conventionalRound"]
    instrument, rate, thickness = _read_unit(setup)
    u, v, t = (axes[name] for name in wanted)
    return UltrasonicScan(
        ascan / 100.0, time, 1.0 / float(t["resolution"]), float(t.get("offset", 0.0)),
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
