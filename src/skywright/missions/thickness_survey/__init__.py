"""The mission kind "thickness-survey"."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from skywright.missions.thickness_survey.task import ThicknessSurvey
from skywright.run.folder_kind import FolderKind

if TYPE_CHECKING:
    from skywright.inspection.history.entries import Entries, Procedure
    from skywright.run.flight import Flown
    from skywright.run.setup import Setup


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

    def entries(self, run: Flown[ThicknessSurvey, Any]) -> Entries:
        from skywright.missions.thickness_survey.entries import build_entries

        return build_entries(run)

    def procedure(self, setup: Setup[ThicknessSurvey]) -> Procedure:
        from skywright.missions.thickness_survey.entries import build_procedure

        return build_procedure(setup)
