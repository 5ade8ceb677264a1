"""Base classes of components, with all names that the author of a sensor or a law imports.

A component is a class with
- `Table`: its TOML table (a Spec: units in the keys, ranges);
- `Me`: a Record of its parameters and memory, and further Records: `Output`s, which others may
  declare as ports, and `Normal` and `Uniform` draws;
- `build(me, table, context)`, which fills `Me` from the table once, in Python;
- steps: static methods whose annotations are their ports. A step with the name `step` runs in the
  component's `slot`; `slots` declares others. `Out[X]` is a port that the step fills (only one step
  may), `InOut[X]` one that it modifies afterwards; all other ports are read-only. `X | None` is an
  optional port: None if no component of the vehicle fills it, at no cost.

Numba compiles the steps (`helper` decorates the functions that they call; `words` and `table` read
arrays by address), or they run as plain Python (`compiled = False`, which selects interactive
mode). They must not allocate: use `local(3)` (core/scratch.py) for scratch, and `Me` for memory.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from skywright.core.compiled import helper, integers, table, words
from skywright.core.record import Array, Record
from skywright.core.spec import NonNegative, Spec
from skywright.core.streams import build_stream

if TYPE_CHECKING:
    from skywright.description.robot.spec import Robot
    from skywright.description.world.spec import World
    from skywright.models.allocation import Allocator
    from skywright.models.arm_body import Deviation
    from skywright.models.nominal import Nominal
    from skywright.models.rotor_loss import RotorsLeft
    from skywright.models.rotors import RotorSet
    from skywright.models.scene import Scene
    from skywright.models.spring_bench import Springs
    from skywright.vehicle.gusts import GustModel
    from skywright.vehicle.loops import AttitudeGains

SLOTS = (
    "clear", "observe", "sense", "link", "body", "estimate", "reference", "control", "derive",
    "record", "peaks", "guard", "allocate", "downlink", "actuate", "effects", "fast",
)  # fmt: skip
"""The parts of a control tick in order; rows of `fast` run after each physics step."""

__all__ = [
    "Actuator", "Component", "Context", "Draws", "Effect", "Estimator", "Fault", "InOut", "Law",
    "Normal", "Out", "Output", "PlantContext", "Recorded", "ReferenceBlock", "Sensor", "Streamed",
    "Uniform", "helper", "integers", "table", "words",
]  # fmt: skip

_T = TypeVar("_T")
Out = Annotated[_T, "out"]
"""A port that the step fills."""
InOut = Annotated[_T, "inout"]
"""A port that the step modifies after its owner has filled it."""


class Output(Record):
    """A record that a component fills and that others may declare as a port.

    A delayed link delivers the latest record. If the first field is `fresh` (float), it delivers
    new records only (`fresh` 1, cleared by the framework each tick). If the first fields are `t`,
    `n` (int) and arrays of rows, the record is a batch of samples, and all samples are delivered.
    """


class ReferenceBlock(Output):
    """A part of the reference that a component owns; the rows of the plan fill it (follower.py).

    Its fields are fields of a row (core/types.py: REFERENCE) that no other record has. `rules`
    define the interpolation of each field between rows; the default is linear.
    """

    rules: ClassVar[dict[str, int]] = {}


class Draws(Record):
    """Random numbers, new at each call of the step."""

    stream: ClassVar[str] = ""
    """Name of a stream of core/streams.py; a component from a file has its own stream."""


class Normal(Draws):
    """Standard normal numbers."""


class Uniform(Draws):
    """Uniform numbers from 0 to 1."""


@dataclass(frozen=True)
class Context:
    """Data for `build` of a component on the robot's side: nominal robot and map."""

    nominal: Nominal  # the robot, its rigid body, rotors and allocation, the world's surfaces
    world: World
    mass: float  # kg, nominal, whole robot, arm folded
    dt: float  # s, control period
    h: float  # s, physics step
    law: str  # kind of the platform's law
    asked: frozenset[type[Record]]  # records that law, estimator and parts have as ports
    records: dict[Any, NDArray[Any]]  # (1,) by (class, name); robot's side: its own only
    springs: Springs  # nominal springs of joints and force sensor
    named: tuple[Component, ...] = ()
    """Law, estimator and further parts of the description; robot's side: its own only."""
    alive: list[Any] = field(default_factory=list)
    components: Sequence[Component] = ()  # at build; robot's side: its own only
    carried: list[Any] = field(default_factory=list)  # of a link (vehicle/assembly.py: Carried)

    @property
    def robot(self) -> Robot:
        """The robot as described."""
        return self.nominal.robot

    @property
    def model(self) -> Any:
        """BodyModel record, the nominal rigid body (models/rigid_body.py)."""
        return self.nominal.model[0]

    @property
    def rotors(self) -> RotorSet:
        """The nominal rotors."""
        return self.nominal.rotors

    @property
    def allocator(self) -> Allocator:
        """The allocation of wrenches to thrusts of the nominal rotors."""
        return self.nominal.allocator

    def limit(self) -> Context:
        """Return the context for components on the robot's side."""
        return self

    def keep(self, array: NDArray[Any]) -> int:
        """Return the address of a C-contiguous array, and keep it as long as the vehicle."""
        assert array.flags.c_contiguous
        self.alive.append(array)
        return int(array.ctypes.data)


@dataclass(frozen=True)
class PlantContext(Context):
    """Data for `build` of a component on the plant's side, including the truth.

    `world` is the true world, with pipe or structure at their true poses.
    """

    known: World = None  # type: ignore[assignment]  # the world of the map
    deviation: Deviation = None  # type: ignore[assignment]
    true: Nominal = None  # type: ignore[assignment]  # robot and world with the true surfaces
    scene: Scene = None  # type: ignore[assignment]
    sim: Any = None  # Simulation: MuJoCo's model and data
    seed: int = 0
    start: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def limit(self) -> Context:
        """Return the context of the robot's side: the nominal robot and the map."""
        seen = {f.name: getattr(self, f.name) for f in fields(Context)}
        return Context(**{**seen, "world": self.known})

    def stream(self, name: str) -> np.random.Generator:
        """Return a new generator of a named random stream of this run."""
        return build_stream(self.seed, name)


class Recorded(NamedTuple):
    """A column of the samples, and the field of a record from which it is copied.

    `rotation`: the field is a rotation matrix, the column its quaternion (wxyz). `item` is an index
    of the field's first axis, such as a hand. `per` limits this axis to the actual number of
    joints, rotors, hands or objects.
    """

    name: str
    source: type[Record]
    field: str
    unit: str = ""
    meaning: str = ""
    rotation: bool = False
    item: int = -1
    per: Literal["", "joint", "rotor", "hand", "object"] = ""


class Streamed(NamedTuple):
    """Raw samples of a sensor, each recorded at its own time (vehicle/streams.py).

    `columns` are fields of one Output. An Output with `fresh` gives a row when it is new, at its
    `t` if it has one; a batch gives all its rows, one physics step apart, the last one at `t`. The
    topic is /sensors/COMPONENT, or /sensors/COMPONENT/`name` if a component has several. `paths`
    map columns to fields of a ROS 2 message of type `kind`, `numbers` are its constant fields;
    without a kind the message has the columns as fields.
    """

    columns: tuple[Recorded, ...]
    kind: str = ""
    frame: str = ""
    paths: Mapping[str, str] = {}
    numbers: Mapping[str, float] = {}
    name: str = ""


class Component:
    """Base of all components; derive from one of the groups below."""

    group: ClassVar[str] = ""
    slot: ClassVar[str] = ""
    slots: ClassVar[dict[str, str]] = {}
    """Name of a step -> its slot, for components with several steps."""
    side: ClassVar[Literal["robot", "plant"]] = "robot"
    compiled: ClassVar[bool] = True
    """False: the steps run as plain Python, and the vehicle in interactive mode."""
    ports: dict[str, str] = {}
    """Parameter of a step -> name of the component that fills it, if several do. An optional port
    with a component that the vehicle lacks is None."""
    columns: ClassVar[tuple[Recorded, ...]] = ()
    """Columns of the samples, if the vehicle has their records."""
    streams: ClassVar[tuple[Streamed, ...]] = ()
    """Raw samples that are recorded at their own rate."""
    limits: Mapping[str, tuple[float, float]] = {}
    """Range of each column that a mission sets; `build` may read it from the table."""
    Table: ClassVar[type[Spec]] = Spec

    def __init__(self, name: str, table: Any = None) -> None:
        self.name = name
        self.table: Any = self.Table() if table is None else table

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Fill `Me` (a NumPy record with named fields) from the table, once, in Python.

        `context` is a Context, or a PlantContext on the plant's side.
        """

    def get_period(self, step: str, context: Any) -> float:
        """Return the period (s) of a step: that of the table's `rate_hz`, 0 for every tick."""
        rate = getattr(self.table, "rate_hz", None)
        return 0.0 if rate is None or self.slot == "fast" else 1.0 / rate

    def draw(self, what: type[Draws], rng: np.random.Generator, n: int) -> Array:
        """Return `n` rows of random numbers (n, words); white by default."""
        size = (n, what.dtype.itemsize // 8)
        return rng.random(size) if issubclass(what, Uniform) else rng.standard_normal(size)

    def extend_scene(self, spec: Any) -> None:
        """Add elements, such as a sensor, to the scene (a mujoco.MjSpec) before its compilation;
        called before `build`, for components of the description only."""

    def before_tick(self, t: float, n_ticks: int) -> None:
        """Called in Python before a mission tick from `t` (s) with `n_ticks` control ticks."""

    def after_tick(self, t: float) -> None:
        """Called in Python after a mission tick that ended at `t` (s)."""

    def save(self) -> Any:
        """Return the state of this object outside its records."""

    def restore(self, saved: Any) -> None:
        """Restore the state that `save` returned; the records are restored before."""

    def reseed(self, seed: int) -> None:
        """Called after `restore` if a seed is given: build own random streams from this seed."""

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Yield the instances that robot and world require."""
        return ()


class Sensor(Component):
    """A sensor: reads the true state of the plant and fills an Output. `[robot.sensors.NAME]`."""

    group, slot, side = "sensor", "sense", "plant"


class Estimator(Component):
    """An estimator of the robot's state: fills Estimate. `[mission.estimator]`."""

    group, slot = "estimator", "estimate"
    needs_motion_capture: ClassVar[bool] = False
    is_truth: ClassVar[bool] = False
    """Whether it copies the truth instead of estimating the state."""

    @classmethod
    def assemble(cls, table: Any, context: Any) -> list[Component]:
        """Return the components of this estimator, usually one.

        `context` is a Context, or a PlantContext if the estimator `is_truth`.
        """
        return [cls("estimator", table)]


class Law(Component):
    """A control law of the platform (and a rigid arm): fills WrenchCommand. `[mission.law]`."""

    group, slot = "law", "control"
    needs_full_actuation: ClassVar[bool] = False
    """Whether it commands forces in any direction at any attitude."""
    presses_with_arm: ClassVar[bool] = False
    """Whether it controls the force of the block Press with the arm (vehicle/follower.py)."""
    knows_modes: ClassVar[bool] = False
    """Whether it follows `Reference.mode`."""
    commands_torque: ClassVar[bool] = False
    """Whether it commands servo torques instead of speeds."""

    def check_robot(self, robot: Robot) -> None:
        """Raise InputError if the robot lacks parts that the law requires."""

    def give_up_rotor(self, me: Any, left: RotorsLeft) -> None:
        """Called after the loss of a rotor; laws that command thrusts override this."""

    def get_attitude_loop(self, robot: Robot) -> AttitudeGains | None:
        """Return the attitude loop, for the check of a link's delay; None if unknown."""
        return None

    def compute_borne_delay(self, nominal: Nominal, spare: float) -> float:
        """Return the one-way delay (s) for a phase margin of `spare` (rad); NaN if unknown."""
        return float("nan")

    def find_unflyable(self, nominal: Nominal) -> str | None:
        """Return why this law cannot fly the robot, for the check before take-off; None: it can."""
        return None

    def compute_rate_torque(self, nominal: Nominal, I_C: Array) -> Array | None:
        """Return the torque (3, 2) N m per rad/s of roll and pitch for `I_C` (3, 3), or None."""
        loop = self.get_attitude_loop(nominal.robot)
        return None if loop is None else I_C[:, :2] * (2.0 * loop.damping * loop.bandwidth)

    def observe_wrench(self, context: Context) -> Array | None:
        """Return the bandwidths (3,) rad/s, forward, left, up, of the port Wrench; None: unused."""
        return None

    def build_gust_model(self, nominal: Nominal, yaw: float) -> GustModel | None:
        """Return a model of the motion in gusts at a heading `yaw` (rad), None if unknown."""
        return None

    def compute_push_share(self, nominal: Nominal) -> float:
        """Return the ratio of the push at a plan's depth to that of law (4)'s stiffness m w^2."""
        return 1.0

    def compute_gust_response(
        self, robot: Robot, world: World, frequencies: Array, h: float
    ) -> Array | None:
        """Return the change (n,) of the contact force per newton of a gust along the probe, at
        `frequencies` (n,) rad/s and a physics step `h` (s); None: no force loop, 1 if slow."""
        return None


class ArmsLaw(Component):
    """A control law of arms with position servos: fills ShaftCommand at the servo rate."""

    group, slot = "arms_law", "control"

    def get_period(self, step: str, context: Any) -> float:
        """Return the servos' period (s)."""
        from skywright.models.compliant_arms import count_command_ticks

        return count_command_ticks(context.robot) * float(context.dt)


class Fault(Component):
    """A fault of the plant that begins at `start_s`. `[plant.faults.NAME]`."""

    group, slot, side = "fault", "effects", "plant"
    needs_link: ClassVar[bool] = False
    """Whether it requires a control link."""

    class Table(Spec):
        """Keys of every fault: its start."""

        start_s: NonNegative = 0.0

    def resolve(self, robot: Robot, world: World, rng: np.random.Generator) -> Fault:
        """Return the fault to inject: this one, or one that `rng` draws (kind `random`)."""
        return self

    @classmethod
    def draw_table(
        cls, rng: np.random.Generator, robot: Robot, world: World
    ) -> dict[str, Any] | None:
        """Draw the keys of a fault except its start; None if it does not apply."""
        return None


class Effect(Component):
    """A force on the plant: adds to MuJoCo's external forces. `[world.effects.NAME]`."""

    group, slot, side = "effect", "effects", "plant"


class Actuator(Component):
    """An actuator other than rotors and servos: applies a Setpoint. `[robot.actuators.NAME]`."""

    group, slot, side = "actuator", "actuate", "plant"
