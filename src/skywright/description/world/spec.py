"""Keys of a world file: the root `world`. W is ENU with the ground at z = 0."""

from __future__ import annotations

import math
from typing import Literal

from pydantic import Field, model_validator

from skywright.core.spec import Coordinate, Fraction, Name, NonNegative, Positive, Spec
from skywright.description.world.gnss import Gnss
from skywright.description.world.localisation import TotalStation
from skywright.description.world.origin import Origin
from skywright.description.world.radio import Radio
from skywright.description.world.structure import Structure
from skywright.description.world.thing import Thing
from skywright.description.world.things import T, check_things, drop_things, find_thing


class Pipe(Spec):
    """A pipe: a cylinder with its centre at (x, y, z).

    Its axis points along +y at yaw 0 and inclination 0; `yaw_deg` rotates it about z,
    `inclination_deg` raises its +y end, `roll_deg` rotates it about its axis. The circumferential
    angle phi of a surface point is zero at the side facing -x (at yaw 0 and roll 0) and increases
    towards the top.
    """

    diameter_m: Positive = 0.4
    length_m: Positive = 0.5
    x_m: Coordinate = 2.0
    y_m: Coordinate = 0.0
    z_m: Coordinate = 1.5
    yaw_deg: float = 0.0
    inclination_deg: float = Field(default=0.0, ge=-90, le=90)
    # raises the origin of the angle phi
    roll_deg: float = Field(default=0.0, ge=-180, le=180)
    friction: NonNegative = 0.2  # mean coefficient between the probe's tip and the surface
    # standard deviation of the friction relative to its mean
    friction_variation: float = Field(default=0.0, ge=0, le=1)
    friction_length_m: Positive = 0.03  # correlation length of the friction along the surface
    conductivity_s_per_m: Positive = 5.0e6
    relative_permeability: Positive = 100.0
    supports: bool = True  # two posts from the ground, near the ends
    tracked: bool = False  # motion capture measures its pose with markers on it


class Weld(Spec):
    """A weld on the unrolled surface (s along the axis, c = R phi around it).

    It is the intersection of the pipe with an oblique plane, a closed line around the pipe: at phi
    = `around_deg` it passes through s = `offset_m` at `angle_deg` from the circumferential
    direction. 0 is a girth weld, 90 a seam along the axis, `offset_m` beside `around_deg`.
    """

    present: bool = True
    angle_deg: float = Field(default=10.0, gt=-90, le=90)
    offset_m: float = 0.0
    around_deg: float = Field(default=0.0, ge=-180, le=180)
    half_width_m: Positive = 0.005
    conductivity_change: float = Field(default=-0.1, gt=-1)  # fraction
    permeability_change: float = Field(default=-0.35, gt=-1)  # fraction


class Tube(Spec):
    """A straight pipe of a structure, from one end of its axis to the other."""

    x_m: Coordinate
    y_m: Coordinate
    z_m: Coordinate
    to_x_m: Coordinate
    to_y_m: Coordinate
    to_z_m: Coordinate
    diameter_m: Positive = 0.1

    @model_validator(mode="after")
    def _has_length(self) -> Tube:
        if self.length_m < 1e-3:
            raise ValueError("the two ends are the same point")
        return self

    @property
    def length_m(self) -> float:
        """Distance between the ends."""
        return math.dist((self.x_m, self.y_m, self.z_m), (self.to_x_m, self.to_y_m, self.to_z_m))


class Passage(Spec):
    """A gap between two things, meant for a robot to fly through; it is given by names.

    The opening follows from the geometry, the required size from the robot.
    """

    between: list[str] = Field(min_length=2, max_length=2)  # tubes, or "ground" or "ceiling"
    # the robot's height, the platform's width or the bar's length has to fit
    needs: Literal["robot", "platform", "bar"]


class Area(Spec):
    """Region of a robot with everything that it carries; the ground is the floor."""

    x_min_m: Coordinate = -50.0
    x_max_m: Coordinate = 50.0
    y_min_m: Coordinate = -50.0
    y_max_m: Coordinate = 50.0
    z_max_m: float = Field(default=50.0, gt=0, le=1000)

    @model_validator(mode="after")
    def _limits_do_not_cross(self) -> Area:
        for a in "xy":
            low, high = getattr(self, f"{a}_min_m"), getattr(self, f"{a}_max_m")
            if low >= high:
                raise ValueError(f"{a}_min_m {low:g} must be below {a}_max_m {high:g}")
        return self


class Fan(Spec):
    """A fan whose free round jet blows on the robot; speed and heading are those of the wind.

    `world.wind.mean_mps` is the air speed at the outlet; `toward_deg` and `vertical_mps` set its
    direction.
    """

    x_m: float = -1.5  # centre of the outlet
    y_m: float = 0.0
    z_m: float = 1.5
    diameter_m: Positive = 0.4
    # rms of each component, relative to the local mean speed
    turbulence: float = Field(default=0.2, ge=0, le=0.5)
    turbulence_length_m: Positive = 0.3  # size of the eddies
    sweep_deg: float = Field(default=0.0, ge=0, le=90)  # to each side; 0 is a static fan
    sweep_period_s: Positive = 12.0


class Dryden(Spec):
    """Turbulence of MIL-F-8785C at low altitude, added to the wind's mean.

    `severity` "mean" uses the wind at 20 ft (W20) that belongs to the mean wind; light, moderate
    and severe are the standard's 15, 30 and 45 knots. `w20_mps` overrides it, `sigma_mps` both.
    """

    severity: Literal["mean", "light", "moderate", "severe"] = "mean"
    w20_mps: NonNegative | None = None  # wind at 20 ft (6.1 m) that sets the turbulence
    sigma_mps: NonNegative | None = None  # rms along and across the wind; vertical follows
    height_m: float = Field(default=3.048, ge=3.048, le=304.8)  # the standard starts at 10 ft


class Wind(Spec):
    """Air moving in W. `toward_deg` is the direction of its motion, from +x counter-clockwise.

    If `kind` is not set, it is steady with a speed and none without: `mean_mps` alone can be set
    or varied.
    """

    kind: Literal["none", "steady", "fan", "dryden"] = "none"
    mean_mps: NonNegative = 0.0
    toward_deg: float = 0.0
    vertical_mps: float = 0.0
    fan: Fan = Fan()
    dryden: Dryden = Dryden()

    @model_validator(mode="before")
    @classmethod
    def _a_speed_alone_is_steady(cls, data: object) -> object:
        """Infer the kind if it is not given: `--set world.wind.mean_mps=6` is sufficient."""
        if isinstance(data, dict) and "kind" not in data:
            moving = any(
                data.get(key) not in (None, 0, 0.0) for key in ("mean_mps", "vertical_mps")
            )
            return {**data, "kind": "steady" if moving else "none"}
        return data

    @model_validator(mode="after")
    def _none_is_calm(self) -> Wind:
        if self.kind == "none" and (self.mean_mps > 0.0 or self.vertical_mps != 0.0):
            raise ValueError(
                f"kind = 'none' contradicts mean_mps = {self.mean_mps:g}, vertical_mps = "
                f"{self.vertical_mps:g}: set kind to steady, fan or dryden"
            )
        return self

    @model_validator(mode="after")
    def _fan_and_turbulence_need_wind(self) -> Wind:
        if self.kind == "fan" and self.mean_mps == 0.0:
            raise ValueError("kind = 'fan' requires mean_mps above 0, the speed at its outlet")
        if self.kind == "dryden" and self.mean_mps == 0.0:
            raise ValueError("kind = 'dryden' requires mean_mps above 0")
        return self

    @property
    def gusty(self) -> bool:
        """Whether the wind is turbulent."""
        return self.kind in ("fan", "dryden")


class Mocap(Spec):
    """Motion capture of the vehicle and of the probe."""

    rate_hz: float = Field(default=100.0, gt=0, le=500)
    latency_s: float = Field(default=0.008, ge=0, le=0.1)
    position_noise_m: NonNegative = 0.0003
    attitude_noise_rad: NonNegative = 0.002
    dropout_fraction: Fraction = 0.01
    calibration_m: NonNegative = 0.001  # stated accuracy (1 sigma) of the probe's markers
    outlier_fraction: Fraction = 0.0  # of the samples of each body: swapped or false markers
    outlier_m: float = Field(default=2.0, ge=0.01)  # largest outlier; sizes are log-uniform


class Link(Spec):
    """The link between robot and controller, in each direction; all zero: both are one computer."""

    delay_s: float = Field(default=0.0, ge=0, le=0.2)  # mean
    jitter_s: float = Field(default=0.0, ge=0, le=0.05)  # standard deviation
    loss_fraction: float = Field(default=0.0, ge=0, lt=1)  # of packets


class Effects(Spec):
    """Components that act on the robot, by name: `[world.effects.NAME] kind = ...`."""


class World(Spec):
    """The root `world`."""

    name: Name
    description: str = ""
    origin: Origin | None = None  # position of W on the earth, for `go_to_geo`
    gravity_mps2: Positive = 9.81
    air_density_kg_m3: Positive = 1.2
    pipe: Pipe | None = None
    structure: Structure | None = None
    weld: Weld | None = None
    welds: dict[str, Weld] = {}  # additional welds
    things: dict[str, Thing] = {}  # objects in the world, models/things/
    tubes: dict[str, Tube] = {}
    passages: dict[str, Passage] = {}
    area: Area | None = None
    scenario_seed: int | None = Field(default=None, ge=0)  # random tubes and passages instead
    difficulty: Fraction = 0.5  # of a random scenario: narrower, and three structures above 0.5
    wind: Wind = Wind()
    # system that measures the robot's pose or position
    localisation: Literal["mocap", "gnss", "total-station"] = "mocap"
    mocap: Mocap = Mocap()
    gnss: Gnss = Gnss()
    total_station: TotalStation = TotalStation()
    link: Link = Link()
    radio: Radio = Radio()
    effects: Effects = Effects()

    @model_validator(mode="after")
    def _passages_name_tubes(self) -> World:
        if self.scenario_seed is None:
            for name, passage in self.passages.items():
                for end in passage.between:
                    if end not in (*self.tubes, "ground", "ceiling"):
                        raise ValueError(
                            f"passages.{name}.between names {end!r}; valid: ground, ceiling, "
                            f"{', '.join(self.tubes)}"
                        )
                if passage.between[0] == passage.between[1]:
                    raise ValueError(
                        f"passages.{name}.between names {passage.between[0]!r} twice; valid: two "
                        "different ends"
                    )
                if "ceiling" in passage.between and self.area is None:
                    raise ValueError(
                        f"passages.{name} ends at the ceiling: this requires [world.area]"
                    )
        return self

    @model_validator(mode="after")
    def _things_go_together(self) -> World:
        check_things(self.things)
        return self

    @property
    def tracks_markers(self) -> bool:
        """Whether the localisation measures poses of markers (platform, probe, things), or a
        position."""
        return self.localisation == "mocap"

    def find_thing(self, name: str, cls: type[T]) -> T:
        """Return the thing of that name and class; InputError otherwise, with the valid names."""
        return find_thing(self.things, name, cls, self.name)

    def drop_things(self, *names: str) -> World:
        """Return the world without these things and those on them."""
        return self.model_copy(update={"things": drop_things(self.things, *names)})

    def add_thing(self, name: str, thing: Thing) -> World:
        """Return the world with this thing added, or replaced if the name exists."""
        return self.model_copy(update={"things": self.things | {name: thing}})

    def list_welds(self) -> list[Weld]:
        """Return the pipe's welds that are present."""
        return [w for w in (self.weld, *self.welds.values()) if w is not None and w.present]

    @model_validator(mode="after")
    def _weld_needs_pipe(self) -> World:
        if (self.weld is not None or self.welds) and self.pipe is None:
            raise ValueError("a weld requires a pipe")
        if self.structure is not None and self.pipe is not None:
            raise ValueError("a world cannot have both a pipe and a structure")
        if self.pipe is not None:
            up, half = math.radians(self.pipe.inclination_deg), self.pipe.length_m / 2
            drop = half * abs(math.sin(up)) + self.pipe.diameter_m / 2 * math.cos(up)
            if self.pipe.z_m < drop:
                raise ValueError(f"the pipe reaches {drop - self.pipe.z_m:.2f} m below the ground")
            for weld in self.list_welds():
                steep = math.inf if weld.angle_deg == 90 else math.tan(math.radians(weld.angle_deg))
                least = abs(weld.offset_m) - self.pipe.diameter_m / 2 * abs(steep)
                if least > half:
                    raise ValueError(
                        f"the weld at offset_m = {weld.offset_m:g} lies beyond the pipe's ends at "
                        f"{-half:g} and {half:g} m"
                    )
        return self
