"""Read the scan from a run's recording in the form of an instrument's file."""

import re
from pathlib import Path

import numpy as np

from skywright.errors import InputError
from skywright.inspection.scan_file import MIN_ROWS, Scan
from skywright.recordings.columns import has_columns
from skywright.recordings.mcap_file import CUT
from skywright.recordings.recording import read_recording

CALIBRATING, SCANNING = ("touch", "settle"), "scan"
"""Phases of a mission of kind "scan": from air to contact, and sliding on the surface."""
SIGNALS = ("t", "ec", "meas_p_WT")


def is_recording(path: Path) -> bool:
    """Return whether a path is a run's directory or recording."""
    return path.is_dir() or path.suffix == ".mcap"


def load_recorded_scan(path: Path) -> tuple[Scan, tuple[float, float]]:
    """Return the data of instrument and motion capture, and the time span (s) of the calibration.

    The data cover the last touch before the first scan phase, and all touch and scan phases after
    it. The calibration is that last touch. `path` is a run's directory or its recording. Raises
    InputError if it contains no scan.
    """
    file = path / "recording.mcap" if path.is_dir() else path
    recording = read_recording(file)
    s = recording.samples
    missing = [name for name in SIGNALS if not has_columns(s, name)]
    if missing:
        raise InputError(f"{file}: has no column {missing[0]}; valid: the recording of a scan")
    starts = [
        (e.t, m.group(1)) for e in recording.events if (m := re.fullmatch(r"phase (.+)", e.text))
    ]
    names = [name for _, name in starts]
    if SCANNING not in names:
        raise InputError(f"{file}: the run did not reach the scan: there is no phase 'scan'")
    first = names.index(SCANNING)
    begin = first
    while begin > 0 and names[begin - 1] in CALIBRATING:
        begin -= 1
    ends = [t for t, _ in starts[1:]] + [float(s["t"][-1]) + 1.0]
    keep = np.zeros(len(s), bool)
    for i in range(begin, len(starts)):
        if names[i] in (*CALIBRATING, SCANNING):
            keep |= (s["t"] >= starts[i][0]) & (s["t"] < ends[i])
    keep &= np.all(np.isfinite(s["meas_p_WT"]), axis=1)
    if np.count_nonzero(keep) < MIN_ROWS or begin == first:
        raise InputError(f"{file}: the recording of touch and scan is too short")
    notes = [f"of {recording.info.get('mission', 'a run')}, from its recording"]
    if not recording.complete:
        notes.append(CUT)
    s = s[keep]
    scan = Scan(s["t"], s["ec"], s["meas_p_WT"], None, tuple(notes))
    return scan, (starts[begin][0], ends[first - 1])
