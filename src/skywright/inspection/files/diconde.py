"""Write results as DICONDE-style files: DICOM, attributes renamed for components (ASTM E2339).

One file contains the readings and indications of one component and flight as a UT or ET result. The
tags are those of the DICOM dictionary, including group 0014. The files are called DICONDE-style
because nothing checks conformance to E2663 (UT) or E2934 (ET). pydicom is an extra.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from skywright.errors import InputError
from skywright.inspection.history.entries import (
    StoredCalibration,
    StoredComponent,
    StoredFlight,
    StoredIndication,
    StoredReading,
)

EDDY_CURRENT = "1.2.840.10008.5.1.4.1.1.601.1"  # Eddy Current Image Storage
ULTRASOUND = "1.2.840.10008.5.1.4.1.1.6.1"  # Ultrasound Image Storage (assumed for UT)
IMPLEMENTATION = "1.2.826.0.1.3680043.10.1700"


class Result(NamedTuple):
    """The contents of one file."""

    asset: str
    component: StoredComponent
    flight: StoredFlight
    calibrations: Sequence[StoredCalibration]
    readings: Sequence[StoredReading]
    indications: Sequence[StoredIndication]


def write_diconde(result: Result, path: Path) -> None:
    """Write a result.

    Raises InputError if pydicom is missing, if the result has no readings, indications or
    calibrations, or if the file cannot be written.
    """
    try:
        from pydicom.dataset import Dataset, FileMetaDataset
        from pydicom.uid import UID, ExplicitVRLittleEndian, generate_uid
    except ImportError:
        raise InputError(
            "DICONDE-style files need pydicom: pip install 'skywright[dicom]'"
        ) from None
    if not (result.readings or result.indications or result.calibrations):
        raise InputError(
            f"flight {result.flight.id}: no readings, indications or calibrations of component "
            f"{result.component.name!r}"
        )
    methods = {c.calibrated.method for c in result.calibrations}
    eddy = methods == {"ET"} or (not methods and not result.readings)
    meta = FileMetaDataset()
    meta.MediaStorageSOPClassUID = UID(EDDY_CURRENT if eddy else ULTRASOUND)
    meta.MediaStorageSOPInstanceUID = generate_uid()
    meta.TransferSyntaxUID = ExplicitVRLittleEndian
    meta.ImplementationClassUID = UID(IMPLEMENTATION)
    d = Dataset()
    d.file_meta = meta
    d.SpecificCharacterSet = "ISO_IR 192"  # UTF-8; without it, DICOM permits ASCII only
    d.SOPClassUID, d.SOPInstanceUID = meta.MediaStorageSOPClassUID, meta.MediaStorageSOPInstanceUID
    d.StudyInstanceUID, d.SeriesInstanceUID = generate_uid(), generate_uid()
    d.Modality = "ES" if eddy else "US"
    # E2339: the component takes the place of the patient
    names = (_write_text(name, "\\^=") for name in (result.component.name, result.asset))
    d.PatientName = "^".join(names)[:64]
    d.PatientID = _write_text(f"{result.asset}/{result.component.name}")
    d.PatientBirthDate, d.PatientSex = "", "O"
    date, _, time = result.flight.started_utc.partition("T")
    d.StudyDate, d.StudyTime = date.replace("-", ""), time[:8].replace(":", "")
    d.StudyID = result.flight.id
    d.AccessionNumber, d.ReferringPhysicianName = "", ""
    d.SeriesNumber, d.InstanceNumber = 1, 1
    d.SeriesDescription = "SIMULATED" if result.flight.simulated else "measured"
    d.ImageComments = (
        "SIMULATED: computed from models, not measured. " if result.flight.simulated else ""
    ) + "DICONDE-style result; conformance to ASTM E2663 or E2934 was not checked."
    if result.component.material:
        d.MaterialNotes = result.component.material
    if result.component.nominal_mm is not None:
        d.MaterialThickness = _write_number(result.component.nominal_mm)
    _add_equipment(d, result.calibrations)
    d.EvaluatorSequence = [_build_evaluation(result, Dataset)]
    partial = path.with_name(path.name + ".partial")
    try:
        d.save_as(partial, enforce_file_format=True)
        partial.replace(path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from None


def _write_text(text: str, separators: str = "\\", length: int = 64) -> str:
    """Return a text as one DICOM LO or SH of at most `length` characters.

    A separator would divide the text into several values (or a name into its parts, with ^ and =).
    """
    return text.translate({ord(c): "/" for c in separators})[:length]


def _write_number(value: float) -> str:
    """Return a number as a DICOM DS of at most 16 characters."""
    return f"{value:.8g}"[:16]


def _add_equipment(d: Any, calibrations: Sequence[StoredCalibration]) -> None:
    from pydicom.dataset import Dataset

    settings = []
    for c in calibrations:
        one, item = c.calibrated, Dataset()
        d.Manufacturer, d.ManufacturerModelName = "", _write_text(one.model)
        d.DeviceSerialNumber = _write_text(one.serial)
        numbers = "; ".join(f"{k} {v}" for k, v in one.settings.items())
        item.CalibrationProcedure = (
            f"{one.stage} the flight, {one.block}: {'passed' if one.passed else 'FAILED'}"
            + (f"; {numbers}" if numbers else "") + (f"; {one.note}" if one.note else "")
        )  # fmt: skip
        date, _, time = c.time_utc.partition("T")
        item.CalibrationDate = date.replace("-", "")
        item.CalibrationTime = time[:8].replace(":", "")
        settings.append(item)
    if settings:
        d.CalibrationSettingsSequence = settings


def _build_evaluation(result: Result, dataset: Any) -> Any:
    """Return an evaluator whose indication sequence has an item per reading and indication."""
    evaluator = dataset()
    items: list[Any] = []
    evaluator.EvaluatorNumber = 1
    for r in result.readings:
        item, one = dataset(), r.reading
        value = "none" if one.value is None else f"{one.value:.3f} {one.unit}"
        u95 = "" if one.u95 is None else f" +- {one.u95:.3f} (95 %)"
        state = "accepted" if one.accepted else f"refused: {one.reason}"
        item.IndicationNumber = len(items) + 1
        item.IndicationLabel = _write_text(one.spot or f"reading {r.id}", length=16)
        item.IndicationDescription = f"{one.quantity} {value}{u95}; {state}"
        item.IndicationType = "MEASUREMENT"
        _place(item, one.x_m, one.y_m, one.z_m)
        items.append(item)
    for i in result.indications:
        item, found = dataset(), i.indication
        sizes = [
            f"{name} {value:.2f} mm"
            for name, value in (("length", found.length_mm), ("depth", found.depth_mm))
            if value is not None
        ]
        item.IndicationNumber = len(items) + 1
        item.IndicationLabel = f"ind. {i.id}"
        item.IndicationDescription = ", ".join([found.kind, *sizes])
        item.IndicationType = found.kind.upper()[:16]
        item.IndicationDisposition = i.disposition.upper()[:16]
        _place(item, found.x_m, found.y_m, found.z_m)
        items.append(item)
    evaluator.IndicationSequence = items
    return evaluator


def _place(item: Any, x: float, y: float, z: float) -> None:
    item.IndicationDescription += f"; at x {x:.4f}, y {y:.4f}, z {z:.4f} m in the asset's frame"
