"""Interface of missions to any back end: the protocol Backend, and WholeBody and Probe.

Moves (vehicle/moves.py) and Arms (vehicle/arms_interface.py) complete it. A back end (physics,
kinematic animation, a recording, an autopilot) tracks tables of REFERENCE rows and declares which
of the four classes it supports. The four classes convert commands to tables.
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


JOINT_SPEED = 0.8
"""rad/s, of commanded motions of the joints."""


class Limits(NamedTuple):
    """Limits of commanded motions."""

    speed: float  # m/s
    acceleration: float  # m/s^2
    joint_speed: float  # rad/s


def build_limits(robot: Robot) -> Limits:
    """Return the limits that the robot's file sets."""
    c = robot.control
    return Limits(c.speed_max_mps, c.acceleration_max_mps2, JOINT_SPEED)


class Ticked(NamedTuple):
    """Result of one mission tick."""

    t: float
    fired: int  # bits of vehicle.tick
    arrived: bool  # the tracked table has ended


class Backend(Protocol):
    """Interface of a vehicle to missions."""

    offers: frozenset[str]
    refuses: str  # why it accepts no commands, "" if it does
    robot: Robot
    limits: Limits
    n_joints: int
    rotors: RotorSet  # nominal
    model: Any  # BodyModel of the nominal robot
    world: World
    arc: LinkArc | None  # of a link that lies on the ground at the start
    piloted: bool  # whether a pilot flies by the vehicle's own controls
    stopped: str  # why the motors stopped without a command, "" if they did not

    def close(self) -> None:
        """Close the connection to a vehicle outside the simulation."""

    @property
    def actuators(self) -> Actuators:
        """Values that a mission sets, by the names of their columns: vehicle/setpoints.py."""

    @property
    def devices(self) -> Devices:
        """Devices other than the robot."""

    @property
    def t(self) -> float:
        """Mission time (s)."""

    @property
    def reference(self) -> Any:
        """A copy of the present REFERENCE row."""

    @property
    def reference_now(self) -> Any:
        """The same, read field by field without a copy: `reference_now["p_WB"]`."""

    @property
    def estimate(self) -> Any:
        """The present ESTIMATE."""

    def read(self, record: type[R], name: str = "") -> R:
        """Return a copy of a record, such as `read(Hands).p_WH`.

        `name` is that of the component that fills it, if several do. Raises InputError if no
        component of the vehicle fills it.
        """

    def look(self, record: type[R]) -> R:
        """Return a record itself, which must not be modified; raise InputError as `read` does."""

    @property
    def localised(self) -> bool:
        """Whether the estimate is valid: false until the estimator has started."""

    @property
    def fix_age(self) -> float:
        """Time (s) since the last external position fix."""

    @property
    def force(self) -> float:
        """Present force (N) of the probe's sensor; 0 without one."""

    @property
    def saturated(self) -> bool:
        """Whether the rotors could not produce the wrench of the last control tick."""

    @property
    def pose_std(self) -> float:
        """Standard deviation (m) of the platform's position, from the estimator; NaN if unknown."""

    def take_control(self) -> str:
        """Take control of the platform from a pilot; return why it is refused, or ""."""

    def give_control(self) -> str:
        """Give a pilot control of the platform; return why it is refused, or ""."""

    def track(self, table: Table) -> None:
        """Follow `table` from now on; its last row holds."""

    @property
    def tracking(self) -> tuple[Table, float]:
        """The table that is tracked, and the time (s) along it."""

    def tick(self, guards: int = 0) -> Ticked:
        """Run one mission tick (20 ms), or less if a guard in `guards` fires.

        Raises StepFailed if a step of the robot's computer fails.
        """

    def in_contact(self) -> bool:
        """Whether the probe's instrument detects contact."""

    def calibrate_probe(self, null: Array, axis: Array) -> None:
        """Detect contact by the signal's distance from `null` (2,), in units, along `axis` (2,)."""

    def give_up_rotor(self, i: int) -> RotorsLeft | None:
        """Continue without rotor `i` (from 0); returns None if the others cannot hold the robot."""

    def stop_computer(self, failed: StepFailed) -> bool:
        """Stop the failed step; returns whether it is restarted. If not, the robot falls."""

    def release(self) -> None:
        """Release a robot that is held in the air (in simulations of a world with a bench)."""

    def set_stick(self, stick: Array, button: bool) -> None:
        """Set the operator's input (3,), each from -1 to 1, and button for the recording."""

    def tip_of(self, row: Any) -> tuple[Array, Array]:
        """Return the nominal (p_WT, R_WT) of a row's platform pose and joints."""


def require(
    backend: Backend, needs: frozenset[str], mission: str, devices: frozenset[str] = frozenset()
) -> None:
    """Raise InputError if a back end lacks an offer or a device that a mission needs."""
    check_offers(backend.offers, backend.devices.names, needs, mission, devices)


def check_offers(
    offers: frozenset[str], beside: frozenset[str], needs: frozenset[str], mission: str,
    devices: frozenset[str] = frozenset(),
) -> None:  # fmt: skip
    """Do the same as `require` with the offers of a back end and the devices of the vehicle."""
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
        """Stop the reference, with tip loop and dead zone unchanged."""
        row = self.backend.reference
        row["t"] = 0.0
        for field in ("v_WB", "a_WB", "w_WB_B", "wd_WB_B", "qd", "v_WT"):
            row[field] = 0.0
        self.backend.track(row[None])


class Probe:
    """Contact state of the probe, from its instrument."""

    def __init__(self, backend: Backend) -> None:
        self.backend = backend

    def in_contact(self) -> bool:
        """Whether the lift-off signal is below its threshold."""
        return self.backend.in_contact()

    def calibrate(self, contact: complex, axis: complex) -> None:
        """Set the signal in `contact` and its `axis` towards air, for the detection of contact."""
        self.backend.calibrate_probe(
            np.array([contact.real, contact.imag]), np.array([axis.real, axis.imag])
        )


def fill_tips(backend: Backend, table: Table) -> None:
    """Fill the nominal tip poses of a generated table, and the velocities by differences."""
    for row in table:
        row["p_WT"], row["R_WT"] = backend.tip_of(row)
    p, v = table["p_WT"], table["v_WT"]
    v[:] = 0.0
    if len(table) > 1:  # central differences; np.gradient takes long for the two rows of a tick
        v[0], v[-1] = (p[1] - p[0]) / ROW_PERIOD, (p[-1] - p[-2]) / ROW_PERIOD
        v[1:-1] = (p[2:] - p[:-2]) / (2.0 * ROW_PERIOD)
