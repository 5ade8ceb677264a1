"""An operator puts the tool onto the pipe: Suarez 2020, section VI-A.3 and law (24).

The robot brings the tool to a place beside its seat (`HAND_OVER`) and hands over: from then on the
stick moves both hands, as one device does in the paper. Since the tool is tracked, every
installation begins at the same place in the seat's frame, wherever pipe and bench stand; that is
why a recorded input fits again. The hands are led in W, so that they make up for the platform's
drift. The arms alone reach 7 cm down before their elbows are straight; so the platform follows the
hands' goal slowly, and they work where the handle lies well in the hooks. What the operator says is
done is believed only when the tool stands.
"""

import math

import numpy as np

from skywright.core.arrays import Array
from skywright.core.rotations import rot_z
from skywright.missions.skills.assistance import Assistance
from skywright.missions.skills.operated import Lead, OperatorGone, compute_velocity
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
from skywright.missions.tool_install.task import ToolInstall
from skywright.run.operator import STILL, Operator, Sight
from skywright.run.supervisor import Supervisor
from skywright.vehicle.arms.ports import Hands, HandState
from skywright.vehicle.plant import MISSION_TICK

HAND_OVER = np.array([-0.03, 0.03, 0.0])
"""m, ahead, left, up, of the tool from the place over its seat when the operator takes over."""
FENCE = np.array([[-0.08, -0.08, -0.06], [0.08, 0.08, 0.13]])
"""m, from the seat: lowest and highest place that the stick can ask for."""
SEATED_M = 0.015  # m, in height, within which a tool that is light counts as standing on the pipe
FOLLOW_RATE = 1.0  # 1/s, of the platform: it is 3 cm behind hands that move at 3 cm/s


def install_by_operator(
    s: Supervisor[ToolInstall], operator: Operator, grip: Grip, seat: Place, weight_n: float,
    speeds: tuple[float, float],
) -> str:  # fmt: skip
    """Fly the phases "install" and, where it failed, "take up again".

    `speeds` (m/s) are those of hands and platform. Returns "" with the
    tool standing on the pipe and the hooks drawn out, else why not, the tool lifted again where it
    still hangs on the hooks.
    """
    weight = Weight(s, weight_n)
    R = rot_z(seat.yaw)
    align_tool(s, weight, Place(seat.p_WO + R @ HAND_OVER, seat.yaw), 1.5 * weight_n)
    s.begin("install")
    q, height = np.array(s.vehicle.read(HandState).q_goal), _measure_height(s)
    reason = _operate(s, operator, grip, weight, weight_n, seat, s.task)
    s.vehicle.set_stick(STILL.axes, False)
    if reason == "":
        let_go(s, grip, speeds[0])
        return ""
    s.begin("take up again")
    _raise_hands(s, weight, 1.5 * weight_n, height, s.task.stick_speed_mps)
    s.arms.move_to(q[: s.vehicle.n_joints])
    s.until_arrived()
    return reason


def _operate(
    s: Supervisor, operator: Operator, grip: Grip, weight: Weight, weight_n: float, seat: Place,
    task: ToolInstall,
) -> str:  # fmt: skip
    """Let the operator move the hands until the tool stands; returns why it does not, or ""."""
    R = rot_z(seat.yaw)
    goal = R.T @ (measure_tool(s)[0] - seat.p_WO)
    led, platform = np.zeros(3), np.array(s.vehicle.reference["p_WB"])
    lead, help_ = Lead(s, operator), Assistance(task.assistance, weight_n)
    while True:
        p, R_WO = measure_tool(s)
        off = R.T @ (p - seat.p_WO)
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
        v = compute_velocity(axes, v_max, goal, FENCE)
        goal, led = goal + MISSION_TICK * v, led + MISSION_TICK * (R @ v)
        s.arms.hands_velocity({"left": R @ v, "right": R @ v})
        behind = platform + led - s.vehicle.reference["p_WB"]
        weight.step(s, FOLLOW_RATE * behind, 1.5 * weight_n)


def explain_loss(R_WO: Array) -> str:
    """Say why a tool at R_WO (3, 3) is not led any further: tilted, or away from the hands."""
    if R_WO[2, 2] > math.cos(TILT_MAX):
        return "the tool fell off the hooks"
    tilt = math.degrees(math.acos(max(R_WO[2, 2], -1.0)))
    return f"the tool was tilted by {tilt:.0f} deg: operator control was stopped"


def _explain(what: str, off: Array, weight: float) -> str:
    mm = ", ".join(f"{1e3 * x:.0f}" for x in off)
    return (
        f"{what} before the tool was seated: the tool was {mm} mm "
        f"(ahead, left, up) from its target, and the hands carried {weight:.1f} N"
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
