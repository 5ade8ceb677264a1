"""Base classes of components: everything that the author of a sensor or a law imports.

A component is a class with
- `Table`: its TOML table (a Spec: units in the keys, ranges);
- `Me`: a Record of its parameters and memory, and further Records: `Output`s that others may ask
  for as ports, `Normal` and `Uniform` draws;
- `build(me, table, context)`, which fills `Me` from the table, once, in Python;
- steps: static methods whose annotations are their ports. A step of the name `step` runs in the
  component's `slot`; `slots` names others. `Out[X]` marks the port that a step fills (one row
  does), `InOut[X]` one that it changes after that, everything else is read. `X | None` is an
  optional port: None where nothing in the vehicle fills it, at no cost.

Steps are compiled by numba (`helper` decorates what they call; `words` and `table` read arrays by
address), or run as plain Python (`compiled = False`, interactive mode only). They must not
allocate: scratch is `local(3)` (core/scratch.py), memory belongs into `Me`.
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
"""A port that the step changes after its owner filled it."""


class Output(Record):
    """A record that a component fills and that others may declare as a port.

    Over a delayed link the far end gets the latest one. With a first field `fresh` (float) it is
    delivered when it is new (`fresh` 1, cleared by the framework each tick); with first fields
    `t`, `n` (int) and arrays of rows it is a batch of samples, all of which are delivered.
    """


class ReferenceBlock(Output):
    """A part of the reference that a component owns: the plan's rows fill it (follower.py).

    Its fields are fields of a row (core/types.py: REFERENCE) that no other record has; `rules` tell
    how each is interpolated between rows, linear where it tells nothing.
    """

    rules: ClassVar[dict[str, int]] = {}


class Draws(Record):
    """Random numbers, new at each call of the step: a row of a block."""

    stream: ClassVar[str] = ""
    """Names a stream of core/streams.py; a component from a file has one of its own."""


class Normal(Draws):
    """Unit normal numbers."""


class Uniform(Draws):
    """Numbers from 0 to 1."""


@dataclass(frozen=True)
class Context:
    """Data for `build` of a component on the robot's side: nominal robot and map."""

    nominal: Nominal  # the robot, its rigid body, rotors and allocation, the world's surfaces
    world: World
    mass: float  # kg, nominal, whole robot, arm folded
    dt: float  # s, control period
    h: float  # s, physics step
    law: str  # kind of the platform's law
    asked: frozenset[type[Record]]  # records that law, estimator and parts ask for
    records: dict[Any, NDArray[Any]]  # (1,) by (class, name); the robot's side has its own only
    springs: Springs  # of joints and force sensor, as believed
    named: tuple[Component, ...] = ()
    """Law, estimator and further parts, which the description names; likewise."""
    alive: list[Any] = field(default_factory=list)
    components: Sequence[Component] = ()  # all of the vehicle, at build; likewise
    carried: list[Any] = field(default_factory=list)  # by a link (vehicle/assembly.py: Carried)

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
        """From wrenches to thrusts of the nominal rotors."""
        return self.nominal.allocator

    def limit(self) -> Context:
        """Return the part that components on the robot's side may read."""
        return self

    def keep(self, array: NDArray[Any]) -> int:
        """Return the address of a C-contiguous array, which lives as long as the vehicle."""
        assert array.flags.c_contiguous
        self.alive.append(array)
        return int(array.ctypes.data)


@dataclass(frozen=True)
class PlantContext(Context):
    """What a component of the plant's side is built from: the truth as well.

    `world` is the one flown in, with pipe or structure where they truly are.
    """

    known: World = None  # type: ignore[assignment]  # `world` as the map has it
    deviation: Deviation = None  # type: ignore[assignment]
    true: Nominal = None  # type: ignore[assignment]  # robot and world with the true surfaces
    scene: Scene = None  # type: ignore[assignment]
    sim: Any = None  # Simulation: MuJoCo's model and data
    seed: int = 0
    start: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def limit(self) -> Context:
        """Return the part for the robot's side: the nominal robot and the map."""
        seen = {f.name: getattr(self, f.name) for f in fields(Context)}
        return Context(**{**seen, "world": self.known})

    def stream(self, name: str) -> np.random.Generator:
        """Return a new generator of a named stream of this run."""
        from skywright.core.streams import build_stream

        return build_stream(self.seed, name)


class Recorded(NamedTuple):
    """A column of the samples, and the field of a record that it is copied from.

    `rotation`: the field is a rotation matrix, the column its quaternion (wxyz). `item` is that of
    the field's first axis, such as a hand. `per` cuts that axis at the number of joints, rotors,
    hands or objects that there are.
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
    """Raw samples of a sensor, recorded each at its own time (vehicle/streams.py).

    `columns` show fields of one Output: with `fresh`, a row whenever it is new, at its `t` where it
    has one; a batch, a row for each of its rows, a physics step apart and the last one at `t`. The
    topic is /sensors/COMPONENT, and `name` below it where a component has several. `paths` say
    where a message of the ROS 2 type `kind` holds the columns, `numbers` what else it holds;
    without a kind the message has the columns as they are.
    """

    columns: tuple[Recorded, ...]
    kind: str = ""
    frame: str = ""
    paths: Mapping[str, str] = {}
    numbers: Mapping[str, float] = {}
    name: str = ""


class Component:
    """Base of everything that runs every tick; subclass a group below."""

    group: ClassVar[str] = ""
    slot: ClassVar[str] = ""
    slots: ClassVar[dict[str, str]] = {}
    """Name of a step -> its slot, of components with several."""
    side: ClassVar[Literal["robot", "plant"]] = "robot"
    compiled: ClassVar[bool] = True
    """False: steps run as plain Python, which flies in interactive mode only."""
    ports: dict[str, str] = {}
    """Parameter of a step -> name of the component that fills it, where several do; an optional
    port that names a component which the vehicle lacks is None."""
    columns: ClassVar[tuple[Recorded, ...]] = ()
    """What samples tell of it, where the vehicle has the records."""
    streams: ClassVar[tuple[Streamed, ...]] = ()
    """What is recorded of it at its own rate."""
    limits: Mapping[str, tuple[float, float]] = {}
    """Least and most of columns that a mission sets; `build` may take them from the table."""
    Table: ClassVar[type[Spec]] = Spec

    def __init__(self, name: str, table: Any = None) -> None:
        self.name = name
        self.table: Any = self.Table() if table is None else table

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Fill `Me` (a NumPy record with named fields) from the table; once, in Python.

        `context` is a Context, on the plant's side a PlantContext.
        """

    def get_period(self, step: str, context: Any) -> float:
        """Return the time (s) between calls of a step: `rate_hz` of the table, else each tick."""
        rate = getattr(self.table, "rate_hz", None)
        return 0.0 if rate is None or self.slot == "fast" else 1.0 / rate

    def draw(self, what: type[Draws], rng: np.random.Generator, n: int) -> Array:
        """Return `n` rows of draws, (n, words); white by default."""
        size = (n, what.dtype.itemsize // 8)
        return rng.random(size) if issubclass(what, Uniform) else rng.standard_normal(size)

    def extend_scene(self, spec: Any) -> None:
        """Add to the plant's scene (a mujoco.MjSpec), such as a sensor, before it is compiled.

        Called for components that a description names, before `build`.
        """

    def before_tick(self, t: float, n_ticks: int) -> None:
        """Called in Python before a mission tick from `t` (s) with `n_ticks` control ticks."""

    def after_tick(self, t: float) -> None:
        """Called in Python after a mission tick that ended at `t` (s)."""

    def save(self) -> Any:
        """Return the state of this object that is not in its records."""

    def restore(self, saved: Any) -> None:
        """Restore the state that `save` returned."""

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Yield the instances that robot and world ask for by tables of their own."""
        return ()


class Sensor(Component):
    """A sensor: reads the true state of the plant and fills an Output. `[robot.sensors.NAME]`."""

    group, slot, side = "sensor", "sense", "plant"


class Estimator(Component):
    """An estimator of the robot's state: fills Estimate. `[mission.estimator]`."""

    group, slot = "estimator", "estimate"
    needs_motion_capture: ClassVar[bool] = False
    is_truth: ClassVar[bool] = False
    """Whether it tells the truth instead of estimating it."""

    @classmethod
    def assemble(cls, table: Any, context: Any) -> list[Component]:
        """Return the components of this estimator for a robot in a world: most often one.

        `context` is a Context, of one that `is_truth` a PlantContext.
        """
        return [cls("estimator", table)]


class Law(Component):
    """A control law of the platform (and a rigid arm): fills WrenchCommand. `[mission.law]`."""

    group, slot = "law", "control"
    needs_full_actuation: ClassVar[bool] = False
    """Whether it asks for force in any direction, whatever the attitude."""
    presses_with_arm: ClassVar[bool] = False
    """Whether its arm controls the force of the block Press (vehicle/follower.py)."""
    knows_modes: ClassVar[bool] = False
    """Whether it follows `Reference.mode`."""
    commands_torque: ClassVar[bool] = False
    """Whether it tells the servos torques instead of speeds."""

    def check_robot(self, robot: Robot) -> None:
        """Raise InputError if the robot lacks parts that the law requires."""

    def give_up_rotor(self, me: Any, left: RotorsLeft) -> None:
        """Called after the loss of a rotor; laws that command thrusts override this."""

    def get_attitude_loop(self, robot: Robot) -> AttitudeGains | None:
        """Return the attitude loop, to check it against a link's delay; None: not known."""
        return None

    def compute_borne_delay(self, nominal: Nominal, spare: float) -> float:
        """Return the one-way delay (s) for a phase margin of `spare` (rad); NaN if unknown."""
        return float("nan")

    def compute_rate_torque(self, nominal: Nominal, I_C: Array) -> Array | None:
        """Return N m (3, 2) for 1 rad/s of roll and pitch, of inertia `I_C` (3, 3), or None."""
        loop = self.get_attitude_loop(nominal.robot)
        return None if loop is None else I_C[:, :2] * (2.0 * loop.damping * loop.bandwidth)

    def observe_wrench(self, context: Context) -> Array | None:
        """Return the bandwidths (3,) rad/s, forward, left, up, of the port Wrench; None: unused."""
        return None

    def build_gust_model(self, nominal: Nominal, yaw: float) -> GustModel | None:
        """Return how a wind's gusts move a platform that heads `yaw` (rad); None: not known."""
        return None

    def compute_push_share(self, nominal: Nominal) -> float:
        """Return the law's push over what law (4)'s stiffness m w^2 makes at a plan's depth."""
        return 1.0

    def compute_gust_response(
        self, robot: Robot, world: World, frequencies: Array, h: float
    ) -> Array | None:
        """Return the change (n,) of the contact force per newton of a gust along the probe, at
        `frequencies` (n,) rad/s and a physics step `h` (s); None: no loop on it, so 1 if slow."""
        return None


class ArmsLaw(Component):
    """A law of arms with position servos: fills ShaftCommand at the servos' rate."""

    group, slot = "arms_law", "control"

    def get_period(self, step: str, context: Any) -> float:
        """Return the servos' period (s)."""
        from skywright.models.compliant_arms import count_command_ticks

        return count_command_ticks(context.robot) * float(context.dt)


class Fault(Component):
    """A fault of the plant that begins at `start_s`. `[plant.faults.NAME]`."""

    group, slot, side = "fault", "effects", "plant"
    needs_link: ClassVar[bool] = False
    """Whether there must be a control link that it acts on."""

    class Table(Spec):
        """Keys of every fault: its start."""

        start_s: NonNegative = 0.0

    def resolve(self, robot: Robot, world: World, rng: np.random.Generator) -> Fault:
        """Return the fault that this one stands for: itself, but for what `rng` draws."""
        return self

    @classmethod
    def draw_table(
        cls, rng: np.random.Generator, robot: Robot, world: World
    ) -> dict[str, Any] | None:
        """Draw the keys of a fault of this kind, but for its time; None where it cannot happen."""
        return None


class Effect(Component):
    """A force on the plant: adds to MuJoCo's external forces. `[world.effects.NAME]`."""

    group, slot, side = "effect", "effects", "plant"


class Actuator(Component):
    """An actuator beside rotors and servos: acts on a Setpoint. `[robot.actuators.NAME]`."""

    group, slot, side = "actuator", "actuate", "plant"


def overrides(component: Component, method: str) -> bool:
    """Whether a component's class has a method of its own in place of Component's."""
    return getattr(type(component), method) is not getattr(Component, method)
