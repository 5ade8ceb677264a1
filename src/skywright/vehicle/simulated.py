"""The physics back end: the perturbed plant, its sensors, and the controllers' belief.

Fast mode runs each mission tick in one compiled call; interactive mode runs each control tick from
Python (real exceptions, a debugger works, plain-Python laws are allowed). Both are bit-identical.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.control.backstepping_gains import fill_backstepping
from skywright.control.cascade_gains import fill_cascade
from skywright.control.registry import CASCADED, Law, load_arms_law
from skywright.core.rotations import exp_so3, quat_to_rot
from skywright.core.streams import build_stream
from skywright.core.types import BELIEF, SAMPLE
from skywright.description.robot.spec import Robot
from skywright.description.world.spec import Pipe, World
from skywright.description.world.thing import Frame as Pose
from skywright.description.world.thing import Placed
from skywright.description.world.things import find_carrier, find_first, locate_thing
from skywright.errors import InputError, SimulationError
from skywright.estimation.registry import (
    check_localisation,
    fill_parameters,
    load_estimator,
)
from skywright.inspection.eddy_current import Instrument, build_probe_signal
from skywright.models.allocation import build_allocator
from skywright.models.arm_body import Deviation
from skywright.models.compliant_arms import (
    fill_arms_parameters,
    is_compliant,
)
from skywright.models.localisation.calibration import Calibration
from skywright.models.rigid_body import (
    KINEMATICS,
    build_body_model,
    compute_body,
    compute_tip,
    joint_names,
    posture,
)
from skywright.models.rotors import build_rotors
from skywright.models.scene import TIMESTEP, Scene, build_scene, home_pose
from skywright.models.things._build import OBJECT, find_offsets
from skywright.models.things.bench import CLAMP, Bench
from skywright.sim.gnss import GNSS_NOISE, fill_gnss
from skywright.sim.inertial import IMU_BLOCK, build_inertial, draw_inertial
from skywright.sim.link import LINK_BLOCK, build_link, draw_link
from skywright.sim.localisation import Sight, draw_localisation
from skywright.sim.plant import BLOCK
from skywright.sim.plant_setup import build_plant
from skywright.sim.simulation import Simulation
from skywright.sim.wind import count_noise
from skywright.vehicle.columns import Recorded, list_recorded
from skywright.vehicle.frame import Frame
from skywright.vehicle.guard import GUARD, NOT_FINITE
from skywright.vehicle.interface import Limits, Table, Ticked
from skywright.vehicle.link_arc import LinkArc, compute_link_arc
from skywright.vehicle.localisation import prepare_localisation
from skywright.vehicle.tick import (
    mission_tick,
    tick_after_law,
    tick_before_law,
    tick_inertial,
    tick_law,
)

Array = NDArray[np.float64]

MISSION_TICK = 0.02  # s
SAMPLE_RATE = 100.0  # Hz
SAMPLES = 256  # rows between deliveries
SAMPLES_A_TICK = 16  # more than one mission tick can write
SETTLE = 2.0  # s in which the estimator starts
LIFT_OFF_THRESHOLD = 15.0  # instrument units (Tognon 2018, section VII)


class SimulatedVehicle:
    """A back end (vehicle.interface.Backend) that flies the plant."""

    offers: frozenset[str]

    def __init__(
        self,
        robot: Robot,
        world: World,
        law: Law,
        *,
        seed: int,
        deviation: Deviation,
        start: tuple[float, float, float] = (0.0, 0.0, 0.0),
        interactive: bool = False,
        estimator: str = "filter",
        on_samples: Callable[[NDArray[Any]], None] | None = None,
    ) -> None:
        """`start` is x, y (m) and yaw (rad) of the take-off place; see Deviation for the plant."""
        check_localisation(estimator, robot, world)
        self.robot, self.world, self.law = robot, world, law
        self._deviation = deviation
        self.interactive = interactive or law.compiled is None
        rate = robot.control.rate_hz
        self.n_steps = round(1.0 / (rate * TIMESTEP))
        if abs(self.n_steps * TIMESTEP * rate - 1.0) > 1e-9 or self.n_steps < 1:
            raise InputError(
                f"robot.control.rate_hz = {rate:g} does not divide the physics rate "
                f"{1 / TIMESTEP:g} Hz; valid: 1000, 500, 250, 200, 125, 100"
            )
        self.dt = self.n_steps * TIMESTEP
        self.n_ticks = max(round(MISSION_TICK / self.dt), 1)
        self.scene: Scene = build_scene(robot, world, deviation)
        self.n_joints = self.scene.n_joints
        self.offers = frozenset(
            ["uav"]
            + (["arms", "whole_body"] if robot.arm else [])
            + (["hands"] if is_compliant(robot) else [])
            + (["probe"] if robot.probe else [])
        )
        c = robot.control
        self.limits = Limits(c.speed_max_mps, c.acceleration_max_mps2, 0.8)
        self.rotors = build_rotors(robot.rotors)
        self.allocator = build_allocator(self.rotors)
        self.model = build_body_model(robot, world.gravity_mps2)
        self.arc = compute_link_arc(robot, self.model)
        self.kin = np.zeros(1, KINEMATICS)
        self.thrust = np.zeros(len(self.rotors.thrust_min))
        self.sim = Simulation(self.scene, home_pose(robot, world, *start))
        self._held = {
            name: (
                self.scene.model.equality(f"hold {name}").id,
                int(self.scene.model.sensor(f"touch {name}").adr[0]),
                thing.frees_at_n,
            )
            for name, thing in world.things.items()
            if thing.frees_at_n is not None
        }
        self.belief = self._build_belief()
        self.plant = build_plant(robot, world, self.scene, deviation, seed)
        names = (
            "gyro", "accelerometer", "vibration", "mocap", "dropout", "outlier", "probe", "wind",
            "link", "deflection", "camera", "force", "gnss", "station", "range_finder", "pipe",
            "survey",
        )  # fmt: skip
        self._streams = {n: build_stream(seed, n) for n in names}
        fill_gnss(self.plant[0]["gnss"], robot, world, self._streams["gnss"])
        self.inertial = build_inertial(robot, world.gravity_mps2, TIMESTEP, self._streams)
        self.link = build_link(world.link)
        self.link_on = bool(self.link[0]["on"])
        self.estimator = load_estimator(estimator, world.localisation)
        self._sight: Sight | None = None
        self._body_R = np.eye(3)
        self.calibration: Calibration | None = None
        if world.localisation == "total-station":
            self._sight = Sight(self.sim, int(self.plant[0]["platform"]))
            self.calibration = prepare_localisation(
                self.plant[0], self.belief[0]["fus"], robot, world, seed, self._streams
            )
        arms_law = load_arms_law(robot.control.arms_law or "compliant")
        self.guard = self._build_guard(estimator == "truth")
        pipe = world.pipe or Pipe()  # without a pipe the signal is never asked for
        weld = world.weld if world.pipe is not None else None
        self.probe_signal = build_probe_signal(pipe, weld, build_stream(seed, "texture"))
        self.samples = np.zeros(SAMPLES, SAMPLE)
        self.recorded = self.list_recorded()
        self.frame = Frame(
            self.belief, self.plant, self.inertial, self.link, self.guard, self.model, self.kin,
            self.samples, self.sim, self.allocator, self.thrust, self.probe_signal,
            0 if law.compiled is None else law.compiled.address, self.estimator.compiled.address,
            arms_law.compiled.address,
        )  # fmt: skip
        self._written = 0
        self.on_samples = on_samples
        # fields that every mission tick reads, as plain arrays
        self._time, self._table_t0 = self.belief["t"], self.belief["table_t0"]
        self._mask, self._fired = self.guard["mask"], self.guard["fired"]
        self._block = self.plant["block"]
        self._block[0] = BLOCK
        self._inertial_index, self._link_index = self.inertial["index"], self.link["index"]
        p, _, q = home_pose(robot, world, *start)
        self._table = np.zeros(1, self.belief["ref"].dtype)
        self._set_home_reference(p, start[2], q)
        self.track(self._table)
        if self._sight is not None:
            self._check_sight()

    # --- Backend ---------------------------------------------------------------------------------

    def list_recorded(self, *more: str) -> Recorded:
        """Return columns and topics of this robot and world, and of `more` PARTS."""
        pl = self.plant[0]
        have = {
            "hands": pl["positioned"], "objects": pl["n_objects"], "loads": pl["loads"]["on"],
            "force": pl["force_on"], "localisation": pl["localisation"]["on"],
        }  # fmt: skip
        parts = [name for name, on in have.items() if on]
        return list_recorded(joint_names(self.robot), len(self.thrust), [*parts, *more])

    @property
    def t(self) -> float:
        """Mission time (s)."""
        return float(self._time[0])

    @property
    def reference(self) -> Any:
        """A copy of the REFERENCE row at the last control tick."""
        return self.belief[0]["ref"].copy()

    @property
    def estimate(self) -> Any:
        """A copy of the ESTIMATE at the last control tick."""
        return self.belief[0]["est"].copy()

    @property
    def hands(self) -> Any:
        """A copy of the ARMS record at the last arms' tick."""
        return self.belief[0]["arms"].copy()

    @property
    def localised(self) -> bool:
        """Whether the estimator has begun."""
        b = self.belief[0]
        if self.estimator.name == "observer":
            return bool(b["obs"]["ready"] > 0.0)
        return self.estimator.name == "truth" or bool(b["flt"]["ready"] >= 2.0)

    @property
    def fix_age(self) -> float:
        """Time (s) since the robot was last told where it is."""
        return self.t - float(self.guard[0]["last_fix"])

    @property
    def force(self) -> float:
        """Force (N) of the tip at the last control tick, by the probe's sensor."""
        return float(self.belief[0]["est"]["f_tip"])

    @property
    def saturated(self) -> bool:
        """Whether the rotors could not make what was commanded at the last control tick."""
        return bool(self.belief[0]["cmd"]["saturated"] > 0.0)

    @property
    def pose_std(self) -> float:
        """Largest standard deviation (m) of the filter's position; NaN with another estimator."""
        if self.estimator.name != "filter":
            return math.nan
        return math.sqrt(float(np.max(np.diag(self.belief[0]["flt"]["P"])[:3])))

    def track(self, table: Table) -> None:
        """Follow `table` from now on; its last row holds."""
        self._table = np.ascontiguousarray(table)
        self._table_end = float(self._table[-1]["t"])
        self.frame.set_table(self._table)
        self.belief[0]["table_t0"] = self.belief[0]["t"]
        self.belief[0]["cursor"] = 0
        # commands given before the next tick build on the table's first row
        self.belief[0]["ref"] = self._table[0]

    def tick(self, guards: int = 0) -> Ticked:
        """Run one mission tick; raises SimulationError when it diverges."""
        self._mask[0], self._fired[0] = guards, 0
        if self._block[0] + self.n_ticks > BLOCK:
            self._draw_noise()
        if self._inertial_index[0] + self.n_ticks * self.n_steps > IMU_BLOCK:
            draw_inertial(self.inertial[0], self.robot, self._streams)
        if self.link_on and self._link_index[0] + self.n_ticks > LINK_BLOCK:
            draw_link(self.link[0], self._streams["link"])
        if self._sight is not None:
            self._look(self._sight)
        written = self._tick_interactive() if self.interactive else self._tick_fast()
        self._written = written
        if written > SAMPLES - SAMPLES_A_TICK:
            self.flush()
        fired = int(self._fired[0])
        if fired & NOT_FINITE:
            raise SimulationError(self._explain_not_finite())
        if self._held:
            self._let_go()
        t = float(self._time[0])
        return Ticked(t, fired, t - float(self._table_t0[0]) >= self._table_end - 1e-9)

    def flush(self) -> None:
        """Deliver the samples taken since the last delivery."""
        n, self._written = self._written, 0
        if n and self.on_samples is not None:
            self.on_samples(self.recorded.select(self.samples[:n]))

    def in_contact(self) -> bool:
        """Whether the instrument's lift-off signal says contact."""
        return bool(self.guard[0]["in_contact"])

    def tip_of(self, row: Any) -> tuple[Array, Array]:
        """Nominal (p_WT, R_WT) of a row's platform pose and joints."""
        p_BT, R_BT = compute_tip(self.model, row["q"])
        return row["p_WB"] + row["R_WB"] @ p_BT, row["R_WB"] @ R_BT

    def push(self, body: str, f_W: Array) -> None:
        """Apply a force (3,) N to a body of the robot, at its centre of mass, until told otherwise.

        A disturbance from outside, such as a helper's hand; raises InputError for an unknown body.
        """
        model = self.sim.scene.model
        names = [model.body(i).name for i in range(1, model.nbody)]
        if body not in names:
            raise InputError(f"no body {body!r} to push; valid: {', '.join(names)}")
        index, limbs = model.body(body).id, self.plant[0]["limbs"]
        for i in range(limbs["n"]):  # the forces on these are written every tick
            if limbs["body"][i] == index:
                limbs["given_W"][i] = f_W
                return
        self.sim.xfrc[index, :3] = f_W

    def move_bench(self, p_W: Array, yaw: float = 0.0) -> None:
        """Move the bench that clamps the platform to p_W (3,) m, turned by `yaw` (rad).

        Raises InputError where the world has none.
        """
        w, _, y, _ = self._find_bench().q_WB
        self.sim.data.mocap_pos[0] = p_W
        c, s = math.cos(0.5 * yaw), math.sin(0.5 * yaw)
        self.sim.data.mocap_quat[0] = [c * w, -s * y, c * y, s * w]  # first about y, then about z

    def release(self) -> None:
        """Open the clamp that holds the platform; it stays open.

        Raises InputError where the world has none.
        """
        self._find_bench()
        self.sim.data.eq_active[self.scene.model.equality(CLAMP).id] = 0

    def survey(self, name: str) -> tuple[Array, Array]:
        """Return (p_WO, R_WO) of a tracked thing as motion capture sees it: true, but for the error
        of its markers, one for the run, and a sample's noise.

        Raises InputError where the world has no tracked thing of that name.
        """
        thing = self.world.find_thing(name, Placed)
        if not thing.tracked:
            raise InputError(
                f"world {self.world.name!r}: motion capture does not see {name!r}: "
                f"[world.things.{name}] tracked = true"
            )
        draw, mocap = self._streams["survey"].standard_normal(6), self.world.mocap
        noise = np.repeat([mocap.position_noise_m, mocap.attitude_noise_rad], 3) * draw
        p, R = self._locate(name)
        error, turn = self._deviation.survey_error + noise, np.empty((3, 3))
        exp_so3(error[3:], turn)
        return p + R @ error[:3], R @ turn

    def _locate(self, name: str) -> Pose:
        """Where a thing is in truth."""
        things = self.world.things
        carrier = name if things[name].movable else find_carrier(things, name)
        if carrier is None:
            offsets = find_offsets(things, self._deviation.socket_error)
            return locate_thing(things, name, offsets=offsets)
        body, data = self.scene.model.body(OBJECT + carrier).id, self.sim.data
        frame = Pose(np.array(data.xpos[body]), np.array(data.xmat[body]).reshape(3, 3))
        return frame if carrier == name else frame.at(locate_thing(things, name, carrier))

    def _find_bench(self) -> Bench:
        bench = find_first(self.world.things, Bench)
        if bench is None:
            raise InputError(
                f"world {self.world.name!r} has no bench: give it a thing of kind 'bench'"
            )
        return bench

    def zero_gauges(self) -> None:
        """Count the wrench on the platform from now on (a simulation of a world with pads can)."""
        self.plant[0]["loads"]["zero"] = 1

    def _let_go(self) -> None:
        """Free the stuck things that are pulled harder than they are held."""
        for name, (equality, address, force) in list(self._held.items()):
            pull = self.sim.sensordata[address : address + 3]
            if float(np.linalg.norm(pull)) > force:
                self.sim.data.eq_active[equality] = 0
                del self._held[name]

    def set_phase(self, index: int) -> None:
        """Phase index that samples carry from now on."""
        self.guard[0]["phase"] = index

    def set_stick(self, stick: Array, button: bool) -> None:
        """Operator's input (3,) and button that samples carry from now on."""
        self.guard[0]["stick"], self.guard[0]["button"] = stick, float(button)

    # --- the two ways of running ---------------------------------------------------------------

    def _tick_fast(self) -> int:
        return int(mission_tick(self.frame.array, self.n_ticks, self.n_steps, self._written))

    def _tick_interactive(self) -> int:
        frame, compiled = self.frame.array, self.law.compiled is not None
        written = self._written
        for _ in range(self.n_ticks):
            tick_before_law(frame)
            if compiled:
                tick_law(frame)
            else:
                self._call_python_law()
            fired, written = tick_after_law(frame, written)
            if fired & NOT_FINITE:
                break
            for _ in range(self.n_steps):
                self.sim.step(1)
                tick_inertial(frame)
            if fired:
                break
        return int(written)

    def _call_python_law(self) -> None:
        try:
            self.law.step(self.belief)
        except (Exception, SystemExit) as error:
            raise SimulationError(
                f"control law {self.law.name!r} raised at t = {self.t:.3f} s: {error!r}"
            ) from error

    # --- set-up ------------------------------------------------------------------------------

    def _check_sight(self) -> None:
        """Raise InputError where the station does not see the robot that stands at its start."""
        assert self._sight is not None
        self._look(self._sight)
        station = self.world.total_station
        for start, stop in station.blocked_s:
            if start < SETTLE and stop > 0.0:
                raise InputError(
                    f"world.total_station.blocked_s holds [{start:g}, {stop:g}]: the station must "
                    f"see the robot for {SETTLE:g} s before it takes off"
                )
        if not self.plant[0]["localisation"]["visible"]:
            raise InputError(
                f"world.total_station at ({station.x_m:g}, {station.y_m:g}, {station.z_m:g}) m "
                "does not see the prism of the robot where it stands before take-off: move the "
                "station, or what is in between"
            )

    def _look(self, sight: Sight) -> None:
        """Find what the station and the range finder see in this mission tick."""
        loc, t, R = self.plant[0]["localisation"], self.t, self._body_R
        draw_localisation(loc, self._streams, self.n_ticks)
        p = self.sim.qpos[:3]
        quat_to_rot(self.sim.qpos[3:7], R)
        station = loc["station"]
        hidden = any(start <= t < stop for start, stop in self.world.total_station.blocked_s)
        prism = p + R @ station["p_BP"]
        loc["visible"] = int(not hidden and sight.sees(station["p_WS"], prism))
        if loc["ranges"]:
            loc["distance"] = sight.measure(np.array(p), -R[:, 2])

    def _draw_noise(self) -> None:
        """Fill the noise block, one stream a sensor; lasts for BLOCK control ticks."""
        pl = self.plant[0]
        pl["block"] = 0
        pl["noise_mocap"] = self._streams["mocap"].standard_normal((BLOCK, 12))
        pl["noise_drop"] = self._streams["dropout"].random(BLOCK)
        if self.world.mocap.outlier_fraction > 0.0:
            pl["noise_outlier"] = self._streams["outlier"].random((BLOCK, 9))
        if pl["gnss"]["on"]:
            pl["noise_gnss"] = self._streams["gnss"].standard_normal((BLOCK, GNSS_NOISE))
        if pl["positioned"]:
            pl["noise_deflection"] = self._streams["deflection"].standard_normal(
                pl["noise_deflection"].shape
            )
        if pl["camera"]["marker"]:
            pl["noise_camera"] = self._streams["camera"].standard_normal(pl["noise_camera"].shape)
        if pl["camera"]["pipe"]:
            pl["noise_pipe"] = self._streams["pipe"].standard_normal(pl["noise_pipe"].shape)
        if pl["force_on"]:
            pl["noise_force"] = self._streams["force"].standard_normal(BLOCK)
        pl["noise_ec"] = self._streams["probe"].standard_normal((BLOCK, 2))
        if self.world.wind.gusty:
            n = count_noise(self.world.wind, len(self.rotors.thrust_min))
            pl["noise_wind"][:, :n] = self._streams["wind"].standard_normal((BLOCK, n))

    def _build_belief(self) -> NDArray[Any]:
        out = np.zeros(1, BELIEF)
        b, c = out[0], self.robot.control
        par = b["par"]
        mass, _, _ = compute_body(self.model, posture(self.robot, "working"))
        par["dt"] = self.dt
        par["wn_p"], par["zeta_p"] = c.position_bandwidth_rad_s, c.position_damping
        par["wi_p"] = c.position_integral_rad_s
        par["wn_R"], par["zeta_R"] = c.attitude_bandwidth_rad_s, c.attitude_damping
        par["wi_R"] = c.attitude_integral_rad_s
        par["friction"] = c.friction_feed_forward
        par["k_arm"], par["tilt_max"] = c.arm_bandwidth_rad_s, math.radians(c.tilt_max_deg)
        par["thrust_max"] = float(np.sum(self.rotors.thrust_max * self.rotors.axis[:, 2]))
        par["f_integral_max"] = 0.4 * mass * self.world.gravity_mps2
        par["t_integral_max"] = 0.1 * mass * self.world.gravity_mps2
        par["belt"], par["belt_inv"] = self.model[0]["belt"], self.model[0]["belt_inv"]
        par["motor_speed_max"] = self.model[0]["motor_speed_max"]
        b["body"]["mass"], b["body"]["gravity"] = mass, self.world.gravity_mps2
        if self.robot.force_sensor is not None and self.robot.probe is not None:
            par["spring"] = self.robot.probe.spring_n_per_m
            par["slider"] = self.robot.probe.slider_mass_kg
        fill_parameters(b, self.robot, self.world, TIMESTEP)
        fill_arms_parameters(b["arms"], self.robot)
        b["arms"]["pipe_mocap"] = float(self.world.pipe is not None and self.world.pipe.tracked)
        if self.law.name in CASCADED:
            inverted = self.law.name == "model_inversion"
            fill_cascade(b, self.robot, self.world, self.model, inverted)
            if self.arc is not None:
                self._check_balance(par, self.arc)
        if self.law.name == "backstepping":
            fill_backstepping(par, self.robot)
        for field in ("ref", "est"):
            for name in ("R_WB", "R_WT"):
                b[field][name] = np.eye(3)
        b["ref"]["R_WS"] = np.eye(3)
        return out

    def _check_balance(self, par: Any, arc: LinkArc) -> None:
        """Raise InputError where the roll loop is too slow for the take-off along the arc.

        On the end of its link the robot is an inverted pendulum sideways, which falls at
        sqrt(g / h): the attitude has to answer faster.
        """
        _, com, _ = compute_body(self.model, posture(self.robot, "working"))
        falls = math.sqrt(self.world.gravity_mps2 / (arc.top + com[2]))
        found, rate = float(par["k_attitude"][0]), self.robot.control.rate_hz
        if found < falls:
            raise InputError(
                f"robot.control: at rate_hz = {rate:g} and world.link.delay_s = "
                f"{self.world.link.delay_s:g} the roll loop reaches {found:.2f} rad/s; to take off "
                f"on the end of its link {self.robot.name!r} needs {falls:.2f} rad/s: raise "
                "rate_hz or lower delay_s"
            )

    def _build_guard(self, truth: bool) -> NDArray[Any]:
        out = np.zeros(1, GUARD)
        g, instrument = out[0], Instrument()
        g["sample_every"] = max(round(1.0 / (SAMPLE_RATE * self.dt)), 1)
        g["truth_estimator"] = int(truth)
        g["lift_axis"] = [math.cos(instrument.phase), math.sin(instrument.phase)]
        g["lift_threshold"] = LIFT_OFF_THRESHOLD
        g["collision_limit"] = 0.5
        return out

    def _set_home_reference(self, p: Array, yaw: float, q: Array) -> None:
        row = self._table[0]
        c, s = math.cos(yaw), math.sin(yaw)
        row["p_WB"] = p
        row["R_WB"] = [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]
        bench = find_first(self.world.things, Bench)
        if bench is not None and bench.pitch_deg != 0.0:
            R = np.empty((3, 3))
            quat_to_rot(np.array(bench.q_WB), R)
            row["R_WB"] = R
        row["R_WS"] = np.eye(3)
        row["q"][: self.n_joints] = q
        row["p_WT"], row["R_WT"] = self.tip_of(row)
        if self.plant[0]["positioned"]:  # the servos hold where they stand
            arms = self.belief[0]["arms"]
            for field in (self.belief[0]["cmd"]["theta"], arms["theta_ref"], arms["q_goal"],
                          self.belief[0]["est"]["q"], self.plant[0]["servo_now"],
                          self.plant[0]["servo_held"], self.link[0]["motor"]):  # fmt: skip
                field[: self.n_joints] = q

    def _explain_not_finite(self) -> str:
        cmd = self.belief[0]["cmd"]
        joints = [cmd["qd"][: self.n_joints], cmd["theta"][: self.n_joints]]
        values = np.concatenate([cmd["f_B"], cmd["t_B"], *joints])
        if not np.all(np.isfinite(values)):
            return (
                f"control law {self.law.name!r} raised, or returned NaN or infinity, at "
                f"t = {self.t:.3f} s "
                "(force, torque or joint velocity); the command was not applied"
            )
        return f"the simulation diverged at t = {self.t:.3f} s: the state is not finite"
