"""The mission kind "thickness-survey"."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from skywright.missions.thickness_survey.task import ThicknessSurvey
from skywright.run.folder_kind import FolderKind

if TYPE_CHECKING:
    from skywright.run.flight import Flown


class ThicknessSurveyKind(FolderKind[ThicknessSurvey]):
    """Press an ultrasonic probe on spots of a wall and measure its thickness."""

    task = ThicknessSurvey
    needs = frozenset({"uav", "whole_body", "probe"})

    def result(self, run: Flown[ThicknessSurvey, Any]) -> object:
        from skywright.missions.thickness_survey.metrics import find_readings

        return run.once(find_readings)

    def describe(self, run: Flown[ThicknessSurvey, Any]) -> dict[str, Any]:
        from skywright.missions.thickness_survey.metrics import describe_readings

        return describe_readings(run)
