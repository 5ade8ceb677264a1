"""The mission kind external-arms: hover, and let an operator lead the arms through the gateway.

    skywright run external-arms.toml --operator udp:9870

Operations, a stick and joint references come by UDP (docs/howto/gateway.md). The operation `land`
ends the work. A kind is one class; your own arms program can be tried against this one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field

from skywright.description.mission.spec import Task
from skywright.run.kind import Figures, Measures, MissionKind

if TYPE_CHECKING:
    from skywright.run.flight import Flight, Flown
    from skywright.run.planning import MissionPlan
    from skywright.run.result import RunResult
    from skywright.run.setup import Setup
    from skywright.run.supervisor import Supervisor

LED = (
    "hold", "rest", "operate", "stick", "joints", "torque_on", "torque_off", "grasp", "force",
    "visual",
)  # fmt: skip


class ExternalArmsTask(Task):
    """The table [mission.task]."""

    operator: str | None = None  # no recording: the operator is at the gateway
    longest_s: float = Field(default=600.0, gt=0, le=3600)  # time for the operator
    stick_speed_mps: float = Field(default=0.05, gt=0, le=0.2)  # of the hands, v_max of (24)
    force_n: float = Field(default=1.0, gt=0, le=5)  # of a hand, at full deflection; of a grasp


class ExternalArms(MissionKind[ExternalArmsTask, None]):
    """Hover while an operator leads the arms."""

    task = ExternalArmsTask
    needs = frozenset({"uav", "hands"})
    operated = True

    @property
    def measures(self) -> Measures:
        return {
            "arms.led_s": ("s", "time for which the operator led the arms"),
            "arms.tracking_rms_deg": ("deg", "joints from their references while these were led"),
            "platform.drift_max_mm": ("mm", "farthest that the platform moved meanwhile"),
        }

    def plan(self, setup: Setup[ExternalArmsTask]) -> MissionPlan[None]:
        from skywright.run.planning import MissionPlan

        return MissionPlan(True, None, 0.0, setup.task.longest_s)

    def fly(self, s: Supervisor[ExternalArmsTask], way: None) -> Flight:
        from skywright.links.udp.lead_arms import Lead
        from skywright.run.flight import Flight

        gateway = getattr(s.operator, "gateway", None)
        if gateway is None:
            return Flight(False, "the arms have no operator; run with --operator udp:PORT")
        lead = Lead(s, gateway, s.task.stick_speed_mps, s.task.force_n)
        led = lead.run(s.task.longest_s)
        s.begin("fold")
        s.arms.move_to(lead.poses["rest"])
        s.until_arrived()
        return Flight(not led.reason, led.reason)

    def metrics(self, run: Flown[ExternalArmsTask, None]) -> dict[str, float]:
        phases = {
            name: [i for i, p in enumerate(run.phases) if p.name in names]
            for name, names in (("led", LED), ("joints", ("joints",)))
        }
        s = run.samples[np.isin(run.samples["phase"], phases["led"])]
        if not len(s):
            return {}
        drift = np.linalg.norm(s["p_WB"] - s["p_WB"][0], axis=1)
        found = {
            "arms.led_s": 0.01 * len(s), "platform.drift_max_mm": 1e3 * float(np.max(drift)),
        }  # fmt: skip
        s = s[np.isin(s["phase"], phases["joints"])]
        if len(s):
            error = np.degrees(s["q"] - s["ref_q"])
            found["arms.tracking_rms_deg"] = float(np.sqrt(np.mean(error**2)))
        return found

    def figures(self) -> Figures:
        return Figures(describe)


def describe(result: RunResult[ExternalArmsTask, None]) -> str:
    """Begin the sentence that says how the run went."""
    d: Any = result.description
    seconds = result.metrics.get("arms.led_s", 0.0)
    return f"{d.robot.name} hovered while its arms were led for {seconds:.0f} s"
