"""A thickness survey: approach, press, wait for a thin film, accept or repeat with a reason."""

from __future__ import annotations

from typing import Any, cast

import numpy as np

from skywright.inspection.thickness import Reading
from skywright.missions.bridge_contact.fly import Pilot
from skywright.missions.bridge_contact.stations import Station
from skywright.missions.thickness_survey.gauge import build_gauge
from skywright.missions.thickness_survey.plan import ThicknessWay
from skywright.missions.thickness_survey.task import ThicknessSurvey
from skywright.run.flight import Flight
from skywright.run.supervisor import Supervisor
from skywright.vehicle.sensors.ultrasonic import Ultrasonic


def fly(s: Supervisor[ThicknessSurvey], way: ThicknessWay) -> Flight:
    """Locate the wall by touch, then measure at every spot."""
    pilot = SurveyPilot(s, way)
    home = np.array(s.vehicle.reference)
    reason = ""
    survey = way.contact.survey
    if survey is not None and survey.stations:
        reason = pilot.find_with_tip(survey)
    for i in range(len(way.contact.stations)) if not reason else ():
        if survey is not None and not survey.stations:
            reason = pilot.find_with_feet(survey, i)
        reason = reason or pilot.measure(pilot.way.stations[i])
        if reason:
            break
    pilot.go("return", p=home["p_WB"], R=home["R_WB"], q=home["q"][: s.vehicle.n_joints])
    return Flight(not reason, reason)


class SurveyPilot(Pilot):
    """A pilot of contact inspection whose measurement is a reading of the gauge."""

    def __init__(self, s: Supervisor[ThicknessSurvey], way: ThicknessWay) -> None:
        super().__init__(cast(Any, s), way.contact, s.task)
        self.survey = s.task
        self.gauge = build_gauge(s.task.procedure, way.gauge)
        self._reading = s.vehicle.look(Ultrasonic.Reading)
        self._newest: Reading | None = None

    def measure(self, at: Station) -> str:
        """Touch a spot until a reading is accepted; returns the reason for an abort, or "".

        A spot that an order leaves out is not touched again.
        """
        reason: str | None = ""
        for _ in range(self.survey.tries):
            self._newest = None
            if self.contact.dock:
                reason = self.inspect_docked(at)
            else:
                assert self.way.free is not None
                reason = self.inspect_flying(at, self.way.free)
            accepted = self._newest is not None and self._newest.accepted
            if reason != "" or accepted:
                break
        self.gauge.leave_site()
        return reason or ""

    def measure_force(self, spot: str, force: float, how: str) -> None:
        """Hold until the gauge accepts a reading, for `hold_s` at most."""
        s, seen = self.s, float(self._reading.scan)
        start = s.vehicle.t
        self._newest = None  # of a touch that is repeated
        self.gauge.restart()
        for _ in s.orders.passes(self.profile.hold_s):
            # readings before the phase are ignored, as in the evaluation
            if self._reading.scan > seen and self._reading.t > start:
                seen = float(self._reading.scan)
                row = np.array(self._reading.ascan)
                self._newest = self.gauge.add([float(self._reading.t)], row)[0]
                if self._newest.accepted:
                    break
        accepted = self._newest is not None and self._newest.accepted
        s.end("done" if accepted else "retry")
