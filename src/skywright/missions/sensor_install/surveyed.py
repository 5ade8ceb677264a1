"""Survey of the pipe with the hand that carries no sensor, before the other hand presses.

The sensor's tape would stick at the first touch. The hand touches from below at four places. The
target of each touch follows from the touches before it: first below the middle according to the
map, then a little towards the robot, then wide on either side of the estimated middle. The wide
touches locate the middle. If they came first they could meet the flank, where an upward push slides
off and pushes back the link that carries the arms.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.core.rotations import rot_z
from skywright.description.world.surface import Cylinder, level_axes, surface_frame
from skywright.missions.sensor_install.task import SensorInstall
from skywright.missions.skills.survey import Hand, Touch, survey_surface
from skywright.missions.skills.surveyed import (
    CLEAR,
    Ball,
    Surveyed,
    compute_reach,
    fit_touches,
    get_map_error,
)
from skywright.models.rigid_body import compute_kinematics
from skywright.run.setup import Setup
from skywright.run.supervisor import Supervisor

PLACES = np.array([[-0.1, 0.0], [-0.1, 0.15], [0.1, 0.35], [0.1, -0.3]])
"""Position along the pipe (m), and towards the robot in radii."""
BOTTOM = -0.5 * math.pi  # rad, around the pipe
ROOM = 0.04  # m, for the deflection of the springs under load and errors of the arm
TOUCH_STD, BIAS = 2e-3, 5e-3
"""m, deviations of a hand's position by its joints: from touch to touch, and common to all touches
(joint zeros, lengths)."""
SETTLE_S = 2.0


class InstallSurvey(NamedTuple):
    """Parameters of the touches."""

    setup: Setup[SensorInstall]
    hand: int
    ball: Ball
    p_BH: Array  # (n_hands, 3) m, in the pose of the survey
    axis: Array  # (3,) in W, pointing out of the hand
    yaw: float
    stand_off: float  # m, of the hand below the map's pipe
    travels: list[float]  # m, each
    error: float  # m, by which the pipe may be nearer to the idle hand than on the map

    def start(self, i: int, cylinder: Cylinder | None = None) -> tuple[Array, Array]:
        """Return the positions of platform and hand, (3,) m each, before touch `i`.

        The pipe is `cylinder`, or by default that of the map.
        """
        known = self.setup.cylinder
        assert known is not None
        R_WS = np.empty((3, 3))
        surface_frame(known, BOTTOM, R_WS)
        end = lead_to(self, cylinder or known, *PLACES[i]) + self.stand_off * R_WS[:, 2]
        return place_platform(self, end, self.hand), end


def plan_survey(setup: Setup[SensorInstall], q: Array, yaw: float) -> InstallSurvey:
    """Plan touches with the arms at q (n_joints,) rad and the platform's heading `yaw` (rad)."""
    cylinder, error, model = setup.cylinder, get_map_error(setup), setup.model
    assert cylinder is not None
    hands = compute_kinematics(model, q)
    n = int(model[0]["n_hands"])
    arm = setup.robot.arm
    assert arm is not None
    reach = max(compute_reach(cylinder, error, np.array([s, BOTTOM])) for s, _ in PLACES)
    stand_off = max(setup.task.stand_off_m, reach + CLEAR)
    r = cylinder.radius
    aside = [min(abs(share) * r + error.place, 0.9 * r) for _, share in PLACES]
    apart = abs(float(hands["p_BH"][0, 1] - hands["p_BH"][n - 1, 1]))
    far = np.array([np.max(np.abs(PLACES[:, 0])) + apart, BOTTOM])
    travels = [stand_off + reach + r - math.sqrt(r * r - x * x) + ROOM for x in aside]
    return InstallSurvey(
        setup, n - 1, Ball(arm.hand.radius_m, BIAS, TOUCH_STD), np.array(hands["p_BH"][:n]),
        rot_z(yaw) @ np.array(hands["R_BH"][n - 1])[:, 2], yaw, stand_off, travels,
        compute_reach(cylinder, error, far),
    )  # fmt: skip


def lead_to(survey: InstallSurvey, cylinder: Cylinder, along: float, share: float) -> Array:
    """Return the end (3,) m of a hand whose ball touches the pipe from below."""
    ahead, axis, up = level_axes(cylinder.R_WP).T
    r, ball = cylinder.radius, survey.ball.radius
    down = math.sqrt((r + ball) ** 2 - (share * r) ** 2)
    centre = cylinder.p_WP + along * axis - share * r * ahead - down * up
    return np.asarray(centre + ball * survey.axis)


def place_platform(survey: InstallSurvey, end: Array, hand: int) -> Array:
    """Return p_WB (3,) m at which the end of hand `hand` is at `end` (3,) m."""
    return np.asarray(end - rot_z(survey.yaw) @ survey.p_BH[hand])


def find_pipe(
    s: Supervisor[SensorInstall], survey: InstallSurvey, move: Callable[[Array, Array], None]
) -> Surveyed:
    """Touch the pipe; `move` moves platform and hand to (3,) m each, at the same time."""
    setup, known = survey.setup, survey.setup.cylinder
    assert known is not None
    R_WS = np.empty((3, 3))
    surface_frame(known, BOTTOM, R_WS)

    def come(i: int, touches: list[Touch]) -> None:
        made = any(not t.reason for t in touches)
        at = fit_touches(setup, touches, survey.ball).found.cylinder if made else known
        s.begin("survey_move")
        move(*survey.start(i, at))

    hand = Hand(s, survey.hand, s.task.hand_speed_mps)
    touches = survey_surface(
        s, hand, [R_WS] * len(PLACES), survey.travels, come, lambda: s.wait(SETTLE_S)
    )
    return fit_touches(setup, touches, survey.ball)
