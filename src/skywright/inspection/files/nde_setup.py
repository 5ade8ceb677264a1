"""The JSON texts of an .nde file, version 4.3: its properties and its set-up."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from skywright.inspection.files.nde import EddyScan, UltrasonicScan

VERSION = "4.3.0"
FULL = 32767
"""The int16 value of full screen height."""
SIMULATED = "SIMULATED: computed from models, not measured"
GROUP = "/Public/Groups/0/Datasets/"
ENCODERS = "/Public/DataMappings/0/Datasets/"


def build_properties(ultrasonic: bool, simulated: bool) -> dict[str, Any]:
    """Return the properties of a file."""
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


def build_ultrasonic(scan: UltrasonicScan) -> dict[str, Any]:
    """Return the set-up of a grid of A-scans."""
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


def build_eddy(scan: EddyScan) -> dict[str, Any]:
    """Return the set-up of an impedance over the acquisition cycles."""
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
