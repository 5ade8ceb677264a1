"""What a world file may say: the root `world`. W is ENU with the ground at z = 0."""

from __future__ import annotations

import math
from typing import Literal

from pydantic import Field, model_validator

from skywright.core.spec import Coordinate, Fraction, Name, NonNegative, Positive, Spec
from skywright.core.types import MAX_OBJECTS
from skywright.description.world.gnss import Gnss
from skywright.description.world.insertion import Peg, Socket
from skywright.description.world.localisation import TotalStation
from skywright.description.world.structure import Structure
from skywright.description.world.things import Bench, Marker, Pad, Thing
from skywright.description.world.tool import Tool


class Pipe(Spec):
    """A pipe: a cylinder whose centre sits at (x, y, z).

    Its axis points along +y at yaw 0 and inclination 0; `yaw_deg` turns it about z,
    `inclination_deg` lifts its +y end. The circumferential angle phi of a surface point is zero
    at the side facing -x (at yaw 0) and grows towards the top.
    """

    diameter_m: Positive = 0.4
    length_m: Positive = 0.5
    x_m: Coordinate = 2.0
    y_m: Coordinate = 0.0
    z_m: Coordinate = 1.5
    yaw_deg: float = 0.0
    inclination_deg: float = Field(default=0.0, ge=-90, le=90)
    friction: NonNegative = 0.2  # mean coefficient between the probe's tip and the surface
    friction_variation: float = Field(default=0.0, ge=0, le=1)  # standard deviation over the mean
    friction_length_m: Positive = 0.03  # correlation length of the friction along the surface
    conductivity_s_per_m: Positive = 5.0e6
    relative_permeability: Positive = 100.0
    supports: bool = True  # two posts from the ground, near the ends
    tracked: bool = False  # motion capture sees targets on it and tells where it is


class Weld(Spec):
    """A straight weld on the unrolled surface (s along the axis, c = R phi around it).

    `offset_m` is s where the line meets phi = 0. `angle_deg` is measured from the circumferential
    direction: 0 is a girth weld, 90 a seam along the axis.
    """

    present: bool = True
    angle_deg: float = Field(default=10.0, gt=-90, le=90)
    offset_m: float = 0.0
    half_width_m: Positive = 0.005
    conductivity_change: float = Field(default=-0.1, gt=-1)  # fraction
    permeability_change: float = Field(default=-0.35, gt=-1)  # fraction


class Box(Spec):
    """A fixed box obstacle; `pad` upholsters its face towards -x (turned by yaw)."""

    x_m: float
    y_m: float
    z_m: float
    size_x_m: Positive
    size_y_m: Positive
    size_z_m: Positive
    yaw_deg: float = 0.0
    pad: Pad | None = None


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
    """A gap between two things that a robot is meant to go through: names, not numbers.

    The opening follows from the geometry, what the robot needs from the robot.
    """

    between: list[str] = Field(min_length=2, max_length=2)  # tubes, or "ground" or "ceiling"
    needs: Literal["robot", "platform", "bar"]  # height of all, width of the platform, bar's length


class Area(Spec):
    """Where a robot may be, with everything that it carries; the ground is the floor."""

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

    `world.wind.mean_mps` is the air speed at the outlet, `toward_deg` and `vertical_mps` aim it.
    """

    x_m: float = -1.5  # centre of the outlet
    y_m: float = 0.0
    z_m: float = 1.5
    diameter_m: Positive = 0.4
    turbulence: float = Field(default=0.2, ge=0, le=0.5)  # rms of each component, over local speed
    turbulence_length_m: Positive = 0.3  # size of the eddies
    sweep_deg: float = Field(default=0.0, ge=0, le=90)  # to each side; 0 is a static fan
    sweep_period_s: Positive = 12.0


class Dryden(Spec):
    """Turbulence of MIL-F-8785C at low altitude, on top of the wind's mean.

    `severity` "mean" takes the wind at 20 ft (W20) that belongs to the mean wind; light, moderate
    and severe are the standard's 15, 30 and 45 knots. `w20_mps` overrides it, `sigma_mps` both.
    """

    severity: Literal["mean", "light", "moderate", "severe"] = "mean"
    w20_mps: NonNegative | None = None  # wind at 20 ft (6.1 m) that sets the turbulence
    sigma_mps: NonNegative | None = None  # rms along and across the wind; vertical follows
    height_m: float = Field(default=3.048, ge=3.048, le=304.8)  # the standard starts at 10 ft


class Wind(Spec):
    """Air moving in W. `toward_deg` is where it blows to, from +x counter-clockwise."""

    kind: Literal["none", "steady", "fan", "dryden"] = "none"
    mean_mps: NonNegative = 0.0
    toward_deg: float = 0.0
    vertical_mps: float = 0.0
    fan: Fan = Fan()
    dryden: Dryden = Dryden()

    @model_validator(mode="before")
    @classmethod
    def _a_speed_alone_is_steady(cls, data: object) -> object:
        """`--set world.wind.mean_mps=6` says enough: the kind follows where it is not given."""
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
            raise ValueError("kind = 'fan' needs mean_mps above 0: the speed at its outlet")
        if self.kind == "dryden" and self.mean_mps == 0.0:
            raise ValueError(
                "kind = 'dryden' needs mean_mps above 0: the mean wind carries the turbulence past"
            )
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
    outlier_fraction: Fraction = 0.0  # of samples, a body each: swapped or false markers
    outlier_m: float = Field(default=2.0, ge=0.01)  # largest artefact; sizes are log-uniform


class Link(Spec):
    """The link between robot and controller, each way; all zero: they are one computer."""

    delay_s: float = Field(default=0.0, ge=0, le=0.2)  # mean
    jitter_s: float = Field(default=0.0, ge=0, le=0.05)  # standard deviation
    loss_fraction: float = Field(default=0.0, ge=0, lt=1)  # of packets


class Tape(Spec):
    """Double-sided tape on what a hand carries: pressed on, it stays; pulled off, one side gives.

    The bond grows with the pressing: strength * (1 - exp(-impulse / press)). While the hand pulls
    back, tape and holder stretch until the weaker of bond and holder lets go: the holder, and the
    sensor stays on the surface; the bond, and it comes off again.
    """

    hand: Literal["left", "right"] = "left"
    strength_n: Positive = 5.0  # of the bond, in tension, pressed for long
    press_n_s: Positive = 4.0  # N s of pressing after which 63 % of it are reached
    release_n: Positive = 1.0  # pull at which the holder lets go of the sensor
    stiffness_n_per_m: Positive = 1000.0  # of tape and holder together


class Effects(Spec):
    """Components that act on the robot, by name: `[world.effects.NAME] kind = ...`."""


class World(Spec):
    """The root `world`."""

    name: Name
    description: str = ""
    gravity_mps2: Positive = 9.81
    air_density_kg_m3: Positive = 1.2
    pipe: Pipe | None = None
    structure: Structure | None = None
    weld: Weld | None = None
    obstacles: dict[str, Box] = {}
    tubes: dict[str, Tube] = {}
    passages: dict[str, Passage] = {}
    area: Area | None = None
    scenario_seed: int | None = Field(default=None, ge=0)  # draws tubes and passages instead
    difficulty: Fraction = 0.5  # of a drawn scenario: narrower, and three structures above 0.5
    tape: Tape | None = None
    objects: dict[str, Thing] = Field(default={}, max_length=MAX_OBJECTS)
    tool: Tool | None = None
    peg: Peg | None = None
    socket: Socket | None = None
    rack: Socket | None = None  # where the peg bar stands at first
    bench: Bench | None = None
    marker: Marker | None = None
    wind: Wind = Wind()
    localisation: Literal["mocap", "gnss", "total-station"] = "mocap"  # tells the robot its place
    mocap: Mocap = Mocap()
    gnss: Gnss = Gnss()
    total_station: TotalStation = TotalStation()
    link: Link = Link()
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
                if "ceiling" in passage.between and self.area is None:
                    raise ValueError(f"passages.{name} ends at the ceiling: give an area")
        return self

    @property
    def things(self) -> list[str]:
        """Names of everything that moves, in the order of the scene; tool or peg bar come last."""
        given = {"tool": self.tool, "peg": self.peg}
        return [*self.objects, *(name for name, thing in given.items() if thing is not None)]

    @model_validator(mode="after")
    def _tool_stands_on_an_obstacle(self) -> World:
        if self.tool is None:
            return self
        if self.tool.on not in self.obstacles:
            valid = ", ".join(self.obstacles) or "none, the world has no obstacles"
            raise ValueError(f"tool.on is {self.tool.on!r}; valid: {valid}")
        if "tool" in self.objects or len(self.objects) >= MAX_OBJECTS:
            raise ValueError(
                f"beside a tool there is room for {MAX_OBJECTS - 1} objects, none named 'tool'"
            )
        return self

    @model_validator(mode="after")
    def _peg_stands_in_the_rack(self) -> World:
        if self.peg is None:
            return self
        if self.rack is None:
            raise ValueError("a peg bar stands in a rack at first: give it a [world.rack] table")
        if "peg" in self.objects or len(self.things) > MAX_OBJECTS:
            raise ValueError(
                f"with tool and peg bar there are {MAX_OBJECTS} movable things at most, and no "
                "object is named 'peg'"
            )
        return self

    @model_validator(mode="after")
    def _marker_sits_on_a_thing(self) -> World:
        on = self.marker.on if self.marker is not None else None
        if on is not None and on not in self.things:
            valid = ", ".join(self.things) or "none, the world has no objects"
            raise ValueError(f"marker.on is {on!r}; valid: {valid}")
        return self

    @model_validator(mode="after")
    def _weld_needs_pipe(self) -> World:
        if self.weld is not None and self.pipe is None:
            raise ValueError("a weld needs a pipe")
        if self.structure is not None and self.pipe is not None:
            raise ValueError("a world has a pipe or a structure to touch, not both")
        if self.pipe is not None:
            bottom = self.pipe.z_m - self.pipe.diameter_m / 2
            if bottom < 0:
                raise ValueError(f"the pipe reaches {-bottom:.2f} m below the ground")
        return self
