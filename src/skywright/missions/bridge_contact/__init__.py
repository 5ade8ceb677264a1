"""The mission kind "bridge-contact"."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skywright.missions.bridge_contact.task import BridgeContact
from skywright.run.kind import Figures, Measures, MissionKind

if TYPE_CHECKING:
    from skywright.missions.bridge_contact.plan import ContactPlan
    from skywright.run.flight import Flight, Flown
    from skywright.run.planning import MissionPlan
    from skywright.run.setup import Setup
    from skywright.run.supervisor import Supervisor


class BridgeContactKind(MissionKind[BridgeContact, "ContactPlan"]):
    """Press a probe on a structure, docked or flying, and slide it along."""

    task = BridgeContact
    needs = frozenset({"uav", "whole_body", "probe"})

    @property
    def measures(self) -> Measures:
        from skywright.missions.bridge_contact.metrics import MEASURES

        return MEASURES

    def plan(self, setup: Setup[BridgeContact]) -> MissionPlan[ContactPlan]:
        from skywright.missions.bridge_contact.plan import plan

        return plan(setup)

    def fly(self, s: Supervisor[BridgeContact], way: ContactPlan) -> Flight:
        from skywright.missions.bridge_contact.fly import fly

        return fly(s, way)

    def metrics(self, run: Flown[BridgeContact, ContactPlan]) -> dict[str, float]:
        from skywright.missions.bridge_contact.metrics import compute_contact_metrics

        return compute_contact_metrics(run)

    def figures(self) -> Figures:
        from skywright.missions.bridge_contact.figures import FIGURES

        return FIGURES
