"""Places of the survey touches before a press, and the accuracy of the survey.

Under a deck the feet of the docking gear, half a metre apart, touch simultaneously. The attitude of
the robot then measures the slope to a fraction of a degree; consecutive touches would differ by the
error of the total station. On other structures the tip of the probe touches at places around the
spots, each along the normal of the map.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from skywright.core.arrays import Array, Samples
from skywright.description.world.structure import PLANE, Structure, build_surface
from skywright.errors import InputError
from skywright.missions.bridge_contact.stations import Station
from skywright.missions.bridge_contact.task import BridgeContact, Contact
from skywright.missions.skills.datum import explain_view, get_datum
from skywright.missions.skills.survey import Tip, Touch, read_touches
from skywright.missions.skills.surveyed import CLEAR, TIP_STD, Ball, get_map_error, get_tip
from skywright.missions.skills.surveyed_structure import compute_structure_reach
from skywright.models.docking_body import list_feet
from skywright.models.rigid_body import compute_body
from skywright.recordings.columns import has_columns
from skywright.run.flight import PhaseRecord
from skywright.run.setup import Setup

WIDE = 0.12
"""m, least distance to each side between places that the tip touches: 14 degrees on a pillar of 0.5
m radius, where friction still holds the tip."""
FOOT_STD = 1.5e-3
"""m, deviation of a foot's position across the deck: 0.3 degrees of the estimated attitude over
0.25 m."""
LOCALISED_STD = 0.03  # m, three deviations of a position while the station is hidden


class SurveyWay(NamedTuple):
    """Parameters of the survey."""

    setup: Setup[BridgeContact]  # to plan again with, once the structure is known
    feet: Array  # (n, 3) m in B; none: the tip touches
    stations: list[Station]  # where the tip touches, by the map
    stand_off: float  # m, of feet or tip before a touch
    reach: float  # m, largest depth of the true surface behind the map's
    stiffness: float  # N/m, of the position loop
    mark: Station | None = None  # where the robot measures the datum first

    @property
    def stops(self) -> list[Station]:
        """Stations at which the tip stands off the surface, in flying order."""
        return self.stations if self.mark is None else [self.mark, *self.stations]


def plan_survey(
    setup: Setup[BridgeContact], spots: list[Station], stand: Callable[[Array, str], Station],
    q: Array,
) -> SurveyWay:  # fmt: skip
    """Plan the touches; `stand` returns the poses at a place, `q` is the posture before docking.

    Raises InputError for docking on a curved deck, and for a datum that the camera may not see.
    """
    structure, surface, task = setup.world.structure, setup.surface, setup.task
    error, docking, control = get_map_error(setup), setup.robot.docking, setup.robot.control
    assert structure is not None and surface is not None
    feet, stations, lever, mark = np.zeros((0, 3)), [], 0.0, None
    places = [s.place for s in spots]
    if docking is not None and structure.facing == "down" and surface.shape == PLANE:
        feet, lever = list_feet(docking), docking.radius_m
        if get_datum(setup) is not None:
            raise InputError(
                "mission.task.datum: a survey by the feet of a docking gear does not use the "
                "probe's camera; valid: mission.task.datum=false, or a robot without "
                "[robot.docking]"
            )
    elif task.dock:
        raise InputError(
            "mission.task.survey: feet can survey a level or sloped deck, not a curved "
            "one: set mission.task.survey=false or mission.task.dock=false"
        )
    else:
        places = choose_places(task, structure)
        stations = [stand(place, f"touch {i + 1}") for i, place in enumerate(places)]
        if (datum := get_datum(setup)) is not None:
            mark = stand(np.array(datum.get_place()), "the datum")
            places = [mark.place, *places]
    reach = max(compute_structure_reach(structure, error, place) for place in places)
    reach += lever * math.tan(math.sqrt(2.0) * error.turn)
    reach += 0.0 if setup.world.tracks_markers else LOCALISED_STD
    stiffness = compute_body(setup.model, q)[0] * control.position_bandwidth_rad_s**2
    if mark is not None:
        aside = math.sqrt(2.0) * (error.place + math.tan(error.turn) * math.hypot(*mark.place))
        hidden = explain_view(setup, reach + CLEAR, reach, aside)
        if hidden:
            raise InputError(hidden)
    return SurveyWay(setup, feet, stations, reach + CLEAR, reach, stiffness, mark)


def choose_places(task: Contact, structure: Structure) -> list[Array]:
    """Return places (2,) m in S around spots and slides, WIDE to each side at least.

    Four of a plane; of a curved surface two along its axis, three around it each.
    """
    surface = build_surface(structure)
    points = np.array([[spot.x_m, spot.y_m] for spot in task.spots])
    far = points.copy()
    far[:, surface.along] += task.slide_m
    points = np.vstack([points, far])
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    half = np.maximum(0.5 * np.ptp(points, axis=0), WIDE)
    ends = np.array([[-1, -1], [-1, 1], [1, 1], [1, -1]])
    if surface.shape != PLANE:
        rows = [[-1, -1], [-1, 0], [-1, 1], [1, 1], [1, 0], [1, -1]]
        ends = np.array(rows)[:, :: 1 if surface.along == 0 else -1]
    return [middle + half * end for end in ends]


def get_ball(setup: Setup[Any], feet: bool, pose_std: float) -> Ball:
    """Return the ball that touches; `pose_std` (m) is the estimator's position deviation, or NaN.

    Feet touch simultaneously, so this deviation is common to them; touches of the tip are half a
    minute apart.
    """
    if setup.world.tracks_markers or not math.isfinite(pose_std):
        return Ball(0.0, setup.world.mocap.calibration_m, FOOT_STD) if feet else get_tip(setup)
    assert setup.robot.probe is not None
    if feet:
        return Ball(0.0, pose_std, FOOT_STD)
    return Ball(setup.robot.probe.tip_radius_m, 0.0, math.hypot(TIP_STD, pose_std))


def read_survey(
    survey: SurveyWay, samples: Samples, phases: list[PhaseRecord]
) -> tuple[list[Touch], Ball]:
    """Return the touches of a recorded flight, and the ball that touched."""
    from skywright.missions.bridge_contact.seat import read_seats

    std = float(np.median(samples["pose_std"])) if has_columns(samples, "pose_std") else math.nan
    ball = get_ball(survey.setup, len(survey.feet) > 0, std)
    if len(survey.feet):
        return read_seats(samples, phases, survey.feet), ball
    return read_touches(samples, phases, Tip.columns), ball
