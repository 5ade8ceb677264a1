"""An operator puts the tool onto the pipe: Suarez 2020, section VI-A.3 and law (24).

The robot brings the tool to a place beside its seat (`HAND_OVER`) and hands over: from then on the
stick moves both hands (led_hands.py), as one device does in the paper. Since the tool is tracked,
every installation begins at the same place in the seat's frame, wherever pipe and bench stand; that
is why a recorded input fits again. What the operator says is done is believed only when the tool
stands.
"""

import math

import numpy as np

from skywright.core.arrays import Array
from skywright.core.rotations import rot_z
from skywright.missions.skills.assistance import Assistance
from skywright.missions.skills.operated import Lead, OperatorGone
from skywright.missions.skills.tool_handling import (
    LIGHT_N,
    TILT_MAX,
    Grip,
    Place,
    Weight,
    align_tool,
    hold_joints,
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
from skywright.vehicle.arms.ports import Hands, HandState

HAND_OVER = np.array([-0.03, 0.03, 0.0])
"""m, ahead, left, up, of the tool from the place over its seat when the operator takes over."""
FENCE = np.array([[-0.08, -0.08, -0.06], [0.08, 0.08, 0.13]])
"""m, from the seat: lowest and highest place that the stick can ask for."""


def install_by_operator(
    s: Supervisor[ToolInstall], lead: Lead, grip: Grip, seat: Place, weight_n: float,
    speeds: tuple[float, float],
) -> str:  # fmt: skip
    """Fly the phases "install" and, where it failed, "take up again".

    `speeds` (m/s) are those of hands and platform. Returns "" with the
    tool standing on the pipe and the hooks drawn out, else why not, the tool lifted again where it
    still hangs on the hooks.
    """
    weight = Weight(s, weight_n)
    R = rot_z(seat.yaw)
    align_tool(s, weight, Place(seat.p_WO + R @ HAND_OVER, seat.yaw), MOST * weight_n)
    s.begin("install")
    q, height = np.array(s.vehicle.read(HandState).q_goal), _measure_height(s)
    reason = _operate(s, lead, grip, weight, weight_n, seat)
    lead.end()
    if reason == "":
        let_go(s, grip, speeds[0])
        return ""
    s.begin("take up again")
    _raise_hands(s, weight, MOST * weight_n, height, s.task.stick_speed_mps)
    s.arms.move_to(q[: s.vehicle.n_joints])
    s.until_arrived()
    return reason


def _operate(
    s: Supervisor[ToolInstall], lead: Lead, grip: Grip, weight: Weight, weight_n: float,
    seat: Place,
) -> str:  # fmt: skip
    """Let the operator move the hands until the tool stands; returns why it does not, or ""."""
    task, p_WB = s.task, s.vehicle.reference["p_WB"]
    off = rot_z(seat.yaw).T @ (measure_tool(s)[0] - seat.p_WO)
    hands = LedHands(s, weight, weight_n, seat.yaw, off, p_WB)
    help_ = Assistance(task.assistance, weight_n)
    while True:
        p, R_WO = measure_tool(s)
        off = hands.R.T @ (p - seat.p_WO)
        if not is_at_hand(s, grip):
            return explain_loss(R_WO)
        try:
            stick = lead.read(Sight(off, weight.carried < LIGHT_N))
        except OperatorGone as gone:
            return _explain(str(gone), off, weight.carried)
        upright = R_WO[2, 2] > math.cos(TILT_MAX)
        if stick.button and weight.carried < LIGHT_N and upright and abs(off[2]) < SEATED_M:
            return ""
        axes, v_max, stands = np.array(stick.axes), task.stick_speed_mps, weight_n - weight.carried
        sink = help_.step(-axes[2], v_max, float(off[2]), max(stands, 0.0))
        axes[2] = -sink / v_max
        hands.step(axes, v_max, FENCE)


def _explain(what: str, off: Array, weight: float) -> str:
    return (
        f"{what} before the tool was seated: the tool was {describe_way(off)} from its target, "
        f"and the hands carried {weight:.1f} N"
    )


def _measure_height(s: Supervisor) -> float:
    """Height (m) of the hands, as estimated."""
    return float(np.mean(s.vehicle.read(Hands).p_WH[:2, 2]))


def _raise_hands(s: Supervisor, weight: Weight, most: float, height: float, speed: float) -> None:
    """Lead the hands straight up to `height` (m): a tool below comes along."""
    up = np.array([0.0, 0.0, speed])
    s.arms.hands_velocity({"left": up, "right": up})
    ends = s.vehicle.t + 1.5 * max(height - _measure_height(s), 0.0) / speed
    while _measure_height(s) < height and s.vehicle.t < ends:
        weight.step(s, np.zeros(3), most)
    hold_joints(s)
