"""What stands or lies in a world: the abstract thing, and the plain data that it consists of.

A kind of thing is a subclass in a file of its own: `models/things/<kind>.py`, a user's file
(`kind = "my_thing.py:HandWheel"`) or an installed package (entry points `skywright.things`). Its
fields are the keys of its table `[world.things.NAME]`. It says what it consists of as data; the
scene (models/things/_build.py), drawings and planners are made from that.

Frames: W world; a thing's own frame O; `Frame`s name a place of O for other things and missions.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from skywright.core.open_spec import OpenSpec
from skywright.core.rotations import rot_z
from skywright.core.spec import Coordinate

Array = NDArray[np.float64]

Vector = Sequence[float] | Array


class Frame(NamedTuple):
    """A place and attitude in an outer frame: p (3,) m, R (3, 3)."""

    p: Array
    R: Array

    def at(self, inner: Frame) -> Frame:
        """Return a frame that is given in this one, in the outer frame."""
        return Frame(self.p + self.R @ inner.p, self.R @ inner.R)


def build_frame(x: float = 0.0, y: float = 0.0, z: float = 0.0, R: Array | None = None) -> Frame:
    """Return the frame at (x, y, z) m, turned by R (3, 3)."""
    return Frame(np.array([x, y, z]), np.eye(3) if R is None else R)


class Contact(NamedTuple):
    """How a solid touches others; the defaults are MuJoCo's.

    Friction is Coulomb's. Of a pair the larger coefficient holds, or that of the higher `priority`.
    """

    friction: float = 1.0
    priority: int = 0
    torsion: bool = False
    """Whether friction also resists turning about the normal: a contact patch of 5 mm."""
    time_constant_s: float = 0.02  # two steps of the simulation (2 ms) at least; damped critically
    impedance: float = 0.9  # 0 soft to 1 hard, at no depth


SOFT = Contact(torsion=True, time_constant_s=0.008)
"""Of what hands hold: eight steps, so that half a kilogram sinks in by less than 0.1 mm."""


class Solid(NamedTuple):
    """A rigid shape in the frame of its part; cylinders and capsules lie along z.

    `size` (m): the half edges of a box; radius and half length of a cylinder or capsule (without
    its caps); the radius of a sphere. A capsule may be given by its `ends` instead: size is then
    its radius alone, and `frame` is not looked at.
    """

    shape: Literal["box", "cylinder", "capsule", "sphere"]
    size: Vector
    name: str = ""  # among the solids of its thing; "" for the only one
    frame: Frame = build_frame()
    mass_kg: float = 0.0
    contact: Contact = Contact()
    color: tuple[float, float, float] = (0.6, 0.5, 0.4)
    ends: tuple[Vector, Vector] | None = None


class Joint(NamedTuple):
    """How a part moves against its thing: along (slide, m) or about (hinge, rad) `axis`."""

    kind: Literal["slide", "hinge"]
    axis: Vector  # (3,), in the part's frame
    low: float  # stops, m or rad
    high: float
    stiffness: float = 0.0  # N/m or N m/rad, of a spring that rests at 0
    damping: float = 0.0  # N s/m or N m s/rad
    friction: float = 0.0  # N or N m


class Part(NamedTuple):
    """Solids that are one rigid body; one with a joint moves in the plant, else it is fixed."""

    solids: Sequence[Solid]
    joint: Joint | None = None
    name: str = ""  # among the moving parts of its thing
    frame: Frame = build_frame()  # in O
    gauged: bool = False
    """Whether a run records how hard it is hit (vehicle/observers/gauges.py)."""


class Thing(OpenSpec):
    """What stands or lies in a world; the base of every kind."""

    group: ClassVar[str] = "thing"
    is_marker: ClassVar[bool] = False
    """Whether its O is what cameras and motion capture read."""

    @property
    def movable(self) -> bool:
        """Whether it moves freely as a whole; its pose is then recorded."""
        return False

    @property
    def frees_at_n(self) -> float | None:
        """Pull (N) at which a movable thing comes free of what holds it; None: it lies loose."""
        return None

    def list_parts(self) -> list[Part]:
        """List what it consists of, in O."""
        return []

    def list_frames(self) -> dict[str, Frame]:
        """Name its frames, in O; things stand on `top`, or else on O."""
        return {}

    def extend_plant(self, spec: Any, name: str) -> None:
        """Add to the plant's MjSpec what parts cannot say; the robot is in it already."""

    def describe(self) -> str:
        """Return one line about it, for `skywright show`."""
        return self.kind


class Placed(Thing):
    """A thing with a place: O in W, or `on` another thing.

    `on = "THING"` is that thing's frame `top`, where it has one, or its O; `on = "THING.FRAME"` is
    one of its named frames. A thing stands with its foot there, (x, y) aside and z above it.
    """

    on: str | None = None
    x_m: Coordinate = 0.0
    y_m: Coordinate = 0.0
    z_m: Coordinate = 0.0
    yaw_deg: float = 0.0
    tracked: bool = False
    """Whether motion capture sees where it is. One that does not move stands in truth where
    `plant.socket_*_error` says, against the world file."""

    anywhere: ClassVar[bool] = False
    """Whether a table without a place has a meaning."""

    @property
    def foot_m(self) -> float:
        """Height of O above what it stands on."""
        return 0.0

    @property
    def attitude(self) -> Array:
        """Attitude (3, 3) of O in W, or in the frame that it is on."""
        return rot_z(math.radians(self.yaw_deg))

    @property
    def frame(self) -> Frame:
        """O in W, or in the frame that it is on, its foot left out."""
        return build_frame(self.x_m, self.y_m, self.z_m, self.attitude)

    @model_validator(mode="after")
    def _has_a_place(self) -> Placed:
        lacking = [k for k in ("x_m", "y_m", "z_m") if k not in self.model_fields_set]
        if self.on is None and lacking and not self.anywhere:
            raise ValueError(
                f"lacks {', '.join(lacking)}: give a position in the world, or `on` another thing"
            )
        return self


class Fixture(Placed):
    """A thing that clamps the platform: its O is where the platform's origin is held.

    Its `extend_plant` adds the constraint CLAMP between the platform and a body of its own that is
    moved by hand (MuJoCo's "mocap" body).
    """

    CLAMP: ClassVar[str] = "clamp"

    @property
    def q_WB(self) -> tuple[float, float, float, float]:
        """Attitude of the platform (wxyz)."""
        raise NotImplementedError


Things = Mapping[str, Thing]
