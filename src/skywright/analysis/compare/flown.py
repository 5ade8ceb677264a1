"""Measurements by flights: collisions, and the accuracy of the tip in wind."""

import math
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from skywright.analysis.compare.comparison import Collision, Hover, Install
from skywright.analysis.compare.geometry import PipeDistance
from skywright.core.arrays import Array
from skywright.core.types import TASK_POSITION
from skywright.description.loader import Description, load_description
from skywright.description.robot.limbs import list_joints
from skywright.errors import SkywrightError
from skywright.models.compliant_arms import find_hands
from skywright.models.rigid_body import build_body_model
from skywright.recordings.columns import has_columns
from skywright.run.backends import build_vehicle
from skywright.run.metrics import in_phases
from skywright.run.run import fly_and_evaluate
from skywright.vehicle.arms_interface import Arms
from skywright.vehicle.guard import LOST_CONTROL
from skywright.vehicle.interface import WholeBody
from skywright.vehicle.moves import Moves
from skywright.vehicle.simulated import SimulatedVehicle

WINDS = (0.0, 1.0, 2.0, 3.0)  # m/s
HEIGHT = 2.5  # m
SETTLE_S, WATCH_S = 8.0, 15.0


class _Lost(Exception):
    """The robot no longer follows its reference."""


class Still(NamedTuple):
    """A hover: rms distances from the references (NaN: control was lost), mean deflection of
    springs."""

    tip: float  # m
    platform: float  # m
    deflection: Array  # (n_joints,) rad


def list_collisions(springs: bool, link: bool) -> list[str]:
    """Return the impacting parts: a hand (with springs also without them), and a passive link."""
    return [*["hand, stiff joints"] * springs, "hand", *["passive link"] * link]


def fly_collision(robot: str, name: str) -> Collision:
    """Fly `impact` with a part that `list_collisions` names."""
    sets = {
        "mission.task.joints": "stiff" if "stiff" in name else "compliant",
        "mission.task.part": "link" if "link" in name else "arm",
    }
    try:
        result = fly_and_evaluate(load_description("impact", robot, sets=sets))
    except SkywrightError as error:
        return Collision(name, {}, str(error))
    met = {k: v for k, v in result.metrics.items() if k.startswith("impact.")}
    return Collision(name, met, "" if met else result.reason or "nothing was touched")


def fly_install(d: Description) -> Install:
    """Fly sensor-install and compute the distances to the pipe between take-off and landing."""
    try:
        result = fly_and_evaluate(d)
    except SkywrightError as error:
        return Install({}, math.nan, math.nan, str(error))
    met = {k: v for k, v in result.metrics.items() if math.isfinite(v)}
    missed = [f"{r.name} {_write(r.value)} {r.unit}".strip()
              for r in result.requirements if not r.passed]  # fmt: skip
    reason = result.reason or ("flown, but not met: " + ", ".join(missed) if missed else "")
    s = result.samples[~in_phases(result.samples, result.phases, "start", "take_off", "land")]
    if not len(s):
        return Install(met, math.nan, math.nan, reason)
    ask, n = PipeDistance(d), len(list_joints(d.robot))
    R = Rotation.from_quat(np.roll(s["q_WB"], -1, axis=1)).as_matrix()
    near = [
        ask(p, np.ascontiguousarray(r), q)
        for p, r, q in zip(s["p_WB"][::10], R[::10], s["q"][::10, :n].copy(), strict=True)
    ]
    propellers, gear = np.min(near, axis=0)
    return Install(met, float(propellers), float(gear), reason)


def build_hover(found: list[tuple[float, float]]) -> Hover:
    """Arrange results of `hover_once`, ordered by wind of WINDS, then seed, as a table."""
    both = np.array(found, float).reshape(len(WINDS), -1, 2)
    return Hover(np.array(WINDS), both[..., 0], both[..., 1])


def hover_once(robot: str, q: Array, wind: float, seed: int) -> tuple[float, float]:
    """Return the rms distances (m) of tip and platform from their references; NaN: control lost."""
    found = hover_in(robot, q, wind, seed, {})
    return found.tip, found.platform


def hover_in(robot: str, q: Array, wind: float, seed: int, sets: dict[str, object]) -> Still:
    """Hover once in gusty wind with mean speed `wind` (m/s) and joints at q (n_joints,) rad."""
    if wind > 0.0:
        sets = {**sets, "world.wind": {"kind": "dryden", "mean_mps": wind, "toward_deg": 45.0}}
    lost = Still(math.nan, math.nan, np.full(len(q), math.nan))
    d = load_description("waypoints", robot, "open", sets, seed)
    blocks: list[Any] = []
    vehicle = build_vehicle(d, blocks.append)
    try:
        goal, place = _settle(vehicle, q)
        vehicle.flush()
        blocks.clear()
        _wait(vehicle, WATCH_S)
        vehicle.flush()
    except (_Lost, SkywrightError):
        return lost
    s = np.concatenate(blocks)
    at = s["left_p_WH"] if "hands" in vehicle.offers else s["p_WT"]
    wound = np.zeros(len(q))
    if has_columns(s, "deflection"):
        wound = s["deflection"].mean(axis=0)
    return Still(_rms(at - goal), _rms(s["p_WB"] - place), wound)


def _settle(vehicle: SimulatedVehicle, q: Array) -> tuple[Array, Array]:
    """Take off, move the arms to q; return the references of tip and platform, each (3,) m."""
    uav, arms = Moves(vehicle), Arms(vehicle)
    _wait(vehicle, 1.0)
    uav.motors(True)
    uav.take_off(HEIGHT)
    _arrive(vehicle)
    arms.move_to(q)
    _arrive(vehicle)
    model = build_body_model(vehicle.robot, vehicle.world.gravity_mps2)
    row = np.array(vehicle.reference)
    place = row["p_WB"].copy()
    goal = place + row["R_WB"] @ find_hands(model, q)[0]
    if "hands" in vehicle.offers:  # the arms compensate the motion of the platform
        row["t"] = 0.0
        for field in ("v_WB", "a_WB", "w_WB_B", "wd_WB_B", "qd", "v_WT", "v_WH"):
            row[field] = 0.0
        row["task"][0], row["p_WH"][0] = TASK_POSITION, goal
        WholeBody(vehicle).track(row[None])
    _wait(vehicle, SETTLE_S)
    return goal, place


def _arrive(vehicle: SimulatedVehicle) -> None:
    while not _tick(vehicle).arrived:
        pass


def _wait(vehicle: SimulatedVehicle, seconds: float) -> None:
    end = vehicle.t + seconds
    while vehicle.t < end - 1e-9:
        _tick(vehicle)


def _tick(vehicle: SimulatedVehicle) -> Any:
    ticked = vehicle.tick()
    if ticked.fired & LOST_CONTROL:
        raise _Lost
    return ticked


def _rms(error: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(error**2, axis=1))))


def _write(value: float | None) -> str:
    return "not measured" if value is None else f"{value:.3g}"
