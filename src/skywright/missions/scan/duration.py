"""Time that a scan takes in addition to its planned motion."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from skywright.core.arrays import Table
from skywright.missions.scan.fly import SETTLE, TRIM_TIMES
from skywright.missions.scan.plan import ScanWay, SurveyWay
from skywright.missions.scan.task import Scan
from skywright.missions.skills.datum import LOOK_S
from skywright.missions.skills.survey import compute_touch_s
from skywright.run.planning import MissionPlan
from skywright.run.setup import Setup
from skywright.vehicle.interface import build_limits
from skywright.vehicle.moves import compute_move_s

TRIM_S = TRIM_TIMES[0]


def compute_added_s(setup: Setup[Scan], plan: MissionPlan[ScanWay]) -> float:
    """Return the time (s) of the survey's touches, of the path planned after it, and of rests."""
    return compute_rests_s(setup, plan.segments, plan.get_way().survey)


def compute_rests_s(
    setup: Setup[Any], segments: Mapping[str, Table], survey: SurveyWay | None
) -> float:
    """Return the duration (s) of the phases of a scan that have no planned segments."""
    rests = TRIM_S + SETTLE
    if survey is None:
        return rests
    look = 0.0 if survey.mark is None else TRIM_S + LOOK_S
    touches = len(survey.points) * (TRIM_S + compute_touch_s(survey.stand_off_m))
    close = segments["close_in"]  # is flown again after the survey
    back = float(np.linalg.norm(close["p_WB"][0] - segments["survey leave"]["p_WB"][-1]))
    face = compute_move_s(back, 0.0, build_limits(setup.robot))
    return rests + look + touches + face + float(close["t"][-1])
