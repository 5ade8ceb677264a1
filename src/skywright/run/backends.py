"""The back ends that fly a mission file or a script, by name."""

from __future__ import annotations

from collections.abc import Callable, Sequence
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
from skywright.vehicle.observers.operator import Operator as OperatorStick
from skywright.vehicle.simulated import SimulatedVehicle
from skywright.vehicle.streams import StreamRecorder

PHYSICS, KINEMATIC, RECORDING = BACKENDS = ("physics", "kinematic", "recording")
"""The perturbed plant; references that are followed exactly; a run's recording that is played."""


def choose_backend(name: str) -> type[SimulatedVehicle]:
    """Return the class of a back end that flies; raises InputError that lists them."""
    if name == PHYSICS:
        return SimulatedVehicle
    if name == KINEMATIC:
        from skywright.vehicle.kinematic import KinematicVehicle

        return KinematicVehicle
    what = "plays a run: use skywright.fly(RUN, backend='recording')" if name == RECORDING else ""
    raise InputError(
        f"backend {name!r} {what or 'is unknown'}; back ends that fly a mission: "
        f"{PHYSICS}, {KINEMATIC}"
    )


def build_vehicle(
    description: Description,
    on_samples: Callable[[NDArray[Any]], None] | None = None,
    setup: Setup[Any] | None = None,
    backend: str = PHYSICS,
    parts: Sequence[Component] = (),
) -> SimulatedVehicle:
    """Build a back end of a description; `setup` is what has been built of it.

    `backend` is one of BACKENDS; raises InputError for another. `parts` are further components,
    of those who observe the flight.
    """
    d, mission = description, description.mission
    setup = setup or Setup(description)
    world = setup.true.world
    if load_kind(mission.kind).held:  # in the air, where the flight begins
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
