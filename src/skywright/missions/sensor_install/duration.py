"""Time that a sensor's installation takes in addition to its moves: tests, survey, press, waits."""

from skywright.missions.sensor_install.fly import (
    LOWER_S,
    PARK_S,
    RAMP_S,
    SETTLE_S,
    STEADY_S,
    SWING_WAIT,
    TARE_S,
    TOUCH_SPEED,
    WATCH_S,
)
from skywright.missions.sensor_install.plan import InstallPlan
from skywright.missions.sensor_install.surveyed import SETTLE_S as CALM_S
from skywright.missions.sensor_install.task import SensorInstall
from skywright.missions.skills.survey import compute_touch_s
from skywright.run.planning import MissionPlan
from skywright.run.setup import Setup


def compute_added_s(setup: Setup[SensorInstall], plan: MissionPlan[InstallPlan]) -> float:
    """Return the time (s) of tests, touches, the press and waits."""
    task, way = setup.task, plan.get_way()
    tare = STEADY_S + TARE_S
    tests = task.hover_s + (SWING_WAIT if task.swing_deg > 0.0 and way.swing_rad_s > 0.0 else 0.0)
    before = tare + 3.0 * PARK_S + WATCH_S + (tare if task.pose == "L" else 0.0)
    press = task.stand_off_m / TOUCH_SPEED + RAMP_S + SETTLE_S + task.hold_s
    after = 0.0 if task.leave_singularity else LOWER_S
    survey = 0.0
    if way.survey is not None:
        each = CALM_S + compute_touch_s(way.survey.stand_off)
        survey = WATCH_S + len(way.survey.travels) * each + PARK_S
    return tests + before + survey + press + after
