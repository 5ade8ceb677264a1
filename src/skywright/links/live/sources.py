"""Sources of the player: a run's recording and a scan file; trajectories come from the caller."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from skywright.core.rotations import quat_from_rot
from skywright.errors import InputError
from skywright.inspection.recorded_scan import is_recording, load_recorded_scan
from skywright.inspection.scan_file import Scan, load_scan
from skywright.links.live.player import Track
from skywright.recordings.recording import read_recording

Array = NDArray[np.float64]


def load_run_tracks(path: Path) -> list[Track]:
    """Return the tracks of a run's recording: tip and signal of a scan, wrench, true platform pose.

    Raises InputError if it has none of them.
    """
    samples = read_recording(path / "recording.mcap" if path.is_dir() else path).samples
    names = samples.dtype.names or ()
    tracks: list[Track] = []
    if "ec" in names and "meas_p_WT" in names:
        with suppress(InputError):  # the flight did not reach its scan
            tracks += build_scan_tracks(load_recorded_scan(path)[0], str(path))
    if "wrench_force" in names:
        values = np.hstack([samples["wrench_force"], samples["wrench_torque"]])
        tracks.append(_keep_finite(Track("SKYFT", "wrench", samples["t"], values, str(path))))
    if "p_WB" in names:
        values = np.hstack([samples["p_WB"], samples["q_WB"]])
        tracks.append(_keep_finite(Track("pose", "truth", samples["t"], values, str(path))))
    if not tracks:
        raise InputError(f"{path}: holds no poses, eddy-current signal or wrench to play")
    return tracks


def load_scan_tracks(path: Path, columns: str | None = None) -> list[Track]:
    """Return signal and tip of a scan file; raises InputError as `weld` does."""
    return build_scan_tracks(load_scan(path, columns), str(path))


def build_scan_tracks(scan: Scan, source: str) -> list[Track]:
    """Return the signal, and the tip as poses if the probe's axis is known."""
    signal = Track("SKYEC", "eddy", scan.t, scan.ec, source)
    if scan.axis_W is None or not np.all(np.isfinite(scan.axis_W)):
        return [signal, Track("position", "tip", scan.t, scan.p_WT, source)]
    q = np.array([quat_from_rot(_build_frame(axis)) for axis in scan.axis_W])
    return [signal, Track("pose", "tip", scan.t, np.hstack([scan.p_WT, q]), source)]


def is_scan(path: Path) -> bool:
    """Whether a text file's header names a signal: `re` and `im`."""
    try:
        with path.open("rb") as file:
            head = file.read(4096).decode("utf-8", errors="replace").lower()
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    for line in head.splitlines():
        if line.strip() and not line.lstrip().startswith(("#", "%", "//")):
            cells = {c.strip() for c in line.replace(";", ",").replace("\t", ",").split(",")}
            return {"re", "im"} <= cells
    return False


def is_run(path: Path) -> bool:
    """Whether a path is a run's directory or recording."""
    return is_recording(path)


def _build_frame(axis: Array) -> Array:
    """Return a rotation whose z is `axis` (3,); the rotation about it is arbitrary."""
    z = axis / np.linalg.norm(axis)
    x = np.cross(z, [0.0, 0.0, 1.0] if abs(z[2]) < 0.9 else [1.0, 0.0, 0.0])
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def _keep_finite(track: Track) -> Track:
    keep = np.all(np.isfinite(track.values), axis=1)
    return track._replace(t=track.t[keep], values=track.values[keep])
