"""An operator retrieves the tool from the pipe by law (24), as it was installed.

The robot moves the hooks below the handle, offset by `HAND_OVER`, and hands over. The stick moves
them below the handle ("hook") and raises them until they carry the tool; then it lifts the tool off
the pipe ("lift off"). The operator's confirmation takes effect only if the tool is suspended from
both hooks, clear of the pipe.

Beside the handle the hooks stay below it: higher, their tips would touch it from below and tip the
tool over.
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
    LOW,
    STEADY_S,
    TILT_MAX,
    Grip,
    Place,
    Weight,
    find_platform,
    is_at_hand,
    lead_hands,
    let_go,
)
from skywright.missions.skills.tool_pose import measure_tool
from skywright.missions.tool_install.led_hands import (
    FREE,
    MOST,
    SEATED_M,
    UP,
    LedHands,
    describe_way,
    explain_loss,
)
from skywright.missions.tool_install.task import ToolInstall
from skywright.run.operator import Sight
from skywright.run.orders import Detour
from skywright.run.supervisor import Supervisor
from skywright.vehicle.arms.ports import Hands
from skywright.vehicle.plant import MISSION_TICK

HAND_OVER = np.array([0.0, 0.02, 0.0])
"""m, ahead, left, up, from the hands' waiting position: 27 mm ahead of the handle, 75 mm below."""
FENCE = np.array([[-0.04, -0.03, -0.1], [0.06, 0.03, 0.13]])
"""m, of the hands from their holding position: lowest and highest position that the stick can
command. To the left and right there are 30 mm of clearance between hook and box (plan.HAND_ROOM).
"""
UNDER = 0.004  # m, by which the tips of hooks beside the handle stay below it
SET_DOWN, BACK_RATE = 0.5, 0.5  # deflection, and 1/s, when a tool is set down again
LEFT = "the tool was not taken"
HANGS, STANDS = 0.8, 0.4
"""Of the tool's weight: load of the hands above which they lift it, and below which it stands
again."""
HOOK, LIFT_OFF = "hook", "lift off"


def retrieve_by_operator(
    s: Supervisor[ToolInstall], lead: Lead, grip: Grip, place: Place, weight_n: float,
    speeds: tuple[float, float],
) -> tuple[float | None, str]:  # fmt: skip
    """Fly "hook" and "lift off" with the operator; the tool stands at `place`.

    Returns the weight (N) on the hooks, None if the tool stays on the pipe; and why the operator
    did not finish, or "".
    """
    work = _Retrieval(s, lead, grip, place, weight_n, speeds[0])
    detour = Detour(work.set_back, work.wait_beside)
    reason = s.orders.attempt("the handle", work.fly, LEFT, detour)
    if reason == LEFT:
        return None, reason
    if reason and not work.hangs:
        s.end("failed")
        work.set_back()
        return None, reason
    if reason:
        s.begin("take up again")
        work.lift()
    s.arms.move_to(grip.q)
    s.until_arrived()
    for _ in range(round(STEADY_S / MISSION_TICK)):
        work.weight.step(s, np.zeros(3), MOST * weight_n)
    return work.weight.carried, reason


class _Retrieval:
    """State of an operated retrieval, which an operator's order may interrupt."""

    def __init__(
        self, s: Supervisor[ToolInstall], lead: Lead, grip: Grip, place: Place, weight_n: float,
        hand_speed: float,
    ) -> None:  # fmt: skip
        self.s, self.lead, self.grip, self.place, self.weight_n = s, lead, grip, place, weight_n
        self.weight, self.R, self.hand_speed = Weight(s, 0.0), rot_z(place.yaw), hand_speed
        self.capture, self.below = compute_entry(s.vehicle.robot, grip)
        self._begin_anew()

    def _begin_anew(self) -> None:
        off = self._measure()
        platform = find_platform(self.grip, self.place) + self.R @ off
        self.hands = LedHands(self.s, self.weight, self.weight_n, self.place.yaw, off, platform)
        self.help = Assistance(self.s.task.assistance, self.weight_n)
        self.phase, self.raised, self.hangs = HOOK, 0.0, False

    def fly(self) -> str:
        """Let the operator move the hands until the tool is suspended; returns why it is not, or
        ""."""
        self.s.begin(HOOK)
        self.lead.begin()
        self._begin_anew()
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
        finally:
            self.lead.end()
        return ""

    def set_back(self) -> None:
        """Set down a lifted tool over its place, and draw the hooks out."""
        s, v_max = self.s, self.s.task.stick_speed_mps
        ends = s.vehicle.t + 4.0 * LIFT / v_max
        while self.weight.carried > LIGHT_N and s.vehicle.t < ends:
            off = self.R.T @ (measure_tool(s)[0] - self.place.p_WO)
            axes = -SET_DOWN * UP
            if off[2] > SEATED_M:
                axes[:2] = np.clip(-BACK_RATE / v_max * off[:2], -1.0, 1.0)
            self.hands.step(axes, v_max, FREE)
        let_go(s, self.grip, self.hand_speed)

    def wait_beside(self) -> None:
        """Move the hands from below the handle to the position of the hand-over."""
        lead_hands(self.s, self.grip, -LOW, self.hand_speed, HAND_OVER)

    def lift(self) -> None:
        """Continue to lift the tool without an operator."""
        v_max = self.s.task.stick_speed_mps
        ends = self.s.vehicle.t + 2.0 * LIFT / v_max
        while self.raised < LIFT and self.s.vehicle.t < ends:
            self.hands.step(UP, v_max, FENCE)
            self.raised = float((measure_tool(self.s)[0] - self.place.p_WO)[2])

    def _step(self) -> bool:
        """Read the stick and fly a tick; returns whether the retrieval is complete."""
        p, R_WO = measure_tool(self.s)
        carried, v_max = self.weight.carried, self.s.task.stick_speed_mps
        self.raised = float((p - self.place.p_WO)[2])
        upright = R_WO[2, 2] > math.cos(TILT_MAX)
        self.hangs = upright and self.raised > SEATED_M and carried > STANDS * self.weight_n
        done = self.hangs and self.raised > 0.9 * LIFT
        stick = self.lead.read(Sight(self._look(), done, (0.0, 0.0, 1.0)))
        if stick.button and self.hangs and self.raised > 0.5 * LIFT:
            return True
        self._watch(carried)
        axes, off = np.array(stick.axes), self._measure()
        axes[2] = self.help.step(axes[2], v_max, -float(off[2]), carried) / v_max
        if self.phase == LIFT_OFF:  # the tool has no contact any more
            axes[2] = stick.axes[2]
        fence = np.array(FENCE)
        if off[2] < 0.5 * self.below and float(np.hypot(off[0], off[1])) > self.capture:
            fence[1, 2] = self.below - UNDER
        self.hands.step(axes, v_max, fence)
        return False

    def _watch(self, carried: float) -> None:
        """Begin the phase that matches the load."""
        if self.phase == HOOK and carried > HANGS * self.weight_n:
            self._begin(LIFT_OFF)
        elif self.phase == LIFT_OFF and carried < STANDS * self.weight_n:
            self.s.end("retry")
            self._begin(HOOK)

    def _begin(self, phase: str) -> None:
        self.phase = phase
        self.s.begin(phase)

    def _measure(self) -> Array:
        """Return the hands' midpoint relative to its holding position, (3,) m: ahead, left, up."""
        p, R = measure_tool(self.s)
        middle = np.mean(self.s.vehicle.read(Hands).p_WH[:2], axis=0)
        off: Array = self.R.T @ (middle - p - R @ (self.grip.handle - self.grip.cradle))
        return off

    def _look(self) -> Array:
        """Return the error that the operator corrects, (3,) m: of the hooks, later of the tool.

        The goal of a tool on the hooks is LIFT above its place.
        """
        if self.phase == HOOK:
            return self._measure()
        off: Array = self.R.T @ (measure_tool(self.s)[0] - self.place.p_WO)
        off[2] -= LIFT
        return off
