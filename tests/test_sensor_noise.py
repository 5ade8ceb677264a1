"""The plant's sensors have noise that data sheets, and filters that believe them, do not know."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from skywright.description.loader import load_description
from skywright.description.world.spec import Mocap
from skywright.errors import InputError
from skywright.models.deviated_sensors import draw_noise_factors
from skywright.reports.explain import list_plant
from skywright.run.backends import build_vehicle
from skywright.run.gyro_limit import compute_strain, explain_noise, find_noisy_gyroscope
from skywright.run.setup import Setup
from skywright.vehicle.bus import Body
from skywright.vehicle.estimators.filter import Filter
from skywright.vehicle.estimators.station_camera import StationCamera
from skywright.vehicle.rate_torque import measure_rate_torque
from skywright.vehicle.sensor_tables import get_table
from skywright.vehicle.sensors.gnss import SatelliteReceiver
from skywright.vehicle.sensors.inertial import Inertial
from skywright.vehicle.sensors.mocap import MotionCapture
from skywright.vehicle.sensors.range_finder import RangeFinder
from skywright.vehicle.sensors.station import StationCamera as Station


def build(mission: str, error: float, *sets: str) -> Any:
    d = load_description(mission, sets=[f"plant.sensor_noise_error={error}", *sets])
    return d, build_vehicle(d, lambda block: None)


def test_factors_are_log_normal_bounded_and_of_seed_sensor_and_key() -> None:
    table = Mocap()
    drawn = [draw_noise_factors(table, "mocap", 0.2, seed) for seed in range(2000)]
    assert set(drawn[0]) == {"position_noise_m", "attitude_noise_rad"}
    logs = np.log([[f["position_noise_m"], f["attitude_noise_rad"]] for f in drawn])
    np.testing.assert_allclose(np.mean(logs, axis=0), 0.0, atol=0.02)
    np.testing.assert_allclose(np.std(logs, axis=0), 0.2, atol=0.01)
    assert np.max(np.abs(logs)) <= 0.6 + 1e-12
    assert abs(np.corrcoef(logs.T)[0, 1]) < 0.08
    assert draw_noise_factors(table, "tracked pipe", 0.2, 1) != drawn[1]
    assert draw_noise_factors(table, "mocap", 0.0, 1) == dict.fromkeys(drawn[0], 1.0)


def test_inertial_unit_and_motion_capture_are_noisier_than_the_filter_believes() -> None:
    d, believed = build("waypoints", 0.0)
    _, v = build("waypoints", 0.5)
    factors = draw_noise_factors(d.world.mocap, "mocap", 0.5, d.mission.seed)
    mocap = v.assembly.get(MotionCapture.Me, "mocap")
    for field, key in (("sigma_p", "position_noise_m"), ("sigma_R", "attitude_noise_rad")):
        assert mocap[field] == pytest.approx(factors[key] * getattr(d.world.mocap, key))
    for field in Filter.Me.dtype.names:  # the robot believes the same
        a, b = v.read_memory("estimator")[field], believed.read_memory("estimator")[field]
        np.testing.assert_array_equal(a, b, field)
    unit, s = v.find(Inertial), d.robot.sensors
    factors = draw_noise_factors(s, "inertial", 0.5, d.mission.seed)
    rng = np.random.default_rng(1)
    for what, noise, walk in (
        (Inertial.GyroError, "gyro_noise_rad_s_sqrthz", "gyro_walk_rad_s2_sqrthz"),
        (Inertial.AccelError, "accel_noise_mps2_sqrthz", "accel_walk_mps3_sqrthz"),
    ):
        drawn = unit.draw(what, rng, 200_000)
        steps = np.diff(unit._paths[what.__name__], axis=0) / math.sqrt(0.01)
        white = np.diff(drawn, axis=0)[::10] / math.sqrt(2.0) * math.sqrt(1e-3)
        assert np.std(white) == pytest.approx(factors[noise] * getattr(s, noise), rel=0.01)
        assert np.std(steps) == pytest.approx(factors[walk] * getattr(s, walk), rel=0.01)


def test_station_camera_and_range_finder_are_noisier_than_the_filter_believes() -> None:
    d, believed = build("bridge-contact", 0.0)
    _, v = build("bridge-contact", 0.5)
    s, c, r, seed = d.world.total_station, d.robot.tracking_camera, d.robot.range_finder, 1
    of = {
        name: draw_noise_factors(table, name, 0.5, seed)
        for name, table in (("total station", s), ("tracking camera", c), ("range finder", r))
    }
    me = v.assembly.get(Station.Me, "total station")
    for seen, key in (("range_std", "range_noise_m"), ("pointing_std", "pointing_noise_m")):
        assert me["station"][seen] == pytest.approx(of["total station"][key] * getattr(s, key))
    camera = of["tracking camera"]
    assert me["camera"]["noise_std"] == pytest.approx(camera["noise_m"] * c.noise_m)
    walk = camera["walk_m_per_sqrt_m"] * c.walk_m_per_sqrt_m
    assert me["camera"]["walk_per_sqrt_m"] == pytest.approx(walk)
    turn = camera["attitude_noise_rad"] * c.attitude_noise_rad
    assert me["attitude_noise"] == pytest.approx(turn)
    finder = v.assembly.get(RangeFinder.Me, "range finder")["finder"]
    assert finder["noise_std"] == pytest.approx(of["range finder"]["noise_m"] * r.noise_m)
    for field in StationCamera.Me.dtype.names:
        a, b = v.read_memory("estimator")[field], believed.read_memory("estimator")[field]
        np.testing.assert_array_equal(a, b, field)


def test_a_satellite_receiver_is_noisier_than_the_filter_believes() -> None:
    d, believed = build("waypoints", 0.0, "world.localisation=gnss")
    _, v = build("waypoints", 0.5, "world.localisation=gnss")
    factors = draw_noise_factors(d.world.gnss.fill(), "gnss", 0.5, d.mission.seed)
    me = v.assembly.get(SatelliteReceiver.Me, "gnss")
    assert me["noise"][2] == pytest.approx(factors["noise_up_m"] * 0.0075)
    heading = factors["heading_noise_deg"] * math.radians(0.4)
    assert me["heading_noise"] == pytest.approx(heading)
    for field in ("r_fix", "r_heading"):
        a, b = v.read_memory("estimator")[field], believed.read_memory("estimator")[field]
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("value", ["-0.1", "0.8", "'much'"])
def test_a_spread_that_means_nothing_is_refused(value: str) -> None:
    with pytest.raises(InputError, match=r"plant\.sensor_noise_error"):
        load_description("waypoints", sets=[f"plant.sensor_noise_error={value}"])


@pytest.mark.parametrize("mission", ["pipe-weld-scan", "sensor-install", "bridge-contact"])
def test_the_report_tells_what_was_drawn_of_each_sensor(mission: str) -> None:
    d, v = build(mission, 0.3)
    rows = {r.name: r.value for r in list_plant(SimpleNamespace(description=d))}  # type: ignore[arg-type]
    assert rows["plant.sensor_noise_error"] == "0.3"
    told = {name: value for name, value in rows.items() if name.startswith("noise of ")}
    expected = {}
    for c in v.assembly.components:
        names = draw_noise_factors(c.table, c.name, 0.3, d.mission.seed)
        if c.group == "sensor" and names:
            true = get_table(c, v.assembly.context)
            values = [getattr(true, k) / (getattr(c.table, k) or math.nan) for k in names]
            expected[f"noise of {c.name} drawn"] = values
    camera = told.pop("noise of tracking camera drawn", None)  # of the total station's component
    assert (camera is not None) == (mission == "bridge-contact")
    assert set(told) == set(expected)
    for name, values in expected.items():
        seen = np.array([float(x) for x in told[name].split(", ")])
        known = np.isfinite(values)
        np.testing.assert_allclose(seen[known], np.array(values)[known], atol=6e-4)


QUIET_LAW = '''
import numpy as np
from skywright.vehicle.bus import Allocated, Body, Estimate, Reference, WrenchCommand
from skywright.vehicle.component import Out
from skywright.vehicle.laws.push_and_slide import PushAndSlide


class Quiet(PushAndSlide):
    """Answers rates with 18 I, and states no attitude loop."""

    compiled = False

    def get_attitude_loop(self, robot):
        return None

    @staticmethod
    def step(me: PushAndSlide.Me, ref: Reference, est: Estimate, body: Body,
             allocated: Allocated, cmd: Out[WrenchCommand]) -> None:
        me.sigma[0] += 1.0
        cmd.qd[:] = 0.0
        cmd.f_B[:] = np.array([0.0, 0.0, body.mass * body.gravity])
        cmd.t_B[:] = -18.0 * body.I_B @ est.w_WB_B
'''


def test_the_answer_of_a_law_that_states_no_loop_is_measured(tmp_path):
    """A noisy gyroscope is told beside a law's failure in flight, from the law's own step."""
    (tmp_path / "quiet.py").write_text(QUIET_LAW)
    key = "robot.sensors.gyro_noise_rad_s_sqrthz"

    def quiet_law(noise: float):
        sets = [f"mission.law={tmp_path / 'quiet.py'}:Quiet", f"{key}={noise}"]
        d = load_description("waypoints", robot="othex", sets=sets)
        return d, build_vehicle(d)

    d, v = quiet_law(0.6)
    assert find_noisy_gyroscope(Setup(d)) is None  # nothing is known of it before the flight
    v.assembly.get(Body)["I_B"][:] = np.diag([0.2, 0.3, 0.4])
    before = v.assembly.arena.copy()
    torque = measure_rate_torque(v.assembly, v.law)
    np.testing.assert_allclose(torque, -18.0 * np.diag([0.2, 0.3, 0.4])[:, :2], atol=1e-6)
    assert np.array_equal(before, v.assembly.arena)  # nothing of the flight has changed
    said = explain_noise(v, 3.0)
    assert f"{key} = 0.6" in said and "N rms per rotor" in said and "valid: at most" in said
    strain = compute_strain(v.nominal, torque)
    assert strain.exceeds(3.0) and f"{strain.asked:.2f} N rms" in said
    quiet = quiet_law(1e-5)[1]
    quiet.assembly.get(Body)["I_B"][:] = np.diag([0.2, 0.3, 0.4])
    assert explain_noise(quiet, 3.0) == ""
