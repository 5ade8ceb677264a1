"""Load a flight for identification: a recording, a ULog (`ulog.py`) or a table (`table.py`)."""

import math
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from skywright.analysis.identify.flight_log import (
    FlightLog,
    align_signs,
    build_axis,
    find_rotations,
    find_sampled,
    leave_out_gaps,
)
from skywright.analysis.identify.table import load_table
from skywright.analysis.identify.ulog import load_ulog
from skywright.core.arrays import Array
from skywright.core.trust import guarded
from skywright.description.loader import Description, load_description
from skywright.description.robot.limbs import list_joints, list_servos, takes_torque
from skywright.description.robot.spec import Robot
from skywright.description.world.spec import World
from skywright.errors import InputError
from skywright.models.allocation import allocate, build_allocator, thrust_to_speed
from skywright.models.compliant_arms import count_command_ticks
from skywright.models.link_age import compute_mean_age
from skywright.models.rigid_body import build_body_model, compute_body, posture
from skywright.models.rotor_reaction import compute_reaction_times
from skywright.models.rotors import build_rotors
from skywright.recordings.columns import has_columns
from skywright.recordings.mcap_file import CUT
from skywright.recordings.recording import Recording, read_recording

TOUCHING = 1e-3  # m, deflection of the probe's spring in contact; less in free flight
SHORTEST = 5.0  # s, minimum duration of free flight
IDENTIFY_FIELDS = (
    "t", "phase", "est_q_WB", "est_v_WB", "est_w_WB_B", "rotor_speed", "cmd_f_B", "cmd_t_B", "q",
    "qd", "cmd_qd", "theta", "cmd_theta", "f_collision", "f_contact", "spring",
    "f_docking_W", "autopilot_command",
)  # fmt: skip
"""Columns that a log requires, as far as the recording has them."""


def load_log(path: Path, robot: Robot | None = None) -> FlightLog:
    """Load a run directory, a recording.mcap, a PX4 ULog or a table (these two need `robot`).

    Raises InputError if the file does not exist, has another format, or is too short.
    """
    if path.is_dir():
        path = path / "recording.mcap"
        if not path.is_file():
            raise InputError(f"{path.parent}: contains no recording.mcap; give a run directory")
    if not path.is_file():
        what = "is a device or pipe" if path.exists() else "no such file"
        raise InputError(f"{path}: {what}; give a run's directory, a recording, a ULog or a table")
    if path.suffix == ".ulg":
        log = load_ulog(path, robot)
    elif path.suffix == ".csv":
        log = load_table(path, robot)
    elif path.suffix == ".mcap":
        log = _load_recording(path, robot)
    else:
        raise InputError(
            f"{path}: unknown kind of log; valid: a run's directory, *.mcap, *.ulg, *.csv"
        )
    flown = log.period * int(np.sum(log.free))
    if flown < SHORTEST:
        raise InputError(
            f"{path}: contains {flown:.1f} s of free flight; at least {SHORTEST:g} s are required"
        )
    return log


def _load_recording(path: Path, robot: Robot | None) -> FlightLog:
    recording = read_recording(path)
    text = recording.attachments.get("mission.toml")
    if text is None:
        raise InputError(f"{path}: contains no mission.toml; give the recording of a run")
    description = parse_description(text)
    robot = robot or description.robot
    s = recording.samples
    if len(s) < 10:
        raise InputError(f"{path}: contains only {len(s)} samples; at least 10 are required")
    if not np.all(np.diff(s["t"]) > 0.0):
        raise InputError(
            f"{path}: the times of its samples do not rise; give the recording of a run"
        )
    if len(robot.rotors.azimuth_deg) != recording.info["n_rotors"]:
        raise InputError(
            f"{path}: was flown with {recording.info['n_rotors']} rotors; robot {robot.name!r} has "
            f"{len(robot.rotors.azimuth_deg)}"
        )
    joints = tuple(limb.name for limb in list_joints(robot))
    flown = tuple(recording.info["joint_names"])
    if joints != flown:
        raise InputError(
            f"{path}: was flown by {description.robot.name!r} with joints "
            f"{', '.join(flown) or 'none'}; robot {robot.name!r} has "
            f"{', '.join(joints) or 'none'}"
        )
    phases = _phase_names(recording, s["t"])
    name = path.parent.name or path.name
    log = build_log(name, robot, description.world, s, phases, flown, description.robot)
    if robot.name != description.robot.name:
        log = log._replace(notes=(
            f"{name} was flown by {description.robot.name!r}; its rotors and masses are read as "
            f"those of {robot.name!r}, which was given, the commands of its drives as those of "
            f"{description.robot.name!r}",
            *log.notes,
        ))  # fmt: skip
    return log if recording.complete else log._replace(notes=(*log.notes, CUT))


def parse_description(text: bytes) -> Description:
    """Return the description in a resolved mission.toml."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "mission.toml"
        file.write_bytes(text)
        with guarded("the recording"):
            return load_description(file)


def build_log(
    name: str,
    robot: Robot,
    world: World,
    s: NDArray[Any],
    phases: NDArray[np.str_],
    joints: tuple[str, ...],
    flown: Robot | None = None,
) -> FlightLog:
    """Build a log from samples (k,) of a run with the columns IDENTIFY_FIELDS, resampled evenly.

    `phases` (k,) names the phase of each sample. The times of the samples rise. `flown` is the
    robot file with which the robot flew, and from which its commands follow, default `robot`.
    """
    flown = flown or robot
    notes: list[str] = []
    stamps = s["t"]
    t = build_axis(name, stamps)
    place = np.interp(t, stamps, np.arange(len(s)))
    s, phases = _resample(s, place), phases[np.rint(place).astype(int)]
    n, rotors = len(joints), len(robot.rotors.azimuth_deg)
    positioned = any(servo.mode == "position" for _, servo in list_servos(robot))
    response = s["theta" if positioned else "qd"][:, :n]
    command = s["cmd_theta" if positioned else "cmd_qd"][:, :n]
    hold = _compute_servo_hold(flown, stamps) if positioned else _compute_hold(flown, world)
    if takes_torque(robot):  # a torque command has no lag in angle or speed
        response = np.zeros_like(response)
    R = find_rotations(s["est_q_WB"])
    free = (s["f_collision"] == 0.0) & ~np.any(s["f_contact"], axis=1) & (s["spring"] < TOUCHING)
    if has_columns(s, "f_docking_W"):
        free &= ~np.any(s["f_docking_W"], axis=1)
    free &= ~np.isin(phases, ["start", "take_off", "land"])
    free &= np.all(s["rotor_speed"][:, :rotors] > 1.0, axis=1)
    free = leave_out_gaps(free, find_sampled(stamps, t), t, notes)
    return FlightLog(
        name=name,
        robot=robot,
        t=t,
        free=free,
        v_WB=s["est_v_WB"],
        R_WB=R,
        w_WB_B=s["est_w_WB_B"],
        specific_force_B=None,
        rotor_speed=s["rotor_speed"][:, :rotors],
        rotor_command=_commanded_speeds(flown, world, s, t, R, n),
        command_is_thrust=False,
        joints=joints,
        q=s["q"][:, :n],
        servo_unit="rad" if positioned else "rad/s",
        servo_command=_delay(command, t, hold),
        servo_response=response,
        gravity=world.gravity_mps2,
        air_density=world.air_density_kg_m3,
        notes=tuple(notes),
    )


def _resample(s: NDArray[Any], place: Array) -> NDArray[Any]:
    """Return the columns IDENTIFY_FIELDS of samples (k,) at `place` (n,), fractions of an index.

    Columns of floats are interpolated; others have the value of the nearest sample.
    """
    fields = [name for name in IDENTIFY_FIELDS if has_columns(s, name)]
    out = s[fields][np.rint(place).astype(int)]
    before = np.minimum(place.astype(int), len(s) - 2)
    for name in fields:
        x = align_signs(s[name]) if name == "est_q_WB" else s[name]
        if x.dtype.kind == "f":
            share = (place - before).reshape(-1, *(1,) * (x.ndim - 1))
            out[name] = x[before] + share * (x[before + 1] - x[before])
    return out


def _phase_names(recording: Recording, t: Array) -> NDArray[np.str_]:
    """Return the phase of each sample from the events of the recording."""
    starts = [
        (e.t, e.text.removeprefix("phase ")) for e in recording.events if e.text[:6] == "phase "
    ]
    if not starts:
        return np.full(len(t), "")
    at = np.searchsorted([s[0] for s in starts], t + 1e-9) - 1
    return np.array([name for _, name in starts])[np.clip(at, 0, len(starts) - 1)]


def _commanded_speeds(
    robot: Robot, world: World, s: NDArray[Any], t: Array, R: Array, n: int
) -> Array:
    """Return the speeds (k, rotors) rad/s that the rotors were commanded.

    An autopilot commands shares of the full speed; `world.link` does not delay them. Otherwise they
    follow from the commanded wrench by the allocation. `t` (k,) s are the times of the samples `s`,
    R (k, 3, 3) their attitudes.
    """
    rotor_set = build_rotors(robot.rotors)
    tick = 1.0 / robot.control.rate_hz
    if has_columns(s, "autopilot_command"):
        full = np.sqrt(rotor_set.thrust_max / rotor_set.k_f)
        return _delay(s["autopilot_command"][:, : len(full)] * full, t, 0.5 * tick)
    a = build_allocator(rotor_set)
    model = build_body_model(robot, world.gravity_mps2)
    weight = world.gravity_mps2 * compute_body(model, posture(robot, "folded"))[0]
    reaction = float(compute_reaction_times(rotor_set, a, weight)[2])
    torque = s["cmd_t_B"].copy()
    torque[:, 2] = filter_yaw(torque[:, 2], t, reaction, tick)
    rotors = len(a.t_max)
    thrust, speed = np.zeros(rotors), np.zeros(rotors)
    out = np.zeros((len(s), rotors))
    com, last = np.zeros(3), None
    for i in range(len(s)):
        if last is None or np.max(np.abs(s["q"][i, :n] - last), initial=0.0) > 0.02:
            last = s["q"][i, :n].copy()
            com = compute_body(model, last)[1]
        allocate(
            a.B, a.P, a.t_min, a.t_max, a.full, s["cmd_f_B"][i].copy(), torque[i],
            np.ascontiguousarray(R[i, 2]), com, thrust,
        )  # fmt: skip
        thrust_to_speed(thrust + a.preload, rotors, a.k_f, speed)
        out[i] = speed
    return _delay(out, t, _compute_hold(robot, world))


def _delay(x: Array, t: Array, delay: float) -> Array:
    """Return the signals x (k, n) at the times `t` (k,) s, later by `delay` (s)."""
    out = np.empty(x.shape)
    for j in range(x.shape[1]):
        out[:, j] = np.interp(t - delay, t, x[:, j])
    return out


def _compute_hold(robot: Robot, world: World) -> float:
    """Return by how much (s) a law's commands take effect after their samples, in the mean.

    A command is recorded as it is sent, and held for a control tick: its effect is that of a
    continuous signal half a tick later. The link adds its delay.
    """
    tick = 1.0 / robot.control.rate_hz
    return 0.5 * tick + compute_mean_age(world.link, tick)


def _compute_servo_hold(robot: Robot, stamps: Array) -> float:
    """Return the time (s) by which to shift the commands of position servos (negative: earlier).

    A held command acts, on average, half a hold after it was sent. The samples at `stamps` (k,) s
    show it later than that, because each is recorded before the servo takes the command of its
    tick.
    """
    rate, every = robot.control.rate_hz, count_command_ticks(robot)
    age = (np.rint(stamps * rate) - 1.0) % every + 1.0  # ticks
    return float(0.5 * every - np.mean(age)) / rate


def filter_yaw(torque: Array, t: Array, reaction: float, tick: float) -> Array:
    """Return the torque about z (k,) N m that the allocation sends for a commanded one (k,).

    Rotors with the reaction time T = `reaction` (s, models/rotor_reaction.py) produce (1 + T s)
    times the torque that they are sent, so the allocation sends 1 / (1 + T s) times the command if
    T is positive. `t` (k,) s are the times of the samples. The filter runs at the control period
    `tick` (s), as in flight: at the interval of the samples, its lag would differ by up to half an
    interval.
    """
    if reaction <= 0.0:
        return torque
    ticks = np.arange(t[0], t[-1] + tick, tick)
    share = 1.0 - math.exp(-tick / reaction)
    sent = lfilter([share], [1.0, share - 1.0], np.interp(ticks, t, torque))
    return np.interp(t, ticks, sent)
