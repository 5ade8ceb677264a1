"""Keys of a robot file: the root `robot`.

A robot is a platform with rotors, optionally an arm (named links in a chain or a tree) and a probe.
Every number has its unit in the key. Frames: B body (FLU: x forward, y left, z up) at the
platform's reference point; a link's frame is at its joint with x along the link.
"""

from __future__ import annotations

from typing import Literal

from pydantic import Field, field_validator, model_validator

from skywright.core.spec import (
    Bandwidth,
    Fraction,
    Name,
    NonNegative,
    Positive,
    Spec,
)
from skywright.core.types import MAX_JOINTS, MAX_ROTORS
from skywright.description.robot.arm import Arm, Link
from skywright.description.robot.camera import Camera, ProbeCamera
from skywright.description.robot.docking import Docking
from skywright.description.robot.force_sensor import ForceSensor
from skywright.description.robot.inertia import check_inertia
from skywright.description.robot.localisation import Prism, RangeFinder, TrackingCamera
from skywright.description.robot.mesh import MeshTable


class Platform(Spec):
    """The airframe without arm."""

    mass_kg: Positive  # with battery and rotors
    inertia_xx_kgm2: Positive
    inertia_yy_kgm2: Positive
    inertia_zz_kgm2: Positive
    inertia_xy_kgm2: float = 0.0  # product of inertia: the tensor's entry, -sum m x y
    inertia_xz_kgm2: float = 0.0
    inertia_yz_kgm2: float = 0.0
    com_x_m: float = 0.0
    com_y_m: float = 0.0
    com_z_m: float = 0.0
    diameter_m: Positive  # over the propeller tips
    height_m: Positive  # of the collision body around the rotor plane, gear excluded
    body_radius_m: Positive = 0.12  # central hub
    gear_height_m: Positive = 0.25  # feet below the origin of B
    gear_radius_m: Positive = 0.2
    drag_area_x_m2: NonNegative = 0.05  # C_D A of body and arm, force = rho/2 C_D A v^2
    drag_area_y_m2: NonNegative = 0.05
    drag_area_z_m2: NonNegative = 0.08

    @model_validator(mode="after")
    def _inertia_is_a_body_s(self) -> Platform:
        check_inertia(*self.inertia_terms)
        return self

    @property
    def inertia_terms(self) -> tuple[float, float, float, float, float, float]:
        """Ixx, Iyy, Izz, Ixy, Ixz, Iyz kg m^2 about the centre of mass, in the axes of B."""
        return (
            self.inertia_xx_kgm2, self.inertia_yy_kgm2, self.inertia_zz_kgm2,
            self.inertia_xy_kgm2, self.inertia_xz_kgm2, self.inertia_yz_kgm2,
        )  # fmt: skip


class Rotors(Spec):
    """Rotor layout and propulsion. Axis of rotor i: Rz(azimuth) Rx(alpha) Ry(beta) z.

    The lists have one entry per rotor. Azimuth, radius and height define the position of a hub;
    alpha and beta define the direction of its axis (alpha = 180 deg: downwards). `spin` is the
    sense of rotation of the propeller seen from where its thrust points to (from above, if it
    points up); the drag torque on the body has the opposite sense. Thrust = thrust_coefficient *
    speed^2.
    """

    azimuth_deg: list[float] = Field(min_length=3, max_length=MAX_ROTORS)
    # distance of the hubs from the z axis of B: one number, or one per rotor
    radius_m: Positive | list[NonNegative]
    height_m: float | list[float] = 0.0  # height of the hubs above B: one number, or a list
    alpha_deg: list[float]  # tilt about the radial axis
    beta_deg: list[float]  # tilt about the (rotated) tangential axis
    spin: list[Literal["ccw", "cw"]]
    propeller_radius_m: Positive
    thrust_coefficient_n_per_rad2s2: Positive
    torque_per_thrust_m: Positive
    thrust_min_n: NonNegative
    thrust_max_n: Positive
    thrust_fraction: Fraction = 1.0  # usable fraction of thrust_max
    time_constant_s: Positive  # of the rotor speed
    rotor_inertia_kgm2: NonNegative = 0.0  # propeller and bell of one rotor about its axis
    drag_coefficient_n_per_rads_mps: NonNegative  # force in the disc plane = -c * speed * v_perp
    figure_of_merit: Fraction = 0.6  # ratio of ideal induced power to shaft power
    motor_efficiency: Fraction = 0.8  # ratio of shaft power to electrical power

    @model_validator(mode="after")
    def _lengths_agree(self) -> Rotors:
        n = len(self.azimuth_deg)
        for name in ("alpha_deg", "beta_deg", "spin"):
            if len(getattr(self, name)) != n:
                raise ValueError(
                    f"{name} has {len(getattr(self, name))} entries, azimuth_deg has {n}: "
                    "give one entry per rotor"
                )
        for name in ("radius_m", "height_m"):
            value = getattr(self, name)
            if isinstance(value, list) and len(value) != n:
                raise ValueError(
                    f"{name} has {len(value)} entries, azimuth_deg has {n}: give one number, "
                    "or one per rotor"
                )
        if max(self.radii) <= 0.0:
            raise ValueError("radius_m must be above 0 for at least one rotor")
        if self.thrust_max_n <= self.thrust_min_n:
            raise ValueError("thrust_max_n must exceed thrust_min_n")
        return self

    @property
    def radii(self) -> list[float]:
        """Distance (m) of each hub from the z axis of B."""
        r, n = self.radius_m, len(self.azimuth_deg)
        return r if isinstance(r, list) else [r] * n

    @property
    def heights(self) -> list[float]:
        """Height (m) of each hub above the origin of B."""
        h, n = self.height_m, len(self.azimuth_deg)
        return h if isinstance(h, list) else [h] * n


class Battery(Spec):
    """Energy on board, which determines the endurance. Its mass is part of `platform.mass_kg`."""

    energy_wh: Positive
    usable_fraction: Fraction = 0.8
    avionics_power_w: NonNegative = 15.0


class Probe(Spec):
    """The probe in its sprung holder at the end of the last link (or of the link `on`).

    Its axis is x of that link, rotated by `pitch_deg` about the link's y. The tip is a small
    sphere; the spring compresses along the axis.
    """

    on: str | None = None
    mass_kg: Positive  # holder and sensor
    length_m: Positive  # from the link's end to the tip, spring released
    pitch_deg: float = 0.0
    slider_mass_kg: Positive = 0.04  # the moving part behind the spring
    spring_n_per_m: Positive = 200.0
    spring_preload_n: NonNegative = 0.5
    spring_travel_m: Positive = 0.01
    spring_damping_ratio: NonNegative = 0.7
    tip_radius_m: Positive = 0.004
    radius_m: Positive = 0.012  # collision capsule of the holder
    force_n: Positive = 2.0  # nominal contact force
    camera: ProbeCamera | None = None

    @model_validator(mode="after")
    def _slider_is_a_part(self) -> Probe:
        if self.slider_mass_kg >= self.mass_kg:
            raise ValueError(
                f"slider_mass_kg {self.slider_mass_kg:g} must be below mass_kg "
                f"{self.mass_kg:g}, which includes it"
            )
        return self


class Actuators(Spec):
    """Actuators besides rotors and servos, by name: `[robot.actuators.NAME] kind = ...`."""


class Sensors(Spec):
    """Onboard sensors; additional ones are tables in it: `[robot.sensors.NAME] kind = ...`."""

    gyro_noise_rad_s_sqrthz: NonNegative = 3.4e-4
    gyro_bias_rad_s: NonNegative = 0.005  # 1 sigma, drawn once per run
    gyro_walk_rad_s2_sqrthz: NonNegative = 3.9e-5  # of the bias
    accel_noise_mps2_sqrthz: NonNegative = 4e-3
    accel_bias_mps2: NonNegative = 0.1  # 1 sigma, drawn once per run
    accel_walk_mps3_sqrthz: NonNegative = 6e-3  # of the bias
    vibration_mps2: NonNegative = 0.5  # at the IMU, from one rotor at thrust_max_n
    vibration_rad_s: NonNegative = 0.02
    imu_x_m: float = 0.0  # position of the IMU in B
    imu_y_m: float = 0.0
    imu_z_m: float = 0.0
    antenna_x_m: float = 0.0  # position of the GNSS antenna in B
    antenna_y_m: float = 0.0
    antenna_z_m: float = 0.1


CONTROL_RATES = (100.0, 125.0, 200.0, 250.0, 500.0, 1000.0)  # Hz


class Control(Spec):
    """Bandwidths from which all gains are computed (files contain no gains)."""

    law: str | None = None  # kind: name or "file.py:Class"; the mission may override
    arms_law: str | None = None  # of arms with position servos
    position_bandwidth_rad_s: Bandwidth = 3.0
    position_damping: Positive = 1.0
    position_integral_rad_s: NonNegative = 0.3
    attitude_bandwidth_rad_s: Bandwidth = 9.0
    attitude_damping: Positive = 1.0
    attitude_integral_rad_s: NonNegative = 0.5
    arm_bandwidth_rad_s: NonNegative = 3.0
    # of arms with position servos
    torque_bandwidth_rad_s: Bandwidth = 10.0  # of a joint's torque loop, with the link held
    deflection_bandwidth_rad_s: Bandwidth = 0.5  # of a joint's output position loop
    hand_speed_max_mps: float = Field(default=0.15, gt=0, le=2)
    force_estimator: Literal["torque", "cartesian"] = "torque"  # Suarez 2020 (26): "cartesian"
    friction_feed_forward: NonNegative = 0.0  # assumed friction of the surface; 0: none
    tilt_max_deg: Positive = 25.0
    rate_hz: Positive = 500.0
    observer_bandwidth_rad_s: Positive = 12.0
    # law "cascade"
    # ratio of the bandwidths of a loop and of the one that encloses it
    loop_separation: float = Field(default=2.5, ge=1.5)
    phase_margin_deg: float = Field(default=60.0, ge=30.0, lt=90.0)  # of the rate loop
    # damping ratio of the swing of a link without a servo
    swing_damping: float = Field(default=0.5, gt=0.0, lt=1.0)
    # largest |S| of the motion loop with such a link; 0: position_bandwidth_rad_s sets the motion
    # loop
    motion_sensitivity: float = Field(default=0.0, ge=0.0, le=3.0)
    speed_max_mps: Positive = 1.0
    acceleration_max_mps2: Positive = 0.8

    @field_validator("rate_hz")
    @classmethod
    def _rate_divides_the_physics(cls, rate: float) -> float:
        if rate not in CONTROL_RATES:
            valid = ", ".join(f"{r:g}" for r in CONTROL_RATES)
            raise ValueError(f"must divide the physics rate of 1000 Hz; valid: {valid}")
        return rate


class Robot(Spec):
    """The root `robot`."""

    name: Name
    description: str = ""
    paper: str = ""
    extends: str | None = None  # robot (name or file) that this file modifies
    platform: Platform
    rotors: Rotors
    battery: Battery
    pendulum: Link | None = None  # passive link that carries the arm (long reach)
    arm: Arm | None = None
    probe: Probe | None = None
    force_sensor: ForceSensor | None = None
    docking: Docking | None = None
    sensors: Sensors = Sensors()
    actuators: Actuators = Actuators()
    camera: Camera | None = None
    prism: Prism | None = None  # localisation by a total station: prism, camera, range finder
    tracking_camera: TrackingCamera | None = None
    range_finder: RangeFinder | None = None
    control: Control = Control()
    meshes: dict[str, MeshTable] = {}  # meshes with which parts are drawn

    @field_validator("pendulum")
    @classmethod
    def _pendulum_hangs(cls, link: Link | None) -> Link | None:
        if link is None:
            return None
        if link.joint != "hinge":
            raise ValueError(f"joint is {link.joint!r}; valid: 'hinge', since a pendulum swings")
        if link.parent is not None:
            raise ValueError("a pendulum hangs from the platform and cannot have a parent")
        if link.flex_stiffness_nm_per_rad is not None:
            raise ValueError(
                "flex_stiffness_nm_per_rad: a passive joint has no servo and no joint spring"
            )
        return link.model_copy(update={"passive": True, "along": "-z"})

    @model_validator(mode="after")
    def _pendulum_needs_arm(self) -> Robot:
        if self.pendulum is None:
            return self
        if self.arm is None:
            raise ValueError("a pendulum requires an arm")
        for name in ("mount_x_m", "mount_z_m"):
            if value := getattr(self.arm, name):
                raise ValueError(
                    f"arm.{name} is {value:g}; valid: 0, since a pendulum carries the arm at its "
                    f"end: pendulum.{name[6:]} and pendulum.length_m place it"
                )
        moving = sum(link.joint != "fixed" for s in self.arm.chains for link in s.values())
        if moving + 1 > MAX_JOINTS:
            raise ValueError(f"{moving + 1} joints; at most {MAX_JOINTS} are supported")
        return self

    @model_validator(mode="after")
    def _meshes_are_on_parts(self) -> Robot:
        valid = ["platform", *self._list_limbs()]
        for name, mesh in self.meshes.items():
            if mesh.on not in valid:
                raise ValueError(f"meshes.{name}.on is {mesh.on!r}; valid: {', '.join(valid)}")
        return self

    def _list_limbs(self) -> list[str]:
        """Return the names of the arms' links as parts of the scene."""
        if self.arm is None:
            return []
        if self.arm.sides == 1:
            return sorted(self.arm.links)
        sides = zip(("left", "right"), self.arm.chains, strict=True)
        return [f"{side}_{name}" for side, links in sides for name in sorted(links)]

    @model_validator(mode="after")
    def _probe_needs_arm(self) -> Robot:
        if self.probe is not None and self.arm is None:
            raise ValueError("a probe requires an arm")
        if self.probe is not None and self.arm is not None:
            on, valid = self.probe.on, self._list_limbs()
            if on is not None and on not in valid:
                raise ValueError(f"probe.on is {on!r}; valid: {valid}")
            if self.arm.bar is not None:
                raise ValueError(
                    f"arm.bar needs two hands, but the {(on or 'left').split('_')[0]} arm has the "
                    "probe instead: remove [robot.probe] or [robot.arm.bar]"
                )
        return self

    @model_validator(mode="after")
    def _force_sensor_needs_probe(self) -> Robot:
        if self.force_sensor is not None and self.probe is None:
            raise ValueError("a force_sensor requires a probe: it is mounted in the probe's slider")
        return self
