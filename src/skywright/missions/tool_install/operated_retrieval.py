"""An operator takes the tool from the pipe again, by law (24) as it was put there.

The robot brings the hooks below the handle, beside the place by `HAND_OVER`, and hands over. The
stick brings them below the handle ("hook") and raises them until they carry the tool; then it
lifts the tool off the pipe ("lift off"). What the operator says is done is believed only when the
tool hangs in both hooks, clear of the pipe.

Beside the handle the hooks are led no higher than below it: higher, their tips would meet it from
below and tip the tool over.
"""

import math

import numpy as np

from skywright.core.arrays import Array
from skywright.core.rotations import rot_z
from skywright.missions.skills.assistance import Assistance
from skywright.missions.skills.hook_grip import compute_entry
from skywright.missions.skills.operated import Lead, OperatorGone
from skywright.missions.skills.tool_handling import (
    LIFT,
    LIGHT_N,
    STEADY_S,
    TILT_MAX,
    Grip,
    Place,
    Weight,
    find_platform,
    is_at_hand,
    let_go,
    measure_tool,
)
from skywright.missions.tool_install.led_hands import (
    MOST,
    SEATED_M,
    LedHands,
    describe_way,
    explain_loss,
)
from skywright.missions.tool_install.task import ToolInstall
from skywright.run.operator import Sight
from skywright.run.supervisor import Supervisor
from skywright.vehicle.arms.ports import Hands
from skywright.vehicle.plant import MISSION_TICK

HAND_OVER = np.array([0.0, 0.02, 0.0])
"""m, ahead, left, up, from where the hands wait for the handle: 27 mm ahead of it, 75 mm below."""
FENCE = np.array([[-0.04, -0.03, -0.1], [0.06, 0.03, 0.13]])
"""m, of the hands from where they hold the handle: lowest and highest place that the stick can ask
for. To the left and right 30 mm are free between hook and box (plan.HAND_ROOM)."""
UNDER = 0.004  # m, that the tips of hooks beside the handle stay below it
UP = (0.0, 0.0, 1.0)
HANGS, STANDS = 0.8, 0.4
"""Of the tool's weight: what the hands carry when they lift it, and when it stands again."""
HOOK, LIFT_OFF = "hook", "lift off"


def retrieve_by_operator(
    s: Supervisor[ToolInstall], lead: Lead, grip: Grip, place: Place, weight_n: float,
    speeds: tuple[float, float],
) -> tuple[float | None, str]:  # fmt: skip
    """Fly "hook" and "lift off" with the operator; the tool stands at `place`.

    Returns the weight (N) on the hooks, None where the tool was left on the pipe, and why the
    operator did not come to an end, or "".
    """
    work = _Retrieval(s, lead, grip, place, weight_n)
    lead.begin()
    s.begin(HOOK)
    reason = work.fly()
    lead.end()
    weight = work.weight
    if reason and not work.hangs:
        s.end("failed")
        _lower(s, weight, MOST * weight_n)
        let_go(s, grip, speeds[0])
        return None, reason
    if reason:
        s.begin("take up again")
        work.lift()
    s.arms.move_to(grip.q)
    s.until_arrived()
    for _ in range(round(STEADY_S / MISSION_TICK)):
        weight.step(s, np.zeros(3), MOST * weight_n)
    return weight.carried, reason


class _Retrieval:
    """The state of an operated retrieval; each step is one tick."""

    def __init__(
        self, s: Supervisor[ToolInstall], lead: Lead, grip: Grip, place: Place, weight_n: float
    ) -> None:
        self.s, self.lead, self.grip, self.place, self.weight_n = s, lead, grip, place, weight_n
        self.weight = Weight(s, 0.0)
        self.R = rot_z(place.yaw)
        off = self._measure()
        platform = find_platform(grip, place) + self.R @ off
        self.hands = LedHands(s, self.weight, weight_n, place.yaw, off, platform)
        self.help = Assistance(s.task.assistance, weight_n)
        self.capture, self.below = compute_entry(s.vehicle.robot, grip)
        self.phase, self.raised, self.hangs = HOOK, 0.0, False

    def fly(self) -> str:
        """Let the operator move the hands until the tool hangs; returns why it does not, or ""."""
        try:
            while not self._step():
                if not is_at_hand(self.s, self.grip):
                    self.hangs = False
                    return explain_loss(measure_tool(self.s)[1])
        except OperatorGone as gone:
            what = "the hands were" if self.phase == HOOK else "the tool hung"
            return (
                f"{gone} before the tool was lifted off: {what} "
                f"{describe_way(self._look())} from the place, and the hands carried "
                f"{self.weight.carried:.1f} N"
            )
        return ""

    def lift(self) -> None:
        """Lift the tool on, without an operator."""
        v_max = self.s.task.stick_speed_mps
        ends = self.s.vehicle.t + 2.0 * LIFT / v_max
        while self.raised < LIFT and self.s.vehicle.t < ends:
            self.hands.step(np.array(UP), v_max, FENCE)
            self.raised = float((measure_tool(self.s)[0] - self.place.p_WO)[2])

    def _step(self) -> bool:
        """Read the stick and fly a tick; returns whether the operator is done."""
        p, R_WO = measure_tool(self.s)
        carried, v_max = self.weight.carried, self.s.task.stick_speed_mps
        self.raised = float((p - self.place.p_WO)[2])
        upright = R_WO[2, 2] > math.cos(TILT_MAX)
        self.hangs = upright and self.raised > SEATED_M and carried > STANDS * self.weight_n
        done = self.hangs and self.raised > 0.9 * LIFT
        stick = self.lead.read(Sight(self._look(), done, UP))
        if stick.button and self.hangs and self.raised > 0.5 * LIFT:
            return True
        self._watch(carried)
        axes, off = np.array(stick.axes), self._measure()
        axes[2] = self.help.step(axes[2], v_max, -float(off[2]), carried) / v_max
        if self.phase == LIFT_OFF:  # nothing is touched any more
            axes[2] = stick.axes[2]
        fence = np.array(FENCE)
        if off[2] < 0.5 * self.below and float(np.hypot(off[0], off[1])) > self.capture:
            fence[1, 2] = self.below - UNDER
        self.hands.step(axes, v_max, fence)
        return False

    def _watch(self, carried: float) -> None:
        """Follow the tool by the phases."""
        if self.phase == HOOK and carried > HANGS * self.weight_n:
            self._begin(LIFT_OFF)
        elif self.phase == LIFT_OFF and carried < STANDS * self.weight_n:
            self.s.end("retry")
            self._begin(HOOK)

    def _begin(self, phase: str) -> None:
        self.phase = phase
        self.s.begin(phase)

    def _measure(self) -> Array:
        """Where the hands' middle is from where it holds the handle, (3,) m: ahead, left, up."""
        p, R = measure_tool(self.s)
        middle = np.mean(self.s.vehicle.read(Hands).p_WH[:2], axis=0)
        off: Array = self.R.T @ (middle - p - R @ (self.grip.handle - self.grip.cradle))
        return off

    def _look(self) -> Array:
        """What is led from its place, (3,) m: the hooks from the handle, then the tool from above.

        A tool on the hooks shall hang LIFT above where it stood.
        """
        if self.phase == HOOK:
            return self._measure()
        off: Array = self.R.T @ (measure_tool(self.s)[0] - self.place.p_WO)
        off[2] -= LIFT
        return off


def _lower(s: Supervisor, weight: Weight, most: float) -> None:
    """Lower the hands as they came until nothing hangs on them."""
    down = np.array([0.0, 0.0, -s.task.stick_speed_mps])
    s.arms.hands_velocity({"left": down, "right": down})
    ends = s.vehicle.t + 3.0 * SEATED_M / s.task.stick_speed_mps
    while weight.carried > LIGHT_N and s.vehicle.t < ends:
        weight.step(s, np.zeros(3), most)
