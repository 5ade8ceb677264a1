"""An operator installs the tool on the pipe: Suarez 2020, section VI-A.3 and law (24).

The robot moves the tool beside its seat (`HAND_OVER`) and hands over. From then on the stick moves
both hands (led_hands.py), as a single device does in the paper. Since the tool is tracked, every
installation begins at the same position in the seat's frame, independent of pipe and bench. A
recorded input is therefore reusable. The operator's confirmation takes effect only if the tool
stands.
"""

import math

import numpy as np

from skywright.core.rotations import rot_z
from skywright.missions.skills.assistance import Assistance
from skywright.missions.skills.operated import Lead, OperatorGone
from skywright.missions.skills.tool_handling import (
    LEFT_OUT,
    LIGHT_N,
    TILT_MAX,
    Grip,
    Place,
    Weight,
    align_tool,
    is_at_hand,
    let_go,
)
from skywright.missions.skills.tool_pose import measure_tool
from skywright.missions.tool_install.led_hands import (
    MOST,
    SEATED_M,
    LedHands,
    describe_way,
    explain_loss,
)
from skywright.missions.tool_install.task import ToolInstall
from skywright.run.operator import Sight
from skywright.run.orders import Detour
from skywright.run.supervisor import Supervisor

HAND_OVER = np.array([-0.03, 0.03, 0.0])
"""m, ahead, left, up, position of the tool relative to its seat at the hand-over."""
FENCE = np.array([[-0.08, -0.08, -0.06], [0.08, 0.08, 0.13]])
"""m, from the seat: lowest and highest position that the stick can command."""


def install_by_operator(
    s: Supervisor[ToolInstall], lead: Lead, grip: Grip, seat: Place, weight_n: float,
    speeds: tuple[float, float],
) -> str:  # fmt: skip
    """Fly the phases "install" and, after a failure, "take up again".

    `speeds` (m/s) are those of hands and platform. Returns "" if the tool stands on the pipe and
    the hooks are drawn out. Otherwise returns the reason; a tool still on the hooks is lifted
    again.
    """
    work = _Install(s, lead, grip, seat, weight_n)
    detour = Detour(work.go_back, work.align)
    work.align()
    reason = s.orders.attempt("the place of 'install'", work.fly, LEFT_OUT, detour)
    if not reason:
        let_go(s, grip, speeds[0])
    elif reason != LEFT_OUT:
        s.begin("take up again")
        work.go_back()
    return reason


class _Install:
    """State of an operated installation, which an operator's order may interrupt."""

    def __init__(
        self, s: Supervisor[ToolInstall], lead: Lead, grip: Grip, seat: Place, weight_n: float
    ) -> None:
        self.s, self.lead, self.grip, self.seat, self.weight_n = s, lead, grip, seat, weight_n
        self.weight, self.most = Weight(s, weight_n), MOST * weight_n
        self.hands: LedHands | None = None

    def align(self) -> None:
        """Move the suspended tool to the position of the hand-over."""
        start = self.seat.p_WO + rot_z(self.seat.yaw) @ HAND_OVER
        align_tool(self.s, self.weight, Place(start, self.seat.yaw), self.most)

    def go_back(self) -> None:
        """Move the hands back there; a tool that stands comes along."""
        if self.hands is not None:
            self.hands.go_back(self.s.task.stick_speed_mps)

    def fly(self) -> str:
        """Let the operator move the hands until the tool stands; returns why it does not, or ""."""
        s, seat = self.s, self.seat
        s.begin("install")
        self.lead.begin()
        off = rot_z(seat.yaw).T @ (measure_tool(s)[0] - seat.p_WO)
        p_WB = s.vehicle.reference["p_WB"]
        self.hands = LedHands(s, self.weight, self.weight_n, seat.yaw, off, p_WB)
        help_ = Assistance(s.task.assistance, self.weight_n)
        try:
            while not self._step(self.hands, help_):
                if not is_at_hand(s, self.grip):
                    return explain_loss(measure_tool(s)[1])
        except OperatorGone as gone:
            off = self.hands.R.T @ (measure_tool(s)[0] - seat.p_WO)
            return (
                f"{gone} before the tool was seated: the tool was {describe_way(off)} from its "
                f"target, and the hands carried {self.weight.carried:.1f} N"
            )
        finally:
            self.lead.end()
        return ""

    def _step(self, hands: LedHands, help_: Assistance) -> bool:
        """Read the stick and fly a tick; returns whether the installation is complete."""
        p, R_WO = measure_tool(self.s)
        off, carried = hands.R.T @ (p - self.seat.p_WO), self.weight.carried
        stick = self.lead.read(Sight(off, carried < LIGHT_N))
        upright = R_WO[2, 2] > math.cos(TILT_MAX)
        if stick.button and carried < LIGHT_N and upright and abs(off[2]) < SEATED_M:
            return True
        axes, v_max = np.array(stick.axes), self.s.task.stick_speed_mps
        sink = help_.step(-axes[2], v_max, float(off[2]), max(self.weight_n - carried, 0.0))
        axes[2] = -sink / v_max
        hands.step(axes, v_max, FENCE)
        return False
