"""What a mission may command over any back end: WholeBody and Probe.

Moves (vehicle/moves.py) and Arms (vehicle/arms_interface.py) are beside them. A back end (physics,
kinematic animation, a recording; an autopilot) tracks tables of REFERENCE rows and says which of
the four it offers. The four classes turn commands into tables.
"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from skywright.core.record import Record
from skywright.core.types import REFERENCE
from skywright.description.robot.spec import Robot
from skywright.description.world.spec import World
from skywright.errors import InputError
from skywright.models.rotor_loss import RotorsLeft
from skywright.models.rotors import RotorSet
from skywright.vehicle.devices import Devices
from skywright.vehicle.link_arc import LinkArc
from skywright.vehicle.rest_to_rest import ROW_PERIOD
from skywright.vehicle.setpoints import Actuators
from skywright.vehicle.ticker import StepFailed

Array = NDArray[np.float64]
Table = NDArray[Any]
R = TypeVar("R", bound=Record)


class Limits(NamedTuple):
    """What the commands may ask for."""

    speed: float  # m/s
    acceleration: float  # m/s^2
    joint_speed: float  # rad/s


class Ticked(NamedTuple):
    """What one mission tick reported."""

    t: float
    fired: int  # bits of vehicle.tick
    arrived: bool  # the tracked table has ended


class Backend(Protocol):
    """What the mission needs of a vehicle."""

    offers: frozenset[str]
    refuses: str  # why it takes no commands, "" where it does
    robot: Robot
    limits: Limits
    n_joints: int
    rotors: RotorSet  # as believed
    model: Any  # BodyModel of the robot as believed
    world: World
    arc: LinkArc | None  # of a link that lies on the ground at the start
    piloted: bool  # whether a pilot flies by the vehicle's own controls
    stopped: str  # why the motors stand although nothing here stopped them

    def close(self) -> None:
        """End the connection to a vehicle that is not simulated here."""

    @property
    def actuators(self) -> Actuators:
        """Values that a mission sets, by the names of their columns: vehicle/setpoints.py."""

    @property
    def devices(self) -> Devices:
        """What is beside the robot."""

    @property
    def t(self) -> float:
        """Mission time (s)."""

    @property
    def reference(self) -> Any:
        """The REFERENCE row that is tracked now."""

    @property
    def reference_now(self) -> Any:
        """The same, read field by field where it stands: `reference_now["p_WB"]`."""

    @property
    def estimate(self) -> Any:
        """The ESTIMATE now."""

    def read(self, record: type[R], name: str = "") -> R:
        """A copy of a record as it is now, such as `read(Hands).p_WH`.

        `name` is that of the component that fills it, where several do. Raises InputError where
        nothing in the vehicle fills it.
        """

    def look(self, record: type[R]) -> R:
        """A record itself, which is not to be written to; raises as `read` does."""

    @property
    def localised(self) -> bool:
        """Whether the estimate is one: false until the estimator has begun."""

    @property
    def fix_age(self) -> float:
        """Time (s) since the robot was last localised from outside."""

    @property
    def force(self) -> float:
        """Force (N) that the probe's sensor reads now; 0 without one."""

    @property
    def saturated(self) -> bool:
        """Whether the rotors could not make what was commanded at the last control tick."""

    @property
    def pose_std(self) -> float:
        """Standard deviation (m) of the platform's place as the estimator says; NaN unknown."""

    def take_control(self) -> str:
        """Take the platform back from a pilot; returns why not, or ""."""

    def give_control(self) -> str:
        """Give the platform to a pilot; returns why not, or ""."""

    def track(self, table: Table) -> None:
        """Follow `table` from now on; its last row holds."""

    @property
    def tracking(self) -> tuple[Table, float]:
        """The table that is tracked, and the time (s) along it."""

    def tick(self, guards: int = 0) -> Ticked:
        """Run one mission tick (20 ms) or less when a guard in `guards` fires.

        Raises StepFailed where a step of the robot's computer does.
        """

    def in_contact(self) -> bool:
        """Whether the probe's instrument says contact."""

    def calibrate_probe(self, null: Array, axis: Array) -> None:
        """Judge contact by how far the signal is from `null` (2,), in units, along `axis` (2,)."""

    def give_up_rotor(self, i: int) -> RotorsLeft | None:
        """Fly on without rotor `i` (from 0); None where the others cannot hold the robot."""

    def stop_computer(self, failed: StepFailed) -> bool:
        """Run what failed no more; returns whether it is started again, else nothing flies."""

    def release(self) -> None:
        """Let go a robot that is held in the air (a simulation of a world with a bench can)."""

    def set_stick(self, stick: Array, button: bool) -> None:
        """Operator's input (3,), each from -1 to 1, and button that a recording notes from now."""

    def tip_of(self, row: Any) -> tuple[Array, Array]:
        """Nominal (p_WT, R_WT) of a row's platform pose and joints."""


def require(
    backend: Backend, needs: frozenset[str], mission: str, devices: frozenset[str] = frozenset()
) -> None:
    """Raise InputError when a back end does not offer what a mission needs, or lacks devices."""
    check_offers(backend.offers, backend.devices.names, needs, mission, devices)


def check_offers(
    offers: frozenset[str], beside: frozenset[str], needs: frozenset[str], mission: str,
    devices: frozenset[str] = frozenset(),
) -> None:  # fmt: skip
    """Raise as `require` does, of what a back end offers and of the devices beside it."""
    missing = sorted(needs - offers)
    if missing:
        raise InputError(
            f"mission {mission!r} requires {', '.join(missing)}; the vehicle offers "
            f"{', '.join(sorted(offers)) or 'nothing'}"
        )
    lacking = sorted(devices - beside)
    if lacking:
        raise InputError(
            f"mission {mission!r} requires the device {', '.join(lacking)}; the vehicle has "
            f"{', '.join(sorted(beside)) or 'no devices'}"
        )


class WholeBody:
    """Platform and arm together: track a tip and posture reference."""

    def __init__(self, backend: Backend) -> None:
        self.backend = backend

    def track(self, table: Table) -> None:
        """Follow a plan segment (rows of REFERENCE, own time from 0)."""
        if table.dtype != REFERENCE or table.ndim != 1 or len(table) == 0:
            raise InputError(f"a plan segment is a 1-D array of REFERENCE rows, got {table.dtype}")
        self.backend.track(table)

    def hold(self) -> None:
        """Stay at the reference, tip loop and dead zone unchanged."""
        row = self.backend.reference
        row["t"] = 0.0
        for field in ("v_WB", "a_WB", "w_WB_B", "wd_WB_B", "qd", "v_WT"):
            row[field] = 0.0
        self.backend.track(row[None])


class Probe:
    """The probe's state as its instrument reports it."""

    def __init__(self, backend: Backend) -> None:
        self.backend = backend

    def in_contact(self) -> bool:
        """Whether the lift-off signal is under its threshold."""
        return self.backend.in_contact()

    def calibrate(self, contact: complex, axis: complex) -> None:
        """Judge contact from now on by the signal in `contact` and its `axis` towards air."""
        self.backend.calibrate_probe(
            np.array([contact.real, contact.imag]), np.array([axis.real, axis.imag])
        )


def fill_tips(backend: Backend, table: Table) -> None:
    """Fill the nominal tip poses of a generated table, differentiated for the velocity."""
    for row in table:
        row["p_WT"], row["R_WT"] = backend.tip_of(row)
    table["v_WT"] = 0.0
    if len(table) > 1:
        table["v_WT"] = np.gradient(table["p_WT"], ROW_PERIOD, axis=0)
