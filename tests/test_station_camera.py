"""Flight without motion capture: the filter's identities, flights with outages, wrong input."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from exact_map import KNOWN
from skywright import load, run
from skywright.core.record import View
from skywright.core.types import IMU_HISTORY
from skywright.description.loader import load_description
from skywright.description.world.localisation import TotalStation
from skywright.errors import InputError
from skywright.run.backends import build_vehicle
from skywright.vehicle.estimates import EstimatorState
from skywright.vehicle.estimators import _fusion as fusion
from skywright.vehicle.estimators import station_camera
from skywright.vehicle.estimators._fusion import N_FUSION
from skywright.vehicle.estimators._kalman import correct
from skywright.vehicle.estimators.station_camera import StationCamera, compute_lag
from skywright.vehicle.sensors import station

STATION = "world.localisation='total-station'"


@given(st.integers(0, 10**6), st.integers(1, 6))
@settings(max_examples=25, deadline=None)
def test_correction_is_the_textbooks(seed, m):
    rng = np.random.default_rng(seed)
    n = 9
    A = rng.normal(size=(n, n))
    P, H, r = A @ A.T + np.eye(n), rng.normal(size=(m, n)), rng.uniform(0.1, 1.0, m)
    nu, dx, new = rng.normal(size=m), np.empty(n), P.copy()
    size = correct(new, H, nu.copy(), r, np.inf, dx)
    S = H @ P @ H.T + np.diag(r)
    K = P @ H.T @ np.linalg.inv(S)
    assert size == pytest.approx(nu @ np.linalg.solve(S, nu), rel=1e-9)
    assert dx == pytest.approx(K @ nu, rel=1e-8, abs=1e-9)
    assert new == pytest.approx((np.eye(n) - K @ H) @ P, rel=1e-7, abs=1e-8)
    before = new.copy()
    assert correct(new, H, 1e3 * nu, r, 1.0, dx) >= 1.0
    assert np.array_equal(new, before) and not np.any(dx)


def build_filter(seed: int) -> np.ndarray:
    """A moving robot whose camera errs, without noise."""
    rng = np.random.default_rng(seed)
    b = np.zeros(1, StationCamera.Me.dtype)
    flt = fus = b[0]
    flt["h"], flt["n"], flt["ready"] = 1e-3, 100, 2.0
    flt["p_BI"], fus["p_BP"] = [0.02, -0.01, 0.03], [0.05, 0.0, -0.15]
    flt["gyro"] = rng.normal(size=3) + 0.2 * rng.normal(size=(IMU_HISTORY, 3))
    flt["accel"] = [0.3, -0.4, 9.9] + 0.5 * rng.normal(size=(IMU_HISTORY, 3))
    flt["p_f"], flt["v_f"] = rng.normal(size=3) + [0, 0, 3], rng.normal(size=3)
    flt["R_f"] = Rotation.from_rotvec(0.3 * rng.normal(size=3)).as_matrix()
    fus["T"] = Rotation.from_rotvec(0.1 * rng.normal(size=3)).as_matrix()
    fus["rate"] = 0.02
    fus["growth"], fus["drift"] = 0.05, rng.normal(size=3)
    fus["R_WC"], fus["scale"] = np.eye(3), 1.0
    return b


def shift(b: np.ndarray, dx: np.ndarray) -> np.ndarray:
    out = b.copy()
    fusion._inject(View(out[0]), dx)
    return out


def subtract(b: np.ndarray, a: np.ndarray) -> np.ndarray:
    """The error that takes `a` to `b`."""
    flt, fus, f, g = b[0], b[0], a[0], a[0]
    turn = Rotation.from_matrix(flt["R_f"] @ f["R_f"].T).as_rotvec()
    frame = Rotation.from_matrix(fus["T"] @ g["T"].T).as_rotvec()
    parts = [flt["p_f"] - f["p_f"], flt["v_f"] - f["v_f"], turn, flt["bg"] - f["bg"],
             flt["ba"] - f["ba"], fus["drift"] - g["drift"], frame,
             [fus["growth"] - g["growth"], fus["range_bias"] - g["range_bias"],
              fus["delay"] - g["delay"], fus["rate"] - g["rate"]]]  # fmt: skip
    return np.concatenate(parts)


@pytest.mark.parametrize("seed", range(3))
def test_covariance_follows_the_state(seed):
    """One step of the covariance against finite differences of the state."""
    rng = np.random.default_rng(seed)
    b, v = build_filter(seed), rng.normal(size=N_FUSION)
    b[0]["P_full"] = np.outer(v, v)
    moved = shift(b, 1e-6 * v)
    for x in (b, moved):
        fusion.advance(View(x[0]), 10, 9.81)
    expected = subtract(moved, b) / 1e-6
    assert b[0]["P_full"] == pytest.approx(np.outer(expected, expected), rel=2e-3, abs=2e-3)


def fuse(b: np.ndarray, kind: str, z: object) -> None:
    me = View(b[0])
    if kind == "fix":
        fusion.fuse_fix(me, z)
    elif kind == "range":
        fusion.fuse_range(me, z)
    else:
        me.odo_p[0], me.odo_R[0] = z
        fusion.fuse_odometry(me, 0)


def measure(b: np.ndarray, kind: str) -> object:
    """What the sensors would say in this state."""
    flt = fus = b[0]
    R, p_B = flt["R_f"], flt["p_f"] - flt["R_f"] @ flt["p_BI"]
    if kind == "fix":
        return p_B + R @ fus["p_BP"] - flt["v_f"] * fus["delay"]
    if kind == "range":
        return float(p_B[2] / R[2, 2] + fus["range_bias"])
    return p_B + fus["drift"], fus["T"] @ R


@pytest.mark.parametrize("kind", ["fix", "range", "odometry"])
@pytest.mark.parametrize("seed", range(3))
def test_a_perfect_measurement_moves_the_state_onto_it(kind, seed):
    """It does to first order where the Jacobian is right: twice closer is four times better."""
    rng = np.random.default_rng(seed)
    v, left = rng.normal(size=N_FUSION), []
    for size in (1e-2, 5e-3):
        b = build_filter(seed)
        b[0]["P_full"] = 1e-2 * np.eye(N_FUSION)
        for noise in ("r_fix", "r_odo", "r_odo_R", "r_range"):
            b[0][noise] = 1e-12
        z = measure(shift(b, size * v), kind)
        fuse(b, kind, z)
        off = np.atleast_1d(np.asarray(z[0] if kind == "odometry" else z))
        now = measure(b, kind)
        left.append(np.linalg.norm(off - np.asarray(now[0] if kind == "odometry" else now)))
        if kind == "odometry":
            left[-1] += Rotation.from_matrix(z[1] @ now[1].T).magnitude()
    assert left[1] < 0.35 * left[0] + 1e-9 and left[0] < 2e-3


# --- flights --------------------------------------------------------------------------------------


def fly(*sets: str, seed: int = 3) -> tuple[np.ndarray, dict[str, float]]:
    d = load("waypoints", robot="f550-bridge", seed=seed, sets=[STATION, *sets])
    result = run(d, report=False)
    assert result.outcome == "succeeded"
    return result.samples, result.metrics


def test_a_flight_knows_where_it_is_to_millimetres():
    _, m = fly()
    assert m["estimate.position_rms_mm"] < 8.0 and m["estimate.outage_s"] < 2.0
    assert 0.4 < m["estimate.sigmas"] < 2.5


def test_an_outage_is_bridged_by_the_camera_and_healed():
    samples, m = fly("world.total_station.blocked_s=[[8.0, 16.0]]")
    assert m["estimate.outage_s"] > 7.0
    assert 2.0 < m["estimate.outage_max_mm"] < 120.0
    after = samples[samples["t"] > 18.5]
    error = np.linalg.norm(after["est_p_WB"] - after["p_WB"], axis=1)
    assert np.max(error) < 0.02
    assert np.max(samples["pose_std"][samples["t"] > 15.0]) > 3.0 * np.min(
        samples["pose_std"][100:]
    )


@pytest.mark.parametrize(
    ("sensor", "jump"), [("gyroscope", [0.08, -0.17, 0.07]), ("accelerometer", [0.44, 0.08, 0.89])]
)
def test_a_zero_that_jumps_is_told_and_found_again(sensor, jump):
    """The camera contradicts the inertial unit for longer than its own jumps do."""
    sets = [f"plant.faults.a.sensor={sensor}", f"plant.faults.a.jump={jump}"]
    sets += ["plant.faults.a.kind=sensor", "plant.faults.a.start_s=8", STATION]
    result = run(load("waypoints", robot="f550-bridge", seed=3, sets=sets), report=False)
    assert result.outcome == "aborted" and "estimator inconsistent" in result.reason
    s = result.samples
    acted = result.acted[0].t_s
    assert 8.0 < acted < 9.2
    error = np.linalg.norm(s["est_p_WB"] - s["p_WB"], axis=1)
    aloft = (s["t"] > acted + 1.0) & (s["p_WB"][:, 2] > 0.3)
    assert np.max(error[aloft]) < 0.05 and np.linalg.norm(s["v_WB"][-1]) < 0.1


def test_a_noisy_camera_is_not_taken_for_an_inertial_unit_that_is_off():
    """Its attitude has 1.82 times the stated noise, the most that is drawn: no rule acts."""
    _, m = fly(seed=103)
    assert m["estimate.position_rms_mm"] < 20.0


def test_both_ways_of_running_are_bit_identical():
    sets = ("mission.hover_height_m=0.8",
            "mission.task.points=[{ x_m = 0.3, y_m = 0.0, z_m = 1.0, hold_s = 0.2 }]")  # fmt: skip
    d = [load("waypoints", robot="f550-bridge", sets=[STATION, *sets, f"mission.mode={m!r}"])
         for m in ("fast", "interactive")]  # fmt: skip
    fast, slow = (run(x, report=False).samples for x in d)
    n = min(len(fast), len(slow))
    assert n > 500
    for name in ("p_WB", "est_p_WB", "fix_age", "pose_std"):
        assert np.array_equal(fast[name][:n], slow[name][:n]), name


def test_without_a_place_it_does_not_take_off(monkeypatch):
    """The station's samples come later than the filter remembers, so it never begins."""
    monkeypatch.setattr(station_camera, "compute_lag", lambda *_: 0.25)  # which refuses them
    sets = ["world.total_station.latency_min_s=1", "world.total_station.latency_mean_s=1"]
    result = run(load("waypoints", robot="f550-bridge", sets=[STATION, *sets]), report=False)
    assert result.outcome == "aborted" and "no take-off" in result.reason
    assert [p.name for p in result.phases] == ["start"]
    assert np.all(result.samples["rotor_speed"] == 0.0)
    assert np.all(np.isfinite(result.samples["est_p_WB"]))


@pytest.mark.parametrize(
    ("robot", "sets", "words"),
    [
        ("hexarotor", [], ["'hexarotor' has no [robot.prism] and no [robot.tracking_camera]"]),
        ("f550-bridge", ["mission.estimator='observer'"], ["requires motion capture"]),
        ("f550-bridge", ["world.total_station.blocked_s=[[5.0, 4.0]]"], ["blocked_s", "from < to"]),
        ("f550-bridge", ["world.total_station.blocked_s=[[1.0, 4.0]]"], ["before take-off"]),
        (
            "f550-bridge",
            [
                "world.things.a={kind='box',x_m=-9.0,y_m=-4.5,z_m=1.0,size_x_m=1,size_y_m=5,size_z_m=3}"
            ],
            ["does not see the robot's prism"],
        ),
        ("f550-bridge", ["world.total_station.rate_mean_hz=30"], ["exceeds rate_max_hz 20"]),
        ("f550-bridge", ["world.total_station.latency_mean_s=0.01"], ["below latency_min_s"]),
        (
            "f550-bridge",
            ["world.total_station.latency_mean_s=0.8"],
            ["world.total_station.latency_mean_s = 0.8", "at most 0.45 is valid"],
        ),
        ("f550-bridge", ["robot.range_finder.range_min_m=200"], ["must be below range_max_m"]),
        (
            "f550-bridge",
            ["world.total_station.rate_mean_hz=0.1", "mission.clearance_m=0.4"],
            ["cannot be calibrated"],
        ),
        ("f550-bridge", ["world.localisation='gps'"], ["world.localisation is the text 'gps'"]),
    ],
)
def test_wrong_input(robot, sets, words):
    with pytest.raises(InputError) as error:
        run(load("waypoints", robot=robot, sets=[STATION, *sets]), report=False)
    for word in words:
        assert word in str(error.value)


def test_a_calibration_whose_last_step_moves_a_sample_off_the_cameras_end_is_one() -> None:
    d = load_description("bridge-contact", sets=KNOWN, seed=238506084143718)
    found = build_vehicle(d).find(station.StationCamera).calibration
    assert np.all(np.isfinite(found.paper.matrix)) and found.rms < 0.2


def test_the_horizon_waits_for_the_stations_latency() -> None:
    assert compute_lag(TotalStation(), 200.0, 1e-3) == 0.25
    slow = ["world.total_station.latency_min_s=0.3", "world.total_station.latency_mean_s=0.35"]
    v = build_vehicle(load("waypoints", robot="f550-bridge", sets=[STATION, *slow]))
    for _ in range(400):
        v.tick()
    me = v.get_memory(next(c.name for c in v.assembly.components if isinstance(c, StationCamera)))
    assert me.fixes > 0.9 * (me.fix_n - 6) and me.fix_n > 40
    assert float(v.look(EstimatorState).fix_age) < 1.0
