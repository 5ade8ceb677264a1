"""The base class of objects in a world, and the plain data that they consist of.

A kind of thing is a subclass in its own file: `models/things/<kind>.py`, a user's file (`kind =
"my_thing.py:HandWheel"`) or an installed package (entry points `skywright.things`). Its fields are
the keys of its table `[world.things.NAME]`. It returns its parts as data, from which the scene
(models/things/_build.py), drawings and planners are built.

Frames: W world; a thing's own frame O; `Frame`s are named frames in O for other things and
missions.
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
    """A position and attitude in an outer frame: p (3,) m, R (3, 3)."""

    p: Array
    R: Array

    def at(self, inner: Frame) -> Frame:
        """Return a frame that is given in this one, expressed in the outer frame."""
        return Frame(self.p + self.R @ inner.p, self.R @ inner.R)


def build_frame(x: float = 0.0, y: float = 0.0, z: float = 0.0, R: Array | None = None) -> Frame:
    """Return the frame at (x, y, z) m, rotated by R (3, 3)."""
    return Frame(np.array([x, y, z]), np.eye(3) if R is None else R)


class Contact(NamedTuple):
    """Contact parameters of a solid; the defaults are MuJoCo's.

    Friction is Coulomb's. A pair uses the larger coefficient, or that of the higher `priority`.
    """

    friction: float = 1.0
    priority: int = 0
    torsion: bool = False
    """Whether friction also resists rotation about the normal: a contact patch of 5 mm."""
    time_constant_s: float = 0.02  # at least two steps of the simulation (2 ms); critically damped
    impedance: float = 0.9  # 0 soft to 1 hard, at zero depth


SOFT = Contact(torsion=True, time_constant_s=0.008)
"""Contact of objects held in hands: eight steps, so that half a kilogram penetrates less than 0.1
mm."""


class Solid(NamedTuple):
    """A rigid shape in the frame of its part; cylinders and capsules are along z.

    `size` (m): the half edges of a box; radius and half length of a cylinder or capsule (without
    its caps); the radius of a sphere. A capsule may be given by its `ends` instead: size is then
    its radius alone, and `frame` is ignored.
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
    """Motion of a part relative to its thing: along (slide, m) or about (hinge, rad) `axis`."""

    kind: Literal["slide", "hinge"]
    axis: Vector  # (3,), in the part's frame
    low: float  # stops, m or rad
    high: float
    stiffness: float = 0.0  # N/m or N m/rad, of a spring with its rest position at 0
    damping: float = 0.0  # N s/m or N m s/rad
    friction: float = 0.0  # N or N m


class Part(NamedTuple):
    """Solids that form one rigid body; with a joint it moves in the plant, else it is fixed."""

    solids: Sequence[Solid]
    joint: Joint | None = None
    name: str = ""  # among the moving parts of its thing
    frame: Frame = build_frame()  # in O
    gauged: bool = False
    """Whether a run records its contact force (vehicle/observers/gauges.py)."""


class Thing(OpenSpec):
    """An object in a world; the base of every kind."""

    group: ClassVar[str] = "thing"
    is_marker: ClassVar[bool] = False
    """Whether cameras and motion capture measure its O."""

    @property
    def movable(self) -> bool:
        """Whether it moves freely as a whole; its pose is then recorded."""
        return False

    @property
    def frees_at_n(self) -> float | None:
        """Pull (N) at which a movable thing is released; None: it is not held."""
        return None

    def list_parts(self) -> list[Part]:
        """Return its parts, in O."""
        return []

    def list_frames(self) -> dict[str, Frame]:
        """Return its named frames, in O; other things stand on `top`, otherwise on O."""
        return {}

    def extend_plant(self, spec: Any, name: str) -> None:
        """Add to the plant's MjSpec elements that parts cannot express; it contains the robot
        already."""

    def describe(self) -> str:
        """Return a description of one line, for `skywright show`."""
        return self.kind


class Placed(Thing):
    """A thing with a pose: O in W, or `on` another thing.

    `on = "THING"` is that thing's frame `top`, if it has one, otherwise its O; `on = "THING.FRAME"`
    is one of its named frames. A thing stands there with its foot, offset by (x, y) horizontally
    and by z upwards.
    """

    on: str | None = None
    x_m: Coordinate = 0.0
    y_m: Coordinate = 0.0
    z_m: Coordinate = 0.0
    yaw_deg: float = 0.0
    tracked: bool = False
    """Whether motion capture measures its pose. The true pose of a tracked thing that does not move
    deviates from the world file by `plant.socket_*_error`."""

    anywhere: ClassVar[bool] = False
    """Whether the position may be omitted."""

    @property
    def foot_m(self) -> float:
        """Height of O above its support."""
        return 0.0

    @property
    def attitude(self) -> Array:
        """Attitude (3, 3) of O in W, or in the frame that it is on."""
        return rot_z(math.radians(self.yaw_deg))

    @property
    def frame(self) -> Frame:
        """O in W, or in the frame that it is on, without the height of its foot."""
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
    """A thing that clamps the platform: it holds the platform's origin at its O.

    Its `extend_plant` adds the constraint CLAMP between the platform and a separate body of
    prescribed motion (MuJoCo's "mocap" body).
    """

    CLAMP: ClassVar[str] = "clamp"

    @property
    def q_WB(self) -> tuple[float, float, float, float]:
        """Attitude of the platform (wxyz)."""
        raise NotImplementedError

    @model_validator(mode="after")
    def _is_placed_in_the_world(self) -> Fixture:
        if self.on is not None:  # the platform starts at its position in W
            raise ValueError(f"on is {self.on!r}; valid for a {self.kind}: a position in the world")
        return self


Things = Mapping[str, Thing]
