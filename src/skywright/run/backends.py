"""The back ends that fly a mission file or a script, by name."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.description.loader import Description
from skywright.errors import InputError
from skywright.models.things.bench import Bench
from skywright.run.kind import load_kind
from skywright.run.parts import build_estimator, build_law, build_named
from skywright.run.setup import Setup
from skywright.vehicle.component import Component
from skywright.vehicle.interface import check_offers, require
from skywright.vehicle.observers.operator import Operator as OperatorStick
from skywright.vehicle.set_up import list_offers
from skywright.vehicle.simulated import SimulatedVehicle
from skywright.vehicle.streams import StreamRecorder

PHYSICS, KINEMATIC, RECORDING = BACKENDS = ("physics", "kinematic", "recording")
"""The perturbed plant; a vehicle that follows references exactly; a replay of a recorded run."""
MAVLINK, PX4 = "mavlink", "px4"
LINKED = {
    MAVLINK: "skywright.links.mavlink.companion", PX4: "skywright.links.px4.mission",
}  # fmt: skip
"""Back ends whose vehicle or autopilot is at the other end of a link, `NAME:ADDRESS`. The value is
their module, which defines `open_backend(address)` and `check_backend(address, setup)`."""


def split_backend(name: str) -> tuple[str, str]:
    """Return a back end's kind and its address, with options."""
    kind = name.partition(":")[0].partition("?")[0]
    return kind, name[len(kind) :].removeprefix(":")


def has_forces(name: str) -> bool:
    """Whether a back end simulates forces and power; if not, their samples have no meaning."""
    return split_backend(name)[0] in (PHYSICS, PX4)


def choose_backend(name: str) -> Callable[..., SimulatedVehicle]:
    """Return the constructor of a back end that flies; raises InputError for another name."""
    kind, address = split_backend(name)
    if kind in LINKED:
        return import_module(LINKED[kind]).open_backend(address)
    if name == PHYSICS:
        return SimulatedVehicle
    if name == KINEMATIC:
        from skywright.vehicle.kinematic import KinematicVehicle

        return KinematicVehicle
    what = "plays a run: use skywright.fly(RUN, backend='recording')" if name == RECORDING else ""
    raise InputError(
        f"backend {name!r} {what or 'is unknown'}; back ends that fly a mission: "
        f"{', '.join((PHYSICS, KINEMATIC, *LINKED))}"
    )


def check_backend(setup: Setup[Any], name: str) -> None:
    """Raise InputError if a back end cannot fly a mission; called before anything is connected."""
    d, (kind, address) = setup.description, split_backend(name)
    choose_backend(name)
    if kind in LINKED:
        import_module(LINKED[kind]).check_backend(address, setup)
    elif name == KINEMATIC:  # planning reports what the robot lacks for the physics
        from skywright.vehicle.kinematic import OFFERS

        offers, asks = list_offers(d.robot) & OFFERS, load_kind(d.mission.kind)
        check_offers(offers, frozenset(), asks.needs, d.mission.name, asks.devices)


def build_for_mission(
    description: Description, setup: Setup[Any], backend: str, parts: Sequence[Component]
) -> SimulatedVehicle:
    """Build a back end for a mission; raises InputError if it lacks what the mission needs."""
    vehicle = build_vehicle(description, setup=setup, backend=backend, parts=parts)
    kind = load_kind(description.mission.kind)
    try:
        require(vehicle, kind.needs, description.mission.name, kind.devices)
        kind.check_vehicle(vehicle, description.mission.task)
    except InputError:
        vehicle.close()
        raise
    vehicle.on_say(lambda says: print(says, file=sys.stderr, flush=True))
    return vehicle


def build_vehicle(
    description: Description,
    on_samples: Callable[[NDArray[Any]], None] | None = None,
    setup: Setup[Any] | None = None,
    backend: str = PHYSICS,
    parts: Sequence[Component] = (),
) -> SimulatedVehicle:
    """Build a back end of a description; `setup` is the Setup of it, if one was already built.

    `backend` is one of BACKENDS, or one of LINKED with its address; raises InputError for another.
    `parts` are further components, which observe the flight.
    """
    d, mission = description, description.mission
    setup = setup or Setup(description)
    world = setup.true.world
    if load_kind(mission.kind).held:  # the flight begins in the air
        place = Bench(x_m=mission.start_x_m, y_m=mission.start_y_m, z_m=mission.hover_height_m)
        world = world.add_thing("clamp", place)
    parts = [*build_named(d), *parts]
    if mission.record_raw:
        parts.append(StreamRecorder("raw samples"))
    if load_kind(mission.kind).operated:
        parts.append(OperatorStick("operator"))
    return choose_backend(backend)(
        setup,
        build_law(d, setup),
        build_estimator(d),
        world=world,
        seed=mission.seed,
        deviation=setup.deviation,
        start=(mission.start_x_m, mission.start_y_m, float(np.radians(mission.start_yaw_deg))),
        interactive=mission.mode == "interactive",
        timestep=1e-3 * mission.timestep_ms,
        calibrated=mission.calibrate_springs,
        parts=parts,
        on_samples=on_samples,
    )
