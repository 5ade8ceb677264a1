"""The mission kind "bridge-contact"."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from skywright.description.mission.spec import Requirement
from skywright.missions.bridge_contact.task import BridgeContact
from skywright.run.folder_kind import FolderKind

if TYPE_CHECKING:
    from skywright.inspection.history.entries import Entries
    from skywright.run.flight import Flown
    from skywright.run.setup import Setup


class BridgeContactKind(FolderKind[BridgeContact]):
    """Press a probe on a structure, docked or flying, and slide it along."""

    task = BridgeContact
    needs = frozenset({"uav", "whole_body", "probe"})
    operated = True

    def requirements(self, setup: Setup[BridgeContact], way: Any) -> dict[str, Requirement]:
        """Leave out the requirements of docking or sliding if the task omits them."""
        task = setup.task
        left_out = {"dock.": not task.dock, "slide.": task.slide_m == 0.0}
        return self.leave_out(super().requirements(setup, way), left_out)

    def entries(self, run: Flown[BridgeContact, Any]) -> Entries:
        """State the standard deviation of the contacts' places if the flight measured a datum."""
        from skywright.inspection.history.entries import Entries
        from skywright.missions.bridge_contact.metrics import find_place_std

        return Entries(registration_std_m=find_place_std(run))

    def list_waived(self, metrics: dict[str, float]) -> dict[str, str]:
        """Waive the requirements on a slide if an operator pressed: the operator applies one force
        only."""
        waived = super().list_waived(metrics)
        if "operator.time_s" in metrics:
            names = (
                "slide.rms_error_n", "slide.lost_s", "slide.no_force_max_s", "slide.length_m",
                "slide.length_fraction",
            )  # fmt: skip
            waived |= dict.fromkeys(names, "an operator pressed by hand, without a slide")
        return waived
