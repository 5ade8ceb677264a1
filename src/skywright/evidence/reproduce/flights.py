"""Flights that measure claims: missions, a tap on the probe, a collision with the surface.

All use ordinary descriptions; the stored result of a flight is small enough for the cache.
"""

import json
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.analysis.identify.load import IDENTIFY_FIELDS
from skywright.core.arrays import Array
from skywright.core.user_files import hash_sources
from skywright.description.dump import dump_description, list_sources
from skywright.description.loader import Description, load_description
from skywright.description.world.things import list_movers
from skywright.errors import SimulationError
from skywright.evidence.reproduce import flights_arms
from skywright.evidence.reproduce.cache import Record
from skywright.evidence.reproduce.spec import Case
from skywright.missions.excitation.task import ExcitationTask
from skywright.missions.scan.plan import ScanWay
from skywright.missions.skills.tables import build_retreat
from skywright.missions.skills.tool_handling import LOW
from skywright.missions.tool_install.metrics import compute_grasp_errors
from skywright.missions.tool_install.task import ToolInstall
from skywright.models.compliant_arms import is_compliant
from skywright.recordings.columns import build_dtype, has_columns
from skywright.run.backends import build_vehicle
from skywright.run.planning import MissionPlan, plan_mission
from skywright.run.run import fly_and_evaluate
from skywright.vehicle.bus import Body
from skywright.vehicle.interface import WholeBody
from skywright.vehicle.moves import Moves
from skywright.vehicle.simulated import SimulatedVehicle

FIELDS = (
    "t", "phase", "p_WB", "q_WB", "p_WT", "q_WT", "spring", "gap_max", "tilt", "f_normal",
    "f_wind_W", "ref_p_WB", "ref_q_WB", "ref_p_WT", "ref_normal_W", "ec", "meas_p_WT",
)  # fmt: skip
"""Stored columns."""

ARM_FIELDS = (
    "q", "deflection", "est_p_WB", "load_t_peak", "load_f_peak", "pad_f_peak",
    *(f"{side}_{n}" for side in ("left", "right")
      for n in ("p_WH", "ref_p_WH", "est_p_WH", "f_W", "est_f_W")),
)  # fmt: skip
"""Stored columns of compliant arms."""

CONTACT_FIELDS = (
    "q", "est_p_WB", "force_meas", "ref_force", "pressing", "docked", "f_contact", "f_docking_W",
    "fix_age", "pose_std",
)  # fmt: skip
"""Stored columns of missions with a force sensor, and of flight modes."""

TAP = (1.0, 0.0, 1.0)  # N, on the probe's holder, for one mission tick (20 ms)
RING = 6.0  # s, recorded after the tap
LEFT = 0.5  # m, distance from the reference beyond which the platform counts as lost
WATCH = 2.0  # s, recorded after a touch


def build_description(case: Case, seed: int) -> Description:
    """Load the description of a case with one seed."""
    return load_description(case.mission, case.robot or None, sets=case.sets, seed=seed)


def describe_content(case: Case, description: Description) -> str:
    """Return the text on which the result of a flight depends, as the key of the cache."""
    doing = case.model_dump(exclude={"mission", "robot", "sets", "seeds", "needs"})
    doing["sources"] = hash_sources(list_sources(description))  # the cache hashes no user's sources
    return json.dumps(doing, sort_keys=True) + dump_description(description)


def fly_case(case: Case, description: Description) -> Record:
    """Fly one seed of a case. Raises as `skywright.run` does."""
    return FLIGHTS[case.kind](case, description)


class _Watcher:
    """Records values at every mission tick (20 ms) that samples do not contain."""

    def __init__(self) -> None:
        self.rows: list[Array] = []

    def on_plan(self, plan: MissionPlan, description: Description) -> None:
        """Do nothing."""

    def on_tick(self, t: float, phase: str, vehicle: SimulatedVehicle) -> None:
        """Record time, torques of the arm's structural springs, and the position integral."""
        law = vehicle.read_memory("law")
        sigma = law["sigma"] if "sigma" in law.dtype.names else np.zeros(3)  # some laws have none
        self.rows.append(np.concatenate([[t], flex_torque(vehicle), sigma]))

    def close(self) -> None:
        """Do nothing."""


def flex_torque(vehicle: SimulatedVehicle) -> Array:
    """Return the torque (n,) N m in the arm's structural springs."""
    model, places = vehicle.scene.model, vehicle.scene.places
    flex = places.flex_qpos[places.flex_qpos >= 0]
    joints = [int(np.flatnonzero(model.jnt_qposadr == q)[0]) for q in flex]
    stiffness = np.asarray(model.jnt_stiffness, dtype=float).reshape(model.njnt, -1)[joints, 0]
    return np.asarray(stiffness * vehicle.sim.qpos[flex])


def _fly_mission(case: Case, description: Description) -> Record:
    watcher = _Watcher()
    result = fly_and_evaluate(description, [watcher])
    info = {
        "outcome": result.outcome,
        "reason": result.reason,
        "metrics": {k: v for k, v in result.metrics.items() if math.isfinite(v)},
        "failed": [r.name for r in result.requirements if not r.passed],
        "phases": [p._asdict() for p in result.phases],
        "plan_s": result.plan.plan_s,
        "depth_m": way.depth_m if isinstance(way := result.plan.way, ScanWay) else 0.0,
    }
    fields = list(FIELDS)
    if is_compliant(description.robot):
        fields += ARM_FIELDS
        objects = list_movers(description.world.things)
        fields += [f"object{i}_p_WO" for i in range(len(objects))]
        info |= {"objects": objects, "task": description.mission.model_dump().get("task", {})}
    elif description.robot.force_sensor is not None:
        fields += CONTACT_FIELDS
    arrays = {n: result.samples[n] for n in fields if has_columns(result.samples, n)}
    if isinstance(description.mission.task, ToolInstall):
        index = list_movers(description.world.things).index(description.mission.task.tool)
        arrays["tool_p_WO"] = result.samples[f"object{index}_p_WO"]
        for name, along in (("grasp_error_O", 0.0), ("wait_error_O", -LOW)):
            arrays[name] = compute_grasp_errors(result.samples, index, result.plan.get_way(), along)
    if isinstance(description.mission.task, ExcitationTask):  # keep the columns for identification
        samples = result.samples
        arrays |= {n: samples[n] for n in IDENTIFY_FIELDS if has_columns(samples, n)}
        info["mission"] = dump_description(description)
    arrays["watched"] = np.array(watcher.rows)
    return Record(info, arrays)


def _fly_to_stand_off(
    description: Description, blocks: list[NDArray[Any]]
) -> tuple[SimulatedVehicle, WholeBody, MissionPlan]:
    """Fly to the stand-off before the surface, with the tip loop closed, and hold."""
    plan = plan_mission(description)
    vehicle = build_vehicle(description, blocks.append)
    uav, body = Moves(vehicle), WholeBody(vehicle)
    for _ in range(50):
        vehicle.tick()
    uav.motors(True)
    uav.take_off(description.mission.hover_height_m)
    _arrive(vehicle)
    for name in ("approach", "unfold", "close_in"):
        body.track(plan.segments[name])
        _arrive(vehicle)
    body.hold()
    for _ in range(150):
        vehicle.tick()
    vehicle.flush()
    blocks.clear()
    return vehicle, body, plan


def _arrive(vehicle: SimulatedVehicle) -> None:
    while not vehicle.tick().arrived:
        pass


def _fly_taps(case: Case, description: Description) -> Record:
    """Tap the probe's holder and record the vibration of the tip, for each gain.

    The position integral is disabled, so that only the tested gain acts. `tip` is (gains, n, 3) m:
    the tip relative to the platform, NaN from the loss of the platform.
    """
    blocks: list[NDArray[Any]] = []
    vehicle, _, _ = _fly_to_stand_off(description, blocks)
    saved = vehicle.save()
    gains, mass = vehicle.get_memory("law"), float(vehicle.read(Body).mass)
    n = round(RING * 100)
    tip = np.full((len(case.gains), n, 3), np.nan)
    for i, gain in enumerate(case.gains):
        vehicle.flush()
        vehicle.restore(saved)
        blocks.clear()
        gains.wi_p = 0.0
        if case.gain == "position_n_per_m":
            gains.wn_p = math.sqrt(gain / mass)
        else:
            gains.k_arm = gain
        vehicle.devices.helper.push("holder", np.array(TAP))
        _watch(vehicle, 0.02)
        vehicle.devices.helper.push("holder", np.zeros(3))
        vehicle.flush()
        blocks.clear()
        _watch(vehicle, RING)
        s = _joined(vehicle, blocks)[:n]
        tip[i, : len(s)] = s["p_WT"] - s["p_WB"]
    return Record({"mass": mass, "gains": case.gains}, {"tip": tip})


def _watch(vehicle: SimulatedVehicle, seconds: float) -> None:
    """Tick for some time, or until the platform is too far from its reference."""
    end = vehicle.t + seconds
    while vehicle.t < end - 1e-9:
        try:
            vehicle.tick()
        except SimulationError:
            return
        if np.linalg.norm(vehicle.estimate["p_WB"] - vehicle.reference["p_WB"]) > LEFT:
            return


def _joined(vehicle: SimulatedVehicle, blocks: list[NDArray[Any]]) -> NDArray[Any]:
    vehicle.flush()
    return np.concatenate(blocks) if blocks else np.zeros(0, build_dtype(vehicle.recorded.columns))


def _fly_bumps(case: Case, description: Description) -> Record:
    """Touch the surface at each mean speed and record the torques of the arm's structure.

    `torque` is (speeds, n, joints) N m, every 4 ms from the start of the touch; `force` (speeds,) N
    is the maximum contact force.
    """
    blocks: list[NDArray[Any]] = []
    vehicle, body, plan = _fly_to_stand_off(description, blocks)
    vehicle.n_ticks = 2
    saved = vehicle.save()
    touch = plan.segments["touch"]
    distance = float(np.linalg.norm(touch["p_WT"][0] - touch["p_WT"][-1]))
    torques, forces = [], []
    for speed in case.speeds_mps:
        vehicle.flush()
        vehicle.restore(saved)
        blocks.clear()
        total = distance / speed
        body.track(build_retreat(touch[-1], distance, total, back=True))
        rows, end = [], vehicle.t + total + WATCH
        while vehicle.t < end - 1e-9:
            vehicle.tick()
            rows.append(flex_torque(vehicle))
        torques.append(np.array(rows))
        forces.append(float(np.max(_joined(vehicle, blocks)["f_normal"])))
    most = max(len(t) for t in torques)
    padded = np.stack([np.pad(t, ((0, most - len(t)), (0, 0)), mode="edge") for t in torques])
    return Record(
        {"speeds": case.speeds_mps, "distance": distance},
        {"torque": padded, "force": np.array(forces)},
    )


FLIGHTS = {
    "mission": _fly_mission,
    "tap": _fly_taps,
    "bump": _fly_bumps,
    "press": flights_arms.fly_press,
    "hover": flights_arms.fly_hover,
    "lean": flights_arms.fly_lean,
}
"""Kind of a case -> function that flies it."""
