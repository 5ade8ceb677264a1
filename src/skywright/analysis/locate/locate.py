"""Implementation of `skywright locate`: from files to a trajectory and its errors."""

import math
import os
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from skywright.analysis.locate.fusion import (
    Events,
    describe_jumps,
    find_outages,
    fuse,
    fuse_as_printed,
    prepare_camera,
)
from skywright.analysis.locate.outages import Outage, measure_outages
from skywright.analysis.locate.point_file import pair_points
from skywright.analysis.locate.roles import assign_roles
from skywright.analysis.locate.station_frame import StationPose, estimate_station_pose
from skywright.analysis.locate.trajectory_error import (
    ALIGNMENTS,
    Statistics,
    TrajectoryError,
    compute_error,
    judge,
)
from skywright.core.arrays import Array, Mask
from skywright.errors import InputError
from skywright.models.hover import read_numbers
from skywright.models.localisation.calibration import Calibration, calibrate
from skywright.models.localisation.drift_filter import CAMERA, STATION, DriftModel, Fused
from skywright.models.localisation.frame_alignment import METHODS
from skywright.models.localisation.time_alignment import (
    TimeAlignment,
    estimate_offset,
)
from skywright.models.localisation.trajectory import (
    Trajectory,
    find_covered,
    find_gap_limit,
    interpolate_rotation,
)
from skywright.recordings.text_table import parse_span


class Fusion(NamedTuple):
    """Fusion of station and camera."""

    station: Trajectory
    camera: Trajectory
    time: TimeAlignment | None  # None: the offset was given
    calibration: Calibration
    model: DriftModel
    events: Events
    fused: Fused
    paper: Array  # (n, 3) m, the paper's filter over the same events
    outages: list[Outage]
    pose: StationPose | None  # of the station, in the time-consistent frame


class LocateReport(NamedTuple):
    """Result of a localisation."""

    trajectory: Trajectory  # the result: fused, or the evaluated one
    std: Array | None  # (n,) m, three-dimensional, of the fused one
    point: str  # point of the robot that the trajectory describes
    fusion: Fusion | None
    reference: Trajectory | None
    errors: dict[str, TrajectoryError]  # by name: fused, paper filter, aligned camera; trajectory
    notes: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """Return the object of `skywright locate --json`."""
        found: dict[str, Any] = {
            "trajectory": self.trajectory.name,
            "point": self.point,
            "samples": len(self.trajectory.t),
            "start_s": float(self.trajectory.t[0]),
            "duration_s": round(self.trajectory.duration, 4),
        }
        if self.fusion is not None:
            found |= _describe_fusion(self.fusion)
            if self.std is not None:
                found["std_m"] = _round(float(np.median(self.std)))
        found["reference"] = None if self.reference is None else self.reference.name
        found["errors"] = {name: describe_error(e) for name, e in self.errors.items()}
        found["notes"] = list(self.notes)
        return found


def _round(x: float | None, digits: int = 6) -> float | None:
    return None if x is None or not math.isfinite(x) else round(float(x), digits)


def _describe_fusion(f: Fusion) -> dict[str, Any]:
    c = f.calibration
    q = np.roll(Rotation.from_matrix(c.frame.rotation).as_quat(), 1)
    pose = None
    if f.pose is not None:
        pose = {
            "p_m": [_round(x) for x in f.pose.p_WS],
            "rotation_wxyz": [
                _round(x, 9) for x in np.roll(Rotation.from_matrix(f.pose.R_WS).as_quat(), 1)
            ],
            "sigma_mm": _round(1e3 * f.pose.sigma, 4),
            "chi2": _round(f.pose.chi2, 4),
            "chi2_limit": _round(f.pose.chi2_limit, 4),
            "points": [
                {
                    "name": p.name, "residual_mm": [_round(1e3 * x, 3) for x in p.residual],
                    "statistic": _round(p.statistic, 3), "redundancy": _round(p.redundancy, 4),
                    "detectable_mm": _round(1e3 * p.detectable, 2), "used": p.used,
                }
                for p in f.pose.points
            ],
        }  # fmt: skip
    return {
        "station": f.station.name,
        "camera": f.camera.name,
        "time_offset_s": _round(c.time_offset),
        "time_offset_std_s": _round(c.offset_std),
        "clock_skew": _round(c.skew, 9),
        "frame": {
            "method": c.frame.method,
            "rotation_wxyz": [_round(x, 9) for x in q],
            "scale": _round(c.frame.scale, 9),
            "offset_m": [_round(x) for x in c.frame.offset],
            "matrix": [[_round(x, 9) for x in row] for row in c.frame.matrix],
            "rotation_std_deg": _round(math.degrees(c.rotation_std)),
            "scale_std": _round(c.scale_std),
            "rms_m": _round(c.rms),
        },
        "prism_m": [_round(x, 5) for x in c.p_BP],
        "calibration": {
            "span_s": [_round(x) for x in c.span],
            "pairs": c.pairs,
            "outliers": c.outliers,
            "geometry": c.geometry.kind,
            "extent_m": [_round(x, 4) for x in c.geometry.extent],
        },
        "noise": {
            "station_mm": _round(1e3 * c.noise.station, 4),
            "camera_mm": _round(1e3 * f.model.camera, 4),
            "drift_m_per_sqrt_s": _round(c.noise.per_sqrt_s),
            "drift_m_per_sqrt_m": _round(c.noise.per_sqrt_m),
        },
        "rejected": int(np.count_nonzero(~f.fused.accepted & (f.fused.kind == STATION))),
        "camera_jumps": int(np.count_nonzero(~f.fused.accepted & (f.fused.kind == CAMERA))),
        "outages": [
            {
                "start_s": _round(o.start), "end_s": _round(o.end), "fused_m": _round(o.fused),
                "paper_filter_m": _round(o.paper), "aligned_camera_m": _round(o.camera),
            }
            for o in f.outages
        ],
        "station_pose": pose,
    }  # fmt: skip


def describe_error(e: TrajectoryError) -> dict[str, Any]:
    """Return errors against a reference as plain numbers."""

    def plain(s: Statistics | None, factor: float = 1.0) -> dict[str, Any] | None:
        if s is None:
            return None
        values = {name: _round(factor * getattr(s, name)) for name in s._fields[:-1]}
        return {**values, "samples": s.samples}

    return {
        "absolute_m": plain(e.absolute),
        "relative_m": plain(e.relative),
        "relative_deg": plain(e.relative_angle, 180.0 / math.pi),
        "relative_over_s": e.over,
        "alignment": "none" if e.frame is None else e.frame.method,
        "scale": _round(e.frame.scale, 9) if e.frame is not None else 1.0,
        "time_offset_s": _round(e.time_offset),
    }


def parse_vector(text: str, flag: str) -> Array:
    """Parse 'X,Y,Z' in metres."""
    try:
        v = np.array([float(part) for part in text.split(",")])
    except ValueError:
        v = np.array([math.nan])
    if v.shape != (3,) or not np.all(np.abs(v) < 100.0):
        raise InputError(
            f"{flag}: {text[:60]!r} is not a position on a robot; valid: X,Y,Z in metres, "
            "such as 0.05,0,0.12"
        )
    return v


def locate(
    data: list[str],
    *,
    station: str | None = None,
    camera: str | None = None,
    reference: str | None = None,
    align: str = "similarity",
    span: str | None = None,
    time_offset: float | None = None,
    prism: str | None = None,
    frame: tuple[str | os.PathLike[str], str | os.PathLike[str]] | None = None,
    compare: str = "rigid",
    reference_offset: float | None = None,
) -> LocateReport:
    """Fuse a station's and a camera's recording, or evaluate one trajectory against a reference.

    Texts as on the command line. Raises InputError with one line for wrong input.
    """
    if align not in METHODS:
        raise InputError(f"--align {align}; valid: {', '.join(METHODS)}")
    if compare not in ALIGNMENTS:
        raise InputError(f"--compare {compare}; valid: {', '.join(ALIGNMENTS)}")
    offsets: list[float | None] = []
    for flag, value in (("time", time_offset), ("reference", reference_offset)):
        seconds = np.zeros(()) if value is None else read_numbers(value)
        if seconds is None or seconds.shape or not abs(seconds) < 1e12:
            raise InputError(f"--{flag}-offset {value!r}; valid: a number of seconds")
        offsets.append(None if value is None else float(seconds))
    time_offset, reference_offset = offsets
    chosen = (
        parse_span(span, "after the station's first sample", "0:30") if span is not None else None
    )
    lever = parse_vector(prism, "--prism") if prism is not None else None
    pose = None
    if frame is not None:
        files = frame if isinstance(frame, tuple | list) else ()
        if len(files) != 2 or not all(isinstance(file, str | os.PathLike) for file in files):
            raise InputError(f"frame: {frame!r}; valid: two files of points (known, measured)")
        pose = estimate_station_pose(*pair_points(Path(files[0]), Path(files[1])))
    roles = assign_roles(data, station, camera, reference)
    notes = list(roles.notes)
    for traj in (roles.station, roles.camera, roles.reference):
        if traj is not None:
            notes += [f"{traj.name}: {note}" for note in traj.notes]
    if roles.station is None:
        flags = {
            "--calibrate": span, "--prism": prism, "--frame": frame, "--time-offset": time_offset
        }  # fmt: skip
        unused = [flag for flag, value in flags.items() if value is not None]
        if unused:
            hint = "; valid here: --reference-offset" if unused[0] == "--time-offset" else ""
            raise InputError(f"{unused[0]} needs a station's and a camera's file{hint}")
        assert roles.reference is not None
        error = judge(roles.camera, roles.reference, compare, reference_offset, notes)
        return LocateReport(
            roles.camera, None, "as recorded", None, roles.reference, {"trajectory": error},
            tuple(notes),
        )  # fmt: skip
    fusion = bring_together(
        roles.station, roles.camera, align=align, span=chosen, time_offset=time_offset,
        lever=lever, pose=pose, notes=notes,
    )  # fmt: skip
    trajectory, std = build_result(fusion, lever is not None)
    errors: dict[str, TrajectoryError] = {}
    if roles.reference is not None:
        errors["fused"] = judge(trajectory, roles.reference, compare, reference_offset, notes)
        at = errors["fused"].time_offset
        for name, other in build_rivals(fusion, lever is not None).items():
            errors[name] = compute_error(other, roles.reference, time_offset=at, alignment=compare)
    point = "camera" if lever is not None else "prism"
    return LocateReport(trajectory, std, point, fusion, roles.reference, errors, tuple(notes))


def bring_together(
    station: Trajectory,
    camera: Trajectory,
    *,
    align: str,
    span: tuple[float, float] | None,
    time_offset: float | None,
    lever: Array | None,
    pose: StationPose | None,
    notes: list[str],
) -> Fusion:
    """Align, calibrate and filter; append doubtful results to `notes`."""
    if pose is not None:
        station = station._replace(p=pose.apply(station.p))
        notes += list(pose.notes)
    camera = prepare_camera(camera, notes)
    time = None
    if time_offset is None:
        time = estimate_offset(station, camera)
        notes += [time.note] if time.note else []
        offset = time.offset
    else:
        offset = time_offset
    first = float(station.t[0])
    cal = calibrate(
        station, camera, offset, method=align, p_BP=lever,
        fixed_time=time is None or time.peak == 0.0,
        span=None if span is None else (first + span[0], first + span[1]),
    )  # fmt: skip
    notes += list(cal.notes)
    if cal.outliers > 0:
        notes.append(f"{cal.outliers} of {cal.pairs + cal.outliers} samples left out of the "
                     "calibration as outliers")  # fmt: skip
    events, fused, model = fuse(station, camera, cal)
    grown = model.yaw / DriftModel(0.0, 0.0, 0.0, 0.0).yaw
    if grown > 1.0:
        notes.append(
            f"without the station, the camera's drift is {grown:.2g} times that of the "
            "calibration; the stated standard deviations include this factor"
        )
    notes += describe_jumps(fused)
    paper = fuse_as_printed(events)
    lost = np.count_nonzero(~fused.accepted & (fused.kind == STATION))
    if lost:
        notes.append(f"{lost} of the station's samples rejected as outliers while filtering")
    spans = find_outages(station, float(station.t[0]), float(events.t[-1]))
    outages = measure_outages(spans, events, fused, paper, notes)
    return Fusion(station, camera, time, cal, model, events, fused, paper, outages, pose)


def _select(f: Fusion) -> Mask:
    """Return the mask of the events in the result: the camera's, else the station's."""
    t_cam = f.events.t[f.events.kind == CAMERA]
    gap = find_gap_limit(t_cam, 0.05)
    alone = ~find_covered(t_cam, f.events.t, gap)
    keep = (f.events.kind == CAMERA) | alone
    keep[1:] &= np.diff(f.events.t) > 0
    return np.asarray(keep)


def build_result(f: Fusion, at_camera: bool) -> tuple[Trajectory, Array]:
    """Return the fused trajectory in W on the station's clock, and its standard deviation (n,) m.

    It describes the prism, or the camera if the position of the prism is given.
    """
    keep = _select(f)
    p = f.fused.p - f.events.lever if at_camera else f.fused.p
    q = None
    t = f.events.t[keep]
    turn = interpolate_rotation(f.camera, f.calibration.to_camera_time(t))
    if turn is not None:
        turned = Rotation.from_rotvec(f.fused.turn[keep]).as_matrix()
        R = turned @ f.calibration.frame.rotation @ turn
        q = np.roll(Rotation.from_matrix(R).as_quat(), 1, axis=1)
    name = f"{f.station.name} with {f.camera.name}"
    return (
        Trajectory(name, t, p[keep], q),
        np.asarray(np.linalg.norm(f.fused.p_std[keep], axis=1)),
    )


def build_rivals(f: Fusion, at_camera: bool) -> dict[str, Trajectory]:
    """Return the trajectories for comparison: the paper's filter, and the aligned camera."""
    keep = _select(f)
    lever = f.events.lever if at_camera else np.zeros_like(f.events.lever)
    camera = keep & (f.events.kind == CAMERA)
    return {
        "paper filter": Trajectory("paper filter", f.events.t[keep], (f.paper - lever)[keep]),
        "aligned camera": Trajectory(
            "aligned camera", f.events.t[camera], (f.events.z - lever)[camera]
        ),
    }
