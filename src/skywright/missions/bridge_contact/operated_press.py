"""An operator presses the probe on a structure in flight: law (24) for the tip, then a force.

The robot moves the tip in front of the spot, offset by `HAND_OVER`, and hands over. The stick moves
platform and tip together with the arm in a fixed posture. From the first touch on, the stick's
component into the structure raises and lowers the force reference, which the robot's force loop
holds. If it lowers the force to zero, the stick moves the tip again. With the button the operator
confirms the force; the robot then holds it and measures.
"""

from __future__ import annotations

import numpy as np

from skywright.core.arrays import Array
from skywright.missions.bridge_contact.stations import Station
from skywright.missions.bridge_contact.task import BridgeContact
from skywright.missions.skills.assistance import LIMIT, Assistance
from skywright.missions.skills.moves import set_rest
from skywright.missions.skills.operated import Lead, OperatorGone, compute_velocity
from skywright.run.operator import Sight
from skywright.run.supervisor import Supervisor
from skywright.vehicle.plant import MISSION_TICK

HAND_OVER = np.array([-0.04, 0.02, 0.01])  # m: in front of the spot, and lateral offset
FENCE = np.array([[-0.15, -0.06, -0.06], [0.05, 0.06, 0.06]])
"""m, from the spot along the axes of the stick: lowest and highest position that it can command."""
CONTACT_N, CONTACT_S = 0.3, 0.1  # N, s: a touch
LOST_S = 1.0  # s without contact, after which the stick moves the tip again
RATE = 0.5  # 1/s, rate of the force at full deflection, relative to the requested force
MOST = 2.0  # largest force that the stick can command, relative to the requested force
LEAST_N = 0.2  # N; below it the stick moves the tip again
TOUCH, PRESS = "free touch", "free press"


class HandPress:
    """State of an operated press; each step is one tick."""

    def __init__(self, s: Supervisor, lead: Lead, at: Station, task: BridgeContact) -> None:
        """`at` is the station at whose spot the operator presses."""
        self.s, self.task, self.place = s, task, at.p_contact
        x = -at.normal
        left = np.cross([0.0, 0.0, 1.0], x) if abs(x[2]) < 0.9 else np.array(at.R_level[:, 1])
        left /= np.linalg.norm(left)
        self.R = np.column_stack([x, left, np.cross(x, left)])  # into it, left, up
        if abs(x[2]) >= 0.9:  # a deck: ahead, left, up
            self.R = np.column_stack([np.cross(left, x), left, x])
        self.into = int(abs(x[2]) >= 0.9) * 2  # axis of the stick that points into the structure
        self.asked = max(task.forces_n)
        self.help = Assistance(task.assistance, self.asked)
        self.lead = lead
        self.goal, self.force, self.exerts = self._measure(), 0.0, 0.0
        self.phase, self._felt, self._free = TOUCH, 0.0, 0.0

    @classmethod
    def place_before(cls, at: Station) -> Array:
        """Return the platform's position (3,) m at the hand-over, in the attitude of the press."""
        return at.p_press + at.R_dock @ HAND_OVER if abs(at.normal[2]) < 0.9 else (
            at.p_press + at.R_dock @ HAND_OVER[[1, 2, 0]]
        )  # fmt: skip

    def fly(self) -> str:
        """Fly "free touch" and "free press"; returns the reason of a failure, or ""."""
        self.s.begin(TOUCH)
        self.lead.begin()
        try:
            while not self.step():
                pass
        except OperatorGone as gone:
            self.s.end("failed")
            return f"{gone} before the force was held: the tip pressed with {self.force:.1f} N"
        finally:
            self.lead.end()
        return ""

    def step(self) -> bool:
        """Read the stick and fly a tick; returns whether the operator confirms the force."""
        s, task = self.s, self.task
        off = self._measure()
        self.force = max(float(s.vehicle.force), 0.0)
        towards = [0.0, 0.0, 0.0]
        towards[self.into] = 1.0
        stick = self.lead.read(
            Sight(off, False, (towards[0], towards[1], towards[2]), self.force, self.asked,
                  task.hold_s)
        )  # fmt: skip
        self._watch()
        if self.phase == PRESS and stick.button:
            return True
        inward = float(stick.axes[self.into])
        if self.phase == PRESS and self._exert(inward):
            return False
        axes, v_max = np.array(stick.axes), task.stick_speed_mps
        gap = -float(off[self.into])
        axes[self.into] = self.help.step(inward, v_max, gap, self.force) / v_max
        fence = FENCE if self.into == 0 else FENCE[:, [1, 2, 0]]
        v = compute_velocity(axes, v_max, self.goal, fence)
        self.goal = self.goal + MISSION_TICK * v
        row, v_W = set_rest(s.vehicle.reference), self.R @ v
        row["press"] = row["force"] = 0.0
        for p, rate in (("p_WB", "v_WB"), ("p_WT", "v_WT")):
            row[p] += MISSION_TICK * v_W
            row[rate] = v_W
        s.body.track(row[None])
        s.tick()
        return False

    def _measure(self) -> Array:
        """Return the tip's position relative to its spot, (3,) m along the axes of the stick."""
        return self.R.T @ (np.array(self.s.vehicle.estimate["p_WT"]) - self.place)

    def _watch(self) -> None:
        """Begin the phase that matches the contact."""
        touch = self.force > CONTACT_N
        self._felt = self._felt + MISSION_TICK if touch else 0.0
        self._free = 0.0 if touch else self._free + MISSION_TICK
        if self.phase == TOUCH and self._felt > CONTACT_S - 1e-9:
            self.phase = PRESS
            self.s.begin(PRESS)
        elif self.phase == PRESS and self._free > LOST_S:
            self.s.end("retry")
            self.phase, self.exerts, self.goal = TOUCH, 0.0, self._measure()
            self.s.begin(TOUCH)

    def _exert(self, inward: float) -> bool:
        """Change the force by the stick for a tick; returns whether the tip exerts one."""
        s, asked = self.s, self.asked
        if self.exerts == 0.0:
            self.exerts = max(self.force, CONTACT_N)
        change = RATE * asked * inward
        self.help.step(inward, self.task.stick_speed_mps, 0.0, self.force)
        if self.help.holding:
            change = min(max(asked - self.exerts, -RATE * asked), RATE * asked)
        most = (LIMIT if self.task.assistance == "guard" else MOST) * asked
        self.exerts = min(self.exerts + MISSION_TICK * change, most)
        if self.exerts < LEAST_N:
            self.exerts, self.goal = 0.0, self._measure()
            return False
        row = set_rest(s.vehicle.reference)
        row["press"], row["force"] = 1.0, self.exerts
        s.body.track(row[None])
        s.tick()
        return True
