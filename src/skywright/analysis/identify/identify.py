"""Identify a robot from logs: the implementation of `skywright identify`."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from skywright.analysis.identify.fit import (
    CONFIDENCE,
    Estimate,
    Fit,
    compute_misfit,
    fit_parameters,
)
from skywright.analysis.identify.flight_log import FlightLog
from skywright.analysis.identify.lag import Lag, fit_rotor_lag, fit_servos
from skywright.analysis.identify.load import load_log
from skywright.analysis.identify.plausible import check_fit
from skywright.analysis.identify.signals import POSE, Columns, build_columns, find_stretches
from skywright.core.arrays import Array
from skywright.core.threads import on_one_thread
from skywright.description.robot.spec import Robot
from skywright.errors import InputError
from skywright.models.hover import read_numbers
from skywright.models.rigid_body import build_body_model, compute_body, posture

AXES = (
    "specific_force_x", "specific_force_y", "specific_force_z",
    "angular_acceleration_x", "angular_acceleration_y", "angular_acceleration_z",
)  # fmt: skip
LAGS = (0.0, 0.01, 0.02, 0.03, 0.04, 0.05, 0.06, 0.08, 0.1, 0.13)
"""s, rotor lags that are tried if a log holds commands but no speeds."""
FIRST_LAG = 0.05  # s, lag for the fit that selects the identifiable parameters


class Part(NamedTuple):
    """A used part of a log: free flight with a still arm."""

    log: str
    start_s: float  # from the log's first sample
    end_s: float


class Identification(NamedTuple):
    """Result of an identification from one or more flights."""

    robot: Robot
    logs: list[str]
    parts: list[Part]
    fit: Fit
    poses: Array  # (poses, joints) rad
    joints: tuple[str, ...]
    rotor_lag: Lag | None
    command_lag: float | None  # s, best lag if a log holds commands but no speeds
    servos: list[Lag]
    mass_given: bool
    notes: list[str]

    def to_json(self) -> dict[str, Any]:
        """Return the object of `--json`."""
        fit, p = self.fit, self.fit.prediction
        return {
            "robot": self.robot.name,
            "logs": self.logs,
            "used": [part._asdict() for part in self.parts],
            "samples": fit.samples,
            "confidence": CONFIDENCE,
            "mass_kg": fit.mass,
            "mass_source": "given" if self.mass_given else "robot file",
            "parameters": {e.parameter.name: _estimate(e) for e in fit.estimates},
            "poses_deg": [
                dict(zip(self.joints, np.degrees(q).tolist(), strict=True)) for q in self.poses
            ],
            "r_squared": dict(zip(AXES, p.r_squared(p.predicted).tolist(), strict=True)),
            "r_squared_nominal": dict(zip(AXES, p.r_squared(p.nominal).tolist(), strict=True)),
            "residual_rms": dict(zip(AXES, fit.noise.tolist(), strict=True)),
            "command_lag_s": self.command_lag,
            "rotor_lag": None if self.rotor_lag is None else _lag(self.rotor_lag),
            "servos": {lag.name: _lag(lag) for lag in self.servos},
            "not_identified": self.list_unknown(),
            "notes": self.notes,
        }

    def list_lags(self) -> list[Lag]:
        """Return the identified responses, the rotors' first."""
        lags = [self.rotor_lag, *self.servos]
        return [lag for lag in lags if lag is not None and lag.identified]

    def list_unknown(self) -> list[str]:
        """Return one text per quantity that was not identified."""
        out = []
        for e in self.fit.estimates:
            if not e.identified:
                p = e.parameter
                width = f"+- {e.would_be:.2g}" if math.isfinite(e.would_be) else "anything"
                out.append(
                    f"{p.name}: not excited enough (it could be {width} {p.unit}".rstrip()
                    + f"); kept at {p.nominal:.4g}"
                )
        if self.rotor_lag is None and self.command_lag is None:
            out.append("rotors' lag: the log lacks their speeds or their commands")
        elif self.rotor_lag is not None and not self.rotor_lag.identified:
            out.append(f"rotors' lag: {self.rotor_lag.reason}")
        out += [f"servo of {lag.name}: {lag.reason}" for lag in self.servos if not lag.identified]
        return out


def _estimate(e: Estimate) -> dict[str, Any]:
    p = e.parameter
    return {
        "value": e.value if e.identified else None,
        "half_width": e.half_width if e.identified else None,
        "unit": p.unit,
        "nominal": p.nominal,
        "identified": e.identified,
        "meaning": p.meaning,
    }


def _lag(lag: Lag) -> dict[str, Any]:
    values = lag._asdict()
    return {
        k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in values.items()
    }


@on_one_thread
def identify(
    paths: Sequence[Path], robot: Robot | None = None, mass: float | None = None
) -> Identification:
    """Identify a robot from one or more flights (further poses of the arm, more data).

    `robot` is required for a ULog or a table, and replaces that of a recording. `mass` (kg) is the
    weighed mass of the robot, default that of the robot file. Raises InputError without a log, for
    logs that cannot be read or belong to different robots, and if the model does not predict the
    flight (`plausible.check_fit`).
    """
    if not paths:
        raise InputError("no log; give at least one run directory, recording, ULog or table")
    number = np.ones(()) if mass is None else read_numbers(mass)
    if number is None or number.shape or not 0.0 < number < math.inf:
        raise InputError(f"--mass {mass!r}: give the mass of the robot in kg, above 0")
    logs = [load_log(path, robot) for path in paths]
    first = logs[0]
    for log, path in zip(logs, paths, strict=True):
        if log.robot.name != first.robot.name or log.joints != first.joints:
            raise InputError(
                f"{path}: was flown by {log.robot.name!r}, {paths[0]} by {first.robot.name!r}; "
                "give flights of one robot"
            )
    model = build_body_model(first.robot, first.gravity)
    nominal, _, _ = compute_body(model, posture(first.robot, "folded"))
    weight = nominal if mass is None else mass
    if not 0.3 < weight / nominal < 3.0:
        raise InputError(
            f"--mass {weight:g}: robot {first.robot.name!r} has {nominal:.3g} kg in its "
            "file; give the mass in kg, or the correct robot"
        )
    notes = sorted({note for log in logs for note in log.notes})
    columns, lag = _build_all(logs, weight)
    if lag is not None:
        notes.append(f"rotors' lag of {1e3 * lag:.0f} ms fits the commands best")
    fit = fit_parameters(columns, first.robot, weight, first.gravity)
    parts = [Part(log.name, *span) for log in logs for span in _list_used(log)]
    notes.append("used: " + _tell_parts(parts))
    notes += [
        f"R² about {axis} is {r:.2g} on held-out parts: the result of this axis is not used"
        for axis, r, unused in zip("xyz", fit.given_up_r2, fit.unused, strict=True)
        if unused
    ]
    check_fit(fit, first.robot, ", ".join(log.name for log in logs), notes)
    if mass is None:
        notes.append(
            f"the mass is taken from the robot file ({nominal:.4g} kg); gains, inertias "
            "and drag are proportional to it, so weigh the robot and give --mass"
        )
    longest = max(logs, key=lambda log: int(log.free.sum()))
    return Identification(
        first.robot, [log.name for log in logs], parts, fit, columns.poses, first.joints,
        fit_rotor_lag(longest), lag, _fit_servos(logs), mass is not None, notes,
    )  # fmt: skip


def _list_used(log: FlightLog) -> list[tuple[float, float]]:
    """Return the parts of a log that the fit uses, in s from its first sample."""
    found = find_stretches(log)
    return [(float(log.t[a] - log.t[0]), float(log.t[b - 1] - log.t[0])) for a, b in found]


def _tell_parts(parts: list[Part]) -> str:
    """Return the used parts of the logs as text; the three longest if there are more."""
    total = sum(p.end_s - p.start_s for p in parts)
    longest = sorted(parts, key=lambda p: p.start_s - p.end_s)[:3]
    each = ", ".join(f"{p.start_s:.1f} to {p.end_s:.1f} s of {p.log}" for p in longest)
    more = f" and {len(parts) - 3} shorter stretches" if len(parts) > 3 else ""
    return f"{total:.1f} s of free flight with a still arm: {each}{more}"


def _build_all(logs: list[FlightLog], mass: float) -> tuple[Columns, float | None]:
    """Return the columns of all logs, and the rotor lag (s) if it was searched for."""
    if all(log.rotor_speed is not None for log in logs):
        return _join([build_columns(log) for log in logs]), None
    robot, gravity = logs[0].robot, logs[0].gravity
    every = {lag: _join([build_columns(log, lag) for log in logs]) for lag in LAGS}
    first = fit_parameters(every[FIRST_LAG], robot, mass, gravity)
    free = np.array([e.identified for e in first.estimates])
    best = min(LAGS, key=lambda lag: compute_misfit(every[lag], robot, mass, gravity, free))
    return every[best], best


def _join(parts: list[Columns]) -> Columns:
    """Concatenate the columns of several logs; equal poses are merged."""
    poses: list[Array] = []
    out: list[Columns] = []
    start = 0.0
    for part in parts:
        index = []
        for q in part.poses:
            near = [i for i, p in enumerate(poses) if np.max(np.abs(p - q), initial=0.0) < POSE]
            if not near:
                poses.append(q)
            index.append(near[0] if near else len(poses) - 1)
        pose = np.array(index)[part.pose]
        out.append(part._replace(pose=pose, t=part.t + start))
        start = float(math.ceil((out[-1].t[-1] + 20.0) / 20.0) * 20.0)  # whole test blocks
    fields = [n for n in Columns._fields if n != "poses"]
    joined = {n: np.concatenate([getattr(p, n) for p in out]) for n in fields}
    return Columns(poses=np.array(poses), **joined)


def _fit_servos(logs: list[FlightLog]) -> list[Lag]:
    """Return the best fit of each servo over all flights."""
    found: dict[str, Lag] = {}
    for log in logs:
        for lag in fit_servos(log):
            old = found.get(lag.name)
            better = lag.identified and (
                old is None or not old.identified or lag.half_gain < old.half_gain
            )
            if old is None or better:
                found[lag.name] = lag
    return list(found.values())
